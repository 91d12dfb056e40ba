//! Brightness/Contrast (`ShaderNodeBrightContrast`): `max((1 + contrast) c + (brightness - contrast / 2), 0)`.
//!
//! Blender leaves constants to Cycles, which folds them by the same formula.

use crate::base::arrays::Mapped;
use crate::nodes::color_space::fill;
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always, vector_at};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeBrightContrast",
    label: "Brightness/Contrast",
    module: "bright_contrast",
    shader: include_str!("../../shaders/nodes/bright_contrast.wgsl"),
    properties: &[],
    inputs: &[
        InputSocket::color("Color", "Color", &[1.0; 3]),
        InputSocket::float("Bright", "Brightness", &[0.0], always),
        InputSocket::float("Contrast", "Contrast", &[0.0], always),
    ],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|_| Box::new(BrightContrast)),
};

struct BrightContrast;

/// Encloses one channel before its negative part goes: linear in each of the three, so extreme at corners.
fn enclose_channel(channel: Interval, brightness: Interval, contrast: Interval) -> Interval {
    let slope = Interval::ONE + contrast;
    let offset = brightness - contrast * Interval::point(0.5);
    let result = slope * channel + offset;
    if !result.is_finite() {
        return result;
    }
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for c in channel.ends() {
        for k in contrast.ends() {
            let value = (1.0 + k) * c - 0.5 * k;
            (low, high) = (low.min(value), high.max(value));
        }
    }
    let [darker, brighter] = brightness.ends();
    // What is rounded is never larger than these.
    let (c, k) = (channel.magnitude(), contrast.magnitude());
    let error = 1e-6 * ((1.0 + k) * c + k + brightness.magnitude());
    Interval::with_error(low + darker, high + brighter, error, false).meet(result)
}

impl Evaluate for BrightContrast {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        fill(outputs, |index| {
            let (brightness, contrast) = (inputs[3].values[index], inputs[4].values[index]);
            let slope = R::of(1.0) + contrast;
            let offset = brightness - contrast * R::of(0.5);
            vector_at(inputs, 0, index).mapped(|channel| (slope * channel + offset).greater(R::of(0.0)))
        });
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (output, &channel) in outputs.iter_mut().zip(&inputs[..3]) {
            *output = enclose_channel(channel, inputs[3], inputs[4]).greater(Interval::ZERO);
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
    fn contrast_turns_about_the_middle() {
        let columns = [0.5_f32, 0.75, 0.1, 0.25, 2.0].map(|value| [value]);
        let inputs: Vec<_> = columns.iter().map(|values| Column { values, uniform: true }).collect();
        let mut output = [[0.0_f32]; 3];
        let mut outputs: Vec<&mut [f32]> = output.iter_mut().map(|values| values.as_mut_slice()).collect();
        BrightContrast.evaluate(&inputs, &mut outputs);
        assert_eq!(output, [[0.75], [1.5], [0.0]]);
    }

    #[test]
    fn bounds_of_a_varying_contrast_are_tight() {
        let bounds = enclose_channel(Interval::new(0.4, 0.6), Interval::ZERO, Interval::new(0.0, 1.0));
        assert!((bounds.low - 0.3).abs() < 1e-4 && (bounds.high - 0.7).abs() < 1e-4, "{bounds:?}");
    }
}
