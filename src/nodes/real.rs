//! The number types that nodes are evaluated with, and the primitive functions of Cycles' kernels.
//!
//! * [`f32`]: every intermediate rounded, no fused operations, written order. Equal bit for bit to
//!   Cycles' SSE4.2 kernel, except for the C library's functions, which are within 1 ulp.
//! * [`Oracle`]: f64 arithmetic that rounds to f32 where a texture is a function of the *rounded*
//!   coordinate (scaled coordinates, hash values). The oracle for conditioning.
//! * [`f64`]: no rounding anywhere; a different function near fine octaves, for study only.
//!
//! `lesser`, `greater` and `clamped` keep the operand order of the kernels, so that a NaN behaves as there.

use crate::base::arrays::Mapped;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number type for evaluation.
pub trait Real:
    Copy
    + Send
    + Sync
    + PartialOrd
    + Default
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + 'static
{
    /// Whether a number is its value and nothing else, such as a bound of its error.
    const IS_PLAIN: bool = false;

    /// Exact conversion.
    fn of(value: f32) -> Self;
    /// The nearest number: what a parameter of a node is in this type.
    #[inline(always)]
    fn of_f64(value: f64) -> Self {
        Self::of(value as f32)
    }
    /// Rounds to f32.
    fn to_f32(self) -> f32;
    /// Widens to f64.
    fn to_f64(self) -> f64;
    /// Rounds a texture coordinate to f32 where this type's semantics ask for it.
    fn round_coordinate(self) -> Self;
    /// `bits / 2^32`, the integer rounded to f32 first where this type's semantics ask for it.
    fn from_hash_32(bits: u32) -> Self;
    /// `bits / 2^31` for a non-negative 31-bit integer, rounded likewise.
    fn from_hash_31(bits: i32) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Largest integer not above.
    fn floor(self) -> Self;
    /// [`Self::floor`] that takes a lattice coordinate apart, in a field that does not jump at the
    /// faces of its cells.
    #[inline(always)]
    fn lattice_floor(self) -> Self {
        self.floor()
    }
    /// Smallest integer not below.
    fn ceil(self) -> Self;
    /// Towards zero.
    fn trunc(self) -> Self;
    /// Magnitude.
    fn abs(self) -> Self;
    /// Exact remainder with the sign of `self` (C `fmod`).
    fn fmod(self, divisor: Self) -> Self;
    /// Power of the C library.
    fn powf(self, exponent: Self) -> Self;
    /// A function of one argument of the C library.
    fn library(self, function: Library) -> Self;
    /// Sine and cosine of the C library.
    #[inline(always)]
    fn sine_and_cosine(self) -> [Self; 2] {
        [self.library(Library::Sin), self.library(Library::Cos)]
    }
    /// Two-argument arctangent, `self` is y.
    fn atan2(self, x: Self) -> Self;
    /// C `fmin`: the operand that is not NaN.
    fn fmin(self, other: Self) -> Self;
    /// C `fmax`: the operand that is not NaN.
    fn fmax(self, other: Self) -> Self;
    /// Whether it is not a number.
    #[inline(always)]
    fn is_nan(self) -> bool {
        self.to_f64().is_nan()
    }
    /// Truncation to i32; -2^31 for NaN and for magnitudes from 2^31 on, as on x86.
    fn to_int(self) -> i32;

    /// `a if a > b else b`.
    #[inline(always)]
    fn greater(self, other: Self) -> Self {
        if self > other { self } else { other }
    }
    /// `a if a < b else b`.
    #[inline(always)]
    fn lesser(self, other: Self) -> Self {
        if self < other { self } else { other }
    }
    /// `lesser(greater(self, low), high)`.
    #[inline(always)]
    fn clamped(self, low: Self, high: Self) -> Self {
        self.greater(low).lesser(high)
    }
    /// `clamped(self, 0, 1)`; NaN becomes 0.
    #[inline(always)]
    fn saturate(self) -> Self {
        self.clamped(Self::of(0.0), Self::of(1.0))
    }
    /// `self - floor(self)`.
    #[inline(always)]
    fn fraction(self) -> Self {
        self - self.floor()
    }
    /// `self + t*(other - self)`.
    #[inline(always)]
    fn lerp(self, other: Self, t: Self) -> Self {
        self + t * (other - self)
    }
    /// Division that gives 0 for a zero divisor.
    #[inline(always)]
    fn safe_divide(self, divisor: Self) -> Self {
        if divisor != Self::of(0.0) { self / divisor } else { Self::of(0.0) }
    }
    /// Power as the Math node means it: 0 for a negative base with a fractional exponent, 1 for
    /// exponent 0, 0 for base 0, tested in this order.
    #[inline]
    fn safe_power(self, exponent: Self) -> Self {
        let zero = Self::of(0.0);
        if self < zero && exponent != Self::of(exponent.to_int() as f32) {
            zero
        } else if exponent == zero {
            Self::of(1.0)
        } else if self == zero {
            zero
        } else {
            self.powf(exponent)
        }
    }
    /// [`Self::safe_power`] up to Blender 4.5: without a rule of its own for base 0, whose negative powers are infinite.
    #[inline]
    fn safe_power_before_5(self, exponent: Self) -> Self {
        let is_fractional = exponent != Self::of(exponent.to_int() as f32);
        if self < Self::of(0.0) && is_fractional { Self::of(0.0) } else { self.powf(exponent) }
    }
    /// [`Self::safe_power`] since Blender 5.1: exponents beyond 2^31 and infinite ones are whole numbers, too, even ones.
    #[inline]
    fn safe_power_since_5_1(self, exponent: Self) -> Self {
        let (zero, is_whole) = (Self::of(0.0), exponent == exponent.trunc());
        if is_whole && exponent != zero && self < zero { self.powf(exponent) } else { self.safe_power(exponent) }
    }
    /// 1 where `condition` holds, which compares this number with `other`, and 0 elsewhere.
    #[inline(always)]
    fn decided(self, _other: Self, condition: bool) -> Self {
        if condition { Self::of(1.0) } else { Self::of(0.0) }
    }
    /// The kernel's cubic step between two edges.
    #[inline(always)]
    fn smooth_step(self, edge0: Self, edge1: Self) -> Self {
        // Selections, so that loops over points hold no branch.
        let t = (self - edge0) / (edge1 - edge0);
        let step = (Self::of(3.0) - Self::of(2.0) * t) * (t * t);
        let at_most_one = if self >= edge1 { Self::of(1.0) } else { step };
        if self < edge0 { Self::of(0.0) } else { at_most_one }
    }
    /// `t^3 (t (6 t - 15) + 10)` in the kernel's order.
    #[inline(always)]
    fn quintic(self) -> Self {
        ((self * self) * self) * (self * (self * Self::of(6.0) - Self::of(15.0)) + Self::of(10.0))
    }
}

