//! What closures of a volume share: coefficients, the phase function's sockets, and number types.
//!
//! A closure that fills a medium adds scattering, extinction and emission per metre of world space and
//! channel. Its formula is written once ([`Formula`]) and runs on f64 and on intervals, so that values
//! and bounds cannot differ. All formulas are Cycles 5.0.1's, measured with an absorption probe: a
//! homogeneous cube of edge 2 before a world of radiance 1 transmits `exp(-2 extinction)`.

use crate::base::arrays::{Mapped, each};
use crate::nodes::{InputSocket, Interval, Mode, Property};
use std::ops::{Add, Mul, Sub};

/// A medium's coefficients, linear Rec. 709.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Coefficients<Q> {
    /// Scattered part of the radiance per metre; at least 0.
    pub scattering: [Q; 3],
    /// Scattered and absorbed part of the radiance per metre. Colours outside of [0, 1] can make it
    /// negative, in Cycles too.
    pub extinction: [Q; 3],
    /// Radiance per metre; may be negative.
    pub emission: [Q; 3],
}

/// A number or the interval of a number. NaN passes through every operation, so that it is seen.
pub trait Quantity: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// A constant of a formula.
    fn of(value: f64) -> Self;
    /// The value, or 0 where it is negative.
    fn positive_part(self) -> Self;
    /// The value between these limits.
    fn limited(self, low: f64, high: f64) -> Self;
    /// Image under a function that does not decrease in either argument.
    fn increasing_in_both(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self;
    /// Image under a function that is defined piece by piece: `function` holds from each knot to the
    /// next, with the piece's number and an argument within the piece.
    fn piecewise<const C: usize>(self, knots: &[f64], function: impl Fn(usize, Self) -> [Self; C]) -> [Self; C];
    /// The reciprocal of a positive number.
    fn reciprocal(self) -> Self;
}

impl Quantity for f64 {
    fn of(value: f64) -> Self {
        value
    }
    fn positive_part(self) -> Self {
        if self < 0.0 { 0.0 } else { self }
    }
    fn limited(self, low: f64, high: f64) -> Self {
        // Keeps NaN, unlike minimum and maximum.
        self.clamp(low, high)
    }
    fn increasing_in_both(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self {
        function(self, other)
    }
    fn piecewise<const C: usize>(self, knots: &[f64], function: impl Fn(usize, Self) -> [Self; C]) -> [Self; C] {
        function(knots.partition_point(|&knot| knot <= self).saturating_sub(1), self)
    }
    fn reciprocal(self) -> Self {
        1.0 / self
    }
}

impl Quantity for Interval {
    fn of(value: f64) -> Self {
        // The constants of the formulas are no f32 numbers: the pad holds the exact one.
        if value == 0.0 || value == 1.0 { Self::point(value as f32) } else { Self::outward(value, value, false) }
    }
    fn positive_part(self) -> Self {
        self.greater(Self::ZERO).or_nan(self.may_be_nan)
    }
    fn limited(self, low: f64, high: f64) -> Self {
        let [a, b] = self.ends().mapped(|end| end.clamp(low, high));
        Self::outward(a, b, self.may_be_nan)
    }
    fn increasing_in_both(self, other: Self, function: impl Fn(f64, f64) -> f64) -> Self {
        let ([a, b], [c, d]) = (self.ends(), other.ends());
        Self::outward(function(a, c), function(b, d), self.may_be_nan || other.may_be_nan)
    }
    fn piecewise<const C: usize>(self, knots: &[f64], function: impl Fn(usize, Self) -> [Self; C]) -> [Self; C] {
        let [low, high] = self.ends();
        let mut result: Option<[Self; C]> = None;
        for (piece, &begin) in knots.iter().enumerate() {
            let first = if piece == 0 { f64::NEG_INFINITY } else { begin };
            let last = knots.get(piece + 1).copied().unwrap_or(f64::INFINITY);
            if low > last || high < first {
                continue;
            }
            let part = Self::outward(low.max(first), high.min(last), self.may_be_nan);
            let found = function(piece, part);
            result = Some(match result {
                None => found,
                Some(known) => each(|index| known[index].hull(found[index])),
            });
        }
        result.unwrap_or([Self::EVERYTHING; C])
    }
    fn reciprocal(self) -> Self {
        Self::ONE.divide(self)
    }
}

/// A phase function as a node describes it; `integrate::phase` evaluates and samples it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Phase {
    /// Henyey-Greenstein.
    HenyeyGreenstein {
        /// Mean cosine; above 0 is forward.
        anisotropy: f64,
    },
    /// Rayleigh.
    Rayleigh,
    /// Draine.
    Draine {
        /// Anisotropy of the Henyey-Greenstein factor.
        anisotropy: f64,
        /// Weight of the squared cosine.
        alpha: f64,
    },
    /// Fournier-Forand, for water.
    FournierForand {
        /// Index of refraction of the particles, relative to the water.
        ior: f64,
        /// Share of the light that goes back.
        backscatter: f64,
    },
    /// Fit to Mie scattering of water droplets (Jendersie and d'Eon 2023).
    Mie {
        /// Micrometres.
        diameter: f64,
    },
}

