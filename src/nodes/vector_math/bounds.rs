//! Bounds of the Vector Math node's operations.

use crate::base::arrays::{self, Mapped};
use crate::nodes::bounds::Interval;
use crate::nodes::math::bounds::{may_overflow, modulo, sign, snap, wrap};
use crate::scene::Release;

type Vector = [Interval; 3];

/// Below this square an f32 square loses digits or vanishes, and with it the sense of a direction.
const SMALLEST_SQUARE: f32 = 1e-30;

fn each(a: Vector, b: Vector, function: impl Fn(Interval, Interval) -> Interval) -> Vector {
    arrays::each(|axis| function(a[axis], b[axis]))
}

fn dot(a: Vector, b: Vector) -> Interval {
    (a[0] * b[0] + a[1] * b[1]) + a[2] * b[2]
}

fn square(a: Vector) -> Interval {
    (a[0].square() + a[1].square()) + a[2].square()
}

/// Length, exactly that of the kernels: the root of the sum of squares.
pub(super) fn length(a: Vector) -> Interval {
    square(a).sqrt()
}

/// Unit vector, or the vector itself when its length vanishes.
pub(in crate::nodes) fn safe_unit(a: Vector) -> Vector {
    let nan = a.iter().any(|x| x.may_be_nan || x.magnitude().is_infinite());
    let norm_square = square(a);
    if nan || norm_square.low < SMALLEST_SQUARE || norm_square.high.is_infinite() {
        // Rounding of tiny squares lengthens a vector by less than a half: f32 holds the square of
        // a length that it does not flush to within a factor of 2. An overflowing square gives 0.
        return [Interval::new(-1.5, 1.5).or_nan(nan); 3];
    }
    arrays::each(|axis| {
        let [low, high] = a[axis].ends();
        let [others_low, others_high] = (a[(axis + 1) % 3].square() + a[(axis + 2) % 3].square()).ends();
        // x / sqrt(x^2 + m) rises with x; a positive one falls with m, a negative one rises.
        let unit = |x: f64, m: f64| if x == 0.0 { 0.0 } else { x / (x * x + m).sqrt() };
        let least = unit(low, if low > 0.0 { others_high } else { others_low });
        let greatest = unit(high, if high > 0.0 { others_low } else { others_high });
        // Square, sum, root, reciprocal and product: each below PAD.
        Interval::with_error(least, greatest, 4e-6, false)
    })
}

/// Keeps each component within the length `a` can have, where the direction is sound.
fn no_longer_than(result: Vector, a: Vector, sound: bool) -> Vector {
    if !sound {
        return result;
    }
    let limit = f64::from(length(a).high);
    let shell = Interval::with_error(-limit, limit, 1e-5 * limit, true);
    result.mapped(|x| if limit.is_finite() { x.meet(shell) } else { x })
}

/// Whether the direction of a vector is well-defined: its square neither vanishes nor overflows.
pub(in crate::nodes) fn is_sound(b: Vector) -> bool {
    let square = square(b);
    square.low > SMALLEST_SQUARE && square.is_finite()
}

fn project(a: Vector, b: Vector) -> Vector {
    let square = square(b);
    let along = if square.as_point() == Some(0.0) { Interval::ZERO } else { dot(a, b).divide(square) };
    let result = b.mapped(|x| along * x);
    let result = if square.has_zero() { result.mapped(|x| x.hull(Interval::ZERO)) } else { result };
    no_longer_than(result, a, is_sound(b))
}

fn reflect(a: Vector, b: Vector) -> Vector {
    let normal = safe_unit(b);
    let product = dot(a, normal);
    let result = each(a, normal, |x, n| x - (Interval::point(2.0) * n) * product);
    no_longer_than(result, a, is_sound(b))
}

fn refract(a: Vector, b: Vector, eta: Interval) -> Vector {
    let normal = safe_unit(b);
    let cosine = dot(normal, a);
    let k = Interval::ONE - eta.square() * (Interval::ONE - cosine.square());
    if k.high < 0.0 && !k.may_be_nan {
        return [Interval::ZERO; 3];
    }
    let root = Interval { low: k.low.max(0.0), high: k.high.max(0.0), ..k }.sqrt();
    let along = eta * cosine + root;
    let result = each(a, normal, |x, n| eta * x - along * n);
    if k.low < 0.0 { result.mapped(|x| x.hull(Interval::ZERO)) } else { result }
}

/// Bounds of `operation`; a single result stands in the first component.
pub(super) fn operation(operation: &str, release: Release, [a, b, c]: [Vector; 3], scale: Interval) -> Vector {
    match operation {
        "ADD" => each(a, b, |x, y| x + y),
        "SUBTRACT" => each(a, b, |x, y| x - y),
        "MULTIPLY" => each(a, b, |x, y| x * y),
        "DIVIDE" => each(a, b, Interval::safe_divide),
        "MULTIPLY_ADD" => each(each(a, b, |x, y| x * y), c, |x, y| x + y),
        "CROSS_PRODUCT" => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]],
        "PROJECT" => project(a, b),
        "REFLECT" => reflect(a, b),
        "REFRACT" => refract(a, b, scale),
        "FACEFORWARD" => {
            let side = dot(c, b);
            if side.high < 0.0 && !side.may_be_nan {
                a
            } else if side.low >= 0.0 {
                a.mapped(|x| -x)
            } else {
                a.mapped(|x| x.hull(-x))
            }
        }
        "DOT_PRODUCT" => [dot(a, b); 3],
        "DISTANCE" => [length(each(a, b, |x, y| x - y)); 3],
        "LENGTH" => [length(a); 3],
        "SCALE" => a.mapped(|x| x * scale),
        "NORMALIZE" => safe_unit(a),
        "ABSOLUTE" => a.mapped(Interval::abs),
        "POWER" => each(a, b, |base, exponent| base.power_of(release, exponent)),
        "SIGN" => a.mapped(sign),
        "MINIMUM" => each(a, b, Interval::lesser),
        "MAXIMUM" => each(a, b, Interval::greater),
        "ROUND" => a.mapped(|x| (x + Interval::point(0.5)).floor()),
        "FLOOR" => a.mapped(Interval::floor),
        "CEIL" => a.mapped(Interval::ceil),
        "FRACTION" => a.mapped(Interval::fraction),
        "MODULO" if release == Release::V4_5 => each(a, b, modulo),
        "MODULO" => each(a, b, truncated_modulo),
        "WRAP" => arrays::each(|axis| wrap(a[axis], b[axis], c[axis])),
        "SNAP" => each(a, b, snap),
        "SINE" => a.mapped(Interval::sin),
        "COSINE" => a.mapped(Interval::cos),
        "TANGENT" => a.mapped(Interval::tan),
        other => unreachable!("{other} is not in OPERATIONS"),
    }
}

/// `a - trunc(a/b) b`, not the exact remainder: an overflowing quotient spoils it.
fn truncated_modulo(a: Interval, b: Interval) -> Interval {
    if b.as_point() == Some(0.0) {
        return Interval::ZERO;
    }
    if b.has_zero() || may_overflow(&[a, b]) || !a.divide(b).is_finite() { Interval::EVERYTHING } else { modulo(a, b) }
}
