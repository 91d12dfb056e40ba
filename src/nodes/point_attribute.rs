//! Attribute (`ShaderNodeAttribute`) of type Geometry: the density of a Volume object by its output Fac, or, in probes only, three
//! numbers per point by its output Vector, given beside the positions under the attribute's name. A mesh that renders has no such
//! data, so the node is refused there.

use crate::base::error::Error;
use crate::nodes::{NodeType, OutputSocket, Property, Role, SourceValue, always};
use crate::scene::SocketType;
use crate::scene::volume_grid::DENSITY;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeAttribute",
    label: "Attribute",
    module: "point_attribute",
    shader: "",
    properties: &[Property::choice("attribute_type", &["GEOMETRY"]), Property::other("attribute_name")],
    inputs: &[],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Vector", SocketType::Vector, always),
        OutputSocket::new("Fac", SocketType::Float, always),
        OutputSocket::new("Alpha", SocketType::Float, always),
    ],
    role: Role::Source(|context, _, output| {
        let name = context.node.properties.get("attribute_name").and_then(|value| value.as_str());
        match (output, name) {
            ("Fac", Some(DENSITY)) if context.has_grid => Ok(SourceValue::Grid),
            ("Fac", Some(name)) if context.has_grid => Err(Error::new(
                format!("{}: property attribute_name", context.place),
                format!("\"{name}\""),
                format!("\"{DENSITY}\", the grid of the object"),
                "Name that grid.",
            )),
            ("Vector", Some(name)) => Ok(SourceValue::Attribute(name.to_owned())),
            (_, None) => Err(Error::new(
                format!("{}: property attribute_name", context.place),
                "nothing",
                "the name of a per-point attribute",
                "Give the attribute's name.",
            )),
            (other, _) => Err(Error::new(
                format!("{}: output {other}", context.place),
                format!("the {other} output of Attribute"),
                "the Fac output on a Volume object, or Vector in a probe, which carries three numbers per point",
                "Link that output, or use a Volume object.",
            )),
        }
    }),
};
