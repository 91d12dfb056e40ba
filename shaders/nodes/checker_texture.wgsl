// Checker Texture node (ShaderNodeTexChecker): two colours by the parity of the cell of scaled coordinates.
// Color is the first colour and Factor 1 where the sum of the cell's numbers is odd.
// Source: Blender's formula; the offset and the factor keep small whole numbers off the faces of the cells.
// Domain: finite f32; cells from 2^31 on count as even. Limits: a fused operation may move a point over a face.
#import cloudparity::numeric::to_int

struct Outputs {
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_FAC
    fac: f32,
#endif
}

fn evaluate(vector: vec3f, first: vec3f, second: vec3f, scale: f32) -> Outputs {
    let cell = floor((vector * scale + vec3f(0.000001)) * 0.999999);
    let odd = ((to_int(cell.x) ^ to_int(cell.y) ^ to_int(cell.z)) & 1) == 1;
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    outputs.color = select(second, first, odd);
#endif
#ifdef OUTPUT_FAC
    outputs.fac = select(0.0, 1.0, odd);
#endif
    return outputs;
}
