//! Principled Volume (`ShaderNodeVolumePrincipled`): the closure that closes a volume material.
//!
//! With density d = max(Density, 0), colour c and absorption colour a, per channel:
//! scattering = max(c d, 0); absorption = d max(1 - c, 0) max(1 - sqrt(a), 0); extinction is
//! (c + the absorption factor) d; emission does not depend on the density. The phase function is
//! Henyey-Greenstein with the given anisotropy. Grid attributes do not exist on a mesh.

use super::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

const fn text(identifier: &'static str) -> InputSocket {
    InputSocket {
        identifier,
        label: identifier,
        kind: SocketType::Shader,
        default: &[],
        generated_when_unlinked: false,
        exists: always,
    }
}

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVolumePrincipled",
    label: "Principled Volume",
    module: "principled_volume",
    shader: "",
    properties: &[],
    inputs: &[
        InputSocket::color("Color", "Color", &[0.5; 3]),
        text("Color Attribute"),
        InputSocket::float("Density", "Density", &[1.0], always),
        text("Density Attribute"),
        InputSocket::float("Anisotropy", "Anisotropy", &[0.0], always),
        InputSocket::color("Absorption Color", "Absorption Color", &[0.0; 3]),
        InputSocket::float("Emission Strength", "Emission Strength", &[0.0], always),
        InputSocket::color("Emission Color", "Emission Color", &[1.0; 3]),
        InputSocket::float("Blackbody Intensity", "Blackbody Intensity", &[0.0], always),
        InputSocket::color("Blackbody Tint", "Blackbody Tint", &[1.0; 3]),
        InputSocket::float("Temperature", "Temperature", &[1000.0], always),
        text("Temperature Attribute"),
        InputSocket::float("Weight", "Weight", &[0.0], always),
    ],
    outputs: &[OutputSocket::new("Volume", SocketType::Shader, always)],
    role: Role::Closure,
};

/// Extinction and scattering per unit density of one channel.
pub fn coefficients_per_density(color: f32, absorption_color: f32) -> (f32, f32) {
    let transparency = absorption_color.max(0.0).sqrt().max(0.0);
    let absorption = (1.0 - color).max(0.0) * (1.0 - transparency).max(0.0);
    (color + absorption, color.max(0.0))
}
