//! Combine Color (`ShaderNodeCombineColor`): a colour from its channels, or from hue, saturation and value (lightness).
//!
//! The inputs are called Red, Green and Blue in every mode. Blender leaves constants to Cycles, which loses
//! the sign of zero channels.

use crate::nodes::color_space::ColorSpace;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, Simplified, always, map_vector,
};
use crate::scene::SocketType;

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeCombineColor",
    label: "Combine Color",
    module: "combine_color",
    shader: include_str!("../../shaders/nodes/combine_color.wgsl"),
    properties: &[Property::choice("mode", &["RGB", "HSV", "HSL"])],
    inputs: &[
        InputSocket::float("Red", "Red", &[0.0], always),
        InputSocket::float("Green", "Green", &[0.0], always),
        InputSocket::float("Blue", "Blue", &[0.0], always),
    ],
    outputs: &[OutputSocket::new("Color", SocketType::Color, always)],
    role: Role::Evaluated(|mode| Box::new(CombineColor { space: ColorSpace::of(mode.choice("mode")) })),
};

struct CombineColor {
    space: ColorSpace,
}

impl Evaluate for CombineColor {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        // The space is known where each loop is compiled.
        match self.space {
            ColorSpace::Rgb => map_vector(inputs, [0, 1, 2], outputs, |place| ColorSpace::Rgb.combine(place)),
            ColorSpace::Hsv => map_vector(inputs, [0, 1, 2], outputs, |place| ColorSpace::Hsv.combine(place)),
            ColorSpace::Hsl => map_vector(inputs, [0, 1, 2], outputs, |place| ColorSpace::Hsl.combine(place)),
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs.copy_from_slice(&self.space.enclose_combine([inputs[0], inputs[1], inputs[2]]));
    }

    fn folds_early(&self) -> bool {
        false
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        // -0 + 0 is +0; nothing else changes.
        (self.space == ColorSpace::Rgb).then(|| inputs.iter().map(|channel| channel + 0.0).collect())
    }

    fn simplify_constants(&self, _inputs: &[Option<f32>]) -> Option<Simplified> {
        // Putting channels side by side is naming them: nothing is left to evaluate.
        (self.space == ColorSpace::Rgb).then(|| Simplified::Renames(vec![0, 1, 2]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_channels_lose_the_sign_of_zero() {
        let node = CombineColor { space: ColorSpace::Rgb };
        let folded = node.fold_constants_late(&[-0.0, 0.5, -1.0]).expect("a rule of its own");
        assert!(folded[0].is_sign_positive());
        assert_eq!(folded, [0.0, 0.5, -1.0]);
    }
}
