//! The cells around a point in 2 to 4 dimensions on SIMD lanes, one point per lane; the same bits as
//! the full scans.
//!
//! Three facts make it fast. First, a cell whose *box* is not nearer than what was found so far
//! cannot matter. The bound is exact in f32, without a margin: a point of the cell at offset +1 lies
//! at `1 + hash` with hash >= 0, so its offset from the coordinate is at least `1 - local`, and
//! rounding is monotone; likewise at offset -1 it is at least `local` away. The metric is monotone
//! in each magnitude and is summed in the same order, so the bound never exceeds the true value.
//! Second, the smallest distances do not depend on the order of the cells, so that the cells are
//! visited near side first: per axis and lane "near" is the neighbour on the side of the coordinate
//! within its cell, so that lanes at unrelated points agree on an order in which most of the 81
//! cells of 4D are skipped. Where it counts which of two equally distant cells wins, it is the one
//! of the smaller *rank*: its place in the order of the full scan. Third, a cell that is farther
//! than the smooth minimum by the smoothness leaves every sum of smooth F1 as it is; there the order
//! counts, and the cells are visited as in the full scan.

use crate::base::arrays::each;
use crate::nodes::lanes;
use crate::nodes::voronoi_texture::Hashing;
use crate::nodes::voronoi_texture::lanes::{Found, Measure, Metric, Search};
use crate::nodes::white_noise_texture;
use fearless_simd::prelude::*;
use std::sync::OnceLock;

/// Factor and increment of the integer hash; see [`crate::nodes::hash::pcg`].
const MULTIPLIER: i32 = 1_664_525;
const INCREMENT: i32 = 1_013_904_223;

/// Smallest smoothness with which smooth F1 skips cells: the bound is not proven where halves of it are subnormal.
const SMALLEST_CULLED_SMOOTHNESS: f32 = 1.0e-30;

/// Offsets of the cells that smooth F1 searches, per axis.
const WIDE_OFFSETS: [f32; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];

/// Per axis the number of one of the cells' kinds; axes beyond the dimensions are 0.
pub(super) type Kinds = [u8; 4];

/// Every combination of `kinds` kinds per axis, first axis fastest, for 2, 3 and 4 dimensions.
fn combinations(kinds: u32) -> [Vec<Kinds>; 3] {
    [2, 3, 4].map(|dimensions: u32| {
        let kind = |index: u32, axis: u32| if axis < dimensions { index / kinds.pow(axis) % kinds } else { 0 };
        (0..kinds.pow(dimensions)).map(|index| each(|axis| kind(index, axis as u32) as u8)).collect()
    })
}

/// Cells by kind per axis (0 own, 1 near, 2 far), likely nearest first.
pub(super) fn visiting_order<const N: usize>() -> &'static [Kinds] {
    static ORDERS: OnceLock<[Vec<Kinds>; 3]> = OnceLock::new();
    let orders = ORDERS.get_or_init(|| {
        combinations(3).map(|mut cells| {
            // Mean squared distance to the box of a kind, in twelfths: own 0, near 1, far 7.
            cells.sort_by_key(|cell| cell.iter().map(|&kind| [0, 1, 7][usize::from(kind)]).sum::<u32>());
            cells
        })
    });
    &orders[N - 2]
}

/// Cells by index into [`WIDE_OFFSETS`] per axis, in the order of the full scan.
fn wide_order<const N: usize>() -> &'static [Kinds] {
    static ORDERS: OnceLock<[Vec<Kinds>; 3]> = OnceLock::new();
    &ORDERS.get_or_init(|| combinations(5))[N - 2]
}

/// What a cell's hash starts from along one axis: the linear part of the hash of its number, or the bits of its corner.
#[inline(always)]
fn key<S: Simd>(floor: S::f32s, hashing: Hashing) -> S::i32s {
    match hashing {
        Hashing::WholeNumbers => S::i32s::truncate_from(floor) * MULTIPLIER + INCREMENT,
        // The sum is never -0.
        Hashing::Floats => (floor + 0.0).bitcast(),
    }
}

/// The key of the cell that is so many cells farther on.
#[inline(always)]
fn stepped<S: Simd>(key: S::i32s, step: S::i32s, hashing: Hashing) -> S::i32s {
    match hashing {
        Hashing::WholeNumbers => key + step * MULTIPLIER,
        Hashing::Floats => {
            let corner: S::f32s = key.bitcast();
            (corner + S::f32s::float_from(step)).bitcast()
        }
    }
}

