//! Gradient noise over a permutation, and its sum over octaves (Perlin 2002, "Improving noise", with one look-up more).
//!
//! A place is f64 whatever the noise is computed in: a coordinate is taken apart into its lattice cell, modulo 256, and its part of the
//! cell before it becomes a [`Number`] ([`cell_and_part`]). In f32 a coordinate of 31337 would have 11 bits left behind the point; its part
//! of a cell has all 24, however far from the origin the place and however high the octave is.

use crate::base::arrays::Mapped;
use crate::nodes::perlin_fbm::random::Permutation;
use crate::nodes::running_error::RunningError;
use serde::{Deserialize, Serialize};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// What the noise is computed in, once coordinates have lost their cell.
pub trait Number:
    Copy
    + Send
    + Sync
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
{
    /// A double, rounded.
    fn number(value: f64) -> Self;
}

impl Number for f64 {
    fn number(value: f64) -> Self {
        value
    }
}

impl Number for f32 {
    fn number(value: f64) -> Self {
        value as Self
    }
}

/// f32 with a bound on its distance from the exact value: what f32 and adapters are judged by.
impl Number for RunningError {
    fn number(value: f64) -> Self {
        Self::rounded(value)
    }
}

/// Which noise: the two differ in the number of look-ups, so they are different fields over one table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// Four look-ups: what the volume is baked from.
    Volume,
    /// Three: what deforms the mask.
    Mask,
}

/// Octaves of noise.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Octaves {
    /// How many; at least 1.
    pub count: u32,
    /// Amplitude over that of the octave before.
    pub persistence: f64,
    /// Frequency over that of the octave before.
    pub lacunarity: f64,
}

/// The lattice cell of a coordinate, modulo the lattice's period of 256, and its part of the cell, 0 to 1: exact in f64, rounded once in
/// the number type. A part that rounds to 1 is the next cell's beginning, where noise is the same.
pub fn cell_and_part<T: Number>(coordinate: f64) -> (usize, T) {
    let floor = coordinate.floor();
    // From 2^63 on doubles are multiples of 256; there and without a number the original's 32 bits are 0 as well.
    let cell = if floor.abs() < 9e18 { (floor as i64 & 255) as usize } else { 0 };
    (cell, T::number(coordinate - floor))
}

/// Noise in about [-1, 1] at a place in units of the lattice, which repeats after 256. In f64 values are those of the original's
/// order of operations.
pub fn noise<T: Number>(field: Field, table: &Permutation, place: [f64; 3]) -> T {
    let taken_apart = place.mapped(cell_and_part::<T>);
    let (cells, fractions) = (taken_apart.mapped(|(cell, _)| cell), taken_apart.mapped(|(_, part)| part));
    let [u, v, w] = fractions.mapped(fade);
    let look_up = |index: usize| usize::from(table[index & 255]);
    let one = T::number(1.0);
    let corner = |upper: [usize; 3]| {
        let mut hash = look_up(cells[0] + upper[0]);
        hash = look_up(hash + cells[1] + upper[1]);
        hash = look_up(hash + cells[2] + upper[2]);
        if field == Field::Volume {
            hash = look_up(hash);
        }
        let from = |axis: usize| if upper[axis] == 1 { fractions[axis] - one } else { fractions[axis] };
        gradient(hash & 15, [from(0), from(1), from(2)])
    };
    let along_x = |y: usize, z: usize| lerp(u, corner([0, y, z]), corner([1, y, z]));
    let along_y = |z: usize| lerp(v, along_x(0, z), along_x(1, z));
    lerp(w, along_y(0), along_y(1))
}

/// Octaves of the volume's noise, divided by the sum of amplitudes.
pub fn octaves<T: Number>(table: &Permutation, place: [f64; 3], octaves: &Octaves) -> T {
    let persistence = T::number(octaves.persistence);
    let (mut sum, mut amplitudes, mut amplitude) = (T::number(0.0), T::number(0.0), T::number(1.0));
    let mut frequency = 1.0;
    for _ in 0..octaves.count {
        sum = sum + noise::<T>(Field::Volume, table, place.mapped(|coordinate| coordinate * frequency)) * amplitude;
        amplitudes = amplitudes + amplitude;
        amplitude = amplitude * persistence;
        frequency *= octaves.lacunarity;
    }
    sum / amplitudes
}

/// t^3 (t (6 t - 15) + 10).
pub(crate) fn fade<T: Number>(t: T) -> T {
    let [six, ten, fifteen] = [6.0, 10.0, 15.0].mapped(T::number);
    t * t * t * (t * (t * six - fifteen) + ten)
}

pub(crate) fn lerp<T: Number>(t: T, a: T, b: T) -> T {
    a + t * (b - a)
}

/// One of 16 gradients that point to the edges of a cube (four of them twice), times the offset from a corner.
fn gradient<T: Number>(hash: usize, [x, y, z]: [T; 3]) -> T {
    let u = if hash < 8 { x } else { y };
    let v = match hash {
        0..4 => y,
        12 | 14 => x,
        _ => z,
    };
    let signed = |value: T, bit: usize| if hash & bit == 0 { value } else { -value };
    signed(u, 1) + signed(v, 2)
}
