//! Geometry (`ShaderNodeNewGeometry`) in a volume: the position in the world.
//!
//! The other outputs depend on the ray or on a surface: refused.

use crate::base::error::Error;
use crate::nodes::{NodeType, OutputSocket, Role, SourceValue, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeNewGeometry",
    label: "Geometry",
    module: "geometry",
    shader: "",
    properties: &[],
    inputs: &[],
    outputs: &[
        OutputSocket::new("Position", SocketType::Vector, always),
        OutputSocket::new("Normal", SocketType::Vector, always),
        OutputSocket::new("Tangent", SocketType::Vector, always),
        OutputSocket::new("True Normal", SocketType::Vector, always),
        OutputSocket::new("Incoming", SocketType::Vector, always),
        OutputSocket::new("Parametric", SocketType::Vector, always),
        OutputSocket::new("Backfacing", SocketType::Float, always),
        OutputSocket::new("Pointiness", SocketType::Float, always),
        OutputSocket::new("Random Per Island", SocketType::Float, always),
    ],
    role: Role::Source(|context, _, output| match output {
        "Position" => {
            let rows = context.matrix_world;
            Ok(SourceValue::Affine([rows[0], rows[1], rows[2]]))
        }
        other => Err(Error::new(
            format!("{}: output {other}", context.place),
            format!("the {other} output of Geometry"),
            "Position (the others depend on the ray or on a surface, so they are no field)",
            "Use the Position output.",
        )),
    }),
};
