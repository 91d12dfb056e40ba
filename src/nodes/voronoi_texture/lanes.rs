//! F1 distance on SIMD lanes, one point per lane; the same bits as the full scan.
//!
//! Two facts make it fast. First, the smallest distance does not depend on the order of the cells,
//! and a cell whose *box* is not nearer than the best point so far cannot hold a nearer point. The
//! test is exact in f32, without a margin: a point of the cell at offset +1 lies at `1 + hash`
//! with hash >= 0, so its offset from the coordinate is at least `1 - local`, and rounding is
//! monotone; likewise at offset -1 it is at least `local` away. The metric is monotone in each
//! magnitude and is summed in the same order, so the bound never exceeds the true value.
//! Second, the cells are visited near side first: per axis and lane "near" is the neighbour on the
//! side of the coordinate within its cell, so that lanes at unrelated points agree on an order in
//! which most of the 81 cells of 4D are skipped.

use super::{Feature, Metric, VoronoiTexture};
use crate::nodes::{Column, Evaluate, columns_at, lane_level};
use fearless_simd::{dispatch, prelude::*};

/// Factor and increment of the integer hash; see [`crate::nodes::hash::pcg`].
const MULTIPLIER: i32 = 1_664_525;
const INCREMENT: i32 = 1_013_904_223;

/// Cells beyond this magnitude are left to the scalar evaluation, which knows what x86 does there.
const LARGEST_COORDINATE: f32 = 1.0e9;

/// Evaluates if this mode and these inputs have a lane version: F1, distance only, 2 to 4
/// dimensions, any metric but Minkowski, parameters equal at all points.
pub(super) fn evaluate(node: &VoronoiTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
    let distance_only = node.distance && !node.color && !node.position && !node.w;
    if node.feature != Feature::F1 || !distance_only || node.metric == Metric::Minkowski || node.dimensions == 1 {
        return false;
    }
    let Some(plan) = Plan::new(node, inputs) else { return false };
    let level = lane_level();
    let output = &mut *outputs[0];
    match (node.dimensions, node.metric) {
        (2, Metric::Euclidean) => dispatch!(level, simd => run::<_, 2, EUCLIDEAN>(simd, &plan, inputs, output)),
        (2, Metric::Manhattan) => dispatch!(level, simd => run::<_, 2, MANHATTAN>(simd, &plan, inputs, output)),
        (2, _) => dispatch!(level, simd => run::<_, 2, CHEBYCHEV>(simd, &plan, inputs, output)),
        (3, Metric::Euclidean) => dispatch!(level, simd => run::<_, 3, EUCLIDEAN>(simd, &plan, inputs, output)),
        (3, Metric::Manhattan) => dispatch!(level, simd => run::<_, 3, MANHATTAN>(simd, &plan, inputs, output)),
        (3, _) => dispatch!(level, simd => run::<_, 3, CHEBYCHEV>(simd, &plan, inputs, output)),
        (_, Metric::Euclidean) => dispatch!(level, simd => run::<_, 4, EUCLIDEAN>(simd, &plan, inputs, output)),
        (_, Metric::Manhattan) => dispatch!(level, simd => run::<_, 4, MANHATTAN>(simd, &plan, inputs, output)),
        (_, _) => dispatch!(level, simd => run::<_, 4, CHEBYCHEV>(simd, &plan, inputs, output)),
    }
    for index in 0..output.len() {
        let near = (0..node.dimensions)
            .all(|axis| (inputs[axis].values[index] * plan.largest_factor).abs() < LARGEST_COORDINATE);
        if !near {
            node.evaluate(&columns_at(inputs, index), &mut [&mut output[index..=index]]);
        }
    }
    true
}

const EUCLIDEAN: u8 = 0;
const MANHATTAN: u8 = 1;
const CHEBYCHEV: u8 = 2;

/// One octave: factor on the scaled coordinate, and how its distance joins the sum.
struct Octave {
    scale: f32,
    amplitude: f32,
    /// Blend factor of the fractional last octave, none for whole ones.
    rest: Option<f32>,
}

/// What is equal at all points.
struct Plan {
    scale: f32,
    randomness: f32,
    octaves: Vec<Octave>,
    /// The single octave counts as it is, without amplitude.
    single: bool,
    /// Divisor of the normalised distance.
    divisor: Option<f32>,
    /// Largest factor on an input coordinate, for the range check.
    largest_factor: f32,
}

