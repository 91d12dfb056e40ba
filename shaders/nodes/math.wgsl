// Math node (ShaderNodeMath), scalar: one operation per instance, named by the def OPERATION_<NAME>; USE_CLAMP limits
// the result to [0, 1]; BEFORE_BLENDER_5 makes negative powers of 0 infinite, as in Blender 4.5.
// Source: Blender's operation list; a = Value, b = Value_001, c = Value_002, as many as the operation has.
// Divisions by zero, roots and logarithms of what has none and remainders by zero give 0, not NaN.
// Domain: finite f32. Limits: +, -, * and comparisons follow the device's f32; see numeric for the functions.
#import cloudparity::numeric
#import cloudparity::numeric::{safe_divide, safe_pow}

const EPSILON: f32 = 1.1920929e-7;

#ifdef OPERATION_ADD
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(a + b);
}
#else ifdef OPERATION_SUBTRACT
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(a - b);
}
#else ifdef OPERATION_MULTIPLY
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(a * b);
}
#else ifdef OPERATION_DIVIDE
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(safe_divide(a, b));
}
#else ifdef OPERATION_MULTIPLY_ADD
fn evaluate(a: f32, b: f32, c: f32) -> f32 {
    return finish(a * b + c);
}
#else ifdef OPERATION_POWER
fn evaluate(a: f32, b: f32) -> f32 {
#ifdef BEFORE_BLENDER_5
    return finish(numeric::safe_pow_before_5(a, b));
#else ifdef SINCE_BLENDER_5_1
    return finish(numeric::safe_pow_since_5_1(a, b));
#else
    return finish(safe_pow(a, b));
#endif
}
#else ifdef OPERATION_LOGARITHM
fn evaluate(a: f32, b: f32) -> f32 {
    if a <= 0.0 || b <= 0.0 {
        return 0.0;
    }
    return finish(safe_divide(numeric::log_of(a), numeric::log_of(b)));
}
#else ifdef OPERATION_SQRT
fn evaluate(a: f32) -> f32 {
    return finish(sqrt(max(a, 0.0)));
}
#else ifdef OPERATION_INVERSE_SQRT
fn evaluate(a: f32) -> f32 {
    return finish(select(0.0, 1.0 / sqrt(a), a > 0.0));
}
#else ifdef OPERATION_ABSOLUTE
fn evaluate(a: f32) -> f32 {
    return finish(abs(a));
}
#else ifdef OPERATION_EXPONENT
fn evaluate(a: f32) -> f32 {
    return finish(numeric::exp_of(a));
}
#else ifdef OPERATION_MINIMUM
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(min(a, b));
}
#else ifdef OPERATION_MAXIMUM
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(max(a, b));
}
#else ifdef OPERATION_LESS_THAN
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(select(0.0, 1.0, a < b));
}
#else ifdef OPERATION_GREATER_THAN
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(select(0.0, 1.0, a > b));
}
#else ifdef OPERATION_SIGN
fn evaluate(a: f32) -> f32 {
    return finish(sign(a));
}
#else ifdef OPERATION_COMPARE
fn evaluate(a: f32, b: f32, c: f32) -> f32 {
    return finish(select(0.0, 1.0, a == b || abs(a - b) <= max(c, EPSILON)));
}
#else ifdef OPERATION_SMOOTH_MIN
fn evaluate(a: f32, b: f32, c: f32) -> f32 {
    return finish(smooth_min(a, b, c));
}
#else ifdef OPERATION_SMOOTH_MAX
fn evaluate(a: f32, b: f32, c: f32) -> f32 {
    return finish(-smooth_min(-a, -b, c));
}
#else ifdef OPERATION_ROUND
// Halves go up.
fn evaluate(a: f32) -> f32 {
    return finish(floor(a + 0.5));
}
#else ifdef OPERATION_FLOOR
fn evaluate(a: f32) -> f32 {
    return finish(floor(a));
}
#else ifdef OPERATION_CEIL
fn evaluate(a: f32) -> f32 {
    return finish(ceil(a));
}
#else ifdef OPERATION_TRUNC
fn evaluate(a: f32) -> f32 {
    return finish(trunc(a));
}
#else ifdef OPERATION_FRACT
fn evaluate(a: f32) -> f32 {
    return finish(a - floor(a));
}
#else ifdef OPERATION_MODULO
fn evaluate(a: f32, b: f32) -> f32 {
    if b == 0.0 {
        return 0.0;
    }
    return finish(numeric::fmod(a, b));
}
#else ifdef OPERATION_FLOORED_MODULO
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(select(0.0, a - floor(a / b) * b, b != 0.0));
}
#else ifdef OPERATION_WRAP
// b is the maximum, c the minimum.
fn evaluate(a: f32, b: f32, c: f32) -> f32 {
    let range = b - c;
    return finish(select(c, a - range * floor((a - c) / range), range != 0.0));
}
#else ifdef OPERATION_SNAP
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(floor(safe_divide(a, b)) * b);
}
#else ifdef OPERATION_PINGPONG
fn evaluate(a: f32, b: f32) -> f32 {
    let t = (a - b) / (b * 2.0);
    return finish(select(0.0, abs(((t - floor(t)) * b) * 2.0 - b), b != 0.0));
}
#else ifdef OPERATION_SINE
fn evaluate(a: f32) -> f32 {
    return finish(numeric::sin_of(a));
}
#else ifdef OPERATION_COSINE
fn evaluate(a: f32) -> f32 {
    return finish(numeric::cos_of(a));
}
#else ifdef OPERATION_TANGENT
fn evaluate(a: f32) -> f32 {
    return finish(numeric::tan_of(a));
}
#else ifdef OPERATION_ARCSINE
fn evaluate(a: f32) -> f32 {
    return finish(numeric::asin_of(clamp(a, -1.0, 1.0)));
}
#else ifdef OPERATION_ARCCOSINE
fn evaluate(a: f32) -> f32 {
    return finish(numeric::acos_of(clamp(a, -1.0, 1.0)));
}
#else ifdef OPERATION_ARCTANGENT
fn evaluate(a: f32) -> f32 {
    return finish(numeric::atan_of(a));
}
#else ifdef OPERATION_ARCTAN2
fn evaluate(a: f32, b: f32) -> f32 {
    return finish(numeric::atan2_of(a, b));
}
#else ifdef OPERATION_SINH
fn evaluate(a: f32) -> f32 {
    return finish(numeric::sinh_of(a));
}
#else ifdef OPERATION_COSH
fn evaluate(a: f32) -> f32 {
    return finish(numeric::cosh_of(a));
}
#else ifdef OPERATION_TANH
fn evaluate(a: f32) -> f32 {
    return finish(numeric::tanh_of(a));
}
#else ifdef OPERATION_RADIANS
fn evaluate(a: f32) -> f32 {
    return finish(a * 0.0174532924);
}
#else ifdef OPERATION_DEGREES
fn evaluate(a: f32) -> f32 {
    return finish(a * 57.2957764);
}
#endif

// A cubic blend of width c around a = b; a negative width gives the minimum.
fn smooth_min(a: f32, b: f32, c: f32) -> f32 {
    if c == 0.0 {
        return min(a, b);
    }
    let h = max(c - abs(a - b), 0.0) / c;
    // Not negative: the maximum only keeps compilers from multiplying the constants first, which rounds otherwise.
    let cubic = max(((h * h) * h) * c, 0.0);
    return min(a, b) - cubic * 0.166666672;
}

fn finish(x: f32) -> f32 {
#ifdef USE_CLAMP
    return clamp(x, 0.0, 1.0);
#else
    return x;
#endif
}
