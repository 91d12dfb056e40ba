// Elementary functions with stated accuracy, because WGSL promises too little (sin: 2^-11 absolute on [-pi, pi]).
// Source: range reduction in integers (Payne and Hanek for sin, cos, tan; fixed point for exp, pow), then near-minimax
// polynomials fitted for this file. Integers make the reductions independent of fused or reassociated float arithmetic.
// Domain: all finite f32. Accuracy: 5 ulp at most for normal results; measured by the tests of this module.
// Limits: subnormal arguments count as zero and subnormal results may flush; NaN and infinity are not handled.
#define_import_path cloudparity::numeric

const PI: f32 = 3.14159274;
const HALF_PI: f32 = 1.57079637;
const QUARTER_PI: f32 = 0.785398163;
const LN_TWO: f32 = 0.693147182;
const SMALLEST_NORMAL: f32 = 1.1754944e-38;
const LARGEST: f32 = 3.4028235e38;

// ---------------------------------------------------------------------------------------------------------------------
// Conversions and remainders

// C's (int) on x86: the smallest integer where the value does not fit. WGSL would saturate.
fn to_int(x: f32) -> i32 {
    return select(i32(-2147483647 - 1), i32(x), abs(x) < 2147483648.0);
}

fn mix_linear(a: f32, b: f32, t: f32) -> f32 {
    return a + t * (b - a);
}

fn safe_divide(a: f32, b: f32) -> f32 {
    return select(0.0, a / b, b != 0.0);
}

fn safe_divide3(a: vec3f, b: vec3f) -> vec3f {
    return select(vec3f(0.0), a / b, b != vec3f(0.0));
}

// Exponent and integer mantissa of a finite |x| > 0: |x| = mantissa * 2^(exponent - 150), mantissa in [2^23, 2^24).
struct Decomposed {
    mantissa: u32,
    exponent: i32,
}

fn decompose(x: f32) -> Decomposed {
    let bits = bitcast<u32>(x) & 0x7fffffffu;
    let exponent = i32(bits >> 23u);
    let mantissa = bits & 0x7fffffu;
    if exponent == 0 {
        let shift = countLeadingZeros(mantissa) - 8u;
        return Decomposed(mantissa << (shift & 31u), 1 - i32(shift));
    }
    return Decomposed(mantissa | 0x800000u, exponent);
}

// 2^e for e in [-126, 127].
fn power_of_two(e: i32) -> f32 {
    return bitcast<f32>(u32(e + 127) << 23u);
}

// The exact remainder with the sign of a (C's fmod) for b != 0: long division of the mantissas, eight bits a step.
// a / b < 2^277, hence the bound of the loop.
fn fmod(a: f32, b: f32) -> f32 {
    let bits_a = bitcast<u32>(a) & 0x7fffffffu;
    let bits_b = bitcast<u32>(b) & 0x7fffffffu;
    if bits_a < bits_b {
        return a;
    }
    let top = decompose(a);
    let bottom = decompose(b);
    let divisor = max(bottom.mantissa, 1u);
    var rest = top.mantissa % divisor;
    var left = top.exponent - bottom.exponent;
    for (var digit = 0; digit < 36; digit++) {
        if left <= 0 {
            break;
        }
        let shift = min(left, 8);
        rest = (rest << u32(shift)) % divisor;
        left -= shift;
    }
    // rest * 2^(exponent - 150); rest < 2^24, so that every step is exact.
    let shift = countLeadingZeros(rest) - 8u;
    let exponent = bottom.exponent - i32(shift);
    var bits = 0u;
    if rest != 0u {
        if exponent > 0 {
            bits = ((rest << (shift & 31u)) & 0x7fffffu) | (u32(exponent) << 23u);
        } else {
            // Subnormal: in units of 2^-149.
            bits = (rest << u32(max(bottom.exponent - 1, 0))) >> u32(max(1 - bottom.exponent, 0));
        }
    }
    return bitcast<f32>(bits | (bitcast<u32>(a) & 0x80000000u));
}

// ---------------------------------------------------------------------------------------------------------------------
// 64-bit integers as (high, low)

