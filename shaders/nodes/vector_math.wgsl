// Vector Math node (ShaderNodeVectorMath): one operation per instance, named by the def OPERATION_<NAME>.
// Source: Blender's operation list; a = Vector, b = Vector_001, c = Vector_002, s = Scale, those that the operation
// has, in this order. DOT_PRODUCT, DISTANCE and LENGTH give a float, all others a vector.
// Divisions and remainders by zero give 0; the direction of a zero vector is the zero vector.
// Domain: finite f32. Limits: squares overflow for components above 1.8e19. MODULO is not the exact remainder of the
// Math node, and WRAP has another form than there; both as in Blender.
#import cloudparity::numeric
#import cloudparity::numeric::{safe_divide3, safe_pow3, sin3, cos3, tan3}

// Sums in Blender's order; the built-in leaves the order open.
fn dot_ordered(a: vec3f, b: vec3f) -> f32 {
    return (a.x * b.x + a.y * b.y) + a.z * b.z;
}

fn length_ordered(v: vec3f) -> f32 {
    return sqrt(dot_ordered(v, v));
}

fn safe_unit(v: vec3f) -> vec3f {
    let l = length_ordered(v);
    return select(v, v * (1.0 / l), l != 0.0);
}

#ifdef OPERATION_ADD
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return a + b;
}
#else ifdef OPERATION_SUBTRACT
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return a - b;
}
#else ifdef OPERATION_MULTIPLY
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return a * b;
}
#else ifdef OPERATION_DIVIDE
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return safe_divide3(a, b);
}
#else ifdef OPERATION_MULTIPLY_ADD
fn evaluate(a: vec3f, b: vec3f, c: vec3f) -> vec3f {
    return a * b + c;
}
#else ifdef OPERATION_CROSS_PRODUCT
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return vec3f(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
#else ifdef OPERATION_PROJECT
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    let q = dot_ordered(b, b);
    return select(vec3f(0.0), (dot_ordered(a, b) / q) * b, q != 0.0);
}
#else ifdef OPERATION_REFLECT
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    let n = safe_unit(b);
    return a - (2.0 * n) * dot_ordered(a, n);
}
#else ifdef OPERATION_REFRACT
fn evaluate(a: vec3f, b: vec3f, s: f32) -> vec3f {
    let n = safe_unit(b);
    let d = dot_ordered(n, a);
    let k = 1.0 - (s * s) * (1.0 - d * d);
    // Total reflection: no refracted direction.
    if k < 0.0 {
        return vec3f(0.0);
    }
    return s * a - (s * d + sqrt(k)) * n;
}
#else ifdef OPERATION_FACEFORWARD
fn evaluate(a: vec3f, b: vec3f, c: vec3f) -> vec3f {
    return select(-a, a, dot_ordered(c, b) < 0.0);
}
#else ifdef OPERATION_DOT_PRODUCT
fn evaluate(a: vec3f, b: vec3f) -> f32 {
    return dot_ordered(a, b);
}
#else ifdef OPERATION_DISTANCE
fn evaluate(a: vec3f, b: vec3f) -> f32 {
    return length_ordered(a - b);
}
#else ifdef OPERATION_LENGTH
fn evaluate(a: vec3f) -> f32 {
    return length_ordered(a);
}
#else ifdef OPERATION_SCALE
fn evaluate(a: vec3f, s: f32) -> vec3f {
    return a * s;
}
#else ifdef OPERATION_NORMALIZE
fn evaluate(a: vec3f) -> vec3f {
    return safe_unit(a);
}
#else ifdef OPERATION_ABSOLUTE
fn evaluate(a: vec3f) -> vec3f {
    return abs(a);
}
#else ifdef OPERATION_POWER
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
#ifdef BEFORE_BLENDER_5
    return vec3f(
        numeric::safe_pow_before_5(a.x, b.x),
        numeric::safe_pow_before_5(a.y, b.y),
        numeric::safe_pow_before_5(a.z, b.z)
    );
#else ifdef SINCE_BLENDER_5_1
    return vec3f(
        numeric::safe_pow_since_5_1(a.x, b.x),
        numeric::safe_pow_since_5_1(a.y, b.y),
        numeric::safe_pow_since_5_1(a.z, b.z)
    );
#else
    return safe_pow3(a, b);
#endif
}
#else ifdef OPERATION_SIGN
fn evaluate(a: vec3f) -> vec3f {
    return sign(a);
}
#else ifdef OPERATION_MINIMUM
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return min(a, b);
}
#else ifdef OPERATION_MAXIMUM
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return max(a, b);
}
#else ifdef OPERATION_ROUND
fn evaluate(a: vec3f) -> vec3f {
    return floor(a + vec3f(0.5));
}
#else ifdef OPERATION_FLOOR
fn evaluate(a: vec3f) -> vec3f {
    return floor(a);
}
#else ifdef OPERATION_CEIL
fn evaluate(a: vec3f) -> vec3f {
    return ceil(a);
}
#else ifdef OPERATION_FRACTION
fn evaluate(a: vec3f) -> vec3f {
    return a - floor(a);
}
#else ifdef OPERATION_MODULO
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
#ifdef BEFORE_BLENDER_5
    let rest = vec3f(numeric::fmod(a.x, b.x), numeric::fmod(a.y, b.y), numeric::fmod(a.z, b.z));
    return select(vec3f(0.0), rest, b != vec3f(0.0));
#else
    return select(vec3f(0.0), a - trunc(a / b) * b, b != vec3f(0.0));
#endif
}
#else ifdef OPERATION_WRAP
// b is the maximum, c the minimum.
fn evaluate(a: vec3f, b: vec3f, c: vec3f) -> vec3f {
    let v = a - c;
    let range = b - c;
#ifdef BEFORE_BLENDER_5
    return select(c, a - range * floor(v / range), range != vec3f(0.0));
#else
    return select(c, (v - floor(v / range) * range) + c, range != vec3f(0.0));
#endif
}
#else ifdef OPERATION_SNAP
fn evaluate(a: vec3f, b: vec3f) -> vec3f {
    return floor(safe_divide3(a, b)) * b;
}
#else ifdef OPERATION_SINE
fn evaluate(a: vec3f) -> vec3f {
    return sin3(a);
}
#else ifdef OPERATION_COSINE
fn evaluate(a: vec3f) -> vec3f {
    return cos3(a);
}
#else ifdef OPERATION_TANGENT
fn evaluate(a: vec3f) -> vec3f {
    return tan3(a);
}
#endif
