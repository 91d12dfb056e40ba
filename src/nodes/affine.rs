//! Affine image of a position, inserted by the compiler for Generated coordinates and for the
//! coordinates of another object: `X x + Y y + Z z + Translation`, added from the left.

use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type. It has no counterpart in Blender's interface.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.Affine",
    label: "(coordinate transform)",
    module: "affine",
    shader: include_str!("../../shaders/nodes/affine.wgsl"),
    properties: &[],
    inputs: &[
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always),
        InputSocket::vector("X", "X", &[1.0, 0.0, 0.0], always),
        InputSocket::vector("Y", "Y", &[0.0, 1.0, 0.0], always),
        InputSocket::vector("Z", "Z", &[0.0, 0.0, 1.0], always),
        InputSocket::vector("Translation", "Translation", &[0.0; 3], always),
    ],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|_| Box::new(Affine)),
};

struct Affine;

impl Evaluate for Affine {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (axis, output) in outputs.iter_mut().enumerate() {
            for (index, result) in output.iter_mut().enumerate() {
                let at = |column: usize| inputs[column].values[index];
                *result = ((at(0) * at(3 + axis) + at(1) * at(6 + axis)) + at(2) * at(9 + axis)) + at(12 + axis);
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        for (axis, output) in outputs.iter_mut().enumerate() {
            let term = |column: usize| inputs[column] * inputs[3 * (column + 1) + axis];
            *output = ((term(0) + term(1)) + term(2)) + inputs[12 + axis];
        }
    }
}