/// Per kind of neighbour along one axis (own, near, far): the offset of the cell, its [`key`], and the least magnitude (as it enters what is compared) of an offset to its point.
#[derive(Clone, Copy)]
pub(super) struct Axis<S: Simd> {
    pub(super) offset: [S::f32s; 3],
    pub(super) keys: [S::i32s; 3],
    pub(super) least: [S::f32s; 3],
    /// The place from which distances are measured.
    pub(super) place: S::f32s,
}

impl<S: Simd> Axis<S> {
    /// The neighbours of the cell at `corner`, which holds `place`.
    #[inline(always)]
    fn around(simd: S, corner: S::f32s, key: S::i32s, place: S::f32s, search: Search) -> Self {
        let Search { measure, hashing, .. } = search;
        let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
        let (down, up) = (place - corner, (corner + one) - place);
        let upper = down.simd_ge(0.5);
        let near = upper.select(one, -one);
        let step = S::i32s::splat(simd, 1);
        let [after, before] = [stepped::<S>(key, step, hashing), stepped::<S>(key, -step, hashing)];
        Self {
            offset: [corner, corner + near, corner - near],
            keys: [key, upper.select(after, before), upper.select(before, after)],
            least: [
                zero,
                least_part(simd, measure, upper.select(up, down)),
                least_part(simd, measure, upper.select(down, up)),
            ],
            place,
        }
    }
}

/// The neighbourhood of the coordinates.
#[inline(always)]
pub(super) fn axes<S: Simd, const N: usize>(
    simd: S,
    floor: [S::f32s; N],
    x: [S::f32s; N],
    search: Search,
) -> [Axis<S>; N] {
    let zero = S::f32s::splat(simd, 0.0);
    each(
        #[inline(always)]
        |axis| Axis::around(simd, zero, key::<S>(floor[axis], search.hashing), x[axis] - floor[axis], search),
    )
}

/// Joins the parts of the axes in the kernel's association.
#[inline(always)]
pub(super) fn join<S: Simd, const N: usize>(measure: Measure, v: [S::f32s; N]) -> S::f32s {
    #[inline(always)]
    fn with<V: Copy, const N: usize>(add: impl Fn(V, V) -> V, v: [V; N]) -> V {
        match N {
            2 => add(v[0], v[1]),
            3 => add(add(v[0], v[1]), v[2]),
            _ => add(add(v[0], v[1]), add(v[2], v[3])),
        }
    }
    if measure.metric == Metric::Chebychev { with(|a: S::f32s, b| a.max(b), v) } else { with(|a, b| a + b, v) }
}

/// Powers of the C library, lane by lane.
#[inline(never)]
fn power(values: &mut [f32], exponent: f32) {
    values.iter_mut().for_each(|value| *value = value.powf(exponent));
}

#[inline(always)]
fn powered<S: Simd>(simd: S, value: S::f32s, exponent: f32) -> S::f32s {
    let mut values = [0.0; lanes::MOST];
    let values = &mut values[..S::f32s::LEN];
    value.store_slice(values);
    power(values, exponent);
    S::f32s::from_slice(simd, values)
}

/// What one axis gives to what is compared.
#[inline(always)]
fn part<S: Simd>(simd: S, measure: Measure, offset: S::f32s) -> S::f32s {
    match measure.metric {
        Metric::Euclidean => offset * offset,
        Metric::Minkowski => powered(simd, offset.abs(), measure.exponent),
        _ => offset.abs(),
    }
}

/// A bound on [`part`] for all offsets of at least this magnitude. Powers of the C library are accurate to a unit in the last
/// place, but need not be monotone: the margins cover that, and powers that underflow.
#[inline(always)]
fn least_part<S: Simd>(simd: S, measure: Measure, magnitude: S::f32s) -> S::f32s {
    let part = part(simd, measure, magnitude);
    if measure.metric == Metric::Minkowski { part * (1.0 - 1.0 / 1_048_576.0) - 1.0e-37 } else { part }
}

/// What orders offsets as the distance does: without the root.
#[inline(always)]
pub(super) fn compared<S: Simd, const N: usize>(simd: S, measure: Measure, v: [S::f32s; N]) -> S::f32s {
    join::<S, N>(measure, each(|axis| part(simd, measure, v[axis])))
}

