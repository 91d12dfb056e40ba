//! Bounds of the Voronoi texture.
//!
//! For a box of coordinates each cell's point has a least and a greatest distance to the box. The
//! scan sees the cells of a window around the coordinate, so over the box:
//!
//! * lower end of F1: the least of the least distances, over the cells that are in the window of
//!   *some* coordinate of the box;
//! * upper end: the least of the greatest distances, over the cells that are in the window of
//!   *every* coordinate. A point nearer than the window's radius is always in the window (its cell
//!   is at most that many steps away), so cells with a greatest distance below the radius count too.
//!   That is why min(F1, 1) is continuous although F1 itself may jump where it exceeds 1.
//!
//! So a cell is looked at if its box may hold a point whose least distance is below the least known, or whose greatest distance is below
//! the least known of those: the greatest distance of any point is at least half of the box's extent along every axis, and rises with
//! the cell's distance from the box's middle.
//!
//! F2 takes the second least of each. Where a coordinate may be NaN, infinite or so large that its
//! fraction is coarse, and for metrics whose powers overflow, only the feature's range is stated.
//!
//! Everything here is in f64 on the exact hashes; [`ERROR`] covers the evaluators' rounding.

use crate::base::arrays::{Mapped, each};
use crate::nodes::bounds::Interval;
use crate::nodes::hash::{hash_floats, pcg, pcg_values};
use crate::nodes::voronoi_texture::{
    Feature, Hashing, Metric, VoronoiTexture, cell_of_floats, color_of_floats, neighbours,
};

/// Error of a distance in cell units. Hash, product with the randomness, sum with the cell, local
/// coordinate and difference round by at most 3e-8, 6e-8, 1.2e-7, 6e-8 and 1.2e-7 per axis: 4e-7,
/// over four axes 8e-7 (Euclidean) or 1.6e-6 (Manhattan). The sum and the root add 6 ulp of at most
/// 8: less than 6e-6 altogether.
const ERROR: f64 = 8e-6;

/// Beyond this magnitude a coordinate's fraction has fewer than two bits.
const LARGEST_COORDINATE: f64 = 4_194_304.0;

/// Cells that a scan may visit before the box counts as too large; see [`VoronoiTexture::window`].
const LARGEST_WINDOW: f64 = 20_000.0;

/// Candidates for the nearest point beyond which colours, positions, edges and radii are not looked at singly.
const LARGEST_CANDIDATE_COUNT: usize = 64;

/// Distance in cells that a box without a use for the far side takes for 0, and looks no further. Such a box holds so many points that
/// the least distance is rarely above it, and all of its cells would be looked at to say how little it is.
const CLOSE: f64 = 0.05;

/// Minkowski exponents with a scan. Outside, f32 powers of offsets over- or underflow, or the
/// comparison orders the other way round (below 0).
const EXPONENTS: [f64; 2] = [0.25, 8.0];

/// Minkowski exponents for which no power of an offset up to 2 leaves f32's range.
const USUAL_EXPONENTS: [f32; 2] = [0.05, 100.0];

/// Parameters over a box, clamped as the kernel does.
type Parameters = super::Parameters<Interval>;

/// Bounds of one octave.
#[derive(Clone, Copy)]
struct Found<const N: usize> {
    distance: Interval,
    color: [Interval; 3],
    position: [Interval; N],
}

/// A box of coordinates in cell units.
#[derive(Clone, Copy)]
struct CellBox<const N: usize> {
    low: [f64; N],
    high: [f64; N],
    /// Cells of the corners.
    first: [i32; N],
    last: [i32; N],
    randomness: [f64; 2],
    hashing: Hashing,
}

/// A cell's point: the cell and the box that holds the point (one place unless the randomness varies).
#[derive(Clone, Copy)]
struct CellPoint<const N: usize> {
    cell: [i32; N],
    low: [f64; N],
    high: [f64; N],
}

/// How offsets along the axes join to the quantity that the scan compares: terms are joined, the
/// root makes a distance of the whole.
trait Measure: Copy {
    /// What an offset along one axis counts.
    fn term(self, offset: f64) -> f64;
    /// Two terms together.
    #[inline(always)]
    fn join(self, a: f64, b: f64) -> f64 {
        a + b
    }
    /// The distance of the joined terms.
    fn root(self, joined: f64) -> f64;
    /// Error of a distance.
    fn error(self) -> f64 {
        ERROR
    }
}

/// Root of the sum of squares.
#[derive(Clone, Copy)]
struct Euclidean;

impl Measure for Euclidean {
    #[inline(always)]
    fn term(self, offset: f64) -> f64 {
        offset * offset
    }
    #[inline(always)]
    fn root(self, joined: f64) -> f64 {
        joined.sqrt()
    }
}

/// Sum of magnitudes; also the one axis of 1D.
#[derive(Clone, Copy)]
struct Manhattan;

impl Measure for Manhattan {
    #[inline(always)]
    fn term(self, offset: f64) -> f64 {
        offset
    }
    #[inline(always)]
    fn root(self, joined: f64) -> f64 {
        joined
    }
}

/// Largest magnitude.
#[derive(Clone, Copy)]
struct Chebychev;

