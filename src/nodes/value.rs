//! Value (`ShaderNodeValue`): a stored number.

use super::{NodeType, OutputSocket, Property, Role, SourceValue, always};
use crate::error::Error;
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeValue",
    label: "Value",
    module: "value",
    properties: &[Property::other("value")],
    inputs: &[],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Source(|context, _, _| match context.node.properties.get("value").and_then(|value| value.as_f64()) {
        Some(value) => Ok(SourceValue::Constant(vec![value as f32])),
        None => Err(Error::new(
            format!("{}: property value", context.place),
            context.node.properties.get("value").map_or("nothing".to_owned(), ToString::to_string),
            "the number that the node stores",
            "Write it as \"properties\": {\"value\": 1.0}.",
        )),
    }),
};
