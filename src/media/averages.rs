//! A density averaged over cells, as a mip level of a density texture holds it: what surrounds a place, without its detail.
//!
//! Light that is scattered many times spreads, so that it follows the density around a place and not the one at it. Engines that keep a
//! density in a texture have such averages for a trilinear read. Two levels: [`CELLS`] cells per axis, which a march towards
//! the sun reads, and half of it, for what surrounds a place. Between centres of cells values are linear; beyond the outermost centres they
//! stay. Both are programs like the density that they stand for, in its frame.

use crate::base::error::{Error, Result};
use crate::base::texture::{Outside, Texels, Texture, TextureFilter, TextureHandle};
use crate::graph::Program;
use crate::media::density::Density;
use crate::media::region::Region;
use glam::DVec3;
use std::sync::Arc;

/// Cells per axis of the finer level.
pub const CELLS: usize = 32;

/// Places per axis of a cell over which its density is averaged.
const PLACES: usize = 3;

/// Both levels.
#[derive(Clone)]
pub struct Averages {
    /// The density around a place, as a march towards the sun reads it.
    pub along: Arc<Program>,
    /// The same, wider.
    pub around: Arc<Program>,
}

impl Averages {
    /// Averages a density over the cells of its box.
    pub fn of(density: &Density) -> Result<Self> {
        let Region { low, high } = density.bounds;
        let side = (high - low) / CELLS as f64;
        if !(side.is_finite() && side.max_element() < 1e6) {
            return Err(Error::new(
                "averages of a density",
                format!("a box from {low} to {high}"),
                "a box with ends: averages are kept in a texture",
                "Leave out the light terms body and coarse shadow.",
            ));
        }
        let mut fine = Vec::with_capacity(CELLS.pow(3));
        for z in 0..CELLS {
            fine.extend(layer(density, side, z)?);
        }
        let half = CELLS / 2;
        let mut wide = vec![0.0; half.pow(3)];
        for (index, value) in fine.iter().enumerate() {
            let [x, y, z] = [index % CELLS, index / CELLS % CELLS, index / (CELLS * CELLS)];
            wide[(z / 2 * half + y / 2) * half + x / 2] += value / 8.0;
        }
        let program = |name: &str, values: Vec<f32>, cells: usize| {
            let texture = Texture::new([cells; 3], Texels::F32(values), TextureFilter::Trilinear, Outside::Clamp);
            // The middle of the first cell has index 0.
            let scale = cells as f64 / (high - low);
            let origin = -low * scale - 0.5;
            let rows = std::array::from_fn(|axis| {
                let mut row = [0.0; 4];
                row[axis] = scale[axis] as f32;
                row[3] = origin[axis] as f32;
                row
            });
            Arc::new(Program::of_texture(name, TextureHandle::new(texture), rows))
        };
        Ok(Self { along: program("averages", fine, CELLS), around: program("wide averages", wide, half) })
    }
}

/// The cells of a layer, x fastest.
fn layer(density: &Density, side: DVec3, z: usize) -> Result<Vec<f32>> {
    let mut places = Vec::with_capacity(CELLS * CELLS * PLACES.pow(3));
    for cell in 0..CELLS * CELLS {
        let corner = DVec3::new((cell % CELLS) as f64, (cell / CELLS) as f64, z as f64);
        for place in 0..PLACES.pow(3) {
            let part = [place % PLACES, place / PLACES % PLACES, place / PLACES.pow(2)];
            let inner = DVec3::from(part.map(|part| (part as f64 + 0.5) / PLACES as f64));
            places.push((density.bounds.low + (corner + inner) * side).as_vec3().to_array());
        }
    }
    let found = density.values(&places)?;
    let mean =
        |values: &[f32]| (values.iter().map(|&value| f64::from(value)).sum::<f64>() / values.len() as f64) as f32;
    Ok(found.chunks_exact(PLACES.pow(3)).map(mean).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::evaluate::Points;

    #[test]
    fn averages_of_a_linear_density_are_its_values_between_the_outermost_centres() {
        // 2 (z + 0.5) between the middles of two texels.
        let texture = Texture::new([1, 1, 2], Texels::F32(vec![0.0, 2.0]), TextureFilter::Trilinear, Outside::Clamp);
        let rows = [[0.0; 4], [0.0; 4], [0.0, 0.0, 1.0, 0.5]];
        let ramp = Program::of_texture("ramp", TextureHandle::new(texture), rows);
        let region = Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
        let found = Averages::of(&Density::new(Arc::new(ramp), region).expect("a density")).expect("a box");
        let read = |program: &Program, place: [f32; 3]| {
            program.evaluate_single(Points::new(&[place])).expect("no attributes")[0]
        };
        for place in [[0.0; 3], [0.3, -0.49, 0.21], [-0.5, 0.5, -0.45]] {
            let truth = 2.0 * (place[2] + 0.5);
            // Values up to 2, some ten roundings.
            assert!((read(&found.along, place) - truth).abs() < 2e-6, "{place:?}");
            assert!((read(&found.around, place) - truth).abs() < 2e-6, "{place:?}");
        }
        // Half a cell from the face values stay.
        assert!((read(&found.along, [0.5; 3]) - (2.0 - 1.0 / CELLS as f32)).abs() < 2e-6);
    }
}