fn multiply_wide(a: u32, b: u32) -> vec2u {
    let a_low = a & 0xffffu;
    let a_high = a >> 16u;
    let b_low = b & 0xffffu;
    let b_high = b >> 16u;
    let low = a_low * b_low;
    // Neither sum overflows: 65535 * 65535 + 2 * 65535 = 2^32 - 1.
    let middle = a_high * b_low + (low >> 16u);
    let other = a_low * b_high + (middle & 0xffffu);
    return vec2u(a_high * b_high + (middle >> 16u) + (other >> 16u), (other << 16u) | (low & 0xffffu));
}

fn add_wide(a: vec2u, b: vec2u) -> vec2u {
    let low = a.y + b.y;
    return vec2u(a.x + b.x + select(0u, 1u, low < a.y), low);
}

fn negate_wide(a: vec2u) -> vec2u {
    return add_wide(~a, vec2u(0u, 1u));
}

fn shift_right_wide(a: vec2u, shift: u32) -> vec2u {
    let s = shift & 31u;
    // The extra shift by one keeps s = 0 legal.
    let low = (a.y >> s) | ((a.x << 1u) << (31u - s));
    let near = vec2u(a.x >> s, low);
    let far = vec2u(0u, a.x >> s);
    return select(select(near, far, shift >= 32u), vec2u(0u), shift >= 64u);
}

// ---------------------------------------------------------------------------------------------------------------------
// Exponentials and powers

// 2^(+-(fixed.x + fixed.y * 2^-32) + offset).
fn exp2_fixed(fixed: vec2u, negative: bool, offset: i32) -> f32 {
    let bounded = select(fixed, vec2u(200u, 0u), fixed.x > 200u);
    let y = select(bounded, negate_wide(bounded), negative);
    // Round to the nearest integer: the fraction, read as signed, lies in [-1/2, 1/2).
    let n = bitcast<i32>(y.x) + i32(y.y >> 31u) + offset;
    let f = f32(bitcast<i32>(y.y)) * 2.3283064365386963e-10;
    let p = 0.693147182 + f * (0.240226507 + f * (0.0555041097 + f * (0.00961803645 + f * (0.0013333431
        + f * (0.000154671361 + f * 0.0000153149722)))));
    // Two factors, since 2^n alone may leave the range where the product does not.
    let half = n >> 1u;
    return ((1.0 + f * p) * power_of_two(half)) * power_of_two(n - half);
}

// |x| * log2(e) in 32.32 fixed point, cut off where the exponential is 0 or infinite anyway.
fn scaled_by_log2_e(x: f32) -> vec2u {
    let bits = bitcast<u32>(x) & 0x7fffffffu;
    let exponent = i32(bits >> 23u);
    let product = multiply_wide(select(0u, (bits & 0x7fffffu) | 0x800000u, exponent > 0), 0xb8aa3b29u);
    return select(shift_right_wide(product, u32(max(149 - exponent, 0))), vec2u(201u, 0u), exponent > 133);
}

// e^x * 2^offset.
fn exp_scaled(x: f32, offset: i32) -> f32 {
    return exp2_fixed(scaled_by_log2_e(x), x < 0.0, offset);
}

fn exp_of(x: f32) -> f32 {
    return exp_scaled(x, 0);
}

// ln x for x > 0.
fn log_of(x: f32) -> f32 {
    // x = m * 2^e with m in [sqrt(1/2), sqrt(2)).
    let bits = bitcast<u32>(max(x, SMALLEST_NORMAL));
    let e = i32((bits + 0x4afb0du) >> 23u) - 127;
    let f = bitcast<f32>(bits - (u32(e) << 23u)) - 1.0;
    let p = 0.333333105 + f * (-0.250000089 + f * (0.200021669 + f * (-0.166680902 + f * (0.142185524
        + f * (-0.124030866 + f * (0.11893525 + f * (-0.116943248 + f * 0.0675753057)))))));
    let series = f * f * (f * p - 0.5);
    return f32(e) * LN_TWO + (f + series);
}

