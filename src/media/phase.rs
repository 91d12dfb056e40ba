//! Phase functions: how a scattering event turns light.
//!
//! `p(c)` is in 1/sr, for the cosine c between the directions of travel before and after, so c = 1 goes on
//! straight; its integral over the sphere is 1. Formulas and limits are those of Cycles 5.0.1, whose evaluation
//! was measured against them with delta lights. (Cycles' importance sampling of some of them is not exact;
//! sampling here is.)
//!
//! * Henyey and Greenstein 1941; isotropic below |g| = 0.001, as in Cycles.
//! * Rayleigh.
//! * Draine 2003; Rayleigh where |g| < 0.001 and alpha > 0.999, as in Cycles.
//! * Fournier and Forand 1994, with the slope that a backscattered share implies.
//! * Mie: the mixture of Henyey-Greenstein and Draine that Jendersie and d'Eon (2023) fitted to fog droplets.
//!
//! Sampling inverts the distribution function with one uniform number: in closed form for Henyey-Greenstein,
//! by Newton steps kept within a bracket for the others.

use crate::media::transfer::constant;
use crate::nodes::closure::Phase;
use glam::DVec3;
use num_traits::Float;
use std::f64::consts::PI;

/// Surface of the unit sphere.
const SPHERE: f64 = 4.0 * PI;

/// Anisotropies are kept this far within (-1, 1).
const LARGEST_ANISOTROPY: f64 = 0.999;

/// Below this anisotropy Cycles takes Henyey-Greenstein as isotropic.
const SMALLEST_ANISOTROPY: f64 = 0.001;

/// Below this anisotropy the closed inverse of the distribution, which divides a difference of nearly equal numbers by the anisotropy,
/// is written without that division.
const SMALL_ANISOTROPY: f64 = 0.25;

/// A lobe of a phase function that is a sum of several: Henyey and Greenstein's, or with an alpha Draine's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScatteringLobe {
    /// Its share of the light that is scattered, 0 to 1.
    pub share: f64,
    /// Its anisotropy.
    pub anisotropy: f64,
    /// Draine's alpha; 0 is Henyey and Greenstein's.
    pub alpha: f64,
}

/// A phase function, prepared to be evaluated and sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhaseFunction {
    first: Lobe,
    /// A second lobe and its share (Mie).
    second: Option<(Lobe, f64)>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Lobe {
    HenyeyGreenstein(f64),
    Draine(Draine),
    FournierForand(FournierForand),
}

impl PhaseFunction {
    /// Light goes everywhere alike.
    pub const ISOTROPIC: Self = Self { first: Lobe::HenyeyGreenstein(0.0), second: None };

    /// Prepares a node's phase function; parameters are limited as Cycles does. NaN makes its values NaN.
    pub fn new(phase: Phase) -> Self {
        let one = |first| Self { first, second: None };
        match phase {
            Phase::HenyeyGreenstein { anisotropy } => one(Lobe::HenyeyGreenstein(limited(anisotropy))),
            Phase::Rayleigh => one(Lobe::Draine(Draine { anisotropy: 0.0, alpha: 1.0 })),
            Phase::Draine { anisotropy, alpha } => one(Lobe::Draine(Draine::new(anisotropy, alpha))),
            Phase::FournierForand { ior, backscatter } => {
                one(Lobe::FournierForand(FournierForand::new(ior, backscatter)))
            }
            Phase::Mie { diameter } => {
                let [anisotropy, draine_anisotropy, alpha, share] = mie_parameters(diameter);
                Self {
                    first: Lobe::HenyeyGreenstein(limited(anisotropy)),
                    second: Some((Lobe::Draine(Draine::new(draine_anisotropy, alpha)), share)),
                }
            }
        }
    }

