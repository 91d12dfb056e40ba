//! Combine XYZ (`ShaderNodeCombineXYZ`): a vector from its components.

use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, Simplified, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeCombineXYZ",
    label: "Combine XYZ",
    module: "combine_xyz",
    // The compiler names the columns instead of calling anything.
    shader: "",
    properties: &[],
    inputs: &[
        InputSocket::float("X", "X", &[0.0], always),
        InputSocket::float("Y", "Y", &[0.0], always),
        InputSocket::float("Z", "Z", &[0.0], always),
    ],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|_| Box::new(CombineXyz)),
};

struct CombineXyz;

impl Evaluate for CombineXyz {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (output, input) in outputs.iter_mut().zip(inputs) {
            output.copy_from_slice(&input.values[..output.len()]);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs.copy_from_slice(inputs);
    }

    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        // Putting columns side by side is naming them: nothing is left to evaluate.
        Some(Simplified::Renames(vec![0, 1, 2]))
    }
}
