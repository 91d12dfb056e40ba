//! Bounds of gradient noise and its fractals.
//!
//! Within one lattice cell the noise is a polynomial of the place in the cell: corner values
//! g.d interpolated with the quintic fade. Two forms are intersected: the natural one (intervals
//! through the interpolation) and the mean value form, value at the centre plus gradient over the
//! box times half the side, with
//!
//! dn/dx_i = interpolation of g_i + fade'(f_i) * interpolation over the other axes of (v_1 - v_0),
//!
//! v_0 and v_1 the corner values on the two sides of axis i. A box over several cells is the union
//! of its parts; over many cells, or where coordinates wrap, the noise's range is all that is said.

use crate::base::arrays::{Mapped, each};
use crate::nodes::bounds::Interval;
use crate::nodes::gradient_noise::{SCALE, gradient, random_offset};
use crate::nodes::hash::jenkins;
use crate::nodes::noise_texture::{Fractal, NoiseTexture};

/// Largest magnitude of the unscaled noise in 1 to 4 dimensions, whatever the gradients.
///
/// Per corner g.d is at most 8 |d| in 1D, |d|_min + 2 |d|_max in 2D, the sum of the two (three)
/// largest |d_i| in 3D (4D). The interpolation of these over the corners has the maxima 4, 1.5112,
/// 1.0364 and 1.5364 (test `range_is_proven` shows the numbers below by subdivision).
const RANGE: [f64; 4] = [4.01, 1.53, 1.06, 1.6];

/// Coordinates from here on may wrap (the period is 100,000 cells).
const LARGEST_COORDINATE: f64 = 99_000.0;

/// Lattice cells that a box may touch and still be treated cell by cell.
const LARGEST_CELL_COUNT: i64 = 16;

/// Rounding of the noise: below 8 operations per interpolated corner value, on a path of at most
/// 1 + 4 interpolations of 3 operations, values up to 8: 20 * 8 * 2^-23 = 2e-5, scaled by at most
/// 0.25 in 1D; values up to 3 and factors up to 0.98 in the others give less.
const ROUNDING: f64 = 8e-6;

/// A plain interval in f64, for the inside of a cell: exact up to 1e-15, covered by [`ROUNDING`].
type Span = [f64; 2];

/// Interpolation; exactly (1 - t) a + t b, which rises in a and b for t in [0, 1].
#[inline(always)]
fn lerp(a: Span, b: Span, t: Span) -> Span {
    let at = |x: f64, y: f64, t: f64| x + t * (y - x);
    [at(a[0], b[0], t[0]).min(at(a[0], b[0], t[1])), at(a[1], b[1], t[0]).max(at(a[1], b[1], t[1]))]
}

#[inline(always)]
fn scale_add(sum: Span, factor: f64, x: Span) -> Span {
    let (p, q) = (factor * x[0], factor * x[1]);
    [sum[0] + p.min(q), sum[1] + p.max(q)]
}

#[inline(always)]
fn product(a: Span, b: Span) -> Span {
    let all = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
    [all[0].min(all[1]).min(all[2].min(all[3])), all[0].max(all[1]).max(all[2].max(all[3]))]
}

fn fade(f: f64) -> f64 {
    f * f * f * (f * (f * 6.0 - 15.0) + 10.0)
}

/// Derivative of the fade over an interval: it rises up to 1/2 and falls behind.
fn fade_slope(f: Span) -> Span {
    let slope = |f: f64| 30.0 * f * f * (1.0 - f) * (1.0 - f);
    let (a, b) = (slope(f[0]), slope(f[1]));
    let top = if f[0] <= 0.5 && f[1] >= 0.5 { 1.875 } else { a.max(b) };
    [a.min(b), top]
}

/// Interpolates `values[..1 << N]` over all axes but `skip` (axes are folded lowest first).
#[inline(always)]
fn interpolate<const N: usize>(mut values: [Span; 16], fades: &[Span; N], skip: Option<usize>) -> Span {
    let mut count = 1 << N;
    if skip.is_some() {
        count /= 2;
    }
    for (axis, &t) in fades.iter().enumerate() {
        if skip == Some(axis) {
            continue;
        }
        count /= 2;
        for index in 0..count {
            values[index] = lerp(values[2 * index], values[2 * index + 1], t);
        }
    }
    values[0]
}

