//! The byte volume: octaves of noise, made periodic, thresholded.

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::base::interpolation::smooth;
use crate::base::texture::Outside;
use crate::nodes::perlin_fbm::noise::{Number, Octaves, octaves};
use crate::nodes::perlin_fbm::random::{Permutation, permutation};
use crate::nodes::perlin_fbm::rows::Waves;
use crate::nodes::perlin_fbm::{Volume, above_zero, finite, rows};
use num_traits::Float;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Most texels per axis: 16 MiB.
pub const LARGEST: usize = 256;

/// Most octaves.
pub const MOST_OCTAVES: u32 = 64;

/// Parameters of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bake {
    /// Centre of the threshold, 0 to 1.
    pub coverage: f64,
    /// Half width of the threshold, above 0.
    pub softness: f64,
    /// Units of noise across the box, above 0.
    pub noise_scale: f64,
    /// Octaves of noise.
    pub octaves: Octaves,
    /// Exponent before the threshold, above 0.
    pub intensity: f64,
    /// Makes the permutation, and shifts the coordinates. Any finite number.
    pub seed: f64,
}

impl Default for Bake {
    /// The engine's defaults; its seed is random, ours is 42.
    fn default() -> Self {
        Self {
            coverage: 0.55,
            softness: 0.05,
            noise_scale: 3.5,
            octaves: Octaves { count: 5, persistence: 0.5, lacunarity: 3.0 },
            intensity: 1.0,
            seed: 42.0,
        }
    }
}

impl Bake {
    /// What rows are made of.
    pub(crate) fn waves(&self) -> Waves {
        Waves { scale: self.noise_scale, seed: self.seed, octaves: self.octaves }
    }

    /// Refuses parameters outside of their ranges.
    pub fn check(&self) -> Result<()> {
        let Octaves { count, persistence, lacunarity } = self.octaves;
        for (name, value) in [
            ("coverage", self.coverage),
            ("softness", self.softness),
            ("noise_scale", self.noise_scale),
            ("persistence", persistence),
            ("lacunarity", lacunarity),
            ("intensity", self.intensity),
            ("seed", self.seed),
        ] {
            finite(name, value)?;
        }
        above_zero("softness", self.softness)?;
        above_zero("noise_scale", self.noise_scale)?;
        above_zero("intensity", self.intensity)?;
        if !(1..=MOST_OCTAVES).contains(&count) {
            let expected = format!("1 to {MOST_OCTAVES}");
            return Err(Error::new("parameter octaves", count.to_string(), expected, "Correct the parameter."));
        }
        Ok(())
    }

    /// The texture of `side` texels per axis, in double precision: byte for byte the original's.
    pub fn volume(&self, side: usize) -> Result<Volume> {
        self.volume_in::<f64>(side)
    }

    /// The texture in the precision `T`. In single precision some texels differ by 1: those whose value lies within the rounding of a
    /// byte's edge, whatever the seed.
    pub fn volume_in<T: Float + Number>(&self, side: usize) -> Result<Volume> {
        self.check_side(side)?;
        let values = rows::blend::<T>(&self.waves(), &permutation(self.seed), side);
        let texels = values.into_par_iter().map(|value| self.byte(value)).collect();
        Ok(Volume::new(side, texels, Outside::Repeat))
    }

    /// The same as [`Self::volume`], texel by texel on one core as the original computes it: what benchmarks and tests compare with.
    pub fn volume_plain(&self, side: usize) -> Result<Volume> {
        self.check_side(side)?;
        let table = permutation(self.seed);
        let texel = |index: usize| {
            let place = [index % side, index / side % side, index / (side * side)];
            self.byte(self.blend::<f64>(&table, place.mapped(|number| number as f64 / (side - 1) as f64)))
        };
        Ok(Volume::new(side, (0..side.pow(3)).map(texel).collect(), Outside::Repeat))
    }

    pub(crate) fn check_side(&self, side: usize) -> Result<()> {
        self.check()?;
        if (2..=LARGEST).contains(&side) {
            return Ok(());
        }
        Err(Error::new(
            "parameter texture_size",
            side.to_string(),
            format!("2 to {LARGEST} texels per axis"),
            "Correct the parameter.",
        ))
    }

    /// The periodic noise mapped to about [0, 1], at a place of the unit box: eight shifted copies, each with the weight of its corner.
    pub fn blend<T: Number>(&self, table: &Permutation, place: [f64; 3]) -> T {
        let (scale, seed) = (self.noise_scale, self.seed);
        let base = place.mapped(|coordinate| coordinate * scale + seed);
        let weights = place.mapped(T::number);
        let one = T::number(1.0);
        let mut sum = T::number(0.0);
        for corner in rows::CORNERS {
            let shifted = each(|axis| if corner[axis] == 1 { base[axis] - scale } else { base[axis] });
            let mut term = octaves::<T>(table, shifted, &self.octaves);
            for axis in 0..3 {
                term = term * if corner[axis] == 1 { weights[axis] } else { one - weights[axis] };
            }
            sum = sum + term;
        }
        (sum + one) / T::number(2.0)
    }

    /// The value in [0, 1] at a place in periods of the texture, that no texture rounds: what a texture of ever more texels and bits
    /// tends to.
    pub fn exact(&self, table: &Permutation, place: [f64; 3]) -> f64 {
        self.density(self.blend(table, place.mapped(|coordinate| coordinate - coordinate.floor())))
    }

    /// The thresholded value of the blended noise. NaN, a negative value to a broken power, gives 0.
    ///
    /// The threshold's width is the difference of its ends, as in the original, but taken before it becomes a `T`: the difference of two
    /// f32 would be off by 2^-24 / softness.
    pub fn density<T: Float + Number>(&self, value: T) -> T {
        let powered = value.powf(T::number(self.intensity));
        if powered.is_nan() {
            return T::zero();
        }
        let [low, high] = self.threshold();
        smooth(T::zero(), T::one(), (powered - T::number(low)) / T::number(high - low))
    }

    /// Where the threshold begins and ends.
    pub(crate) fn threshold(&self) -> [f64; 2] {
        [self.coverage - self.softness, self.coverage + self.softness]
    }

    /// The texel of a value of the blended noise. NaN, a negative value to a broken power, gives 0.
    pub fn byte<T: Float + Number>(&self, value: T) -> u8 {
        (self.density(value) * T::number(255.0)).floor().to_u8().unwrap_or(0)
    }
}
