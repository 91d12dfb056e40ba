//! The density of an engine as numbers on a grid, for programs that read volumes: textures with a pyramid of majorants, OpenVDB.

use super::manifest::{Origin, write_into};
use crate::base::error::{Error, Result};
use crate::base::ktx2::{self, Channel};
use crate::base::texture::{TexelFormat, Texels, Texture, TextureFilter};
use crate::engines::Engine;
use crate::engines::domain::Outline;
use crate::engines::render::EngineRenderer;
use crate::media::density_cache::{CacheReport, DensityCache, Samples};
use crate::scene::Scene;
use crate::scene::volume_grid::VolumeGrid;
use glam::{DAffine3, DMat4, DVec3};
use half::f16;
use ndarray::Array3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// What `field.json` begins with.
pub const FORMAT: &str = "cloudparity field 1";

/// `field.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FieldManifest {
    /// [`FORMAT`].
    pub format: String,
    /// What it was made of.
    #[serde(flatten)]
    pub origin: Origin,
    /// Texels along x, y and z. A value stands at the middle of its texel.
    pub size: [usize; 3],
    /// Index of a texel to the world, in metres, row by row. A texture's coordinate is (index + 0.5) / size.
    pub to_world: [[f64; 4]; 4],
    /// Extinction per metre of a density of 1, per channel.
    pub extinction_per_metre: [f64; 3],
    /// The same per centimetre of a density of `range[1]`, which `density-unreal.vdb` has as 1.
    pub extinction_per_centimetre_of_largest: [f64; 3],
    /// Smallest and largest value.
    pub range: [f32; 2],
    /// How it is stored.
    pub stored: Vec<Stored>,
    /// Texels along x, y and z of each level of the majorants. The one at a texture's coordinate is not below the density there, as each of the
    /// stored forms has it, read without a filter from the level and linearly from the density.
    pub majorant_levels: Vec<[usize; 3]>,
}

/// A form in which the density is stored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stored {
    /// `f16` or `unorm8`.
    pub format: String,
    /// A density is `offset + scale * texel`, where a texel of 8 bits lies between 0 and 1.
    pub scale: f32,
    /// See `scale`.
    pub offset: f32,
    /// Largest error of the field at random points, read linearly, in units of density.
    pub largest_field_error: f64,
    /// Root mean square of it.
    pub root_mean_square_field_error: f64,
    /// Points of the measurement.
    pub points: usize,
}

/// An engine's density on a grid, in 16 and in 8 bits.
pub struct FieldBundle {
    /// What `field.json` says.
    pub manifest: FieldManifest,
    /// The density as each form has it.
    pub caches: [DensityCache; 2],
}

impl FieldBundle {
    /// Of an engine in a scene, with `voxels` along the longest side. An error where the engine's domain is no box.
    pub fn new(scene: &Scene, engine: &Engine, voxels: u32, progress: &(dyn Fn(f64) + Sync)) -> Result<Self> {
        if !matches!(engine.container.outline, Outline::Box(_)) || engine.density.occupied.is_empty() {
            return Err(Error::new(
                "the domain of the engine",
                if engine.density.occupied.is_empty() { "a density that is nowhere" } else { "a shell or a mesh" },
                "a box or a slab with something in it: a grid is of a box",
                "Take the domain of the object, or publish shaders.",
            ));
        }
        let to_world = engine.container.to_local.inverse();
        let samples = Samples::bake(&engine.density, &to_world, voxels - 1, TexelFormat::F16, progress)?;
        let of = |format| DensityCache::new(&samples, format, TextureFilter::Trilinear);
        let caches = [of(TexelFormat::F16)?, of(TexelFormat::Unorm8)?];
        let reports: Vec<CacheReport> =
            caches.iter().map(|cache| cache.measure(&engine.density)).collect::<Result<_>>()?;
        if let Some(report) = reports.iter().find(|report| report.not_finite > 0) {
            return Err(Error::new(
                "the density",
                format!("NaN or infinite at {} of {} points", report.not_finite, report.points),
                "finite numbers",
                "Correct the density (cloudparity eval shows it).",
            ));
        }
        let renderer = EngineRenderer::new(scene, engine, None)?;
        let texture = &caches[0].texture;
        let extinction = engine.extinction.map(|channel| channel / engine.container.unit);
        let range = reports[0].range;
        let stored = caches.iter().zip(&reports).map(|(cache, report)| {
            let (offset, scale) = match cache.texture.texels() {
                Texels::Unorm8 { range: [low, high], .. } => (*low, high - low),
                _ => (0.0, 1.0),
            };
            Stored {
                format: report.settings.format.name().into(),
                scale,
                offset,
                largest_field_error: report.relative_max_error * report.largest_density,
                root_mean_square_field_error: report.relative_rms_error * report.largest_density,
                points: report.points,
            }
        });
        let size = texture.size();
        let manifest = FieldManifest {
            format: FORMAT.into(),
            origin: Origin::of(scene, engine, &renderer),
            size,
            to_world: (to_world * index_to_local(&caches[0])).transpose().to_cols_array_2d(),
            extinction_per_metre: extinction,
            extinction_per_centimetre_of_largest: extinction.map(|channel| channel * f64::from(range[1]) / 100.0),
            range,
            stored: stored.collect(),
            majorant_levels: levels_of(size).map(|level| ktx2::level_size(size, level)).collect(),
        };
        Ok(Self { manifest, caches })
    }

