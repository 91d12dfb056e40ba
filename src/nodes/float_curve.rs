//! Float Curve (`ShaderNodeFloatCurve`): a curve of a float, blended with the float itself by a factor.

use crate::nodes::curve_mapping::{CurveMapping, Curves, Layout, probes};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeFloatCurve",
    label: "Float Curve",
    module: "float_curve",
    shader: include_str!("../../shaders/nodes/float_curve.wgsl"),
    properties: &[Property::data(
        "mapping",
        |given, place| CurveMapping::read(given, Layout::Float, place),
        || probes(Layout::Float),
    )],
    inputs: &[
        InputSocket::float("Factor", "Factor", &[1.0], always),
        InputSocket::float("Value", "Value", &[1.0], always),
    ],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| Box::new(Curves::new(mode))),
};
