// Color Ramp node (ShaderNodeValToRGB): a colour and an alpha for a factor.
// The text in front of this one declares table_value(position), the table of the ramp at a position from 0 to 256: 257
// entries, interpolated linearly unless the ramp is constant between stops.
// Source: Cycles evaluates ramps by such a table. Domain: finite f32; factors beyond 0 and 1 read the ends.

struct Outputs {
#ifdef OUTPUT_COLOR
    color: vec3f,
#endif
#ifdef OUTPUT_ALPHA
    alpha: f32,
#endif
}

fn evaluate(factor: f32) -> Outputs {
    let value = table_value(clamp(factor, 0.0, 1.0) * 256.0);
    var outputs: Outputs;
#ifdef OUTPUT_COLOR
    outputs.color = value.rgb;
#endif
#ifdef OUTPUT_ALPHA
    outputs.alpha = value.a;
#endif
    return outputs;
}
