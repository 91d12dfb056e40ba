//! The formulas of blend modes on one component.
//!
//! Each formula without a branch is written once, for the number types of evaluation, for intervals and for the corners of a box
//! ([`Arithmetic`]). Source: Blender's blend modes as Cycles orders them.

use crate::nodes::{Interval, Real};
use std::ops::{Add, Mul, Sub};

/// What the formulas need of a type.
pub trait Arithmetic: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// Exact conversion.
    fn constant(value: f32) -> Self;
    /// Quotient.
    fn over(self, divisor: Self) -> Self;
    /// `a if a < b else b`.
    fn smaller(self, other: Self) -> Self;
    /// `a if a > b else b`.
    fn larger(self, other: Self) -> Self;
    /// Magnitude.
    fn absolute(self) -> Self;
}

impl<R: Real> Arithmetic for R {
    #[inline(always)]
    fn constant(value: f32) -> Self {
        R::of(value)
    }
    #[inline(always)]
    fn over(self, divisor: Self) -> Self {
        self / divisor
    }
    #[inline(always)]
    fn smaller(self, other: Self) -> Self {
        self.lesser(other)
    }
    #[inline(always)]
    fn larger(self, other: Self) -> Self {
        self.greater(other)
    }
    #[inline(always)]
    fn absolute(self) -> Self {
        self.abs()
    }
}

impl Arithmetic for Interval {
    fn constant(value: f32) -> Self {
        Self::point(value)
    }
    fn over(self, divisor: Self) -> Self {
        self.divide(divisor)
    }
    fn smaller(self, other: Self) -> Self {
        self.lesser(other)
    }
    fn larger(self, other: Self) -> Self {
        self.greater(other)
    }
    fn absolute(self) -> Self {
        self.abs()
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// Formulas: a below, b on top, t the factor

fn one<T: Arithmetic>() -> T {
    T::constant(1.0)
}

fn two<T: Arithmetic>() -> T {
    T::constant(2.0)
}

/// The mean of `a` and `b` with weights `1 - t` and `t`: how floats and vectors are mixed.
#[inline(always)]
pub fn weighted<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a * (one::<T>() - t) + b * t
}

#[inline(always)]
pub fn linear<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a + t * (b - a)
}

#[inline(always)]
pub fn darken<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, a.smaller(b), t)
}

#[inline(always)]
pub fn lighten<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, a.larger(b), t)
}

#[inline(always)]
pub fn multiply<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, a * b, t)
}

#[inline(always)]
pub fn add<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, a + b, t)
}

/// [`multiply`] since Blender 5.3; [`linear`] is [`weighted`] there.
#[inline(always)]
pub fn multiply_since_5_3<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a * ((one::<T>() - t) + t * b)
}

/// [`add`] since Blender 5.3.
#[inline(always)]
pub fn add_since_5_3<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a + t * b
}

/// [`subtract`] since Blender 5.3.
#[inline(always)]
pub fn subtract_since_5_3<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a - t * b
}

#[inline(always)]
pub fn subtract<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, a - b, t)
}

#[inline(always)]
pub fn difference<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, (a - b).absolute(), t)
}

/// Exclusion before its limit.
#[inline(always)]
pub fn excluded<T: Arithmetic>(a: T, b: T, t: T) -> T {
    linear(a, (a + b) - (two::<T>() * a) * b, t)
}

#[inline(always)]
pub fn screen<T: Arithmetic>(a: T, b: T, t: T) -> T {
    one::<T>() - ((one::<T>() - t) + t * (one::<T>() - b)) * (one::<T>() - a)
}

/// Overlay for `a` below one half.
#[inline(always)]
pub fn overlay_dark<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a * ((one::<T>() - t) + (two::<T>() * t) * b)
}

/// Overlay for `a` from one half on.
#[inline(always)]
pub fn overlay_light<T: Arithmetic>(a: T, b: T, t: T) -> T {
    one::<T>() - ((one::<T>() - t) + (two::<T>() * t) * (one::<T>() - b)) * (one::<T>() - a)
}

#[inline(always)]
pub fn soft_light<T: Arithmetic>(a: T, b: T, t: T) -> T {
    let screened = one::<T>() - (one::<T>() - b) * (one::<T>() - a);
    (one::<T>() - t) * a + t * (((one::<T>() - a) * b) * a + a * screened)
}

#[inline(always)]
pub fn linear_light<T: Arithmetic>(a: T, b: T, t: T) -> T {
    a + t * (two::<T>() * b + T::constant(-1.0))
}

/// Divide where `b` is not 0.
#[inline(always)]
pub fn quotient<T: Arithmetic>(a: T, b: T, t: T) -> T {
    (one::<T>() - t) * a + (t * a).over(b)
}

#[inline(always)]
pub fn dodge_divisor<T: Arithmetic>(_: T, b: T, t: T) -> T {
    one::<T>() - t * b
}

#[inline(always)]
pub fn burn_divisor<T: Arithmetic>(_: T, b: T, t: T) -> T {
    (one::<T>() - t) + t * b
}

// ---------------------------------------------------------------------------------------------------------------------
// Formulas with branches

#[inline(always)]
pub fn exclusion<R: Real>(a: R, b: R, t: R) -> R {
    excluded(a, b, t).greater(R::of(0.0))
}

#[inline(always)]
pub fn overlay<R: Real>(a: R, b: R, t: R) -> R {
    if a < R::of(0.5) { overlay_dark(a, b, t) } else { overlay_light(a, b, t) }
}

#[inline(always)]
pub fn divide<R: Real>(a: R, b: R, t: R) -> R {
    if b != R::of(0.0) { quotient(a, b, t) } else { a }
}

#[inline(always)]
pub fn dodge<R: Real>(a: R, b: R, t: R) -> R {
    let divisor = dodge_divisor(a, b, t);
    // The limit in the first place lets a NaN through.
    let quotient = R::of(1.0).lesser(a / divisor);
    // Two selections, no branches: what colours decide is not worth predicting.
    let result = if divisor <= R::of(0.0) { R::of(1.0) } else { quotient };
    if a == R::of(0.0) { a } else { result }
}

#[inline(always)]
pub fn burn<R: Real>(a: R, b: R, t: R) -> R {
    let divisor = burn_divisor(a, b, t);
    let quotient = (R::of(1.0) - a) / divisor;
    let result = R::of(1.0).lesser(R::of(0.0).greater(R::of(1.0) - quotient));
    if divisor <= R::of(0.0) { R::of(0.0) } else { result }
}
