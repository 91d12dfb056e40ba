// Combine Color node (ShaderNodeCombineColor): a colour from three numbers: MODE_RGB its channels, MODE_HSV hue,
// saturation and value, MODE_HSL hue, saturation and lightness.
// Source, domain and limits: those of the colour spaces' module.
#import cloudparity::color_space::{hsv_to_rgb, hsl_to_rgb}

fn evaluate(red: f32, green: f32, blue: f32) -> vec3f {
#ifdef MODE_HSV
    return hsv_to_rgb(vec3f(red, green, blue));
#else ifdef MODE_HSL
    return hsl_to_rgb(vec3f(red, green, blue));
#else
    return vec3f(red, green, blue);
#endif
}
