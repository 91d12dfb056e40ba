// Hue/Saturation/Value node (ShaderNodeHueSaturation): shifts the hue by (hue - 0.5) turns, scales saturation (within
// [0, 1]) and value, blends with the colour by the unclamped factor and drops what is negative.
// Source: Blender. Domain: finite f32.
// Limits: those of the colour spaces' module; a large hue leaves few digits of the sum.
#import cloudparity::color_space::{rgb_to_hsv, hsv_to_rgb}

fn evaluate(hue: f32, saturation: f32, value: f32, factor: f32, color: vec3f) -> vec3f {
    let coordinates = rgb_to_hsv(color);
    let shifted = (coordinates.x + hue) + 0.5;
    let turned = shifted - floor(shifted);
    let adjusted = hsv_to_rgb(vec3f(turned, clamp(coordinates.y * saturation, 0.0, 1.0), coordinates.z * value));
    return max(factor * adjusted + (1.0 - factor) * color, vec3f(0.0));
}
