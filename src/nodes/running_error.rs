//! Running error analysis (Wilkinson 1986; Higham, "Accuracy and Stability of Numerical Algorithms",
//! 2002, section 3.3): a number type that carries, beside the f32 value, a bound on how far any
//! conforming WGSL evaluation may be from it.
//!
//! WGSL (section "Floating point evaluation") lets an adapter fuse and reassociate operations as long as the
//! result is at least as accurate as the written form, divide with 2.5 ulp, take square roots
//! through `inverseSqrt` (2 ulp) and a division, round integers either way, and flush denormals. So each
//! operation adds its own largest error to what its operands bring along, and the sum E bounds
//! |value - exact| for the written form and for every permitted one. Two evaluations, ours on the
//! CPU among them, are then at most 2 E apart: [`RunningError::between_evaluations`].
//!
//! Where an operand is within its error of a jump (a rounding function at a whole number, two sides of a minimum, a comparison) the
//! bound covers both sides. Lattice cells are the exception: gradient noise is smooth across the faces
//! of its cells and min(F1, 1) is 1-Lipschitz there, so the cell of the value stands for its neighbour. Where
//! Blender's F1 exceeds 1 it may jump at a face, and nothing bounds it there.

use crate::base::arrays::Mapped;
use crate::nodes::real::{Library, Real};
use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Largest relative error of one rounding to f32.
const ROUNDING: f64 = 1.0 / 16_777_216.0;

/// A unit in the last place relative to the value, at most.
const ULP: f64 = 2.0 * ROUNDING;

/// What flushing a denormal loses, at most.
const FLUSHED: f64 = f32::MIN_POSITIVE as f64;

/// Division, section "Accuracy of built-in functions" of WGSL.
const DIVISION: f64 = 2.5 * ULP;

/// 2 ulp of `inverseSqrt` and a division, with room for their product.
const SQUARE_ROOT: f64 = 4.51 * ULP;

/// What the shader modules' elementary functions are tested to.
const ELEMENTARY: f64 = 16.0 * ULP;

/// An f32 value and a bound on its distance from the exact result; see the module's head.
///
/// Its operations are calls: inlined into every mode of every texture, they would double the
/// compiler's time for a diagnostic.
#[derive(Debug, Clone, Copy, Default)]
pub struct RunningError {
    value: f32,
    /// Never NaN, which a maximum would forget: infinite where nothing is known.
    error: f64,
}

impl RunningError {
    /// The value in f32, in written order.
    pub fn value(self) -> f32 {
        self.value
    }

    /// A number of double precision, rounded to f32.
    pub fn rounded(value: f64) -> Self {
        Self { value: value as f32, error: farther((f64::from(value as f32) - value).abs(), 0.0) }
    }

    /// Largest distance of a conforming evaluation from the exact result; infinite where nothing is known.
    pub fn error(self) -> f64 {
        self.error
    }

    /// Largest difference between two conforming evaluations; infinite where nothing is known.
    pub fn between_evaluations(self) -> f64 {
        2.0 * self.error
    }

    /// A value with what its operands bring along, and the error of the operation itself.
    fn new(value: f32, inherited: f64, relative: f64, exact: bool) -> Self {
        if !value.is_finite() {
            return Self { value, error: f64::INFINITY };
        }
        let magnitude = f64::from(value.abs());
        // An exact operation on exact operands gives the same value however it is evaluated.
        let own = if exact && inherited == 0.0 { 0.0 } else { relative * (magnitude + inherited) + FLUSHED };
        // 0 times what is unbounded is unbounded.
        Self { value, error: farther(inherited + own, 0.0) }
    }

    /// The value of a function that is monotonic in each operand between the ends of their errors.
    fn monotonic(value: f32, ends: impl IntoIterator<Item = f64>) -> Self {
        let inherited = ends.into_iter().map(|end| (end - f64::from(value)).abs()).fold(0.0, farther);
        Self::new(value, inherited, ELEMENTARY, false)
    }

    fn ends(self) -> [f64; 2] {
        [f64::from(self.value) - self.error, f64::from(self.value) + self.error]
    }

    /// A rounding function: a step apart where the ends of the error are.
    #[inline(never)]
    fn stepped(self, function: fn(f64) -> f64) -> Self {
        let value = function(f64::from(self.value));
        let error = self.ends().map(|end| (function(end) - value).abs()).into_iter().fold(0.0, farther);
        Self { value: value as f32, error }
    }