    /// Value in 1/sr for a cosine within [-1, 1]. It is also the density of [`Self::sample`] over solid angle.
    pub fn evaluate(&self, cosine: f64) -> f64 {
        match &self.second {
            None => self.first.evaluate(cosine),
            Some((second, share)) => (1.0 - share) * self.first.evaluate(cosine) + share * second.evaluate(cosine),
        }
    }

    /// The cosine that belongs to a number uniform in [0, 1).
    pub fn sample(&self, uniform: f64) -> f64 {
        match &self.second {
            None => self.first.sample(uniform),
            Some((second, share)) if uniform < *share => second.sample(uniform / share),
            Some((_, share)) => self.first.sample((uniform - share) / (1.0 - share)),
        }
    }

    /// Whether light goes everywhere alike.
    pub fn is_isotropic(&self) -> bool {
        self.second.is_none()
            && match self.first {
                Lobe::HenyeyGreenstein(anisotropy) => anisotropy.abs() < SMALLEST_ANISOTROPY,
                Lobe::Draine(Draine { anisotropy, alpha }) => anisotropy == 0.0 && alpha == 0.0,
                Lobe::FournierForand(_) => false,
            }
    }

    /// The g of Henyey-Greenstein, if that is what it is.
    pub fn henyey_greenstein(&self) -> Option<f64> {
        match (&self.first, &self.second) {
            (Lobe::HenyeyGreenstein(anisotropy), None) => Some(*anisotropy),
            _ => None,
        }
    }
}

fn limited(anisotropy: f64) -> f64 {
    anisotropy.clamp(-LARGEST_ANISOTROPY, LARGEST_ANISOTROPY)
}

impl Lobe {
    fn evaluate(&self, cosine: f64) -> f64 {
        match self {
            Self::HenyeyGreenstein(anisotropy) => henyey_greenstein(*anisotropy, cosine),
            Self::Draine(draine) => draine.evaluate(cosine),
            Self::FournierForand(forand) => forand.evaluate(cosine),
        }
    }

    fn sample(&self, uniform: f64) -> f64 {
        match self {
            Self::HenyeyGreenstein(anisotropy) => sample_henyey_greenstein(*anisotropy, uniform),
            Self::Draine(draine) => draine.sample(uniform),
            Self::FournierForand(forand) => forand.sample(uniform),
        }
    }
}

/// Henyey-Greenstein phase function in 1/sr for the cosine between the directions of travel before
/// and after; isotropic below |g| = 0.001, as in Cycles.
pub fn henyey_greenstein<T: Float>(anisotropy: T, cosine: T) -> T {
    if anisotropy.abs() < constant(SMALLEST_ANISOTROPY) {
        return constant(1.0 / SPHERE);
    }
    smooth_henyey_greenstein(anisotropy, cosine)
}

/// The same without the exception for small anisotropies.
fn smooth_henyey_greenstein<T: Float>(anisotropy: T, cosine: T) -> T {
    let cosine = if anisotropy < T::zero() { -cosine } else { cosine };
    // Rounding may make more than 1 of a cosine. NaN is not above 1 and stays to be seen.
    let lack = if cosine > T::one() { T::zero() } else { T::one() - cosine };
    henyey_greenstein_by_lack(anisotropy.abs(), lack)
}

/// Henyey-Greenstein for g in [0, 1) and what the cosine c lacks to 1. The base 1 + g^2 - 2 g c is a sum of parts that are not negative: it
/// neither cancels nor falls below (1 - g)^2, so that nothing is divided by 0.
pub fn henyey_greenstein_by_lack<T: Float>(g: T, lack: T) -> T {
    let least = T::one() - g;
    let base = least * least + constant::<T>(2.0) * g * lack;
    least * (T::one() + g) / (constant::<T>(SPHERE) * (base * base.sqrt()))
}

