//! What a step through constant coefficients lets through and adds: the one text of every march and of the path tracer, generic over
//! f32 and f64. Twin on the adapter: `shaders/media/transfer.wgsl`.
//!
//! With the optical depth d of a step, at least 0 and without a unit,
//!
//! - [`transmittance`] is exp(-d);
//! - [`absorbed`] is 1 - exp(-d);
//! - [`mean_transmittance`] is (1 - exp(-d)) / d, the mean of the transmittance over the step: times the length of the step it is the
//!   weight of the energy-conserving rule (Hillaire 2015), with nothing divided by an extinction that may be 0.
//!
//! NaN is not caught: it has to reach the picture. `cloudparity stability` measures all three over 1e-6 to 1e6.

use crate::base::choice::choice;
pub use crate::base::interpolation::smooth;
use num_traits::Float;

/// Below this depth the mean transmittance, 1 - d / 2 + ..., rounds to 1 in f64 as in f32, and nothing is divided by 0.
const NO_DEPTH: f64 = 1e-16;

/// A constant in the number type at work.
pub(crate) fn constant<T: Float>(value: f64) -> T {
    T::from(value).expect("a float holds any double, rounded")
}

/// Share of light that a step lets through.
pub fn transmittance<T: Float>(depth: T) -> T {
    (-depth).exp()
}

/// Share of light that a step keeps, without the difference of 1 and an exponential, which loses the bits of a small depth.
pub fn absorbed<T: Float>(depth: T) -> T {
    -(-depth).exp_m1()
}

/// Mean of the transmittance over a step.
pub fn mean_transmittance<T: Float>(depth: T) -> T {
    if depth < constant(NO_DEPTH) { T::one() } else { absorbed(depth) / depth }
}

/// What the source of a step is multiplied with, transmittance left out: a length.
pub fn step_weight<T: Float>(integration: Integration, extinction: T, step: T) -> T {
    match integration {
        Integration::Plain => step,
        Integration::EnergyConserving => mean_transmittance(extinction * step) * step,
    }
}

choice! {
    "kebab-case",
    /// How a step of a view ray adds what is scattered and emitted along it; [`crate::integrators::march`] gives the formulas.
    pub enum Integration {
        /// The integral over the step, exact for constant coefficients.
        EnergyConserving,
        /// The value at the step's begin times its length: brighter than the truth, without bound as
        /// extinction times step grows.
        Plain,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_without_extinction_weighs_its_length() {
        for extinction in [0.0, 1e-300, 1e-20, 1e-9, 1e-7] {
            let found = step_weight(Integration::EnergyConserving, extinction, 0.25);
            let lost: f64 = (found / 0.25 - 1.0).abs();
            assert!(lost <= 0.5 * extinction * 0.25 + f64::EPSILON, "{extinction}: {found}");
        }
        assert_eq!(mean_transmittance(0.0_f32), 1.0);
        assert_eq!(mean_transmittance(0.0_f64), 1.0);
    }

    #[test]
    fn an_opaque_step_weighs_a_mean_free_path() {
        for depth in [1e2_f64, 1e4, 1e6] {
            assert_eq!(step_weight(Integration::EnergyConserving, depth, 1.0), 1.0 / depth);
            assert_eq!(step_weight(Integration::Plain, depth, 1.0), 1.0);
            assert_eq!(transmittance(depth as f32 * 1e32), 0.0);
        }
    }

    #[test]
    fn what_is_no_number_stays_to_be_seen() {
        assert!(mean_transmittance(f64::NAN).is_nan() && transmittance(f32::NAN).is_nan());
    }
}