    /// The textures by file: KTX2 and the same texels without a head, the majorants with all their levels.
    pub fn textures(&self) -> BTreeMap<String, Vec<u8>> {
        let writer = format!("cloudparity {}", self.manifest.origin.build);
        let size = self.manifest.size;
        let mut files = BTreeMap::new();
        for cache in &self.caches {
            let (bytes, channel, name) = match cache.texture.texels() {
                Texels::F16(bits) => {
                    (bits.iter().flat_map(|bits| bits.to_le_bytes()).collect(), Channel::Float16, "f16")
                }
                Texels::Unorm8 { bytes, .. } => (bytes.to_vec(), Channel::Unorm8, "unorm8"),
                Texels::F32(_) => continue,
            };
            files.insert(
                format!("density.{name}.ktx2"),
                ktx2::write(size, channel, std::slice::from_ref(&bytes), &writer),
            );
            files.insert(format!("density.{name}.raw"), bytes);
        }
        let majorants = majorants(self.caches.each_ref().map(|cache| &*cache.texture));
        files.insert("majorant.f16.ktx2".into(), ktx2::write(size, Channel::Float16, &majorants, &writer));
        files
    }

    /// The density in the world in metres as Blender has it, in 16 bits; values below 0 are 0.
    pub fn grid(&self) -> VolumeGrid {
        let rows = DMat4::from_cols_array_2d(&self.manifest.to_world).transpose();
        VolumeGrid { values: self.values(1.0), to_object: DAffine3::from_mat4(rows) }
    }

    /// The same in centimetres, with the largest value as 1, as an importer into 8 bits wants it.
    pub fn grid_of_unreal(&self) -> VolumeGrid {
        let VolumeGrid { to_object, .. } = self.grid();
        let scale = DAffine3::from_scale(DVec3::splat(100.0));
        let largest = self.manifest.range[1].max(f32::MIN_POSITIVE);
        VolumeGrid { values: self.values(1.0 / largest), to_object: scale * to_object }
    }

    fn values(&self, scale: f32) -> Array3<f32> {
        let texture = &self.caches[0].texture;
        let [x, y, z] = texture.size();
        Array3::from_shape_fn((x, y, z), |(x, y, z)| (texture.texel([x, y, z]) * scale).max(0.0))
    }

    /// Writes files and `field.json` into a folder, the manifest last.
    pub fn write(&self, folder: &Path, files: &BTreeMap<String, Vec<u8>>) -> Result<()> {
        write_into(folder, files, &self.manifest, "field.json")
    }
}

fn index_to_local(cache: &DensityCache) -> DMat4 {
    DMat4::from_translation(cache.low) * DMat4::from_scale(cache.step)
}

/// Levels down to a texel.
fn levels_of(size: [usize; 3]) -> std::ops::Range<usize> {
    0..(size.into_iter().max().unwrap_or(1).ilog2() as usize + 1)
}

/// Upper bounds of textures of one size for all places of each texel of each level, in bits of binary16 rounded up.
///
/// A place in texel i of the first level lies within half a texel of the value that stands there, so that a linear filter reads it and its
/// neighbours. A texel of a further level covers a part of the texture that may cut texels of the first: all that it touches count.
fn majorants(textures: [&Texture; 2]) -> Vec<Vec<u8>> {
    let size = textures[0].size();
    let at = |[x, y, z]: [usize; 3]| (z * size[1] + y) * size[0] + x;
    let mut values = vec![0.0_f32; size.iter().product()];
    for z in 0..size[2] {
        for y in 0..size[1] {
            for x in 0..size[0] {
                values[at([x, y, z])] =
                    textures.map(|texture| texture.texel([x, y, z])).into_iter().fold(f32::MIN, f32::max);
            }
        }
    }
    let first = largest_of(&values, size, size, |_, index, side| [index.saturating_sub(1), (index + 1).min(side - 1)]);
    levels_of(size)
        .map(|level| {
            let coarse = ktx2::level_size(size, level);
            let covered = |axis: usize, index: usize, side: usize| {
                [index * side / coarse[axis], ((index + 1) * side).div_ceil(coarse[axis]) - 1]
            };
            let found = if level == 0 { first.clone() } else { largest_of(&first, size, coarse, covered) };
            found.iter().flat_map(|&value| rounded_up(value).to_bits().to_le_bytes()).collect()
        })
        .collect()
}

