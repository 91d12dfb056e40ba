//! The density of the seeded, baked, masked Perlin-FBM cloud of a published three.js engine: a node type of ours.
//!
//! A byte volume is baked from gradient noise that is made periodic by blending eight shifted copies ([`bake`]), looked up
//! several periods across a box, and masked by the signed distance of a deformed sphere ([`mask`]). Random numbers and
//! permutations come from a seed ([`random`]), gradient noise from a permutation ([`noise`]). The original computes in double
//! precision on the CPU; what is deterministic there is equal here to the byte.
//!
//! The input is a place of the *local box* from -0.5 to 0.5 on every axis, whose y axis points up.

pub mod bake;
pub mod mask;
pub mod noise;
pub mod random;
pub mod rows;

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::base::texture::{Outside, Texels, Texture, TextureFilter, TextureHandle};
use crate::nodes::closure::Quantity;
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Data, Evaluate, InputSocket, Interval, NodeEvaluator, NodeType, OutputSocket, Property, Role, always,
    texture_lookup,
};
use crate::scene::SocketType;
use bake::Bake;
use mask::Mask;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::{Arc, OnceLock};

/// Name of the property that holds [`Parameters`].
pub const PARAMETERS: &str = "parameters";

/// The node type. It has no counterpart in Blender.
pub static TYPE: NodeType = NodeType {
    type_name: "cloudparity.PerlinFbm",
    label: "(Perlin-FBM cloud)",
    module: "perlin_fbm",
    shader: include_str!("../../../shaders/nodes/perlin_fbm.wgsl"),
    properties: &[Property::data(PARAMETERS, read, Vec::new)],
    inputs: &[InputSocket::vector("Vector", "Vector", &[0.0; 3], always)],
    outputs: &[OutputSocket::new("Density", SocketType::Float, always)],
    role: Role::Evaluated(build),
};

fn read(given: Option<&serde_json::Value>, place: &str) -> Result<Data> {
    let parameters = match given {
        None => Parameters::default(),
        Some(value) => serde_path_to_error::deserialize(value).map_err(|cause| {
            Error::new(
                format!("{place}: {}", cause.path()),
                cause.inner().to_string(),
                "the parameter's type",
                "Correct it.",
            )
        })?,
    };
    Ok(Data::PerlinFbm(Arc::new(Cloud::new(parameters)?)))
}

fn build(mode: &crate::nodes::Mode) -> Box<dyn NodeEvaluator> {
    match mode.data(PARAMETERS) {
        Data::PerlinFbm(cloud) => Box::new(Density(Arc::clone(cloud))),
        _ => unreachable!("the property reads clouds"),
    }
}

/// A byte texture of side `side`: one channel, x fastest.
pub struct Volume {
    /// Texels per axis.
    pub side: usize,
    /// `side`^3 texels.
    pub texels: Arc<[u8]>,
    outside: Outside,
    texture: OnceLock<TextureHandle>,
}

impl Volume {
    /// A texture of `side`^3 texels.
    pub fn new(side: usize, texels: Vec<u8>, outside: Outside) -> Self {
        Self { side, texels: texels.into(), outside, texture: OnceLock::new() }
    }

    /// A texture from the byte of each texel, on all cores.
    fn bake(side: usize, outside: Outside, texel: impl Fn([usize; 3]) -> u8 + Sync) -> Self {
        let texels = (0..side.pow(3))
            .into_par_iter()
            .with_min_len(side)
            .map(|index| texel([index % side, index / side % side, index / (side * side)]))
            .collect();
        Self::new(side, texels, outside)
    }

    /// What programs read: values from 0 to 1, of the same bytes, made when it is asked for first. At a coordinate c in [0, 1] its index
    /// is c `side` - 0.5.
    pub fn texture(&self) -> &TextureHandle {
        self.texture.get_or_init(|| {
            let texels = Texels::Unorm8 { bytes: Arc::clone(&self.texels), range: [0.0, 1.0] };
            TextureHandle::new(Texture::new([self.side; 3], texels, TextureFilter::Trilinear, self.outside))
        })
    }
}

/// Its texture's: what depends on a cloud is known by this text, and a volume has millions of texels.
impl std::fmt::Debug for Volume {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.texture().fmt(out)
    }
}

/// What makes the density of the cloud.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// The baked volume.
    pub bake: Bake,
    /// Texels of it per axis.
    pub texture_size: usize,
    /// The mask.
    pub mask: Mask,
    /// Periods of the volume across the box.
    pub tiling: f64,
    /// Animation offset in periods.
    pub offset: [f64; 3],
    /// Texel values below it are empty.
    pub threshold: f64,
    /// Density of a texel of value 1 where the mask is 1; not negative.
    pub density_multiplier: f64,
    /// Where values come from.
    pub evaluation: Evaluation,
    /// The mask alone: every texel counts as 1.
    pub shows_mask: bool,
}

