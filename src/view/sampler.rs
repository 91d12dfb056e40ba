//! Random numbers of a path: reproducible, and independent between pixels and seeds.
//!
//! The first decisions of a path and those at its first scattering events take Owen-scrambled Sobol
//! points (Burley 2020, "Practical Hash-based Owen Scrambling", through the crate `sobol_burley`), four
//! dimensions at a time. Sets of four are padded: each has a scramble of its own, drawn from pixel,
//! seed and set. Decisions along a ray, of which nobody knows the number beforehand, take a counter-based
//! generator: the hash `pcg4d` of Jarzynski and Olano (2020, "Hash Functions for GPU Rendering") of
//! pixel, sample, seed and counter. Both are functions of whole numbers of 32 bits, so that a shader
//! draws the same numbers.

use crate::base::choice::choice;

/// Samples of one Sobol sequence; further samples begin another one.
const SEQUENCE: u32 = 1 << 16;

/// Scattering events whose decisions are stratified; later ones hardly profit.
const STRATIFIED_EVENTS: u32 = 8;

/// Separates the scrambles of Sobol sets from the counter-based numbers.
const SCRAMBLE: u32 = 0x9e37_79b9;

/// Separates the numbers of decisions that are drawn again from those that are kept.
const AGAIN: u32 = 0x85eb_ca6b;

/// Counter-based draws of a ray at most, and of the scattering events behind the stratified ones, where each decision has numbers of its own.
const DRAWS_OF_A_RAY: u32 = 1 << 16;

choice! { "lowercase",
/// What a path decides by its random numbers.
pub enum Decision {
    /// Where in the pixel, or in the reach of its filter, its ray passes.
    Film,
    /// Where rays between events have their collisions, and which of them scatters.
    Distance,
    /// Where rays to lights, and those behind the last event, have the collisions that estimate their transmittance.
    Transmittance,
    /// Where the phase function scatters to.
    Direction,
    /// Which light is looked at, and where on it.
    Light,
}
}

/// What is drawn again, to see how much of the variance it makes.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Redraw {
    /// All numbers come one after the other, as pictures have them.
    #[default]
    Off,
    /// Each decision has numbers of its own, so that one can be drawn again with the others kept.
    Nothing,
    /// The same, with other numbers for this one.
    Only(Decision),
}

/// The source of numbers of one path.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sampler {
    pixel: u32,
    sample: u32,
    seed: u32,
    /// Counter-based draws so far.
    drawn: u32,
    redraw: Redraw,
    /// Whether the ray under way estimates a transmittance.
    is_transmittance: bool,
}

impl Sampler {
    /// The numbers of sample `sample` of pixel `pixel` in the replica `seed`.
    pub fn new(pixel: u32, sample: u32, seed: u32) -> Self {
        Self { pixel, sample, seed, drawn: 0, redraw: Redraw::Off, is_transmittance: false }
    }

    /// The same with decisions drawn again.
    pub fn redrawing(self, redraw: Redraw) -> Self {
        Self { redraw, ..self }
    }

    /// The seed of a decision.
    fn seed_of(&self, decision: Decision) -> u32 {
        if self.redraw == Redraw::Only(decision) { self.seed ^ AGAIN } else { self.seed }
    }

    /// Ray number `number` of the path begins, the camera's being 0. Where decisions have numbers of their own, its numbers do not depend on how
    /// many others took.
    pub fn begin_ray(&mut self, number: u32, is_transmittance: bool) {
        if self.redraw != Redraw::Off {
            self.drawn = number.wrapping_mul(DRAWS_OF_A_RAY);
            self.is_transmittance = is_transmittance;
        }
    }

    /// Four stratified numbers in [0, 1) of the camera ray: two for where in the pixel it passes, one for its first flight, one for the choice of its event.
    pub fn camera(&self) -> [f64; 4] {
        if self.redraw == Redraw::Off {
            return self.stratified(0, self.seed);
        }
        let [[x, y, ..], [_, _, flight, offset]] =
            [Decision::Film, Decision::Distance].map(|decision| self.stratified(0, self.seed_of(decision)));
        [x, y, flight, offset]
    }

