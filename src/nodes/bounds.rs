//! Intervals: what a node's output can be over a box of inputs.
//!
//! An enclosure holds for every evaluator: f32 in Cycles' order, f64, and WGSL with its liberties.
//! It rests on induction: if all operands lie in their intervals, the result of one operation lies
//! in the interval computed here. Ends are computed in f64 and widened by `PAD`:
//!
//! * f32 rounds to nearest: relative error 2^-24 per operation;
//! * WGSL: division 2.5 ulp, square root through `inverseSqrt` and a division 4.5 ulp (an ulp is at
//!   most 2^-23 of the value); fusing a product with a sum only removes a rounding;
//! * storing an end as f32: 2^-24.
//!
//! The sum of these is below 6.5 ulp; 2^-20 is 8 ulp. Results that an implementation may flush to
//! zero (below the smallest normal number) are widened to contain zero. An exact zero stays: every
//! rounding is monotone and keeps 0. Comparisons and selections are exact and take no pad.

use crate::base::arrays::Mapped;
use crate::scene::Release;
use std::ops::{Add, Mul, Neg, Sub};

/// Relative widening after an operation; see the module's text.
const PAD: f64 = 1.0 / 1_048_576.0;

/// Widening of C library functions, relative and absolute. The f32 library is within 1 ulp; the
/// shaders' own versions claim 1e-6 of the larger of 1 and the value.
const LIBRARY_PAD: f64 = 4e-6;

/// Smallest normal f32.
const SMALLEST_NORMAL: f64 = f32::MIN_POSITIVE as f64;

/// A closed interval of f32 values; every evaluator's value lies within it. NaN is possible only
/// where `may_be_nan` is set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f32,
    /// Upper end.
    pub high: f32,
    /// The value may also be NaN.
    pub may_be_nan: bool,
}

impl Interval {
    /// No statement at all.
    pub const EVERYTHING: Self = Self { low: f32::NEG_INFINITY, high: f32::INFINITY, may_be_nan: true };
    /// The number 0.
    pub const ZERO: Self = Self { low: 0.0, high: 0.0, may_be_nan: false };
    /// The number 1.
    pub const ONE: Self = Self { low: 1.0, high: 1.0, may_be_nan: false };
    /// From 0 to 1.
    pub const UNIT: Self = Self { low: 0.0, high: 1.0, may_be_nan: false };

    /// One value. NaN gives [`Self::EVERYTHING`].
    pub fn point(value: f32) -> Self {
        if value.is_nan() { Self::EVERYTHING } else { Self { low: value, high: value, may_be_nan: false } }
    }

    /// From `low` to `high`.
    pub fn new(low: f32, high: f32) -> Self {
        Self { low, high, may_be_nan: false }
    }

    /// From `low` to `high` after an operation: widened by `PAD`.
    #[inline]
    pub fn outward(low: f64, high: f64, may_be_nan: bool) -> Self {
        Self::stored(low - PAD * low.abs(), high + PAD * high.abs(), may_be_nan)
    }

    /// [`Self::outward`] with a further absolute error.
    pub fn with_error(low: f64, high: f64, error: f64, may_be_nan: bool) -> Self {
        Self::outward(low - error, high + error, may_be_nan)
    }

    /// Stores ends that are already widened, rounding by at most the widening that [`PAD`] has left.
    #[inline]
    fn stored(low: f64, high: f64, may_be_nan: bool) -> Self {
        // A result within the subnormal range may be flushed to zero.
        let low = if low > 0.0 && low < SMALLEST_NORMAL {
            0.0
        } else if low < 0.0 && low > -SMALLEST_NORMAL {
            -SMALLEST_NORMAL
        } else {
            low
        };
        let high = if high < 0.0 && high > -SMALLEST_NORMAL {
            0.0
        } else if high > 0.0 && high < SMALLEST_NORMAL {
            SMALLEST_NORMAL
        } else {
            high
        };
        Self {
            // An end beyond f32 is infinite in f32 and finite in f64: the interval has to hold both.
            low: if low.is_nan() { f32::NEG_INFINITY } else { (low as f32).min(f32::MAX) },
            high: if high.is_nan() { f32::INFINITY } else { (high as f32).max(f32::MIN) },
            may_be_nan,
        }
    }

