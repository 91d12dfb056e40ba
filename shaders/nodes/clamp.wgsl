// Clamp node (ShaderNodeClamp): limits a value to [minimum, maximum].
// Source: CLAMP_TYPE_MINMAX is min(max(value, minimum), maximum), so that reversed bounds give the maximum;
// CLAMP_TYPE_RANGE swaps reversed bounds.
// Domain: finite f32; exact.

fn evaluate(value: f32, minimum: f32, maximum: f32) -> f32 {
#ifdef CLAMP_TYPE_RANGE
    return min(max(value, min(minimum, maximum)), max(minimum, maximum));
#else
    return min(max(value, minimum), maximum);
#endif
}