/// Draine's phase function in 1/sr (Draine 2003, equation 4): Henyey-Greenstein for alpha = 0, Cornette and Shanks' for alpha = 1.
pub fn draine<T: Float>(anisotropy: T, alpha: T, cosine: T) -> T {
    let (one, two, three) = (T::one(), constant::<T>(2.0), constant::<T>(3.0));
    let norm = one + alpha * (one + two * anisotropy * anisotropy) / three;
    smooth_henyey_greenstein(anisotropy, cosine) * (one + alpha * cosine * cosine) / norm
}

/// The cosine of [`henyey_greenstein`] for a number uniform in [0, 1).
pub fn sample_henyey_greenstein<T: Float>(anisotropy: T, uniform: T) -> T {
    let (one, two, half) = (T::one(), constant::<T>(2.0), constant::<T>(0.5));
    // For g < 0 the mirrored cosine of the other end of the distribution: no sum below is a difference then.
    let mirrored = anisotropy < T::zero();
    let g = anisotropy.abs();
    let uniform = if mirrored { one - uniform } else { uniform };
    let s = two * uniform - one;
    let cosine = if g < constant(SMALLEST_ANISOTROPY) {
        s
    } else if g < constant(SMALL_ANISOTROPY) {
        let below = one + g * s;
        (s + half * g * (s * s + constant(3.0)) + g * g * s + half * g * g * g * (s * s - one)) / (below * below)
    } else {
        let ratio = (one - g) * (one + g) / ((one - g) + two * g * uniform);
        (one + g * g - ratio * ratio) / (two * g)
    };
    let cosine = if mirrored { -cosine } else { cosine };
    // Written so that NaN stays.
    if cosine < -one {
        -one
    } else if cosine > one {
        one
    } else {
        cosine
    }
}

/// Unit vector at an angle of this cosine from the unit vector `direction`, turned around it by `turn` of a
/// full circle. Basis: Duff et al. 2017.
pub fn turned(direction: DVec3, cosine: f64, turn: f64) -> DVec3 {
    let sign = 1.0_f64.copysign(direction.z);
    let a = -1.0 / (sign + direction.z);
    let b = direction.x * direction.y * a;
    let first = DVec3::new(1.0 + sign * direction.x * direction.x * a, sign * b, -sign * direction.x);
    let second = DVec3::new(b, sign + direction.y * direction.y * a, -direction.y);
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    let (s, c) = (2.0 * PI * turn).sin_cos();
    (direction * cosine + (first * c + second * s) * sine).normalize()
}

/// The argument in [low, high] at which a non-decreasing function reaches `target`: Newton steps with the
/// derivative that `function` also gives, halving the bracket where they leave it.
fn inverted(target: f64, low: f64, high: f64, function: impl Fn(f64) -> (f64, f64)) -> f64 {
    let (mut low, mut high) = (low, high);
    let mut place = 0.5 * (low + high);
    for _ in 0..100 {
        let (value, slope) = function(place);
        if value < target {
            low = place;
        } else {
            high = place;
        }
        let step = place - (value - target) / slope;
        let next = if step > low && step < high { step } else { 0.5 * (low + high) };
        if (next - place).abs() <= 1e-15 * next.abs().max(f64::MIN_POSITIVE) || low >= high {
            return next;
        }
        place = next;
    }
    place
}

/// Draine's phase function: Henyey-Greenstein times (1 + alpha c^2), normalised.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Draine {
    anisotropy: f64,
    alpha: f64,
}

/// Below this anisotropy the closed form of the distribution function cancels; a series of Legendre
/// polynomials up to degree 5 replaces it, with a rest of 13 g^6 = 8e-10.
const DRAINE_SERIES: f64 = 0.02;

impl Draine {
    /// Below alpha = -1 the function would be negative somewhere: limited there.
    fn new(anisotropy: f64, alpha: f64) -> Self {
        if anisotropy.abs() < SMALLEST_ANISOTROPY && alpha > 0.999 {
            return Self { anisotropy: 0.0, alpha: 1.0 };
        }
        Self { anisotropy: limited(anisotropy), alpha: if alpha < -1.0 { -1.0 } else { alpha } }
    }

