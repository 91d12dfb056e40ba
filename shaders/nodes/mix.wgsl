// Mix node (ShaderNodeMix): DATA_TYPE_FLOAT and DATA_TYPE_VECTOR weight a and b by 1 - t and t, vectors with
// FACTOR_MODE_NON_UNIFORM by a factor per component; DATA_TYPE_RGBA blends colours by BLEND_TYPE_<NAME>.
// CLAMP_FACTOR limits the factor to [0, 1], CLAMP_RESULT the components of a colour.
// Source: Blender; the modes' formulas and their limits are those of the module blend. Domain: finite f32.
#import cloudparity::blend::{blend_mix, blend_darken, blend_multiply, blend_burn, blend_lighten}
#import cloudparity::blend::{blend_screen, blend_dodge, blend_add, blend_overlay, blend_soft_light}
#import cloudparity::blend::{blend_linear_light, blend_difference, blend_exclusion, blend_subtract, blend_divide}
#import cloudparity::blend::{blend_mix_since_5_3, blend_multiply_since_5_3, blend_add_since_5_3}
#import cloudparity::blend::blend_subtract_since_5_3
#import cloudparity::blend::{blend_hue, blend_saturation, blend_color, blend_value}

#ifdef DATA_TYPE_FLOAT

fn evaluate(factor: f32, a: f32, b: f32) -> f32 {
#ifdef CLAMP_FACTOR
    let t = clamp(factor, 0.0, 1.0);
#else
    let t = factor;
#endif
    return a * (1.0 - t) + b * t;
}

#else ifdef DATA_TYPE_VECTOR

#ifdef FACTOR_MODE_NON_UNIFORM
fn evaluate(factor: vec3f, a: vec3f, b: vec3f) -> vec3f {
#ifdef CLAMP_FACTOR
    let t = clamp(factor, vec3f(0.0), vec3f(1.0));
#else
    let t = factor;
#endif
    return a * (1.0 - t) + b * t;
}
#else
fn evaluate(factor: f32, a: vec3f, b: vec3f) -> vec3f {
#ifdef CLAMP_FACTOR
    let t = clamp(factor, 0.0, 1.0);
#else
    let t = factor;
#endif
    return a * (1.0 - t) + b * t;
}
#endif

#else

fn blended(a: vec3f, b: vec3f, t: f32) -> vec3f {
#ifdef BLEND_TYPE_MIX
#ifdef SINCE_BLENDER_5_3
    return blend_mix_since_5_3(a, b, t);
#else
    return blend_mix(a, b, t);
#endif
#else ifdef BLEND_TYPE_DARKEN
    return blend_darken(a, b, t);
#else ifdef BLEND_TYPE_MULTIPLY
#ifdef SINCE_BLENDER_5_3
    return blend_multiply_since_5_3(a, b, t);
#else
    return blend_multiply(a, b, t);
#endif
#else ifdef BLEND_TYPE_BURN
    return blend_burn(a, b, t);
#else ifdef BLEND_TYPE_LIGHTEN
    return blend_lighten(a, b, t);
#else ifdef BLEND_TYPE_SCREEN
    return blend_screen(a, b, t);
#else ifdef BLEND_TYPE_DODGE
    return blend_dodge(a, b, t);
#else ifdef BLEND_TYPE_ADD
#ifdef SINCE_BLENDER_5_3
    return blend_add_since_5_3(a, b, t);
#else
    return blend_add(a, b, t);
#endif
#else ifdef BLEND_TYPE_OVERLAY
    return blend_overlay(a, b, t);
#else ifdef BLEND_TYPE_SOFT_LIGHT
    return blend_soft_light(a, b, t);
#else ifdef BLEND_TYPE_LINEAR_LIGHT
    return blend_linear_light(a, b, t);
#else ifdef BLEND_TYPE_DIFFERENCE
    return blend_difference(a, b, t);
#else ifdef BLEND_TYPE_EXCLUSION
    return blend_exclusion(a, b, t);
#else ifdef BLEND_TYPE_SUBTRACT
#ifdef SINCE_BLENDER_5_3
    return blend_subtract_since_5_3(a, b, t);
#else
    return blend_subtract(a, b, t);
#endif
#else ifdef BLEND_TYPE_DIVIDE
    return blend_divide(a, b, t);
#else ifdef BLEND_TYPE_HUE
    return blend_hue(a, b, t);
#else ifdef BLEND_TYPE_SATURATION
    return blend_saturation(a, b, t);
#else ifdef BLEND_TYPE_COLOR
    return blend_color(a, b, t);
#else ifdef BLEND_TYPE_VALUE
    return blend_value(a, b, t);
#endif
}

fn evaluate(factor: f32, a: vec3f, b: vec3f) -> vec3f {
#ifdef CLAMP_FACTOR
    let t = clamp(factor, 0.0, 1.0);
#else
    let t = factor;
#endif
#ifdef CLAMP_RESULT
    return clamp(blended(a, b, t), vec3f(0.0), vec3f(1.0));
#else
    return blended(a, b, t);
#endif
}

#endif