impl Default for Parameters {
    /// The engine's defaults with the mask that works.
    fn default() -> Self {
        Self {
            bake: Bake::default(),
            texture_size: 96,
            mask: Mask::default(),
            tiling: 2.0,
            offset: [0.0; 3],
            threshold: 0.0,
            density_multiplier: 50.0,
            evaluation: Evaluation::Baked,
            shows_mask: false,
        }
    }
}

/// Where the values of the noise come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Evaluation {
    /// From the byte textures, as the engine has them.
    Baked,
    /// Computed at each place: no filter, no bytes. The periodic noise is taken at the place within its period, and the mask's noise
    /// in the direction from the centre. What the textures cost in truth is the difference.
    Exact,
}

/// The cloud with its textures, which copies share.
#[derive(Debug, Clone)]
pub struct Cloud {
    parameters: Parameters,
    table: random::Permutation,
    volume: Arc<Volume>,
    mask: mask::Baked,
}

impl PartialEq for Cloud {
    fn eq(&self, other: &Self) -> bool {
        self.parameters == other.parameters
    }
}

/// Everything that the density at a place is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample<R> {
    /// Signed distance to the mask's surface, positive inside.
    pub distance: R,
    /// The mask's factor in [0, 1].
    pub mask: R,
    /// The volume's value in [0, 1].
    pub texel: R,
    /// The density.
    pub density: R,
}

impl Cloud {
    /// Bakes the textures of a cloud.
    pub fn new(parameters: Parameters) -> Result<Self> {
        Self::new_after(parameters, None)
    }

    /// The same, with the textures of another cloud where they would be the same.
    pub fn new_after(parameters: Parameters, other: Option<&Self>) -> Result<Self> {
        for (name, value) in [
            ("tiling", parameters.tiling),
            ("threshold", parameters.threshold),
            ("density_multiplier", parameters.density_multiplier),
        ] {
            finite(name, value)?;
        }
        if parameters.density_multiplier < 0.0 {
            let found = parameters.density_multiplier.to_string();
            return Err(Error::new("parameter density_multiplier", found, "0 or above", "Correct the parameter."));
        }
        parameters.offset.iter().try_for_each(|&value| finite("offset", value))?;
        let volume = match other.filter(|other| {
            let there = &other.parameters;
            there.bake == parameters.bake && there.texture_size == parameters.texture_size
        }) {
            Some(other) => Arc::clone(&other.volume),
            None => Arc::new(parameters.bake.volume(parameters.texture_size)?),
        };
        let mask = parameters.mask.bake_after(other.map(|other| &other.mask))?;
        let table = random::permutation(parameters.bake.seed);
        Ok(Self { parameters, table, volume, mask })
    }

    /// What it was made from.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// The volume's texture.
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// The mask's textures.
    pub fn mask(&self) -> &mask::Baked {
        &self.mask
    }

    /// The volume's texture and those of the mask.
    fn textures(&self) -> [&TextureHandle; 3] {
        let [main, fine] = &self.mask.textures;
        [self.volume.texture(), main.texture(), fine.texture()]
    }

    /// Place of the box's centre in the texture, in periods: what is left of it within a period is all that counts, taken in f64.
    fn moved(&self) -> [f64; 3] {
        let Parameters { offset, tiling, .. } = &self.parameters;
        offset.mapped(|offset| (offset + 0.5 * tiling).rem_euclid(1.0))
    }

    fn is_exact(&self) -> bool {
        self.parameters.evaluation == Evaluation::Exact
    }

    /// The density at a place of the local box, and its parts.
    pub fn at<R: Real>(&self, place: [R; 3]) -> Sample<R> {
        let parameters = &self.parameters;
        let number = |value: f64| R::of_f64(value);
        let distance = self.distance(place);
        let mask = distance.smooth_step(R::of(0.0), number(parameters.mask.softness));
        let texel = if parameters.shows_mask {
            R::of(1.0)
        } else {
            // Whole periods go first, those of the place before the offset is added, so that the texel's fraction keeps its bits.
            let moved = self.moved();
            let part: [R; 3] =
                each(|axis| ((place[axis] * number(parameters.tiling)).fraction() + number(moved[axis])).fraction());
            if self.is_exact() {
                number(parameters.bake.exact(&self.table, part.mapped(Real::to_f64)))
            } else {
                let side = R::of(self.volume.side as f32);
                texture_lookup::read(self.volume.texture(), part.mapped(|part| part * side - R::of(0.5)))
            }
        };
        let is_empty = mask <= R::of(0.0) || texel < number(parameters.threshold);
        let density = if is_empty { R::of(0.0) } else { texel * number(parameters.density_multiplier) * mask };
        Sample { distance, mask, texel, density }
    }

