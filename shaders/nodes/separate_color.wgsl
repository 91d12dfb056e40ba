// Separate Color node (ShaderNodeSeparateColor): MODE_RGB the channels, MODE_HSV hue, saturation and value, MODE_HSL
// hue, saturation and lightness, always as red, green, blue.
// Source, domain and limits: those of the colour spaces' module.
#import cloudparity::color_space::{rgb_to_hsv, rgb_to_hsl}

struct Outputs {
#ifdef OUTPUT_RED
    red: f32,
#endif
#ifdef OUTPUT_GREEN
    green: f32,
#endif
#ifdef OUTPUT_BLUE
    blue: f32,
#endif
}

fn evaluate(color: vec3f) -> Outputs {
#ifdef MODE_HSV
    let separated = rgb_to_hsv(color);
#else ifdef MODE_HSL
    let separated = rgb_to_hsl(color);
#else
    let separated = color;
#endif
    var outputs: Outputs;
#ifdef OUTPUT_RED
    outputs.red = separated.x;
#endif
#ifdef OUTPUT_GREEN
    outputs.green = separated.y;
#endif
#ifdef OUTPUT_BLUE
    outputs.blue = separated.z;
#endif
    return outputs;
}
