//! Implicit conversion between socket types, inserted by the compiler where a link joins a vector
//! or colour output to a float input. (A float feeds a vector by repetition, and vectors and
//! colours exchange unchanged; neither needs a node.)
//!
//! Vector to float is the mean, colour to float the luminance of linear Rec. 709 ([`luminance`]) with the weights
//! of Blender's default configuration. Constants are converted by Blender itself, with luminance
//! weights of four digits and a division by three.

use crate::nodes::color_space::{conversion_weights, enclose_luminance, luminance};
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, Simplified, always, map,
};
use crate::scene::SocketType;

/// The node type. It has no counterpart in Blender's interface.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.Conversion",
    label: "(implicit conversion)",
    module: "conversion",
    shader: include_str!("../../shaders/nodes/conversion.wgsl"),
    properties: &[Property::choice("from", &["VECTOR", "COLOR"])],
    inputs: &[InputSocket::vector("Vector", "Vector", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| {
        Box::new(Conversion { luminance: mode.choice("from") == "COLOR", weights: conversion_weights(mode.release()) })
    }),
};

/// Weights that Blender folds constant colours with.
const FOLDED_LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

struct Conversion {
    luminance: bool,
    weights: [f32; 3],
}

impl Evaluate for Conversion {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        if self.luminance {
            map(inputs, [0, 1, 2], outputs[0], |color| luminance(color, self.weights));
        } else {
            map(inputs, [0, 1, 2], outputs[0], |[x, y, z]: [R; 3]| ((x + y) + z) * R::of(1.0 / 3.0));
        }
    }

    fn simplify_linked(&self, _: &[Option<f32>], equal: &dyn Fn(usize, usize) -> bool) -> Option<Simplified> {
        // A float that became a colour or a vector for a node that Cycles has left out becomes itself again.
        (equal(0, 1) && equal(1, 2)).then(|| Simplified::Inputs(vec![0]))
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let [x, y, z] = inputs[..] else { return None };
        let [red, green, blue] = FOLDED_LUMINANCE;
        Some(vec![if self.luminance { (x * red + y * green) + z * blue } else { ((x + y) + z) / 3.0 }])
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let [x, y, z] = [inputs[0], inputs[1], inputs[2]];
        outputs[0] = if self.luminance {
            enclose_luminance([x, y, z], self.weights)
        } else {
            ((x + y) + z) * Interval::point(1.0 / 3.0)
        };
    }
}
