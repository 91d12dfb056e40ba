//! The bake row by row: the values of [`Bake::blend`](super::bake::Bake::blend), to the bit, for a fraction of its work.
//!
//! A coordinate of the noise depends on one axis, one copy of the blend and one octave, so cells, fractions and fades are tables.
//! Along a row of texels y and z stand still: at a lattice point the gradient's dot product is then a x + b for the
//! texel's x, where a and b have one of 16 values for each of the four lattice rows around the texels. Adding the part of a gradient
//! that is 0 changes no value, and the interpolation along x, y and z keeps its order, so every rounding is that of the
//! straightforward evaluation.

use crate::base::arrays::{Mapped, each};
use crate::nodes::perlin_fbm::noise::{Number, Octaves, cell_and_part, fade, lerp};
use crate::nodes::perlin_fbm::random::Permutation;
use rayon::prelude::*;

/// Corners of the blend in the order of the sum, which decides its rounding.
pub(crate) const CORNERS: [[usize; 3]; 8] =
    [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1], [1, 1, 1]];

/// Noise across the unit box: what a bake blends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Waves {
    /// Units of noise across the box.
    pub scale: f64,
    /// What coordinates are shifted by.
    pub seed: f64,
    /// Octaves of the noise.
    pub octaves: Octaves,
}

/// The 16 gradients: what each axis counts for.
const GRADIENTS: [[i8; 3]; 16] = [
    [1, 1, 0],
    [-1, 1, 0],
    [1, -1, 0],
    [-1, -1, 0],
    [1, 0, 1],
    [-1, 0, 1],
    [1, 0, -1],
    [-1, 0, -1],
    [0, 1, 1],
    [0, -1, 1],
    [0, 1, -1],
    [0, -1, -1],
    [1, 1, 0],
    [0, -1, 1],
    [-1, 1, 0],
    [0, -1, -1],
];

/// Dot products at a lattice point of the four rows around a row of texels: slope and value, row (y, z) at index y + 2 z.
type Slopes<T> = [[T; 4]; 2];

/// The coordinates of an axis in one copy of the blend and one octave, for every texel.
pub(crate) struct Axis<T> {
    /// Lattice cell modulo 256.
    pub(crate) cells: Vec<usize>,
    /// Place in the cell, 0 to 1.
    pub(crate) fractions: Vec<T>,
    /// Weight of the cell's end in the interpolation.
    pub(crate) fades: Vec<T>,
    /// Lattice points that the texels lie between, each once, modulo 256.
    points: Vec<usize>,
    /// Number of the lattice point before each texel; the next one lies after it.
    before: Vec<usize>,
}

impl<T: Number> Axis<T> {
    /// From coordinates in f64, which lose their cell before they become a `T`.
    fn new(coordinates: impl Iterator<Item = f64>) -> Self {
        let mut axis = Self {
            cells: Vec::new(),
            fractions: Vec::new(),
            fades: Vec::new(),
            points: Vec::new(),
            before: Vec::new(),
        };
        // The floor at the second of the last two points.
        let mut last = f64::NAN;
        for coordinate in coordinates {
            let floor = coordinate.floor();
            let (cell, part) = cell_and_part(coordinate);
            if floor == last {
                axis.points.push((cell + 1) & 255);
            } else if floor + 1.0 != last {
                axis.points.extend([cell, (cell + 1) & 255]);
            }
            last = floor + 1.0;
            axis.before.push(axis.points.len() - 2);
            axis.cells.push(cell);
            axis.fractions.push(part);
            axis.fades.push(fade(part));
        }
        axis
    }
}

/// Everything that no row changes.
pub(crate) struct Tables<'a, T> {
    /// The permutation, and the last two of its look-ups in one, as the number of a gradient.
    first: &'a Permutation,
    pub(crate) last: [u8; 256],
    /// Place of each texel in the box.
    places: Vec<T>,
    /// Per axis, copy (0 or 1 along that axis) and octave. Axes differ in nothing, so there is one of them.
    pub(crate) axes: [Vec<Axis<T>>; 2],
    pub(crate) amplitudes: Vec<T>,
    pub(crate) amplitude_sum: T,
}

/// The blended noise of all texels, x fastest.
pub(crate) fn blend<T: Number>(waves: &Waves, table: &Permutation, side: usize) -> Vec<T> {
    let tables = Tables::new(waves, table, side);
    let mut values = vec![T::number(0.0); side.pow(3)];
    // Layers of one z, whose rows run through y.
    values.par_chunks_mut(side * side).enumerate().for_each(|(z, layer)| {
        fearless_simd::dispatch!(crate::nodes::lane_level(), simd => {
            let _ = simd;
            tables.layer(z, layer);
        });
    });
    values
}

