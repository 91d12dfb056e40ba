//! A value of the shaded object, inserted by the compiler for Object Info: a constant that neither Blender nor Cycles folds,
//! because Cycles looks it up while it renders. What reads it follows the rules of varying inputs.

use super::real::Real;
use super::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type. It has no counterpart in Blender's interface.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.ObjectValue",
    label: "(value of the object)",
    module: "object_value",
    shader: include_str!("../../shaders/nodes/object_value.wgsl"),
    properties: &[],
    inputs: &[InputSocket::vector("Value", "Value", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Value", SocketType::Vector, always)],
    role: Role::Evaluated(|_| Box::new(ObjectValue)),
};

struct ObjectValue;

impl Evaluate for ObjectValue {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (output, input) in outputs.iter_mut().zip(inputs) {
            output.copy_from_slice(&input.values[..output.len()]);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs.copy_from_slice(inputs);
    }

    fn folds_early(&self) -> bool {
        false
    }
}
