// Implicit conversion of a vector (mean) or a colour (luminance of linear Rec. 709) to a float.
// FROM_VECTOR or FROM_COLOR; BEFORE_BLENDER_5 for the weights of Blender 4.5. Exact but for the rounding of the written order.

fn evaluate(vector: vec3f) -> f32 {
#ifdef FROM_COLOR
#ifdef BEFORE_BLENDER_5
    return (vector.x * 0.21267404 + vector.y * 0.7151516) + vector.z * 0.07217542;
#else
    return (vector.x * 0.21263912 + vector.y * 0.71516913) + vector.z * 0.07219276;
#endif
#else
    return ((vector.x + vector.y) + vector.z) * (1.0 / 3.0);
#endif
}
