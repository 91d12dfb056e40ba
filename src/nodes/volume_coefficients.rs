//! Volume Coefficients (`ShaderNodeVolumeCoefficients`): the coefficients themselves.
//!
//! Extinction = Scatter Coefficients + Absorption Coefficients, as they are, negative ones too; scattering =
//! max(Scatter Coefficients, 0); emission = Emission Coefficients.

use crate::base::arrays::Mapped;
use crate::nodes::closure;
use crate::nodes::closure::{ClosureRole, Coefficients, Formula, Phase, Quantity, per_channel, triple};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVolumeCoefficients",
    label: "Volume Coefficients",
    module: "volume_coefficients",
    shader: "",
    properties: &[closure::PHASE],
    inputs: &[
        closure::WEIGHT,
        InputSocket::vector("Absorption Coefficients", "Absorption Coefficients", &[1.0; 3], always),
        InputSocket::vector("Scatter Coefficients", "Scatter Coefficients", &[1.0; 3], always),
        closure::ANISOTROPY,
        closure::IOR,
        closure::BACKSCATTER,
        closure::ALPHA,
        closure::DIAMETER,
        InputSocket::vector("Emission Coefficients", "Emission Coefficients", &[0.0; 3], always),
    ],
    outputs: &[OutputSocket::new("Volume", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Medium(|mode| Box::new(VolumeCoefficients { phase: mode.choice("phase") }))),
};

struct VolumeCoefficients {
    phase: &'static str,
}

impl Formula for VolumeCoefficients {
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q> {
        let (absorption, scatter) = (triple(inputs, 0), triple(inputs, 3));
        Coefficients {
            scattering: scatter.mapped(Q::positive_part),
            extinction: per_channel(|channel| absorption[channel] + scatter[channel]),
            // Between them stand the phase function's own inputs, as many as it has.
            emission: triple(inputs, inputs.len() - 3),
        }
    }
    fn phase(&self, inputs: &[f64]) -> Option<Phase> {
        Some(closure::phase(self.phase, &inputs[6..]))
    }
}
