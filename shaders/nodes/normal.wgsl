// Normal node (ShaderNodeNormal): the direction that the node stores, and its dot product with a vector, both normalised.
// DIRECTION, of length 1, is put in front of this text.
// Source: Blender. Domain: finite f32. Limits: a vector of length 0 gives NaN in Blender and anything here; squares overflow
// for components above 1.8e19.

struct Outputs {
    normal: vec3f,
    dot: f32,
}

fn evaluate(vector: vec3f) -> Outputs {
    let unit = vector / sqrt((vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z);
    return Outputs(DIRECTION, (DIRECTION.x * unit.x + DIRECTION.y * unit.y) + DIRECTION.z * unit.z);
}