impl Measure for Chebychev {
    #[inline(always)]
    fn term(self, offset: f64) -> f64 {
        offset
    }
    #[inline(always)]
    fn join(self, a: f64, b: f64) -> f64 {
        a.max(b)
    }
    #[inline(always)]
    fn root(self, joined: f64) -> f64 {
        joined
    }
}

/// Root of the sum of powers with this exponent, one of [`EXPONENTS`].
#[derive(Clone, Copy)]
struct Minkowski(f64);

impl Measure for Minkowski {
    fn term(self, offset: f64) -> f64 {
        offset.powf(self.0)
    }
    fn root(self, joined: f64) -> f64 {
        joined.powf(1.0 / self.0)
    }
    /// Flushed powers of small offsets count with large exponents.
    fn error(self) -> f64 {
        2e-4
    }
}

/// The metric of a mode, with a fixed exponent.
#[derive(Clone, Copy)]
enum Shape {
    Euclidean,
    Manhattan,
    Chebychev,
    Minkowski(f64),
}

/// Calls the body with the shape's [`Measure`].
macro_rules! with_measure {
    ($shape:expr, |$measure:ident| $body:expr) => {
        match $shape {
            Shape::Euclidean => {
                let $measure = Euclidean;
                $body
            }
            Shape::Manhattan => {
                let $measure = Manhattan;
                $body
            }
            Shape::Chebychev => {
                let $measure = Chebychev;
                $body
            }
            Shape::Minkowski(exponent) => {
                let $measure = Minkowski(exponent);
                $body
            }
        }
    };
}

impl<const N: usize> CellBox<N> {
    fn new(low: [f64; N], high: [f64; N], randomness: [f64; 2], hashing: Hashing) -> Self {
        let cell = |x: f64| x.floor() as i32;
        Self { low, high, first: low.mapped(cell), last: high.mapped(cell), randomness, hashing }
    }

    #[inline(always)]
    fn point(&self, cell: [i32; N]) -> CellPoint<N> {
        let hash: [f64; N] = if N == 1 || self.hashing == Hashing::Floats {
            // The interface hashes -0 as 0 here; of one axis see `edge` for the other.
            cell_of_floats(cell.mapped(f64::from))
        } else {
            pcg(cell).mapped(|bits| f64::from(bits) * (1.0 / 2_147_483_648.0))
        };
        let [least, most] = self.randomness;
        CellPoint {
            cell,
            low: each(|axis| f64::from(cell[axis]) + hash[axis] * least),
            high: each(|axis| f64::from(cell[axis]) + hash[axis] * most),
        }
    }

    /// Least and greatest joined offset between the box and a cell's point.
    #[inline(always)]
    fn reach(&self, point: &CellPoint<N>, measure: impl Measure) -> [f64; 2] {
        let mut reach = [0.0; 2];
        for axis in 0..N {
            let (below, above) = (self.low[axis] - point.high[axis], point.low[axis] - self.high[axis]);
            let near = below.max(above).max(0.0);
            let far = (self.high[axis] - point.low[axis]).max(point.high[axis] - self.low[axis]);
            reach[0] = measure.join(reach[0], measure.term(near));
            reach[1] = measure.join(reach[1], measure.term(far));
        }
        reach
    }

    /// Whether a cell is in the window of every coordinate of the box.
    fn always_sees(&self, cell: [i32; N], radius: i32) -> bool {
        (0..N).all(|axis| self.last[axis] - radius <= cell[axis] && cell[axis] <= self.first[axis] + radius)
    }

    /// Cells in the window of some coordinate: first and last along each axis.
    fn window(&self, radius: i32) -> [[i32; 2]; N] {
        each(|axis| [self.first[axis] - radius, self.last[axis] + radius])
    }

    fn window_size(&self, radius: i32) -> f64 {
        self.window(radius).iter().map(|[first, last]| f64::from(last - first + 1)).product()
    }

    fn widest_side(&self) -> f64 {
        (0..N).map(|axis| self.high[axis] - self.low[axis]).fold(0.0, f64::max)
    }
}

/// A cell along one axis.
#[derive(Clone, Copy)]
struct AxisCell {
    number: i32,
    /// The least that a point in it, or in a cell behind it, counts as its nearest offset to the box, and as its farthest.
    least: [f64; 2],
}

/// Cells that one axis of a window offers, from the box's middle outwards: both least terms rise.
#[derive(Clone, Copy)]
struct Axis {
    cells: [AxisCell; MOST_CELLS],
    count: usize,
}

/// Cells along one axis of a window that is scanned.
const MOST_CELLS: usize = 24;

impl Axis {
    const EMPTY: Self = Self { cells: [AxisCell { number: 0, least: [0.0; 2] }; MOST_CELLS], count: 0 };

