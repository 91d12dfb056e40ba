//! Gamma (`ShaderNodeGamma`): a power of each positive channel, by the C library; others stay as they are.
//!
//! Gamma 0 gives white; where Blender folds constants, only the positive channels become 1.

use crate::base::arrays::Mapped;
use crate::nodes::color_space::fill;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, Simplified, always, vector_at,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeGamma",
    label: "Gamma",
    module: "gamma",
    shader: include_str!("../../shaders/nodes/gamma.wgsl"),
    properties: &[],
    inputs: &[
        InputSocket::color("Color", "Color", &[1.0; 3]).hiding_value(),
        InputSocket::float("Gamma", "Gamma", &[1.0], always),
    ],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|_| Box::new(Gamma)),
};

struct Gamma;

/// A positive channel's power, any other channel itself.
fn channel_power<R: Real>(channel: R, gamma: R) -> R {
    if channel > R::of(0.0) { channel.powf(gamma) } else { channel }
}

/// Encloses one channel.
fn enclose_channel(channel: Interval, gamma: Interval) -> Interval {
    let mut result: Option<Interval> = None;
    let mut add = |part: Interval| result = Some(result.map_or(part, |known| known.hull(part)));
    if gamma.has_zero() {
        add(Interval::ONE);
    }
    if gamma.as_point() != Some(0.0) {
        if channel.high > 0.0 {
            add(Interval { low: channel.low.max(0.0), high: channel.high, may_be_nan: false }.power(gamma));
        }
        // Shaders count subnormal channels as 0.
        if channel.low < f32::MIN_POSITIVE {
            add(Interval::new(channel.low.min(0.0), channel.high.min(0.0)).hull(Interval::ZERO));
        }
    }
    result.unwrap_or(Interval::EVERYTHING).or_nan(channel.may_be_nan)
}

impl Evaluate for Gamma {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        fill(outputs, |index| {
            let gamma = inputs[3].values[index];
            if gamma == R::of(0.0) {
                return [R::of(1.0); 3];
            }
            vector_at(inputs, 0, index).mapped(|channel| channel_power(channel, gamma))
        });
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (output, &channel) in outputs.iter_mut().zip(&inputs[..3]) {
            *output = enclose_channel(channel, inputs[3]);
        }
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let (gamma, color) = inputs.split_last()?;
        (*gamma == 0.0).then(|| color.iter().map(|&channel| channel_power(channel, *gamma)).collect())
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        let is_white = inputs[..3].iter().all(|channel| *channel == Some(1.0));
        // The first power and the zeroth one are exact.
        match inputs[3] {
            _ if is_white => Some(Simplified::Constant(vec![1.0; 3])),
            Some(0.0) => Some(Simplified::Constant(vec![1.0; 3])),
            Some(1.0) => Some(Simplified::Inputs(vec![0, 1, 2])),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn evaluated(color: [f32; 3], gamma: f32) -> [f32; 3] {
        let columns = [color[0], color[1], color[2], gamma].map(|value| [value]);
        let inputs: Vec<_> = columns.iter().map(|values| Column { values, uniform: true }).collect();
        let mut output = [[0.0_f32]; 3];
        let mut outputs: Vec<&mut [f32]> = output.iter_mut().map(|values| values.as_mut_slice()).collect();
        Gamma.evaluate(&inputs, &mut outputs);
        output.map(|[value]| value)
    }

    #[test]
    fn channels_that_are_not_positive_stay() {
        assert_eq!(evaluated([-0.25, 0.0, 0.25], 0.5), [-0.25, 0.0, 0.5]);
        assert_eq!(evaluated([-0.25, 0.0, 0.25], -1.0), [-0.25, 0.0, 4.0]);
        assert_eq!(evaluated([-0.25, 0.0, 0.25], 0.0), [1.0; 3]);
        assert_eq!(Gamma.fold_constants(&[-0.25, 0.0, 0.25, 0.0]), Some(vec![-0.25, 0.0, 1.0]));
        assert_eq!(Gamma.fold_constants(&[-0.25, 0.0, 0.25, 2.0]), None);
    }

    #[test]
    fn bounds_hold_the_values() {
        let ends = [
            [-1.0, -0.5],
            [-0.5, 0.5],
            [0.0, 0.0],
            [1e-40, 1e-39],
            [0.2, 0.3],
            [0.9, 1.5],
            [2.0, 1e30],
            [1.0, f32::INFINITY],
        ];
        for [low, high] in ends {
            for [first, last] in ends {
                let bounds = enclose_channel(Interval::new(low, high), Interval::new(first, last));
                for channel in [low, 0.5 * low + 0.5 * high, high] {
                    for gamma in [first, 0.5 * first + 0.5 * last, last] {
                        let [found, _, _] = evaluated([channel; 3], gamma);
                        assert!(
                            bounds.contains(f64::from(found)),
                            "{channel} ^ {gamma}: {found} outside of {bounds:?}"
                        );
                    }
                }
            }
        }
    }
}
