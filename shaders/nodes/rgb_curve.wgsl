// RGB Curves node (ShaderNodeRGBCurve): (1 - factor) * color + factor * curves(color), a curve per component.
// The text in front of this one declares table_value(position), each component's curve at 257 places from CURVE_START
// over CURVE_WIDTH, interpolated linearly, and how much it changes per entry beyond its first and last one:
// STEP_BELOW, STEP_ABOVE (0 where the curves go on horizontally).
// Source: Cycles evaluates curves by such a table. Domain: finite f32. Limits: the quotient is as exact as the
// device's.

fn evaluate(factor: f32, color: vec3f) -> vec3f {
    let place = (color - CURVE_START) / CURVE_WIDTH;
    let inside = table_value(clamp(place, vec3f(0.0), vec3f(1.0)) * 256.0);
    let below = (STEP_BELOW * max(-place, vec3f(0.0))) * 256.0;
    let above = (STEP_ABOVE * max(place - 1.0, vec3f(0.0))) * 256.0;
    return (1.0 - factor) * color + factor * (inside + below + above);
}