    /// Puts down the cells from `first` to `last` around the box from `low` to `high`.
    #[inline(always)]
    fn fill(&mut self, [low, high]: [f64; 2], [first, last]: [i32; 2], measure: impl Measure) {
        let (middle, half) = (0.5 * (low + high), 0.5 * (high - low));
        let mut above = (middle.floor() as i32).clamp(first, last);
        let mut below = above - 1;
        while above <= last || below >= first {
            let above_is_nearer = f64::from(above) - middle <= middle - f64::from(below + 1);
            let takes_above = below < first || (above <= last && above_is_nearer);
            let number = if takes_above { above } else { below };
            if takes_above {
                above += 1;
            } else {
                below -= 1;
            }
            // Subtraction rounds monotonically, so that no point of the cell has less than this. The larger of the offsets to both ends is
            // nowhere below half of the box.
            let [start, end] = [f64::from(number), f64::from(number + 1)];
            let near = (start - high).max(low - end).max(0.0);
            let far = (start - low).max(high - end).max(half);
            self.cells[self.count] = AxisCell { number, least: [near, far].mapped(|offset| measure.term(offset)) };
            self.count += 1;
        }
        // Terms rise with the distance from the middle, but its rounding may have swapped cells on either side, and powers may round otherwise.
        for index in (1..self.count).rev() {
            let behind = self.cells[index].least;
            let least = &mut self.cells[index - 1].least;
            *least = [least[0].min(behind[0]), least[1].min(behind[1])];
        }
    }
}

/// The cells around a box.
struct Scan<'a, M, const N: usize> {
    place: &'a CellBox<N>,
    measure: M,
    axes: [Axis; N],
}

impl<M: Measure, const N: usize> Scan<'_, M, N> {
    /// Calls `look` with every cell for whose least joined offsets (the nearest, the farthest) `matters` holds. It must hold for smaller offsets
    /// where it holds for larger ones, and may hold for fewer as the state changes.
    #[inline(always)]
    fn walk<S>(
        &self,
        state: &mut S,
        matters: impl Fn(&S, [f64; 2]) -> bool,
        mut look: impl FnMut(&mut S, &CellPoint<N>),
    ) {
        let (mut axis, mut next, mut sums, mut cell) = (0, [0; N], [[0.0; 2]; N], [0; N]);
        loop {
            let row = &self.axes[axis];
            if next[axis] < row.count {
                let AxisCell { number, least } = row.cells[next[axis]];
                let joined = [0, 1].mapped(|end| self.measure.join(sums[axis][end], least[end]));
                // The cells behind it along this axis matter no more than it does.
                if matters(state, joined) {
                    cell[axis] = number;
                    next[axis] += 1;
                    if axis + 1 < N {
                        axis += 1;
                        (next[axis], sums[axis]) = (0, joined);
                    } else {
                        look(state, &self.place.point(cell));
                    }
                    continue;
                }
            }
            if axis == 0 {
                return;
            }
            axis -= 1;
        }
    }

    /// The least two of the near and of the far joined offsets.
    #[inline(always)]
    fn nearest(&self, wanted: &Wanted) -> Least {
        let (last, error) = (usize::from(wanted.second), self.measure.error());
        let close = self.measure.term(CLOSE);
        // A point nearer than this is in every window, whatever its cell.
        let always_seen = self.measure.term(f64::from(wanted.radius) - error);
        let largest = self.measure.term(wanted.largest + error);
        let mut least = Least { near: [f64::INFINITY; 2], far: [largest; 2] };
        self.walk(
            &mut least,
            #[inline(always)]
            |least, [near, far]| near < least.near[last] || (wanted.far && far < least.far[last]),
            #[inline(always)]
            |least, point| {
                let [near, far] = self.place.reach(point, self.measure);
                insert(&mut least.near, near);
                if !wanted.far && least.near[last] <= close {
                    least.near = [0.0; 2];
                }
                let improves = wanted.far && far < least.far[last];
                if improves && (far < always_seen || self.place.always_sees(point.cell, wanted.radius)) {
                    insert(&mut least.far, far);
                }
            },
        );
        least
    }

    /// The points whose near joined offset is not above a limit.
    fn candidates(&self, limit: f64) -> Vec<CellPoint<N>> {
        let mut found = Vec::new();
        self.walk(
            &mut found,
            |_, [near, _]| near <= limit,
            |found, point| {
                if self.place.reach(point, self.measure)[0] <= limit {
                    found.push(*point);
                }
            },
        );
        found
    }
}

/// What a scan looks for.
struct Wanted {
    /// Keep the second least as well.
    second: bool,
    /// Whether the far side is wanted: not for boxes so wide that it cannot improve on the range.
    far: bool,
    /// Cells to each side that are in a window.
    radius: i32,
    /// Distance that no far side exceeds.
    largest: f64,
}

/// The least two of the near and of the far joined offsets.
struct Least {
    near: [f64; 2],
    far: [f64; 2],
}

/// Keeps the two least.
#[inline(always)]
fn insert(least: &mut [f64; 2], value: f64) {
    if value < least[0] {
        *least = [value, least[0]];
    } else if value < least[1] {
        least[1] = value;
    }
}

/// What a scan of F1 or F2 gives.
struct Scanned<const N: usize> {
    distance: Interval,
    /// Points that may be the one found; `None` when they are too many to look at.
    candidates: Option<Vec<CellPoint<N>>>,
}

impl VoronoiTexture {
    /// The metric with a fixed exponent, if it can be scanned.
    fn shape<const N: usize>(&self, parameters: &Parameters) -> Option<Shape> {
        Some(match self.metric {
            _ if N == 1 => Shape::Manhattan,
            Metric::Euclidean => Shape::Euclidean,
            Metric::Manhattan => Shape::Manhattan,
            Metric::Chebychev => Shape::Chebychev,
            Metric::Minkowski => {
                let exponent = f64::from(parameters.exponent.as_point()?);
                let scanned = (EXPONENTS[0]..=EXPONENTS[1]).contains(&exponent);
                return scanned.then_some(Shape::Minkowski(exponent));
            }
        })
    }