impl Plan {
    fn new(node: &VoronoiTexture, inputs: &[Column<'_, f32>]) -> Option<Self> {
        let columns = node.parameter_columns();
        for column in columns.into_iter().flatten() {
            if !inputs[column].uniform {
                return None;
            }
        }
        let parameters = node.parameters(inputs, 0);
        let finite = [parameters.scale, parameters.detail, parameters.roughness, parameters.lacunarity];
        if !finite.iter().all(|value| value.is_finite()) {
            return None;
        }
        let single = parameters.detail == 0.0 || parameters.roughness == 0.0;
        let whole = parameters.detail.floor() as i32;
        let rest = parameters.detail - parameters.detail.floor();
        let (mut amplitude, mut total, mut scale) = (1.0_f32, 0.0_f32, 1.0_f32);
        let mut octaves = Vec::new();
        for octave in 0..=parameters.detail.ceil() as i32 {
            if single {
                octaves.push(Octave { scale, amplitude, rest: None });
                total = 1.0;
                break;
            }
            if octave <= whole {
                octaves.push(Octave { scale, amplitude, rest: None });
                total += amplitude;
                scale *= parameters.lacunarity;
                amplitude *= parameters.roughness;
            } else if rest != 0.0 {
                octaves.push(Octave { scale, amplitude, rest: Some(rest) });
                total = total + rest * ((total + amplitude) - total);
            }
        }
        let largest_scale = octaves.iter().map(|octave| octave.scale.abs()).fold(1.0, f32::max);
        let largest: f32 = match node.dimensions {
            2 => node.largest_distance::<f32, 2>(&parameters),
            3 => node.largest_distance::<f32, 3>(&parameters),
            _ => node.largest_distance::<f32, 4>(&parameters),
        };
        Some(Self {
            scale: parameters.scale,
            randomness: parameters.randomness,
            octaves,
            single,
            divisor: node.normalize.then_some(total * largest),
            largest_factor: parameters.scale.abs() * largest_scale,
        })
    }
}

#[inline(always)]
fn run<S: Simd, const N: usize, const METRIC: u8>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    output: &mut [f32],
) {
    simd.vectorize(
        #[inline(always)]
        || run_vectorized::<S, N, METRIC>(simd, plan, inputs, output),
    );
}

#[inline(always)]
fn run_vectorized<S: Simd, const N: usize, const METRIC: u8>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    output: &mut [f32],
) {
    let lanes = S::f32s::LEN;
    let count = output.len();
    let order = visiting_order::<N>();
    for start in (0..count).step_by(lanes) {
        let used = lanes.min(count - start);
        let q: [S::f32s; N] = std::array::from_fn(|axis| {
            let mut values = [0.0; 64];
            values[..used].copy_from_slice(&inputs[axis].values[start..start + used]);
            S::f32s::from_slice(simd, &values[..lanes]) * plan.scale
        });
        let mut sum = S::f32s::splat(simd, 0.0);
        for octave in &plan.octaves {
            let x: [S::f32s; N] = std::array::from_fn(|axis| q[axis] * octave.scale);
            let found = f1::<S, N, METRIC>(simd, x, plan.randomness, order);
            sum = if plan.single {
                found
            } else {
                match octave.rest {
                    None => sum + found * octave.amplitude,
                    Some(rest) => sum + ((sum + found * octave.amplitude) - sum) * rest,
                }
            };
        }
        if let Some(divisor) = plan.divisor {
            sum /= divisor;
        }
        let mut values = [0.0; 64];
        sum.store_slice(&mut values[..lanes]);
        output[start..start + used].copy_from_slice(&values[..used]);
    }
}

/// Cells by kind per axis (0 own, 1 near, 2 far), likely nearest first.
fn visiting_order<const N: usize>() -> &'static [[u8; 4]] {
    static ORDERS: std::sync::OnceLock<[Vec<[u8; 4]>; 3]> = std::sync::OnceLock::new();
    let orders = ORDERS.get_or_init(|| {
        [2, 3, 4].map(|dimensions: u32| {
            let mut cells: Vec<[u8; 4]> = (0..3_u32.pow(dimensions))
                .map(|index| {
                    std::array::from_fn(|axis| {
                        if (axis as u32) < dimensions { (index / 3_u32.pow(axis as u32) % 3) as u8 } else { 0 }
                    })
                })
                .collect();
            // Mean squared distance to the box of a kind, in twelfths: own 0, near 1, far 7.
            cells.sort_by_key(|cell| cell.iter().map(|&kind| [0, 1, 7][usize::from(kind)]).sum::<u32>());
            cells
        })
    });
    &orders[N - 2]
}

/// Per axis and kind: the offset of the cell, the linear part of its hash, and the least
/// magnitude (squared for the Euclidean metric) of an offset to its point.
struct Axis<S: Simd> {
    offset: [S::f32s; 3],
    hash: [S::i32s; 3],
    least: [S::f32s; 3],
    local: S::f32s,
}

