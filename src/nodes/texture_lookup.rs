//! The value of a texture at a place: the one read of all textures, of grids, caches, averages and published densities.
//!
//! Coordinates are indices of the texture; values stand at whole ones and are interpolated along x, then y, then z. A Volume object's
//! grid is 0 outside, so that the outermost value fades over one more voxel: that is what Cycles 5.0 does with a Volume object of
//! interpolation LINEAR (measured; docs/volume-objects.md).

use crate::base::arrays::{Mapped, each};
use crate::base::texture::{Outside, TexelFormat, Texture, TextureFilter, TextureHandle};
use crate::nodes::real::Real;
use crate::nodes::{Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Role, always};
use crate::scene::SocketType;

/// The node type. It has no counterpart in Blender's interface. Its mode carries the texture.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.TextureLookup",
    label: "(texture)",
    module: "texture_lookup",
    shader: include_str!("../../shaders/nodes/texture_lookup.wgsl"),
    properties: &[],
    inputs: &[InputSocket::vector("Index", "Index", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Value", SocketType::Float, always)],
    role: Role::Evaluated(|mode| Box::new(Lookup(mode.texture().clone()))),
};

struct Lookup(TextureHandle);

/// Rounding in f32, as a share of the largest value: of three interpolations behind each other, each with a difference, a product and a
/// sum, and of the byte that becomes a number (a division of 2.5 units in the last place in WGSL, a product, a sum, a difference).
const ROUNDING: f64 = 26.0 / (1_u64 << 24) as f64;

/// The value at an index.
#[inline(always)]
pub fn read<R: Real>(texture: &Texture, mut at: [R; 3]) -> R {
    if texture.outside() == Outside::Clamp {
        for axis in 0..3 {
            // NaN stays to be seen.
            if !at[axis].is_nan() {
                at[axis] = at[axis].clamped(R::of(0.0), R::of((texture.size()[axis] - 1) as f32));
            }
        }
    }
    if texture.filter() == TextureFilter::Nearest {
        let index = at.mapped(|coordinate| (coordinate + R::of(0.5)).floor().to_int());
        return R::of(texture.value(each(|axis| texture.inside(axis, index[axis]))));
    }
    let floors = at.mapped(Real::floor);
    let fraction: [R; 3] = each(|axis| at[axis] - floors[axis]);
    let corners = texture.corners(floors.mapped(Real::to_int)).mapped(R::of);
    let along_x = |low: usize| corners[low].lerp(corners[low + 1], fraction[0]);
    let along_y = |low: usize| along_x(low).lerp(along_x(low + 2), fraction[1]);
    along_y(0).lerp(along_y(4), fraction[2])
}

/// Encloses [`read`] over a box of indices, in every evaluator.
pub fn enclose(texture: &Texture, at: &[Interval]) -> Interval {
    let may_be_nan = at.iter().any(|coordinate| coordinate.may_be_nan || !coordinate.is_finite());
    // Nearest rounds half a texel further, which the next whole index covers as well.
    let range = |pick: fn([f64; 2]) -> f64, step: f64| {
        each(|axis| (pick(at[axis].ends()).floor() + step).clamp(-4.0e9, 4.0e9) as i64)
    };
    let [low, high] = texture.range(range(|ends| ends[0], 0.0), range(|ends| ends[1], 1.0));
    if low.is_nan() {
        return Interval::EVERYTHING;
    }
    let error = ROUNDING * f64::from(low.abs().max(high.abs()));
    Interval::outward(f64::from(low) - error, f64::from(high) + error, may_be_nan)
}

/// What a shader calls the texture: `const TEXTURE_<name>: texture::Texture`, the texels beginning at a word of the program's data.
pub fn shader_constant(name: &str, texture: &Texture, first_word: &str) -> String {
    let [x, y, z] = texture.size();
    let [low, high] = texture.texels().stored_range();
    let format = match texture.texels().format() {
        TexelFormat::F32 => "F32",
        TexelFormat::F16 => "F16",
        TexelFormat::Unorm8 => "UNORM8",
    };
    let outside = match texture.outside() {
        Outside::Clamp => "CLAMP",
        Outside::Repeat => "REPEAT",
        Outside::Zero => "ZERO",
    };
    let filter = match texture.filter() {
        TextureFilter::Nearest => "NEAREST",
        TextureFilter::Trilinear => "TRILINEAR",
    };
    format!(
        "const {name} = texture::Texture(vec3i({x}, {y}, {z}), {first_word}, texture::{format}, texture::{outside}, \
         texture::{filter}, {low:?}f, {high:?}f);\n"
    )
}

impl Evaluate for Lookup {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (index, result) in outputs[0].iter_mut().enumerate() {
            *result = read(&self.0, each(|axis| inputs[axis].values[index]));
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs[0] = enclose(&self.0, inputs);
    }

    fn textures(&self) -> Vec<TextureHandle> {
        vec![self.0.clone()]
    }

    fn shader_constants(&self) -> String {
        shader_constant("TEXTURE", &self.0, "TEXELS_0")
    }
}