    /// The same interval, with 0 added where an implementation may flush a subnormal input.
    pub fn flushed(self) -> Self {
        Self::stored(f64::from(self.low), f64::from(self.high), self.may_be_nan)
    }

    /// The single value, if it is one.
    pub fn as_point(self) -> Option<f32> {
        (self.low == self.high && !self.may_be_nan).then_some(self.low)
    }

    /// Whether an evaluator's value is inside.
    pub fn contains(self, value: f64) -> bool {
        if value.is_nan() {
            return self.may_be_nan;
        }
        f64::from(self.low) <= value && value <= f64::from(self.high)
    }

    /// Whether 0 is inside.
    pub fn has_zero(self) -> bool {
        self.low <= 0.0 && self.high >= 0.0
    }

    /// Whether both ends are finite and NaN is impossible.
    pub fn is_finite(self) -> bool {
        self.low.is_finite() && self.high.is_finite() && !self.may_be_nan
    }

    fn has_infinity(self) -> bool {
        self.low == f32::NEG_INFINITY || self.high == f32::INFINITY
    }

    /// Ends in f64.
    pub fn ends(self) -> [f64; 2] {
        [f64::from(self.low), f64::from(self.high)]
    }

    /// Largest magnitude.
    pub fn magnitude(self) -> f64 {
        f64::from(self.low.abs().max(self.high.abs()))
    }