/// Functions of one argument that come from the C library.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "each is the function of its name")]
pub enum Library {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
}

/// f64 that rounds coordinates and hash values to f32; see the module's head.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Oracle(pub f64);

macro_rules! library {
    ($value:expr, $function:expr) => {
        match $function {
            Library::Sin => $value.sin(),
            Library::Cos => $value.cos(),
            Library::Tan => $value.tan(),
            Library::Asin => $value.asin(),
            Library::Acos => $value.acos(),
            Library::Atan => $value.atan(),
            Library::Sinh => $value.sinh(),
            Library::Cosh => $value.cosh(),
            Library::Tanh => $value.tanh(),
            Library::Exp => $value.exp(),
            Library::Ln => $value.ln(),
        }
    };
}

/// x86's conversion: out of range and NaN give the smallest integer.
#[inline(always)]
fn int_of(value: f64) -> i32 {
    if value > -2147483649.0 && value < 2147483648.0 { value as i32 } else { i32::MIN }
}

/// C `fmod`, which is exact, without the C library's loop over the quotient's bits.
///
/// The quotient of two f32 of magnitude 1 and more is a whole number or at least 2^-24 away from one. Below 2^28 an f64 is half
/// a unit in its last place, 2^-26, from what it stands for at most, so that it has the right whole part; and products of a whole
/// number below 2^28 with an f32 are exact, and so is the difference.
#[inline(always)]
fn remainder(a: f32, b: f32) -> f32 {
    let (x, y) = (f64::from(a), f64::from(b));
    let quotient = (x / y).trunc();
    if quotient.abs() < 268_435_456.0 && b.is_finite() { ((x - quotient * y) as f32).copysign(a) } else { a % b }
}

