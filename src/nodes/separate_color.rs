//! Separate Color (`ShaderNodeSeparateColor`): the channels of a colour, or its hue, saturation and value or lightness.
//!
//! The outputs are called Red, Green and Blue in every mode. Blender leaves constants to Cycles.

use crate::nodes::color_space::{ColorSpace, rgb_to_hsv_of_constant};
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, Simplified, always, vector_at,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeSeparateColor",
    label: "Separate Color",
    module: "separate_color",
    shader: include_str!("../../shaders/nodes/separate_color.wgsl"),
    properties: &[Property::choice("mode", &["RGB", "HSV", "HSL"])],
    inputs: &[InputSocket::color("Color", "Color", &[0.8; 3])],
    outputs: &[
        OutputSocket::new("Red", SocketType::Float, always),
        OutputSocket::new("Green", SocketType::Float, always),
        OutputSocket::new("Blue", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(SeparateColor {
            space: ColorSpace::of(mode.choice("mode")),
            axes: (0..3).filter(|&axis| mode.wants(["Red", "Green", "Blue"][axis])).collect(),
        })
    }),
};

struct SeparateColor {
    space: ColorSpace,
    /// Which coordinates are wanted.
    axes: Vec<usize>,
}

impl Evaluate for SeparateColor {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let points = outputs.first().map_or(0, |output| output.len());
        for index in 0..points {
            let coordinates = self.space.separate(vector_at(inputs, 0, index));
            for (output, &axis) in outputs.iter_mut().zip(&self.axes) {
                output[index] = coordinates[axis];
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let coordinates = self.space.enclose_separate([inputs[0], inputs[1], inputs[2]]);
        for (output, &axis) in outputs.iter_mut().zip(&self.axes) {
            *output = coordinates[axis];
        }
    }

    fn folds_early(&self) -> bool {
        false
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let [red, green, blue] = *inputs else { return None };
        let channels = rgb_to_hsv_of_constant([red, green, blue]);
        (self.space == ColorSpace::Hsv).then(|| self.axes.iter().map(|&axis| channels[axis]).collect())
    }

    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        // Channels are the columns themselves: nothing is left to evaluate.
        (self.space == ColorSpace::Rgb).then(|| Simplified::Renames(self.axes.clone()))
    }
}