/// Largest values of blocks, along one axis after the other; `covered` says for an axis, an index and the texels of the side which first and last
/// one lie in it.
fn largest_of(
    values: &[f32],
    size: [usize; 3],
    wanted: [usize; 3],
    covered: impl Fn(usize, usize, usize) -> [usize; 2],
) -> Vec<f32> {
    let mut values = values.to_vec();
    let mut size = size;
    for axis in 0..3 {
        let mut next = size;
        next[axis] = wanted[axis];
        let stride: usize = size[..axis].iter().product();
        let mut found = vec![f32::MIN; next.iter().product()];
        for (index, value) in found.iter_mut().enumerate() {
            let (below, rest) = (index % stride, index / stride);
            let (along, above) = (rest % next[axis], rest / next[axis]);
            let [first, last] = covered(axis, along, size[axis]);
            let row = (above * size[axis]) * stride + below;
            *value = (first..=last).map(|place| values[row + place * stride]).fold(f32::MIN, f32::max);
        }
        (values, size) = (found, next);
    }
    values
}

/// The smallest number of binary16 that is not below a value.
fn rounded_up(value: f32) -> f16 {
    let near = f16::from_f32(value);
    if near.to_f32() >= value {
        return near;
    }
    // Away from zero above it, towards zero below.
    let bits = near.to_bits();
    f16::from_bits(if value >= 0.0 { bits + 1 } else { bits - 1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::texture::Outside;

    #[test]
    fn majorants_bound_what_a_linear_filter_reads() {
        // Sides that halving does not divide.
        let size = [13, 6, 9];
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state as f32 / u32::MAX as f32
        };
        let values: Vec<f32> = (0..size.iter().product::<usize>()).map(|_| random() * 7.0 - 1.0).collect();
        let store = |format| {
            Texture::store(size, values.clone(), format, TextureFilter::Trilinear, Outside::Clamp, "a test")
                .expect("stored")
        };
        let textures = [store(TexelFormat::F16), store(TexelFormat::Unorm8)];
        let levels = majorants(textures.each_ref());
        assert_eq!(levels.len(), 4);
        let mut least = f32::INFINITY;
        for _ in 0..20_000 {
            let place: [f32; 3] = std::array::from_fn(|_| random().min(1.0 - f32::EPSILON));
            let index: [f32; 3] = std::array::from_fn(|axis| place[axis] * size[axis] as f32 - 0.5);
            for texture in &textures {
                let low = index.map(|index| index.floor() as i32);
                let corners = texture.corners(low);
                let part: [f32; 3] = std::array::from_fn(|axis| index[axis] - index[axis].floor());
                let value: f64 = (0..8)
                    .map(|corner| {
                        let weight = |axis: usize| {
                            f64::from(if corner >> axis & 1 == 1 { part[axis] } else { 1.0 - part[axis] })
                        };
                        f64::from(corners[corner]) * weight(0) * weight(1) * weight(2)
                    })
                    .sum();
                for (level, bytes) in levels.iter().enumerate() {
                    let side = ktx2::level_size(size, level);
                    let texel: [usize; 3] = std::array::from_fn(|axis| (place[axis] * side[axis] as f32) as usize);
                    let at = 2 * ((texel[2] * side[1] + texel[1]) * side[0] + texel[0]);
                    let bound = f16::from_le_bytes([bytes[at], bytes[at + 1]]).to_f32();
                    // Weights are rounded, by 2^-22 of the largest value each at most.
                    assert!(
                        value <= f64::from(bound) + 8.0 * 6.0 / f64::from(1 << 22),
                        "{value} above {bound} in level {level}"
                    );
                    least = least.min(bound - value as f32);
                }
            }
        }
        // Were the bounds far away everywhere, they would be of no use.
        assert!(least < 0.1, "{least}");
    }

    #[test]
    fn numbers_are_rounded_up() {
        for value in [0.0, 1.0, 1.0 + f32::EPSILON, -1.0 - f32::EPSILON, 0.1, -0.1, 1e-9, -1e-9, 1234.567] {
            let bound = rounded_up(value).to_f32();
            assert!(bound >= value && bound - value <= value.abs() / 1024.0 + 6e-8, "{value} {bound}");
        }
    }
}