/// The distance that belongs to what was compared.
#[inline(always)]
pub(super) fn distance_of<S: Simd>(simd: S, measure: Measure, compared: S::f32s) -> S::f32s {
    match measure.metric {
        Metric::Euclidean => compared.sqrt(),
        Metric::Minkowski => powered(simd, compared, 1.0 / measure.exponent),
        _ => compared,
    }
}

/// A limit on what is compared: whatever exceeds it belongs to a distance above `distance`. The margins cover
/// the rounding of powers and roots, and powers that underflow.
#[inline(always)]
fn limit<S: Simd>(simd: S, measure: Measure, distance: S::f32s) -> S::f32s {
    match measure.metric {
        Metric::Euclidean => (distance * distance) * (1.0 + 1.0 / 1_048_576.0) + 1.0e-37,
        Metric::Minkowski => {
            // A unit in the last place of the root is that many of the power.
            let margin = (measure.exponent + 4.0) / 1_048_576.0;
            powered(simd, distance + 1.0e-37, measure.exponent) * (1.0 + margin) + 1.0e-37
        }
        _ => distance,
    }
}

/// Least value of what is compared for any point of a cell.
#[inline(always)]
pub(super) fn least<S: Simd, const N: usize>(axes: &[Axis<S>; N], measure: Measure, cell: &Kinds) -> S::f32s {
    join::<S, N>(measure, each(|axis| axes[axis].least[usize::from(cell[axis])]))
}

/// Offset from the place to the point of a cell.
#[inline(always)]
pub(super) fn offset_to<S: Simd, const N: usize>(
    simd: S,
    axes: &[Axis<S>; N],
    search: Search,
    cell: &Kinds,
) -> [S::f32s; N] {
    let kind = |axis: usize| usize::from(cell[axis]);
    let values = hash_values::<S, N>(simd, each(|axis| axes[axis].keys[kind(axis)]), search.hashing);
    each(|axis| (axes[axis].offset[kind(axis)] + values[axis] * search.randomness) - axes[axis].place)
}

/// Rank of each neighbour by kind, two bits per axis, first axis lowest.
#[inline(always)]
fn ranks<S: Simd, const N: usize>(axes: &[Axis<S>; N]) -> [[S::i32s; 3]; N] {
    each(
        #[inline(always)]
        |axis| each(|kind| (S::i32s::truncate_from(axes[axis].offset[kind]) + 1) << (2 * axis as u32)),
    )
}

#[inline(always)]
fn rank_of<S: Simd, const N: usize>(ranks: &[[S::i32s; 3]; N], cell: &Kinds) -> S::i32s {
    (1..N).fold(ranks[0][usize::from(cell[0])], |rank, axis| rank + ranks[axis][usize::from(cell[axis])])
}

/// A cell that a search has found.
struct Winner<S: Simd, const N: usize> {
    offset: [S::f32s; N],
    keys: [S::i32s; N],
    values: [S::f32s; N],
    /// Its point, relative to the corner of the coordinate's cell.
    point: [S::f32s; N],
}

impl<S: Simd, const N: usize> Winner<S, N> {
    /// The cell of a rank among the neighbours of the coordinate's cell.
    #[inline(always)]
    fn of(simd: S, axes: &[Axis<S>; N], rank: S::i32s, search: Search) -> Self {
        let steps: [S::i32s; N] = each(|axis| ((rank >> (2 * axis as u32)) & 3) - 1);
        let offset: [S::f32s; N] = each(|axis| S::f32s::float_from(steps[axis]));
        let keys: [S::i32s; N] = each(|axis| stepped::<S>(axes[axis].keys[0], steps[axis], search.hashing));
        let values = hash_values::<S, N>(simd, keys, search.hashing);
        let point = each(|axis| offset[axis] + values[axis] * search.randomness);
        Self { offset, keys, values, point }
    }

    #[inline(always)]
    fn found(&self, simd: S, search: Search, distance: S::f32s, floor: [S::f32s; N]) -> Found<S, N> {
        let no_color = [S::f32s::splat(simd, 0.0); 3];
        Found {
            distance,
            color: if search.color { color::<S, N>(simd, self.keys, self.values, search.hashing) } else { no_color },
            position: each(|axis| self.point[axis] + floor[axis]),
        }
    }
}