    /// Smallest interval that holds both.
    #[must_use]
    pub fn hull(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
            may_be_nan: self.may_be_nan || other.may_be_nan,
        }
    }

    /// What two enclosures of the same value leave.
    #[must_use]
    pub fn meet(self, other: Self) -> Self {
        let met = Self {
            low: self.low.max(other.low),
            high: self.high.min(other.high),
            may_be_nan: self.may_be_nan && other.may_be_nan,
        };
        // Only NaN is left, or nothing can be evaluated: either enclosure is right then.
        if met.low <= met.high { met } else { self }
    }

    /// The same interval where NaN is possible if `flag` says so.
    #[must_use]
    pub fn or_nan(self, flag: bool) -> Self {
        Self { may_be_nan: self.may_be_nan || flag, ..self }
    }

    /// Image under a non-decreasing function, computed in f64 and widened by `error` beside `PAD`.
    pub fn increasing(self, function: impl Fn(f64) -> f64, error: f64) -> Self {
        let [low, high] = self.ends();
        Self::with_error(function(low), function(high), error, self.may_be_nan)
    }

    /// Image under a non-decreasing function that every evaluator computes exactly.
    fn exactly(self, function: impl Fn(f32) -> f32) -> Self {
        Self { low: function(self.low), high: function(self.high), may_be_nan: self.may_be_nan }
    }

    /// Largest integer not above; NaN for NaN.
    #[must_use]
    pub fn floor(self) -> Self {
        self.exactly(f32::floor)
    }

    /// Smallest integer not below.
    #[must_use]
    pub fn ceil(self) -> Self {
        self.exactly(f32::ceil)
    }

    /// Towards zero.
    #[must_use]
    pub fn trunc(self) -> Self {
        self.exactly(f32::trunc)
    }

    /// Magnitude.
    #[must_use]
    pub fn abs(self) -> Self {
        if self.low >= 0.0 {
            self
        } else if self.high <= 0.0 {
            -self
        } else {
            Self { low: 0.0, high: self.high.max(-self.low), may_be_nan: self.may_be_nan }
        }
    }

    /// The product with itself.
    #[must_use]
    pub fn square(self) -> Self {
        let [low, high] = self.abs().ends();
        Self::outward(low * low, high * high, self.may_be_nan)
    }

    /// Square root; NaN below 0.
    #[must_use]
    pub fn sqrt(self) -> Self {
        let [low, high] = self.ends();
        let nan = self.may_be_nan || low < 0.0;
        Self::outward(low.max(0.0).sqrt(), high.max(0.0).sqrt(), nan)
    }

    /// `x - floor(x)`. Rounding makes it 1 just below an integer.
    #[must_use]
    pub fn fraction(self) -> Self {
        // Infinity minus infinity.
        let nan = self.may_be_nan || self.has_infinity();
        let floor = self.floor();
        if floor.low == floor.high && !self.has_infinity() {
            return (self - floor).meet(Self::UNIT).or_nan(nan);
        }
        Self::UNIT.or_nan(nan)
    }

    /// `a if a > b else b`: NaN in the first place gives b, in the second place NaN.
    #[must_use]
    pub fn greater(self, other: Self) -> Self {
        Self {
            low: if self.may_be_nan { other.low } else { self.low.max(other.low) },
            high: self.high.max(other.high),
            may_be_nan: other.may_be_nan,
        }
    }

    /// `a if a < b else b`, with NaN as in [`Self::greater`].
    #[must_use]
    pub fn lesser(self, other: Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: if self.may_be_nan { other.high } else { self.high.min(other.high) },
            may_be_nan: other.may_be_nan,
        }
    }

    /// `lesser(greater(self, low), high)`: NaN becomes `low`.
    #[must_use]
    pub fn clamped(self, low: Self, high: Self) -> Self {
        self.greater(low).lesser(high)
    }

    /// Clamped to [0, 1].
    #[must_use]
    pub fn saturate(self) -> Self {
        self.clamped(Self::ZERO, Self::ONE)
    }

    /// C `fmin`: the operand that is not NaN.
    #[must_use]
    pub fn fmin(self, other: Self) -> Self {
        let mut high = self.high.min(other.high);
        if self.may_be_nan {
            high = high.max(other.high);
        }
        if other.may_be_nan {
            high = high.max(self.high);
        }
        Self { low: self.low.min(other.low), high, may_be_nan: self.may_be_nan && other.may_be_nan }
    }

    /// C `fmax`: the operand that is not NaN.
    #[must_use]
    pub fn fmax(self, other: Self) -> Self {
        -(-self).fmin(-other)
    }

    /// Quotient. Where the divisor may be 0 nothing is known.
    #[must_use]
    pub fn divide(self, divisor: Self) -> Self {
        if divisor.has_zero() {
            return Self::EVERYTHING;
        }
        let nan = self.may_be_nan || divisor.may_be_nan || (self.has_infinity() && divisor.has_infinity());
        let ([a, b], [c, d]) = (self.ends(), divisor.ends());
        let (low, high) = extremes([a / c, a / d, b / c, b / d]);
        Self::outward(low, high, nan)
    }

    /// Quotient that is 0 for a zero divisor.
    #[must_use]
    pub fn safe_divide(self, divisor: Self) -> Self {
        if !divisor.has_zero() {
            return self.divide(divisor);
        }
        let nan = self.may_be_nan || divisor.may_be_nan || (self.has_infinity() && divisor.has_infinity());
        let ([a, b], [c, d]) = (self.ends(), divisor.ends());
        let mut low = 0.0_f64;
        let mut high = 0.0_f64;
        // A dividend of 0 gives 0; others grow without bound as the divisor nears 0.
        if (b > 0.0 && d > 0.0) || (a < 0.0 && c < 0.0) {
            high = f64::INFINITY;
        }
        if (b > 0.0 && c < 0.0) || (a < 0.0 && d > 0.0) {
            low = f64::NEG_INFINITY;
        }
        Self::outward(low, high, nan)
    }

    /// `self + t (other - self)` for t within [0, 1] up to rounding.
    #[must_use]
    pub fn lerp(self, other: Self, t: Self) -> Self {
        let plain = self + t * (other - self);
        if t.low < 0.0 || t.high > 1.0 || !self.is_finite() || !other.is_finite() || t.may_be_nan {
            return plain;
        }
        let ([a, b], [c, d], [t0, t1]) = (self.ends(), other.ends(), t.ends());
        let at = |x: f64, y: f64, t: f64| x + t * (y - x);
        let (low, high) = (at(a, c, t0).min(at(a, c, t1)), at(b, d, t0).max(at(b, d, t1)));
        // The difference and the product round relative to their own magnitudes.
        let error = PAD * (self.magnitude() + other.magnitude());
        Self::with_error(low, high, error, false).meet(plain)
    }

    /// Sine.
    #[must_use]
    pub fn sin(self) -> Self {
        self.wave(0.25)
    }

    /// Cosine.
    #[must_use]
    pub fn cos(self) -> Self {
        self.wave(0.0)
    }

    /// The cosine shifted right by `crest` periods.
    fn wave(self, crest: f64) -> Self {
        use std::f64::consts::TAU;
        let nan = self.may_be_nan || self.has_infinity();
        let [low, high] = self.ends();
        let whole = Self::with_error(-1.0, 1.0, LIBRARY_PAD, nan);
        // Beyond this, counting periods in f64 is no longer safe to 1e-6.
        if high - low >= TAU || low.abs().max(high.abs()) > 1e6 || nan {
            return whole;
        }
        let (first, last) = (low / TAU - crest, high / TAU - crest);
        let value = |turns: f64| (TAU * turns).cos();
        let (mut least, mut greatest) = (value(first).min(value(last)), value(first).max(value(last)));
        // Crests at whole periods, troughs at half ones; met within 1e-9 counts as met.
        let meets = |phase: f64| (last - phase + 1e-9).floor() > (first - phase - 1e-9).floor();
        if meets(0.0) {
            greatest = 1.0;
        }
        if meets(0.5) {
            least = -1.0;
        }
        Self::with_error(least, greatest, LIBRARY_PAD, false)
    }

    /// Tangent.
    #[must_use]
    pub fn tan(self) -> Self {
        use std::f64::consts::{FRAC_PI_2, PI};
        let nan = self.may_be_nan || self.has_infinity();
        let unbounded = Self::new(f32::NEG_INFINITY, f32::INFINITY).or_nan(nan);
        let [low, high] = self.ends();
        // As a quotient of sine and cosine the error grows without bound near a pole.
        let branch = |x: f64| ((x + FRAC_PI_2) / PI).floor();
        let margin = 1e-3;
        if nan || low.abs().max(high.abs()) > 1e6 || branch(low - margin) != branch(high + margin) {
            return unbounded;
        }
        let (least, greatest) = (low.tan(), high.tan());
        let error = |tangent: f64| LIBRARY_PAD * (1.0 + tangent * tangent);
        Self::outward(least - error(least), greatest + error(greatest), false)
    }

    /// Inverse sine of a value within [-1, 1].
    #[must_use]
    pub fn asin(self) -> Self {
        self.increasing(|x| x.clamp(-1.0, 1.0).asin(), LIBRARY_PAD)
    }

    /// Inverse cosine of a value within [-1, 1].
    #[must_use]
    pub fn acos(self) -> Self {
        (-self).increasing(|x| (-x).clamp(-1.0, 1.0).acos(), LIBRARY_PAD)
    }

    /// Inverse tangent.
    #[must_use]
    pub fn atan(self) -> Self {
        self.increasing(f64::atan, LIBRARY_PAD)
    }

    /// Angle of the point (x, `self`); 0 at the origin.
    #[must_use]
    pub fn atan2(self, x: Self) -> Self {
        use std::f64::consts::PI;
        let nan = self.may_be_nan || x.may_be_nan;
        let ([a, b], [c, d]) = (self.ends(), x.ends());
        // Away from the cut along negative x the angle is extreme at corners.
        if c > 0.0 || a > 0.0 || b < 0.0 {
            let (low, high) = extremes([a.atan2(c), a.atan2(d), b.atan2(c), b.atan2(d)]);
            return Self::with_error(low, high, LIBRARY_PAD, nan);
        }
        Self::with_error(-PI, PI, LIBRARY_PAD, nan)
    }

    /// Exponential. An error of the argument's product in base 2 grows with the argument.
    #[must_use]
    pub fn exp(self) -> Self {
        let [low, high] = self.ends();
        let error = |x: f64| LIBRARY_PAD * (1.0 + x.abs().min(200.0));
        Self::outward(low.exp() * (1.0 - error(low)), high.exp() * (1.0 + error(high)), self.may_be_nan)
    }

    /// Natural logarithm of the positive part; the interval has to reach above 0.
    #[must_use]
    pub fn ln(self) -> Self {
        let [low, high] = self.ends();
        // The smallest positive f64 is above e^-745.2.
        let low = if low > 0.0 { low.ln() } else { -746.0 };
        Self::with_error(low, high.max(f64::MIN_POSITIVE).ln(), LIBRARY_PAD, self.may_be_nan)
    }

    /// Hyperbolic sine.
    #[must_use]
    pub fn sinh(self) -> Self {
        let [low, high] = self.ends();
        let error = |x: f64| LIBRARY_PAD * ((1.0 + x.abs().min(200.0)) * x.sinh().abs() + 1.0);
        Self::outward(low.sinh() - error(low), high.sinh() + error(high), self.may_be_nan)
    }

    /// Hyperbolic cosine.
    #[must_use]
    pub fn cosh(self) -> Self {
        let [low, high] = self.abs().ends();
        let error = |x: f64| LIBRARY_PAD * (1.0 + x.min(200.0)) * x.cosh();
        Self::outward(low.cosh() - error(low), high.cosh() + error(high), self.may_be_nan)
    }

    /// Hyperbolic tangent.
    #[must_use]
    pub fn tanh(self) -> Self {
        self.increasing(f64::tanh, LIBRARY_PAD)
    }

    /// Power of a non-negative base, by the C library's rules; extreme at corners because
    /// `exponent * ln(base)` is bilinear.
    #[must_use]
    pub fn power(self, exponent: Self) -> Self {
        let nan = self.may_be_nan || exponent.may_be_nan;
        let ([a, b], [c, d]) = (self.ends(), exponent.ends());
        let (a, b) = (a.max(0.0), b.max(0.0));
        let corner = |base: f64, exponent: f64| {
            let value = base.powf(exponent);
            // Exponent and logarithm are multiplied: their error is relative to the product.
            let error = LIBRARY_PAD * (2.0 + (exponent * base.ln()).abs().min(800.0));
            [value * (1.0 - error).max(0.0), value * (1.0 + error)]
        };
        let corners = [corner(a, c), corner(a, d), corner(b, c), corner(b, d)];
        let (low, _) = extremes(corners.mapped(|ends| ends[0]));
        let (_, high) = extremes(corners.mapped(|ends| ends[1]));
        let result = Self::outward(low.max(0.0), high, nan);
        // x^0 and 1^y are 1 whatever the other operand is, infinities included.
        let one = exponent.has_zero() || (a <= 1.0 && b >= 1.0);
        if one { result.hull(Self::ONE) } else { result }
    }

    /// The Math node's power: 0 for a negative base with a fractional exponent, 1 for exponent 0,
    /// 0 for base 0.
    #[must_use]
    pub fn safe_power(self, exponent: Self) -> Self {
        self.power_with(exponent, 2_147_483_648.0)
    }

    /// [`Self::safe_power`] where exponents from `largest_whole` on count as fractional.
    fn power_with(self, exponent: Self, largest_whole: f32) -> Self {
        let nan = self.may_be_nan || exponent.may_be_nan;
        let mut result: Option<Self> = None;
        let mut add = |part: Self| result = Some(result.map_or(part, |known| known.hull(part)));
        if self.high > 0.0 {
            add(Self { low: self.low.max(0.0), ..self }.power(exponent));
        }
        if self.has_zero() {
            add(Self::ZERO);
        }
        if exponent.has_zero() {
            add(Self::ONE);
        }
        if self.low < 0.0 {
            let magnitude = Self { low: (-self.high).max(0.0), high: -self.low, may_be_nan: nan };
            match exponent.as_point() {
                Some(y) if y != y.trunc() || y.abs() >= largest_whole => add(Self::ZERO),
                Some(y) if y % 2.0 == 0.0 || y.is_infinite() => add(magnitude.power(exponent)),
                Some(_) => add(-magnitude.power(exponent)),
                None => {
                    add(Self::ZERO);
                    if exponent.low.ceil() <= exponent.high.floor() {
                        let power = magnitude.power(exponent);
                        add(power);
                        add(-power);
                    }
                }
            }
        }
        result.unwrap_or(Self::EVERYTHING).or_nan(nan)
    }

    /// [`Self::safe_power`] up to Blender 4.5, where negative powers of 0 are infinite.
    #[must_use]
    pub fn safe_power_before_5(self, exponent: Self) -> Self {
        let has_pole = self.has_zero() && exponent.low < 0.0;
        if has_pole { Self::EVERYTHING } else { self.safe_power(exponent) }
    }

    /// The power of Math and Vector Math with the values of a release of Blender.
    #[must_use]
    pub fn power_of(self, release: Release, exponent: Self) -> Self {
        match release {
            Release::V4_5 => self.safe_power_before_5(exponent),
            Release::V5_0 => self.safe_power(exponent),
            // Every number of that size is an even one, infinities as well: none is at or beyond this limit.
            _ => self.power_with(exponent, f32::NAN),
        }
    }
}