    /// Signed distance to the surface of the mask, positive inside; -1 without a radius.
    fn distance<R: Real>(&self, place: [R; 3]) -> R {
        let number = |value: f64| R::of_f64(value);
        let Mask { radius, flattening, deformations, reads_textures, .. } = self.parameters.mask;
        if radius <= 0.0 {
            return R::of(-1.0);
        }
        let stretched: [R; 3] =
            each(|axis| place[axis] / number(flattening[usize::from(place[axis] > R::of(0.0))][axis]));
        let [x, y, z] = stretched;
        let length = (x * x + y * y + z * z).sqrt();
        if length == R::of(0.0) {
            return number(radius);
        }
        let direction = stretched.mapped(|part| part / length);
        let mut displacement = R::of(0.0);
        for (index, deformation) in deformations.iter().enumerate() {
            let value = if !reads_textures {
                // Both textures read as 0.
                R::of(-1.0)
            } else if self.is_exact() {
                number(self.mask.exact(index, direction.mapped(Real::to_f64)))
            } else {
                let side = R::of(mask::SIDE as f32);
                let at = direction.mapped(|part| (part * number(radius) * R::of(0.5) + R::of(0.5)) * side - R::of(0.5));
                R::of(2.0) * texture_lookup::read(self.mask.textures[index].texture(), at) - R::of(1.0)
            };
            displacement = displacement + value * number(deformation.strength);
        }
        number(radius) + displacement - length
    }

    /// Encloses [`Self::distance`].
    fn distance_bounds(&self, place: &[Interval]) -> Interval {
        let Mask { radius, flattening, deformations, reads_textures, .. } = self.parameters.mask;
        if radius <= 0.0 {
            return Interval::point(-1.0);
        }
        // Monotone in each coordinate; the root of the sum of squares between those of the nearest and the farthest.
        let mut stretched = [[0.0_f64; 2]; 3];
        let (mut near, mut far) = (0.0, 0.0);
        for axis in 0..3 {
            let ends = place[axis].ends();
            stretched[axis] = ends.mapped(|end| end / flattening[usize::from(end > 0.0)][axis]);
            let [low, high] = stretched[axis];
            let least = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
            near += least * least;
            far += low.abs().max(high.abs()).powi(2);
        }
        let (near, far) = (near.sqrt() * (1.0 - ROUNDING), far.sqrt() * (1.0 + ROUNDING));
        let mut displacement = [0.0; 2];
        for (index, deformation) in deformations.iter().enumerate() {
            let [low, high] = if !reads_textures {
                [-1.0; 2]
            } else if self.is_exact() {
                // Gradient noise of gradients of length root 2 lies within 1 and a little (Perlin 2002); 1.1 is beyond it.
                [-1.1, 1.1]
            } else {
                let directions: [Interval; 3] = each(|axis| {
                    let [low, high] = if near > 0.0 {
                        let [a, b] = stretched[axis];
                        let ends = [a / near, a / far, b / near, b / far];
                        [ends.iter().copied().fold(1.0, f64::min), ends.iter().copied().fold(-1.0, f64::max)]
                    } else {
                        [-1.0, 1.0]
                    };
                    let part = Interval::outward(low.max(-1.0) - ROUNDING, high.min(1.0) + ROUNDING, false);
                    let index = part * <Interval as Quantity>::of(0.5 * radius * mask::SIDE as f64);
                    index + <Interval as Quantity>::of(0.5 * mask::SIDE as f64 - 0.5)
                });
                let [low, high] = texture_lookup::enclose(self.mask.textures[index].texture(), &directions).ends();
                [2.0 * low - 1.0, 2.0 * high - 1.0]
            };
            let ends = [low * deformation.strength, high * deformation.strength];
            displacement[0] += ends[0].min(ends[1]);
            displacement[1] += ends[0].max(ends[1]);
        }
        let mut ends = [radius + displacement[0] - far, radius + displacement[1] - near];
        if near == 0.0 {
            // At the centre there is no direction.
            ends[1] = ends[1].max(radius);
        }
        let size = radius + displacement[0].abs().max(displacement[1].abs()) + far;
        let may_be_nan = place.iter().any(|coordinate| coordinate.may_be_nan || !coordinate.is_finite());
        Interval::outward(ends[0] - ROUNDING * size, ends[1] + ROUNDING * size, may_be_nan)
    }