/// Noise over the part `f` of the lattice cell `cell`.
fn in_cell<const N: usize>(cell: [i64; N], f: [Span; N]) -> Span {
    let mut gradients = [[0.0_f64; N]; 16];
    let mut values = [[0.0; 2]; 16];
    let mut middle_values = [[0.0; 2]; 16];
    let middle = f.mapped(|f| 0.5 * (f[0] + f[1]));
    for corner in 0..1 << N {
        let bit = |axis: usize| (corner >> axis) & 1;
        let hash = jenkins(each::<u32, N>(|axis| (cell[axis] as i32 as u32).wrapping_add(bit(axis) as u32)));
        let mut value = [0.0; 2];
        let mut middle_value = 0.0;
        for axis in 0..N {
            let mut unit = [0.0; N];
            unit[axis] = 1.0;
            let g: f64 = gradient(hash, unit);
            gradients[corner][axis] = g;
            let corner_place = bit(axis) as f64;
            value = scale_add(value, g, [f[axis][0] - corner_place, f[axis][1] - corner_place]);
            middle_value += g * (middle[axis] - corner_place);
        }
        values[corner] = value;
        middle_values[corner] = [middle_value; 2];
    }
    let fades: [Span; N] = f.mapped(|f| f.mapped(fade));
    let natural = interpolate::<N>(values, &fades, None);
    let middle_fades: [Span; N] = middle.mapped(|m| [fade(m); 2]);
    let mut mean_value = interpolate::<N>(middle_values, &middle_fades, None);
    for axis in 0..N {
        let radius = 0.5 * (f[axis][1] - f[axis][0]);
        if radius == 0.0 {
            continue;
        }
        let mut slopes = [[0.0; 2]; 16];
        let mut steps = [[0.0; 2]; 16];
        for corner in 0..1 << N {
            slopes[corner] = [gradients[corner][axis]; 2];
        }
        let below = (1 << axis) - 1;
        for (index, step) in steps.iter_mut().enumerate().take(1 << (N - 1)) {
            // The corner on the near side: a zero bit is put in at this axis.
            let near = (index & below) | ((index & !below) << 1);
            let far = near | (1 << axis);
            // v_1 - v_0: the common offsets occur once.
            for other in 0..N {
                if other == axis {
                    *step = scale_add(*step, gradients[far][axis], [f[axis][0] - 1.0, f[axis][1] - 1.0]);
                    *step = scale_add(*step, -gradients[near][axis], f[axis]);
                } else {
                    let bit = ((near >> other) & 1) as f64;
                    let change = gradients[far][other] - gradients[near][other];
                    *step = scale_add(*step, change, [f[other][0] - bit, f[other][1] - bit]);
                }
            }
        }
        let slope = interpolate::<N>(slopes, &fades, None);
        let step = interpolate::<N>(steps, &fades, Some(axis));
        let bent = product(fade_slope(f[axis]), step);
        let derivative = (slope[0] + bent[0]).abs().max((slope[1] + bent[1]).abs());
        mean_value[0] -= radius * derivative;
        mean_value[1] += radius * derivative;
    }
    [natural[0].max(mean_value[0]), natural[1].min(mean_value[1])]
}

/// Bounds of the signed noise over a box of coordinates.
pub(super) fn signed_noise<const N: usize>(p: [Interval; N]) -> Interval {
    let scale = f64::from(SCALE[N - 1]);
    let range = scale * RANGE[N - 1];
    let whole = Interval::with_error(-range, range, ROUNDING, false);
    if p.iter().any(|x| x.may_be_nan || x.magnitude().is_infinite()) {
        return whole.or_nan(true);
    }
    if p.iter().any(|x| x.magnitude() > LARGEST_COORDINATE) {
        return whole;
    }
    let ends = p.mapped(Interval::ends);
    let first = ends.mapped(|x| x[0].floor() as i64);
    let last = ends.mapped(|x| x[1].floor() as i64);
    let mut count = 1;
    for axis in 0..N {
        count *= last[axis] - first[axis] + 1;
        if count > LARGEST_CELL_COUNT {
            return whole;
        }
    }
    let mut bounds = [f64::INFINITY, f64::NEG_INFINITY];
    let mut cell = first;
    loop {
        let part = each(|axis| {
            let corner = cell[axis] as f64;
            [(ends[axis][0] - corner).max(0.0), (ends[axis][1] - corner).min(1.0)]
        });
        let [low, high] = in_cell(cell, part);
        bounds = [bounds[0].min(low), bounds[1].max(high)];
        let Some(axis) = (0..N).find(|&axis| cell[axis] < last[axis]) else { break };
        cell[axis] += 1;
        cell[..axis].copy_from_slice(&first[..axis]);
    }
    Interval::with_error(scale * bounds[0], scale * bounds[1], ROUNDING, false).meet(whole)
}

