//! Bounds of the Gabor texture.
//!
//! The sum is over impulses at known places, so over a small box each impulse's envelope and phase are
//! enclosed and summed. Over a large box, or where coordinates are coarse, only the envelopes count: each
//! wave is at most its envelope E(r^2) = exp(-pi r^2) cos^2(pi r^2 / 2), which falls with r.
//!
//! With eight impulses per cell the envelopes' sum is at most 8 times the sum over the cells of E at their
//! least distances. As cos(x + y) <= cos x cos y for x, y >= 0 and x + y <= pi/2, E(a + b) <= E(a) E(b), so
//! that the sum over the cells is at most the product over the axes of 1 + E(f^2) + E((1 - f)^2), f the
//! place in the own cell. That is at most 2 (test `envelopes_are_bounded`): 32 in 2D and 64 in 3D.

use crate::base::arrays::{Mapped, each};
use crate::nodes::bounds::Interval;
use crate::nodes::gabor_texture::{
    ANISOTROPY, FREQUENCY, GaborTexture, IMPULSES, LEAST_FREQUENCY, ORIENTATION, SCALE, normalization, random,
};
use std::f32::consts::PI;

/// Bound on 1 + E(f^2) + E((1 - f)^2), with room for rounding.
const AXIS_SUM: f64 = 2.001;

/// Error of an impulse's offset per axis: hash, local coordinate and difference round by at most 6e-8, 1.2e-7 twice.
const OFFSET_ERROR: f64 = 4e-7;

/// Error of an envelope, of the functions' own accuracy above all.
const ENVELOPE_ERROR: f64 = 4e-6;

/// Rounding of the sums relative to the sum of the envelopes: at most 243 additions of half an ulp.
const SUM_ERROR: f64 = 2e-5;

/// Beyond this magnitude a coordinate's fraction has fewer than two bits.
const LARGEST_COORDINATE: f32 = 4_194_304.0;

/// Boxes with a longer side, in cells, hold so many impulses that their sum says nothing.
const LARGEST_SIDE: f32 = 1.0;

/// Magnitudes of the wave vector from here on may overflow in the phase.
const LARGEST_FREQUENCY: f64 = 1e30;

/// Squared length of an orientation that neither under- nor overflows, and of its part in the plane that has an azimuth.
const LENGTHS: [f64; 2] = [1e-24, 1e24];

/// The waves over a box of parameters.
struct Waves<const N: usize> {
    frequency: Interval,
    isotropy: Interval,
    /// See [`super::Waves`].
    angles: [Interval; 2],
    /// The wave vector where nothing scatters.
    common: Option<[Interval; N]>,
}

/// The complex sum.
struct Sum {
    real: Interval,
    imaginary: Interval,
    /// Sum of the envelopes: bound on its magnitude.
    envelopes: f64,
}

pub(super) fn enclose(node: &GaborTexture, inputs: &[Interval], outputs: &mut [Interval]) {
    let sum = match node.dimensions {
        2 => sum::<2>(inputs),
        _ => sum::<3>(inputs),
    };
    let divisor = Interval::point(normalization(node.dimensions));
    let half = Interval::point(0.5);
    let mut next = 0;
    let mut add = |value: Interval| {
        outputs[next] = value;
        next += 1;
    };
    if node.value {
        add(sum.imaginary.divide(divisor) * half + half);
    }
    if node.phase {
        let turn = (sum.imaginary.atan2(sum.real) + Interval::point(PI)) * Interval::point(super::INVERSE_TAU);
        add(turn.meet(Interval::with_error(0.0, 1.0, 1e-6, turn.may_be_nan)));
    }
    if node.intensity {
        let length = (sum.real.square() + sum.imaginary.square()).sqrt();
        let largest = Interval::with_error(0.0, sum.envelopes, SUM_ERROR * sum.envelopes, length.may_be_nan);
        add(Interval { high: length.high.min(largest.high), ..length }.divide(divisor));
    }
}

fn sum<const N: usize>(inputs: &[Interval]) -> Sum {
    let p: [Interval; N] = each(|axis| inputs[axis] * inputs[SCALE]);
    let waves = Waves::<N>::new(inputs);
    let everything = |nan: bool| {
        let envelopes = IMPULSES as f64 * AXIS_SUM.powi(N as i32);
        let part = Interval::with_error(-envelopes, envelopes, SUM_ERROR * envelopes, nan);
        Sum { real: part, imaginary: part, envelopes }
    };
    let finite = p.iter().all(|x| x.is_finite());
    let Some(waves) = waves else { return everything(true) };
    let small =
        |x: &Interval| x.high - x.low <= LARGEST_SIDE && x.low > -LARGEST_COORDINATE && x.high < LARGEST_COORDINATE;
    if !finite || !p.iter().all(small) {
        return everything(!finite);
    }
    waves.sum(p)
}

