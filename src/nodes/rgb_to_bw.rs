//! RGB to BW (`ShaderNodeRGBToBW`): luminance of a colour in linear Rec. 709.
//!
//! The same sum as the implicit conversion of a colour to a float, with weights that differ from its in the last digit since
//! Blender 5.1; and Blender leaves constants to Cycles, so that they have the same weights.

use crate::nodes::color_space::{enclose_luminance, luminance, node_weights};
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always, map};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeRGBToBW",
    label: "RGB to BW",
    module: "rgb_to_bw",
    shader: include_str!("../../shaders/nodes/rgb_to_bw.wgsl"),
    properties: &[],
    inputs: &[InputSocket::color("Color", "Color", &[0.5; 3])],
    outputs: &[OutputSocket::new("Val", SocketType::Float, always)],
    role: Role::Evaluated(|mode| Box::new(RgbToBw { weights: node_weights(mode.release()) })),
};

struct RgbToBw {
    weights: [f32; 3],
}

impl Evaluate for RgbToBw {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        map(inputs, [0, 1, 2], outputs[0], |color| luminance(color, self.weights));
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs[0] = enclose_luminance([inputs[0], inputs[1], inputs[2]], self.weights);
    }

    fn folds_early(&self) -> bool {
        false
    }
}
