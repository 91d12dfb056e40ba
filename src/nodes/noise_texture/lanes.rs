//! fBM without distortion in 3D and 4D on SIMD lanes, one point per lane; the same bits as the
//! scalar evaluation, which these functions follow operation by operation.

use super::{Fractal, NoiseTexture};
use crate::nodes::gradient_noise::{PERIOD, SCALE, random_offset};
use crate::nodes::{Column, Evaluate, Real, columns_at, lane_level};
use fearless_simd::{dispatch, prelude::*};

/// Coordinates beyond this magnitude are left to the scalar evaluation.
const LARGEST_COORDINATE: f32 = 1.0e9;

/// Evaluates if this mode and these inputs have a lane version: fBM in 3D or 4D, no distortion,
/// parameters equal at all points.
pub(super) fn evaluate(node: &NoiseTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
    let columns = node.parameter_columns();
    let uniform = columns.iter().enumerate().all(|(number, &column)| {
        // Offset and gain do not exist for fBM; their numbers point at other columns.
        matches!(number, 4 | 5) || inputs[column].uniform
    });
    if node.fractal != "FBM" || node.dimensions < 3 || !uniform || inputs[columns[6]].values[0] != 0.0 {
        return false;
    }
    let at = |number: usize| inputs[columns[number]].values[0];
    let plan = Plan {
        scale: at(0),
        detail: Real::clamped(at(1), 0.0, 15.0),
        roughness: Real::fmax(at(2), 0.0),
        lacunarity: at(3),
        normalize: node.normalize,
        factor: node.factor,
        color: node.color,
    };
    if ![plan.scale, plan.detail, plan.roughness, plan.lacunarity].iter().all(|value| value.is_finite()) {
        return false;
    }
    match node.dimensions {
        3 => dispatch!(lane_level(), simd => run::<_, 3>(simd, &plan, inputs, outputs)),
        _ => dispatch!(lane_level(), simd => run::<_, 4>(simd, &plan, inputs, outputs)),
    }
    let growth = plan.lacunarity.abs().max(1.0).powi(plan.detail as i32 + 1);
    let largest_factor = plan.scale.abs() * growth;
    for index in 0..outputs[0].len() {
        // 1000 covers the offsets of the colour channels.
        let near = (0..node.dimensions)
            .all(|axis| (inputs[axis].values[index] * largest_factor).abs() + 1000.0 * growth < LARGEST_COORDINATE);
        if !near {
            let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(|output| &mut output[index..=index]).collect();
            node.evaluate(&columns_at(inputs, index), &mut slices);
        }
    }
    true
}

/// Normalised 3D fBM at `places` (x, y, z), bit for bit [`Fractal::fbm`]. Detail lies below 128 and Roughness is finite.
pub(in crate::nodes) fn fbm_values(fractal: &Fractal<f32>, places: [&[f32]; 3], values: &mut [f32]) {
    let plan = Plan {
        scale: 1.0,
        detail: fractal.detail,
        roughness: fractal.roughness,
        lacunarity: fractal.lacunarity,
        normalize: true,
        factor: true,
        color: false,
    };
    let columns = places.map(|values| Column { values, uniform: false });
    dispatch!(lane_level(), simd => run::<_, 3>(simd, &plan, &columns, &mut [&mut *values]));
    let growth = plan.lacunarity.abs().max(1.0).powi(plan.detail.max(0.0) as i32 + 1);
    for (index, value) in values.iter_mut().enumerate() {
        let p = places.map(|place| place[index]);
        if !p.iter().all(|x| (x * growth).abs() < LARGEST_COORDINATE) {
            *value = fractal.fbm(p, true);
        }
    }
}

/// What is equal at all points.
struct Plan {
    scale: f32,
    detail: f32,
    roughness: f32,
    lacunarity: f32,
    normalize: bool,
    factor: bool,
    color: bool,
}

