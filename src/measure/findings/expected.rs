//! Closed forms: what pictures of the small scenes come to, if Cycles does what a finding claims.
//!
//! A medium whose extinction is independent at every point has, along a ray of length L, the transmittance exp(-L times its mean): the
//! fluctuations average out within any length. An estimator that evaluates the extinction at m points and takes the exponential of their sum has the
//! expectation of a product of m independent factors, which is larger (Jensen's inequality).

use crate::media::phase::{draine, henyey_greenstein};

/// Steps of the most precise order that the estimator of null collision takes, per unit of the majorant's optical depth.
pub const STEPS_PER_DEPTH: f64 = 16.0;

/// An extinction that is independent at every point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// `value` with the probability `share`, otherwise 0.
    TwoValued {
        /// Per unit length.
        value: f64,
        /// Probability.
        share: f64,
    },
    /// Uniform in 0 to `value`.
    Uniform {
        /// Per unit length.
        value: f64,
    },
}

impl Noise {
    /// Mean extinction.
    pub fn mean(self) -> f64 {
        match self {
            Self::TwoValued { value, share } => value * share,
            Self::Uniform { value } => value / 2.0,
        }
    }

    /// The largest extinction.
    pub fn majorant(self) -> f64 {
        match self {
            Self::TwoValued { value, .. } | Self::Uniform { value } => value,
        }
    }

    /// Expectation of exp(-extinction * length) with one evaluation.
    fn factor(self, length: f64) -> f64 {
        match self {
            Self::TwoValued { value, share } => 1.0 - share + share * (-value * length).exp(),
            Self::Uniform { value } => -(-value * length).exp_m1() / (value * length),
        }
    }

    /// Transmittance of a ray.
    pub fn transmittance(self, length: f64) -> f64 {
        (-self.mean() * length).exp()
    }

    /// What ray marching comes to: whole steps from the entry on, and the rest in one.
    pub fn marched(self, length: f64, step: f64) -> f64 {
        let [whole, rest] = steps(length, step);
        let last = if rest > 0.0 { self.factor(rest) } else { 1.0 };
        self.factor(step).powf(whole) * last
    }

    /// What a march of so many equal steps comes to.
    pub fn marched_in(self, length: f64, count: f64) -> f64 {
        self.factor(length / count).powf(count)
    }
}

/// Whole steps, and the length of the rest; a rest of rounding is none.
fn steps(length: f64, step: f64) -> [f64; 2] {
    let whole = (length / step + 1e-9).floor();
    let rest = length - whole * step;
    [whole, if rest > 1e-9 * length { rest } else { 0.0 }]
}

/// Where between voxels an extinction is taken from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Lookup {
    /// From one voxel, drawn with the weight that it has in the trilinear interpolation.
    OneVoxel,
    /// The interpolation.
    Interpolated,
}

/// Ray marching along an axis through a checkerboard of voxels of 0 and `value`: rays anywhere beside, one offset for all steps of a ray.
///
/// At a place, the interpolation is value (1 + c q) / 2: c, the product of two triangle waves, belongs to the ray, q, the third, to the place.
/// Midpoint rule over the offset and both waves; `points` of each (error below 1e-5 of the value for 48).
pub fn checkerboard(value: f64, voxel: f64, length: f64, step: f64, lookup: Lookup, points: u32) -> f64 {
    let [whole, rest] = steps(length, step);
    let mut lengths = vec![step; whole as usize];
    if rest > 0.0 {
        lengths.push(rest);
    }
    let middles: Vec<f64> = (0..points).map(|index| (f64::from(index) + 0.5) / f64::from(points)).collect();
    let mut sum = 0.0;
    for offset in &middles {
        let waves: Vec<[f64; 2]> = lengths
            .iter()
            .enumerate()
            .map(|(index, length)| {
                let place = ((index as f64 * step + offset * length) / voxel - 0.5).rem_euclid(2.0);
                [2.0 * (place - 1.0).abs() - 1.0, *length]
            })
            .collect();
        for first in &middles {
            for second in &middles {
                let wave = first * second;
                let factor = |[third, length]: &[f64; 2]| {
                    let share = 0.5 * (1.0 + wave * third);
                    match lookup {
                        Lookup::OneVoxel => 1.0 + share * (-value * length).exp_m1(),
                        Lookup::Interpolated => (-value * length * share).exp(),
                    }
                };
                sum += waves.iter().map(factor).product::<f64>();
            }
        }
    }
    sum / f64::from(points).powi(3)
}

/// Henyey-Greenstein lobes: weights that sum to 1, and anisotropies.
pub type Lobes = [[f64; 2]];