/// Sine and cosine of the C library, which computes both for hardly more than one: for each of the 2^32 arguments glibc 2.36's
/// function gives the bits of `sinf` and `cosf`.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
#[inline(always)]
fn sine_and_cosine(angle: f32) -> [f32; 2] {
    #[allow(unsafe_code, reason = "the C library's function is declared here: it is GNU's, and Rust has none for it")]
    unsafe extern "C" {
        fn sincosf(angle: f32, sine: *mut f32, cosine: *mut f32);
    }
    let [mut sine, mut cosine] = [0.0; 2];
    #[allow(unsafe_code, reason = "it writes two numbers through pointers to them")]
    unsafe {
        sincosf(angle, &raw mut sine, &raw mut cosine);
    }
    [sine, cosine]
}

/// The same where no such function is known.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
#[inline(always)]
fn sine_and_cosine(angle: f32) -> [f32; 2] {
    [angle.sin(), angle.cos()]
}

impl Real for f32 {
    const IS_PLAIN: bool = true;

    #[inline(always)]
    fn of(value: f32) -> Self {
        value
    }
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn round_coordinate(self) -> Self {
        self
    }
    #[inline(always)]
    fn from_hash_32(bits: u32) -> Self {
        bits as f32 * (1.0 / 4294967296.0)
    }
    #[inline(always)]
    fn from_hash_31(bits: i32) -> Self {
        bits as f32 * (1.0 / 2147483648.0)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.floor()
    }
    #[inline(always)]
    fn ceil(self) -> Self {
        self.ceil()
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        self.trunc()
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn fmod(self, divisor: Self) -> Self {
        remainder(self, divisor)
    }
    #[inline(always)]
    fn powf(self, exponent: Self) -> Self {
        self.powf(exponent)
    }
    #[inline(always)]
    fn library(self, function: Library) -> Self {
        library!(self, function)
    }
    #[inline(always)]
    fn sine_and_cosine(self) -> [Self; 2] {
        sine_and_cosine(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        self.atan2(x)
    }
    #[inline(always)]
    fn fmin(self, other: Self) -> Self {
        Self::min(self, other)
    }
    #[inline(always)]
    fn fmax(self, other: Self) -> Self {
        Self::max(self, other)
    }
    #[inline(always)]
    fn to_int(self) -> i32 {
        // In f32 no number lies between -2^31 - 1 and -2^31.
        if (-2_147_483_648.0..2_147_483_648.0).contains(&self) { self as i32 } else { i32::MIN }
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of_f64(value: f64) -> Self {
        value
    }
    const IS_PLAIN: bool = true;

    #[inline(always)]
    fn of(value: f32) -> Self {
        f64::from(value)
    }
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn round_coordinate(self) -> Self {
        self
    }
    #[inline(always)]
    fn from_hash_32(bits: u32) -> Self {
        f64::from(bits) / 4294967296.0
    }
    #[inline(always)]
    fn from_hash_31(bits: i32) -> Self {
        f64::from(bits) / 2147483648.0
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.floor()
    }
    #[inline(always)]
    fn ceil(self) -> Self {
        self.ceil()
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        self.trunc()
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.abs()
    }
    #[inline(always)]
    fn fmod(self, divisor: Self) -> Self {
        self % divisor
    }
    fn powf(self, exponent: Self) -> Self {
        self.powf(exponent)
    }
    fn library(self, function: Library) -> Self {
        library!(self, function)
    }
    fn atan2(self, x: Self) -> Self {
        self.atan2(x)
    }
    #[inline(always)]
    fn fmin(self, other: Self) -> Self {
        Self::min(self, other)
    }
    #[inline(always)]
    fn fmax(self, other: Self) -> Self {
        Self::max(self, other)
    }
    #[inline(always)]
    fn to_int(self) -> i32 {
        int_of(self)
    }
}

macro_rules! oracle_operators {
    ($($trait:ident $method:ident),*) => {$(
        impl $trait for Oracle {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    )*};
}
oracle_operators!(Add add, Sub sub, Mul mul, Div div);

impl Neg for Oracle {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Real for Oracle {
    #[inline(always)]
    fn of_f64(value: f64) -> Self {
        Self(value)
    }
    #[inline(always)]
    fn of(value: f32) -> Self {
        Self(f64::from(value))
    }
    #[inline(always)]
    fn to_f32(self) -> f32 {
        self.0 as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self.0
    }
    #[inline(always)]
    fn round_coordinate(self) -> Self {
        Self(f64::from(self.0 as f32))
    }
    #[inline(always)]
    fn from_hash_32(bits: u32) -> Self {
        Self::of(f32::from_hash_32(bits))
    }
    #[inline(always)]
    fn from_hash_31(bits: i32) -> Self {
        Self::of(f32::from_hash_31(bits))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(self.0.floor())
    }
    #[inline(always)]
    fn ceil(self) -> Self {
        Self(self.0.ceil())
    }
    #[inline(always)]
    fn trunc(self) -> Self {
        Self(self.0.trunc())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(always)]
    fn fmod(self, divisor: Self) -> Self {
        Self(self.0 % divisor.0)
    }
    fn powf(self, exponent: Self) -> Self {
        Self(self.0.powf(exponent.0))
    }
    fn library(self, function: Library) -> Self {
        Self(library!(self.0, function))
    }
    fn atan2(self, x: Self) -> Self {
        Self(self.0.atan2(x.0))
    }
    #[inline(always)]
    fn fmin(self, other: Self) -> Self {
        Self(f64::min(self.0, other.0))
    }
    #[inline(always)]
    fn fmax(self, other: Self) -> Self {
        Self(f64::max(self.0, other.0))
    }
    #[inline(always)]
    fn to_int(self) -> i32 {
        int_of(self.0)
    }
}

/// Dot product in the kernel's association: 4D pairs first and second half.
#[inline(always)]
pub fn dot<R: Real, const N: usize>(a: [R; N], b: [R; N]) -> R {
    match N {
        1 => a[0] * b[0],
        2 => a[0] * b[0] + a[1] * b[1],
        3 => (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2],
        _ => (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3]),
    }
}

/// Euclidean length by [`dot`].
#[inline(always)]
pub fn length<R: Real, const N: usize>(a: [R; N]) -> R {
    dot(a, a).sqrt()
}

/// Unit vector, or the vector itself when its length is 0.
#[inline(always)]
pub fn safe_unit<R: Real>(v: [R; 3]) -> [R; 3] {
    let norm = length(v);
    if norm != R::of(0.0) {
        let inverse = R::of(1.0) / norm;
        v.mapped(|x| x * inverse)
    } else {
        v
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn undefined<R: Real + std::fmt::Debug>() {
        let of = R::of;
        for value in [0.0, 1.0, -2.5, f32::MAX] {
            assert_eq!(of(value).safe_divide(of(0.0)), of(0.0));
            assert_eq!(of(value).safe_divide(of(-0.0)), of(0.0));
            assert_eq!(of(value).safe_power(of(0.0)), of(1.0));
        }
        assert_eq!(of(-2.0).safe_power(of(0.5)), of(0.0));
        assert_eq!(of(0.0).safe_power(of(-1.0)), of(0.0));
        assert_eq!(of(-2.0).safe_power(of(3.0)), of(-8.0));
    }

    #[test]
    fn divisions_and_powers_that_are_undefined_are_zero() {
        undefined::<f32>();
        undefined::<f64>();
        undefined::<Oracle>();
    }

    /// Random bits, most of them of ordinary magnitude, and special values.
    fn adversarial(count: usize) -> Vec<f32> {
        let mut state = 0x1234_5678_9ABC_DEF1_u64;
        let mut random = move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u32
        };
        let drawn = (0..count).map(|index| {
            let bits = random();
            match index % 4 {
                0 => f32::from_bits(bits),
                // Whole numbers and their halves, so that quotients are often whole.
                1 => (bits % 4096) as f32 * 0.5 - 1024.0,
                // Exponents from -3 to 28.
                _ => f32::from_bits((bits & 0x807F_FFFF) | ((124 + (bits >> 23) % 32) << 23)),
            }
        });
        let special = [0.0, 1.0, f32::MIN_POSITIVE, 1e-45, f32::MAX, f32::INFINITY, f32::NAN];
        drawn.chain(special.into_iter().flat_map(|value| [value, -value])).collect()
    }

    fn equal(a: f32, b: f32) -> bool {
        a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
    }

    #[test]
    fn remainders_are_those_of_the_c_library() {
        let values = adversarial(2048);
        for &a in &values {
            for &b in &values {
                assert!(equal(remainder(a, b), a % b), "{a:e} and {b:e}: {:e}, not {:e}", remainder(a, b), a % b);
            }
        }
    }

    #[test]
    fn sines_and_cosines_at_once_are_those_of_two_calls() {
        for angle in adversarial(1 << 18) {
            let [sine, cosine] = sine_and_cosine(angle);
            assert!(equal(sine, angle.sin()) && equal(cosine, angle.cos()), "{angle:e}");
        }
    }
}
