//! Vector Curves (`ShaderNodeVectorCurve`): a curve per component of a vector, blended with the vector itself by a
//! factor.

use crate::nodes::curve_mapping::{CurveMapping, Curves, Layout, probes};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVectorCurve",
    label: "Vector Curves",
    module: "vector_curve",
    shader: include_str!("../../shaders/nodes/vector_curve.wgsl"),
    properties: &[Property::data(
        "mapping",
        |given, place| CurveMapping::read(given, Layout::Vector, place),
        || probes(Layout::Vector),
    )],
    inputs: &[
        InputSocket::float("Fac", "Factor", &[1.0], always),
        InputSocket::vector("Vector", "Vector", &[0.0; 3], always),
    ],
    outputs: &[OutputSocket::new("Vector", SocketType::Vector, always)],
    role: Role::Evaluated(|mode| Box::new(Curves::new(mode))),
};