fn scaled<const N: usize>(p: [Interval; N], factor: Interval) -> [Interval; N] {
    p.mapped(|x| x * factor)
}

fn add<const N: usize>(p: [Interval; N], offset: [Interval; N]) -> [Interval; N] {
    each(|axis| p[axis] + offset[axis])
}

/// Parameters over a box, clamped as the kernel does.
type Parameters = Fractal<Interval>;

/// Union of what the fractal gives for every whole number of octaves that Detail may hold:
/// `sum(octaves, rest)`.
fn over_detail(detail: Interval, mut sum: impl FnMut(usize, Interval) -> Interval) -> Interval {
    let (first, last) = (detail.low.floor() as usize, detail.high.floor() as usize);
    let mut result: Option<Interval> = None;
    for octaves in first..=last {
        let whole = octaves as f32;
        let rest = Interval::new((detail.low - whole).max(0.0), (detail.high - whole).min(1.0));
        let value = sum(octaves, rest);
        result = Some(result.map_or(value, |known| known.hull(value)));
    }
    result.unwrap_or(Interval::EVERYTHING)
}

/// Noise of each octave that may count: one beyond the whole ones.
fn octaves_of<const N: usize>(parameters: &Parameters, mut p: [Interval; N], scales: bool) -> Vec<Interval> {
    let count = parameters.detail.high.floor() as usize + 1 + usize::from(parameters.detail.high.fract() > 0.0);
    let start = p;
    let mut scale = Interval::ONE;
    (0..count.max(1))
        .map(|_| {
            let noise = signed_noise(p);
            // fBM multiplies the first coordinate by the running scale, the others go on from the last.
            scale = scale * parameters.lacunarity;
            p = if scales { scaled(start, scale) } else { scaled(p, parameters.lacunarity) };
            noise
        })
        .collect()
}

/// Bounds of [`Fractal::fbm`] for any Detail from 0 to some dozens.
pub(in crate::nodes) fn fbm<const N: usize>(
    parameters: &Fractal<Interval>,
    p: [Interval; N],
    normalize: bool,
) -> Interval {
    let noise = octaves_of(parameters, p, true);
    let half = Interval::point(0.5);
    let normalized = |sum: Interval, total: Interval| {
        if normalize { (half * sum).divide(total) + half } else { sum }
    };
    over_detail(parameters.detail, |octaves, rest| {
        let (mut sum, mut total, mut amplitude) = (Interval::ZERO, Interval::ZERO, Interval::ONE);
        for &octave in &noise[..=octaves] {
            sum = sum + octave * amplitude;
            total = total + amplitude;
            amplitude = amplitude * parameters.roughness;
        }
        let value = normalized(sum, total);
        match noise.get(octaves + 1) {
            Some(&next) if rest.high > 0.0 => value.lerp(normalized(sum + next * amplitude, total + amplitude), rest),
            _ => value,
        }
    })
}

fn multifractal<const N: usize>(parameters: &Parameters, p: [Interval; N]) -> Interval {
    let noise = octaves_of(parameters, p, false);
    over_detail(parameters.detail, |octaves, rest| {
        let (mut value, mut amplitude) = (Interval::ONE, Interval::ONE);
        for &octave in &noise[..=octaves] {
            value = value * (amplitude * octave + Interval::ONE);
            amplitude = amplitude * parameters.roughness;
        }
        match noise.get(octaves + 1) {
            Some(&next) if rest.high > 0.0 => value * ((rest * amplitude) * next + Interval::ONE),
            _ => value,
        }
    })
}