/// Colour of a cell from its keys and its hash values.
#[inline(always)]
fn color<S: Simd, const N: usize>(simd: S, keys: [S::i32s; N], values: [S::f32s; N], hashing: Hashing) -> [S::f32s; 3] {
    match (hashing, N) {
        (Hashing::Floats, 2 | 4) => {
            white_noise_texture::color_on_lanes::<S, N>(simd, each(|axis| keys[axis].bitcast()))
        }
        (Hashing::WholeNumbers, 2) => whole_number_values::<S, 3>([keys[0], keys[1], S::i32s::splat(simd, INCREMENT)]),
        _ => each(|channel| values[channel.min(N - 1)]),
    }
}

/// Smallest value of what is compared among the cells.
#[inline(always)]
fn smallest<S: Simd, const N: usize>(simd: S, axes: &[Axis<S>; N], search: Search, cells: &[Kinds]) -> S::f32s {
    // A function of its own, compiled once for the features that need it.
    simd.vectorize(
        #[inline(always)]
        || {
            let mut best = S::f32s::splat(simd, f32::MAX);
            for cell in cells {
                if least(axes, search.measure, cell).simd_lt(best).all_false() {
                    continue;
                }
                best = best.min(compared::<S, N>(simd, search.measure, offset_to(simd, axes, search, cell)));
            }
            best
        },
    )
}

/// Smallest value of what is compared, and the rank of the first cell in the order of the full scan that has it.
#[inline(always)]
fn nearest<S: Simd, const N: usize>(simd: S, axes: &[Axis<S>; N], search: Search) -> (S::f32s, S::i32s) {
    // As in `smallest`.
    simd.vectorize(
        #[inline(always)]
        || {
            let ranks = ranks(axes);
            let (mut best, mut best_rank) = (S::f32s::splat(simd, f32::MAX), S::i32s::splat(simd, 0));
            for cell in visiting_order::<N>() {
                if least(axes, search.measure, cell).simd_le(best).all_false() {
                    continue;
                }
                let value = compared::<S, N>(simd, search.measure, offset_to(simd, axes, search, cell));
                let rank = rank_of::<S, N>(&ranks, cell);
                let wins = precedes::<S>(value, rank, best, best_rank);
                best = wins.select(value, best);
                best_rank = wins.select(rank, best_rank);
            }
            (best, best_rank)
        },
    )
}

/// Whether a cell comes before another by its value, and by the order of the full scan among equals.
#[inline(always)]
fn precedes<S: Simd>(value: S::f32s, rank: S::i32s, other: S::f32s, other_rank: S::i32s) -> S::mask32s {
    value.simd_lt(other) | (value.simd_eq(other) & rank.simd_lt(other_rank))
}

/// F1.
#[inline(always)]
pub(super) fn f1<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], search: Search) -> Found<S, N> {
    let floor: [S::f32s; N] = each(|axis| x[axis].floor());
    let axes = axes(simd, floor, x, search);
    if search.color || search.position {
        let (compared, rank) = nearest(simd, &axes, search);
        let distance = distance_of::<S>(simd, search.measure, compared);
        return Winner::of(simd, &axes, rank, search).found(simd, search, distance, floor);
    }
    let compared = smallest(simd, &axes, search, visiting_order::<N>());
    Found::of_distance(simd, distance_of::<S>(simd, search.measure, compared))
}

/// F2.
#[inline(always)]
pub(super) fn f2<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], search: Search) -> Found<S, N> {
    let floor: [S::f32s; N] = each(|axis| x[axis].floor());
    let axes = axes(simd, floor, x, search);
    // The full scan compares roots; powers of the C library need not keep the order.
    if search.color || search.position || search.measure.metric == Metric::Minkowski {
        let (distance, rank) = second_nearest(simd, &axes, search);
        return Winner::of(simd, &axes, rank, search).found(simd, search, distance, floor);
    }
    Found::of_distance(simd, distance_of::<S>(simd, search.measure, second_smallest(simd, &axes, search)))
}

