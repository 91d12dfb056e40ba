//! Clamp (`ShaderNodeClamp`): limits a value to [Min, Max]; mode Range swaps reversed limits.

use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, map};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeClamp",
    label: "Clamp",
    module: "clamp",
    shader: include_str!("../../shaders/nodes/clamp.wgsl"),
    properties: &[Property::choice("clamp_type", &["MINMAX", "RANGE"])],
    inputs: &[
        InputSocket::float("Value", "Value", &[1.0], always),
        InputSocket::float("Min", "Min", &[0.0], always),
        InputSocket::float("Max", "Max", &[1.0], always),
    ],
    outputs: &[OutputSocket::new("Result", SocketType::Float, always)],
    role: Role::Evaluated(|mode| Box::new(Clamp { swaps: mode.choice("clamp_type") == "RANGE" })),
};

struct Clamp {
    swaps: bool,
}

impl Evaluate for Clamp {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        map(inputs, [0, 1, 2], outputs[0], |[value, low, high]: [R; 3]| {
            if self.swaps && low > high { value.clamped(high, low) } else { value.clamped(low, high) }
        });
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let [value, low, high] = [inputs[0], inputs[1], inputs[2]];
        let straight = value.clamped(low, high);
        outputs[0] = if !self.swaps || low.high <= high.low {
            straight
        } else if low.low > high.high && !low.may_be_nan && !high.may_be_nan {
            value.clamped(high, low)
        } else {
            straight.hull(value.clamped(high, low))
        };
    }
}
