//! Distances to the nearest point (F1 without colour and position) in 3 and 4 dimensions, for many places at once; the
//! same bits as the full scan.
//!
//! Lanes at unrelated places agree on few cells: the 16 lanes of a vector visit 40 of the 81 cells of 4D together, each
//! of them needs 18. Therefore the search has three parts. All lanes visit the own and near cells of every axis, which
//! are nearly always needed (14 of 16). What is still needed of the cells that are far along one axis, and then of those
//! that are far along several, is done for the places that need it, packed densely into vectors of their own. A cell is
//! left out for the reason that [`super::cells`] gives, place by place.

use crate::base::arrays::each;
use crate::nodes::Column;
use crate::nodes::lanes;
use crate::nodes::voronoi_texture::lanes::cells::{Axis, Kinds, axes, compared, distance_of, hashes, least, offset_to};
use crate::nodes::voronoi_texture::lanes::{Measure, Octave, Plan, Search, blended, cells};
use crate::nodes::voronoi_texture::{Hashing, Metric};
use fearless_simd::prelude::*;

/// Places that are searched together. A power of two, and a multiple of every vector's width.
const BATCH: usize = 512;

/// What is known of a batch in one octave.
struct Places<const N: usize> {
    coordinates: [[f32; BATCH]; N],
    /// Per axis the least value of what is compared for cells on the far side.
    far: [[f32; BATCH]; N],
    /// The smallest value of what is compared so far.
    best: [f32; BATCH],
}

/// Sums the octaves at all places.
#[inline(always)]
pub(super) fn run<S: Simd, const N: usize>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    outputs: &mut [&mut [f32]],
) {
    let search = plan.search;
    let is_plain = search.measure.metric == Metric::Euclidean && search.randomness == 1.0;
    if is_plain && search.hashing == Hashing::WholeNumbers {
        run_as::<S, N, true>(simd, plan, inputs, outputs[0]);
    } else {
        run_as::<S, N, false>(simd, plan, inputs, outputs[0]);
    }
}

/// `PLAIN`: Euclidean distances with a randomness of 1, cells hashed as whole numbers.
#[inline(always)]
fn run_as<S: Simd, const N: usize, const PLAIN: bool>(
    simd: S,
    plan: &Plan,
    inputs: &[Column<'_, f32>],
    output: &mut [f32],
) {
    let mut places = Places { coordinates: [[0.0; BATCH]; N], far: [[0.0; BATCH]; N], best: [0.0; BATCH] };
    for (batch, sums) in output.chunks_mut(BATCH).enumerate() {
        let columns: [&[f32]; N] = each(
            #[inline(always)]
            |axis| &inputs[axis].values[batch * BATCH..][..sums.len()],
        );
        sums.fill(0.0);
        for octave in &plan.octaves {
            search_near::<S, N, PLAIN>(simd, plan, &columns, octave, &mut places);
            search_far::<S, N, PLAIN>(simd, plan.search, sums.len(), &mut places);
            for start in (0..sums.len()).step_by(S::f32s::LEN) {
                let group = &mut sums[start..];
                let used = group.len().min(S::f32s::LEN);
                let best = S::f32s::from_slice(simd, &places.best[start..start + S::f32s::LEN]);
                let found = distance_of::<S>(simd, plan.search.measure, best);
                let sum = lanes::load::<S>(simd, &group[..used]);
                let next = if plan.single { found } else { blended::<S>(sum, sum + found * octave.amplitude, octave) };
                lanes::store::<S>(next, &mut group[..used]);
            }
        }
        if let Some(divisor) = plan.distance_divisor {
            sums.iter_mut().for_each(|sum| *sum /= divisor);
        }
    }
}

/// Searches the own and near cells of all places.
#[inline(always)]
fn search_near<S: Simd, const N: usize, const PLAIN: bool>(
    simd: S,
    plan: &Plan,
    columns: &[&[f32]; N],
    octave: &Octave,
    places: &mut Places<N>,
) {
    // A function of its own, compiled with the instructions of the lanes.
    simd.vectorize(
        #[inline(always)]
        || {
            let (width, count) = (S::f32s::LEN, columns[0].len());
            for start in (0..count).step_by(width) {
                let used = width.min(count - start);
                let x: [S::f32s; N] = each(
                    #[inline(always)]
                    |axis| lanes::load::<S>(simd, &columns[axis][start..start + used]) * plan.scale * octave.scale,
                );
                let axes = around(simd, x, known::<PLAIN>(plan.search));
                let best = S::f32s::splat(simd, f32::MAX);
                search_block::<S, N, PLAIN, N>(simd, &axes, plan.search, best)
                    .store_slice(&mut places.best[start..start + width]);
                for axis in 0..N {
                    x[axis].store_slice(&mut places.coordinates[axis][start..start + width]);
                    axes[axis].least[2].store_slice(&mut places.far[axis][start..start + width]);
                }
            }
        },
    );
}

/// The search, with a kind of hash and a metric that the compiler sees where they are known.
#[inline(always)]
fn known<const PLAIN: bool>(search: Search) -> Search {
    if PLAIN {
        Search { hashing: Hashing::WholeNumbers, measure: Measure::EUCLIDEAN, randomness: 1.0, ..search }
    } else {
        search
    }
}

#[inline(always)]
fn around<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], search: Search) -> [Axis<S>; N] {
    axes(
        simd,
        each(
            #[inline(always)]
            |axis| x[axis].floor(),
        ),
        x,
        search,
    )
}