    fn norm(&self) -> f64 {
        1.0 + self.alpha * (1.0 + 2.0 * self.anisotropy * self.anisotropy) / 3.0
    }

    fn evaluate(&self, cosine: f64) -> f64 {
        draine(self.anisotropy, self.alpha, cosine)
    }

    /// Probability of a cosine below this one.
    fn distribution(&self, cosine: f64) -> f64 {
        let antiderivative =
            |c: f64| if self.anisotropy.abs() < DRAINE_SERIES { self.series(c) } else { self.closed(c) };
        2.0 * PI * (antiderivative(cosine) - antiderivative(-1.0)) / self.norm()
    }

    /// Antiderivative of HG (1 + alpha c^2), by the substitution u^2 = 1 + g^2 - 2 g c.
    fn closed(&self, c: f64) -> f64 {
        let (g, alpha) = (self.anisotropy, self.alpha);
        let sum = 1.0 + g * g;
        let u = (sum - 2.0 * g * c).sqrt();
        let square = alpha / (4.0 * g * g);
        (1.0 - g * g) / (SPHERE * g) * (1.0 / u + square * (sum * sum / u + 2.0 * sum * u - u * u * u / 3.0))
    }

    /// The same from HG = sum of (2 l + 1) g^l P_l(c) / 4 pi, l up to 5.
    fn series(&self, c: f64) -> f64 {
        // Legendre polynomials by powers of c.
        const LEGENDRE: [[f64; 6]; 6] = [
            [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            [-0.5, 0.0, 1.5, 0.0, 0.0, 0.0],
            [0.0, -1.5, 0.0, 2.5, 0.0, 0.0],
            [0.375, 0.0, -3.75, 0.0, 4.375, 0.0],
            [0.0, 1.875, 0.0, -8.75, 0.0, 7.875],
        ];
        let mut result = 0.0;
        for (degree, polynomial) in LEGENDRE.iter().enumerate() {
            let factor = (2 * degree + 1) as f64 * self.anisotropy.powi(degree as i32);
            for (power, coefficient) in polynomial.iter().enumerate() {
                let exponent = power as i32;
                let integral = c.powi(exponent + 1) / f64::from(exponent + 1)
                    + self.alpha * c.powi(exponent + 3) / f64::from(exponent + 3);
                result += factor * coefficient * integral;
            }
        }
        result / SPHERE
    }

    fn sample(&self, uniform: f64) -> f64 {
        inverted(uniform, -1.0, 1.0, |cosine| (self.distribution(cosine), 2.0 * PI * self.evaluate(cosine)))
    }
}

/// Fournier-Forand phase function in s = (1 - c) / 2, the square of the sine of half the angle.
#[derive(Debug, Clone, Copy, PartialEq)]
struct FournierForand {
    /// delta(1) = 4 / (3 (n - 1)^2).
    scale: f64,
    /// Exponent nu, from the backscattered share.
    exponent: f64,
}

/// Closest to straight on that Fournier-Forand is evaluated: it grows without bound towards s = 0. The share
/// of light within is below 1e-4 for the default parameters, and exact in sampling.
const SMALLEST_HALF_ANGLE: f64 = 1e-12;

impl FournierForand {
    /// The index is at least 1.001; of the backscattered share the magnitude counts, at most 0.499. At share 0
    /// all light would go straight on and Cycles evaluates to 0: 1e-6 is the least here.
    fn new(ior: f64, backscatter: f64) -> Self {
        let step = if ior < 1.001 { 0.001 } else { ior - 1.0 };
        let scale = 4.0 / (3.0 * step * step);
        let share = backscatter.abs().clamp(1e-6, 0.499);
        let middle = 0.5 * scale;
        // -ln(1 + 2 B (middle - 1)) / ln(middle), continued where middle is 1.
        let exponent = if (middle - 1.0).abs() < 1e-9 {
            -2.0 * share
        } else {
            -(2.0 * share * (middle - 1.0)).ln_1p() / middle.ln()
        };
        Self { scale, exponent }
    }

