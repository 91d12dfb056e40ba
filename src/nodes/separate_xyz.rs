//! Separate XYZ (`ShaderNodeSeparateXYZ`): the components of a vector.

use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeSeparateXYZ",
    label: "Separate XYZ",
    module: "separate_xyz",
    // The compiler names the columns instead of calling anything.
    shader: "",
    properties: &[],
    inputs: &[InputSocket::vector("Vector", "Vector", &[0.0; 3], always)],
    outputs: &[
        OutputSocket::new("X", SocketType::Float, always),
        OutputSocket::new("Y", SocketType::Float, always),
        OutputSocket::new("Z", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(SeparateXyz { axes: (0..3).filter(|&axis| mode.wants(["X", "Y", "Z"][axis])).collect() })
    }),
};

struct SeparateXyz {
    axes: Vec<usize>,
}

impl Evaluate for SeparateXyz {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (output, &axis) in outputs.iter_mut().zip(&self.axes) {
            output.copy_from_slice(&inputs[axis].values[..output.len()]);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (output, &axis) in outputs.iter_mut().zip(&self.axes) {
            *output = inputs[axis];
        }
    }

    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<super::Simplified> {
        // Taking a vector apart is naming its columns: nothing is left to evaluate.
        Some(super::Simplified::Renames(self.axes.clone()))
    }
}