fn hetero_terrain<const N: usize>(parameters: &Parameters, p: [Interval; N]) -> Interval {
    let noise = octaves_of(parameters, p, false);
    let offset = parameters.offset;
    over_detail(parameters.detail, |octaves, rest| {
        let mut amplitude = parameters.roughness;
        let mut value = offset + noise[0];
        let grown = |value: Interval, octave: Interval, weight: Interval| {
            // v + s v, as v (1 + s): v occurs once.
            let plain = value + (octave + offset) * weight * value;
            let error = 4e-6 * plain.magnitude();
            let once = value * (Interval::ONE + (octave + offset) * weight);
            plain.meet(Interval::with_error(once.ends()[0], once.ends()[1], error, once.may_be_nan))
        };
        for &octave in &noise[1..=octaves] {
            value = grown(value, octave, amplitude);
            amplitude = amplitude * parameters.roughness;
        }
        match noise.get(octaves + 1) {
            Some(&next) if rest.high > 0.0 => grown(value, next, rest * amplitude),
            _ => value,
        }
    })
}

fn hybrid<const N: usize>(parameters: &Parameters, p: [Interval; N]) -> Interval {
    let noise = octaves_of(parameters, p, false);
    let threshold = 0.001_f32;
    over_detail(parameters.detail, |octaves, rest| {
        let (mut amplitude, mut value, mut weight) = (Interval::ONE, Interval::ZERO, Interval::ONE);
        // What the sum is where the weight has fallen to the threshold on the way.
        let mut stopped: Option<Interval> = None;
        let ended = |stopped: Option<Interval>, value: Interval| stopped.map_or(value, |s| s.hull(value));
        for &octave in &noise[..=octaves] {
            if weight.low <= threshold || weight.may_be_nan {
                stopped = Some(ended(stopped, value));
            }
            if weight.high <= threshold {
                return ended(stopped, value);
            }
            weight = Interval::new(weight.low.max(threshold), weight.high).fmin(Interval::ONE);
            let signal = (octave + parameters.offset) * amplitude;
            amplitude = amplitude * parameters.roughness;
            value = value + weight * signal;
            weight = weight * (parameters.gain * signal);
        }
        if let Some(&next) = noise.get(octaves + 1) {
            if weight.low <= threshold || weight.may_be_nan || rest.low <= 0.0 {
                stopped = Some(ended(stopped, value));
            }
            if weight.high > threshold && rest.high > 0.0 {
                weight = Interval::new(weight.low.max(threshold), weight.high).fmin(Interval::ONE);
                let signal = (next + parameters.offset) * amplitude;
                value = value + (rest * weight) * signal;
            }
        }
        ended(stopped, value)
    })
}

fn ridged<const N: usize>(parameters: &Parameters, p: [Interval; N]) -> Interval {
    let noise = octaves_of(parameters, p, false);
    over_detail(parameters.detail, |octaves, _| {
        let mut amplitude = parameters.roughness;
        let mut signal = (parameters.offset - noise[0].abs()).square();
        let mut value = signal;
        for &octave in &noise[1..=octaves] {
            let weight = (signal * parameters.gain).saturate();
            signal = (parameters.offset - octave.abs()).square() * weight;
            value = value + signal * amplitude;
            amplitude = amplitude * parameters.roughness;
        }
        value
    })
}

impl NoiseTexture {
    fn enclose_fractal<const N: usize>(&self, parameters: &Parameters, p: [Interval; N]) -> Interval {
        match self.fractal {
            "FBM" => fbm(parameters, p, self.normalize),
            "MULTIFRACTAL" => multifractal(parameters, p),
            "HETERO_TERRAIN" => hetero_terrain(parameters, p),
            "HYBRID_MULTIFRACTAL" => hybrid(parameters, p),
            _ => ridged(parameters, p),
        }
    }