#[inline(always)]
fn run<S: Simd, const N: usize>(simd: S, plan: &Plan, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) {
    simd.vectorize(
        #[inline(always)]
        || run_vectorized::<S, N>(simd, plan, inputs, outputs),
    );
}

#[inline(always)]
fn run_vectorized<S: Simd, const N: usize>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
) {
    let lanes = S::f32s::LEN;
    let count = outputs[0].len();
    let seeds: [[f32; N]; 2] = [N as f32, (N + 1) as f32].map(random_offset);
    for start in (0..count).step_by(lanes) {
        let used = lanes.min(count - start);
        let p: [S::f32s; N] = std::array::from_fn(|axis| {
            let mut values = [0.0; 64];
            values[..used].copy_from_slice(&inputs[axis].values[start..start + used]);
            S::f32s::from_slice(simd, &values[..lanes]) * plan.scale
        });
        let mut store = |output: usize, value: S::f32s| {
            let mut values = [0.0; 64];
            value.store_slice(&mut values[..lanes]);
            outputs[output][start..start + used].copy_from_slice(&values[..used]);
        };
        let value = fbm::<S, N>(simd, plan, p);
        let mut next = 0;
        if plan.factor {
            store(0, value);
            next = 1;
        }
        if plan.color {
            store(next, value);
            for (channel, seed) in seeds.iter().enumerate() {
                let shifted = std::array::from_fn(|axis| p[axis] + seed[axis]);
                store(next + 1 + channel, fbm::<S, N>(simd, plan, shifted));
            }
        }
    }
}

#[inline(always)]
fn fbm<S: Simd, const N: usize>(simd: S, plan: &Plan, p: [S::f32s; N]) -> S::f32s {
    let rest = plan.detail - plan.detail.floor();
    let (mut total, mut amplitude, mut scale) = (0.0_f32, 1.0_f32, 1.0_f32);
    let mut sum = S::f32s::splat(simd, 0.0);
    for _ in 0..=plan.detail as i32 {
        sum += signed_noise::<S, N>(simd, p.map(|x| x * scale)) * amplitude;
        total += amplitude;
        amplitude *= plan.roughness;
        scale *= plan.lacunarity;
    }
    let normalized = |sum: S::f32s, total: f32| if plan.normalize { sum * 0.5 / total + 0.5 } else { sum };
    if rest == 0.0 {
        return normalized(sum, total);
    }
    let next = sum + signed_noise::<S, N>(simd, p.map(|x| x * scale)) * amplitude;
    let low = normalized(sum, total);
    low + (normalized(next, total + amplitude) - low) * rest
}

#[inline(always)]
fn signed_noise<S: Simd, const N: usize>(simd: S, p: [S::f32s; N]) -> S::f32s {
    let half = S::f32s::splat(simd, 0.5);
    let zero = S::f32s::splat(simd, 0.0);
    let wrapped = p.map(|x| {
        let shift = x.abs().simd_ge(1_000_000.0).select(half, zero);
        (x - (x * (1.0 / PERIOD)).trunc() * PERIOD) + shift
    });
    perlin::<S, N>(simd, wrapped) * SCALE[N - 1]
}

