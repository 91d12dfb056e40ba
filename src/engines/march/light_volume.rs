//! A light volume as a march reads it: the weights that a ray gives to its coefficients; and the columns towards suns that it keeps.

use crate::base::error::{Error, Result};
use crate::engines::domain::Container;
use crate::engines::light::LightModel;
use crate::media::density::{Density, DensityEvaluator};
use crate::media::light_volume::{Columns, LightGrid, LightVolume, MOST_BANDS};
use crate::view::lights::{LARGEST_BAND, harmonics};
use glam::DVec3;
use rayon::prelude::*;

// A volume keeps as many bands as there are harmonics: its module knows none of them.
const _: () = assert!(MOST_BANDS as usize == LARGEST_BAND);

/// Vertices of a task.
const VERTICES: usize = 64;

/// Samples of a column per cell of its grid: places of a cached density differ over a cell, hardly over a half of one.
const SAMPLES_PER_CELL: f64 = 2.0;

/// Largest difference between the directions to a sun, of unit vectors that come from the same matrix.
const SAME_SUN: f64 = 1e-6;

/// The columns of a density in its domain towards suns, unit vectors of the world, on a grid with so many cells along its longest side.
pub fn columns(container: &Container, density: &Density, suns: &[DVec3], cells: u32) -> Result<Columns> {
    let grid = LightGrid::over(density, &container.to_local, cells);
    let to_world = container.to_local.inverse();
    let side = (0..3).map(|axis| to_world.col(axis).truncate().length() * grid.step[axis]).fold(0.0, f64::max);
    let longest = side / container.unit / SAMPLES_PER_CELL;
    let column = |towards: DVec3| -> Result<Vec<f64>> {
        let way = container.way(towards);
        let of_some = |indices: &[usize]| -> Result<Vec<f64>> {
            let mut density = DensityEvaluator::new(density)?;
            let (mut owners, mut asked) = (Vec::new(), Vec::new());
            for (owner, &index) in indices.iter().enumerate() {
                let place = grid.place(index);
                let parts = container.outline.parts_to_light(place, way);
                let steps = (parts.length / longest).ceil().max(1.0);
                for number in 0..steps as usize {
                    let passed = (number as f64 + 0.5) * parts.length / steps;
                    owners.push((owner, parts.length / steps));
                    asked.push(place + way * (parts.start + parts.distance(passed)));
                }
            }
            let mut sums = vec![0.0; indices.len()];
            for ((owner, step), found) in owners.into_iter().zip(density.values(&asked)) {
                sums[owner] += found * step;
            }
            Ok(sums)
        };
        let parts: Vec<Vec<f64>> = grid.read.par_chunks(VERTICES).map(of_some).collect::<Result<_>>()?;
        Ok(parts.concat())
    };
    let found = suns.iter().map(|&sun| column(sun)).collect::<Result<Vec<_>>>()?;
    Ok(Columns::new(grid, &found))
}

/// A light volume under a phase function.
pub struct ReadVolume<'a> {
    /// The volume.
    pub volume: &'a LightVolume,
    /// Moments of the phase function, one for each band, times the exposure.
    pub moments: Vec<f64>,
}

impl<'a> ReadVolume<'a> {
    /// Under the phase function and the exposure of a light.
    pub fn new(volume: &'a LightVolume, light: &LightModel) -> Self {
        let moments = light.phase.moments(volume.settings().bands);
        Self { volume, moments: moments.into_iter().map(|moment| moment * light.terms.exposure).collect() }
    }

    /// Refuses a volume with the light of other suns.
    pub(super) fn check(&self, light: &LightModel) -> Result<()> {
        let suns = self.volume.suns();
        let is_same = suns.len() == light.suns.len()
            && suns.iter().zip(&light.suns).all(|(own, sun)| own.distance(sun.towards()) < SAME_SUN);
        if is_same {
            return Ok(());
        }
        Err(Error::new(
            "the march of an engine",
            format!("{} suns, and a light volume of {} others", light.suns.len(), suns.len()),
            "a light volume of the same suns",
            "Find the light again where the suns have moved.",
        ))
    }

    /// Weights of the coefficients for a ray of the world; the unit direction is that of travel from the camera.
    pub fn weights(&self, direction: DVec3) -> Vec<f32> {
        let basis = harmonics(direction);
        let of_band = |band: usize| {
            basis[band * band..(band + 1) * (band + 1)].iter().map(move |value| (self.moments[band] * value) as f32)
        };
        (0..self.moments.len()).flat_map(of_band).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engines::defects::Defects;
    use crate::engines::light::TwoLobes;
    use crate::engines::parameters::Values;
    use crate::engines::perlin_fbm::settings;
    use crate::media::light_volume::{LightGrid, LightVolumeSettings};
    use crate::view::lights::sphere_directions;

    /// Radiance of bands 0 to 3 alone, scattered by summation over directions and by the volume.
    #[test]
    fn what_is_scattered_is_the_integral_of_phase_function_and_radiance() {
        let radiance = |direction: DVec3| {
            let basis = harmonics(direction);
            4.0 + (0..16).map(|number| basis[number] * (0.3 * number as f64 - 2.0) / 4.0).sum::<f64>()
        };
        let directions = sphere_directions(20_000);
        let share = 4.0 * std::f64::consts::PI / directions.len() as f64;
        let mut coefficients = vec![[0.0; 3]; 16];
        for &direction in &directions {
            for (sum, value) in coefficients.iter_mut().zip(harmonics(direction)) {
                (0..3).for_each(|channel| sum[channel] += share * value * radiance(direction));
            }
        }
        let grid = LightGrid { size: [2; 3], low: DVec3::ZERO, step: DVec3::ONE, read: (0..8).collect() };
        let settings = LightVolumeSettings { bands: 3, ..LightVolumeSettings::of_cells(1) };
        let volume = LightVolume::new(grid, settings, &coefficients.repeat(8), Vec::new(), None, 0.0);
        let mut light = settings::light(&Values::defaults(settings::PARAMETERS), &Defects::NONE);
        light.terms.exposure = 1.5;
        for phase in [TwoLobes::new([0.7, -0.3], 0.4), TwoLobes { alpha: [2.0, 0.0], ..TwoLobes::new([0.5, 0.1], 0.2) }]
        {
            light.phase = phase;
            let read = ReadVolume::new(&volume, &light);
            for ray in sphere_directions(7) {
                let truth: f64 =
                    directions.iter().map(|way| share * phase.evaluate(ray.dot(*way)) * radiance(*way)).sum();
                let [found, ..] = volume.read(DVec3::splat(0.4), &read.weights(ray));
                // The lattice of directions integrates to some 1/N; the rest are roundings of f32.
                assert!((found / (1.5 * truth) - 1.0).abs() < 1e-3, "{ray}: {found}, not {}", 1.5 * truth);
            }
        }
    }
}
