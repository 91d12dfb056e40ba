//! Light that arrives at the vertices of a grid, in spherical harmonics: what path tracing has found beforehand, for marches that read it.
//!
//! Between two collisions light knows nothing of the camera. What arrives at a place from all directions, but for the suns themselves, so is the same
//! for all pictures of a cloud under its suns, and smooth: scattering has spread it. A vertex keeps the coefficients of its radiance L in real
//! orthonormal spherical harmonics, c_lm = int L(w) Y_lm(w) dw, for red, green and blue. A phase function of the angle alone is diagonal in
//! them (Funk and Hecke): what is scattered into the direction of a ray is sum_lm a_l Y_lm(ray) c_lm, with the moments a_l = 2 pi int p(c) P_l(c) dc.
//! So a sample of a ray costs one trilinear read, with weights that the ray has from its begin (Ramamoorthi and Hanrahan 2001, "An Efficient
//! Representation for Irradiance Environment Maps", for the form; Sloan, Kautz and Snyder 2002 for volumes of it).
//!
//! The suns' own light is not smooth: it has the edges of shadows. Of each sun a finer grid keeps the density times length towards it, in the place
//! of a march there.
//!
//! What is lost: harmonics above the largest band, detail finer than the grids (thin sheets of a medium are brighter inside than a line between
//! two vertices, so that coarse grids lose light), and the noise of the paths. Twin of the reading: `shaders/engines/march.wgsl`, `from_volume` and
//! `column`.

use crate::media::density::Density;
use crate::media::lattice::{vertex, vertices_around, vertices_of};
use crate::media::region::Region;
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// Largest band that a volume may keep.
pub const MOST_BANDS: u32 = 3;

/// Most cells along a side: 16 coefficients of 16 bytes at each of 257^3 vertices are 4 GiB.
pub const MOST_CELLS: u32 = 256;

/// Most paths of a vertex.
pub const MOST_PATHS: u32 = 1 << 16;

/// How a volume is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightVolumeSettings {
    /// Cells along the longest world side of the occupied part of the medium, 1 to [`MOST_CELLS`].
    pub cells: u32,
    /// Paths from a vertex, 1 to [`MOST_PATHS`].
    #[serde(default = "paths")]
    pub paths: u32,
    /// Largest band of the harmonics, 0 to [`MOST_BANDS`].
    #[serde(default = "bands")]
    pub bands: u32,
    /// Cells along the longest side of the grid that the suns' own light has, at most [`MOST_CELLS`]; 0: it is marched for.
    #[serde(default = "shadow_cells")]
    pub shadow_cells: u32,
    /// Chooses the random numbers.
    #[serde(default)]
    pub seed: u32,
}

fn paths() -> u32 {
    16
}

fn bands() -> u32 {
    1
}

fn shadow_cells() -> u32 {
    128
}

impl LightVolumeSettings {
    /// With the default of everything else.
    pub fn of_cells(cells: u32) -> Self {
        Self { cells, paths: paths(), bands: bands(), shadow_cells: shadow_cells(), seed: 0 }
    }

    /// Coefficients of a vertex and channel.
    pub fn coefficients(&self) -> usize {
        (self.bands as usize + 1).pow(2)
    }
}

/// A grid over the occupied part of a medium; which of its vertices a march may read.
#[derive(Debug, Clone, PartialEq)]
pub struct LightGrid {
    /// Vertices per axis, at least 2.
    pub size: [usize; 3],
    /// Place of the first vertex, in the frame of the density.
    pub low: DVec3,
    /// From a vertex to the next along each axis.
    pub step: DVec3,
    /// Vertices of cells in which there may be something: numbers, x fastest.
    pub read: Vec<usize>,
}

impl LightGrid {
    /// With so many cells along the longest world side of the occupied part of a density.
    pub fn over(density: &Density, to_local: &DMat4, cells: u32) -> Self {
        let occupied = density.occupied;
        if occupied.is_empty() {
            return Self { size: [2; 3], low: occupied.low, step: DVec3::ONE, read: Vec::new() };
        }
        let (size, step) = vertices_of(&occupied, to_local, cells);
        let low = occupied.low;
        let mut is_read = vec![false; size.iter().product()];
        let [across, along, up] = size;
        for z in 0..up - 1 {
            for y in 0..along - 1 {
                for x in 0..across - 1 {
                    let first = (z * along + y) * across + x;
                    let corner = vertex(first, size, low, step);
                    if !density.may_hold_within(&Region { low: corner, high: corner + step }) {
                        continue;
                    }
                    for number in 0..8 {
                        let [right, back, above] = [number & 1, number >> 1 & 1, number >> 2];
                        is_read[first + right + (back + above * along) * across] = true;
                    }
                }
            }
        }
        Self { size, low, step, read: (0..is_read.len()).filter(|&index| is_read[index]).collect() }
    }