    /// A number in [0, 1), stratified over the samples of a pixel, for where a marched ray samples its steps.
    pub fn step_offset(&self) -> f64 {
        self.stratified(0, self.seed)[0]
    }

    /// Eight numbers in [0, 1) for scattering event `event` (the first is 0): the first two for a direction, the others for a light.
    pub fn scattering(&mut self, event: u32) -> [[f64; 4]; 2] {
        if self.redraw == Redraw::Off {
            if event < STRATIFIED_EVENTS {
                return [1, 2].map(|set| self.stratified(set + 2 * event, self.seed));
            }
            return [self.next4(), self.next4()];
        }
        let seeds = [Decision::Direction, Decision::Light].map(|decision| self.seed_of(decision));
        let drawn = |set: u32, seed: u32| {
            if event < STRATIFIED_EVENTS {
                return self.stratified(set + 2 * event, seed);
            }
            // Behind those of the two rays of the event before.
            self.numbers((2 * event).wrapping_mul(DRAWS_OF_A_RAY) - set, seed)
        };
        let [[first, second, ..], [_, _, third, fourth]] = seeds.map(|seed| drawn(1, seed));
        [[first, second, third, fourth], drawn(2, seeds[1])]
    }

    /// Four independent numbers in [0, 1).
    pub fn next4(&mut self) -> [f64; 4] {
        self.drawn += 1;
        let decision = if self.is_transmittance { Decision::Transmittance } else { Decision::Distance };
        self.numbers(self.drawn, self.seed_of(decision))
    }

    fn numbers(&self, count: u32, seed: u32) -> [f64; 4] {
        pcg4d([self.pixel, self.sample, seed, count]).map(unit)
    }

    fn stratified(&self, set: u32, seed: u32) -> [f64; 4] {
        let sequence = self.sample / SEQUENCE;
        let scramble = pcg4d([self.pixel, set ^ SCRAMBLE, seed, sequence.wrapping_add(SCRAMBLE)])[0];
        sobol_burley::sample_4d(self.sample % SEQUENCE, 0, scramble).map(f64::from)
    }
}

/// A number in [0, 1) of 32 bits.
fn unit(bits: u32) -> f64 {
    f64::from(bits) / 4_294_967_296.0
}

