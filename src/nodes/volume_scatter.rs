//! Volume Scatter (`ShaderNodeVolumeScatter`): scattering without absorption.
//!
//! With density d = max(Density, 0) and colour c: extinction = c d and scattering = max(c d, 0). A coloured
//! node scatters each channel by its own amount and absorbs nothing: its albedo is 1.

use crate::base::arrays::Mapped;
use crate::nodes::closure;
use crate::nodes::closure::{ClosureRole, Coefficients, Formula, Phase, Quantity, nothing, per_channel};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVolumeScatter",
    label: "Volume Scatter",
    module: "volume_scatter",
    shader: "",
    properties: &[closure::PHASE],
    inputs: &[
        InputSocket::color("Color", "Color", &[0.8; 3]),
        InputSocket::float("Density", "Density", &[1.0], always),
        closure::ANISOTROPY,
        closure::IOR,
        closure::BACKSCATTER,
        closure::ALPHA,
        closure::DIAMETER,
        closure::WEIGHT,
    ],
    outputs: &[OutputSocket::new("Volume", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Medium(|mode| Box::new(VolumeScatter { phase: mode.choice("phase") }))),
};

struct VolumeScatter {
    phase: &'static str,
}

impl Formula for VolumeScatter {
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q> {
        let density = inputs[3].positive_part();
        let extinction = per_channel(|channel| inputs[channel] * density);
        Coefficients { scattering: extinction.mapped(Q::positive_part), extinction, emission: nothing() }
    }
    fn phase(&self, inputs: &[f64]) -> Option<Phase> {
        Some(closure::phase(self.phase, &inputs[4..]))
    }
}
