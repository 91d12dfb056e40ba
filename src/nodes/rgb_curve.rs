//! RGB Curves (`ShaderNodeRGBCurve`): a combined curve and then one per channel of a colour, blended with the
//! colour itself by a factor.

use crate::nodes::curve_mapping::{CurveMapping, Curves, Layout, probes};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeRGBCurve",
    label: "RGB Curves",
    module: "rgb_curve",
    shader: include_str!("../../shaders/nodes/rgb_curve.wgsl"),
    properties: &[Property::data(
        "mapping",
        |given, place| CurveMapping::read(given, Layout::Color, place),
        || probes(Layout::Color),
    )],
    inputs: &[InputSocket::float("Fac", "Factor", &[1.0], always), InputSocket::color("Color", "Color", &[1.0; 3])],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|mode| Box::new(Curves::new(mode))),
};