    /// Largest distance of an offset with these magnitudes, for any exponent of the box.
    fn longest<const N: usize>(&self, offsets: [f64; N], parameters: &Parameters) -> f64 {
        if N > 1 && self.metric == Metric::Minkowski {
            let longest = offsets.iter().copied().fold(0.0, f64::max);
            let exponent = parameters.exponent;
            return if exponent.may_be_nan {
                f64::INFINITY
            } else if exponent.low > USUAL_EXPONENTS[0] && exponent.high < USUAL_EXPONENTS[1] {
                // Falls with the exponent.
                longest * (N as f64).powf(1.0 / exponent.ends()[0]) * (1.0 + 1e-4)
            } else if exponent.low > -60.0 && exponent.high < 0.0 {
                // Below each of the offsets' magnitudes; the comparison prefers far points, up to 2 away.
                longest.max(2.0) * (1.0 + 1e-4)
            } else {
                f64::INFINITY
            };
        }
        let length = match self.metric {
            Metric::Chebychev => offsets.iter().copied().fold(0.0, f64::max),
            Metric::Euclidean if N > 1 => offsets.iter().map(|x| x * x).sum::<f64>().sqrt(),
            _ => offsets.iter().sum(),
        };
        length + ERROR
    }

    /// Upper end of the feature's distance, wherever the coordinate is: by the cell's own point for
    /// F1, for F2 also that of the nearer neighbour along the first axis.
    fn largest<const N: usize>(&self, second: bool, parameters: &Parameters) -> f64 {
        let mut offsets = [1.0; N];
        if second {
            offsets[0] = 1.5;
        }
        self.longest(offsets, parameters)
    }

    /// The box in cell units, unless coordinates are unfit for a scan.
    fn place<const N: usize>(&self, x: &[Interval; N], parameters: &Parameters) -> Option<CellBox<N>> {
        if x.iter().any(|x| !x.is_finite() || x.magnitude() > LARGEST_COORDINATE) {
            return None;
        }
        let ends = x.mapped(Interval::ends);
        Some(CellBox::new(ends.map(|x| x[0]), ends.map(|x| x[1]), parameters.randomness.ends(), self.hashing))
    }

    /// Bounds of the least (or second least) distance over a window, with the points that may attain it.
    fn scan<const N: usize>(
        &self,
        place: &CellBox<N>,
        measure: impl Measure,
        radius: i32,
        second: bool,
        largest: f64,
        wants_candidates: bool,
    ) -> Scanned<N> {
        let error = measure.error();
        let window = place.window(radius);
        let fits = window.iter().all(|[first, last]| ((last - first) as usize) < MOST_CELLS);
        if !fits || place.window_size(radius) > LARGEST_WINDOW {
            return Scanned { distance: Interval::with_error(0.0, largest, error, false), candidates: None };
        }
        let mut scan = Scan { place, measure, axes: [Axis::EMPTY; N] };
        for axis in 0..N {
            scan.axes[axis].fill([place.low[axis], place.high[axis]], window[axis], measure);
        }
        let least =
            scan.nearest(&Wanted { second, far: wants_candidates || place.widest_side() <= 1.0, radius, largest });
        let which = usize::from(second);
        let (near, far) = (measure.root(least.near[which]), measure.root(least.far[which]).min(largest));
        let distance = Interval::with_error((near - error).max(0.0), far + error, 0.0, false);
        let candidates = if wants_candidates { scan.candidates(measure.term(far + 2.0 * error)) } else { Vec::new() };
        let few = wants_candidates && candidates.len() <= LARGEST_CANDIDATE_COUNT;
        Scanned { distance, candidates: few.then_some(candidates) }
    }

    /// Statement about an octave that holds everywhere.
    fn range<const N: usize>(&self, x: &[Interval; N], feature: Feature, parameters: &Parameters) -> Found<N> {
        let mut unfit = x.iter().any(|x| x.may_be_nan || x.magnitude().is_infinite());
        let second = feature == Feature::F2;
        let smooth = feature == Feature::SmoothF1;
        if N > 1 && self.metric == Metric::Minkowski {
            unfit |= parameters.exponent.may_be_nan;
            if smooth && self.shape::<N>(parameters).is_none() {
                // Mixing distances that overflow gives NaN.
                let nothing = Interval::EVERYTHING;
                return Found { distance: nothing, color: [nothing; 3], position: [nothing; N] };
            }
        }
        let mut largest = self.largest::<N>(second, parameters);
        if unfit && (second || (N == 1 && !smooth)) {
            // Nothing is nearer than the start value, which F2 and the one axis keep.
            largest = f64::from(f32::MAX);
        }
        let smoothness = if smooth { parameters.smoothness.magnitude() } else { 0.0 };
        let undershoot = color_undershoot(smoothness);
        let radius = if smooth { 2.0 } else { 1.0 };
        let error = if smooth { mixing_error::<N>() } else { ERROR };
        Found {
            // Blending octaves turns an infinite distance into NaN.
            distance: Interval::with_error(-smoothness, largest, error, unfit || largest.is_infinite()),
            color: [Interval::with_error(-undershoot, 1.0, error, unfit); 3],
            position: x.mapped(|x| {
                let place = x.floor() + Interval::with_error(-radius - undershoot, radius + 1.0, error, false);
                place.or_nan(unfit)
            }),
        }
    }