/// Searches the other cells, where they may matter.
#[inline(always)]
fn search_far<S: Simd, const N: usize, const PLAIN: bool>(
    simd: S,
    search: Search,
    count: usize,
    places: &mut Places<N>,
) {
    search_far_along::<S, N, PLAIN, 0>(simd, search, count, places);
    search_far_along::<S, N, PLAIN, 1>(simd, search, count, places);
    search_far_along::<S, N, PLAIN, 2>(simd, search, count, places);
    if N == 4 {
        search_far_along::<S, N, PLAIN, 3>(simd, search, count, places);
    }
    search_where::<S, N, PLAIN>(
        simd,
        count,
        search,
        places,
        #[inline(always)]
        |far, best| {
            // Of the cells that are far along several axes, one that is far along two has the least bound.
            let mut needed = S::mask32s::splat(simd, false);
            for first in 0..N {
                for second in 0..first {
                    let part = |axis: usize| {
                        if axis == first || axis == second { far[axis] } else { S::f32s::splat(simd, 0.0) }
                    };
                    needed |= cells::join::<S, N>(known::<PLAIN>(search).measure, each(part)).simd_lt(best);
                }
            }
            needed
        },
        #[inline(always)]
        |axes, best| search_corners::<S, N>(simd, axes, known::<PLAIN>(search), best),
    );
}

/// Searches the cells that are far along one axis, where they may matter.
#[inline(always)]
fn search_far_along<S: Simd, const N: usize, const PLAIN: bool, const AXIS: usize>(
    simd: S,
    search: Search,
    count: usize,
    places: &mut Places<N>,
) {
    search_where::<S, N, PLAIN>(
        simd,
        count,
        search,
        places,
        #[inline(always)]
        |far, best| far[AXIS].simd_lt(best),
        #[inline(always)]
        |axes, best| search_block::<S, N, PLAIN, AXIS>(simd, axes, search, best),
    );
}

/// The places of the set bits of each byte, from the lowest; 0 behind them.
static SET_BITS: [[u16; 8]; 256] = {
    let mut places = [[0; 8]; 256];
    let mut byte = 0;
    while byte < 256 {
        let (mut bit, mut found) = (0, 0);
        while bit < 8 {
            if byte >> bit & 1 == 1 {
                places[byte][found] = bit;
                found += 1;
            }
            bit += 1;
        }
        byte += 1;
    }
    places
};

/// Searches cells with `visit` for the places that `is_needed` asks for.
#[inline(always)]
fn search_where<S: Simd, const N: usize, const PLAIN: bool>(
    simd: S,
    count: usize,
    search: Search,
    places: &mut Places<N>,
    is_needed: impl Fn(&[S::f32s; N], S::f32s) -> S::mask32s,
    visit: impl Fn(&[Axis<S>; N], S::f32s) -> S::f32s,
) {
    simd.vectorize(
        #[inline(always)]
        || {
            let width = S::f32s::LEN;
            // With room for the vector that the last ones fill in part.
            let mut needing = [0_u16; BATCH + lanes::MOST];
            let mut number = 0;
            for start in (0..count).step_by(width) {
                let far: [S::f32s; N] = each(
                    #[inline(always)]
                    |axis| S::f32s::from_slice(simd, &places.far[axis][start..start + width]),
                );
                let best = S::f32s::from_slice(simd, &places.best[start..start + width]);
                let mut needed = is_needed(&far, best).to_bitmask();
                if count - start < width {
                    needed &= (1 << (count - start)) - 1;
                }
                // Without a branch, which would be a guess: eight places are put down, those that count come first.
                for first in (0..width).step_by(8) {
                    let bits = (needed >> first & 0xFF) as usize;
                    let places = &mut needing[number..number + 8];
                    for lane in 0..8 {
                        places[lane] = (start + first) as u16 + SET_BITS[bits][lane];
                    }
                    number += bits.count_ones() as usize;
                }
            }
            // The lanes that are left repeat a place.
            let whole = number.next_multiple_of(width);
            let repeated = needing[whole.saturating_sub(width)];
            needing[number..whole].fill(repeated);
            for group in needing[..whole].chunks_exact(width) {
                let mut gathered = [0.0; lanes::MOST];
                let mut gather = |from: &[f32; BATCH]| {
                    for lane in 0..width {
                        gathered[lane] = from[usize::from(group[lane]) % BATCH];
                    }
                    S::f32s::from_slice(simd, &gathered[..width])
                };
                let mut x = [S::f32s::splat(simd, 0.0); N];
                for axis in 0..N {
                    x[axis] = gather(&places.coordinates[axis]);
                }
                let best = gather(&places.best);
                visit(&around(simd, x, known::<PLAIN>(search)), best).store_slice(&mut gathered[..width]);
                for (&place, &best) in group.iter().zip(&gathered) {
                    places.best[usize::from(place) % BATCH] = best;
                }
            }
        },
    );
}