/// Hash of four words to four words (Jarzynski and Olano 2020, listing `pcg4d`).
fn pcg4d(words: [u32; 4]) -> [u32; 4] {
    let seeded = words.map(|word| word.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    mix(mix(seeded).map(|word| word ^ word >> 16))
}

/// One round of `pcg4d`.
fn mix([mut x, mut y, mut z, mut w]: [u32; 4]) -> [u32; 4] {
    x = x.wrapping_add(y.wrapping_mul(w));
    y = y.wrapping_add(z.wrapping_mul(x));
    z = z.wrapping_add(x.wrapping_mul(y));
    w = w.wrapping_add(y.wrapping_mul(z));
    [x, y, z, w]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pearson correlation of two equally long rows.
    fn correlation(first: &[f64], second: &[f64]) -> f64 {
        let count = first.len() as f64;
        let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
        let (a, b) = (mean(first), mean(second));
        let product =
            |x: &[f64], y: &[f64], a: f64, b: f64| x.iter().zip(y).map(|(x, y)| (x - a) * (y - b)).sum::<f64>() / count;
        product(first, second, a, b) / (product(first, first, a, a) * product(second, second, b, b)).sqrt()
    }

    #[test]
    fn every_row_of_numbers_is_uniform() {
        // Mean and variance of 2^16 uniform numbers: standard errors 0.0011 and 0.00029; 5 of each.
        let count = 1 << 16;
        type Draw = fn(u32) -> f64;
        let rows: [Draw; 4] = [
            |index| Sampler::new(7, index, 3).camera()[2],
            |index| Sampler::new(7, index, 3).scattering(1)[1][0],
            |index| Sampler::new(index, 5, 3).camera()[0],
            |index| Sampler::new(7, index, 3).next4()[3],
        ];
        for (number, row) in rows.iter().enumerate() {
            let values: Vec<f64> = (0..count).map(row).collect();
            assert!(values.iter().all(|value| (0.0..1.0).contains(value)));
            let mean = values.iter().sum::<f64>() / f64::from(count);
            let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / f64::from(count);
            assert!((mean - 0.5).abs() < 0.0056, "row {number}: mean {mean}");
            assert!((variance - 1.0 / 12.0).abs() < 0.0015, "row {number}: variance {variance}");
        }
    }

    #[test]
    fn what_is_drawn_again_leaves_the_others_as_they_are() {
        // Numbers of a path by decision: film and first flight, the camera's ray, an event, a ray to a light that takes more numbers in one path than in
        // the other, the next ray, an event behind the stratified ones.
        let numbers = |redraw: Redraw, longer: u32| {
            let mut sampler = Sampler::new(3, 5, 7).redrawing(redraw);
            let [x, y, flight, _] = sampler.camera();
            let mut found = vec![(Decision::Film, [x, y]), (Decision::Distance, [flight, sampler.next4()[0]])];
            for event in [0, STRATIFIED_EVENTS + 2] {
                let [[first, second, third, fourth], [choice, ..]] = sampler.scattering(event);
                found.push((Decision::Direction, [first, second]));
                found.extend([(Decision::Light, [third, fourth]), (Decision::Light, [choice, 0.0])]);
                sampler.begin_ray(2 * event + 1, true);
                found.push((Decision::Transmittance, [sampler.next4()[0], sampler.next4()[1]]));
                for _ in 0..longer {
                    sampler.next4();
                }
                sampler.begin_ray(2 * event + 2, false);
                found.push((Decision::Distance, [sampler.next4()[0], sampler.next4()[1]]));
            }
            found
        };
        let kept = numbers(Redraw::Nothing, 0);
        assert_eq!(kept, numbers(Redraw::Nothing, 9), "a ray that takes more numbers leaves the others");
        for &decision in <Decision as strum::VariantArray>::VARIANTS {
            let again = numbers(Redraw::Only(decision), 4);
            for (place, (before, after)) in kept.iter().zip(&again).enumerate() {
                assert_eq!(before.1 == after.1, before.0 != decision, "{decision} at {place}");
            }
        }
    }

    #[test]
    fn pixels_seeds_sets_and_dimensions_are_uncorrelated() {
        // The standard error of a correlation of 2^14 independent pairs is 0.0078; 5 of it.
        let count = 1 << 14;
        type Draw = fn(u32) -> f64;
        let pairs: [(Draw, Draw); 6] = [
            (|i| Sampler::new(1, i, 0).camera()[0], |i| Sampler::new(2, i, 0).camera()[0]),
            (|i| Sampler::new(1, i, 0).camera()[0], |i| Sampler::new(1, i, 1).camera()[0]),
            (|i| Sampler::new(1, i, 0).camera()[0], |i| Sampler::new(1, i, 0).camera()[1]),
            (|i| Sampler::new(1, i, 0).camera()[0], |i| Sampler::new(1, i, 0).scattering(0)[0][0]),
            (|i| Sampler::new(1, i, 0).next4()[0], |i| Sampler::new(2, i, 0).next4()[0]),
            (|i| Sampler::new(1, i, 0).next4()[0], |i| Sampler::new(1, i, 1).next4()[1]),
        ];
        for (number, (first, second)) in pairs.iter().enumerate() {
            let rows: [Vec<f64>; 2] = [(0..count).map(first).collect(), (0..count).map(second).collect()];
            let found = correlation(&rows[0], &rows[1]);
            assert!(found.abs() < 0.039, "pair {number}: correlation {found}");
        }
    }

    #[test]
    fn samples_of_a_pixel_are_stratified() {
        // 64 points of a (0, 6, 2)-net: one in each of 8 x 8 squares.
        let mut squares = [0; 64];
        for index in 0..64 {
            let [x, y, ..] = Sampler::new(11, index, 5).camera();
            squares[(x * 8.0) as usize * 8 + (y * 8.0) as usize] += 1;
        }
        assert!(squares.iter().all(|&count| count == 1), "{squares:?}");
    }
}