    /// F1 or F2.
    fn enclose_nearest<const N: usize>(
        &self,
        x: &[Interval; N],
        feature: Feature,
        parameters: &Parameters,
    ) -> Found<N> {
        let mut found = self.range(x, feature, parameters);
        if self.hashes_negative_zero && x[0].flushed().has_zero() {
            return found;
        }
        let (Some(place), Some(shape)) = (self.place(x, parameters), self.shape::<N>(parameters)) else {
            return found;
        };
        let second = feature == Feature::F2;
        let wants_candidates = self.color || self.position || self.w;
        let largest = self.largest::<N>(second, parameters);
        let scanned = with_measure!(shape, |measure| self.scan(&place, measure, 1, second, largest, wants_candidates));
        found.distance = scanned.distance.meet(found.distance);
        if let Some(candidates) = scanned.candidates {
            let hull_of =
                |value: &dyn Fn(&CellPoint<N>) -> Interval| candidates.iter().map(value).reduce(Interval::hull);
            for channel in 0..3 {
                let color = hull_of(&|point| {
                    let color = cell_color(point.cell, self.hashing)[channel];
                    Interval::with_error(color, color, 1e-7, false)
                });
                found.color[channel] = color.map_or(found.color[channel], |color| color.meet(found.color[channel]));
            }
            for axis in 0..N {
                let position = hull_of(&|point| Interval::with_error(point.low[axis], point.high[axis], ERROR, false));
                found.position[axis] =
                    position.map_or(found.position[axis], |position| position.meet(found.position[axis]));
            }
        }
        found
    }

    /// Smooth F1. Each step of the smooth minimum rises with the distance so far and with the new
    /// one, so within one cell (where the order of the cells is fixed) the recursion over the least
    /// and over the greatest distances bounds it. Otherwise: it is below F1 of its window, and above
    /// it less the smoothness: as long as all distances are at least m, m - s grows no further once
    /// it has reached the smoothness, because then h = 0.
    fn enclose_smooth<const N: usize>(&self, x: &[Interval; N], parameters: &Parameters) -> Found<N> {
        let mut found = self.range(x, Feature::SmoothF1, parameters);
        let (Some(place), Some(shape)) = (self.place(x, parameters), self.shape::<N>(parameters)) else {
            return found;
        };
        with_measure!(shape, |measure| self.smooth(&place, measure, parameters, &mut found));
        found
    }

    /// Narrows the distance of smooth F1 for one metric.
    fn smooth<const N: usize>(
        &self,
        place: &CellBox<N>,
        measure: impl Measure,
        parameters: &Parameters,
        found: &mut Found<N>,
    ) {
        let error = measure.error() + mixing_error::<N>();
        let smoothness = parameters.smoothness.ends();
        let largest = self.largest::<N>(false, parameters);
        let scanned = self.scan(place, measure, 2, false, largest, false);
        let [near, far] = scanned.distance.ends();
        found.distance = Interval::with_error(near - smoothness[1], far, error, false).meet(found.distance);
        if place.first != place.last || smoothness[0] != smoothness[1] || smoothness[0] < 1e-6 {
            return;
        }
        let width = smoothness[0];
        let step = |s: f64, distance: f64| {
            let t = (0.5 + 0.5 * (s - distance) / width).clamp(0.0, 1.0);
            let h = t * t * (3.0 - 2.0 * t);
            s + h * (distance - s) - width * h * (1.0 - h)
        };
        let mut smooth: Option<[f64; 2]> = None;
        for offset in neighbours::<N>(2) {
            let cell = each(|axis| place.first[axis] + offset[axis]);
            let [near, far] = place.reach(&place.point(cell), measure).mapped(|joined| measure.root(joined));
            smooth = Some(match smooth {
                None => [near, far],
                Some([low, high]) => [step(low, near), step(high, far)],
            });
        }
        if let Some([low, high]) = smooth {
            found.distance = Interval::with_error(low, high, error, false).meet(found.distance);
        }
    }

    fn enclose_feature<const N: usize>(&self, x: &[Interval; N], parameters: &Parameters) -> Found<N> {
        if self.feature != Feature::SmoothF1 {
            return self.enclose_nearest(x, self.feature, parameters);
        }
        // Smoothness 0 is F1.
        if parameters.smoothness.high <= 0.0 {
            return self.enclose_nearest(x, Feature::F1, parameters);
        }
        let smooth = self.enclose_smooth(x, parameters);
        if parameters.smoothness.low > 0.0 {
            return smooth;
        }
        let sharp = self.enclose_nearest(x, Feature::F1, parameters);
        Found {
            distance: smooth.distance.hull(sharp.distance),
            color: each(|channel| smooth.color[channel].hull(sharp.color[channel])),
            position: each(|axis| smooth.position[axis].hull(sharp.position[axis])),
        }
    }

