//! Mix Shader (`ShaderNodeMixShader`): the coefficients of the first closure times 1 - f and those of the
//! second times f are added, f being Fac clamped to [0, 1]. An input without link adds nothing.

use crate::nodes::closure::ClosureRole;
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeMixShader",
    label: "Mix Shader",
    module: "mix_shader",
    shader: "",
    properties: &[],
    inputs: &[
        InputSocket::float("Fac", "Factor", &[0.5], always),
        InputSocket::shader("Shader"),
        InputSocket::shader("Shader_001"),
    ],
    outputs: &[OutputSocket::new("Shader", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Mix),
};
