//! A density averaged over cells, as a mip level of a density texture holds it: what surrounds a place, without its detail.
//!
//! Light that is scattered many times spreads, so that it follows the density around a place and not the one at it. Engines that keep a
//! density in a texture have such averages for a trilinear read. Two levels: [`CELLS`] cells per axis, which a march towards
//! the sun reads, and half of it, for what surrounds a place. Between centres of cells values are linear; beyond the outermost centres they
//! stay, and outside of the box there is nothing.

use crate::base::error::Result;
use crate::graph::constants::{SharedConstants, SharedNumber};
use crate::media::density::DensityModel;
use glam::DVec3;
use rayon::prelude::*;

/// Cells per axis of the finer level.
pub const CELLS: usize = 32;

/// Numbers that the shader imports.
pub const CONSTANTS: SharedConstants = SharedConstants {
    path: "cloudparity::coarse::constants",
    numbers: &[("CELLS", SharedNumber::Unsigned(CELLS as u32))],
};

/// Places per axis of a cell over which its density is averaged.
const PLACES: usize = 3;

/// Both levels.
#[derive(Debug, Clone, PartialEq)]
pub struct CoarseDensity {
    fine: Vec<f32>,
    wide: Vec<f32>,
}

impl CoarseDensity {
    /// Averages a density over the cells of the box.
    pub fn of(density: &dyn DensityModel) -> Self {
        let layers: Vec<Vec<f32>> = (0..CELLS).into_par_iter().map(|z| layer(density, z)).collect();
        let fine = layers.concat();
        let half = CELLS / 2;
        let mut wide = vec![0.0; half.pow(3)];
        for (index, value) in fine.iter().enumerate() {
            let [x, y, z] = [index % CELLS, index / CELLS % CELLS, index / (CELLS * CELLS)];
            wide[(z / 2 * half + y / 2) * half + x / 2] += value / 8.0;
        }
        Self { fine, wide }
    }

    /// The density around a place, as a march towards the sun reads it.
    pub fn along(&self, place: DVec3) -> f64 {
        read(&self.fine, CELLS, place)
    }

    /// The density around a place, wider.
    pub fn around(&self, place: DVec3) -> f64 {
        read(&self.wide, CELLS / 2, place)
    }

    /// Both levels, x fastest, the finer one first: what the adapter reads.
    pub fn bytes(&self) -> Vec<u8> {
        [bytemuck::cast_slice(&self.fine), bytemuck::cast_slice(&self.wide)].concat()
    }
}

/// The cells of a layer, x fastest.
fn layer(density: &dyn DensityModel, z: usize) -> Vec<f32> {
    let side = 1.0 / CELLS as f64;
    let mut places = Vec::with_capacity(CELLS * CELLS * PLACES.pow(3));
    for cell in 0..CELLS * CELLS {
        let corner = DVec3::new((cell % CELLS) as f64, (cell / CELLS) as f64, z as f64) * side - 0.5;
        for place in 0..PLACES.pow(3) {
            let part = [place % PLACES, place / PLACES % PLACES, place / PLACES.pow(2)];
            places.push(corner + DVec3::from(part.map(|part| (part as f64 + 0.5) / PLACES as f64)) * side);
        }
    }
    let found = density.densities(&places);
    let mean = |values: &[f64]| (values.iter().sum::<f64>() / values.len() as f64) as f32;
    found.chunks_exact(PLACES.pow(3)).map(mean).collect()
}

/// Trilinear between the centres of cells.
fn read(values: &[f32], cells: usize, place: DVec3) -> f64 {
    if place.abs().max_element() > 0.5 {
        return 0.0;
    }
    let last = (cells - 1) as f64;
    let at = ((place + 0.5) * cells as f64 - 0.5).clamp(DVec3::ZERO, DVec3::splat(last));
    let low = at.floor().min(DVec3::splat(last - 1.0));
    let part = at - low;
    let [x, y, z] = low.to_array().map(|index| index as usize);
    let value = |dx: usize, dy: usize, dz: usize| f64::from(values[((z + dz) * cells + y + dy) * cells + x + dx]);
    let along_x = |dy, dz| value(0, dy, dz) + (value(1, dy, dz) - value(0, dy, dz)) * part.x;
    let along_y = |dz| along_x(0, dz) + (along_x(1, dz) - along_x(0, dz)) * part.y;
    along_y(0) + (along_y(1) - along_y(0)) * part.z
}

/// A density with its averages.
pub struct WithCoarse<'a> {
    /// The density itself.
    pub density: &'a dyn DensityModel,
    /// Its averages.
    pub coarse: &'a CoarseDensity,
}

impl DensityModel for WithCoarse<'_> {
    fn densities(&self, places: &[DVec3]) -> Vec<f64> {
        self.density.densities(places)
    }

    fn extinction(&self) -> [f64; 3] {
        self.density.extinction()
    }

    fn shader(&self) -> Result<crate::gpu::ModelShader> {
        self.density.shader()
    }

    fn coarse(&self) -> Option<&CoarseDensity> {
        Some(self.coarse)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::error::Error;
    use crate::gpu::ModelShader;

    /// Linear in z, 0 to 2.
    struct Ramp;

    impl DensityModel for Ramp {
        fn densities(&self, places: &[DVec3]) -> Vec<f64> {
            places.iter().map(|place| 2.0 * (place.z + 0.5)).collect()
        }

        fn extinction(&self) -> [f64; 3] {
            [1.0; 3]
        }

        fn shader(&self) -> Result<ModelShader> {
            Err(Error::new("ramp", "no shader", "none", "none"))
        }
    }

    #[test]
    fn averages_of_a_linear_density_are_its_values_between_the_outermost_centres() {
        let coarse = CoarseDensity::of(&Ramp);
        for place in [DVec3::ZERO, DVec3::new(0.3, -0.49, 0.21), DVec3::new(-0.5, 0.5, -0.45)] {
            let truth = 2.0 * (place.z + 0.5);
            assert!((coarse.along(place) - truth).abs() < 1e-6, "{place}");
            assert!((coarse.around(place) - truth).abs() < 1e-6, "{place}");
        }
        // Half a cell from the face values stay; outside there is nothing.
        assert!((coarse.along(DVec3::splat(0.5)) - (2.0 - 1.0 / CELLS as f64)).abs() < 1e-6);
        assert_eq!(coarse.along(DVec3::new(0.0, 0.0, 0.51)), 0.0);
        assert_eq!(coarse.bytes().len(), 4 * (CELLS.pow(3) + (CELLS / 2).pow(3)));
    }
}
