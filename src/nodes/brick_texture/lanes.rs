//! Bricks on SIMD lanes, one point per lane; the same bits as the scalar evaluation, which these functions follow operation by
//! operation, computing both sides of its branches.

use crate::base::arrays::each;
use crate::nodes::brick_texture::{
    BIAS, BrickTexture, FIRST_COLOR, HEIGHT, Layout, MORTAR, MORTAR_SIZE, MORTAR_SMOOTH, SCALE, SECOND_COLOR, WIDTH,
};
use crate::nodes::lanes::{self, lesser, saturate};
use crate::nodes::{Column, Evaluate, columns_at, lane_level};
use fearless_simd::{dispatch, prelude::*};

/// Rows from here on are left to the scalar evaluation. Below it, dividing by a frequency of at most 99 in f32 does not round
/// up to a whole number, and remainders are exact.
const LARGEST_ROW: f32 = 16_384.0;

/// Columns from here on are left to the scalar evaluation, which knows what numbers beyond 2^31 become.
const LARGEST_COLUMN: f32 = 1.0e9;

/// Always has a lane version.
pub(super) fn evaluate(node: &BrickTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) {
    let far = dispatch!(lane_level(), simd => run(simd, node, inputs, outputs));
    for index in far {
        let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(|output| &mut output[index..=index]).collect();
        node.evaluate(&columns_at(inputs, index), &mut slices);
    }
}

