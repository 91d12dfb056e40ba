//! The mask: the signed distance of a sphere that is flattened in six directions and deformed by two textures of noise.

use crate::base::arrays::Mapped;
use crate::base::error::Result;
use crate::base::texture::Outside;
use crate::nodes::perlin_fbm::noise::{Field, noise};
use crate::nodes::perlin_fbm::random::{Permutation, permutation};
use crate::nodes::perlin_fbm::{Volume, above_zero, finite};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Texels of a mask texture per axis.
pub const SIDE: usize = 128;

/// Parameters of the mask, in units of the local box.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mask {
    /// Radius of the sphere; not above 0: no cloud.
    pub radius: f64,
    /// Distance over which the mask fades in, above 0.
    pub softness: f64,
    /// Factors on the radius along -x, -y, -z and +x, +y, +z: 1 is a sphere, below it flat. Above 0: the original divides by it.
    pub flattening: [[f64; 3]; 2],
    /// Main and fine deformation.
    pub deformations: [Deformation; 2],
    /// Whether the textures are read. The original never uploads its own, so that both read as 0 and the sphere is smaller by
    /// both strengths (defect PF-2).
    pub reads_textures: bool,
}

/// A deformation of the sphere.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Deformation {
    /// Seed of its noise.
    pub seed: f64,
    /// Largest displacement.
    pub strength: f64,
    /// Units of noise in the sphere's radius.
    pub frequency: f64,
}

impl Default for Mask {
    /// What the engine's mask begins with: the only values with which its mask works as published.
    fn default() -> Self {
        Self {
            radius: 0.52,
            softness: 0.17,
            flattening: [[0.9, 0.3, 0.9], [0.9, 0.7, 0.9]],
            deformations: [
                Deformation { seed: 1.0, strength: 0.05, frequency: 2.7 },
                Deformation { seed: 10.0, strength: 0.036, frequency: 10.5 },
            ],
            reads_textures: true,
        }
    }
}

/// A mask with its textures.
#[derive(Debug, Clone)]
pub struct Baked {
    mask: Mask,
    /// Main and fine deformation.
    pub textures: [Arc<Volume>; 2],
    /// Their permutations.
    tables: [Permutation; 2],
}

impl Mask {
    /// Makes the textures, after refusing parameters that are no numbers, or not above 0 where they must be.
    pub fn bake(&self) -> Result<Baked> {
        self.bake_after(None)
    }

    /// The same, with the textures of another mask where their seed and frequency are the same.
    pub fn bake_after(&self, other: Option<&Baked>) -> Result<Baked> {
        finite("mask radius", self.radius)?;
        finite("mask softness", self.softness)?;
        for &value in self.flattening.as_flattened() {
            finite("flattening", value)?;
            above_zero("flattening", value)?;
        }
        for Deformation { seed, strength, frequency } in self.deformations {
            finite("deformation seed", seed)?;
            finite("deformation strength", strength)?;
            finite("deformation frequency", frequency)?;
        }
        above_zero("mask softness", self.softness)?;
        let textures = std::array::from_fn(|number| {
            let wanted = self.deformations[number];
            let found = other.and_then(|other| {
                let there = other.mask.deformations[number];
                (there.seed == wanted.seed && there.frequency == wanted.frequency)
                    .then(|| Arc::clone(&other.textures[number]))
            });
            found.unwrap_or_else(|| Arc::new(wanted.texture()))
        });
        let tables = self.deformations.mapped(|deformation| permutation(deformation.seed));
        Ok(Baked { mask: *self, textures, tables })
    }
}

impl Deformation {
    /// The texture of `SIDE` texels per axis: noise in the direction of each texel from the centre, as a byte that wraps around.
    pub fn texture(&self) -> Volume {
        let table = permutation(self.seed);
        Volume::bake(SIDE, Outside::Clamp, |place| {
            // The side is even: no texel lies at the centre.
            let value = self.value(&table, place.mapped(|number| 2.0 * number as f64 / (SIDE - 1) as f64 - 1.0));
            // Truncated, not clamped: 256 wraps to 0.
            (128.0 * value + 128.0) as i64 as u8
        })
    }
}

impl Deformation {
    /// The noise in a direction of any length but 0.
    fn value(&self, table: &Permutation, [x, y, z]: [f64; 3]) -> f64 {
        let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
        noise(Field::Mask, table, [x, y, z].mapped(|part| part * inverse * self.frequency))
    }
}

impl Baked {
    /// The noise of the main (0) or fine (1) deformation in a direction of any length but 0: what its texture holds as bytes.
    pub fn exact(&self, number: usize, direction: [f64; 3]) -> f64 {
        self.mask.deformations[number].value(&self.tables[number], direction)
    }
}
