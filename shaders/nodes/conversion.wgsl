// Implicit conversion of a vector (mean) or a colour (luminance of linear Rec. 709) to a float.
// FROM_VECTOR or FROM_COLOR; BEFORE_BLENDER_5 for the weights of Blender 4.5. Exact but for the rounding of the written order.
#import cloudparity::color_space::{luminance, luminance_before_5}

fn evaluate(vector: vec3f) -> f32 {
#ifdef FROM_COLOR
#ifdef BEFORE_BLENDER_5
    return luminance_before_5(vector);
#else
    return luminance(vector);
#endif
#else
    return ((vector.x + vector.y) + vector.z) * (1.0 / 3.0);
#endif
}
