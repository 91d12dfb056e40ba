// Value node (ShaderNodeValue). It has no input socket: the parameter is the number stored in its output socket. Exact.

fn evaluate(value: f32) -> f32 {
    return value;
}
