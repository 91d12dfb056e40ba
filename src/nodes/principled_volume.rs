//! Principled Volume (`ShaderNodeVolumePrincipled`).
//!
//! With density d = max(Density, 0), colour c and absorption colour a, per channel: scattering = max(c d, 0);
//! extinction = (c + max(1 - c, 0) max(1 - sqrt(max(a, 0)), 0)) d. Emission does not depend on the density: it
//! is max(Emission Strength, 0) * Emission Color plus the blackbody. The phase function is Henyey-Greenstein.
//! On a Volume object the density is max(Density, 0) times the grid that Density Attribute names, `density` where it says nothing;
//! attributes of grids do not exist on a mesh.

use crate::base::arrays::Mapped;
use crate::nodes::blackbody;
use crate::nodes::closure::{ClosureRole, Coefficients, Formula, Phase, Quantity, WEIGHT, per_channel, triple};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Role, always};
use crate::scene::{Release, SocketType};

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeVolumePrincipled",
    label: "Principled Volume",
    module: "principled_volume",
    shader: "",
    properties: &[],
    inputs: &[
        InputSocket::color("Color", "Color", &[0.5; 3]),
        InputSocket::text("Color Attribute"),
        InputSocket::float("Density", "Density", &[1.0], always).times_grid("Density Attribute"),
        InputSocket::text("Density Attribute"),
        InputSocket::float("Anisotropy", "Anisotropy", &[0.0], always),
        InputSocket::color("Absorption Color", "Absorption Color", &[0.0; 3]),
        InputSocket::float("Emission Strength", "Emission Strength", &[0.0], always),
        InputSocket::color("Emission Color", "Emission Color", &[1.0; 3]),
        InputSocket::float("Blackbody Intensity", "Blackbody Intensity", &[0.0], always),
        InputSocket::color("Blackbody Tint", "Blackbody Tint", &[1.0; 3]),
        InputSocket::float("Temperature", "Temperature", &[1000.0], always),
        InputSocket::text("Temperature Attribute"),
        WEIGHT,
    ],
    outputs: &[OutputSocket::new("Volume", SocketType::Shader, always)],
    role: Role::Closure(ClosureRole::Medium(|mode| Box::new(PrincipledVolume { release: mode.release() }))),
};

struct PrincipledVolume {
    /// Whose blackbody it has.
    release: Release,
}

/// Where each input's components begin.
mod at {
    pub const COLOR: usize = 0;
    pub const DENSITY: usize = 3;
    pub const ANISOTROPY: usize = 4;
    pub const ABSORPTION_COLOR: usize = 5;
    pub const EMISSION_STRENGTH: usize = 8;
    pub const EMISSION_COLOR: usize = 9;
    pub const BLACKBODY_INTENSITY: usize = 12;
    pub const BLACKBODY_TINT: usize = 13;
    pub const TEMPERATURE: usize = 16;
}

impl Formula for PrincipledVolume {
    fn coefficients<Q: Quantity>(&self, inputs: &[Q]) -> Coefficients<Q> {
        let density = inputs[at::DENSITY].positive_part();
        let (color, absorption) = (triple(inputs, at::COLOR), triple(inputs, at::ABSORPTION_COLOR));
        let strength = inputs[at::EMISSION_STRENGTH].positive_part();
        let emission_color = triple(inputs, at::EMISSION_COLOR);
        let glow = blackbody::emission(
            inputs[at::BLACKBODY_INTENSITY],
            triple(inputs, at::BLACKBODY_TINT),
            inputs[at::TEMPERATURE],
            self.release,
        );
        Coefficients {
            scattering: color.mapped(|color| (color * density).positive_part()),
            extinction: per_channel(|channel| extinction(color[channel], absorption[channel]) * density),
            emission: per_channel(|channel| strength * emission_color[channel] + glow[channel]),
        }
    }
    fn phase(&self, inputs: &[f64]) -> Option<Phase> {
        Some(Phase::HenyeyGreenstein { anisotropy: inputs[at::ANISOTROPY] })
    }
}

/// Extinction per unit density. It grows with the colour and falls with the absorption colour.
fn extinction<Q: Quantity>(color: Q, absorption_color: Q) -> Q {
    color.increasing_in_both(Q::of(0.0) - absorption_color, |color, negative| {
        let opacity = 1.0 - (-negative).max(0.0).sqrt();
        // Of NaN, `max` would keep the number.
        let color_and_nan = color + 0.0 * negative;
        color_and_nan + (1.0 - color).max(0.0) * opacity.max(0.0)
    })
}
