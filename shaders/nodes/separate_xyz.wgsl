// Separate XYZ node (ShaderNodeSeparateXYZ): the wanted components of a vector, by the defs OUTPUT_X, _Y and _Z.
// Source: Blender. Domain: any f32; exact.
// Limits: at least one output must be wanted, since a structure cannot be empty.

struct Outputs {
#ifdef OUTPUT_X
    x: f32,
#endif
#ifdef OUTPUT_Y
    y: f32,
#endif
#ifdef OUTPUT_Z
    z: f32,
#endif
}

fn evaluate(vector: vec3f) -> Outputs {
    var outputs: Outputs;
#ifdef OUTPUT_X
    outputs.x = vector.x;
#endif
#ifdef OUTPUT_Y
    outputs.y = vector.y;
#endif
#ifdef OUTPUT_Z
    outputs.z = vector.z;
#endif
    return outputs;
}
