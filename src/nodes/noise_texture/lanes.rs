//! Every fractal in one to four dimensions on SIMD lanes, one point per lane; the same bits as the
//! scalar evaluation, which these functions follow operation by operation.

use crate::base::arrays::Mapped;
use crate::base::arrays::each;
use crate::nodes::gradient_noise::{PERIOD, SCALE, random_offset};
use crate::nodes::lanes::{self, finished_hash, mixed_words, saturate};
use crate::nodes::noise_texture::{Fractal, NoiseTexture};
use crate::nodes::{Column, Evaluate, Real, columns_at, lane_level};
use fearless_simd::{dispatch, prelude::*};

/// Coordinates beyond this magnitude are left to the scalar evaluation.
const LARGEST_COORDINATE: f32 = 1.0e9;

/// More than the largest random offset, which the colour channels and the distortion add.
const LARGEST_OFFSET: f32 = 201.0;

/// Evaluates if the parameters that decide how often octaves repeat are equal at all points, and finite. Offset, gain and
/// distortion may vary.
pub(super) fn evaluate(node: &NoiseTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
    let columns @ [scale, detail, roughness, lacunarity, offset, gain, distortion] = node.parameter_columns();
    if outputs[0].is_empty() || !columns[..4].iter().all(|&column| inputs[column].uniform) {
        return false;
    }
    let [scale, detail, roughness, lacunarity] =
        [scale, detail, roughness, lacunarity].mapped(|column| inputs[column].values[0]);
    let plan = Plan {
        kind: Kind::of(node.fractal),
        scale,
        detail: Real::clamped(detail, 0.0, 15.0),
        roughness: Real::fmax(roughness, 0.0),
        lacunarity,
        offset: node.has_offset.then_some(offset),
        gain: node.has_gain.then_some(gain),
        distortion: (!inputs[distortion].uniform || inputs[distortion].values[0] != 0.0).then_some(distortion),
        normalize: node.normalize,
        factor: node.factor,
        color: node.color,
    };
    if ![plan.scale, plan.detail, plan.roughness, plan.lacunarity].iter().all(|value| value.is_finite()) {
        return false;
    }
    let far = match node.dimensions {
        1 => dispatch!(lane_level(), simd => run::<_, 1>(simd, &plan, inputs, outputs)),
        2 => dispatch!(lane_level(), simd => run::<_, 2>(simd, &plan, inputs, outputs)),
        3 => dispatch!(lane_level(), simd => run::<_, 3>(simd, &plan, inputs, outputs)),
        _ => dispatch!(lane_level(), simd => run::<_, 4>(simd, &plan, inputs, outputs)),
    };
    for index in far {
        let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(|output| &mut output[index..=index]).collect();
        node.evaluate(&columns_at(inputs, index), &mut slices);
    }
    true
}

/// Normalised 3D fBM at `places` (x, y, z), bit for bit [`Fractal::fbm`]. Detail lies below 128 and Roughness is finite.
pub(in crate::nodes) fn fbm_values(fractal: &Fractal<f32>, places: [&[f32]; 3], values: &mut [f32]) {
    let plan = Plan {
        kind: Kind::Fbm,
        scale: 1.0,
        detail: fractal.detail,
        roughness: fractal.roughness,
        lacunarity: fractal.lacunarity,
        offset: None,
        gain: None,
        distortion: None,
        normalize: true,
        factor: true,
        color: false,
    };
    let columns = places.mapped(|values| Column { values, uniform: false });
    let far = dispatch!(lane_level(), simd => run::<_, 3>(simd, &plan, &columns, &mut [&mut *values]));
    for index in far {
        values[index] = fractal.fbm(places.mapped(|place| place[index]), true);
    }
}

/// Which sum of octaves.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Fbm,
    Multifractal,
    HeteroTerrain,
    Hybrid,
    Ridged,
}

impl Kind {
    fn of(name: &str) -> Self {
        match name {
            "FBM" => Self::Fbm,
            "MULTIFRACTAL" => Self::Multifractal,
            "HETERO_TERRAIN" => Self::HeteroTerrain,
            "HYBRID_MULTIFRACTAL" => Self::Hybrid,
            _ => Self::Ridged,
        }
    }
}

/// What is equal at all points, and the columns of what need not be.
struct Plan {
    kind: Kind,
    scale: f32,
    detail: f32,
    roughness: f32,
    lacunarity: f32,
    /// 0 without a column.
    offset: Option<usize>,
    /// 1 without a column.
    gain: Option<usize>,
    /// 0 without a column.
    distortion: Option<usize>,
    normalize: bool,
    factor: bool,
    color: bool,
}

