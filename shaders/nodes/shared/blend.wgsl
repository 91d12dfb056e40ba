// The blend modes of two colours: a below, b on top, t the factor (linear RGB, any range).
// Source: Blender's blend modes in Cycles' order of operations. Division by a zero component keeps a; dodging and
// burning are limited (1 from above, 0 and 1), exclusion is limited by 0 from below; a colour without saturation has no
// hue to give, a base without saturation takes none.
// Domain: finite f32. Limits: dodge, burn and divide amplify rounding near their poles, where t b = 1, 1 - t + t b = 0
// and b = 0.
#define_import_path cloudparity::blend

#import cloudparity::color_space::{rgb_to_hsv, hsv_to_rgb}

// Written out: the built-in mix leaves the order of operations open.
fn blend_mix(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a + t * (b - a);
}

// Since Blender 5.3 four modes have another order of operations.
fn blend_mix_since_5_3(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a * (1.0 - t) + b * t;
}

fn blend_multiply_since_5_3(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a * ((1.0 - t) + t * b);
}

fn blend_add_since_5_3(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a + t * b;
}

fn blend_subtract_since_5_3(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a - t * b;
}

fn blend_darken(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_mix(a, min(a, b), t);
}

fn blend_lighten(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_mix(a, max(a, b), t);
}

fn blend_multiply(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_mix(a, a * b, t);
}

fn blend_add(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_mix(a, a + b, t);
}

fn blend_subtract(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_mix(a, a - b, t);
}

fn blend_difference(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_mix(a, abs(a - b), t);
}

fn blend_exclusion(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return max(blend_mix(a, (a + b) - (2.0 * a) * b, t), vec3f(0.0));
}

fn blend_screen(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return 1.0 - ((1.0 - t) + t * (1.0 - b)) * (1.0 - a);
}

fn blend_overlay(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let dark = a * ((1.0 - t) + (2.0 * t) * b);
    let light = 1.0 - ((1.0 - t) + (2.0 * t) * (1.0 - b)) * (1.0 - a);
    return select(light, dark, a < vec3f(0.5));
}

fn blend_soft_light(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let screened = 1.0 - (1.0 - b) * (1.0 - a);
    return (1.0 - t) * a + t * (((1.0 - a) * b) * a + a * screened);
}

fn blend_linear_light(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a + t * (2.0 * b + vec3f(-1.0));
}

fn blend_divide(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return select(a, (1.0 - t) * a + (t * a) / b, b != vec3f(0.0));
}

fn blend_dodge(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let divisor = 1.0 - t * b;
    let dodged = select(min(a / divisor, vec3f(1.0)), vec3f(1.0), divisor <= vec3f(0.0));
    return select(dodged, a, a == vec3f(0.0));
}

fn blend_burn(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let divisor = (1.0 - t) + t * b;
    let burnt = clamp(1.0 - (1.0 - a) / divisor, vec3f(0.0), vec3f(1.0));
    return select(burnt, vec3f(0.0), divisor <= vec3f(0.0));
}

fn blend_hue(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let hsv_a = rgb_to_hsv(a);
    let hsv_b = rgb_to_hsv(b);
    return select(a, blend_mix(a, hsv_to_rgb(vec3f(hsv_b.x, hsv_a.y, hsv_a.z)), t), hsv_b.y != 0.0);
}

fn blend_saturation(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let hsv_a = rgb_to_hsv(a);
    let saturation = (1.0 - t) * hsv_a.y + t * rgb_to_hsv(b).y;
    return select(a, hsv_to_rgb(vec3f(hsv_a.x, saturation, hsv_a.z)), hsv_a.y != 0.0);
}

fn blend_color(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let hsv_b = rgb_to_hsv(b);
    return select(a, blend_mix(a, hsv_to_rgb(vec3f(hsv_b.x, hsv_b.y, rgb_to_hsv(a).z)), t), hsv_b.y != 0.0);
}

fn blend_value(a: vec3f, b: vec3f, t: f32) -> vec3f {
    let hsv_a = rgb_to_hsv(a);
    return hsv_to_rgb(vec3f(hsv_a.x, hsv_a.y, (1.0 - t) * hsv_a.z + t * rgb_to_hsv(b).z));
}