impl<'a, T: Number> Tables<'a, T> {
    pub(crate) fn new(waves: &Waves, table: &'a Permutation, side: usize) -> Self {
        let Waves { scale, seed, octaves } = *waves;
        let persistence = T::number(octaves.persistence);
        let places: Vec<f64> = (0..side).map(|number| number as f64 / (side - 1) as f64).collect();
        let mut tables = Self {
            first: table,
            last: each(|index| table[usize::from(table[index])] & 15),
            places: places.iter().map(|&place| T::number(place)).collect(),
            axes: [Vec::new(), Vec::new()],
            amplitudes: Vec::new(),
            amplitude_sum: T::number(0.0),
        };
        let (mut amplitude, mut frequency) = (T::number(1.0), 1.0);
        for _ in 0..octaves.count {
            for (copy, axes) in tables.axes.iter_mut().enumerate() {
                axes.push(Axis::new(places.iter().map(|&place| {
                    let base = place * scale + seed;
                    (if copy == 1 { base - scale } else { base }) * frequency
                })));
            }
            tables.amplitudes.push(amplitude);
            tables.amplitude_sum = tables.amplitude_sum + amplitude;
            amplitude = amplitude * persistence;
            frequency *= octaves.lacunarity;
        }
        tables
    }

    #[inline(always)]
    fn layer(&self, z: usize, layer: &mut [T]) {
        let side = self.places.len();
        let mut noise = vec![T::number(0.0); side];
        let one = T::number(1.0);
        let mut slopes: Vec<Slopes<T>> = Vec::new();
        for (y, row) in layer.chunks_exact_mut(side).enumerate() {
            for corner in CORNERS {
                noise.fill(T::number(0.0));
                for octave in 0..self.amplitudes.len() {
                    let [along_x, along_y, along_z] = corner.mapped(|copy| &self.axes[copy][octave]);
                    self.dot_products(along_x, [(along_y, y), (along_z, z)], &mut slopes);
                    add_octave(
                        along_x,
                        [along_y.fades[y], along_z.fades[z]],
                        &slopes,
                        self.amplitudes[octave],
                        &mut noise,
                    );
                }
                let weight = |axis: usize, place: T| if corner[axis] == 1 { place } else { one - place };
                let [along_y, along_z] = [weight(1, self.places[y]), weight(2, self.places[z])];
                for ((sum, noise), &place) in row.iter_mut().zip(&noise).zip(&self.places) {
                    *sum = *sum + *noise / self.amplitude_sum * weight(0, place) * along_y * along_z;
                }
            }
            for value in row {
                *value = (*value + one) / T::number(2.0);
            }
        }
    }

    /// Slopes and values at the lattice points along x, for the texel row at these places of y and z.
    #[inline(always)]
    fn dot_products(&self, along_x: &Axis<T>, across: [(&Axis<T>, usize); 2], slopes: &mut Vec<Slopes<T>>) {
        let [y, z] = across.mapped(|(axis, place)| axis.fractions[place]);
        let [cell_y, cell_z] = across.mapped(|(axis, place)| axis.cells[place]);
        let one = T::number(1.0);
        let part = |sign: i8| T::number(f64::from(sign));
        let dot: [[[T; 2]; 16]; 4] = each(|row| {
            let [from_y, from_z] = [(y, row & 1), (z, row >> 1)].mapped(|(t, up)| if up == 1 { t - one } else { t });
            each(|gradient| {
                let [a, b, c] = GRADIENTS[gradient].mapped(part);
                [a, b * from_y + c * from_z]
            })
        });
        slopes.clear();
        slopes.extend(along_x.points.iter().map(|&point| {
            let first = usize::from(self.first[point]);
            let second = [0, 1].mapped(|up| usize::from(self.first[(first + cell_y + up) & 255]));
            let found: [[T; 2]; 4] = each(|row| {
                let gradient = self.last[(second[row & 1] + cell_z + (row >> 1)) & 255];
                dot[row][usize::from(gradient & 15)]
            });
            [0, 1].mapped(|part| each(|row| found[row][part]))
        }));
    }
}

/// Adds one octave of noise along a row.
#[inline(always)]
fn add_octave<T: Number>(axis: &Axis<T>, fades: [T; 2], slopes: &[Slopes<T>], amplitude: T, noise: &mut [T]) {
    let one = T::number(1.0);
    let texels = axis.before.iter().zip(&axis.fractions).zip(&axis.fades);
    for (((&before, &from), &fade), sum) in texels.zip(noise) {
        let [low, high] = [&slopes[before], &slopes[before + 1]];
        let to = from - one;
        let rows: [T; 4] = each(|row| lerp(fade, low[0][row] * from + low[1][row], high[0][row] * to + high[1][row]));
        let value = lerp(fades[1], lerp(fades[0], rows[0], rows[1]), lerp(fades[0], rows[2], rows[3]));
        *sum = *sum + value * amplitude;
    }
}
