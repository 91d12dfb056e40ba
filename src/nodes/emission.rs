//! Emission (`ShaderNodeEmission`), in a volume: radiance per metre = Color * Strength, negative ones too.
//!
//! A value or a colour that is linked where a closure belongs acts as Emission of strength 1.

use crate::nodes::closure::{ClosureRole, Coefficients, Formula, Phase, Quantity, WEIGHT, nothing, per_channel};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeEmission",
    label: "Emission",
    module: "emission",
    shader: "",
    properties: &[],
    inputs: &[
        InputSocket::color("Color", "Color", &[1.0; 3]),
        InputSocket::float("Strength", "Strength", &[1.0], always),
        WEIGHT,
    ],
    outputs: &[OutputSocket::new("Emission", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Medium(|_| Box::new(Emission))),
};

/// The formula.
pub struct Emission;

impl Formula for Emission {
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q> {
        let emission = per_channel(|channel| inputs[channel] * inputs[3]);
        Coefficients { scattering: nothing(), extinction: nothing(), emission }
    }
    fn phase(&self, _inputs: &[f64]) -> Option<Phase> {
        None
    }
}
