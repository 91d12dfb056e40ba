// Value node (ShaderNodeValue): a number.
// Source: Blender. The node has no input socket: the parameter is what its output socket stores.
// Domain: any f32; exact. Limits: none.

fn evaluate(value: f32) -> f32 {
    return value;
}
