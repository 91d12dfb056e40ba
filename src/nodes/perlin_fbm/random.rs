//! The seeded random numbers of the published engine, and the permutation that they shuffle.
//!
//! A hash of the Mulberry kind over a state that is a double and is never reduced: a fraction of the seed matters through the rounding
//! of the growing sum and through truncation towards 0 while the state is negative, and seeds that differ by a
//! multiple of 2^32 give the same numbers.

use crate::base::arrays::each;

/// Added to the state before every draw.
const STEP: f64 = 1_831_565_813.0;

/// 2^32.
const RANGE: f64 = 4_294_967_296.0;

/// A sequence of random numbers.
#[derive(Debug, Clone)]
pub struct Random {
    state: f64,
}

/// The numbers 0 to 255 in an order that a seed decides.
pub type Permutation = [u8; 256];

impl Random {
    /// Begins a sequence; `seed` is any finite number.
    pub fn new(seed: f64) -> Self {
        Self { state: seed }
    }

    /// The next number times 2^32, which is a whole one.
    pub fn draw(&mut self) -> u32 {
        self.state += STEP;
        // Truncated towards 0, then modulo 2^32; both are exact in double precision.
        let mut t = self.state.trunc().rem_euclid(RANGE) as u32;
        t = (t ^ (t >> 15)).wrapping_mul(t | 1);
        t ^= t.wrapping_add((t ^ (t >> 7)).wrapping_mul(t | 61));
        t ^ (t >> 14)
    }
}

/// Shuffles the numbers 0 to 255 (Fisher and Yates, from the last).
pub fn permutation(seed: f64) -> Permutation {
    let mut random = Random::new(seed);
    let mut table: Permutation = each(|number| number as u8);
    for last in (1..256_usize).rev() {
        // floor(draw / 2^32 * (last + 1)), without rounding.
        let other = (u64::from(random.draw()) * (last as u64 + 1)) >> 32;
        table.swap(last, other as usize);
    }
    table
}