    /// Place of a vertex, in the frame of the density.
    pub fn place(&self, index: usize) -> DVec3 {
        vertex(index, self.size, self.low, self.step)
    }

    /// The eight vertices around a place, or around the nearest place of the grid, each with its share.
    fn around(&self, place: DVec3) -> [(usize, f32); 8] {
        vertices_around((place - self.low) / self.step, self.size)
    }
}

/// Density times length towards the suns at the vertices of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Columns {
    /// The grid.
    pub grid: LightGrid,
    /// Of each sun those of all vertices, x fastest, in units of length.
    pub values: Vec<f32>,
}

impl Columns {
    /// Of the columns of the vertices that are [`LightGrid::read`], one list for each sun.
    pub fn new(grid: LightGrid, suns: &[Vec<f64>]) -> Self {
        let vertices: usize = grid.size.iter().product();
        let mut values = vec![0.0; vertices * suns.len()];
        for (found, values) in suns.iter().zip(values.chunks_exact_mut(vertices)) {
            grid.read.iter().zip(found).for_each(|(&index, column)| values[index] = *column as f32);
        }
        Self { grid, values }
    }

    /// Density times length from a place towards a sun.
    pub fn read(&self, sun: usize, place: DVec3) -> f64 {
        let vertices: usize = self.grid.size.iter().product();
        let values = &self.values[sun * vertices..];
        f64::from(self.grid.around(place).into_iter().map(|(index, share)| share * values[index]).sum::<f32>())
    }
}

/// Radiance in spherical harmonics at the vertices of a grid.
#[derive(Debug, Clone, PartialEq)]
pub struct LightVolume {
    grid: LightGrid,
    settings: LightVolumeSettings,
    /// Coefficients of each vertex, one after the other, x fastest: red, green, blue and nothing.
    rows: Vec<[f32; 4]>,
    suns: Vec<DVec3>,
    columns: Option<Columns>,
    seconds: f64,
}

/// What a volume is, for whoever reads of a picture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LightVolumeReport {
    /// How it was made.
    pub settings: LightVolumeSettings,
    /// Vertices per axis of the scattered light.
    pub vertices: [usize; 3],
    /// Those that paths began at: the others lie where nothing is.
    pub traced: usize,
    /// Bytes that a march reads from.
    pub bytes: usize,
    /// Seconds of wall time that it took.
    pub seconds: f64,
}

impl LightVolume {
    /// Of the coefficients of the vertices that are [`LightGrid::read`], one vertex after the other.
    ///
    /// # Panics
    /// Where there are more or fewer of them.
    pub fn new(
        grid: LightGrid,
        settings: LightVolumeSettings,
        found: &[[f64; 3]],
        suns: Vec<DVec3>,
        columns: Option<Columns>,
        seconds: f64,
    ) -> Self {
        let count = settings.coefficients();
        assert_eq!(found.len(), count * grid.read.len());
        let mut rows = vec![[0.0; 4]; count * grid.size.iter().product::<usize>()];
        for (&index, found) in grid.read.iter().zip(found.chunks_exact(count)) {
            for (row, [red, green, blue]) in rows[count * index..].iter_mut().zip(found) {
                *row = [*red as f32, *green as f32, *blue as f32, 0.0];
            }
        }
        Self { grid, settings, rows, suns, columns, seconds }
    }

    /// Its grid.
    pub fn grid(&self) -> &LightGrid {
        &self.grid
    }

    /// Unit vectors of the world towards the suns whose light it has.
    pub fn suns(&self) -> &[DVec3] {
        &self.suns
    }

    /// Density times length towards the suns, where it is kept.
    pub fn columns(&self) -> Option<&Columns> {
        self.columns.as_ref()
    }

    /// How it was made.
    pub fn settings(&self) -> &LightVolumeSettings {
        &self.settings
    }

    /// Coefficients of each vertex, one after the other, x fastest, as the adapter reads them.
    pub fn rows(&self) -> &[[f32; 4]] {
        &self.rows
    }

    /// What it is.
    pub fn report(&self) -> LightVolumeReport {
        LightVolumeReport {
            settings: self.settings,
            vertices: self.grid.size,
            traced: self.grid.read.len(),
            bytes: size_of_val(self.rows.as_slice())
                + self.columns.as_ref().map_or(0, |columns| size_of_val(columns.values.as_slice())),
            seconds: self.seconds,
        }
    }