/// The smaller of `best` and the values of the cells that are far along the axis `FAR`, own and near along the others;
/// without such an axis (`FAR == N`) those of all own and near cells.
#[inline(always)]
fn search_block<S: Simd, const N: usize, const PLAIN: bool, const FAR: usize>(
    simd: S,
    axes: &[Axis<S>; N],
    search: Search,
    mut best: S::f32s,
) -> S::f32s {
    // Written out: cells that share parts of the hash share its first products. Kinds of the last axis vary slowest; cells go in twos
    // along an axis on which the block has both.
    let (other, along) = if FAR == 2 { (2, 0) } else { (0, 2) };
    kinds::<FAR>(
        if N == 4 { 3 } else { usize::MAX },
        #[inline(always)]
        |w| {
            kinds::<FAR>(
                1,
                #[inline(always)]
                |y| {
                    kinds::<FAR>(
                        other,
                        #[inline(always)]
                        |kind| {
                            let mut cells = [[0, y, 0, w]; 2];
                            for (number, cell) in cells.iter_mut().enumerate() {
                                (cell[other], cell[along]) = (kind, number as u8);
                            }
                            let [first, second] = values::<S, N, PLAIN>(simd, axes, search, cells);
                            best = best.min(first).min(second);
                        },
                    );
                },
            );
        },
    );
    best
}

/// Calls `each` with the kinds of an axis that a block has.
#[inline(always)]
fn kinds<const FAR: usize>(axis: usize, mut each: impl FnMut(u8)) {
    if axis == FAR {
        each(2);
    } else {
        each(0);
        if axis != usize::MAX {
            each(1);
        }
    }
}

/// What is compared for the points of two cells.
#[inline(always)]
fn values<S: Simd, const N: usize, const PLAIN: bool>(
    simd: S,
    axes: &[Axis<S>; N],
    search: Search,
    cells: [Kinds; 2],
) -> [S::f32s; 2] {
    if !PLAIN {
        return each(
            #[inline(always)]
            |number| compared::<S, N>(simd, search.measure, offset_to(simd, axes, search, &cells[number])),
        );
    }
    let kind = |number: usize, axis: usize| usize::from(cells[number][axis]);
    let bits = hashes::<S, N, 2>(each(
        #[inline(always)]
        |number| {
            each(
                #[inline(always)]
                |axis| axes[axis].keys[kind(number, axis)],
            )
        },
    ));
    let mut squares = [[S::f32s::splat(simd, 0.0); N]; 2];
    for axis in 0..N {
        for number in 0..2 {
            // The product with 2^-31 is exact, so that fusing it with the sum changes no bit.
            let offset = axes[axis].offset[kind(number, axis)];
            let point = S::f32s::float_from(bits[number][axis]).mul_add(1.0 / 2_147_483_648.0, offset);
            let apart = point - axes[axis].place;
            squares[number][axis] = apart * apart;
        }
    }
    each(
        #[inline(always)]
        |number| cells::join::<S, N>(Measure::EUCLIDEAN, squares[number]),
    )
}

/// The smaller of `best` and the values of the cells that are far along several axes.
#[inline(always)]
fn search_corners<S: Simd, const N: usize>(simd: S, axes: &[Axis<S>; N], search: Search, mut best: S::f32s) -> S::f32s {
    for cell in cells::visiting_order::<N>() {
        let is_corner = cell.iter().filter(|&&kind| kind == 2).count() > 1;
        if is_corner && least(axes, search.measure, cell).simd_lt(best).any_true() {
            best = best.min(compared::<S, N>(simd, search.measure, offset_to(simd, axes, search, cell)));
        }
    }
    best
}
