// Float Curve node (ShaderNodeFloatCurve): (1 - factor) * value + factor * curve(value).
// The text in front of this one declares table_value(position), the curve at 257 places from CURVE_START over
// CURVE_WIDTH, interpolated linearly, and how much it changes per entry beyond its first and last one: STEP_BELOW,
// STEP_ABOVE (0 where the curve goes on horizontally).
// Source: Cycles evaluates curves by such a table. Domain: finite f32. Limits: the quotient is as exact as the
// device's.

fn evaluate(factor: f32, value: f32) -> f32 {
    let place = (value - CURVE_START) / CURVE_WIDTH;
    let inside = table_value(clamp(place, 0.0, 1.0) * 256.0);
    let below = (STEP_BELOW * max(-place, 0.0)) * 256.0;
    let above = (STEP_ABOVE * max(place - 1.0, 0.0)) * 256.0;
    return (1.0 - factor) * value + factor * (inside + below + above);
}