    /// The sum of the coefficients at a place of the density's frame with these weights, one for each coefficient: radiance, of which what is
    /// below 0, as harmonics may have it, counts as 0. Places outside of the grid have its nearest place's.
    pub fn read(&self, place: DVec3, weights: &[f32]) -> [f64; 3] {
        let count = weights.len();
        let mut sum = [0.0_f32; 4];
        for (vertex, share) in self.grid.around(place) {
            let rows = &self.rows[count * vertex..count * (vertex + 1)];
            for (row, weight) in rows.iter().zip(weights) {
                let weight = share * weight;
                (0..4).for_each(|lane| sum[lane] += weight * row[lane]);
            }
        }
        // What is no number stays to be seen.
        [0, 1, 2].map(|channel| if sum[channel] < 0.0 { 0.0 } else { f64::from(sum[channel]) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Program;
    use std::sync::Arc;

    fn grid(size: [usize; 3]) -> LightGrid {
        let read = (0..size.iter().product()).collect();
        LightGrid { size, low: DVec3::new(-1.0, 0.0, 2.0), step: DVec3::new(0.5, 0.25, 2.0), read }
    }

    #[test]
    fn what_is_linear_between_vertices_is_read_as_it_is() {
        let settings = LightVolumeSettings { bands: 1, ..LightVolumeSettings::of_cells(4) };
        let grid = grid([3, 4, 2]);
        let linear = |place: DVec3, number: usize| {
            let value = 10.0 + place.x - 2.0 * place.y + 0.5 * place.z + number as f64;
            [value, 2.0 * value, -value]
        };
        let found: Vec<[f64; 3]> = grid
            .read
            .iter()
            .flat_map(|&index| (0..4).map(move |number| (index, number)))
            .map(|(index, number)| linear(grid.place(index), number))
            .collect();
        let towards = grid.read.iter().map(|&index| 3.0 + grid.place(index).x + grid.place(index).z).collect();
        let columns = Columns::new(grid.clone(), &[vec![1.0; 24], towards]);
        let volume = LightVolume::new(grid, settings, &found, vec![DVec3::X, DVec3::Z], Some(columns), 0.0);
        let weights = [1.0, 0.5, -0.25, 0.125];
        for place in [[-1.0, 0.0, 2.0], [-0.3, 0.4, 2.7], [0.0, 0.75, 4.0], [-0.5, 0.25, 3.0]].map(DVec3::from) {
            let truth: f64 =
                weights.iter().enumerate().map(|(number, &weight)| f64::from(weight) * linear(place, number)[0]).sum();
            let [red, green, blue] = volume.read(place, &weights);
            // Values up to 40 through some 40 roundings of f32.
            assert!((red - truth).abs() < 2e-4 && (green - 2.0 * truth).abs() < 4e-4, "{place}: {red}, not {truth}");
            assert_eq!(blue, 0.0, "what is below 0 counts as 0");
            let columns = volume.columns().expect("they are there");
            let [first, second] = [0, 1].map(|sun| columns.read(sun, place));
            assert!((first - 1.0).abs() < 1e-6 && (second - 3.0 - place.x - place.z).abs() < 1e-5, "{place}: {second}");
        }
        let outside = volume.read(DVec3::new(9.0, 9.0, 9.0), &weights);
        assert_eq!(outside, volume.read(DVec3::new(0.0, 0.75, 4.0), &weights));
        let report = volume.report();
        assert_eq!((report.vertices, report.traced, report.bytes), ([3, 4, 2], 24, 24 * 4 * 16 + 2 * 24 * 4));
    }

    #[test]
    fn nothing_is_read_where_there_is_nothing() {
        let region = Region { low: DVec3::splat(-0.5), high: DVec3::splat(0.5) };
        let full = Density::filling(Arc::new(Program::constant("one", 1.0)), region);
        let grid = LightGrid::over(&full, &DMat4::from_scale(DVec3::new(1.0, 0.5, 1.0)), 8);
        // The second axis is twice as long in the world.
        assert_eq!(grid.size, [5, 9, 5]);
        assert_eq!(grid.read.len(), 5 * 9 * 5);
        assert!(grid.place(5 * 9 * 5 - 1).distance(region.high) < 1e-12);
        let empty = Density::new(Arc::new(Program::constant("none", 0.0)), region).expect("a density");
        let grid = LightGrid::over(&empty, &DMat4::IDENTITY, 8);
        assert!(grid.read.is_empty());
        let volume = LightVolume::new(grid, LightVolumeSettings::of_cells(8), &[], Vec::new(), None, 0.0);
        assert_eq!(volume.read(DVec3::ZERO, &[1.0; 4]), [0.0; 3]);
    }
}
