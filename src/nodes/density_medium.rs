//! The medium of a published cloud system as a closure: coefficients in proportion to a density, and one lobe of its phase function.
//!
//! It has no counterpart in Blender and no place in graphs: path tracing builds it from an engine's constants. With the density d,
//! extinction = e max(d, 0) and scattering = s max(d, 0), channel by channel.

use crate::nodes::closure::{ClosureRole, Coefficients, Formula, Phase, Quantity, VolumeClosure, nothing, per_channel};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type of such a closure.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.DensityMedium",
    label: "(medium of an engine)",
    module: "density_medium",
    shader: "",
    properties: &[],
    inputs: &[InputSocket::float("Density", "Density", &[1.0], always)],
    outputs: &[OutputSocket::new("Volume", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Medium(|_| {
        Box::new(DensityMedium { extinction: [0.0; 3], scattering: [0.0; 3], anisotropy: 0.0, alpha: 0.0 })
    })),
};

/// Coefficients per unit of density and metre, and the mean cosine of the lobe.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DensityMedium {
    /// Per channel; at least 0.
    pub extinction: [f64; 3],
    /// Per channel; at least 0.
    pub scattering: [f64; 3],
    /// Of the phase function.
    pub anisotropy: f64,
    /// Draine's alpha; 0 is Henyey and Greenstein's function.
    pub alpha: f64,
}

impl DensityMedium {
    /// As a closure.
    pub fn boxed(self) -> Box<dyn VolumeClosure> {
        Box::new(self)
    }
}

impl Formula for DensityMedium {
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q> {
        let density = inputs[0].positive_part();
        let times = |factors: [f64; 3]| per_channel(|channel| density * Q::of(factors[channel]));
        Coefficients { scattering: times(self.scattering), extinction: times(self.extinction), emission: nothing() }
    }

    fn phase(&self, _: &[f64]) -> Option<Phase> {
        let Self { anisotropy, alpha, .. } = *self;
        Some(if alpha == 0.0 { Phase::HenyeyGreenstein { anisotropy } } else { Phase::Draine { anisotropy, alpha } })
    }
}
