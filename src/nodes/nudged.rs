//! f32 whose last bits are moved on purpose: how far a value depends on bits that nobody promises.
//!
//! Two builds of the C library differ by a unit in the last place here and there ([`Nudge::Library`]), and a shader may fuse,
//! reassociate and divide inexactly ([`Nudge::Everything`]). Evaluating a program under several nudges gives, point by point, the
//! values that such differences lead to, through everything that comes after them: amplification, cancellation, comparisons that
//! turn out otherwise. (The idea is that of random rounding: Vignes, "A stochastic arithmetic for reliable scientific
//! computation", 1993.)
//!
//! Which way a result moves is a hash of the function, its arguments and the seed of the nudge: a library is a function, so
//! equal arguments give equal results, whoever asks. Seed 0 moves nothing, 1 everything up, 2 everything down. What every
//! library gets right stays: results that are exact, and ends of a function's range.
//!
//! The nudge belongs to the thread ([`with`]), because numbers have no place to carry it.

use crate::nodes::real::{Library, Real};
use std::cell::Cell;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// What moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nudge {
    /// Nothing: plain f32.
    Nothing,
    /// Results of the C library, by a unit in the last place.
    Library(u64),
    /// Every inexact result: by a unit in the last place, divisions and square roots by two. And the sign of a zero that was
    /// computed, which WGSL does not promise to keep (its specification, section "Floating point evaluation").
    Everything(u64),
}

thread_local! {
    static NUDGE: Cell<Nudge> = const { Cell::new(Nudge::Nothing) };
    static CALLS: Cell<u64> = const { Cell::new(0) };
}

/// Does the work under a nudge, on this thread.
pub fn with<T>(nudge: Nudge, work: impl FnOnce() -> T) -> T {
    struct Restore(Nudge);
    impl Drop for Restore {
        fn drop(&mut self) {
            NUDGE.set(self.0);
        }
    }
    let _restore = Restore(NUDGE.replace(nudge));
    work()
}

/// Calls of the C library that this thread made with [`Nudged`] so far.
pub fn calls() -> u64 {
    CALLS.get()
}

/// An f32 that obeys the thread's [`Nudge`].
///
/// Its operations are calls, as those of [`super::RunningError`]: it is for diagnostics.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
pub struct Nudged(pub f32);

/// Up (1), down (-1) or nowhere (0).
fn direction(seed: u64, function: u64, arguments: [f32; 2]) -> i32 {
    match seed {
        0 => 0,
        1 => 1,
        2 => -1,
        _ => {
            // SplitMix64's mixing over all that counts.
            let words = [function, u64::from(arguments[0].to_bits()), u64::from(arguments[1].to_bits())];
            let hash = words.into_iter().fold(seed, |hash, word| {
                let mixed = (hash ^ word).wrapping_add(0x9E37_79B9_7F4A_7C15);
                let mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
                mixed ^ (mixed >> 31)
            });
            (hash % 3) as i32 - 1
        }
    }
}

/// The value some units in the last place away; never to the other side of 0, and from a finite number
/// never to infinity.
fn moved(value: f32, direction: i32, units: u32) -> f32 {
    let mut result = value;
    for _ in 0..units {
        result = match direction {
            1 => result.next_up(),
            -1 => result.next_down(),
            _ => result,
        };
    }
    if !result.is_finite() || result * value.signum() < 0.0 { value } else { result }
}

/// A result of the C library; `exact` is the same in f64.
fn from_library(value: f32, exact: f64, function: u64, arguments: [f32; 2]) -> Nudged {
    CALLS.set(CALLS.get() + 1);
    let (Nudge::Library(seed) | Nudge::Everything(seed)) = NUDGE.get() else { return Nudged(value) };
    // What f32 holds exactly, every library gives.
    if !value.is_finite() || exact == f64::from(value) {
        return Nudged(value);
    }
    Nudged(moved(value, direction(seed, function, arguments), 1))
}

/// A result of Blender's own folding in a node that calls the library, which is no generic arithmetic.
pub(crate) fn folded(value: f32) -> f32 {
    // Whole numbers are special cases of the rules, not results.
    let exact = if value == value.trunc() { f64::from(value) } else { f64::NAN };
    from_library(value, exact, 99, [value, 0.0]).0
}

/// A result of arithmetic, where `exact` says that no evaluation can give another one.
fn from_arithmetic(value: f32, exact: bool, function: u64, arguments: [f32; 2], units: u32) -> Nudged {
    match NUDGE.get() {
        Nudge::Everything(seed) if !exact && value.is_finite() => {
            Nudged(moved(value, direction(seed, function, arguments), units))
        }
        Nudge::Everything(seed) if value == 0.0 => Nudged(match direction(seed, function, arguments) {
            1 => 0.0,
            -1 => -0.0,
            _ => value,
        }),
        _ => Nudged(value),
    }
}

impl Add for Nudged {
    type Output = Self;
    #[inline(never)]
    fn add(self, other: Self) -> Self {
        let value = self.0 + other.0;
        let exact = f64::from(self.0) + f64::from(other.0) == f64::from(value);
        from_arithmetic(value, exact, 1, [self.0, other.0], 1)
    }
}

impl Sub for Nudged {
    type Output = Self;
    #[inline(never)]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Nudged {
    type Output = Self;
    #[inline(never)]
    fn mul(self, other: Self) -> Self {
        let value = self.0 * other.0;
        // The product of two f32 is exact in f64.
        let exact = f64::from(self.0) * f64::from(other.0) == f64::from(value);
        from_arithmetic(value, exact, 2, [self.0, other.0], 1)
    }
}