/// A closure's coefficients, written once for every [`Quantity`].
pub trait Formula: Send + Sync {
    /// Coefficients; `inputs` are the components of the existing value inputs in socket order.
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q>;
    /// Phase function, if the closure scatters at all.
    fn phase(&self, inputs: &[f64]) -> Option<Phase>;
}

/// A closure in one mode, ready to evaluate; see [`Formula`].
pub trait VolumeClosure: Send + Sync {
    /// Coefficients at a point.
    fn coefficients(&self, inputs: &[f64]) -> Coefficients<f64>;
    /// What holds every coefficient for inputs within these intervals.
    fn bounds(&self, inputs: &[Interval]) -> Coefficients<Interval>;
    /// Phase function at a point, if the closure scatters at all.
    fn phase(&self, inputs: &[f64]) -> Option<Phase>;
}

impl<F: Formula> VolumeClosure for F {
    fn coefficients(&self, inputs: &[f64]) -> Coefficients<f64> {
        Formula::coefficients(self, inputs)
    }
    fn bounds(&self, inputs: &[Interval]) -> Coefficients<Interval> {
        Formula::coefficients(self, inputs)
    }
    fn phase(&self, inputs: &[f64]) -> Option<Phase> {
        Formula::phase(self, inputs)
    }
}

/// What a closure does in the graph.
#[derive(Clone, Copy)]
pub enum ClosureRole {
    /// Fills the medium: builds the formula of a mode.
    Medium(fn(&Mode) -> Box<dyn VolumeClosure>),
    /// Adds two closures.
    Add,
    /// Mixes two closures by a factor.
    Mix,
}

/// The property that chooses the phase function; the first is Blender's default.
pub const PHASE: Property =
    Property::choice("phase", &["HENYEY_GREENSTEIN", "FOURNIER_FORAND", "DRAINE", "RAYLEIGH", "MIE"]);

/// Anisotropy of Henyey-Greenstein and Draine.
pub const ANISOTROPY: InputSocket = InputSocket::float("Anisotropy", "Anisotropy", &[0.0], |mode| {
    matches!(mode.choice("phase"), "HENYEY_GREENSTEIN" | "DRAINE")
});
/// Index of refraction of Fournier-Forand.
pub const IOR: InputSocket =
    InputSocket::float("IOR", "IOR", &[1.33], |mode| mode.choice("phase") == "FOURNIER_FORAND");
/// Backscattered share of Fournier-Forand.
pub const BACKSCATTER: InputSocket =
    InputSocket::float("Backscatter", "Backscatter", &[0.1], |mode| mode.choice("phase") == "FOURNIER_FORAND");
/// Weight of the squared cosine in Draine.
pub const ALPHA: InputSocket = InputSocket::float("Alpha", "Alpha", &[0.5], |mode| mode.choice("phase") == "DRAINE");
/// Droplet diameter of Mie.
pub const DIAMETER: InputSocket =
    InputSocket::float("Diameter", "Diameter", &[20.0], |mode| mode.choice("phase") == "MIE");
/// Blender gives every closure a weight that it does not use.
pub const WEIGHT: InputSocket = InputSocket::float("Weight", "Weight", &[0.0], |_| false);

/// The chosen phase function; `parameters` begin with its own inputs in socket order.
pub fn phase(name: &str, parameters: &[f64]) -> Phase {
    match name {
        "RAYLEIGH" => Phase::Rayleigh,
        "DRAINE" => Phase::Draine { anisotropy: parameters[0], alpha: parameters[1] },
        "FOURNIER_FORAND" => Phase::FournierForand { ior: parameters[0], backscatter: parameters[1] },
        "MIE" => Phase::Mie { diameter: parameters[0] },
        _ => Phase::HenyeyGreenstein { anisotropy: parameters[0] },
    }
}

/// Reads a colour or vector from component `first` on.
pub fn triple<Q: Copy>(inputs: &[Q], first: usize) -> [Q; 3] {
    [inputs[first], inputs[first + 1], inputs[first + 2]]
}

/// Channel by channel.
pub fn per_channel<Q>(function: impl FnMut(usize) -> Q) -> [Q; 3] {
    std::array::from_fn(function)
}

/// Nothing in any channel.
pub fn nothing<Q: Quantity>() -> [Q; 3] {
    [Q::of(0.0); 3]
}
