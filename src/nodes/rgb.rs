//! RGB (`ShaderNodeRGB`, labelled Color): a stored colour in linear Rec. 709; its alpha is dropped. Blender has no
//! function for it, so only Cycles takes it for a constant.

use crate::base::error::Error;
use crate::nodes::{NodeType, OutputSocket, Role, SourceValue, always};
use crate::scene::{Input, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeRGB",
    label: "Color",
    module: "rgb",
    shader: "",
    properties: &[],
    inputs: &[],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Source(|context, _, socket| match context.node.outputs.get(socket) {
        Some(Input::List(channels)) if (3..=4).contains(&channels.len()) => {
            Ok(SourceValue::LateConstant(channels[..3].to_vec()))
        }
        other => Err(Error::new(
            format!("{}: output {socket}", context.place),
            other.map_or("nothing".to_owned(), |found| format!("{found:?}")),
            "the colour that the node stores: three or four numbers",
            "Write it as \"outputs\": {\"Color\": [0.5, 0.5, 0.5, 1.0]}.",
        )),
    }),
};