/// Second smallest value of what is compared. It belongs to the second smallest distance: a root keeps the order.
#[inline(always)]
fn second_smallest<S: Simd, const N: usize>(simd: S, axes: &[Axis<S>; N], search: Search) -> S::f32s {
    let [mut first, mut second] = [S::f32s::splat(simd, f32::MAX); 2];
    for cell in visiting_order::<N>() {
        if least(axes, search.measure, cell).simd_lt(second).all_false() {
            continue;
        }
        let value = compared::<S, N>(simd, search.measure, offset_to(simd, axes, search, cell));
        second = second.min(first.max(value));
        first = first.min(value);
    }
    second
}

/// Second smallest distance and the rank of its cell. Distances that are equal only by the rounding of
/// the root are equal here: the full scan compares roots.
#[inline(always)]
fn second_nearest<S: Simd, const N: usize>(simd: S, axes: &[Axis<S>; N], search: Search) -> (S::f32s, S::i32s) {
    let ranks = ranks(axes);
    let [mut first, mut second] = [S::f32s::splat(simd, f32::MAX); 2];
    let [mut first_rank, mut second_rank] = [S::i32s::splat(simd, 0); 2];
    let mut reach = limit::<S>(simd, search.measure, second);
    for cell in visiting_order::<N>() {
        if least(axes, search.measure, cell).simd_le(reach).all_false() {
            continue;
        }
        let value = compared::<S, N>(simd, search.measure, offset_to(simd, axes, search, cell));
        let distance = distance_of::<S>(simd, search.measure, value);
        let rank = rank_of::<S, N>(&ranks, cell);
        let is_first = precedes::<S>(distance, rank, first, first_rank);
        let is_second = precedes::<S>(distance, rank, second, second_rank);
        second = is_first.select(first, is_second.select(distance, second));
        second_rank = is_first.select(first_rank, is_second.select(rank, second_rank));
        first = is_first.select(distance, first);
        first_rank = is_first.select(rank, first_rank);
        reach = limit::<S>(simd, search.measure, second);
    }
    (second, second_rank)
}

/// Per offset along one axis: the cell's [`key`], and the least magnitude (as it
/// enters what is compared) of an offset to its point.
#[derive(Clone, Copy)]
struct WideAxis<S: Simd> {
    keys: [S::i32s; 5],
    least: [S::f32s; 5],
    local: S::f32s,
}

impl<S: Simd> WideAxis<S> {
    #[inline(always)]
    fn around(simd: S, floor: S::f32s, x: S::f32s, search: Search) -> Self {
        let Search { measure, hashing, .. } = search;
        let local = x - floor;
        let (one, two) = (S::f32s::splat(simd, 1.0), S::f32s::splat(simd, 2.0));
        let own = key::<S>(floor, hashing);
        let least = [local + one, local, S::f32s::splat(simd, 0.0), one - local, two - local];
        Self {
            keys: each(|kind| stepped::<S>(own, S::i32s::splat(simd, WIDE_OFFSETS[kind] as i32), hashing)),
            least: each(|kind| least_part(simd, measure, least[kind])),
            local,
        }
    }
}

/// Smooth F1; the smoothness is above 0.
#[inline(always)]
pub(super) fn smooth_f1<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], search: Search) -> Found<S, N> {
    let floor: [S::f32s; N] = each(|axis| x[axis].floor());
    let axes: [WideAxis<S>; N] = each(
        #[inline(always)]
        |axis| WideAxis::around(simd, floor[axis], x[axis], search),
    );
    let mut smooth = Smooth::start(simd, search);
    for cell in wide_order::<N>() {
        let kind = |axis: usize| usize::from(cell[axis]);
        let least = join::<S, N>(search.measure, each(|axis| axes[axis].least[kind(axis)]));
        if least.simd_le(smooth.reach).all_false() {
            continue;
        }
        let keys: [S::i32s; N] = each(|axis| axes[axis].keys[kind(axis)]);
        let values = hash_values::<S, N>(simd, keys, search.hashing);
        let point: [S::f32s; N] = each(|axis| values[axis] * search.randomness + WIDE_OFFSETS[kind(axis)]);
        let v = each(|axis| point[axis] - axes[axis].local);
        let distance = distance_of::<S>(simd, search.measure, compared::<S, N>(simd, search.measure, v));
        smooth.add(
            simd,
            search,
            distance,
            point,
            #[inline(always)]
            || color::<S, N>(simd, keys, values, search.hashing),
        );
    }
    let mut found = smooth.found;
    for axis in 0..N {
        found.position[axis] += floor[axis];
    }
    found
}

