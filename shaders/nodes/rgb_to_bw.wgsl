// RGB to BW node (ShaderNodeRGBToBW): luminance of linear Rec. 709; BEFORE_BLENDER_5 for the
// weights of Blender 4.5. Exact but for the rounding of the written order.
#import cloudparity::color_space::luminance

fn evaluate(color: vec3f) -> f32 {
#ifdef BEFORE_BLENDER_5
    return (color.x * 0.21267404 + color.y * 0.7151516) + color.z * 0.07217542;
#else
    return luminance(color);
#endif
}
