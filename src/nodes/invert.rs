//! Invert Color (`ShaderNodeInvert`): a blend of a colour with what it lacks to white.
//!
//! `f (1 - c) + (1 - f) c`, the factor unclamped. Blender leaves constants to Cycles, which folds them in another order
//! of operations and passes the colour on at a constant factor of 0.

use crate::base::arrays::Mapped;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, Simplified, always, map_vector,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeInvert",
    label: "Invert Color",
    module: "invert",
    shader: include_str!("../../shaders/nodes/invert.wgsl"),
    properties: &[],
    inputs: &[InputSocket::float("Fac", "Factor", &[1.0], always), InputSocket::color("Color", "Color", &[0.0; 3])],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|_| Box::new(Invert)),
};

struct Invert;

/// Encloses one channel: linear in each of the two, so extreme at corners.
fn enclose_channel(factor: Interval, channel: Interval) -> Interval {
    let one = Interval::ONE;
    let result = factor * (one - channel) + (one - factor) * channel;
    if !result.is_finite() {
        return result;
    }
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for f in factor.ends() {
        for c in channel.ends() {
            let value = f * (1.0 - c) + (1.0 - f) * c;
            (low, high) = (low.min(value), high.max(value));
        }
    }
    // Each of the two products is rounded relative to itself.
    let (f, c) = (factor.magnitude(), channel.magnitude());
    Interval::with_error(low, high, 1e-6 * (f * (1.0 + c) + (1.0 + f) * c), false).meet(result)
}

impl Evaluate for Invert {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let one = R::of(1.0);
        map_vector(inputs, [0, 1, 2, 3], outputs, |[factor, color @ ..]: [R; 4]| {
            color.mapped(|channel| factor * (one - channel) + (one - factor) * channel)
        });
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (output, &channel) in outputs.iter_mut().zip(&inputs[1..]) {
            *output = enclose_channel(inputs[0], channel);
        }
    }

    fn folds_early(&self) -> bool {
        false
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let (factor, color) = inputs.split_first()?;
        Some(color.iter().map(|channel| channel.lerp(1.0 - channel, *factor)).collect())
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        (inputs[0] == Some(0.0)).then(|| Simplified::Inputs(vec![1, 2, 3]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constants_are_folded_in_another_order() {
        let (factor, channel) = (0.3_f32, 0.1_f32);
        let mut output = [[0.0_f32]; 3];
        let columns = [factor, channel, channel, channel].map(|value| [value]);
        let inputs: Vec<_> = columns.iter().map(|values| Column { values, uniform: true }).collect();
        let mut outputs: Vec<&mut [f32]> = output.iter_mut().map(|values| values.as_mut_slice()).collect();
        Invert.evaluate(&inputs, &mut outputs);
        assert_eq!(output[0][0], 0.3 * (1.0 - 0.1_f32) + (1.0 - 0.3_f32) * 0.1);
        assert_eq!(Invert.fold_constants_late(&[0.3, 0.1]), Some(vec![0.1 + 0.3 * ((1.0 - 0.1_f32) - 0.1)]));
    }

    #[test]
    fn bounds_of_a_varying_factor_are_tight() {
        let bounds = enclose_channel(Interval::UNIT, Interval::new(0.25, 0.5));
        assert!((bounds.low - 0.25).abs() < 1e-5 && (bounds.high - 0.75).abs() < 1e-5, "{bounds:?}");
    }
}
