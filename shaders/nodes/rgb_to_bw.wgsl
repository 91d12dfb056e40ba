// RGB to BW node (ShaderNodeRGBToBW): luminance of linear Rec. 709; BEFORE_BLENDER_5 for the
// weights of Blender 4.5, SINCE_BLENDER_5_1 for those of 5.1 and later. Exact but for the rounding of the written order.
#import cloudparity::color_space::{luminance, luminance_before_5, luminance_of_node_since_5_1}

fn evaluate(color: vec3f) -> f32 {
#ifdef BEFORE_BLENDER_5
    return luminance_before_5(color);
#else ifdef SINCE_BLENDER_5_1
    return luminance_of_node_since_5_1(color);
#else
    return luminance(color);
#endif
}
