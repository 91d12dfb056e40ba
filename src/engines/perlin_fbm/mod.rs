//! The seeded, baked, masked Perlin-FBM cloud of a published three.js engine.
//!
//! A byte volume is baked from gradient noise that is made periodic by blending eight shifted copies ([`bake`]), looked up
//! several periods across a box, and masked by the signed distance of a deformed sphere ([`mask`]). Random numbers and
//! permutations come from a seed ([`random`]), gradient noise from a permutation ([`noise`]). The original computes in double
//! precision on the CPU; what is deterministic there is equal here to the byte.
//!
//! Space is the *local box* from -0.5 to 0.5 on every axis; y is up.

pub mod adapter;
pub mod bake;
pub mod defects;
pub mod mask;
pub mod noise;
pub mod random;
mod rows;
pub mod settings;

use crate::base::error::{Error, Result};
use crate::engines::{Build, Engine, Model};
use crate::gpu::ModelShader;
use crate::media::density::DensityModel;
use crate::media::transfer::smooth;
use bake::Bake;
use glam::DVec3;
use mask::Mask;
use rayon::prelude::*;
use std::sync::Arc;

/// A byte texture of side `side`: one channel, x fastest.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Volume {
    /// Texels per axis.
    pub side: usize,
    /// `side`^3 texels.
    pub texels: Vec<u8>,
}

/// What lies outside of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// The texture again.
    Repeat,
    /// Its nearest texel.
    Clamp,
}

impl Volume {
    /// A texture from the byte of each texel, on all cores.
    fn bake(side: usize, texel: impl Fn([usize; 3]) -> u8 + Sync) -> Self {
        let texels = (0..side.pow(3))
            .into_par_iter()
            .with_min_len(side)
            .map(|index| texel([index % side, index / side % side, index / (side * side)]))
            .collect();
        Self { side, texels }
    }

    /// Trilinear value in [0, 1] at texture coordinates: texel i has its centre at (i + 0.5) / side. A coordinate that is not
    /// finite reads as NaN.
    pub fn sample(&self, at: [f64; 3], wrap: Wrap) -> f64 {
        if at.iter().any(|coordinate| !coordinate.is_finite()) {
            return f64::NAN;
        }
        let side = self.side as f64;
        let texel = |number: f64| match wrap {
            Wrap::Repeat => number.rem_euclid(side) as usize % self.side,
            Wrap::Clamp => number.clamp(0.0, side - 1.0) as usize,
        };
        let places = at.map(|coordinate| coordinate * side - 0.5);
        let fractions = places.map(|place| place - place.floor());
        let ends = places.map(|place| [texel(place.floor()), texel(place.floor() + 1.0)]);
        let mut sum = 0.0;
        for corner in 0..8 {
            let upper = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let mut weight = 1.0;
            for axis in 0..3 {
                weight *= if upper[axis] == 1 { fractions[axis] } else { 1.0 - fractions[axis] };
            }
            let [x, y, z] = std::array::from_fn(|axis| ends[axis][upper[axis]]);
            sum += weight * f64::from(self.texels[(z * self.side + y) * self.side + x]) / 255.0;
        }
        sum
    }
}

/// The model under its name.
pub static MODEL: Model = Model {
    id: "perlin-fbm",
    title: "Baked Perlin noise with a deformed-sphere mask",
    about: "The seeded cloud of a published three.js engine: octaves of gradient noise, made periodic, thresholded and baked to a \
            byte texture, tiled across a box, and masked by a flattened sphere that two more textures deform.",
    parameters: settings::PARAMETERS,
    qualities: settings::QUALITIES,
    defects: defects::DEFECTS,
    build: Build::Alone(|values, defects, seconds| {
        let (parameters, warnings) = settings::parameters(values, defects, seconds)?;
        Ok(Engine {
            model: MODEL.id,
            defects: defects.clone(),
            values: values.clone(),
            density: Box::new(Cloud::new(parameters)?),
            light: settings::light(values, defects),
            march: settings::march(values, defects),
            compositing: settings::compositing(defects),
            god_rays: settings::god_rays(values, defects),
            warnings,
            averages: std::sync::OnceLock::new(),
        })
    }),
};

