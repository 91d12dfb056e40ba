// Combine XYZ node (ShaderNodeCombineXYZ): a vector from its components.
// Source: Blender. Domain: any f32; exact.
// Limits: none.

fn evaluate(x: f32, y: f32, z: f32) -> vec3f {
    return vec3f(x, y, z);
}
