//! How Blender itself mixes constants, before Cycles sees a graph.
//!
//! In most blend modes the order of operations is not the kernels' one, and the limits let a NaN through. Source:
//! values of Blender, equal in every bit for ordinary operands, infinities and NaN.

use crate::base::arrays::each;
use crate::nodes::color_space::blender::{hsv_to_rgb, rgb_to_hsv};
use crate::nodes::mix::formulas::{burn, divide, dodge, linear_light, overlay, screen, soft_light, weighted};

/// Limits to [0, 1] if asked to; NaN stays, where the kernels' limit makes it 0.
pub fn limited(value: f32, limits: bool) -> f32 {
    if limits { value.clamp(0.0, 1.0) } else { value }
}

/// The blend of `b` over `a` with the factor `t`, in one of [`super::blend::BLEND_TYPES`].
pub fn blended(kind: &str, a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    let each = |formula: fn(f32, f32, f32) -> f32| each(|axis| formula(a[axis], b[axis], t));
    match kind {
        "MIX" => each(weighted),
        "DARKEN" => each(|a, b, t| weighted(a, if a < b { a } else { b }, t)),
        "MULTIPLY" => each(|a, b, t| a * ((1.0 - t) + t * b)),
        "BURN" => each(burn),
        "LIGHTEN" => each(|a, b, t| weighted(a, if a > b { a } else { b }, t)),
        "SCREEN" => each(screen),
        "DODGE" => each(dodge),
        "ADD" => each(|a, b, t| a + t * b),
        "OVERLAY" => each(overlay),
        "SOFT_LIGHT" => each(soft_light),
        "LINEAR_LIGHT" => each(linear_light),
        "DIFFERENCE" => each(|a, b, t| weighted(a, (a - b).abs(), t)),
        "EXCLUSION" => each(|a, b, t| weighted(a, (a + b) - (2.0 * a) * b, t).max(0.0)),
        "SUBTRACT" => each(|a, b, t| a - t * b),
        "DIVIDE" => each(divide),
        "HUE" => hue(a, b, t),
        "SATURATION" => saturation(a, b, t),
        "COLOR" => color(a, b, t),
        "VALUE" => value(a, b, t),
        other => unreachable!("{other} is not in BLEND_TYPES"),
    }
}

fn weighted_each(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    each(|axis| weighted(a[axis], b[axis], t))
}

/// The hue of b; grey has none.
fn hue(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    let [hue, saturation, _] = rgb_to_hsv(b);
    if saturation == 0.0 {
        return a;
    }
    let [_, saturation, value] = rgb_to_hsv(a);
    weighted_each(a, hsv_to_rgb([hue, saturation, value]), t)
}

/// The saturation of b; grey stays grey.
fn saturation(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    let [hue, saturation, value] = rgb_to_hsv(a);
    if saturation == 0.0 {
        return a;
    }
    hsv_to_rgb([hue, weighted(saturation, rgb_to_hsv(b)[1], t), value])
}

/// The hue and the saturation of b.
fn color(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    let [hue, saturation, _] = rgb_to_hsv(b);
    if saturation == 0.0 {
        return a;
    }
    weighted_each(a, hsv_to_rgb([hue, saturation, rgb_to_hsv(a)[2]]), t)
}

/// The value of b.
fn value(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    let [hue, saturation, value] = rgb_to_hsv(a);
    hsv_to_rgb([hue, saturation, weighted(value, rgb_to_hsv(b)[2], t)])
}
