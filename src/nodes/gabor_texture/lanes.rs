//! The f32 evaluation: eight lanes hold the eight impulses of a cell, with the same bits as the scalar
//! evaluation.
//!
//! Two things are left out that add nothing. A cell whose box is not nearer than 1 holds no impulse
//! that counts: an impulse of the cell at offset +1 is at `local - hash` with `local <= 0` and
//! hash in [0, 1], hence not nearer than `-local` along that axis, and one of the cell at offset -1 not
//! nearer than `local - 1`; rounding is monotone, so the test is exact in f32, without a margin. And
//! only impulses nearer than 1 get their direction, their sign and the C library's functions,
//! which are called one by one in the scalar order.

use crate::base::arrays::each;
use crate::nodes::gabor_texture::{
    ANISOTROPY, FREQUENCY, GaborTexture, IMPULSES, ORIENTATION, SCALE, Waves, neighbours, phasor,
};
use crate::nodes::real::dot;
use crate::nodes::{Column, lane_level};
use fearless_simd::{dispatch, f32x8, prelude::*, u32x8};

/// Evaluates all points.
pub(super) fn evaluate(node: &GaborTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) {
    match node.dimensions {
        2 => dispatch!(lane_level(), simd => run::<_, 2>(simd, node, inputs, outputs)),
        _ => dispatch!(lane_level(), simd => run::<_, 3>(simd, node, inputs, outputs)),
    }
}

#[inline(always)]
fn run<S: Simd, const N: usize>(simd: S, node: &GaborTexture, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) {
    simd.vectorize(
        #[inline(always)]
        || run_vectorized::<S, N>(simd, node, inputs, outputs),
    );
}

#[inline(always)]
fn run_vectorized<S: Simd, const N: usize>(
    simd: S,
    node: &GaborTexture,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
) {
    let seeds: [u32x8<S>; 3] = each(|seed| {
        let bits: [u32; IMPULSES] = each(|impulse| ((3 * impulse + seed) as f32).to_bits());
        u32x8::from_slice(simd, &bits)
    });
    let offsets: Vec<[f32; N]> = neighbours().collect();
    let last = if N == 2 { ORIENTATION } else { ORIENTATION + 2 };
    let uniform = [FREQUENCY, ANISOTROPY].into_iter().chain(ORIENTATION..=last).all(|column| inputs[column].uniform);
    let mut waves: Option<Waves<f32, N>> = None;
    for index in 0..outputs[0].len() {
        let at = |column: usize| inputs[column].values[index];
        let waves = match waves {
            Some(known) if uniform => known,
            _ => *waves.insert(Waves::new(inputs, index)),
        };
        let p: [f32; N] = each(|axis| at(axis) * at(SCALE));
        let corner: [f32; N] = each(|axis| p[axis].floor());
        let fraction: [f32; N] = each(|axis| p[axis] - corner[axis]);
        if fraction.iter().any(|place| place.is_nan()) {
            node.store([f32::NAN; 2], outputs, index);
            continue;
        }
        let mut total = [0.0_f32; 2];
        for offset in &offsets {
            let local: [f32; N] = each(|axis| fraction[axis] - offset[axis]);
            let least: [f32; N] = each(|axis| {
                if offset[axis] > 0.0 {
                    local[axis]
                } else if offset[axis] < 0.0 {
                    local[axis] - 1.0
                } else {
                    0.0
                }
            });
            if dot(least, least) >= 1.0 {
                continue;
            }
            let cell = each(|axis| (corner[axis] + offset[axis]).to_bits());
            let sum = cell_sum::<S, N>(simd, cell, local, &seeds, &waves);
            total = [total[0] + sum[0], total[1] + sum[1]];
        }
        node.store(total, outputs, index);
    }
}

/// Sum of the impulses of a cell, given by the bits of its float coordinates.
#[inline(always)]
fn cell_sum<S: Simd, const N: usize>(
    simd: S,
    cell: [u32; N],
    local: [f32; N],
    seeds: &[u32x8<S>; 3],
    waves: &Waves<f32, N>,
) -> [f32; 2] {
    // Loops, not closures: a call of a closure that is not inlined leaves the function that has the vector instructions.
    let mut keys = [u32x8::splat(simd, 0); N];
    for axis in 0..N {
        keys[axis] = u32x8::splat(simd, cell[axis]);
    }
    let mut d = [f32x8::splat(simd, 0.0); N];
    for axis in 0..N {
        d[axis] = f32x8::splat(simd, local[axis]) - random::<S, N>(simd, keys, seeds[1], axis);
    }
    let mut square = d[0] * d[0] + d[1] * d[1];
    if N == 3 {
        square += d[2] * d[2];
    }
    if square.simd_lt(1.0).all_false() {
        return [0.0; 2];
    }
    let squares = lanes(square);
    let mut offsets = [[0.0; IMPULSES]; N];
    for axis in 0..N {
        offsets[axis] = lanes(d[axis]);
    }
    let signs = lanes(random::<S, N>(simd, keys, seeds[2], 0));
    let scatters = waves.isotropy != 0.0;
    let mut scatter = [[0.0; IMPULSES]; 2];
    if scatters {
        for variant in 0..N - 1 {
            scatter[variant] = lanes(random::<S, N>(simd, keys, seeds[0], variant));
        }
    }
    let mut sum = [0.0_f32; 2];
    for impulse in 0..IMPULSES {
        if squares[impulse] >= 1.0 {
            continue;
        }
        let wave = if scatters { waves.scattered([scatter[0][impulse], scatter[1][impulse]]) } else { waves.common };
        let projection = dot(each(|axis| offsets[axis][impulse]), wave);
        let parts = phasor(squares[impulse], projection, signs[impulse] < 0.5);
        sum = [sum[0] + parts[0], sum[1] + parts[1]];
    }
    sum
}

