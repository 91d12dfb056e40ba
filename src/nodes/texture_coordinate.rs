//! Texture Coordinate (`ShaderNodeTexCoord`) in a volume: Object and Generated.
//!
//! Object is the position in the frame of the shaded object, or of another object when one is
//! chosen. Normal, UV, Camera, Window and Reflection depend on the ray or on a surface: refused.

use crate::base::arrays::Mapped;
use crate::base::error::{Error, Result};
use crate::nodes::{NodeType, OutputSocket, Property, Role, SourceContext, SourceValue, always};
use crate::scene::{SocketType, matrix_to_glam};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexCoord",
    label: "Texture Coordinate",
    module: "texture_coordinate",
    shader: "",
    properties: &[Property::other("object"), Property::flag("from_instancer", false)],
    inputs: &[],
    outputs: &[
        OutputSocket::new("Generated", SocketType::Vector, always),
        OutputSocket::new("Normal", SocketType::Vector, always),
        OutputSocket::new("UV", SocketType::Vector, always),
        OutputSocket::new("Object", SocketType::Vector, always),
        OutputSocket::new("Camera", SocketType::Vector, always),
        OutputSocket::new("Window", SocketType::Vector, always),
        OutputSocket::new("Reflection", SocketType::Vector, always),
    ],
    role: Role::Source(|context, mode, output| {
        if mode.flag("from_instancer") {
            return Err(Error::new(
                format!("{}: property from_instancer", context.place),
                "true",
                "false (instances are not supported)",
                "Switch From Instancer off in the Texture Coordinate node.",
            ));
        }
        match output {
            "Object" => object_coordinates(context),
            "Generated" => Ok(SourceValue::Generated),
            other => Err(Error::new(
                format!("{}: output {other}", context.place),
                format!("the {other} output of Texture Coordinate"),
                "Object or Generated (the others depend on the ray or on a surface, so they are no field)",
                "Use the Object output.",
            )),
        }
    }),
};

fn object_coordinates(context: &SourceContext) -> Result<SourceValue> {
    let chosen = context.node.properties.get("object").filter(|value| !value.is_null());
    let Some(object) = chosen else { return Ok(SourceValue::Position) };
    let place = format!("{}: property object", context.place);
    let wrong = |found: String| {
        Error::new(
            place.clone(),
            found,
            "null or {\"name\", \"matrix_world\"} with an invertible 4x4 matrix",
            "Export the scene again.",
        )
    };
    let matrix: crate::scene::Matrix = object
        .get("matrix_world")
        .and_then(|value| serde_json::from_value(value.clone()).ok())
        .ok_or_else(|| wrong(object.to_string()))?;
    let other = matrix_to_glam(&matrix);
    if other.determinant().abs() < 1e-30 {
        return Err(wrong("a matrix that cannot be inverted".into()));
    }
    // Inverted in f64 and rounded once, as the node's definition asks.
    let combined = (other.inverse() * matrix_to_glam(context.matrix_world)).transpose().to_cols_array_2d();
    Ok(SourceValue::Affine([0, 1, 2].mapped(|row: usize| combined[row].mapped(|x| x as f32))))
}
