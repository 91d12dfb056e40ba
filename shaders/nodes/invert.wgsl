// Invert Color node (ShaderNodeInvert): factor * (1 - color) + (1 - factor) * color, the factor unclamped.
// Source: Blender. Domain: finite f32. Limits: fused products change the last bit of the larger one.

fn evaluate(factor: f32, color: vec3f) -> vec3f {
    return factor * (1.0 - color) + (1.0 - factor) * color;
}
