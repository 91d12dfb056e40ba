//! A tile of blue noise: every threshold of it is a pattern of points without clumps and gaps.
//!
//! Void and cluster (Ulichney 1993, "The void-and-cluster method for dither array generation", SPIE 1913), with a
//! Gaussian of 1.5 pixels on a torus. A small pattern is spread out by moving its most crowded point to its largest gap until they are
//! the same; ranks then count down by taking the most crowded point away, and up by filling the largest gap.

use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use std::sync::OnceLock;

/// Pixels per side.
pub const SIDE: usize = 64;

const PIXELS: usize = SIDE * SIDE;

/// Standard deviation of what a point covers: Ulichney's choice.
const SPREAD: f64 = 1.5;

/// Points of the first pattern: a tenth.
const FIRST: usize = PIXELS / 10;

/// Chooses the first pattern; another number would do as well.
const SEED: u64 = 1993;

/// The golden ratio's fraction: what a frame adds, so that the values of a pixel over frames are spread evenly.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// The value in [0, 1) of a pixel, counted from the bottom-left corner, in a frame.
pub fn value(column: usize, row: usize, frame: u32) -> f64 {
    static RANKS: OnceLock<Vec<u16>> = OnceLock::new();
    let ranks = RANKS.get_or_init(ranks);
    let rank = f64::from(ranks[row % SIDE * SIDE + column % SIDE]);
    in_frame((rank + 0.5) / PIXELS as f64, frame)
}

/// A value in [0, 1] of the first frame, moved on by the golden ratio for each later one; then in [0, 1).
pub(super) fn in_frame(value: f64, frame: u32) -> f64 {
    if frame == 0 { value } else { (value + f64::from(frame) * GOLDEN).fract() }
}

/// Points, and how crowded each pixel is.
struct Pattern {
    is_set: Vec<bool>,
    crowding: Vec<f64>,
}

impl Pattern {
    fn turn(&mut self, pixel: usize, kernel: &[f64]) {
        self.is_set[pixel] ^= true;
        let sign = if self.is_set[pixel] { 1.0 } else { -1.0 };
        let (x, y) = (pixel % SIDE, pixel / SIDE);
        for (row, line) in self.crowding.chunks_exact_mut(SIDE).enumerate() {
            let across = &kernel[(row + SIDE - y) % SIDE * SIDE..][..SIDE];
            for (column, crowding) in line.iter_mut().enumerate() {
                *crowding += sign * across[(column + SIDE - x) % SIDE];
            }
        }
    }

    /// The most crowded point, or the largest gap.
    fn extreme(&self, of_points: bool) -> usize {
        let sign = if of_points { 1.0 } else { -1.0 };
        (0..PIXELS)
            .filter(|&pixel| self.is_set[pixel] == of_points)
            .max_by(|&a, &b| (sign * self.crowding[a]).total_cmp(&(sign * self.crowding[b])))
            .expect("a pattern is neither empty nor full where this is asked")
    }
}

/// The rank of each pixel: 0 to `PIXELS` - 1, each once.
fn ranks() -> Vec<u16> {
    let distance = |offset: usize| offset.min(SIDE - offset) as f64;
    let kernel: Vec<f64> = (0..PIXELS)
        .map(|pixel| {
            let square = distance(pixel % SIDE).powi(2) + distance(pixel / SIDE).powi(2);
            (-square / (2.0 * SPREAD * SPREAD)).exp()
        })
        .collect();
    let mut pattern = Pattern { is_set: vec![false; PIXELS], crowding: vec![0.0; PIXELS] };
    let mut pixels: Vec<usize> = (0..PIXELS).collect();
    pixels.shuffle(&mut ChaCha8Rng::seed_from_u64(SEED));
    pixels[..FIRST].iter().for_each(|&pixel| pattern.turn(pixel, &kernel));
    loop {
        let crowded = pattern.extreme(true);
        pattern.turn(crowded, &kernel);
        let gap = pattern.extreme(false);
        pattern.turn(gap, &kernel);
        if crowded == gap {
            break;
        }
    }
    let mut ranks = vec![0; PIXELS];
    let mut lower = Pattern { is_set: pattern.is_set.clone(), crowding: pattern.crowding.clone() };
    for rank in (0..FIRST).rev() {
        let crowded = lower.extreme(true);
        lower.turn(crowded, &kernel);
        ranks[crowded] = rank as u16;
    }
    for rank in FIRST..PIXELS {
        let gap = pattern.extreme(false);
        pattern.turn(gap, &kernel);
        ranks[gap] = rank as u16;
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::Rng as _;

    /// Power of a tile at whole frequencies up to 8 waves per side, without its mean, over that of the variance.
    fn low_power(value: impl Fn(usize, usize) -> f64) -> f64 {
        let mut power = 0.0;
        for (u, v) in (-8_i32..=8).flat_map(|u| (0..=8).map(move |v| (u, v))).filter(|&wave| wave != (0, 0)) {
            let (mut real, mut imaginary) = (0.0, 0.0);
            for pixel in 0..PIXELS {
                let (x, y) = (pixel % SIDE, pixel / SIDE);
                let angle = std::f64::consts::TAU * (f64::from(u) * x as f64 + f64::from(v) * y as f64) / SIDE as f64;
                real += value(x, y) * angle.cos();
                imaginary += value(x, y) * angle.sin();
            }
            power += real * real + imaginary * imaginary;
        }
        power
    }

    #[test]
    fn ranks_are_a_permutation_with_little_power_at_low_frequencies() {
        let mut sorted = ranks();
        sorted.sort_unstable();
        assert!(sorted.iter().enumerate().all(|(index, &rank)| index == usize::from(rank)));
        let blue = low_power(|x, y| value(x, y, 0));
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let white: Vec<f64> = (0..PIXELS).map(|_| random.random()).collect();
        let white = low_power(|x, y| white[y * SIDE + x]);
        assert!(blue < 0.02 * white, "blue noise has {} of white noise's power", blue / white);
    }
}