/// Squared sum.
fn squared<const N: usize>(v: [Interval; N]) -> Interval {
    v.into_iter().map(Interval::square).reduce(|sum, square| sum + square).unwrap_or(Interval::ZERO)
}

impl<const N: usize> Waves<N> {
    /// None where a wave may be NaN.
    fn new(inputs: &[Interval]) -> Option<Self> {
        let frequency = Interval::point(LEAST_FREQUENCY).greater(inputs[FREQUENCY]);
        let isotropy = Interval::ONE - inputs[ANISOTROPY].saturate();
        if !frequency.is_finite() || frequency.magnitude() > LARGEST_FREQUENCY {
            return None;
        }
        let all_common = isotropy.as_point() == Some(0.0);
        if N == 2 {
            let angle = inputs[ORIENTATION];
            // With nothing that scatters the sum of the angle is the orientation itself.
            let common = wave_vector(frequency, [angle.cos(), angle.sin(), Interval::ZERO]);
            let common = all_common.then_some(common);
            return angle.is_finite().then_some(Self { frequency, isotropy, angles: [angle, Interval::ZERO], common });
        }
        let orientation: [Interval; 3] = each(|axis| inputs[ORIENTATION + axis]);
        let usual = |square: Interval| f64::from(square.low) > LENGTHS[0] && f64::from(square.high) < LENGTHS[1];
        let square = squared(orientation);
        if !orientation.iter().all(|x| x.is_finite()) || !usual(square) {
            return None;
        }
        let [x, y, z] = orientation.mapped(|component| component.divide(square.sqrt()));
        let common = Some(wave_vector(frequency, [x, y, z]));
        if all_common {
            return Some(Self { frequency, isotropy, angles: [Interval::ZERO; 2], common });
        }
        let in_plane = squared([x, y]);
        if !usual(in_plane) {
            return None;
        }
        let azimuth = x.divide(in_plane.sqrt()).acos();
        let azimuth = if y.low >= 0.0 {
            azimuth
        } else if y.high < 0.0 {
            -azimuth
        } else {
            azimuth.hull(-azimuth)
        };
        // Without scattering the direction has no angles, and equals theirs up to rounding.
        let common = common.filter(|_| isotropy.has_zero());
        Some(Self { frequency, isotropy, angles: [z.acos(), azimuth], common })
    }

    /// Wave vector of an impulse, see [`super::Waves::scattered`].
    fn wave(&self, cell: [f32; N], impulse: usize) -> [Interval; N] {
        if let Some(common) = self.common
            && self.isotropy.as_point() == Some(0.0)
        {
            return common;
        }
        let pi = Interval::point(PI);
        let value = |variant: usize| Interval::point(random(cell, 3 * impulse, variant)) * Interval::ONE;
        if N == 2 {
            let angle = self.angles[0] + ((value(0) - Interval::point(0.5)) * pi) * self.isotropy;
            return wave_vector(self.frequency, [angle.cos(), angle.sin(), Interval::ZERO]);
        }
        let inclination = self.angles[0] + (value(0) * pi) * self.isotropy;
        let azimuth = self.angles[1] + (value(1) * pi) * self.isotropy;
        let sine = inclination.sin();
        let scattered = wave_vector(self.frequency, [sine * azimuth.cos(), sine * azimuth.sin(), inclination.cos()]);
        match self.common {
            None => scattered,
            Some(common) => each(|axis| scattered[axis].hull(common[axis])),
        }
    }

