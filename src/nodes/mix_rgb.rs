//! Mix of old files (`ShaderNodeMixRGB`): blends two colours, the factor limited to [0, 1].
//!
//! The colour mode of Mix under other names: `use_clamp` limits the result, `use_alpha` has no effect.

use crate::nodes::mix::blend::{BLEND_TYPES, Blend};
use crate::nodes::{InputSocket, NodeType, OutputSocket, Property, Role, always};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeMixRGB",
    label: "Mix (Legacy)",
    module: "mix_rgb",
    shader: include_str!("../../shaders/nodes/mix_rgb.wgsl"),
    properties: &[
        Property::choice("blend_type", BLEND_TYPES),
        Property::flag("use_alpha", false),
        Property::flag("use_clamp", false),
    ],
    inputs: &[
        InputSocket::float("Fac", "Factor", &[0.5], always),
        InputSocket::color("Color1", "Color1", &[0.5; 3]),
        InputSocket::color("Color2", "Color2", &[0.5; 3]),
    ],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|mode| {
        let (kind, release) = (mode.choice("blend_type"), mode.release());
        Box::new(Blend { kind, clamp_factor: true, clamp_result: mode.flag("use_clamp"), release })
    }),
};
