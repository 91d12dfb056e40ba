//! Bounds of the Math node's operations.

use crate::nodes::bounds::Interval;

/// Error of a remainder relative to the dividend: quotient, product and difference round once each,
/// the quotient by 2.5 ulp in WGSL. (The exact remainder of f32 has none.)
const REMAINDER_ERROR: f64 = 1e-6;

/// 1 where `certain`, 0 where `impossible`, else either.
fn truth(certain: bool, impossible: bool) -> Interval {
    match (certain, impossible) {
        (true, _) => Interval::ONE,
        (_, true) => Interval::ZERO,
        _ => Interval::UNIT,
    }
}

/// -1, 0 or 1; anything that is neither 0 nor negative gives 1.
pub(in crate::nodes) fn sign(a: Interval) -> Interval {
    let of = |x: f32| if x > 0.0 { 1.0 } else { f32::from(x == 0.0) - 1.0 };
    Interval::new(of(a.low), if a.may_be_nan { 1.0 } else { of(a.high) })
}

/// The polynomial smooth minimum rises with a and b and falls with a positive k; a negative k gives
/// the plain minimum, and so does a NaN in a or b.
fn smooth_minimum(a: Interval, b: Interval, k: Interval) -> Interval {
    let plain = a.fmin(b);
    if !a.is_finite() || !b.is_finite() || !k.is_finite() {
        let lowest = plain - Interval::new(0.0, k.high.max(0.0)) * Interval::point(0.2);
        let nan = plain.may_be_nan || k.may_be_nan || k.magnitude().is_infinite() || !plain.is_finite();
        return Interval::EVERYTHING.meet(Interval { low: lowest.low, high: plain.high, may_be_nan: nan });
    }
    let value = |a: f64, b: f64, k: f64| {
        if k <= 0.0 {
            return a.min(b);
        }
        let h = (k - (a - b).abs()).max(0.0) / k;
        a.min(b) - h * h * h * k / 6.0
    };
    let ([a0, a1], [b0, b1], [k0, k1]) = (a.ends(), b.ends(), k.ends());
    // Each of the steps rounds relative to its operands.
    let error = 1e-6 * (a.magnitude() + b.magnitude() + k.magnitude());
    Interval::with_error(value(a0, b0, k1), value(a1, b1, k0), error, false)
}

/// Whether a product that is nearly one of these may exceed f32.
pub(in crate::nodes) fn may_overflow(operands: &[Interval]) -> bool {
    operands.iter().any(|operand| !operand.is_finite() || operand.magnitude() > 1e38)
}

/// The quotient's integer part, if it is the same for the whole box and no rounding can change it.
fn whole_quotient(quotient: Interval, integer: impl Fn(f64) -> f64) -> Option<f64> {
    let [low, high] = quotient.ends();
    let whole = integer(low - REMAINDER_ERROR * low.abs());
    (whole == integer(high + REMAINDER_ERROR * high.abs()) && quotient.is_finite()).then_some(whole)
}

/// `a - n b` for a known n, by way of other terms up to `detour`.
fn remainder(a: Interval, b: Interval, whole: f64, detour: f64) -> Interval {
    let ([a0, a1], [b0, b1]) = (a.ends(), b.ends());
    let products = [whole * b0, whole * b1];
    let (low, high) = (a0 - products[0].max(products[1]), a1 - products[0].min(products[1]));
    Interval::with_error(low, high, REMAINDER_ERROR * (a.magnitude() + products[0].abs() + detour), a.may_be_nan)
}