    /// Distance to the edge in one octave. For a nearest point p and another point c the distance to
    /// their bisector is linear in the coordinate with a unit gradient, so it is exact over a box;
    /// the edge is the least over all c, and the union over the points that may be nearest bounds it.
    fn enclose_edge<const N: usize>(&self, x: &[Interval; N], parameters: &Parameters) -> Interval {
        let unfit = x.iter().any(|x| x.may_be_nan || x.magnitude().is_infinite());
        // Half the sum of both lengths, and some point of the window is at most 2 away along one axis
        // and 1 along the others without being next to the nearest one. Two points at least 0.01 apart
        // divide an error of 1e-6.
        let widest = ((N + 3) as f64).sqrt();
        let error = 4e-4;
        let start = f64::from(f32::MAX);
        let range = Interval::with_error(-error, if unfit { start } else { widest }, error, unfit);
        let Some(place) = self.place(x, parameters) else { return range };
        if N == 1 {
            return self.enclose_edge_1d(&place).meet(range);
        }
        let [least, most] = place.randomness;
        if least != most || place.widest_side() > 1.0 {
            return range;
        }
        let scanned = self.scan(&place, Euclidean, 1, false, (N as f64).sqrt(), true);
        let Some(candidates) = scanned.candidates else { return range };
        let middle: [f64; N] = each(|axis| 0.5 * (place.low[axis] + place.high[axis]));
        let window = place.window(1);
        let mut points = Vec::new();
        let mut cell = window.mapped(|[first, _]| first);
        loop {
            points.push((place.point(cell), place.always_sees(cell, 1)));
            let Some(axis) = (0..N).find(|&axis| cell[axis] < window[axis][1]) else { break };
            cell[axis] += 1;
            for earlier in 0..axis {
                cell[earlier] = window[earlier][0];
            }
        }
        let mut result: Option<Interval> = None;
        for nearest in &candidates {
            let (mut low, mut high) = (f64::INFINITY, widest);
            for (other, always_seen) in &points {
                let across: [f64; N] = each(|axis| other.low[axis] - nearest.low[axis]);
                let square: f64 = across.iter().map(|x| x * x).sum();
                // The scan's threshold is 0.0001; rounding may decide either way next to it.
                if square < 0.000_099 {
                    continue;
                }
                let norm = square.sqrt();
                let (mut centre, mut radius) = (0.0, 0.0);
                for axis in 0..N {
                    let direction = across[axis] / norm;
                    centre += direction * (0.5 * (other.low[axis] + nearest.low[axis]) - middle[axis]);
                    radius += direction.abs() * 0.5 * (place.high[axis] - place.low[axis]);
                }
                low = low.min(centre - radius);
                if *always_seen && square > 0.000_101 {
                    high = high.min(centre + radius);
                }
            }
            // Where this point is the nearest one, the distance is not negative.
            let part = Interval::with_error(low.max(0.0), high.max(0.0), error, false);
            result = Some(result.map_or(part, |known| known.hull(part)));
        }
        result.map_or(range, |result| result.meet(range))
    }

    /// One axis: the nearer of the two middles between the own and the neighbouring points.
    fn enclose_edge_1d<const N: usize>(&self, place: &CellBox<N>) -> Interval {
        let range = Interval::with_error(0.0, 1.5, ERROR, false);
        let (first, last) = (place.first[0], place.last[0]);
        if last - first > 4 {
            return range;
        }
        let span = |cell: i32, minus_zero: bool| {
            let floor = if minus_zero { -0.0 } else { f64::from(cell) };
            let hash: f64 = hash_floats([floor]);
            place.randomness.mapped(|randomness| f64::from(cell) + hash * randomness)
        };
        let mut result: Option<Interval> = None;
        for cell in first..=last {
            // The middle cell hashes its own floor: that of a negative zero is -0.
            for minus_zero in [false, true].into_iter().take(if cell == 0 { 2 } else { 1 }) {
                let own = span(cell, minus_zero);
                let ends = [place.low[0].max(f64::from(cell)), place.high[0].min(f64::from(cell + 1))];
                let to = |other: [f64; 2]| {
                    let (low, high) = (0.5 * (own[0] + other[0]) - ends[1], 0.5 * (own[1] + other[1]) - ends[0]);
                    Interval::with_error(low, high, ERROR, false).abs()
                };
                let part = to(span(cell - 1, false)).lesser(to(span(cell + 1, false)));
                result = Some(result.map_or(part, |known| known.hull(part)));
            }
        }
        result.map_or(range, |result| result.meet(range))
    }

    /// Half the distance from the nearest point to its own nearest neighbour.
    fn enclose_radius<const N: usize>(&self, x: &[Interval; N], parameters: &Parameters) -> Interval {
        // The neighbour along the first axis on the point's side is at most (1.5, 1, ...) away. Without
        // a nearest point (coordinates that are no numbers) the start values take its place: the origin.
        let unfit = x.iter().any(|x| x.may_be_nan || x.magnitude().is_infinite());
        let widest = if unfit { 2.0 * (N as f64).sqrt() } else { ((N as f64) + 1.25).sqrt() };
        let range = Interval::with_error(0.0, 0.5 * widest, ERROR, false);
        let Some(place) = self.place(x, parameters) else { return range };
        if place.widest_side() > 2.0 {
            return range;
        }
        let scanned = self.scan(&place, Euclidean, 1, false, (N as f64).sqrt(), true);
        let Some(candidates) = scanned.candidates else { return range };
        let mut result: Option<Interval> = None;
        for nearest in &candidates {
            let from = CellBox::new(nearest.low, nearest.high, place.randomness, place.hashing);
            let mut least = [f64::INFINITY; 2];
            for offset in neighbours::<N>(1).filter(|offset| *offset != [0; N]) {
                let cell = each(|axis| nearest.cell[axis].wrapping_add(offset[axis]));
                let [near, far] = from.reach(&from.point(cell), Euclidean);
                least = [least[0].min(near), least[1].min(far)];
            }
            let [near, far] = least.mapped(|joined| 0.5 * Euclidean.root(joined));
            let part = Interval::with_error(near, far, ERROR, false);
            result = Some(result.map_or(part, |known| known.hull(part)));
        }
        result.map_or(range, |result| result.meet(range))
    }

