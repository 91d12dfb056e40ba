//! The cells around a point in one dimension on SIMD lanes, one point per lane, operation by operation as the
//! scalar evaluation. Few cells: every one is visited, in the same order.

use crate::base::arrays::each;
use crate::nodes::lanes;
use crate::nodes::voronoi_texture::lanes::cells::Smooth;
use crate::nodes::voronoi_texture::lanes::{Found, Search};
use fearless_simd::prelude::*;

/// A coordinate taken apart.
struct Cell<S: Simd> {
    floor: S::f32s,
    local: S::f32s,
}

impl<S: Simd> Cell<S> {
    #[inline(always)]
    fn of(x: S::f32s) -> Self {
        let floor = x.floor();
        Self { floor, local: x - floor }
    }

    /// Point of the cell at `offset`, relative to this cell's corner.
    #[inline(always)]
    fn point(&self, simd: S, offset: S::f32s, randomness: f32) -> S::f32s {
        offset + hash_of_place(simd, self.floor + offset) * randomness
    }

    /// Colour of the cell at `offset`.
    #[inline(always)]
    fn color(&self, simd: S, offset: S::f32s) -> [S::f32s; 3] {
        let place = self.floor + offset;
        let numbered = |number: f32| {
            let keys = [place.bitcast(), S::u32s::splat(simd, number.to_bits())];
            lanes::hash_value::<S>(lanes::jenkins::<S, 2>(simd, keys))
        };
        [hash_of_place(simd, place), numbered(1.0), numbered(2.0)]
    }

    /// What was found in the cell at `offset`.
    #[inline(always)]
    fn found<const N: usize>(
        &self,
        simd: S,
        search: Search,
        distance: S::f32s,
        point: S::f32s,
        offset: S::f32s,
    ) -> Found<S, N> {
        let mut found = Found::of_distance(simd, distance);
        if search.color {
            found.color = self.color(simd, offset);
        }
        found.position = [point + self.floor; N];
        found
    }
}

/// The smallest distance so far, its cell's point and offset.
struct Best<S: Simd> {
    distance: S::f32s,
    point: S::f32s,
    offset: S::f32s,
}

impl<S: Simd> Best<S> {
    #[inline(always)]
    fn start(simd: S) -> Self {
        let zero = S::f32s::splat(simd, 0.0);
        Self { distance: S::f32s::splat(simd, f32::MAX), point: zero, offset: zero }
    }

    /// `self` where the mask is set, `other` elsewhere.
    #[inline(always)]
    fn select(&self, mask: S::mask32s, other: &Self) -> Self {
        Self {
            distance: mask.select(self.distance, other.distance),
            point: mask.select(self.point, other.point),
            offset: mask.select(self.offset, other.offset),
        }
    }
}

/// The cell whose point is nearest to the coordinate.
#[inline(always)]
fn nearest<S: Simd>(simd: S, cell: &Cell<S>, randomness: f32) -> Best<S> {
    let mut best = Best::start(simd);
    for offset in [-1.0, 0.0, 1.0] {
        let offset = S::f32s::splat(simd, offset);
        let point = cell.point(simd, offset, randomness);
        let distance = (point - cell.local).abs();
        best = Best { distance, point, offset }.select(distance.simd_lt(best.distance), &best);
    }
    best
}

/// F1.
#[inline(always)]
pub(super) fn f1<S: Simd, const N: usize>(simd: S, x: S::f32s, search: Search) -> Found<S, N> {
    let cell = Cell::<S>::of(x);
    let best = nearest(simd, &cell, search.randomness);
    cell.found(simd, search, best.distance, best.point, best.offset)
}

/// F2.
#[inline(always)]
pub(super) fn f2<S: Simd, const N: usize>(simd: S, x: S::f32s, search: Search) -> Found<S, N> {
    let cell = Cell::<S>::of(x);
    let (mut first, mut second) = (Best::start(simd), Best::start(simd));
    for offset in [-1.0, 0.0, 1.0] {
        let offset = S::f32s::splat(simd, offset);
        let point = cell.point(simd, offset, search.randomness);
        let distance = (point - cell.local).abs();
        let new = Best { distance, point, offset };
        let (is_first, is_second) = (distance.simd_lt(first.distance), distance.simd_lt(second.distance));
        second = first.select(is_first, &new.select(is_second, &second));
        first = new.select(is_first, &first);
    }
    cell.found(simd, search, second.distance, second.point, second.offset)
}

/// Smooth F1; the smoothness is above 0.
#[inline(always)]
pub(super) fn smooth_f1<S: Simd, const N: usize>(simd: S, x: S::f32s, search: Search) -> Found<S, N> {
    let cell = Cell::<S>::of(x);
    let mut smooth = Smooth::start(simd, search);
    for offset in [-2.0, -1.0, 0.0, 1.0, 2.0] {
        let offset = S::f32s::splat(simd, offset);
        let point = cell.point(simd, offset, search.randomness);
        smooth.add(
            simd,
            search,
            (point - cell.local).abs(),
            [point; N],
            #[inline(always)]
            || cell.color(simd, offset),
        );
    }
    let mut found = smooth.found;
    found.position = each(|axis| found.position[axis] + cell.floor);
    found
}

/// Distance to edge.
#[inline(always)]
pub(super) fn edge<S: Simd>(simd: S, x: S::f32s, search: Search) -> S::f32s {
    let cell = Cell::<S>::of(x);
    // The middle cell hashes its own floor, sign of zero included.
    let middle = hash_of_place(simd, cell.floor) * search.randomness + 0.0;
    let to = |other: S::f32s| ((middle + other) / 2.0 - cell.local).abs();
    let one = S::f32s::splat(simd, 1.0);
    let left = to(cell.point(simd, -one, search.randomness));
    let right = to(cell.point(simd, one, search.randomness));
    lanes::lesser::<S>(left, right)
}

/// Radius of the n-sphere: half the distance from the nearest point to its nearest neighbour.
#[inline(always)]
pub(super) fn n_sphere_radius<S: Simd>(simd: S, x: S::f32s, search: Search) -> S::f32s {
    let cell = Cell::<S>::of(x);
    let closest = nearest(simd, &cell, search.randomness);
    let left = cell.point(simd, closest.offset - 1.0, search.randomness);
    let right = cell.point(simd, closest.offset + 1.0, search.randomness);
    (left - closest.point).abs().min((right - closest.point).abs()) / 2.0
}

/// Hash value of a cell's place, as [`crate::nodes::hash::hash_floats`] of one value.
#[inline(always)]
fn hash_of_place<S: Simd>(simd: S, place: S::f32s) -> S::f32s {
    lanes::hash_value::<S>(lanes::jenkins::<S, 1>(simd, [place.bitcast()]))
}
