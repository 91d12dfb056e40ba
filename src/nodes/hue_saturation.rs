//! Hue/Saturation/Value (`ShaderNodeHueSaturation`): shifts a colour's hue and scales its saturation and value.
//!
//! In HSV: hue + Hue + 1/2, of which the fraction counts (a Hue of 0.5 keeps the hue), saturation times Saturation
//! within [0, 1], value times Value. The result is blended with the colour by the unclamped factor, and its negative
//! part goes. Constants are evaluated like everything else: neither Blender nor Cycles folds the node.

use crate::base::arrays::each;
use crate::nodes::color_space::{enclose_hsv_to_rgb, enclose_rgb_to_hsv, hsv_to_rgb, rgb_to_hsv};
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always, map_vector};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeHueSaturation",
    label: "Hue/Saturation/Value",
    module: "hue_saturation",
    shader: include_str!("../../shaders/nodes/hue_saturation.wgsl"),
    properties: &[],
    inputs: &[
        InputSocket::float("Hue", "Hue", &[0.5], always),
        InputSocket::float("Saturation", "Saturation", &[1.0], always),
        InputSocket::float("Value", "Value", &[1.0], always),
        InputSocket::float("Fac", "Factor", &[1.0], always),
        InputSocket::color("Color", "Color", &[0.8; 3]),
    ],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|_| Box::new(HueSaturation)),
};

struct HueSaturation;

/// The colour with shifted hue and scaled saturation and value.
fn adjusted<R: Real>(color: [R; 3], [shift, saturating, brightening]: [R; 3]) -> [R; 3] {
    let [hue, saturation, value] = rgb_to_hsv(color);
    let hue = ((hue + shift) + R::of(0.5)).fraction();
    hsv_to_rgb([hue, (saturation * saturating).saturate(), value * brightening])
}

/// Encloses [`adjusted`].
fn enclose_adjusted(color: [Interval; 3], [shift, saturating, brightening]: [Interval; 3]) -> [Interval; 3] {
    let [hue, saturation, value] = enclose_rgb_to_hsv(color);
    let hue = ((hue + shift) + Interval::point(0.5)).fraction();
    enclose_hsv_to_rgb([hue, (saturation * saturating).saturate(), value * brightening])
}

/// Encloses the blend of one channel, before its negative part goes.
fn enclose_blend(adjusted: Interval, channel: Interval, factor: Interval) -> Interval {
    let result = factor * adjusted + (Interval::ONE - factor) * channel;
    let is_blend = factor.low >= 0.0 && factor.high <= 1.0 && !factor.may_be_nan;
    if is_blend && result.is_finite() { channel.lerp(adjusted, factor).meet(result) } else { result }
}

impl Evaluate for HueSaturation {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        map_vector(inputs, [0, 1, 2, 3, 4, 5, 6], outputs, |[hue, saturation, value, factor, color @ ..]: [R; 7]| {
            let adjusted = adjusted(color, [hue, saturation, value]);
            each(|axis| (factor * adjusted[axis] + (R::of(1.0) - factor) * color[axis]).greater(R::of(0.0)))
        });
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let color = [inputs[4], inputs[5], inputs[6]];
        let adjusted = enclose_adjusted(color, [inputs[0], inputs[1], inputs[2]]);
        for (axis, output) in outputs.iter_mut().enumerate() {
            *output = enclose_blend(adjusted[axis], color[axis], inputs[3]).greater(Interval::ZERO);
        }
    }

    fn folds_early(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hue_of_one_half_keeps_the_colour() {
        let color = [0.75_f64, 0.25, 0.5];
        let found = adjusted(color, [0.5, 1.0, 1.0]);
        assert!(found.iter().zip(color).all(|(a, b)| (a - b).abs() < 1e-7), "{found:?}");
        // A third of a turn on, red becomes green.
        let found = adjusted([1.0_f64, 0.0, 0.0], [0.5 + 1.0 / 3.0, 1.0, 0.5]);
        assert!((found[0]).abs() < 1e-7 && (found[1] - 0.5).abs() < 1e-7 && found[2].abs() < 1e-7, "{found:?}");
        // Saturation ends at 1.
        assert_eq!(adjusted([1.0_f32, 0.5, 0.5], [0.5, 9.0, 1.0]), [1.0, 0.0, 0.0]);
    }

    #[test]
    fn bounds_hold_the_values() {
        let ends = [[0.2_f32, 0.2], [0.1, 0.4], [0.4, 1.0], [-0.5, 2.0], [3.0, 1e30]];
        for number in 0..5_usize.pow(7) {
            // Boxes of seven inputs, one in 61 of all: their corners and middles by turns.
            if number % 61 != 0 {
                continue;
            }
            let boxes: [[f32; 2]; 7] = std::array::from_fn(|input| ends[number / 5_usize.pow(input as u32) % 5]);
            let inputs = boxes.map(|[low, high]| Interval::new(low, high));
            let mut bounds = [Interval::ZERO; 3];
            HueSaturation.enclose(&inputs, &mut bounds);
            for turn in 0..9_usize {
                let values: [[f32; 1]; 7] = std::array::from_fn(|input| {
                    let [low, high] = boxes[input];
                    [[low, 0.5 * low + 0.5 * high, high][(turn * (input + 1) + turn / 3) % 3]]
                });
                let columns: Vec<_> = values.iter().map(|values| Column { values, uniform: true }).collect();
                let mut output = [[0.0_f32]; 3];
                let mut outputs: Vec<&mut [f32]> = output.iter_mut().map(|values| values.as_mut_slice()).collect();
                HueSaturation.evaluate(&columns, &mut outputs);
                for ([found], bound) in output.iter().zip(bounds) {
                    assert!(bound.contains(f64::from(*found)), "{values:?} of {boxes:?}: {output:?}, {bounds:?}");
                }
            }
        }
    }
}