// log2 |x| in signed 8.56 fixed point for normal x: relative accuracy 2^-29 also next to 1, as pow needs.
fn log2_fixed(x: f32) -> vec2u {
    let bits = bitcast<u32>(x) & 0x7fffffffu;
    let e = i32((bits + 0x4afb0du) >> 23u) - 127;
    // m in [sqrt(1/2), sqrt(2)) in units of 2^-24.
    let upper = (bits & 0x7fffffu) | 0x800000u;
    let m = i32(select(upper, upper << 1u, e == i32(bits >> 23u) - 127));
    // s = (m - 1) / (m + 1) = quotient * 2^-28 + rest, the rest from an exact integer remainder.
    let numerator = m - 0x1000000;
    let denominator = m + 0x1000000;
    let inverse = 1.0 / f32(denominator);
    let s = f32(numerator) * inverse;
    let quotient = i32(round(s * 268435456.0));
    let remainder = (numerator << 28u) - quotient * denominator;
    let rest = f32(remainder) * inverse * 3.7252903e-9;
    // log2 m = (2 / ln 2) (s + s^3 / 3 + s^5 / 5 + ...)
    let linear = shift_right_wide(multiply_wide(u32(abs(quotient)), 3098164009u), 2u);
    var sum = select(linear, negate_wide(linear), quotient < 0);
    let u = s * s;
    let small = 2.88539004 * rest + s * u * (0.961796701 + u * (0.577082932 + u * (0.411701292 + u * 0.340321749)));
    // The float tail, |small| < 2^-5, shifted into place.
    let tail_bits = bitcast<u32>(small) & 0x7fffffffu;
    let tail_exponent = i32(tail_bits >> 23u) - 94;
    let tail_mantissa = select(0u, (tail_bits & 0x7fffffu) | 0x800000u, tail_exponent > -94);
    let up = u32(clamp(tail_exponent, 0, 31));
    let down = u32(clamp(-tail_exponent, 0, 31));
    let tail = vec2u((tail_mantissa >> 1u) >> (31u - up), (tail_mantissa << up) >> down);
    sum = add_wide(sum, select(tail, negate_wide(tail), small < 0.0));
    return vec2u(sum.x + (bitcast<u32>(e) << 24u), sum.y);
}

// |a|^b for a != 0.
fn pow_magnitude(a: f32, b: f32) -> f32 {
    let logarithm = log2_fixed(a);
    let below_one = (logarithm.x >> 31u) == 1u;
    let magnitude = select(logarithm, negate_wide(logarithm), below_one);
    // |log2 a| = top * 2^(-24 - zeros), top in [2^31, 2^32).
    let zeros = select(countLeadingZeros(magnitude.x), 32u + countLeadingZeros(magnitude.y), magnitude.x == 0u);
    let s = zeros & 31u;
    let near = (magnitude.x << s) | ((magnitude.y >> 1u) >> (31u - s));
    let top = select(near, magnitude.y << s, zeros >= 32u);
    let bits = bitcast<u32>(b) & 0x7fffffffu;
    let exponent = i32(bits >> 23u);
    let product = multiply_wide(top, (bits & 0x7fffffu) | 0x800000u);
    let shift = 142 + i32(zeros) - exponent;
    var fixed = select(shift_right_wide(product, u32(max(shift, 0))), vec2u(201u, 0u), shift < 15);
    fixed = select(fixed, vec2u(0u), (magnitude.x | magnitude.y) == 0u);
    return exp2_fixed(fixed, below_one != (b < 0.0), 0);
}

// Power with Blender's special cases: 0^0 = 1, 0^b = 0, a negative base needs an integral exponent, else 0.
fn safe_pow(a: f32, b: f32) -> f32 {
    let whole = to_int(b);
    if a < 0.0 && b != f32(whole) {
        return 0.0;
    }
    if b == 0.0 {
        return 1.0;
    }
    if abs(a) < SMALLEST_NORMAL {
        return 0.0;
    }
    let magnitude = pow_magnitude(a, b);
    return select(magnitude, -magnitude, a < 0.0 && (whole & 1) != 0);
}

// safe_pow since Blender 5.1: exponents beyond 2^31 are whole numbers, too, even ones.
fn safe_pow_since_5_1(a: f32, b: f32) -> f32 {
    return safe_pow(select(a, abs(a), abs(b) >= 2147483648.0), b);
}

// safe_pow up to Blender 4.5: negative powers of 0 are infinite.
fn safe_pow_before_5(a: f32, b: f32) -> f32 {
    if b < 0.0 && abs(a) < SMALLEST_NORMAL {
        return exp_of(LARGEST);
    }
    return safe_pow(a, b);
}