    /// (delta(1)^-nu - 1) / (delta(1) - 1), continued where delta(1) is 1.
    fn backward(&self) -> f64 {
        let difference = self.scale - 1.0;
        if difference.abs() < 1e-9 {
            return -self.exponent;
        }
        (-self.exponent * self.scale.ln()).exp_m1() / difference
    }

    fn evaluate(&self, cosine: f64) -> f64 {
        self.evaluate_at((0.5 * (1.0 - cosine)).max(SMALLEST_HALF_ANGLE))
    }

    fn evaluate_at(&self, s: f64) -> f64 {
        let (d, nu) = (self.scale * s, self.exponent);
        let e = d.powf(nu);
        let step = d - 1.0;
        let main = if step.abs() < 1e-4 {
            // Taylor series about D = 1 to first order: an error of 1e-8 where the closed form would cancel
            // to 1e-16 / step^2 = 1e-8.
            let even = nu * (nu - 1.0) / 2.0 * (1.0 + (nu - 2.0) / 3.0 * step);
            let odd = nu * (nu + 1.0) / 2.0 * (1.0 + (nu - 1.0) / 3.0 * step);
            (even - odd / s) / e
        } else {
            (nu * (1.0 - d) - (1.0 - e) + (d * (1.0 - e) - nu * (1.0 - d)) / s) / (step * step * e)
        };
        let cosine = 1.0 - 2.0 * s;
        (main + self.backward() * (3.0 * cosine * cosine - 1.0) / 4.0) / SPHERE
    }

    /// Probability of a smaller s, the integral of 4 pi p ds.
    fn distribution(&self, s: f64) -> f64 {
        let (d, nu) = (self.scale * s, self.exponent);
        let step = d - 1.0;
        let e = d.powf(nu);
        let main = if step.abs() < 1e-7 {
            // The limit at D = 1.
            (nu + 1.0) - nu * s
        } else {
            ((1.0 - e * d) - (1.0 - e) * s) / (-step * e)
        };
        let c = 1.0 - 2.0 * s;
        main + self.backward() * (c - c * c * c) / 8.0
    }

