//! Value (`ShaderNodeValue`): a stored number.

use crate::base::error::Error;
use crate::nodes::{NodeType, OutputSocket, Role, SourceValue, always};
use crate::scene::{Input, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeValue",
    label: "Value",
    module: "value",
    shader: "",
    properties: &[],
    inputs: &[],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Source(|context, _, socket| match context.node.outputs.get(socket) {
        Some(Input::Number(value)) => Ok(SourceValue::Constant(vec![*value])),
        other => Err(Error::new(
            format!("{}: output {socket}", context.place),
            other.map_or("nothing".to_owned(), |found| format!("{found:?}")),
            "the number that the node stores",
            "Write it as \"outputs\": {\"Value\": 1.0}.",
        )),
    }),
};