impl Plan {
    /// Magnitude of scaled coordinates from which an octave may leave [`LARGEST_COORDINATE`], random offsets included.
    fn reach(&self) -> f32 {
        let growth = self.lacunarity.abs().max(1.0).powi(self.detail.max(0.0) as i32 + 1);
        LARGEST_COORDINATE / growth - LARGEST_OFFSET
    }
}

/// Returns the points that are left to the scalar evaluation: far out, or not finite.
#[inline(always)]
fn run<S: Simd, const N: usize>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
) -> Vec<usize> {
    simd.vectorize(
        #[inline(always)]
        || run_vectorized::<S, N>(simd, plan, inputs, outputs),
    )
}

#[inline(always)]
fn run_vectorized<S: Simd, const N: usize>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
) -> Vec<usize> {
    let width = S::f32s::LEN;
    let count = outputs[0].len();
    let none = [0.0_f32; N];
    let seeds: [[f32; N]; 3] = [none, random_offset(N as f32), random_offset((N + 1) as f32)];
    let distortions: [[f32; N]; N] = each(|axis| random_offset(axis as f32));
    let reach = plan.reach();
    let mut far = Vec::new();
    for start in (0..count).step_by(width) {
        let used = width.min(count - start);
        let load = |column: usize| lanes::load::<S>(simd, &inputs[column].values[start..start + used]);
        let mut p: [S::f32s; N] = each(|axis| load(axis) * plan.scale);
        let mut is_near = S::f32s::splat(simd, 0.0).simd_eq(0.0);
        let mut check = |p: &[S::f32s; N]| {
            for x in p {
                is_near &= x.abs().simd_lt(reach);
            }
        };
        check(&p);
        if let Some(column) = plan.distortion {
            let strength = load(column);
            let undistorted = p;
            for axis in 0..N {
                let shifted = each(|other| undistorted[other] + distortions[axis][other]);
                let moved = undistorted[axis] + signed_noise::<S, N>(simd, shifted) * strength;
                p[axis] = strength.simd_eq(0.0).select(undistorted[axis], moved);
            }
            check(&p);
        }
        let offset = plan.offset.map_or(S::f32s::splat(simd, 0.0), load);
        let gain = plan.gain.map_or(S::f32s::splat(simd, 1.0), load);
        let mut store =
            |output: usize, value: S::f32s| lanes::store::<S>(value, &mut outputs[output][start..start + used]);
        let first_color = usize::from(plan.factor);
        for (channel, seed) in seeds.iter().enumerate().take(if plan.color { 3 } else { 1 }) {
            // Nothing is added to the first channel: a sum with 0 would lose the sign of a zero.
            let place = if channel == 0 { p } else { each(|axis| p[axis] + seed[axis]) };
            let value = fractal::<S, N>(simd, plan, place, offset, gain);
            if channel == 0 && plan.factor {
                store(0, value);
            }
            if plan.color {
                store(first_color + channel, value);
            }
        }
        far.extend(lanes::marked::<S>(is_near, false, used).map(|lane| start + lane));
    }
    far
}

/// The sum of octaves of [`Fractal`], which one loop makes of all kinds so that the noise is compiled once.
#[inline(always)]
fn fractal<S: Simd, const N: usize>(simd: S, plan: &Plan, p: [S::f32s; N], offset: S::f32s, gain: S::f32s) -> S::f32s {
    let rest = plan.detail - plan.detail.floor();
    let whole = (plan.detail as i32 + 1).max(0);
    let has_part = rest != 0.0 && plan.kind != Kind::Ridged;
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    let (mut total, mut amplitude, mut scale) = (0.0_f32, 1.0_f32, 1.0_f32);
    let mut value = if plan.kind == Kind::Multifractal { one } else { zero };
    // Of fBM the sum with one more octave, of the ridged kind the signal, of the hybrid one the weight.
    let (mut longer, mut longer_total, mut signal, mut weight) = (zero, 0.0, zero, one);
    let mut place = p;
    for octave in 0..whole + i32::from(has_part) {
        let is_part = octave == whole;
        let noise = signed_noise::<S, N>(simd, place);
        match plan.kind {
            Kind::Fbm if is_part => {
                longer = value + noise * amplitude;
                longer_total = total + amplitude;
            }
            Kind::Fbm => {
                value += noise * amplitude;
                total += amplitude;
            }
            Kind::Multifractal => value *= noise * (if is_part { rest * amplitude } else { amplitude }) + 1.0,
            Kind::HeteroTerrain if octave == 0 => value = offset + noise,
            Kind::HeteroTerrain => {
                let increment = ((noise + offset) * amplitude) * value;
                value += if is_part { increment * rest } else { increment };
            }
            Kind::Hybrid => {
                // A NaN weight ends the sum, too.
                let goes_on = weight.simd_gt(0.001);
                if goes_on.all_false() {
                    break;
                }
                let limited = weight.simd_lt(1.0).select(weight, one);
                let heard = (noise + offset) * amplitude;
                let factor = if is_part { limited * rest } else { limited };
                value = goes_on.select(value + factor * heard, value);
                weight = goes_on.select(limited * (gain * heard), weight);
            }
            Kind::Ridged => {
                let folded = offset - noise.abs();
                if octave == 0 {
                    signal = folded * folded;
                    value = signal;
                } else {
                    signal = (folded * folded) * saturate::<S>(simd, signal * gain);
                    value += signal * amplitude;
                }
            }
        }
        // Ridged and hetero terrain leave the first octave's amplitude of 1 out.
        amplitude *= plan.roughness;
        if plan.kind == Kind::Fbm {
            scale *= plan.lacunarity;
            place = each(|axis| p[axis] * scale);
        } else {
            place = each(|axis| place[axis] * plan.lacunarity);
        }
    }
    if plan.kind != Kind::Fbm {
        return value;
    }
    let normalized = |sum: S::f32s, total: f32| if plan.normalize { sum * 0.5 / total + 0.5 } else { sum };
    let low = normalized(value, total);
    if !has_part { low } else { low + (normalized(longer, longer_total) - low) * rest }
}