fn safe_pow3(a: vec3f, b: vec3f) -> vec3f {
    return vec3f(safe_pow(a.x, b.x), safe_pow(a.y, b.y), safe_pow(a.z, b.z));
}

fn sinh_of(x: f32) -> f32 {
    let u = x * x;
    let near = x + x * u * (0.166666672 + u * (0.0083333496 + u * (0.000198361595 + u * 0.00000281695134)));
    // e^x / 2, since e^x overflows before sinh does.
    let a = abs(x);
    let far = exp_scaled(a, -1) - exp_scaled(-a, -1);
    return select(near, select(far, -far, x < 0.0), a > 1.0);
}

fn cosh_of(x: f32) -> f32 {
    return exp_scaled(x, -1) + exp_scaled(-x, -1);
}

fn tanh_of(x: f32) -> f32 {
    let a = abs(x);
    let u = x * x;
    let near = x + x * u * (-0.333333313 + u * (0.13333191 + u * (-0.0539448895 + u * (0.0216901526
        + u * (-0.00815069396 + u * 0.0021180152)))));
    let far = 1.0 - 2.0 / (exp_of(2.0 * min(a, 10.0)) + 1.0);
    return select(near, select(far, -far, x < 0.0), a > 0.625);
}

// ---------------------------------------------------------------------------------------------------------------------
// Trigonometry

// The 128 bits of 2/pi that start 32 * index bits after a leading word of zeros.
fn two_over_pi(index: u32) -> vec4u {
    switch index {
        case 0u: {
            return vec4u(0u, 0xa2f9836eu, 0x4e441529u, 0xfc2757d1u);
        }
        case 1u: {
            return vec4u(0xa2f9836eu, 0x4e441529u, 0xfc2757d1u, 0xf534ddc0u);
        }
        case 2u: {
            return vec4u(0x4e441529u, 0xfc2757d1u, 0xf534ddc0u, 0xdb629599u);
        }
        case 3u: {
            return vec4u(0xfc2757d1u, 0xf534ddc0u, 0xdb629599u, 0x3c439041u);
        }
        default: {
            return vec4u(0xf534ddc0u, 0xdb629599u, 0x3c439041u, 0xfe5163abu);
        }
    }
}

// x = quadrant * pi/2 + angle, |angle| <= pi/4, the quadrant modulo 4.
struct Reduced {
    angle: f32,
    quadrant: u32,
}

// Payne and Hanek: multiply the mantissa with just those bits of 2/pi that matter modulo 4, exactly, in integers.
fn reduce_angle(x: f32) -> Reduced {
    let a = abs(x);
    if a <= QUARTER_PI {
        return Reduced(x, 0u);
    }
    let bits = bitcast<u32>(a);
    let mantissa = (bits & 0x7fffffu) | 0x800000u;
    // Bits above the weight 2 contribute multiples of 4: the window opens at the weight 2.
    let position = (bits >> 23u) - 120u;
    let words = two_over_pi(position >> 5u);
    let s = position & 31u;
    let high = (words.x << s) | ((words.y >> 1u) >> (31u - s));
    let middle = (words.y << s) | ((words.z >> 1u) >> (31u - s));
    let low = (words.z << s) | ((words.w >> 1u) >> (31u - s));
    var product = multiply_wide(mantissa, middle);
    product = add_wide(product, vec2u(0u, multiply_wide(mantissa, low).x));
    product.x += mantissa * high;
    // Two bits of quadrant, 62 of fraction; to the nearest multiple of pi/2.
    var quadrant = product.x >> 30u;
    var fraction = vec2u(product.x << 2u | product.y >> 30u, product.y << 2u);
    var negative = x < 0.0;
    if (fraction.x >> 31u) == 1u {
        quadrant += 1u;
        fraction = negate_wide(fraction);
        negative = !negative;
    }
    if x < 0.0 {
        quadrant = 4u - quadrant;
    }
    let zeros = countLeadingZeros(fraction.x);
    let z = min(zeros, 31u);
    let top = (fraction.x << z) | ((fraction.y >> 1u) >> (31u - z));
    // 24 leading bits convert exactly; the next eight follow, so that the angle is good to one rounding.
    let scale = power_of_two(-i32(z) - 32) * HALF_PI;
    let angle = f32(top >> 8u) * 256.0 * scale + f32(top & 255u) * scale;
    return Reduced(select(angle, -angle, negative), quadrant & 3u);
}

