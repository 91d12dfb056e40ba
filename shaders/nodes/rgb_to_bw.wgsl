// RGB to BW node (ShaderNodeRGBToBW): luminance of linear Rec. 709; BEFORE_BLENDER_5 for the
// weights of Blender 4.5. Exact but for the rounding of the written order.
#import cloudparity::color_space::{luminance, luminance_before_5}

fn evaluate(color: vec3f) -> f32 {
#ifdef BEFORE_BLENDER_5
    return luminance_before_5(color);
#else
    return luminance(color);
#endif
}