/// The sums of smooth F1.
pub(super) struct Smooth<S: Simd, const N: usize> {
    pub(super) found: Found<S, N>,
    /// Whether no cell has been added.
    empty: bool,
    /// What is compared is above this for cells that change nothing.
    reach: S::f32s,
}

impl<S: Simd, const N: usize> Smooth<S, N> {
    #[inline(always)]
    pub(super) fn start(simd: S, search: Search) -> Self {
        let zero = S::f32s::splat(simd, 0.0);
        // The first cell replaces the start values whatever they are.
        let reach = limit::<S>(simd, search.measure, S::f32s::splat(simd, f32::MAX));
        Self { found: Found::of_distance(simd, zero), empty: true, reach }
    }

    /// Adds a cell. A weight of 0 leaves every sum as it is: nothing is added to a sum, and no sum is ever -0.
    #[inline(always)]
    pub(super) fn add(
        &mut self,
        simd: S,
        search: Search,
        distance: S::f32s,
        point: [S::f32s; N],
        color: impl FnOnce() -> [S::f32s; 3],
    ) {
        let (zero, one) = (S::f32s::splat(simd, 0.0), S::f32s::splat(simd, 1.0));
        let sum = &mut self.found;
        let place = ((sum.distance - distance) * 0.5) / search.smoothness + 0.5;
        // The cubic step is exactly 0 and 1 at the ends.
        let t = if self.empty { one } else { place.max(zero).min(one) };
        self.empty = false;
        if t.simd_gt(zero).all_false() {
            return;
        }
        let h = (S::f32s::splat(simd, 3.0) - t * 2.0) * (t * t);
        let correction = (h * search.smoothness) * (one - h);
        sum.distance = (sum.distance + h * (distance - sum.distance)) - correction;
        if search.smoothness >= SMALLEST_CULLED_SMOOTHNESS {
            self.reach = limit::<S>(simd, search.measure, (sum.distance + search.smoothness).max(zero));
        }
        if search.color || search.position {
            let correction = correction / (1.0 + 3.0 * search.smoothness);
            let join = |sum: S::f32s, value: S::f32s| (sum + h * (value - sum)) - correction;
            if search.color {
                let color = color();
                sum.color = each(|channel| join(sum.color[channel], color[channel]));
            }
            if search.position {
                sum.position = each(|axis| join(sum.position[axis], point[axis]));
            }
        }
    }
}

/// Distance to edge. Where it is zero, its sign may differ from the scalar evaluation's.
#[inline(always)]
pub(super) fn edge<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], search: Search) -> S::f32s {
    let search = Search { measure: Measure::EUCLIDEAN, ..search };
    let axes = axes(simd, each(|axis| x[axis].floor()), x, search);
    let (square, rank) = nearest(simd, &axes, search);
    let point = Winner::of(simd, &axes, rank, search).point;
    let nearest: [S::f32s; N] = each(|axis| point[axis] - axes[axis].place);
    let one = S::f32s::splat(simd, 1.0);
    let mut edge = S::f32s::splat(simd, f32::MAX);
    let mut reach = limit::<S>(simd, search.measure, edge);
    let radius = square.sqrt() + 1.0e-4;
    for cell in visiting_order::<N>() {
        if least(&axes, search.measure, cell).simd_le(reach).all_false() {
            continue;
        }
        let v = offset_to(simd, &axes, search, cell);
        let across: [S::f32s; N] = each(|axis| v[axis] - nearest[axis]);
        let square = compared::<S, N>(simd, search.measure, across);
        let norm = square.sqrt();
        let inverse = one / norm;
        let direction: [S::f32s; N] = each(|axis| if N == 3 { across[axis] / norm } else { across[axis] * inverse });
        let products = each(|axis| ((nearest[axis] + v[axis]) * 0.5) * direction[axis]);
        let distance = join::<S, N>(search.measure, products);
        // A point that is (nearly) the nearest itself has no edge to it.
        let smaller = square.simd_gt(0.0001) & distance.simd_lt(edge);
        edge = smaller.select(distance, edge);
        // The edge to a point is at least half as far as the point is farther than the nearest one. Offsets are below
        // 4 and directions accurate to a few units in the last place, so that the margin covers every rounding.
        let farthest = radius + edge * 2.0;
        reach = farthest * farthest;
    }
    edge
}

