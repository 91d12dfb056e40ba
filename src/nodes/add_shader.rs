//! Add Shader (`ShaderNodeAddShader`): the coefficients of both closures are added. An input without link
//! adds nothing.

use crate::nodes::closure::ClosureRole;
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeAddShader",
    label: "Add Shader",
    module: "add_shader",
    shader: "",
    properties: &[],
    inputs: &[InputSocket::shader("Shader"), InputSocket::shader("Shader_001")],
    outputs: &[OutputSocket::new("Shader", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Add),
};
