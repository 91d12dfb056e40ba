// Map Range node (ShaderNodeMapRange): result = to_min + f * (to_max - to_min), f from the place of the value in the
// From range. DATA_TYPE_FLOAT or DATA_TYPE_FLOAT_VECTOR, one INTERPOLATION_TYPE_<NAME>, CLAMP limits to the To range.
// Source: Blender; the two data types differ: an empty From range gives 0 for floats (then clamped) and to_min for
// vectors, and vectors are clamped in the linear and stepped interpolations only (the others cannot leave the range).
// Domain: finite f32. Limits: the quotient is as exact as the device's division.
#import cloudparity::numeric::safe_divide3

#ifdef DATA_TYPE_FLOAT_VECTOR

fn factor(value: vec3f, from_min: vec3f, from_max: vec3f, steps: vec3f) -> vec3f {
    let t = safe_divide3(value - from_min, from_max - from_min);
#ifdef INTERPOLATION_TYPE_LINEAR
    return t;
#else ifdef INTERPOLATION_TYPE_STEPPED
    return select(vec3f(0.0), floor(t * (steps + 1.0)) / steps, steps > vec3f(0.0));
#else ifdef INTERPOLATION_TYPE_SMOOTHSTEP
    let u = clamp(t, vec3f(0.0), vec3f(1.0));
    return (3.0 - 2.0 * u) * (u * u);
#else ifdef INTERPOLATION_TYPE_SMOOTHERSTEP
    let u = clamp(t, vec3f(0.0), vec3f(1.0));
    return ((u * u) * u) * (u * (u * 6.0 - 15.0) + 10.0);
#endif
}

fn map(value: vec3f, from_min: vec3f, from_max: vec3f, to_min: vec3f, to_max: vec3f, steps: vec3f) -> vec3f {
    let result = to_min + factor(value, from_min, from_max, steps) * (to_max - to_min);
#ifdef CLAMP
#ifdef INTERPOLATION_TYPE_LINEAR
    return clamp(result, min(to_min, to_max), max(to_min, to_max));
#endif
#ifdef INTERPOLATION_TYPE_STEPPED
    return clamp(result, min(to_min, to_max), max(to_min, to_max));
#endif
#ifdef INTERPOLATION_TYPE_SMOOTHSTEP
    return result;
#endif
#ifdef INTERPOLATION_TYPE_SMOOTHERSTEP
    return result;
#endif
#else
    return result;
#endif
}

#ifdef INTERPOLATION_TYPE_STEPPED
fn evaluate(value: vec3f, from_min: vec3f, from_max: vec3f, to_min: vec3f, to_max: vec3f, steps: vec3f) -> vec3f {
    return map(value, from_min, from_max, to_min, to_max, steps);
}
#else
fn evaluate(value: vec3f, from_min: vec3f, from_max: vec3f, to_min: vec3f, to_max: vec3f) -> vec3f {
    return map(value, from_min, from_max, to_min, to_max, vec3f(0.0));
}
#endif

#else

#ifdef INTERPOLATION_TYPE_SMOOTHSTEP
// Rises from 0 at low to 1 at high, low < high.
fn smooth_factor(value: f32, low: f32, high: f32) -> f32 {
    let t = (value - low) / (high - low);
    return select(select((3.0 - 2.0 * t) * (t * t), 1.0, value >= high), 0.0, value < low);
}
#endif
#ifdef INTERPOLATION_TYPE_SMOOTHERSTEP
fn smooth_factor(value: f32, low: f32, high: f32) -> f32 {
    let t = clamp((value - low) / (high - low), 0.0, 1.0);
    return ((t * t) * t) * (t * (t * 6.0 - 15.0) + 10.0);
}
#endif

fn factor(value: f32, from_min: f32, from_max: f32, steps: f32) -> f32 {
#ifdef INTERPOLATION_TYPE_LINEAR
    return (value - from_min) / (from_max - from_min);
#else ifdef INTERPOLATION_TYPE_STEPPED
    let t = (value - from_min) / (from_max - from_min);
    return select(0.0, floor(t * (steps + 1.0)) / steps, steps > 0.0);
#else
    // A reversed From range falls from 1 to 0.
    if from_min > from_max {
        return 1.0 - smooth_factor(value, from_max, from_min);
    }
    return smooth_factor(value, from_min, from_max);
#endif
}

fn map(value: f32, from_min: f32, from_max: f32, to_min: f32, to_max: f32, steps: f32) -> f32 {
    let inside = to_min + factor(value, from_min, from_max, steps) * (to_max - to_min);
    let result = select(inside, 0.0, from_min == from_max);
#ifdef CLAMP
    return clamp(result, min(to_min, to_max), max(to_min, to_max));
#else
    return result;
#endif
}

#ifdef INTERPOLATION_TYPE_STEPPED
fn evaluate(value: f32, from_min: f32, from_max: f32, to_min: f32, to_max: f32, steps: f32) -> f32 {
    return map(value, from_min, from_max, to_min, to_max, steps);
}
#else
fn evaluate(value: f32, from_min: f32, from_max: f32, to_min: f32, to_max: f32) -> f32 {
    return map(value, from_min, from_max, to_min, to_max, 0.0);
}
#endif

#endif