/// Light that is scattered once out of a uniform world, over what the phase function says (1), where the world is sampled, too, and hits of the
/// phase function are weighted by the density of the lobe that was drawn instead of that of all.
///
/// With the power heuristic w(a, b) = a^2 / (a^2 + b^2) (Veach 1997, equation 9.13) and the density c of light sampling, next-event
/// estimation gives the integral of p w(c, p), and lobe i, drawn with its weight, that of p_i w(p_i, c) instead of p_i w(p, c).
pub fn lobes_weighted_apart(lobes: &Lobes) -> f64 {
    let uniform = 1.0 / (4.0 * std::f64::consts::PI);
    let heuristic = |own: f64, other: f64| own * own / (own * own + other * other);
    let excess = |cosine: f64| {
        let phases = || lobes.iter().map(|[weight, g]| (*weight, henyey_greenstein(*g, cosine)));
        let all: f64 = phases().map(|(weight, phase)| weight * phase).sum();
        let of_lobe =
            |(weight, phase): (f64, f64)| weight * phase * (heuristic(phase, uniform) - heuristic(all, uniform));
        phases().map(of_lobe).sum()
    };
    1.0 + 2.0 * std::f64::consts::PI * over_cosines(excess)
}

/// Mean cosine of the Draine phase function.
pub fn draine_mean_cosine(anisotropy: f64, alpha: f64) -> f64 {
    2.0 * std::f64::consts::PI * over_cosines(|cosine| cosine * draine(anisotropy, alpha, cosine))
}

/// Integral over -1 to 1: Simpson's rule. Functions are smooth: its error is below 1e-9 for |g| up to 0.8.
fn over_cosines(function: impl Fn(f64) -> f64) -> f64 {
    const INTERVALS: u32 = 20_000;
    let width = 2.0 / f64::from(INTERVALS);
    let weighted = |index: u32| {
        let weight = match index {
            0 | INTERVALS => 1.0,
            index if index % 2 == 1 => 4.0,
            _ => 2.0,
        };
        weight * function(-1.0 + f64::from(index) * width)
    };
    (0..=INTERVALS).map(weighted).sum::<f64>() * width / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};

    /// The closed forms are those of the estimators: drawn as the estimators draw, within 5 standard errors (chance 6e-7 each).
    #[test]
    fn drawn_marches_have_the_closed_forms_as_means() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let noises = [Noise::TwoValued { value: 4.0, share: 0.25 }, Noise::Uniform { value: 3.0 }];
        for noise in noises {
            for (length, step) in [(2.0, 0.5), (2.0, 0.3)] {
                let count = 200_000;
                let (mut sum, mut squares) = (0.0, 0.0);
                for _ in 0..count {
                    let (mut depth, mut at) = (0.0, 0.0);
                    while length - at > 1e-9 {
                        let size = f64::min(step, length - at);
                        depth += size
                            * match noise {
                                Noise::TwoValued { value, share } => {
                                    if random.random::<f64>() < share {
                                        value
                                    } else {
                                        0.0
                                    }
                                }
                                Noise::Uniform { value } => value * random.random::<f64>(),
                            };
                        at += size;
                    }
                    let found = f64::exp(-depth);
                    sum += found;
                    squares += found * found;
                }
                let mean = sum / f64::from(count);
                let error = ((squares / f64::from(count) - mean * mean) / f64::from(count)).sqrt();
                let expected = noise.marched(length, step);
                assert!((mean - expected).abs() < 5.0 * error, "{noise:?} {step} {mean} {expected} {error}");
                // More steps come nearer to the truth, from above.
                let truth = noise.transmittance(length);
                assert!(noise.marched_in(length, 64.0) > truth && noise.marched_in(length, 64.0) < expected);
                assert!((noise.marched_in(length, 1e7) / truth - 1.0).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn the_checkerboard_has_its_limits() {
        // Even numbers of voxels: interpolated, with steps of a voxel, the waves of neighbours cancel.
        let truth = f64::exp(-4.0);
        let voxel = 1.0 / 32.0;
        let interpolated = checkerboard(4.0, voxel, 2.0, voxel, Lookup::Interpolated, 16);
        assert!((interpolated - truth).abs() < 1e-12, "{interpolated}");
        let one = |points| checkerboard(4.0, voxel, 2.0, voxel, Lookup::OneVoxel, points);
        assert!((one(48) / one(96) - 1.0).abs() < 1e-5);
        // Below independent draws at every step, as neighbours are opposite; above the truth.
        let independent = Noise::TwoValued { value: 4.0, share: 0.5 }.marched(2.0, voxel);
        assert!(one(48) > truth && one(48) < independent);
    }

    #[test]
    fn lobes_that_are_one_have_no_excess() {
        assert!((lobes_weighted_apart(&[[0.7, 0.6], [0.3, 0.6]]) - 1.0).abs() < 1e-12);
        assert!(lobes_weighted_apart(&[[0.7, 0.8], [0.3, -0.3]]) > 1.01);
    }

    /// Draine's mean cosine by its moments: g (1 + a (3 + 2 g^2) / 5) / (1 + a (1 + 2 g^2) / 3).
    #[test]
    fn the_mean_cosine_is_that_of_the_moments() {
        for (g, a) in [(0.01, 20.0), (0.5, 1.0), (0.1, 20.0), (-0.3, 0.5)] {
            let moments = g * (1.0 + a * (3.0 + 2.0 * g * g) / 5.0) / (1.0 + a * (1.0 + 2.0 * g * g) / 3.0);
            assert!((draine_mean_cosine(g, a) - moments).abs() < 1e-9);
        }
    }
}
