// Colour spaces: linear Rec. 709 to and from HSV (hue, saturation, value) and HSL (hue, saturation, lightness).
// Source: Smith, "Color Gamut Transform Pairs" (1978), in Blender's form: hue in turns, nothing clamped, a hue outside
// of [0, 1] in the last of the six sectors. Domain: finite f32.
// Limits: as exact as the device's division. The hue of HSV jumps between 0 and 1 next to red.

fn luminance(color: vec3f) -> f32 {
    return (color.x * 0.21263912 + color.y * 0.71516913) + color.z * 0.07219276;
}

fn rgb_to_hsv(color: vec3f) -> vec3f {
    let value = max(color.x, max(color.y, color.z));
    let chroma = value - min(color.x, min(color.y, color.z));
    if value == 0.0 || chroma == 0.0 {
        return vec3f(0.0, 0.0, value);
    }
    // One division of a difference, not a difference of quotients: equal channels have to give exactly 0.
    let lacks = value - color;
    var sixths = 4.0 + (lacks.y - lacks.x) / chroma;
    if color.x == value {
        sixths = (lacks.z - lacks.y) / chroma;
    } else if color.y == value {
        sixths = 2.0 + (lacks.x - lacks.z) / chroma;
    }
    let hue = sixths * (1.0 / 6.0);
    return vec3f(select(hue, hue + 1.0, hue < 0.0), chroma / value, value);
}

fn hsv_to_rgb(coordinates: vec3f) -> vec3f {
    let saturation = coordinates.y;
    let value = coordinates.z;
    if saturation == 0.0 {
        return vec3f(value);
    }
    let sixths = select(coordinates.x, 0.0, coordinates.x == 1.0) * 6.0;
    let sector = floor(sixths);
    let place = sixths - sector;
    let least = value * (1.0 - saturation);
    let falling = value * (1.0 - saturation * place);
    let rising = value * (1.0 - saturation * (1.0 - place));
    if sector == 0.0 {
        return vec3f(value, rising, least);
    } else if sector == 1.0 {
        return vec3f(falling, value, least);
    } else if sector == 2.0 {
        return vec3f(least, value, rising);
    } else if sector == 3.0 {
        return vec3f(least, falling, value);
    } else if sector == 4.0 {
        return vec3f(rising, least, value);
    }
    return vec3f(value, least, falling);
}

fn rgb_to_hsl(color: vec3f) -> vec3f {
    let largest = max(color.x, max(color.y, color.z));
    let smallest = min(color.x, min(color.y, color.z));
    let lightness = min(1.0, (largest + smallest) * 0.5);
    if largest == smallest {
        return vec3f(0.0, 0.0, lightness);
    }
    let chroma = largest - smallest;
    let saturation = chroma / select(largest + smallest, (2.0 - largest) - smallest, lightness > 0.5);
    var sixths = (color.x - color.y) / chroma + 4.0;
    if largest == color.x {
        sixths = (color.y - color.z) / chroma + select(0.0, 6.0, color.y < color.z);
    } else if largest == color.y {
        sixths = (color.z - color.x) / chroma + 2.0;
    }
    return vec3f(sixths * (1.0 / 6.0), saturation, lightness);
}

fn hsl_to_rgb(coordinates: vec3f) -> vec3f {
    let sixths = coordinates.x * 6.0;
    let lightness = coordinates.z;
    let red = abs(sixths - 3.0) - 1.0;
    let green = 2.0 - abs(sixths - 2.0);
    let blue = 2.0 - abs(sixths - 4.0);
    let chroma = (1.0 - abs(2.0 * lightness - 1.0)) * coordinates.y;
    return (clamp(vec3f(red, green, blue), vec3f(0.0), vec3f(1.0)) - 0.5) * chroma + lightness;
}
// The blend modes of two colours: a below, b on top, t the factor (linear RGB, any range).
// Source: Blender's blend modes in Cycles' order of operations. Division by a zero component keeps a; dodging and
// burning are limited (1 from above, 0 and 1), exclusion is limited by 0 from below; a colour without saturation has no
// hue to give, a base without saturation takes none.
// Domain: finite f32. Limits: dodge, burn and divide amplify rounding near their poles, where t b = 1, 1 - t + t b = 0
// and b = 0.


// Written out: the built-in mix leaves the order of operations open.
fn blend_mix(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return a + t * (b - a);
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
// Mix node of old files (ShaderNodeMixRGB): blends two colours by BLEND_TYPE_<NAME>, the factor limited to [0, 1].
// USE_CLAMP limits the components of the result; USE_ALPHA has no effect.
// Source: Blender; the modes' formulas and their limits are those of the module blend. Domain: finite f32.

fn blended(a: vec3f, b: vec3f, t: f32) -> vec3f {
    return blend_value(a, b, t);
}

fn evaluate(factor: f32, a: vec3f, b: vec3f) -> vec3f {
    let t = clamp(factor, 0.0, 1.0);
    return blended(a, b, t);
}