#[inline(always)]
fn signed_noise<S: Simd, const N: usize>(simd: S, p: [S::f32s; N]) -> S::f32s {
    let half = S::f32s::splat(simd, 0.5);
    let zero = S::f32s::splat(simd, 0.0);
    let wrapped = each(
        #[inline(always)]
        |axis| {
            let x = p[axis];
            let shift = x.abs().simd_ge(1_000_000.0).select(half, zero);
            remainder::<S, N>(simd, x) + shift
        },
    );
    perlin::<S, N>(simd, wrapped) * SCALE[N - 1]
}

/// The coordinate within its period: an exact remainder in one and two dimensions, a rounded one in three and four.
#[inline(always)]
fn remainder<S: Simd, const N: usize>(simd: S, x: S::f32s) -> S::f32s {
    if N > 2 {
        return x - (x * (1.0 / PERIOD)).trunc() * PERIOD;
    }
    // Within the first period, where nearly all points lie, nothing changes.
    if x.abs().simd_ge(PERIOD).all_false() {
        return x;
    }
    let lanes = S::f32s::LEN;
    let mut values = [0.0; 64];
    x.store_slice(&mut values[..lanes]);
    values[..lanes].iter_mut().for_each(|value| *value %= PERIOD);
    S::f32s::from_slice(simd, &values[..lanes])
}

#[inline(always)]
fn perlin<S: Simd, const N: usize>(simd: S, p: [S::f32s; N]) -> S::f32s {
    let floors: [S::f32s; N] = each(|axis| p[axis].floor());
    let cell: [S::u32s; N] = each(|axis| S::i32s::truncate_from(floors[axis]).bitcast());
    let fraction: [S::f32s; N] = each(|axis| p[axis] - floors[axis]);
    let weight: [S::f32s; N] = each(
        #[inline(always)]
        |axis| {
            let f = fraction[axis];
            let polynomial = f * (f * 6.0 - 15.0) + 10.0;
            if N == 1 { ((f * f) * f) * polynomial } else { (f * f) * (f * polynomial) }
        },
    );
    let mut corners = [S::f32s::splat(simd, 0.0); 16];
    // In four dimensions what the hash mixes of x, y and z serves both ends of w.
    let ends = if N == 4 { 2 } else { 1 };
    for index in 0..(1 << N) / ends {
        let bit = |axis: usize| (index >> axis) & 1;
        let mixed = mixed_words::<S, N>(simd, each(|axis| cell[axis] + bit(axis) as u32));
        let mut offset: [S::f32s; N] = each(|axis| fraction[axis] - bit(axis) as f32);
        for end in 0..ends {
            let mut words = mixed;
            if N == 4 {
                words[0] += cell[3] + end as u32;
                offset[3] = fraction[3] - end as f32;
            }
            corners[index + 8 * end] = gradient::<S, N>(finished_hash::<S>(words), offset);
        }
    }
    let mut count = 1 << N;
    for t in weight {
        count /= 2;
        for index in 0..count {
            corners[index] = corners[2 * index] + t * (corners[2 * index + 1] - corners[2 * index]);
        }
    }
    corners[0]
}