    fn sample(&self, uniform: f64) -> f64 {
        // Near straight on s spans many magnitudes: solved for its logarithm.
        let found = inverted(uniform, -80.0, 0.0, |logarithm| {
            let s = logarithm.exp();
            (self.distribution(s), s * SPHERE * self.evaluate_at(s))
        });
        1.0 - 2.0 * found.exp()
    }
}

/// Anisotropies of Henyey-Greenstein and Draine, alpha, and the share of Draine, for droplets of `diameter`
/// micrometres (at least 0): Jendersie and d'Eon 2023, equations 4 to 7 and the supplement for small droplets.
fn mie_parameters(diameter: f64) -> [f64; 4] {
    let d = if diameter < 0.0 { 0.0 } else { diameter };
    if d <= 0.1 {
        return [13.8 * d * d, 1.1456 * d * (9.29044 * d).sin(), 250.0, 0.252_977 - 312.983 * d.powf(4.3)];
    }
    let l = d.ln();
    if d < 1.5 {
        let inner = ((l - 0.238_604) * (l + 1.00667) / (0.507_522 - 0.15677 * l)).cos();
        return [
            0.862 - 0.143 * l * l,
            0.379_685 * (1.19692 * inner + 1.37932 * l + 0.062_583_5).cos() + 0.344_213,
            250.0,
            0.146_209 * (3.38707 * l + 2.11193).cos() + 0.316_072 + 0.077_891_7 * l,
        ];
    }
    if d < 5.0 {
        let ll = l.ln();
        return [
            0.060_493_1 * ll + 0.940_256,
            0.500_411 - 0.081_287 / (l.tan() - 2.0 * l + 1.27551),
            7.30354 * l + 6.31675,
            0.026_914 * (l - (5.68947 * (ll - 0.029_214_9)).cos()) + 0.3764,
        ];
    }
    [
        (-0.099_056_7 / (d - 1.67154)).exp(),
        (-2.20679 / (d + 3.91029) - 0.428_934).exp(),
        (3.62489 - 8.29288 / (d + 5.52825)).exp(),
        (-0.599_085 / (d - 0.641_583) - 0.665_888).exp(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_base_stays_positive_for_cosines_beyond_one() {
        for anisotropy in [0.999_f32, -0.999, 0.999_999, -0.999_999, 0.5] {
            // As rounding makes of two equal or opposite directions.
            for cosine in [1.0_f32, 1.000_000_1, 1.000_001, -1.0, -1.000_000_1, -1.000_001, 0.999_999_94] {
                let found = henyey_greenstein(anisotropy, cosine);
                assert!(found.is_finite() && found > 0.0, "{anisotropy} {cosine}: {found}");
            }
        }
        assert!(henyey_greenstein(0.5, f64::NAN).is_nan());
        // What a material asks for beyond the limit is the limit.
        let asked = PhaseFunction::new(Phase::HenyeyGreenstein { anisotropy: 1.0 - 1e-6 });
        assert_eq!(asked.henyey_greenstein(), Some(LARGEST_ANISOTROPY));
        assert!(asked.evaluate(1.0).is_finite());
    }

    #[test]
    fn sampled_cosines_stay_within_one_for_every_eccentricity() {
        for size in [0.0, 0.0009, 0.0011, 0.01, 0.249, 0.251, 0.9, 0.999, 0.999_999] {
            for anisotropy in [size, -size] {
                let mut last = -1.0_f64;
                for number in 0..=1000 {
                    let uniform = f64::from(number) / 1000.0;
                    let cosine = sample_henyey_greenstein(anisotropy, uniform);
                    assert!((-1.0..=1.0).contains(&cosine), "{anisotropy} {uniform}: {cosine}");
                    // The inverse of a distribution rises; a rounding may be lost.
                    assert!(cosine >= last - 1e-12, "{anisotropy} {uniform}: {cosine} after {last}");
                    last = cosine;
                    let single = sample_henyey_greenstein(anisotropy as f32, uniform as f32);
                    assert!((-1.0..=1.0).contains(&single), "{anisotropy} {uniform}: {single}");
                }
                assert!((sample_henyey_greenstein(anisotropy, 0.0) + 1.0).abs() < 1e-9, "{anisotropy}");
            }
        }
        // On both sides of where the text changes, the same numbers but for the change of g.
        for uniform in [0.0, 0.1, 0.5, 0.9, 0.999] {
            let [below, above] = [0.25 - 1e-9, 0.25 + 1e-9].map(|g| sample_henyey_greenstein(g, uniform));
            assert!((below - above).abs() < 1e-7, "{uniform}: {below} {above}");
        }
    }

    /// The functions of the tests, with Cycles' values at 10, 60, 90 and 150 degrees where they were measured.
    fn known() -> Vec<(Phase, [f64; 4])> {
        let henyey_greenstein = |anisotropy| Phase::HenyeyGreenstein { anisotropy };
        let draine = |anisotropy, alpha| Phase::Draine { anisotropy, alpha };
        let forand = |ior, backscatter| Phase::FournierForand { ior, backscatter };
        vec![
            (henyey_greenstein(1.5), [3.007_815e-2, 1.593_121e-4, 5.632_534e-5, 2.209_671e-5]),
            (henyey_greenstein(0.0009), [0.079_577_47; 4]),
            (draine(1.5, 0.5), [2.978_876e-2, 1.195_364e-4, 3.756_666e-5, 2.026_418e-5]),
            (draine(0.3, -0.5), [0.131_675_94, 0.112_331_92, 0.079_212_91, 0.027_588_78]),
            (draine(0.0009, 2.0), [0.117_566_54, 0.074_603_88, 0.059_683_11, 0.104_445_44]),
            (forand(1.33, 0.1), [1.119_544_8, 0.044_524_91, 0.019_773_87, 0.016_119_21]),
            (forand(1.33, -0.1), [1.119_544_8, 0.044_524_91, 0.019_773_87, 0.016_119_21]),
            (forand(1.33, 1e-3), [0.049_234_17, 0.000_667_81, 0.000_235_99, 0.000_141_86]),
            (forand(1.33, 0.6), [0.119_048_54, 0.074_643_86, 0.059_630_75, 0.104_191_12]),
            (forand(0.9, 0.1), [0.445_126_46, 0.022_607_76, 0.014_164_27, 0.019_471_3]),
            (forand(2.5, 0.1), [0.685_802_02, 0.036_238_02, 0.018_246_63, 0.016_888_03]),
            (Phase::Mie { diameter: -1.0 }, [0.089_187_84, 0.078_319_27, 0.074_544_66, 0.085_868_5]),
            (Phase::Mie { diameter: 50.0 }, [0.648_937_63, 0.016_680_15, 0.000_800_1, 0.007_930_71]),
            (Phase::Mie { diameter: 100.0 }, [0.664_872_45, 0.015_836_12, 0.000_686_39, 0.007_470_71]),
        ]
    }

    fn all() -> Vec<Phase> {
        let mut all: Vec<Phase> = known().into_iter().map(|(phase, _)| phase).collect();
        all.push(Phase::Rayleigh);
        for anisotropy in [0.8, -0.4, 0.019, 0.021, -0.005] {
            all.push(Phase::HenyeyGreenstein { anisotropy });
            all.push(Phase::Draine { anisotropy, alpha: 0.5 });
            all.push(Phase::Draine { anisotropy, alpha: 250.0 });
        }
        all.extend([0.05, 0.1, 1.0, 3.0, 10.0, 20.0].map(|diameter| Phase::Mie { diameter }));
        // delta(1/2) = 1 and delta(1) = 1: where the formulas have to be continued.
        for ior in [1.0 + (2.0_f64 / 3.0).sqrt(), 1.0 + (4.0_f64 / 3.0).sqrt(), 1.1] {
            all.push(Phase::FournierForand { ior, backscatter: 0.02 });
        }
        all
    }

    #[test]
    fn values_are_those_of_cycles() {
        for (phase, expected) in known() {
            let function = PhaseFunction::new(phase);
            for (degrees, expected) in [10.0_f64, 60.0, 90.0, 150.0].into_iter().zip(expected) {
                let found = function.evaluate(degrees.to_radians().cos());
                // Cycles' f32 angle of the light: 1e-7 of the sun's direction is amplified by the slope of
                // the narrowest lobe (g = 0.999: dp/p = 3 g sin / (1 + g^2 - 2 g c) = 17 per radian), and the
                // measured values have 5 to 7 digits.
                let error = (found - expected).abs();
                assert!(error < 2e-5 * expected + 6e-9, "{phase:?} at {degrees}: {found} is not {expected}");
            }
        }
    }

    /// Integral of `function(s) * 4 pi p` over s = (1 - c) / 2, in t = ln s and in plain s: Simpson's rule.
    fn mean(phase: &PhaseFunction, function: impl Fn(f64) -> f64) -> f64 {
        let simpson = |low: f64, high: f64, count: usize, integrand: &dyn Fn(f64) -> f64| {
            let step = (high - low) / count as f64;
            (0..=count)
                .map(|index| {
                    let weight = if index == 0 || index == count { 1.0 } else { [2.0, 4.0][index % 2] };
                    weight * integrand(low + step * index as f64)
                })
                .sum::<f64>()
                * step
                / 3.0
        };
        let value = |s: f64| SPHERE * phase.evaluate(1.0 - 2.0 * s) * function(1.0 - 2.0 * s);
        // Peaks stand at either end, over many magnitudes of the angle.
        simpson(-27.0, 0.5_f64.ln(), 6_000, &|t| t.exp() * value(t.exp()))
            + simpson(-27.0, 0.5_f64.ln(), 6_000, &|t| t.exp() * value(1.0 - t.exp()))
    }

    #[test]
    fn every_phase_function_integrates_to_one() {
        for phase in all() {
            let integral = mean(&PhaseFunction::new(phase), |_| 1.0);
            // Simpson's rule is far below; what lies below the angle of ln s = -27 (the forward peak of
            // Fournier-Forand) is known in closed form.
            let rest = match PhaseFunction::new(phase).first {
                Lobe::FournierForand(forand) => forand.distribution((-27.0_f64).exp()),
                _ => 0.0,
            };
            assert!((integral + rest - 1.0).abs() < 1e-5, "{phase:?}: {integral} + {rest}");
        }
    }

    #[test]
    fn samples_have_the_moments_of_the_function() {
        for phase in all() {
            let function = PhaseFunction::new(phase);
            let count = 10_000;
            let cosines: Vec<f64> =
                (0..count).map(|index| function.sample((f64::from(index) + 0.5) / f64::from(count))).collect();
            for power in 1..=4 {
                let found = cosines.iter().map(|cosine| cosine.powi(power)).sum::<f64>() / f64::from(count);
                let expected = mean(&function, |cosine| cosine.powi(power));
                // Evenly spaced numbers: the mean of a monotone function errs by half its range over the
                // count, 2 power / (2 count); two lobes double that. The rest is the quadrature's 1e-5.
                let tolerance = 2.0 * f64::from(power) / f64::from(count) + 2e-5;
                let forward = match function.first {
                    Lobe::FournierForand(forand) => forand.distribution((-27.0_f64).exp()),
                    _ => 0.0,
                };
                assert!(
                    (found - expected - forward).abs() < tolerance,
                    "{phase:?}, moment {power}: {found} is not {expected} + {forward}"
                );
            }
        }
    }

    #[test]
    fn samples_fill_every_bin_as_the_density_says() {
        for phase in all() {
            let function = PhaseFunction::new(phase);
            let (bins, count) = (20, 20_000);
            let mut filled = vec![0.0; bins];
            for index in 0..count {
                let cosine = function.sample((f64::from(index) + 0.5) / f64::from(count));
                let bin = ((0.5 * (1.0 - cosine)) * bins as f64) as usize;
                filled[bin.min(bins - 1)] += 1.0 / f64::from(count);
            }
            for (bin, filled) in filled.iter().enumerate().skip(1) {
                let width = 1.0 / bins as f64;
                let expected: f64 = (0..200)
                    .map(|part| {
                        let s = (bin as f64 + (f64::from(part) + 0.5) / 200.0) * width;
                        SPHERE * function.evaluate(1.0 - 2.0 * s) * width / 200.0
                    })
                    .sum();
                // Evenly spaced numbers miss a bin's share by at most one count per lobe and side.
                assert!((filled - expected).abs() < 4.0 / f64::from(count) + 1e-4 * expected, "{phase:?}, bin {bin}");
            }
        }
    }

    #[test]
    fn a_turned_direction_has_the_angle() {
        for direction in [DVec3::X, -DVec3::Z, DVec3::Z, DVec3::new(0.6, -0.48, -0.64)] {
            let mut sum = DVec3::ZERO;
            for turn in [0.0, 0.25, 0.5, 0.75] {
                let found = turned(direction, 0.3, turn);
                assert!((found.length() - 1.0).abs() < 1e-15 && (found.dot(direction) - 0.3).abs() < 1e-15);
                sum += found;
            }
            // The turns balance.
            assert!((sum / 4.0 - direction * 0.3).length() < 1e-15);
        }
    }
}