impl Div for Nudged {
    type Output = Self;
    #[inline(never)]
    fn div(self, other: Self) -> Self {
        // Not even exact quotients are promised.
        from_arithmetic(self.0 / other.0, self.0 == 0.0, 3, [self.0, other.0], 2)
    }
}

impl Neg for Nudged {
    type Output = Self;
    #[inline(never)]
    fn neg(self) -> Self {
        Self(-self.0)
    }
}

impl Real for Nudged {
    fn of(value: f32) -> Self {
        Self(value)
    }
    fn to_f32(self) -> f32 {
        self.0
    }
    fn to_f64(self) -> f64 {
        f64::from(self.0)
    }
    fn round_coordinate(self) -> Self {
        self
    }
    fn from_hash_32(bits: u32) -> Self {
        Self(f32::from_hash_32(bits))
    }
    fn from_hash_31(bits: i32) -> Self {
        Self(f32::from_hash_31(bits))
    }
    #[inline(never)]
    fn sqrt(self) -> Self {
        from_arithmetic(self.0.sqrt(), self.0 == 0.0, 4, [self.0, 0.0], 2)
    }
    fn floor(self) -> Self {
        Self(self.0.floor())
    }
    fn ceil(self) -> Self {
        Self(self.0.ceil())
    }
    fn trunc(self) -> Self {
        Self(self.0.trunc())
    }
    fn abs(self) -> Self {
        Self(self.0.abs())
    }
    #[inline(never)]
    fn fmod(self, divisor: Self) -> Self {
        let exact = self.0.abs() < divisor.0.abs();
        from_arithmetic(self.0 % divisor.0, exact, 5, [self.0, divisor.0], 1)
    }
    #[inline(never)]
    fn powf(self, exponent: Self) -> Self {
        let exact = f64::from(self.0).powf(f64::from(exponent.0));
        from_library(self.0.powf(exponent.0), exact, 6, [self.0, exponent.0])
    }
    #[inline(never)]
    fn library(self, function: Library) -> Self {
        let value = self.0.library(function);
        let exact = f64::from(self.0).library(function);
        let result = from_library(value, exact, 16 + function as u64, [self.0, 0.0]);
        let bounded = matches!(function, Library::Sin | Library::Cos | Library::Tanh);
        if bounded && result.0.abs() > 1.0 { Self(value) } else { result }
    }
    #[inline(never)]
    fn atan2(self, x: Self) -> Self {
        let exact = f64::from(self.0).atan2(f64::from(x.0));
        from_library(self.0.atan2(x.0), exact, 7, [self.0, x.0])
    }
    fn fmin(self, other: Self) -> Self {
        Self(Real::fmin(self.0, other.0))
    }
    fn fmax(self, other: Self) -> Self {
        Self(Real::fmax(self.0, other.0))
    }
    fn to_int(self) -> i32 {
        self.0.to_int()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(value: f32, nudge: Nudge) -> f32 {
        with(nudge, || Nudged(value).library(Library::Sin).0)
    }

    #[test]
    fn the_library_moves_by_a_unit_and_arithmetic_does_not() {
        let plain = 0.7_f32.sin();
        assert_eq!(sine(0.7, Nudge::Library(0)), plain);
        assert_eq!(sine(0.7, Nudge::Library(1)), plain.next_up());
        assert_eq!(sine(0.7, Nudge::Library(2)), plain.next_down());
        let found: Vec<f32> = (3..40).map(|seed| sine(0.7, Nudge::Library(seed))).collect();
        for expected in [plain, plain.next_up(), plain.next_down()] {
            assert!(found.contains(&expected), "{expected}");
        }
        let product = |nudge| with(nudge, || (Nudged(0.1) * Nudged(0.3)).0);
        assert_eq!(product(Nudge::Library(1)), 0.1 * 0.3);
        assert_eq!(product(Nudge::Everything(1)), (0.1_f32 * 0.3).next_up());
    }

    #[test]
    fn what_is_exact_stays() {
        for nudge in [Nudge::Everything(1), Nudge::Everything(2)] {
            assert_eq!(sine(0.0, nudge), 0.0);
            assert_eq!(with(nudge, || Nudged(0.0).library(Library::Cos).0), 1.0);
            assert_eq!(with(nudge, || Nudged(3.0).powf(Nudged(2.0)).0), 9.0);
            assert_eq!(with(nudge, || (Nudged(0.5) * Nudged(3.0)).0), 1.5);
            // The largest sine is 1 in every library, and no exponential is negative.
            assert!(sine(std::f32::consts::FRAC_PI_2, nudge) <= 1.0);
            assert!(with(nudge, || Nudged(-200.0).library(Library::Exp).0) >= 0.0);
        }
    }

    #[test]
    fn signs_of_computed_zeros_move_with_everything_and_not_with_the_library() {
        let zero = |nudge| with(nudge, || (Nudged(0.0) * Nudged(3.0)).0.to_bits());
        assert_eq!(zero(Nudge::Everything(0)), 0.0_f32.to_bits());
        assert_eq!(zero(Nudge::Everything(1)), 0.0_f32.to_bits());
        assert_eq!(zero(Nudge::Everything(2)), (-0.0_f32).to_bits());
        assert_eq!(zero(Nudge::Library(2)), 0.0_f32.to_bits());
    }

    #[test]
    fn equal_arguments_have_equal_results_and_calls_are_counted() {
        let before = calls();
        for seed in 0..40 {
            assert_eq!(sine(0.7, Nudge::Library(seed)), sine(0.7, Nudge::Library(seed)));
        }
        assert_eq!(calls() - before, 80);
    }
}