#[inline(always)]
fn perlin<S: Simd, const N: usize>(simd: S, p: [S::f32s; N]) -> S::f32s {
    let floors = p.map(|x| x.floor());
    let cell: [S::u32s; N] = floors.map(|x| S::i32s::truncate_from(x).bitcast());
    let fraction: [S::f32s; N] = std::array::from_fn(|axis| p[axis] - floors[axis]);
    let weight = fraction.map(|f| (f * f) * (f * (f * (f * 6.0 - 15.0) + 10.0)));
    let mut corners = [S::f32s::splat(simd, 0.0); 16];
    for (index, corner) in corners.iter_mut().enumerate().take(1 << N) {
        let bit = |axis: usize| (index >> axis) & 1;
        let hash = jenkins::<S, N>(simd, std::array::from_fn(|axis| cell[axis] + bit(axis) as u32));
        let offset: [S::f32s; N] = std::array::from_fn(|axis| fraction[axis] - bit(axis) as f32);
        *corner = gradient::<S, N>(hash, offset);
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
    if N == 3 {
        let h = hash & 15;
        let u = h.simd_lt(8).select(d[0], d[1]);
        let is_x = h.simd_eq(12) | h.simd_eq(14);
        let v = h.simd_lt(4).select(d[1], is_x.select(d[0], d[2]));
        return negate_if::<S>(u, h, 0) + negate_if::<S>(v, h, 1);
    }
    let h = hash & 31;
    let u = h.simd_lt(24).select(d[0], d[1]);
    let v = h.simd_lt(16).select(d[1], d[2]);
    let s = h.simd_lt(8).select(d[2], d[3]);
    (negate_if::<S>(u, h, 0) + negate_if::<S>(v, h, 1)) + negate_if::<S>(s, h, 2)
}

#[inline(always)]
fn rotate<S: Simd>(value: S::u32s, count: u32) -> S::u32s {
    (value << count) | (value >> (32 - count))
}

/// Jenkins' lookup3; see [`crate::nodes::hash::jenkins`].
#[inline(always)]
fn jenkins<S: Simd, const N: usize>(simd: S, keys: [S::u32s; N]) -> S::u32s {
    let start = 0xDEAD_BEEF_u32.wrapping_add(4 * N as u32).wrapping_add(13);
    let [mut a, mut b, mut c] = [S::u32s::splat(simd, start); 3];
    a += keys[0];
    b += keys[1];
    c += keys[2];
    if N == 4 {
        (a, c) = mix::<S>(a, b, c, 4);
        (b, a) = mix::<S>(b, c, a, 6);
        (c, b) = mix::<S>(c, a, b, 8);
        (a, c) = mix::<S>(a, b, c, 16);
        (b, a) = mix::<S>(b, c, a, 19);
        (c, b) = mix::<S>(c, a, b, 4);
        a += keys[3];
    }
    c = last::<S>(c, b, 14);
    a = last::<S>(a, c, 11);
    b = last::<S>(b, a, 25);
    c = last::<S>(c, b, 16);
    a = last::<S>(a, c, 4);
    b = last::<S>(b, a, 14);
    last::<S>(c, b, 24)
}

/// One mixing step on (x, y, z): the new x and z.
#[inline(always)]
fn mix<S: Simd>(x: S::u32s, y: S::u32s, z: S::u32s, count: u32) -> (S::u32s, S::u32s) {
    ((x - z) ^ rotate::<S>(z, count), z + y)
}

/// One final step: the new x.
#[inline(always)]
fn last<S: Simd>(x: S::u32s, y: S::u32s, count: u32) -> S::u32s {
    (x ^ y) - rotate::<S>(y, count)
}

#[cfg(test)]
mod tests {
    use crate::nodes::lane_tests::{adversarial_coordinates, assert_lanes_equal_scalar};
    use serde_json::json;

    #[test]
    fn every_mode_equals_the_scalar_evaluation() {
        let coordinates = adversarial_coordinates(4096);
        for dimensions in ["3D", "4D"] {
            for normalize in [true, false] {
                let properties = json!({"noise_dimensions": dimensions, "normalize": normalize});
                // Scale, detail, roughness, lacunarity, distortion.
                for parameters in [
                    [5.0, 2.0, 0.5, 2.0, 0.0],
                    [-2.0, 0.0, 0.0, 0.0, 0.0],
                    [0.3, 15.0, 1.0, 2.5, 0.0],
                    [1.0, 3.7, 0.5, -2.0, 0.0],
                ] {
                    assert_lanes_equal_scalar(
                        &crate::nodes::noise_texture::TYPE,
                        &properties,
                        vec!["Fac", "Color"],
                        &coordinates,
                        &parameters,
                    );
                }
            }
        }
    }
}