#[inline(always)]
fn axis<S: Simd, const METRIC: u8>(simd: S, x: S::f32s) -> Axis<S> {
    let floor = x.floor();
    let local = x - floor;
    let cell: S::i32s = S::i32s::truncate_from(floor);
    let upper = local.simd_ge(0.5);
    let one = S::f32s::splat(simd, 1.0);
    let up = one - local;
    let near = upper.select(one, -one);
    let near_least = upper.select(up, local);
    let far_least = upper.select(local, up);
    let square = |value: S::f32s| if METRIC == EUCLIDEAN { value * value } else { value };
    let hash = cell * MULTIPLIER + INCREMENT;
    let step = S::i32s::splat(simd, MULTIPLIER);
    let near_hash = upper.select(hash + step, hash - step);
    let far_hash = upper.select(hash - step, hash + step);
    let zero = S::f32s::splat(simd, 0.0);
    Axis {
        offset: [zero, near, -near],
        hash: [hash, near_hash, far_hash],
        least: [zero, square(near_least), square(far_least)],
        local,
    }
}

/// Joins per-axis magnitudes (squared for the Euclidean metric) in the kernel's association.
#[inline(always)]
fn join<S: Simd, const N: usize, const METRIC: u8>(v: [S::f32s; N]) -> S::f32s {
    let add = |a: S::f32s, b: S::f32s| if METRIC == CHEBYCHEV { a.max(b) } else { a + b };
    match N {
        2 => add(v[0], v[1]),
        3 => add(add(v[0], v[1]), v[2]),
        _ => add(add(v[0], v[1]), add(v[2], v[3])),
    }
}

#[inline(always)]
fn f1<S: Simd, const N: usize, const METRIC: u8>(
    simd: S,
    x: [S::f32s; N],
    randomness: f32,
    order: &[[u8; 4]],
) -> S::f32s {
    let axes: [Axis<S>; N] = std::array::from_fn(|index| axis::<S, METRIC>(simd, x[index]));
    let mut best = S::f32s::splat(simd, f32::MAX);
    for cell in order {
        let kind = |index: usize| usize::from(cell[index]);
        let least = join::<S, N, METRIC>(std::array::from_fn(|index| axes[index].least[kind(index)]));
        if least.simd_lt(best).all_false() {
            continue;
        }
        let hash = hash::<S, N>(std::array::from_fn(|index| axes[index].hash[kind(index)]));
        let v: [S::f32s; N] = std::array::from_fn(|index| {
            let axis = &axes[index];
            // The product with 2^-31 is exact; a randomness of 1 leaves the value as it is.
            let value: S::f32s = S::f32s::float_from(hash[index]) * (1.0 / 2_147_483_648.0);
            let v = (axis.offset[kind(index)] + value * randomness) - axis.local;
            if METRIC == EUCLIDEAN { v * v } else { v.abs() }
        });
        best = best.min(join::<S, N, METRIC>(v));
    }
    if METRIC == EUCLIDEAN { best.sqrt() } else { best }
}

/// The rounds of [`crate::nodes::hash::pcg`] after its linear part.
#[inline(always)]
fn hash<S: Simd, const N: usize>(mut v: [S::i32s; N]) -> [S::i32s; N] {
    round::<S, N>(&mut v);
    v = v.map(|x| x ^ (x >> 16));
    round::<S, N>(&mut v);
    v.map(|x| x & 0x7FFF_FFFF)
}

#[inline(always)]
fn round<S: Simd, const N: usize>(v: &mut [S::i32s; N]) {
    match N {
        2 => {
            v[0] += v[1] * MULTIPLIER;
            v[1] += v[0] * MULTIPLIER;
        }
        3 => {
            v[0] += v[1] * v[2];
            v[1] += v[2] * v[0];
            v[2] += v[0] * v[1];
        }
        _ => {
            v[0] += v[1] * v[3];
            v[1] += v[2] * v[0];
            v[2] += v[0] * v[1];
            v[3] += v[1] * v[2];
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::nodes::lane_tests::{adversarial_coordinates, assert_lanes_equal_scalar};
    use serde_json::json;

    #[test]
    fn every_mode_equals_the_full_scan() {
        let coordinates = adversarial_coordinates(4096);
        for dimensions in ["2D", "3D", "4D"] {
            for distance in ["EUCLIDEAN", "MANHATTAN", "CHEBYCHEV"] {
                let properties = json!({"voronoi_dimensions": dimensions, "distance": distance, "normalize": true});
                // Scale, detail, roughness, lacunarity, randomness.
                for parameters in [
                    [5.0, 0.0, 0.5, 2.0, 1.0],
                    [-2.0, 5.0, 0.75, 2.5, 1.0],
                    [0.3, 3.4, 1.0, 3.0, 0.6],
                    [7.0, 0.25, 0.5, -1.5, 0.0],
                ] {
                    assert_lanes_equal_scalar(
                        &crate::nodes::voronoi_texture::TYPE,
                        &properties,
                        vec!["Distance"],
                        &coordinates,
                        &parameters,
                    );
                }
            }
        }
    }
}