/// Remainder with the sign of a; 0 for b = 0.
pub(in crate::nodes) fn modulo(a: Interval, b: Interval) -> Interval {
    let nan = a.may_be_nan || b.may_be_nan || a.magnitude().is_infinite() || b.magnitude().is_infinite();
    let limit = a.magnitude().min(b.magnitude() * (1.0 + REMAINDER_ERROR));
    let error = REMAINDER_ERROR * a.magnitude();
    let low = if a.low < 0.0 { -limit } else { 0.0 };
    let high = if a.high > 0.0 { limit } else { 0.0 };
    let wide = if error.is_finite() { Interval::with_error(low, high, error, nan) } else { Interval::EVERYTHING };
    if nan || b.has_zero() {
        return wide;
    }
    match whole_quotient(a.divide(b), f64::trunc) {
        Some(whole) => remainder(a, b, whole, 0.0).meet(wide),
        None => wide,
    }
}

/// Between `low` and `high`, whichever way round, plus the error of a floored remainder.
fn between(low: Interval, high: Interval, a: Interval) -> Interval {
    let error = 2.0 * REMAINDER_ERROR * (a.magnitude() + low.magnitude() + high.magnitude());
    let hull = low.hull(high);
    Interval::with_error(hull.ends()[0], hull.ends()[1], error, hull.may_be_nan || a.may_be_nan)
}

/// `a - floor(a/b) b`, with the sign of b; 0 for b = 0.
fn floored_modulo(a: Interval, b: Interval) -> Interval {
    if b.as_point() == Some(0.0) {
        return Interval::ZERO;
    }
    if b.has_zero() || may_overflow(&[a, b]) {
        return Interval::EVERYTHING;
    }
    let quotient = a.divide(b);
    if !quotient.is_finite() {
        return Interval::EVERYTHING;
    }
    let wide = between(Interval::ZERO, b, a);
    whole_quotient(quotient, f64::floor).map_or(wide, |whole| remainder(a, b, whole, 0.0).meet(wide))
}

/// `a` brought into [minimum, maximum); `minimum` for an empty range.
pub(in crate::nodes) fn wrap(a: Interval, maximum: Interval, minimum: Interval) -> Interval {
    if minimum.is_finite() && minimum.as_point().is_some() && minimum.as_point() == maximum.as_point() {
        return minimum;
    }
    let range = maximum - minimum;
    if range.has_zero() || may_overflow(&[a, maximum, minimum]) {
        return Interval::EVERYTHING;
    }
    let quotient = (a - minimum).divide(range);
    if !quotient.is_finite() {
        return Interval::EVERYTHING;
    }
    let wide = between(minimum, maximum, a);
    // The vectors' version subtracts the minimum first and adds it again.
    let detour = minimum.magnitude();
    whole_quotient(quotient, f64::floor).map_or(wide, |whole| remainder(a, range, whole, detour).meet(wide))
}

/// The multiple of b at or below a.
pub(in crate::nodes) fn snap(a: Interval, b: Interval) -> Interval {
    let product = a.safe_divide(b).floor() * b;
    if !product.is_finite() {
        return product;
    }
    // floor(q) b lies within one step of a, and 0 stands for b = 0.
    let ([a0, a1], [b0, b1]) = (a.ends(), b.ends());
    let error = REMAINDER_ERROR * (a.magnitude() + b.magnitude());
    let near = Interval::with_error(a0 - b1.max(0.0), a1 - b0.min(0.0), error, false);
    let near = if b.has_zero() { near.hull(Interval::ZERO) } else { near };
    product.meet(near)
}

/// Triangle wave between 0 and |b|.
fn pingpong(a: Interval, b: Interval) -> Interval {
    if may_overflow(&[a, b]) {
        return Interval { low: 0.0, ..Interval::EVERYTHING };
    }
    let two = Interval::point(2.0);
    let quotient = if b.has_zero() { Interval::EVERYTHING } else { (a - b).divide(b * two) };
    let wave = ((quotient.fraction() * b) * two - b).abs();
    let limit = Interval::with_error(0.0, b.magnitude(), 1e-6 * b.magnitude(), true);
    let wave = wave.meet(Interval { low: 0.0, ..limit });
    if b.has_zero() { wave.hull(Interval::ZERO) } else { wave }
}