    /// The sum over the impulses that may be nearer than 1.
    fn sum(&self, p: [Interval; N]) -> Sum {
        let first = p.mapped(|x| x.low.floor() as i32 - 1);
        let counts: [usize; N] = each(|axis| (p[axis].high.floor() as i32 + 2 - first[axis]) as usize);
        let mut ends = [[0.0_f64; 2]; 2];
        let mut envelopes = 0.0;
        for number in 0..counts.iter().product() {
            let mut rest: usize = number;
            let cell: [f32; N] = each(|axis| {
                let step = rest % counts[axis];
                rest /= counts[axis];
                (first[axis] + step as i32) as f32
            });
            // The cell's box first: most cells of a small box's neighbourhood are partly out of reach.
            let gap = |axis: usize| {
                let (low, high) = (f64::from(cell[axis]), f64::from(cell[axis]) + 1.0);
                (low - f64::from(p[axis].high)).max(f64::from(p[axis].low) - high).max(0.0)
            };
            if (0..N).map(|axis| gap(axis).powi(2)).sum::<f64>() > 1.01 {
                continue;
            }
            for impulse in 0..IMPULSES {
                let offset: [[f64; 2]; N] = each(|axis| {
                    let hash: f32 = random(cell, 3 * impulse + 1, axis);
                    let place = f64::from(cell[axis]) + f64::from(hash);
                    let [low, high] = p[axis].ends();
                    [low - place - OFFSET_ERROR, high - place + OFFSET_ERROR]
                });
                let nearest: f64 = offset.iter().map(|[low, high]| low.max(-high).max(0.0).powi(2)).sum();
                let farthest: f64 = offset.iter().map(|[low, high]| low.abs().max(high.abs()).powi(2)).sum();
                if nearest >= 1.0 {
                    continue;
                }
                let largest = envelope(nearest) + ENVELOPE_ERROR;
                envelopes += largest;
                let amplitude = Interval::with_error(envelope(farthest) - ENVELOPE_ERROR, largest, 0.0, false);
                let wave = self.wave(cell, impulse);
                let projection = (0..N)
                    .map(|axis| Interval::with_error(offset[axis][0], offset[axis][1], 0.0, false) * wave[axis])
                    .reduce(|sum, term| sum + term)
                    .unwrap_or(Interval::ZERO);
                let angle = Interval::point(std::f32::consts::TAU) * projection;
                let sign = random::<f32, N>(cell, 3 * impulse + 2, 0);
                for (part, wave) in ends.iter_mut().zip([angle.cos(), angle.sin()]) {
                    let term = amplitude * wave;
                    let term = if sign < 0.5 { -term } else { term };
                    let [low, high] = term.ends();
                    *part = [part[0] + low.max(-largest), part[1] + high.min(largest)];
                }
            }
        }
        let error = SUM_ERROR * envelopes;
        let [real, imaginary] = ends.mapped(|[low, high]| {
            let bound = IMPULSES as f64 * AXIS_SUM.powi(N as i32);
            Interval::with_error(low.max(-bound), high.min(bound), error, false)
        });
        Sum { real, imaginary, envelopes: envelopes.min(IMPULSES as f64 * AXIS_SUM.powi(N as i32)) }
    }
}

/// Scales a direction; its third component does not exist in the plane.
fn wave_vector<const N: usize>(frequency: Interval, direction: [Interval; 3]) -> [Interval; N] {
    each(|axis| frequency * direction[axis])
}

/// The envelope at a squared distance; 0 from 1 on.
fn envelope(square: f64) -> f64 {
    use std::f64::consts::PI;
    if square >= 1.0 { 0.0 } else { (-PI * square).exp() * (0.5 + 0.5 * (PI * square).cos()) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::{Column, Evaluate as _};

    #[test]
    fn envelopes_are_bounded() {
        // The envelope falls: over [f, f + step] it is greatest at the near ends.
        let step = 1e-5;
        for number in 0..50_000 {
            let f = f64::from(number) * step;
            let sum = 1.0 + envelope(f * f) + envelope((1.0 - f - step).powi(2));
            assert!(sum < AXIS_SUM, "{f}: {sum}");
        }
        for [a, b] in [[0.1, 0.2], [0.5, 0.49], [0.0, 0.7], [0.9, 0.4]] {
            assert!(envelope(a + b) <= envelope(a) * envelope(b));
        }
    }

    #[test]
    fn a_small_box_is_tight_and_a_point_almost_exact() {
        for dimensions in [2, 3] {
            let node = GaborTexture { dimensions, value: true, phase: true, intensity: true };
            let values = [0.3, 0.7, -0.4, 5.0, 2.0, 0.6, 0.785, 0.5, 0.3];
            let columns = values.map(|value: f32| [value]);
            let columns = columns.each_ref().map(|values| Column { values, uniform: true });
            let mut found = [[0.0_f32]; 3];
            node.evaluate(&columns, &mut found.each_mut().map(|output| &mut output[..]));
            for (side, width) in [(0.0, 1e-3), (1e-3, 0.3)] {
                let mut inputs = values.map(Interval::point);
                for input in &mut inputs[..3] {
                    *input = Interval::new(input.low - side, input.high + side);
                }
                let mut outputs = [Interval::EVERYTHING; 3];
                node.enclose(&inputs, &mut outputs);
                assert!(outputs[0].high - outputs[0].low < width, "{dimensions}D: {outputs:?}");
                for (bounds, [value]) in outputs.iter().zip(found) {
                    assert!(bounds.contains(f64::from(value)), "{dimensions}D: {bounds:?} {value}");
                }
            }
        }
    }
}