fn sin_polynomial(r: f32) -> f32 {
    let u = r * r;
    return r + r * u * (-0.166666672 + u * (0.00833332911 + u * (-0.000198392721 + u * 0.00000271774593)));
}

fn cos_polynomial(r: f32) -> f32 {
    let u = r * r;
    return 1.0 - u * (0.5 - u * (0.0416666679 + u * (-0.00138888834 + u * (0.0000247994176 - u * 2.72022078e-7))));
}

fn sin_of(x: f32) -> f32 {
    let reduced = reduce_angle(x);
    let value = select(sin_polynomial(reduced.angle), cos_polynomial(reduced.angle), (reduced.quadrant & 1u) == 1u);
    return select(value, -value, reduced.quadrant >= 2u);
}

fn cos_of(x: f32) -> f32 {
    let reduced = reduce_angle(x);
    let value = select(cos_polynomial(reduced.angle), sin_polynomial(reduced.angle), (reduced.quadrant & 1u) == 1u);
    return select(value, -value, ((reduced.quadrant + 1u) & 2u) == 2u);
}

fn tan_of(x: f32) -> f32 {
    let reduced = reduce_angle(x);
    let s = sin_polynomial(reduced.angle);
    let c = cos_polynomial(reduced.angle);
    return select(s / c, -c / s, (reduced.quadrant & 1u) == 1u);
}

fn sin3(v: vec3f) -> vec3f {
    return vec3f(sin_of(v.x), sin_of(v.y), sin_of(v.z));
}

fn cos3(v: vec3f) -> vec3f {
    return vec3f(cos_of(v.x), cos_of(v.y), cos_of(v.z));
}

fn tan3(v: vec3f) -> vec3f {
    return vec3f(tan_of(v.x), tan_of(v.y), tan_of(v.z));
}

// asin on [-1/2, 1/2].
fn asin_polynomial(x: f32) -> f32 {
    let u = x * x;
    return x + x * u * (0.166666597 + u * (0.0750050694 + u * (0.0445164628 + u * (0.0318121016
        + u * (0.014421097 + u * 0.0375422724)))));
}

// For |x| <= 1.
fn asin_of(x: f32) -> f32 {
    let a = abs(x);
    let outer = HALF_PI - 2.0 * asin_polynomial(sqrt(max(0.5 - 0.5 * a, 0.0)));
    return select(asin_polynomial(x), select(outer, -outer, x < 0.0), a > 0.5);
}

fn acos_of(x: f32) -> f32 {
    let a = abs(x);
    let outer = 2.0 * asin_polynomial(sqrt(max(0.5 - 0.5 * a, 0.0)));
    return select(HALF_PI - asin_polynomial(x), select(outer, PI - outer, x < 0.0), a > 0.5);
}

// atan on [0, 1].
fn atan_unit(x: f32) -> f32 {
    let upper = x > 0.414213562;
    let t = select(x, (x - 1.0) / (x + 1.0), upper);
    let u = t * t;
    let p = t + t * u * (-0.333333135 + u * (0.199984163 + u * (-0.142424151 + u * (0.105851188 - u * 0.0605521426))));
    return select(p, QUARTER_PI + p, upper);
}

fn atan_of(x: f32) -> f32 {
    let a = abs(x);
    let inner = atan_unit(select(a, 1.0 / a, a > 1.0));
    let value = select(inner, HALF_PI - inner, a > 1.0);
    return select(value, -value, x < 0.0);
}

// atan2(y, x); 0 for two zeros.
fn atan2_of(y: f32, x: f32) -> f32 {
    if y == 0.0 && x == 0.0 {
        return 0.0;
    }
    let a = abs(y);
    let b = abs(x);
    let larger = max(a, b);
    // Scaled, because WGSL divides accurately only by divisors up to 2^126.
    let scale = select(1.0, 0.0625, larger > 1.0e37);
    let inner = atan_unit((min(a, b) * scale) / (larger * scale));
    let first = select(inner, HALF_PI - inner, a > b);
    let value = select(first, PI - first, x < 0.0);
    return select(value, -value, y < 0.0);
}
