// Quotients and square roots that are rounded to the nearest, whatever the adapter's own are: WGSL and Vulkan allow 2.5 units in the last place
// for a quotient and some more for a root. The adapter's are first guesses; integers decide. src/gpu/exact.rs puts these in the place of every
// quotient and root of a kernel.
// Source: remainders of long division and of the square root by digits, IEEE 754-2019 5.4.1 and 4.3.1.
#define_import_path cloudparity::exact

const HIDDEN: u32 = 0x800000u;
const FRACTION: u32 = 0x7fffffu;
const INFINITE: u32 = 0x7f800000u;
const SIGN: u32 = 0x80000000u;
const ONE: u32 = 0x3f800000u;
const SCALE: f32 = 8388608.0;

// Units in the last place that a first guess may be off, with room to spare.
const GUESS: u32 = 16u;

// A number above 0 as significand (24 bits, the highest one set) and biased exponent, which is below 1 for what is denormal.
struct Parts {
    significand: u32,
    exponent: i32,
}

fn parts_of(magnitude: u32) -> Parts {
    let exponent = magnitude >> 23u;
    let fraction = magnitude & FRACTION;
    if exponent == 0u {
        let shift = countLeadingZeros(fraction) - 8u;
        return Parts(fraction << shift, 1 - i32(shift));
    }
    return Parts(fraction | HIDDEN, i32(exponent));
}

fn divide(a: f32, b: f32) -> f32 {
    let sign = (bitcast<u32>(a) ^ bitcast<u32>(b)) & SIGN;
    let dividend = bitcast<u32>(a) & ~SIGN;
    let divisor = bitcast<u32>(b) & ~SIGN;
    // Zeros, infinities and what is no number round nothing.
    if dividend == 0u || divisor == 0u || dividend >= INFINITE || divisor >= INFINITE { return a / b; }
    let over = parts_of(dividend);
    let under = parts_of(divisor);
    var significand = over.significand;
    var exponent = over.exponent - under.exponent + 127;
    // So that the quotient is from 1 to below 2.
    if significand < under.significand {
        significand <<= 1u;
        exponent -= 1;
    }
    // 24 bits of it, and what is left; what is above 32 bits cancels.
    var quotient = u32(f32(significand) / f32(under.significand) * SCALE);
    var left = bitcast<i32>((significand << 23u) - quotient * under.significand);
    let divided = i32(under.significand);
    for (var step = 0u; step < GUESS && left < 0; step++) {
        quotient -= 1u;
        left += divided;
    }
    for (var step = 0u; step < GUESS && left >= divided; step++) {
        quotient += 1u;
        left -= divided;
    }
    if exponent >= 255 { return bitcast<f32>(sign | INFINITE); }
    if exponent >= 1 {
        let twice = 2 * left;
        let is_up = twice > divided || (twice == divided && (quotient & 1u) == 1u);
        return bitcast<f32>(sign | ((u32(exponent) << 23u) + (quotient & FRACTION) + select(0u, 1u, is_up)));
    }
    // Denormal: bits that have no room are rounded away.
    let lost = u32(1 - exponent);
    if lost > 25u { return bitcast<f32>(sign); }
    let kept = quotient >> lost;
    let low = quotient & ((1u << lost) - 1u);
    let half = 1u << (lost - 1u);
    let is_up = low > half || (low == half && (left > 0 || (kept & 1u) == 1u));
    return bitcast<f32>(sign | (kept + select(0u, 1u, is_up)));
}

fn square_root(a: f32) -> f32 {
    let magnitude = bitcast<u32>(a);
    // 0, infinity, what is negative and what is no number.
    if magnitude == 0u || magnitude >= INFINITE { return sqrt(a); }
    let parts = parts_of(magnitude);
    // The significand times 2^23, or 2^24 where that leaves an even exponent: its root has 24 bits.
    let odd = u32(parts.exponent + 1) & 1u;
    let guess = sqrt(bitcast<f32>(ONE | (parts.significand & FRACTION)) * select(1.0, 2.0, odd == 1u));
    var root = u32(guess * SCALE);
    var left = bitcast<i32>((parts.significand << (23u + odd)) - root * root);
    for (var step = 0u; step < GUESS && left < 0; step++) {
        root -= 1u;
        left += bitcast<i32>(2u * root + 1u);
    }
    for (var step = 0u; step < GUESS && left > bitcast<i32>(2u * root); step++) {
        left -= bitcast<i32>(2u * root + 1u);
        root += 1u;
    }
    let exponent = (parts.exponent - 127 - i32(odd)) / 2 + 127;
    return bitcast<f32>((u32(exponent) << 23u) + (root & FRACTION) + select(0u, 1u, left > bitcast<i32>(root)));
}

fn divide2(a: vec2f, b: vec2f) -> vec2f { return vec2f(divide(a.x, b.x), divide(a.y, b.y)); }

fn divide3(a: vec3f, b: vec3f) -> vec3f { return vec3f(divide2(a.xy, b.xy), divide(a.z, b.z)); }

fn divide4(a: vec4f, b: vec4f) -> vec4f { return vec4f(divide2(a.xy, b.xy), divide2(a.zw, b.zw)); }

fn square_root2(a: vec2f) -> vec2f { return vec2f(square_root(a.x), square_root(a.y)); }

fn square_root3(a: vec3f) -> vec3f { return vec3f(square_root2(a.xy), square_root(a.z)); }

fn square_root4(a: vec4f) -> vec4f { return vec4f(square_root2(a.xy), square_root2(a.zw)); }
