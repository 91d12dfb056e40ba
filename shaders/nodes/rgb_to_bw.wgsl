// RGB to BW node (ShaderNodeRGBToBW): luminance of linear Rec. 709. Exact but for the rounding of the written order.
#import cloudparity::color_space::luminance

fn evaluate(color: vec3f) -> f32 {
    return luminance(color);
}
