// Colour spaces: linear Rec. 709 to and from HSV (hue, saturation, value) and HSL (hue, saturation, lightness).
// Source: Smith, "Color Gamut Transform Pairs" (1978), in Blender's form: hue in turns, nothing clamped, a hue outside
// of [0, 1] in the last of the six sectors. Domain: finite f32.
// Limits: as exact as the device's division. The hue of HSV jumps between 0 and 1 next to red.
#define_import_path cloudparity::color_space

fn luminance(color: vec3f) -> f32 {
    return (color.x * 0.21263912 + color.y * 0.71516913) + color.z * 0.07219276;
}

// With the weights of RGB to BW since Blender 5.1.
fn luminance_of_node_since_5_1(color: vec3f) -> f32 {
    return (color.x * 0.2126391 + color.y * 0.71516913) + color.z * 0.07219274;
}

// With the weights of Blender 4.5.
fn luminance_before_5(color: vec3f) -> f32 {
    return (color.x * 0.21267404 + color.y * 0.7151516) + color.z * 0.07217542;
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