/// The values of all lanes.
#[inline(always)]
fn lanes<S: Simd>(value: f32x8<S>) -> [f32; IMPULSES] {
    let mut values = [0.0; IMPULSES];
    value.store_slice(&mut values);
    values
}

/// [`super::random`] for eight seeds.
#[inline(always)]
fn random<S: Simd, const N: usize>(simd: S, cell: [u32x8<S>; N], seed: u32x8<S>, variant: usize) -> f32x8<S> {
    let bits = match (N, variant) {
        (2, 0) => jenkins(simd, [cell[0], cell[1], seed]),
        (2, _) => jenkins(simd, [seed, cell[0], cell[1]]),
        (_, 0) => jenkins(simd, [cell[0], cell[1], cell[2], seed]),
        (_, 1) => jenkins(simd, [cell[2], cell[0], seed, cell[1]]),
        _ => jenkins(simd, [seed, cell[2], cell[1], cell[0]]),
    };
    f32x8::float_from(bits) * (1.0 / 4_294_967_296.0)
}

/// Jenkins' lookup3 of three or four words; see [`crate::nodes::hash::jenkins`].
#[inline(always)]
fn jenkins<S: Simd, const N: usize>(simd: S, keys: [u32x8<S>; N]) -> u32x8<S> {
    let start = 0xDEAD_BEEF_u32.wrapping_add(4 * N as u32).wrapping_add(13);
    let [mut a, mut b, mut c] = [u32x8::splat(simd, start); 3];
    a += keys[0];
    b += keys[1];
    c += keys[2];
    if N == 4 {
        (a, c) = mix(a, b, c, 4);
        (b, a) = mix(b, c, a, 6);
        (c, b) = mix(c, a, b, 8);
        (a, c) = mix(a, b, c, 16);
        (b, a) = mix(b, c, a, 19);
        (c, b) = mix(c, a, b, 4);
        a += keys[3];
    }
    c = last(c, b, 14);
    a = last(a, c, 11);
    b = last(b, a, 25);
    c = last(c, b, 16);
    a = last(a, c, 4);
    b = last(b, a, 14);
    last(c, b, 24)
}

#[inline(always)]
fn rotate<S: Simd>(value: u32x8<S>, count: u32) -> u32x8<S> {
    (value << count) | (value >> (32 - count))
}

/// One mixing step on (x, y, z): the new x and z.
#[inline(always)]
fn mix<S: Simd>(x: u32x8<S>, y: u32x8<S>, z: u32x8<S>, count: u32) -> (u32x8<S>, u32x8<S>) {
    ((x - z) ^ rotate(z, count), z + y)
}

/// One final step: the new x.
#[inline(always)]
fn last<S: Simd>(x: u32x8<S>, y: u32x8<S>, count: u32) -> u32x8<S> {
    (x ^ y) - rotate(y, count)
}

#[cfg(test)]
mod tests {
    use crate::nodes::gabor_texture::GaborTexture;
    use crate::nodes::lane_tests::adversarial_coordinates;
    use crate::nodes::{Column, Evaluate as _};

    #[test]
    fn every_mode_equals_the_scalar_evaluation() {
        let coordinates = adversarial_coordinates(1024);
        let count = coordinates.len();
        for dimensions in [2, 3] {
            // Scale, frequency, anisotropy, orientation.
            for parameters in [
                [5.0, 2.0, 1.0, 0.785, 0.3, -0.2],
                [-2.0, -1.0, 0.4, 1.3, -0.5, 0.7],
                [0.3, 7.5, f32::NAN, 0.0, 0.0, 1.0],
                [1.0, f32::NAN, 0.0, 1.0, 1.0, 0.0],
            ] {
                let node = GaborTexture { dimensions, value: true, phase: true, intensity: true };
                let values: Vec<Vec<f32>> = (0..3)
                    .map(|axis| coordinates.iter().map(|row| row[axis]).collect())
                    .chain(parameters.iter().map(|&parameter| vec![parameter; count]))
                    .collect();
                let evaluate = |lanes: bool, uniform: bool| {
                    let columns: Vec<Column<'_, f32>> =
                        values.iter().map(|values| Column { values, uniform }).collect();
                    let mut outputs = vec![vec![0.0_f32; count]; 3];
                    let mut slices: Vec<&mut [f32]> = outputs.iter_mut().map(Vec::as_mut_slice).collect();
                    if lanes {
                        assert!(node.evaluate_fast(&columns, &mut slices));
                    } else {
                        node.evaluate(&columns, &mut slices);
                    }
                    outputs
                };
                let expected = evaluate(false, false);
                for uniform in [false, true] {
                    let found = evaluate(true, uniform);
                    for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
                        let equal = found.to_bits() == expected.to_bits() || (found.is_nan() && expected.is_nan());
                        assert!(equal, "{dimensions}D {parameters:?}: lanes {found}, scalar {expected}");
                    }
                }
            }
        }
    }
}