/// What makes the density of the cloud.
#[derive(Debug, Clone, PartialEq)]
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
    /// Density of a texel of value 1 where the mask is 1.
    pub density_multiplier: f64,
    /// Extinction of a view ray is the density times this and [`TINT`], per side of the box.
    pub opacity: f64,
    /// Where values come from.
    pub evaluation: Evaluation,
    /// The mask alone: every texel counts as 1.
    pub shows_mask: bool,
}

/// Where the values of the noise come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Evaluation {
    /// From the byte textures, as the engine has them.
    Baked,
    /// Computed at each place: no filter, no bytes. The periodic noise is taken at the place within its period, and the mask's noise
    /// in the direction from the centre. What the textures cost in truth is the difference.
    Exact,
}

/// Extinction of the channels, relative to each other: blue is dimmed most.
pub const TINT: [f64; 3] = [0.6, 0.65, 0.7];

/// The baked cloud.
#[derive(Debug, Clone)]
pub struct Cloud {
    parameters: Parameters,
    table: random::Permutation,
    volume: Arc<Volume>,
    mask: mask::Baked,
}

/// Everything that the density at a place is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Signed distance to the mask's surface, positive inside.
    pub distance: f64,
    /// The mask's factor in [0, 1].
    pub mask: f64,
    /// The volume's value in [0, 1].
    pub texel: f64,
    /// The density.
    pub density: f64,
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
            ("opacity", parameters.opacity),
        ] {
            finite(name, value)?;
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

    /// The density at a place of the local box, and its parts.
    pub fn at(&self, place: [f64; 3]) -> Sample {
        let Parameters { tiling, offset, threshold, density_multiplier, mask, .. } = &self.parameters;
        let is_exact = self.parameters.evaluation == Evaluation::Exact;
        let distance = if is_exact { self.mask.exact_distance(place) } else { self.mask.distance(place) };
        let factor = smooth(0.0, mask.softness, distance);
        let coordinates = std::array::from_fn(|axis| (place[axis] + 0.5) * tiling + offset[axis]);
        let texel = if self.parameters.shows_mask {
            1.0
        } else if is_exact {
            self.parameters.bake.exact(&self.table, coordinates)
        } else {
            self.volume.sample(coordinates, Wrap::Repeat)
        };
        let is_empty = factor <= 0.0 || texel < *threshold;
        let density = if is_empty { 0.0 } else { texel * density_multiplier * factor };
        Sample { distance, mask: factor, texel, density }
    }
}

impl DensityModel for Cloud {
    fn densities(&self, places: &[DVec3]) -> Vec<f64> {
        places.iter().map(|place| self.at(place.to_array()).density).collect()
    }

    fn extinction(&self) -> [f64; 3] {
        TINT.map(|tint| tint * self.parameters.opacity)
    }

    fn shader(&self) -> Result<ModelShader> {
        if self.parameters.evaluation == Evaluation::Exact {
            return Err(Error::new(
                "parameter exact",
                "1",
                "0: the adapter reads the textures",
                "Leave the parameter out, or --gpu.",
            ));
        }
        Ok(adapter::density(self))
    }
}

/// Refuses a parameter that is no number.
fn finite(name: &str, value: f64) -> Result<()> {
    if value.is_finite() {
        return Ok(());
    }
    Err(Error::new(format!("parameter {name}"), value.to_string(), "a finite number", "Correct the parameter."))
}

/// Refuses a parameter that is not above 0.
fn above_zero(name: &str, value: f64) -> Result<()> {
    if value > 0.0 {
        return Ok(());
    }
    Err(Error::new(format!("parameter {name}"), value.to_string(), "a number above 0", "Correct the parameter."))
}