    fn enclose_points<const N: usize>(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let [scale, detail, roughness, lacunarity, offset, gain, distortion] = self.parameter_columns();
        let offset_vector = |seed: f32| random_offset::<f32, N>(seed).mapped(Interval::point);
        let mut p: [Interval; N] = each(|axis| inputs[axis] * inputs[scale]);
        let strength = inputs[distortion];
        if strength.as_point() != Some(0.0) {
            let undistorted = p;
            p = each(|axis| {
                let shift = signed_noise(add(undistorted, offset_vector(axis as f32)));
                undistorted[axis] + shift * strength
            });
        }
        let parameters = Fractal {
            detail: inputs[detail].clamped(Interval::ZERO, Interval::point(15.0)),
            roughness: inputs[roughness].fmax(Interval::ZERO),
            lacunarity: inputs[lacunarity],
            offset: if self.has_offset { inputs[offset] } else { Interval::ZERO },
            gain: if self.has_gain { inputs[gain] } else { Interval::ONE },
        };
        let value = self.enclose_fractal(&parameters, p);
        let mut next = 0;
        if self.factor {
            outputs[0] = value;
            next = 1;
        }
        if self.color {
            outputs[next] = value;
            for (channel, seed) in [N, N + 1].into_iter().enumerate() {
                let shifted = add(p, offset_vector(seed as f32));
                outputs[next + 1 + channel] = self.enclose_fractal(&parameters, shifted);
            }
        }
    }
}

/// Encloses the wanted outputs; see [`crate::nodes::NodeEvaluator::bounds`].
pub(super) fn enclose(node: &NoiseTexture, inputs: &[Interval], outputs: &mut [Interval]) {
    match node.dimensions {
        1 => node.enclose_points::<1>(inputs, outputs),
        2 => node.enclose_points::<2>(inputs, outputs),
        3 => node.enclose_points::<3>(inputs, outputs),
        _ => node.enclose_points::<4>(inputs, outputs),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest g.d of any gradient of the set, from the magnitudes of d.
    fn largest_product<const N: usize>(mut d: [f64; N]) -> f64 {
        d.sort_by(f64::total_cmp);
        match N {
            1 => 8.0 * d[0],
            2 => d[0] + 2.0 * d[1],
            3 => d[1] + d[2],
            _ => d[1] + d[2] + d[3],
        }
    }

    /// Interpolation of the largest products over all places of a box within the cell.
    fn interpolated<const N: usize>(f: [Span; N]) -> Span {
        let mut values = [[0.0; 2]; 16];
        for (corner, value) in values.iter_mut().enumerate().take(1 << N) {
            let end = |which: usize| {
                largest_product(each::<f64, N>(|axis| {
                    if (corner >> axis) & 1 == 0 { f[axis][which] } else { 1.0 - f[axis][1 - which] }
                }))
            };
            *value = [end(0), end(1)];
        }
        interpolate::<N>(values, &f.map(|f| f.map(fade)), None)
    }

    /// Whether the noise stays below `limit` everywhere: by halving boxes until each shows it. Axes
    /// may be exchanged and mirrored, so 0 <= f_0 <= f_1 <= ... <= 1/2 is enough.
    fn stays_below<const N: usize>(limit: f64) -> bool {
        let mut pending = vec![([[0.0, 0.5]; N], 0)];
        while let Some((f, depth)) = pending.pop() {
            if (1..N).any(|axis| f[axis - 1][0] > f[axis][1]) || interpolated(f)[1] <= limit {
                continue;
            }
            if depth > 10 * N || interpolated(f)[0] > limit {
                return false;
            }
            let axis = depth % N;
            let middle = 0.5 * (f[axis][0] + f[axis][1]);
            for half in [[f[axis][0], middle], [middle, f[axis][1]]] {
                let mut part = f;
                part[axis] = half;
                pending.push((part, depth + 1));
            }
        }
        true
    }

    #[test]
    fn range_is_proven() {
        assert!(stays_below::<1>(RANGE[0]));
        assert!(stays_below::<2>(RANGE[1]));
        assert!(stays_below::<3>(RANGE[2]));
        assert!(stays_below::<4>(RANGE[3]));
        // The proof can fail: these are below the maxima.
        assert!(!stays_below::<2>(1.5));
        assert!(!stays_below::<3>(1.03));
    }
}
