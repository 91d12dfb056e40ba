//! Ranges of input sockets: what Blender keeps a stored value within, and what nodes themselves use of any value.
//!
//! A socket of Blender takes any finite number but for colours, whose components are at least 0; a link may bring anything.
//! Some nodes limit what they read, linked or stored ([`USED`]): beyond the range, the value at its end holds. Other rules at
//! extreme values (divisions by 0, logarithms of negative numbers) are the node's own.

use crate::nodes::Mode;
use crate::scene::SocketType;

/// What Blender limits a stored component of a socket to: no limit is an infinity.
pub fn stored(kind: SocketType) -> [f32; 2] {
    match kind {
        SocketType::Color => [0.0, f32::INFINITY],
        _ => [f32::NEG_INFINITY, f32::INFINITY],
    }
}

/// The range that a node limits an input to.
pub struct Used {
    /// Blender's `bl_idname`.
    pub type_name: &'static str,
    /// The socket.
    pub identifier: &'static str,
    /// Lower and upper end; no limit is an infinity.
    pub range: [f32; 2],
    /// Where the node does so, in words; empty: everywhere.
    pub condition: &'static str,
    /// Whether it does so in a mode.
    pub holds: fn(&Mode) -> bool,
}

const fn used(type_name: &'static str, identifier: &'static str, low: f32, high: f32) -> Used {
    Used { type_name, identifier, range: [low, high], condition: "", holds: super::always }
}

const fn with_clamp_factor(identifier: &'static str) -> Used {
    Used {
        type_name: "ShaderNodeMix",
        identifier,
        range: [0.0, 1.0],
        condition: "with clamp_factor",
        holds: |mode| mode.flag("clamp_factor"),
    }
}

const NONE: f32 = f32::INFINITY;

/// Every input that its node limits.
pub static USED: &[Used] = &[
    used("ShaderNodeBlackbody", "Temperature", -NONE, 12_000.0),
    used("ShaderNodeMapRange", "Steps", 0.0, NONE),
    used("ShaderNodeMapRange", "Steps_FLOAT3", 0.0, NONE),
    with_clamp_factor("Factor_Float"),
    with_clamp_factor("Factor_Vector"),
    used("ShaderNodeMixRGB", "Fac", 0.0, 1.0),
    used("ShaderNodeMixShader", "Fac", 0.0, 1.0),
    used("ShaderNodeTexGabor", "Anisotropy", 0.0, 1.0),
    used("ShaderNodeTexGabor", "Frequency", 0.001, NONE),
    used("ShaderNodeTexNoise", "Detail", 0.0, 15.0),
    used("ShaderNodeTexNoise", "Roughness", 0.0, NONE),
    used("ShaderNodeTexVoronoi", "Detail", 0.0, 15.0),
    used("ShaderNodeTexVoronoi", "Randomness", 0.0, 1.0),
    used("ShaderNodeTexVoronoi", "Roughness", 0.0, 1.0),
    used("ShaderNodeTexVoronoi", "Smoothness", 0.0, 1.0),
    used("ShaderNodeValToRGB", "Fac", 0.0, 1.0),
    used("ShaderNodeVolumeAbsorption", "Density", 0.0, NONE),
    used("ShaderNodeVolumeCoefficients", "Anisotropy", -0.999, 0.999),
    used("ShaderNodeVolumeCoefficients", "Backscatter", -0.499, 0.499),
    used("ShaderNodeVolumeCoefficients", "Diameter", 0.0, NONE),
    used("ShaderNodeVolumeCoefficients", "IOR", 1.001, NONE),
    used("ShaderNodeVolumePrincipled", "Anisotropy", -0.999, 0.999),
    used("ShaderNodeVolumePrincipled", "Density", 0.0, NONE),
    used("ShaderNodeVolumePrincipled", "Temperature", 0.0, NONE),
    used("ShaderNodeVolumeScatter", "Anisotropy", -0.999, 0.999),
    used("ShaderNodeVolumeScatter", "Backscatter", -0.499, 0.499),
    used("ShaderNodeVolumeScatter", "Density", 0.0, NONE),
    used("ShaderNodeVolumeScatter", "Diameter", 0.0, NONE),
    used("ShaderNodeVolumeScatter", "IOR", 1.001, NONE),
];

/// The range that a node limits an input to, if it does.
pub fn used_of(type_name: &str, identifier: &str) -> Option<&'static Used> {
    USED.iter().find(|used| used.type_name == type_name && used.identifier == identifier)
}
