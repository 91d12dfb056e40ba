// Brightness/Contrast node (ShaderNodeBrightContrast): max((1 + contrast) * color + (brightness - contrast / 2), 0).
// Source: Blender. Domain: finite f32. Limits: a fused product changes the last bit of the larger summand.

fn evaluate(color: vec3f, brightness: f32, contrast: f32) -> vec3f {
    return max((1.0 + contrast) * color + (brightness - contrast * 0.5), vec3f(0.0));
}