/// Smallest and largest; NaN entries (0 times infinity and the like) say nothing.
fn extremes(values: [f64; 4]) -> (f64, f64) {
    values.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)))
}

impl Add for Interval {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        let opposite = (self.high == f32::INFINITY && other.low == f32::NEG_INFINITY)
            || (self.low == f32::NEG_INFINITY && other.high == f32::INFINITY);
        let nan = self.may_be_nan || other.may_be_nan || opposite;
        let ([a, b], [c, d]) = (self.ends(), other.ends());
        Self::outward(a + c, b + d, nan)
    }
}

impl Sub for Interval {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Neg for Interval {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self { low: -self.high, high: -self.low, may_be_nan: self.may_be_nan }
    }
}

impl Mul for Interval {
    type Output = Self;
    #[inline]
    fn mul(self, other: Self) -> Self {
        let zero_times_infinity =
            (self.has_zero() && other.has_infinity()) || (self.has_infinity() && other.has_zero());
        let nan = self.may_be_nan || other.may_be_nan || zero_times_infinity;
        let ([a, b], [c, d]) = (self.ends(), other.ends());
        let (mut low, mut high) = extremes([a * c, a * d, b * c, b * d]);
        if zero_times_infinity {
            (low, high) = (low.min(0.0), high.max(0.0));
        }
        Self::outward(low, high, nan)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn zero_stays_exact_and_the_rest_widens() {
        let x = Interval::new(0.0, 1.0);
        assert_eq!((x * Interval::ZERO).as_point(), Some(0.0));
        assert_eq!((x + x).low, 0.0);
        assert!((x + x).high > 2.0 && (x + x).high < 2.000_01);
        assert_eq!(Interval::EVERYTHING.saturate(), Interval::UNIT);
    }

    #[test]
    fn a_nan_follows_the_kernels_rules() {
        let nan = Interval::EVERYTHING;
        assert_eq!(nan.clamped(Interval::point(2.0), Interval::point(3.0)), Interval::new(2.0, 3.0));
        assert!(Interval::ONE.greater(nan).may_be_nan);
        assert!(!Interval::ONE.fmin(nan).may_be_nan);
    }

    #[test]
    fn waves_know_their_crests() {
        let wave = Interval::new(1.0, 2.0).sin();
        assert!(wave.high >= 1.0 && (f64::from(wave.low) - 1_f64.sin()).abs() < 1e-5);
        let wave = Interval::new(2.0, 4.0).cos();
        assert!(wave.low <= -1.0 && (f64::from(wave.high) - 2_f64.cos()).abs() < 1e-5);
    }
}