    /// Whether rounding can turn a comparison with `other` around.
    fn is_undecided(self, other: Self) -> bool {
        let error = self.error + other.error;
        let apart = (f64::from(self.value) - f64::from(other.value)).abs();
        error > 0.0 && apart <= error
    }

    /// The chosen one of two operands, with both errors where the choice is within them.
    #[inline(never)]
    fn chosen(self, other: Self, first: bool) -> Self {
        let chosen = if first { self } else { other };
        let error = if self.is_undecided(other) { self.error.max(other.error) } else { chosen.error };
        Self { error, ..chosen }
    }
}

/// The larger of two distances; one that is NaN is unbounded.
fn farther(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// By the value alone.
impl PartialEq for RunningError {
    #[inline(always)]
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl PartialOrd for RunningError {
    #[inline(always)]
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl Add for RunningError {
    type Output = Self;
    #[inline(never)]
    fn add(self, other: Self) -> Self {
        let value = self.value + other.value;
        let sum = f64::from(self.value) + f64::from(other.value);
        // f64 loses an operand that is 2^53 times smaller; then f32 does, too.
        let absorbed = (other.value != 0.0 && sum == f64::from(self.value))
            || (self.value != 0.0 && sum == f64::from(other.value));
        Self::new(value, self.error + other.error, ROUNDING, sum == f64::from(value) && !absorbed)
    }
}

impl Sub for RunningError {
    type Output = Self;
    #[inline(never)]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for RunningError {
    type Output = Self;
    #[inline(never)]
    fn mul(self, other: Self) -> Self {
        let value = self.value * other.value;
        let [a, b] = [self.value, other.value].mapped(|value| f64::from(value.abs()));
        let mut inherited = a * other.error + b * self.error + self.error * other.error;
        if (a == 0.0 && self.error == 0.0) || (b == 0.0 && other.error == 0.0) {
            // 0 times an unbounded error.
            inherited = 0.0;
        }
        // The product of two f32 is exact in f64.
        let exact = f64::from(self.value) * f64::from(other.value) == f64::from(value);
        Self::new(value, inherited, ROUNDING, exact)
    }
}

impl Div for RunningError {
    type Output = Self;
    #[inline(never)]
    fn div(self, other: Self) -> Self {
        let value = self.value / other.value;
        let divisor = f64::from(other.value.abs()) - other.error;
        let inherited = if divisor > 0.0 {
            (self.error + f64::from(value.abs()) * other.error) / divisor
        } else if self.error == 0.0 && other.error == 0.0 {
            0.0
        } else {
            f64::INFINITY
        };
        // Not even exact quotients are promised.
        Self::new(value, inherited, DIVISION, self.value == 0.0)
    }
}

impl Neg for RunningError {
    type Output = Self;
    #[inline(never)]
    fn neg(self) -> Self {
        Self { value: -self.value, error: self.error }
    }
}

impl Real for RunningError {
    fn of(value: f32) -> Self {
        Self { value, error: 0.0 }
    }
    fn to_f32(self) -> f32 {
        self.value
    }
    fn to_f64(self) -> f64 {
        f64::from(self.value)
    }
    fn round_coordinate(self) -> Self {
        self
    }
    #[inline(never)]
    fn from_hash_32(bits: u32) -> Self {
        let value = f32::from_hash_32(bits);
        Self::new(value, 0.0, ULP, f64::from(value) * 4_294_967_296.0 == f64::from(bits))
    }
    #[inline(never)]
    fn from_hash_31(bits: i32) -> Self {
        let value = f32::from_hash_31(bits);
        Self::new(value, 0.0, ULP, f64::from(value) * 2_147_483_648.0 == f64::from(bits))
    }
    #[inline(never)]
    fn sqrt(self) -> Self {
        let [low, high] = self.ends().mapped(|end| end.max(0.0).sqrt());
        let exact = f64::from(self.value).sqrt();
        Self::new(self.value.sqrt(), (exact - low).max(high - exact), SQUARE_ROOT, self.value == 0.0)
    }
    #[inline(never)]
    fn floor(self) -> Self {
        self.stepped(f64::floor)
    }
    fn lattice_floor(self) -> Self {
        Self::of(self.value.floor())
    }
    #[inline(never)]
    fn ceil(self) -> Self {
        self.stepped(f64::ceil)
    }
    #[inline(never)]
    fn trunc(self) -> Self {
        self.stepped(f64::trunc)
    }
    fn abs(self) -> Self {
        Self { value: self.value.abs(), error: self.error }
    }
    #[inline(never)]
    fn fmod(self, divisor: Self) -> Self {
        let value = self.value % divisor.value;
        let quotient = (self / divisor).stepped(f64::trunc);
        let inherited = self.error
            + f64::from(quotient.value.abs()) * divisor.error
            + quotient.error * (f64::from(divisor.value.abs()) + divisor.error);
        Self::new(value, inherited, ULP, true)
    }
    #[inline(never)]
    fn powf(self, exponent: Self) -> Self {
        let ends = self.ends().into_iter().flat_map(|base| {
            // A base whose error reaches below 0 is a distance: it ends at 0.
            exponent.ends().mapped(|exponent| base.max(0.0).powf(exponent))
        });
        Self::monotonic(self.value.powf(exponent.value), ends)
    }
    #[inline(never)]
    fn library(self, function: Library) -> Self {
        let value = self.value.library(function);
        match function {
            Library::Sin | Library::Cos => Self::new(value, self.error, ELEMENTARY, false),
            // Between the poles, and where the argument stays in the domain.
            _ => Self::monotonic(value, self.ends().mapped(|end| end.library(function))),
        }
    }
    #[inline(never)]
    fn atan2(self, x: Self) -> Self {
        let (length, error) = (self.to_f64().hypot(x.to_f64()), self.error.hypot(x.error));
        // The angle under which the error is seen; behind the origin the angle jumps.
        let behind = x.value < 0.0 && f64::from(self.value.abs()) <= self.error;
        let inherited = if error == 0.0 {
            0.0
        } else if error >= length || behind {
            f64::INFINITY
        } else {
            (error / length).asin()
        };
        Self::new(self.value.atan2(x.value), inherited, ELEMENTARY, false)
    }
    fn fmin(self, other: Self) -> Self {
        self.chosen(other, self.value <= other.value || other.value.is_nan())
    }
    fn fmax(self, other: Self) -> Self {
        self.chosen(other, self.value >= other.value || other.value.is_nan())
    }
    fn to_int(self) -> i32 {
        self.value.to_int()
    }
    #[inline(never)]
    fn greater(self, other: Self) -> Self {
        self.chosen(other, self.value > other.value)
    }
    #[inline(never)]
    fn lesser(self, other: Self) -> Self {
        self.chosen(other, self.value < other.value)
    }
    #[inline(never)]
    fn decided(self, other: Self, condition: bool) -> Self {
        // What is not finite after an operation has no bound, and no order.
        let is_unknown = self.error + other.error == f64::INFINITY;
        let error = if is_unknown || self.is_undecided(other) { 1.0 } else { 0.0 };
        Self { value: if condition { 1.0 } else { 0.0 }, error }
    }
    /// It rises with the value and falls with either edge, so its ends are those of the three errors together. Its own operations,
    /// some 21 roundings, are less than `ELEMENTARY`.
    #[inline(never)]
    fn smooth_step(self, edge0: Self, edge1: Self) -> Self {
        let value = self.value.smooth_step(edge0.value, edge1.value);
        let [[low, high], [low0, high0], [low1, high1]] = [self, edge0, edge1].mapped(Self::ends);
        if high0 >= low1 {
            // A jump between 0 and 1, or between what may be one.
            return Self::new(value, 1.0, ELEMENTARY, false);
        }
        if high <= low0 || low >= high1 {
            return Self::of(value);
        }
        Self::monotonic(value, [low.smooth_step(high0, high1), high.smooth_step(low0, low1)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn of(value: f32) -> RunningError {
        RunningError::of(value)
    }

    #[test]
    fn what_is_exact_has_no_error() {
        let exact = [of(0.5) * of(3.0), of(1.0) - of(0.25), of(7.0).floor(), of(0.1).greater(of(0.2)), of(0.0).sqrt()];
        assert!(exact.iter().all(|result| result.between_evaluations() == 0.0));
        assert!((of(0.1) * of(0.1)).between_evaluations() > 0.0);
        assert!((of(1.0) + of(1e-30)).between_evaluations() > 0.0);
    }

    #[test]
    fn a_fused_product_is_within_the_bound() {
        // a b - c cancels: the fused form keeps the rounding of the product.
        for step in 1..1000_u32 {
            let (a, b) = (1.0 + step as f32 * 1e-4, 1.0 - step as f32 * 3e-5);
            let c = a * b;
            let found = of(a) * of(b) - of(c);
            let fused = a.mul_add(b, -c);
            let difference = f64::from(fused) - f64::from(found.value());
            assert!(difference.abs() <= found.between_evaluations(), "{a} * {b}");
            // The bound is a few roundings of the product and no more.
            assert!(found.between_evaluations() <= 4.0 * ROUNDING * f64::from(c));
        }
    }

    /// What the inputs may be in truth, anywhere within their errors, gives a result within that of the bound; and so do roundings of
    /// f32 on the way.
    #[test]
    fn smooth_steps_stay_within_their_bound_at_their_edges_and_between() {
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let mut beyond_an_edge = 0;
        for case in 0..200_000 {
            let edges = [random.random_range(-2.0..1.0_f32), random.random_range(1e-3..2.0_f32)];
            let edges = [edges[0], edges[0] + edges[1]];
            // At an edge, near one, or anywhere.
            let place = match case % 3 {
                0 => edges[case / 3 % 2],
                1 => edges[case / 3 % 2] + random.random_range(-1e-6..1e-6_f32),
                _ => random.random_range(-3.0..3.0_f32),
            };
            let mut uncertain = |value: f32| {
                let error = f64::from(random.random_range(0.0..1.0_f32)).powi(8) * 1e-2;
                let truth = f64::from(value) + error * random.random_range(-1.0..=1.0);
                (RunningError { value, error }, truth)
            };
            let ((x, true_x), (low, true_low), (high, true_high)) =
                (uncertain(place), uncertain(edges[0]), uncertain(edges[1]));
            let found = x.smooth_step(low, high);
            let truth = true_x.smooth_step(true_low, true_high);
            assert!(
                (f64::from(found.value) - truth).abs() <= found.error,
                "{x:?} {low:?} {high:?}: {found:?}, {truth}"
            );
            assert_eq!(found.value, place.smooth_step(edges[0], edges[1]));
            beyond_an_edge += usize::from((found.value == 0.0 || found.value == 1.0) && found.error > 0.0);
            assert!(found.error <= 1.0 + 3.0 * ELEMENTARY);
            // Where it is no jump it costs what the slope, 1.5 over the width at most, makes of the errors.
            let (errors, width) = (x.error + low.error + high.error, f64::from(edges[1] - edges[0]));
            let slope = 1.5 / (width - low.error - high.error);
            assert!(
                width < 0.1 || found.error <= slope * errors + 3.0 * ELEMENTARY,
                "{x:?} {low:?} {high:?}: {found:?}"
            );
        }
        assert!(beyond_an_edge > 10_000, "{beyond_an_edge}");
        let exact = of(3.0).smooth_step(of(0.0), of(1.0));
        assert_eq!((exact.value(), exact.between_evaluations()), (1.0, 0.0));
    }

    #[test]
    fn what_is_unbounded_stays_unbounded() {
        let unbounded = RunningError { value: 1.0, error: f64::INFINITY };
        let zero = RunningError { value: 0.0, error: 1e-9 };
        for found in
            [zero * unbounded, unbounded - unbounded, (zero * unbounded).sqrt(), (zero * unbounded).fmax(of(0.5))]
        {
            assert_eq!(found.between_evaluations(), f64::INFINITY, "{found:?}");
        }
        assert_eq!((zero * unbounded).powf(of(2.0)).between_evaluations(), f64::INFINITY);
    }

    #[test]
    fn comparisons_within_an_error_cover_both_answers() {
        let near = of(0.1) * of(10.0);
        assert_eq!(near.decided(of(1.0), near < of(1.0)).between_evaluations(), 2.0);
        assert_eq!(near.decided(of(2.0), near < of(2.0)).between_evaluations(), 0.0);
        assert_eq!(of(1.0).decided(of(1.0), false).between_evaluations(), 0.0);
    }

    #[test]
    fn an_undecided_step_covers_both_sides() {
        let near = of(0.1) * of(10.0);
        assert_eq!(near.value(), 1.0);
        assert_eq!(near.floor().between_evaluations(), 2.0);
        assert_eq!(near.lattice_floor().between_evaluations(), 0.0);
        let smaller = near.lesser(of(1.0));
        assert_eq!(smaller.between_evaluations(), near.between_evaluations());
    }

    #[test]
    fn a_division_by_what_may_be_zero_has_no_bound() {
        let small = of(0.1) * of(10.0) - of(1.0);
        assert_eq!((of(1.0) / small).between_evaluations(), f64::INFINITY);
        assert_eq!(of(f32::MAX).mul(of(2.0)).between_evaluations(), f64::INFINITY);
    }
}
