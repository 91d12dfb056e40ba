// A value of the shaded object (Object Info), the same at every point.

fn evaluate(value: vec3f) -> vec3f {
    return value;
}