    /// Encloses the density.
    fn bounds(&self, place: &[Interval]) -> Interval {
        let parameters = &self.parameters;
        let distance = self.distance_bounds(place);
        let softness = parameters.mask.softness;
        let factor = distance.ends().mapped(|end| crate::base::interpolation::smooth(0.0, softness, end));
        let may_be_nan = distance.may_be_nan;
        if factor[1] <= 0.0 && distance.ends()[1] <= -ROUNDING {
            return Interval { may_be_nan, ..Interval::ZERO };
        }
        let texel = if parameters.shows_mask {
            [1.0; 2]
        } else if self.is_exact() {
            [0.0, 1.0]
        } else {
            let (side, moved) = (self.volume.side as f64, self.moved());
            let index: [Interval; 3] = each(|axis| {
                let number = <Interval as Quantity>::of;
                (place[axis] * number(parameters.tiling) + number(moved[axis])) * number(side) - number(0.5)
            });
            texture_lookup::enclose(self.volume.texture(), &index).ends()
        };
        // What a rounding may bring across the threshold.
        let limit = parameters.threshold;
        if texel[1] < limit * (1.0 - ROUNDING) {
            return Interval { may_be_nan, ..Interval::ZERO };
        }
        let most = texel[1].max(0.0) * parameters.density_multiplier * factor[1];
        let least = if texel[0] > limit * (1.0 + ROUNDING) && distance.ends()[0] > 0.0 {
            texel[0].max(0.0) * parameters.density_multiplier * factor[0]
        } else {
            0.0
        };
        Interval::outward(least - ROUNDING * most, most + ROUNDING * most, may_be_nan)
    }
}

/// What f32 and WGSL round in the arithmetic between two enclosures, relative to what is added: some ten operations of 2.5 units in the
/// last place.
const ROUNDING: f64 = 1.0 / (1_u64 << 18) as f64;

struct Density(Arc<Cloud>);

impl Evaluate for Density {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for (index, result) in outputs[0].iter_mut().enumerate() {
            *result = self.0.at(each(|axis| inputs[axis].values[index])).density;
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        outputs[0] = self.0.bounds(inputs);
    }

    fn textures(&self) -> Vec<TextureHandle> {
        self.0.textures().map(Clone::clone).to_vec()
    }

    fn without_shader(&self) -> Option<&'static str> {
        self.0.is_exact().then_some("noise at each place instead of textures")
    }

    fn shader_constants(&self) -> String {
        let Parameters { mask, tiling, threshold, density_multiplier, shows_mask, .. } = &self.0.parameters;
        let [low, high] = mask.flattening;
        let vector = |[x, y, z]: [f64; 3]| format!("vec3f({:?}f, {:?}f, {:?}f)", x as f32, y as f32, z as f32);
        let [volume, main, fine] = self.0.textures();
        let mut text = texture_lookup::shader_constant("VOLUME", volume, "TEXELS_0");
        text += &texture_lookup::shader_constant("MAIN", main, "TEXELS_1");
        text += &texture_lookup::shader_constant("FINE", fine, "TEXELS_2");
        let number = |name: &str, value: f64| format!("const {name}: f32 = {:?}f;\n", value as f32);
        for (name, value) in [
            ("RADIUS", mask.radius),
            ("SOFTNESS", mask.softness),
            ("MAIN_STRENGTH", mask.deformations[0].strength),
            ("FINE_STRENGTH", mask.deformations[1].strength),
            ("TILING", *tiling),
            ("THRESHOLD", *threshold),
            ("MULTIPLIER", *density_multiplier),
        ] {
            text += &number(name, value);
        }
        for (name, value) in [("FLATTENING_LOW", low), ("FLATTENING_HIGH", high), ("MOVED", self.0.moved())] {
            text += &format!("const {name} = {};\n", vector(value));
        }
        text += &format!("const READS_TEXTURES = {};\nconst SHOWS_MASK = {shows_mask};\n", mask.reads_textures);
        text
    }
}

/// Refuses a parameter that is no number.
pub(crate) fn finite(name: &str, value: f64) -> Result<()> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::new(format!("parameter {name}"), value.to_string(), "a finite number", "Correct the parameter."))
}

/// Refuses a parameter that is not above 0.
pub(crate) fn above_zero(name: &str, value: f64) -> Result<()> {
    if value > 0.0 {
        return Ok(());
    }
    Err(Error::new(format!("parameter {name}"), value.to_string(), "a number above 0", "Correct the parameter."))
}
