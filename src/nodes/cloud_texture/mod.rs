//! Textures that published clouds read: a node type of ours, with no counterpart in Blender.
//!
//! The input is a place in periods of the texture, which repeats; with n texels along an axis, texel i stands at (i + 1/2) / n. Texels are
//! bytes from 0 to 1, made once in a process ([`bakes`]) and read like any texture ([`crate::nodes::texture_lookup`]).

pub mod bakes;

use crate::base::arrays::{Mapped, each};
use crate::base::texture::TextureHandle;
use crate::nodes::closure::Quantity;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, texture_lookup,
};
use crate::scene::SocketType;
use bakes::{CloudTexture, FeaturePoints};

/// Name of the property that says which texture.
pub const TEXTURE: &str = "texture";

/// Name of the property that says where features of cellular noise lie.
pub const FEATURE_POINTS: &str = "feature_points";

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.CloudTexture",
    label: "(cloud texture)",
    module: "cloud_texture",
    shader: include_str!("../../../shaders/nodes/cloud_texture.wgsl"),
    properties: &[
        Property::choice(TEXTURE, CloudTexture::NAMES),
        Property::choice(FEATURE_POINTS, FeaturePoints::NAMES),
    ],
    inputs: &[InputSocket::vector("Vector", "Vector", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| {
        let texture = CloudTexture::of_name(mode.choice(TEXTURE));
        let points = FeaturePoints::of_name(mode.choice(FEATURE_POINTS));
        Box::new(Lookup(bakes::texture(texture, points)))
    }),
};

struct Lookup(TextureHandle);

/// What taking whole periods away may round in f32, in periods: next to a whole number, half a unit in the last place of 1.
const ROUNDING: f64 = 1.0 / (1_u64 << 23) as f64;

impl Evaluate for Lookup {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        let size = self.0.size().mapped(|side| R::of(side as f32));
        for (index, result) in outputs[0].iter_mut().enumerate() {
            let at = each(|axis| inputs[axis].values[index].fraction() * size[axis] - R::of(0.5));
            *result = texture_lookup::read(&self.0, at);
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let size = self.0.size();
        let number = <Interval as Quantity>::of;
        let at: [Interval; 3] = each(|axis| {
            let [low, high] = inputs[axis].ends();
            let place = Interval::outward(low - ROUNDING, high + ROUNDING, inputs[axis].may_be_nan);
            place * number(size[axis] as f64) - number(0.5)
        });
        outputs[0] = texture_lookup::enclose(&self.0, &at);
    }

    fn textures(&self) -> Vec<TextureHandle> {
        vec![self.0.clone()]
    }

    fn shader_constants(&self) -> String {
        texture_lookup::shader_constant("TEXTURE", &self.0, "TEXELS_0")
    }
}
