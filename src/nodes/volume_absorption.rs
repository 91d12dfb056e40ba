//! Volume Absorption (`ShaderNodeVolumeAbsorption`).
//!
//! With density d = max(Density, 0) and colour c: extinction = (1 - c) d, scattering 0. Colours are not
//! clamped: above 1 the medium amplifies, in Cycles too.

use crate::nodes::closure::{ClosureRole, Coefficients, Formula, Phase, Quantity, WEIGHT, nothing, per_channel};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVolumeAbsorption",
    label: "Volume Absorption",
    module: "volume_absorption",
    shader: "",
    properties: &[],
    inputs: &[
        InputSocket::color("Color", "Color", &[0.8; 3]),
        InputSocket::float("Density", "Density", &[1.0], always),
        WEIGHT,
    ],
    outputs: &[OutputSocket::new("Volume", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Medium(|_| Box::new(VolumeAbsorption))),
};

struct VolumeAbsorption;

impl Formula for VolumeAbsorption {
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q> {
        let density = inputs[3].positive_part();
        let extinction = per_channel(|channel| (Q::of(1.0) - inputs[channel]) * density);
        Coefficients { scattering: nothing(), extinction, emission: nothing() }
    }
    fn phase(&self, _inputs: &[f64]) -> Option<Phase> {
        None
    }
}