    /// The distance that `normalize` divides by.
    fn enclose_largest_distance<const N: usize>(&self, parameters: &Parameters) -> Interval {
        let half = Interval::point(0.5) + Interval::point(0.5) * parameters.randomness;
        let [low, high] = half.ends();
        let distance = if N == 1 || self.metric == Metric::Chebychev {
            half
        } else {
            let n = N as f64;
            match self.metric {
                Metric::Euclidean => Interval::outward(low * n.sqrt(), high * n.sqrt(), false),
                Metric::Manhattan => Interval::outward(low * n, high * n, false),
                _ => {
                    let exponent = parameters.exponent;
                    let [least, most] = exponent.ends().mapped(|exponent| n.powf(1.0 / exponent));
                    if exponent.low > USUAL_EXPONENTS[0] && exponent.high < USUAL_EXPONENTS[1] {
                        Interval::outward(low * most * (1.0 - 1e-4), high * least * (1.0 + 1e-4), exponent.may_be_nan)
                    } else {
                        Interval::new(0.0, f32::INFINITY).or_nan(exponent.may_be_nan)
                    }
                }
            }
        };
        if self.feature == Feature::F2 { distance * Interval::point(2.0) } else { distance }
    }

    /// The fractal sum of F1, F2 or smooth F1, for every whole number of octaves that Detail may hold.
    fn enclose_fractal<const N: usize>(&self, q: [Interval; N], parameters: &Parameters) -> Found<N> {
        let octaves = octaves(&q, parameters, |x| self.enclose_feature(x, parameters));
        let mut result: Option<Found<N>> = None;
        for whole in parameters.detail.low.floor() as usize..=parameters.detail.high.floor() as usize {
            let mut sum = Found { distance: Interval::ZERO, color: [Interval::ZERO; 3], position: [Interval::ZERO; N] };
            let (mut amplitude, mut total) = (Interval::ONE, Interval::ZERO);
            let add = |sum: &Found<N>, octave: &(Interval, Found<N>), amplitude: Interval| {
                let (scale, found) = octave;
                let inverse = Interval::ONE.divide(*scale);
                Found {
                    distance: sum.distance + found.distance * amplitude,
                    color: each(|channel| sum.color[channel] + found.color[channel] * amplitude),
                    position: each(|axis| sum.position[axis].lerp(found.position[axis] * inverse, amplitude)),
                }
            };
            for octave in &octaves[..=whole] {
                sum = add(&sum, octave, amplitude);
                total = total + amplitude;
                amplitude = amplitude * parameters.roughness;
            }
            let rest = rest_of(parameters.detail, whole);
            if let Some(octave) = octaves.get(whole + 1).filter(|_| rest.high > 0.0) {
                let next = add(&sum, octave, amplitude);
                total = total + amplitude * rest;
                let (_, found) = octave;
                sum = Found {
                    // lerp(a, a + b, t) is a + t b.
                    distance: sum.distance + rest * (found.distance * amplitude),
                    color: each(|channel| sum.color[channel] + rest * (found.color[channel] * amplitude)),
                    position: each(|axis| sum.position[axis].lerp(next.position[axis], rest)),
                };
            }
            if self.normalize {
                sum.distance = sum.distance.divide(total * self.enclose_largest_distance::<N>(parameters));
                sum.color = sum.color.mapped(|x| x * Interval::ONE.divide(total));
            }
            result = Some(match result {
                None => sum,
                Some(known) => Found {
                    distance: known.distance.hull(sum.distance),
                    color: each(|channel| known.color[channel].hull(sum.color[channel])),
                    position: each(|axis| known.position[axis].hull(sum.position[axis])),
                },
            });
        }
        let mut found = result.unwrap_or_else(|| self.range(&q, self.feature, parameters));
        found.position = found.position.mapped(|x| x * Interval::ONE.safe_divide(parameters.scale));
        found
    }

