//! Gradient noise over a permutation, and its sum over octaves (Perlin 2002, "Improving noise", with one look-up more).

use crate::nodes::perlin_fbm::random::Permutation;
use num_traits::Float;
use serde::{Deserialize, Serialize};

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

/// Noise in about [-1, 1] at a place in units of the lattice, which repeats after 256. Values are those of the original's
/// order of operations.
pub fn noise<T: Float>(field: Field, table: &Permutation, place: [T; 3]) -> T {
    let floors = place.map(Float::floor);
    // The lattice repeats after 256 in both directions.
    let cells = floors.map(|floor| (floor.to_i64().unwrap_or(0) & 255) as usize);
    let fractions: [T; 3] = std::array::from_fn(|axis| place[axis] - floors[axis]);
    let [u, v, w] = fractions.map(fade);
    let look_up = |index: usize| usize::from(table[index & 255]);
    let corner = |upper: [usize; 3]| {
        let mut hash = look_up(cells[0] + upper[0]);
        hash = look_up(hash + cells[1] + upper[1]);
        hash = look_up(hash + cells[2] + upper[2]);
        if field == Field::Volume {
            hash = look_up(hash);
        }
        let from = |axis: usize| if upper[axis] == 1 { fractions[axis] - T::one() } else { fractions[axis] };
        gradient(hash & 15, [from(0), from(1), from(2)])
    };
    let along_x = |y: usize, z: usize| lerp(u, corner([0, y, z]), corner([1, y, z]));
    let along_y = |z: usize| lerp(v, along_x(0, z), along_x(1, z));
    lerp(w, along_y(0), along_y(1))
}

/// Octaves of the volume's noise, divided by the sum of amplitudes.
pub fn octaves<T: Float>(table: &Permutation, place: [T; 3], octaves: &Octaves) -> T {
    let convert = |value: f64| T::from(value).expect("a float holds any double, rounded");
    let (persistence, lacunarity) = (convert(octaves.persistence), convert(octaves.lacunarity));
    let (mut sum, mut amplitudes) = (T::zero(), T::zero());
    let (mut amplitude, mut frequency) = (T::one(), T::one());
    for _ in 0..octaves.count {
        sum = sum + noise(Field::Volume, table, place.map(|coordinate| coordinate * frequency)) * amplitude;
        amplitudes = amplitudes + amplitude;
        amplitude = amplitude * persistence;
        frequency = frequency * lacunarity;
    }
    sum / amplitudes
}

/// t^3 (t (6 t - 15) + 10).
fn fade<T: Float>(t: T) -> T {
    let [six, ten, fifteen] = [6.0, 10.0, 15.0].map(|value| T::from(value).expect("a small whole number"));
    t * t * t * (t * (t * six - fifteen) + ten)
}

fn lerp<T: Float>(t: T, a: T, b: T) -> T {
    a + t * (b - a)
}

/// One of 16 gradients that point to the edges of a cube (four of them twice), times the offset from a corner.
fn gradient<T: Float>(hash: usize, [x, y, z]: [T; 3]) -> T {
    let u = if hash < 8 { x } else { y };
    let v = match hash {
        0..4 => y,
        12 | 14 => x,
        _ => z,
    };
    let signed = |value: T, bit: usize| if hash & bit == 0 { value } else { -value };
    signed(u, 1) + signed(v, 2)
}