/// Bounds of `operation` for the operands' intervals, before the optional clamp.
pub(super) fn operation(operation: &str, inputs: &[Interval]) -> Interval {
    use Interval as I;
    let a = inputs[0];
    // Operations of fewer operands do not read the others.
    let b = inputs.get(1).copied().unwrap_or(a);
    let c = inputs.get(2).copied().unwrap_or(a);
    match operation {
        "ADD" => a + b,
        "SUBTRACT" => a - b,
        "MULTIPLY" => a * b,
        "DIVIDE" => a.safe_divide(b),
        "MULTIPLY_ADD" => a * b + c,
        "POWER" => a.safe_power(b),
        "LOGARITHM" => logarithm(a, b),
        "SQRT" => a.greater(I::ZERO).sqrt(),
        "INVERSE_SQRT" => {
            let positive = I { low: a.low.max(0.0), may_be_nan: false, ..a };
            let value = if a.high > 0.0 { I::ONE.safe_divide(positive.sqrt()) } else { I::ZERO };
            if a.low <= 0.0 || a.may_be_nan { value.hull(I::ZERO) } else { value }
        }
        "ABSOLUTE" => a.abs(),
        "EXPONENT" => a.exp(),
        "MINIMUM" => a.fmin(b),
        "MAXIMUM" => a.fmax(b),
        "LESS_THAN" => truth(a.high < b.low && !a.may_be_nan && !b.may_be_nan, a.low >= b.high),
        "GREATER_THAN" => truth(a.low > b.high && !a.may_be_nan && !b.may_be_nan, a.high <= b.low),
        "SIGN" => sign(a),
        "COMPARE" => {
            let difference = (a - b).abs();
            let tolerance = c.fmax(I::point(f32::EPSILON));
            let certain = difference.high <= tolerance.low && !difference.may_be_nan;
            // Equal infinities have a NaN difference and compare as equal.
            let equal = a.low <= b.high && b.low <= a.high;
            truth(certain, difference.low > tolerance.high && !equal)
        }
        "SMOOTH_MIN" => smooth_minimum(a, b, c),
        "SMOOTH_MAX" => -smooth_minimum(-a, -b, c),
        "ROUND" => (a + I::point(0.5)).floor(),
        "FLOOR" => a.floor(),
        "CEIL" => a.ceil(),
        "TRUNC" => a.trunc(),
        "FRACT" => a.fraction(),
        "MODULO" => modulo(a, b),
        "FLOORED_MODULO" => floored_modulo(a, b),
        "WRAP" => wrap(a, b, c),
        "SNAP" => snap(a, b),
        "PINGPONG" => pingpong(a, b),
        "SINE" => a.sin(),
        "COSINE" => a.cos(),
        "TANGENT" => a.tan(),
        "ARCSINE" => a.clamped(-I::ONE, I::ONE).asin(),
        "ARCCOSINE" => a.clamped(-I::ONE, I::ONE).acos(),
        "ARCTANGENT" => a.atan(),
        "ARCTAN2" => {
            let angle = a.atan2(b);
            if a.has_zero() && b.has_zero() { angle.hull(I::ZERO) } else { angle }
        }
        "SINH" => a.sinh(),
        "COSH" => a.cosh(),
        "TANH" => a.tanh(),
        "RADIANS" => a * I::point(std::f32::consts::PI / 180.0),
        "DEGREES" => a * I::point(180.0 / std::f32::consts::PI),
        other => unreachable!("{other} is not in OPERATIONS"),
    }
}

/// `ln a / ln b`, 0 where either is not positive.
fn logarithm(a: Interval, b: Interval) -> Interval {
    let value = if a.high > 0.0 && b.high > 0.0 { a.ln().safe_divide(b.ln()) } else { Interval::ZERO };
    let value = value.or_nan(a.may_be_nan || b.may_be_nan);
    if a.low <= 0.0 || b.low <= 0.0 { value.hull(Interval::ZERO) } else { value }
}