/// Returns the points that are left to the scalar evaluation.
#[inline(always)]
fn run<S: Simd>(simd: S, node: &BrickTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> Vec<usize> {
    simd.vectorize(
        #[inline(always)]
        || run_vectorized(simd, node, inputs, outputs),
    )
}

#[inline(always)]
fn run_vectorized<S: Simd>(
    simd: S,
    node: &BrickTexture,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
) -> Vec<usize> {
    let one = S::f32s::splat(simd, 1.0);
    let count = outputs[0].len();
    let mut far = Vec::new();
    for start in (0..count).step_by(S::f32s::LEN) {
        let used = S::f32s::LEN.min(count - start);
        let load = |column: usize| lanes::load::<S>(simd, &inputs[column].values[start..start + used]);
        let load_color = |first: usize| -> [S::f32s; 3] { each(|channel| load(first + channel)) };
        let scale = load(SCALE);
        let (x, y) = (load(0) * scale, load(1) * scale);
        let height = load(HEIGHT);
        let row = (y / height).floor();
        let (width, shift) = widths(simd, &node.layout, row, load(WIDTH));
        let x = x + shift;
        let column = (x / width).floor();
        let is_near = row.abs().simd_lt(LARGEST_ROW) & column.abs().simd_lt(LARGEST_COLUMN);
        far.extend(lanes::marked::<S>(is_near, false, used).map(|lane| start + lane));
        let x = x - width * column;
        let y = y - height * row;
        let edge = lesser::<S>(lesser::<S>(x, y), lesser::<S>(width - x, height - y));
        let share = mortar(simd, edge, load(MORTAR_SIZE), load(MORTAR_SMOOTH));
        let mut next = 0;
        if node.color {
            let first = load_color(FIRST_COLOR);
            let tint = saturate(simd, brick_value::<S>(row, column) + load(BIAS));
            let tinted = blend(simd, first, load_color(SECOND_COLOR), tint);
            let is_mortar = share.simd_eq(one);
            let base = each(|channel| is_mortar.select(first[channel], tinted[channel]));
            for value in blend(simd, base, load_color(MORTAR), share) {
                lanes::store::<S>(value, &mut outputs[next][start..start + used]);
                next += 1;
            }
        }
        if node.factor {
            lanes::store::<S>(share, &mut outputs[next][start..start + used]);
        }
    }
    far
}

/// Width of the bricks of a row, and how far the row is shifted; see [`Layout::differs`].
#[inline(always)]
fn widths<S: Simd>(simd: S, layout: &Layout, row: S::f32s, width: S::f32s) -> (S::f32s, S::f32s) {
    let zero = S::f32s::splat(simd, 0.0);
    if layout.offset_frequency == 0 || layout.squash_frequency == 0 {
        return (width, zero);
    }
    let is_multiple = |frequency: i32| {
        let frequency = frequency as f32;
        (row - (row / frequency).trunc() * frequency).simd_eq(zero)
    };
    let width = is_multiple(layout.squash_frequency).select(width * layout.squash, width);
    (width, is_multiple(layout.offset_frequency).select(width * layout.offset, zero))
}

/// [`super::mortar`].
#[inline(always)]
fn mortar<S: Simd>(simd: S, edge: S::f32s, size: S::f32s, smooth: S::f32s) -> S::f32s {
    let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
    let g = (one - edge / size) / smooth;
    let step = (g * g) * 3.0 - ((g * g) * 2.0) * g;
    let limited = g.simd_le(zero).select(zero, g.simd_ge(one).select(one, step));
    edge.simd_ge(size).select(zero, smooth.simd_eq(zero).select(one, limited))
}

/// [`super::brick_value`].
#[inline(always)]
fn brick_value<S: Simd>(row: S::f32s, column: S::f32s) -> S::f32s {
    let number = |value: S::f32s| -> S::u32s { S::i32s::truncate_from(value).bitcast() };
    let start = ((number(row) << 16) + (number(column) & 0xFFFF) + 1013) & 0x7FFF_FFFF;
    let n = (start >> 13) ^ start;
    let square = n * n * 60_493 + 19_990_303;
    let hash: S::i32s = ((n * square + 1_376_312_589) & 0x7FFF_FFFF).bitcast();
    S::f32s::float_from(hash) * (1.0 / 2_147_483_648.0)
}

/// [`super::blend`].
#[inline(always)]
fn blend<S: Simd>(simd: S, a: [S::f32s; 3], b: [S::f32s; 3], t: S::f32s) -> [S::f32s; 3] {
    let rest = S::f32s::splat(simd, 1.0) - t;
    each(|channel| a[channel] * rest + b[channel] * t)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::lane_tests::adversarial_coordinates;

    /// The inputs after the coordinate: two colours and the mortar's, scale, mortar size and smoothness, bias, width, height.
    fn compare(layout: Layout, parameters: [f32; 6]) {
        let rows = adversarial_coordinates(4096);
        let color = [0.8, 0.1, 0.3, 0.2, 0.9, 0.4, 0.05, 0.0, 1.0];
        let mut values: Vec<Vec<f32>> = (0..3).map(|axis| rows.iter().map(|row| row[axis]).collect()).collect();
        values.extend(color.iter().chain(&parameters).map(|&value| vec![value; rows.len()]));
        let inputs: Vec<Column<'_, f32>> = values.iter().map(|values| Column { values, uniform: false }).collect();
        let node = BrickTexture { layout, release: crate::scene::Release::V5_0, color: true, factor: true };
        let run = |on_lanes: bool| {
            let mut outputs = vec![vec![0.0; rows.len()]; 4];
            let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
            match on_lanes {
                true => assert!(node.evaluate_fast(&inputs, &mut slices)),
                false => node.evaluate(&inputs, &mut slices),
            }
            outputs
        };
        let (lanes, scalar) = (run(true), run(false));
        for (lane, expected) in lanes.iter().flatten().zip(scalar.iter().flatten()) {
            assert!(lane.to_bits() == expected.to_bits() || (lane.is_nan() && expected.is_nan()), "{lane} {expected}");
        }
    }

    #[test]
    fn every_layout_equals_the_scalar_evaluation() {
        for frequencies in [[2, 2], [3, 2], [1, 99], [0, 2], [7, 3]] {
            for parameters in [
                [5.0, 0.02, 0.1, 0.0, 0.5, 0.25],
                [-300.0, 0.1, 0.0, 0.4, 0.7, 0.01],
                [1.0, 0.3, 1.0, -2.0, 0.0, 1.0],
                [1.0, f32::NAN, f32::INFINITY, f32::NAN, -0.3, f32::INFINITY],
                [1.0, 0.0, f32::NAN, 0.5, f32::NAN, 0.3],
            ] {
                let [offset_frequency, squash_frequency] = frequencies;
                compare(Layout { offset: 0.3, offset_frequency, squash: 0.7, squash_frequency }, parameters);
            }
        }
    }
}