/// Flips the sign where `bit` of the hash is set.
#[inline(always)]
fn negate_if<S: Simd>(value: S::f32s, hash: S::u32s, bit: u32) -> S::f32s {
    let sign = (hash << (31 - bit)) & 0x8000_0000_u32;
    let bits: S::u32s = value.bitcast();
    (bits ^ sign).bitcast()
}

#[inline(always)]
fn gradient<S: Simd, const N: usize>(hash: S::u32s, d: [S::f32s; N]) -> S::f32s {
    match N {
        1 => {
            let magnitude = S::f32s::float_from((hash & 7) + 1);
            negate_if::<S>(magnitude, hash, 3) * d[0]
        }
        2 => {
            let is_along = (hash & 7).simd_lt(4);
            let (u, v) = (is_along.select(d[0], d[1]), is_along.select(d[1], d[0]));
            negate_if::<S>(u, hash, 0) + negate_if::<S>(v * 2.0, hash, 1)
        }
        3 => {
            let h = hash & 15;
            let u = h.simd_lt(8).select(d[0], d[1]);
            let is_x = h.simd_eq(12) | h.simd_eq(14);
            let v = h.simd_lt(4).select(d[1], is_x.select(d[0], d[2]));
            negate_if::<S>(u, h, 0) + negate_if::<S>(v, h, 1)
        }
        _ => {
            let h = hash & 31;
            let u = h.simd_lt(24).select(d[0], d[1]);
            let v = h.simd_lt(16).select(d[1], d[2]);
            let s = h.simd_lt(8).select(d[2], d[3]);
            (negate_if::<S>(u, h, 0) + negate_if::<S>(v, h, 1)) + negate_if::<S>(s, h, 2)
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::nodes::lane_tests::{adversarial_coordinates, assert_lanes_equal_scalar};
    use serde_json::json;

    /// Every combination of type, dimensions and normalisation with these values of Scale, Detail, Roughness, Lacunarity,
    /// Offset, Gain and Distortion.
    fn compare(parameters: [f32; 7]) {
        let coordinates = adversarial_coordinates(2048);
        for noise_type in ["FBM", "MULTIFRACTAL", "RIDGED_MULTIFRACTAL", "HYBRID_MULTIFRACTAL", "HETERO_TERRAIN"] {
            for dimensions in ["1D", "2D", "3D", "4D"] {
                let [scale, detail, roughness, lacunarity, offset, gain, distortion] = parameters;
                let mut used = vec![scale, detail, roughness, lacunarity];
                if matches!(noise_type, "RIDGED_MULTIFRACTAL" | "HYBRID_MULTIFRACTAL" | "HETERO_TERRAIN") {
                    used.push(offset);
                }
                if matches!(noise_type, "RIDGED_MULTIFRACTAL" | "HYBRID_MULTIFRACTAL") {
                    used.push(gain);
                }
                used.push(distortion);
                for normalize in [true, false] {
                    assert_lanes_equal_scalar(
                        &crate::nodes::noise_texture::TYPE,
                        &json!({"noise_dimensions": dimensions, "noise_type": noise_type, "normalize": normalize}),
                        vec!["Fac", "Color"],
                        &coordinates,
                        &used,
                    );
                    if noise_type != "FBM" {
                        break;
                    }
                }
            }
        }
    }

    #[test]
    fn every_mode_equals_the_scalar_evaluation() {
        compare([5.0, 2.0, 0.5, 2.0, 0.0, 1.0, 0.0]);
        compare([-2.0, 0.0, 0.0, 0.0, 0.7, -1.5, 0.0]);
        compare([0.3, 15.0, 1.0, 2.5, 1.3, 2.0, 0.0]);
        compare([1.0, 3.7, 0.5, -2.0, -0.4, 0.5, 0.0]);
    }

    #[test]
    fn distorted_points_equal_the_scalar_evaluation() {
        compare([5.0, 2.0, 0.5, 2.0, 0.3, 1.0, 1.5]);
        compare([1.0, 0.4, 1.1, 1.7, 2.0, 3.0, -40.0]);
        compare([1.0, 1.0, 0.5, 2.0, 0.3, 1.0, f32::INFINITY]);
    }

    #[test]
    fn offset_and_gain_that_are_no_numbers_equal_the_scalar_evaluation() {
        compare([1.0, 4.0, 0.5, 2.0, f32::NAN, 1.0, 0.0]);
        compare([1.0, 4.0, 0.5, 2.0, 1e30, f32::NAN, 0.0]);
        compare([1.0, 4.5, 0.5, 2.0, 1.0, f32::INFINITY, 0.0]);
    }
}