    /// The fractal of the distance to edge.
    fn enclose_fractal_edge<const N: usize>(&self, q: [Interval; N], parameters: &Parameters) -> Interval {
        let octaves = octaves(&q, parameters, |x| self.enclose_edge(x, parameters));
        let largest = Interval::point(0.5) + Interval::point(0.5) * parameters.randomness;
        let mut result: Option<Interval> = None;
        for whole in parameters.detail.low.floor() as usize..=parameters.detail.high.floor() as usize {
            let (mut maximum, mut distance, mut amplitude) = (largest, Interval::point(8.0), Interval::ONE);
            let rest = rest_of(parameters.detail, whole);
            for (number, (scale, found)) in octaves.iter().enumerate().take(whole + 2) {
                let next_maximum = maximum.lerp(largest.divide(*scale), amplitude);
                let next = distance.lesser(found.divide(*scale));
                let next_distance = if number == 0 { *found } else { distance.lerp(next, amplitude) };
                if number <= whole {
                    (maximum, distance) = (next_maximum, next_distance);
                    amplitude = amplitude * parameters.roughness;
                } else if rest.high > 0.0 {
                    maximum = maximum.lerp(next_maximum, rest);
                    distance = distance.lerp(distance.lesser(next_distance), rest);
                }
            }
            let value = if self.normalize { distance.divide(maximum) } else { distance };
            result = Some(result.map_or(value, |known| known.hull(value)));
        }
        result.unwrap_or(Interval::EVERYTHING)
    }

    fn enclose_points<const N: usize>(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let columns = self.parameter_columns();
        let at = |column: Option<usize>| column.map_or(Interval::ZERO, |column| inputs[column]);
        let [scale, detail, roughness, lacunarity, smoothness, exponent, randomness] = columns.mapped(at);
        let half = Interval::point(0.5);
        let parameters = Parameters {
            scale,
            // Without roughness only the first octave counts.
            detail: if roughness.saturate().high > 0.0 {
                detail.clamped(Interval::ZERO, Interval::point(15.0))
            } else {
                Interval::ZERO
            },
            roughness: roughness.saturate(),
            lacunarity,
            smoothness: smoothness.divide(Interval::point(2.0)).clamped(Interval::ZERO, half),
            exponent,
            randomness: randomness.saturate(),
        };
        let q: [Interval; N] = each(|axis| inputs[axis] * scale);
        match self.feature {
            Feature::DistanceToEdge => outputs[0] = self.enclose_fractal_edge(q, &parameters),
            Feature::NSphereRadius => outputs[0] = self.enclose_radius(&q, &parameters),
            _ => {
                let found = self.enclose_fractal(q, &parameters);
                let mut next = 0;
                let mut put = |value: Interval| {
                    outputs[next] = value;
                    next += 1;
                };
                if self.distance {
                    put(found.distance);
                }
                if self.color {
                    found.color.into_iter().for_each(&mut put);
                }
                if self.position {
                    // The third component of 2D is 0, or NaN where a Lacunarity of 0 makes the scale 0.
                    let unbounded = |x: &Interval| x.may_be_nan || !x.low.is_finite() || !x.high.is_finite();
                    let third = Interval { may_be_nan: found.position.iter().any(unbounded), ..Interval::ZERO };
                    (0..3).for_each(|axis| put(if axis < N { found.position[axis] } else { third }));
                }
                if self.w {
                    put(found.position[N - 1]);
                }
            }
        }
    }
}

/// Error of mixing 5^N values up to 4: a few roundings in each step, none in a step with h = 0.
fn mixing_error<const N: usize>() -> f64 {
    ERROR + 5_f64.powi(N as i32) * 4e-7
}

/// How far below 0 a smoothly mixed colour can fall: c' = lerp(c, c_o, h) - k h (1 - h) with
/// c_o >= 0 keeps c >= -k, k = sm/(1 + 3 sm).
fn color_undershoot(smoothness: f64) -> f64 {
    smoothness / (1.0 + 3.0 * smoothness)
}

/// Colour of a cell.
fn cell_color<const N: usize>(cell: [i32; N], hashing: Hashing) -> [f64; 3] {
    if N == 1 || hashing == Hashing::Floats {
        return color_of_floats(cell.mapped(f64::from));
    }
    match N {
        2 => pcg_values([cell[0], cell[1], 0]),
        3 => pcg_values([cell[0], cell[1], cell[2]]),
        _ => {
            let [x, y, z, _] = pcg_values([cell[0], cell[1], cell[2], cell[3]]);
            [x, y, z]
        }
    }
}

/// Fraction of the last octave when `whole` octaves count beside the first.
fn rest_of(detail: Interval, whole: usize) -> Interval {
    let whole = whole as f32;
    Interval::new((detail.low - whole).max(0.0), (detail.high - whole).min(1.0))
}

/// Every octave that may count, with its scale.
fn octaves<T, const N: usize>(
    q: &[Interval; N],
    parameters: &Parameters,
    feature: impl Fn(&[Interval; N]) -> T,
) -> Vec<(Interval, T)> {
    let detail = parameters.detail.high;
    let most = detail.floor() as usize + usize::from(detail.fract() > 0.0);
    let mut scale = Interval::ONE;
    let mut all = Vec::with_capacity(most + 1);
    for number in 0..=most {
        let scaled = if number == 0 { *q } else { q.mapped(|x| x * scale) };
        all.push((scale, feature(&scaled)));
        scale = scale * parameters.lacunarity;
    }
    all
}

/// Encloses the wanted outputs; see [`crate::nodes::NodeEvaluator::bounds`].
pub(super) fn enclose(node: &VoronoiTexture, inputs: &[Interval], outputs: &mut [Interval]) {
    match node.dimensions {
        1 => node.enclose_points::<1>(inputs, outputs),
        2 => node.enclose_points::<2>(inputs, outputs),
        3 => node.enclose_points::<3>(inputs, outputs),
        _ => node.enclose_points::<4>(inputs, outputs),
    }
}