/// Radius of the n-sphere: half the distance from the nearest point to its nearest neighbour.
#[inline(always)]
pub(super) fn n_sphere_radius<S: Simd, const N: usize>(simd: S, x: [S::f32s; N], search: Search) -> S::f32s {
    let search = Search { measure: Measure::EUCLIDEAN, ..search };
    let around_place = axes(simd, each(|axis| x[axis].floor()), x, search);
    let (_, rank) = nearest(simd, &around_place, search);
    let closest = Winner::of(simd, &around_place, rank, search);
    let around_closest: [Axis<S>; N] = each(
        #[inline(always)]
        |axis| Axis::around(simd, closest.offset[axis], closest.keys[axis], closest.point[axis], search),
    );
    // The first cell is the one that holds the point itself.
    smallest(simd, &around_closest, search, &visiting_order::<N>()[1..]).sqrt() / 2.0
}

/// Values in [0, 1] of a cell's hash.
#[inline(always)]
fn hash_values<S: Simd, const N: usize>(simd: S, keys: [S::i32s; N], hashing: Hashing) -> [S::f32s; N] {
    match hashing {
        Hashing::WholeNumbers => whole_number_values::<S, N>(keys),
        Hashing::Floats => float_values::<S, N>(simd, keys),
    }
}

/// The point of a cell from the bits of its corner, as the scalar evaluation's `cell_of_floats`.
#[inline(always)]
fn float_values<S: Simd, const N: usize>(simd: S, keys: [S::i32s; N]) -> [S::f32s; N] {
    let keys: [S::u32s; N] = each(|axis| keys[axis].bitcast());
    if N == 4 {
        return each(
            #[inline(always)]
            |turn| lanes::hash_value::<S>(lanes::jenkins::<S, 4>(simd, each(|axis| keys[(axis + 4 - turn) % 4]))),
        );
    }
    let color = white_noise_texture::color_on_lanes::<S, N>(simd, keys);
    each(|axis| color[axis])
}

/// Values of the hash with the given linear part. The product with 2^-31 is exact.
#[inline(always)]
fn whole_number_values<S: Simd, const N: usize>(linear: [S::i32s; N]) -> [S::f32s; N] {
    let [bits] = hashes::<S, N, 1>([linear]);
    each(|axis| S::f32s::float_from(bits[axis]) * (1.0 / 2_147_483_648.0))
}

/// The rounds of [`crate::nodes::hash::pcg`] after its linear part, for several cells step by step in turn: each step waits for the
/// one before it, and a processor looks only so far ahead for other work.
#[inline(always)]
pub(super) fn hashes<S: Simd, const N: usize, const CELLS: usize>(
    mut v: [[S::i32s; N]; CELLS],
) -> [[S::i32s; N]; CELLS] {
    rounds::<S, N, CELLS>(&mut v);
    for of_cell in &mut v {
        *of_cell = each(|axis| of_cell[axis] ^ (of_cell[axis] >> 16));
    }
    rounds::<S, N, CELLS>(&mut v);
    for of_cell in &mut v {
        *of_cell = each(|axis| of_cell[axis] & 0x7FFF_FFFF);
    }
    v
}

#[inline(always)]
fn rounds<S: Simd, const N: usize, const CELLS: usize>(v: &mut [[S::i32s; N]; CELLS]) {
    match N {
        2 => {
            for [to, from] in [[0, 1], [1, 0]] {
                for of_cell in v.iter_mut() {
                    of_cell[to] += of_cell[from] * MULTIPLIER;
                }
            }
        }
        3 => multiplied::<S, N, CELLS, 3>(v, [[0, 1, 2], [1, 2, 0], [2, 0, 1]]),
        _ => multiplied::<S, N, CELLS, 4>(v, [[0, 1, 3], [1, 2, 0], [2, 0, 1], [3, 1, 2]]),
    }
}

/// To the first of each three the product of the others is added.
#[inline(always)]
fn multiplied<S: Simd, const N: usize, const CELLS: usize, const STEPS: usize>(
    v: &mut [[S::i32s; N]; CELLS],
    steps: [[usize; 3]; STEPS],
) {
    for [to, first, second] in steps {
        for of_cell in v.iter_mut() {
            of_cell[to] += of_cell[first] * of_cell[second];
        }
    }
}
