//! Curves through points, as Float Curve, RGB Curves and Vector Curves have them.
//!
//! A curve is a chain of cubic Bezier segments whose handles follow from the points. Blender samples it into a
//! first table over the range of the clip rectangle and the points ([`Curve::value`]) and folds constants with
//! that. Cycles samples Blender's tables into one of its own over the range of the points
//! ([`CurveMapping::look_up`]). Both are built here in f32, in Blender's order of operations.

use crate::base::arrays::{Mapped, each};
use crate::base::error::{Error, Result};
use crate::nodes::lookup_table::{CELLS, Table, literal, vector};
use crate::nodes::object_property::Part;
use crate::nodes::real::Real;
use crate::nodes::{Column, Data, Evaluate, Interval, Mode, Simplified};
use serde_json::{Value as Json, json};
use std::sync::Arc;

/// Names of the rules that place a point's handles; the first is Blender's default.
pub const HANDLES: &[&str] = &["AUTO", "AUTO_CLAMPED", "VECTOR"];

/// Names of what follows beyond the ends; the second is Blender's default.
pub const EXTENSIONS: &[&str] = &["HORIZONTAL", "EXTRAPOLATED"];

/// Samples of a segment.
const SAMPLES: usize = 32;

/// Length of an automatic handle, as the divisor of the distance to the neighbour.
const HANDLE_DIVISOR: f32 = 2.5614;

/// Slope of a curve that ends in an upright handle.
const UPRIGHT: f32 = 10_000.0;

/// Entries of the first table that are as near to an end of the samples as this take its value.
const NEAR_END: f32 = 1e-6;

/// Limits of the clip rectangle.
const CLIP_LIMITS: [f32; 2] = [-100.0, 100.0];

/// The curves that a node has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Layout {
    /// One curve, for a float.
    Float,
    /// One for each channel of a colour, and one that comes before them.
    Color,
    /// One for each component of a vector, between -1 and 1 by default.
    Vector,
}

impl Layout {
    /// Number of curves.
    pub fn curves(self) -> usize {
        match self {
            Self::Float => 1,
            Self::Color => 4,
            Self::Vector => 3,
        }
    }

    /// Number of values.
    pub fn channels(self) -> usize {
        self.curves().min(3)
    }

    /// The property where the file holds none.
    pub fn default(self) -> Json {
        let low = if self == Self::Vector { -1.0 } else { 0.0 };
        let identity = json!([[low, low, "AUTO"], [1.0, 1.0, "AUTO"]]);
        json!({
            "extend": "EXTRAPOLATED", "use_clip": true, "clip": [low, low, 1.0, 1.0],
            "curves": vec![identity; self.curves()],
        })
    }
}

/// A point of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Argument and value.
    pub place: [f32; 2],
    /// One of [`HANDLES`].
    pub handles: &'static str,
}

/// A curve and its first table.
#[derive(Clone, PartialEq)]
pub struct Curve {
    points: Vec<Point>,
    extrapolates: bool,
    /// Argument of the first entry of the table.
    start: f32,
    /// Entries per unit of the argument.
    density: f32,
    /// Arguments of the outermost entries.
    ends: [f32; 2],
    /// Directions in which the curve leaves its first and its last point.
    directions: [[f32; 2]; 2],
    entries: Vec<f32>,
}

/// What it was made from: the table follows from it.
impl std::fmt::Debug for Curve {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Curve({:?})", self.points)
    }
}

fn minus([a, b]: [f32; 2], [c, d]: [f32; 2]) -> [f32; 2] {
    [a - c, b - d]
}

/// `place + vector * factor`.
fn moved([a, b]: [f32; 2], [x, y]: [f32; 2], factor: f32) -> [f32; 2] {
    [a + x * factor, b + y * factor]
}

fn length([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}

/// Left and right handle of every point.
fn handles(points: &[Point]) -> Vec<[[f32; 2]; 2]> {
    let last = points.len() - 1;
    let mut handles: Vec<[[f32; 2]; 2]> = (0..=last).map(|index| handles_of(points, index)).collect();
    if last < 2 {
        return handles;
    }
    // Automatic handles at the ends point to the inner handle of the neighbour.
    for (end, side, target) in [(0, 1, handles[1][0]), (last, 0, handles[last - 1][1])] {
        let place = points[end].place;
        if points[end].handles != "AUTO" {
            continue;
        }
        let outside = if end == 0 { target[0] < place[0] } else { target[0] > place[0] };
        let target = if outside { [place[0], target[1]] } else { target };
        let direction = minus(target, place);
        let distance = length(direction);
        if distance > f32::EPSILON {
            let scale = length(minus(handles[end][side], place)) / distance;
            let direction = direction.mapped(|axis| axis * scale);
            handles[end][side] = moved(place, direction, 1.0);
            handles[end][1 - side] = minus(place, direction);
        }
    }
    handles
}

/// Handles of a point by its own rule.
fn handles_of(points: &[Point], index: usize) -> [[f32; 2]; 2] {
    let place = points[index].place;
    let before = index.checked_sub(1).map(|index| points[index].place);
    let after = points.get(index + 1).map(|point| point.place);
    // A missing neighbour mirrors the other one.
    let mirrored = |other: Option<[f32; 2]>| {
        let [x, y] = other.unwrap_or(place);
        [2.0 * place[0] - x, 2.0 * place[1] - y]
    };
    let back = minus(place, before.unwrap_or_else(|| mirrored(after)));
    let ahead = minus(after.unwrap_or_else(|| mirrored(before)), place);
    if points[index].handles == "VECTOR" {
        return [moved(place, back, -(1.0 / 3.0)), moved(place, ahead, 1.0 / 3.0)];
    }
    let [back_length, ahead_length] = [back, ahead].mapped(|side| match length(side) {
        0.0 => 1.0,
        length => length,
    });
    let tangent = [ahead[0] / ahead_length + back[0] / back_length, ahead[1] / ahead_length + back[1] / back_length];
    let norm = length(tangent) * HANDLE_DIVISOR;
    if norm == 0.0 {
        // Blender never writes these: points on top of each other, or a curve that turns back on itself.
        return [[0.0; 2]; 2];
    }
    let mut left = moved(place, tangent, -(back_length / norm));
    let mut right = moved(place, tangent, ahead_length / norm);
    if let ("AUTO_CLAMPED", Some(before), Some(after)) = (points[index].handles, before, after) {
        let [rise_before, rise_after] = [before[1] - place[1], after[1] - place[1]];
        if (rise_before <= 0.0 && rise_after <= 0.0) || (rise_before >= 0.0 && rise_after >= 0.0) {
            left[1] = place[1];
            right[1] = place[1];
        } else if rise_before <= 0.0 {
            left[1] = left[1].max(before[1]);
            right[1] = right[1].min(after[1]);
        } else {
            left[1] = left[1].min(before[1]);
            right[1] = right[1].max(after[1]);
        }
    }
    [left, right]
}

/// One coordinate of a cubic Bezier segment at evenly spaced parameters, by forward differences.
fn samples([a, b, c, d]: [f32; 4]) -> [f32; SAMPLES] {
    let steps = (SAMPLES - 1) as f32;
    let square = steps * steps;
    let cube = square * steps;
    let first = 3.0 * (b - a) / steps;
    let second = 3.0 * ((a - 2.0 * b) + c) / square;
    let third = ((d - a) + 3.0 * (b - c)) / cube;
    let (mut value, mut slope) = (a, (first + second) + third);
    let mut bend = 2.0 * second + 6.0 * third;
    let change = 6.0 * third;
    each(|_| {
        let sample = value;
        value += slope;
        slope += bend;
        bend += change;
        sample
    })
}

impl Curve {
    /// A curve through two or more points in order; `clip` is the range of the clip rectangle.
    pub fn new(points: Vec<Point>, clip: [f32; 2], extrapolates: bool) -> Self {
        let last = points.len() - 1;
        let handles = handles(&points);
        let mut places = Vec::with_capacity(last * SAMPLES);
        for index in 0..last {
            let (from, to) = (points[index].place, points[index + 1].place);
            let (mut leaving, mut arriving) = (handles[index][1], handles[index + 1][0]);
            // Handles that overlap are shortened: the curve must not turn back.
            let (first, second) = (minus(from, leaving), minus(to, arriving));
            let (width, reach) = (to[0] - from[0], first[0].abs() + second[0].abs());
            if reach != 0.0 && reach > width {
                let factor = width / reach;
                leaving = [from[0] - factor * first[0], from[1] - factor * first[1]];
                arriving = [to[0] - factor * second[0], to[1] - factor * second[1]];
            }
            let [x, y] = [0, 1].mapped(|axis| samples([from[axis], leaving[axis], arriving[axis], to[axis]]));
            places.extend(x.into_iter().zip(y));
        }
        let unit = |vector: [f32; 2]| {
            let norm = length(vector);
            vector.mapped(|axis| axis / norm)
        };
        let directions =
            [unit(minus(handles[0][0], points[0].place)), unit(minus(points[last].place, handles[last][1]))];
        let start = clip[0].min(points[0].place[0]);
        let end = clip[1].max(points[last].place[0]);
        let step = (1.0 / CELLS as f32) * (end - start);
        let mut curve =
            Self { points, extrapolates, start, density: 1.0 / step, ends: [0.0; 2], directions, entries: Vec::new() };
        curve.ends = [start, start + step * CELLS as f32];
        curve.entries = curve.tabulated(&places, step);
        curve
    }

    /// Entries of the first table, from samples of the curve.
    fn tabulated(&self, places: &[(f32, f32)], step: f32) -> Vec<f32> {
        let last = places.len() - 1;
        let mut next = 0;
        (0..=CELLS)
            .map(|index| {
                let x = self.start + step * index as f32;
                while x >= places[next].0 && next != last {
                    next += 1;
                }
                if next == 0 || x >= places[next].0 {
                    let side = usize::from(next != 0);
                    let (end, value) = places[if next == 0 { 0 } else { last }];
                    let beyond = if next == 0 { end - x } else { x - end };
                    return if beyond < NEAR_END { value } else { self.extended(side, x, end, value) };
                }
                let (before, after) = (places[next - 1], places[next]);
                let width = after.0 - before.0;
                let share = if width > f32::EPSILON { (after.0 - x) / width } else { 0.0 };
                share * before.1 + (1.0 - share) * after.1
            })
            .collect()
    }

    /// The value beyond an end with this value: 0 before the first point, 1 behind the last.
    fn extended(&self, side: usize, x: f32, end: f32, value: f32) -> f32 {
        let [run, rise] = self.directions[side];
        if !self.extrapolates {
            value
        } else if run == 0.0 {
            if side == 0 { value + rise * UPRIGHT } else { value - rise * UPRIGHT }
        } else {
            value + rise * (x - end) / run
        }
    }

    /// The curve at `x`, as Blender evaluates it: between the entries of the first table, or beyond them.
    pub fn value(&self, x: f32) -> f32 {
        let position = (x - self.start) * self.density;
        if position < 0.0 {
            return self.extended(0, x, self.ends[0], self.entries[0]);
        }
        if position > CELLS as f32 {
            return self.extended(1, x, self.ends[1], self.entries[CELLS]);
        }
        // NaN reads the first entry.
        let index = position as usize;
        if index >= CELLS || position.is_nan() {
            return self.entries[if position.is_nan() { 0 } else { CELLS }];
        }
        let rest = position - index as f32;
        (1.0 - rest) * self.entries[index] + rest * self.entries[index + 1]
    }

    fn is_finite(&self) -> bool {
        self.density.is_finite() && self.entries.iter().all(|entry| entry.is_finite())
    }
}

/// The curves of a node and the table that Cycles reads.
#[derive(Clone, PartialEq)]
pub struct CurveMapping {
    layout: Layout,
    extrapolates: bool,
    /// Values that Blender limits a folded Float Curve to.
    limits: Option<[f32; 2]>,
    /// Lower and upper corner of the clip rectangle.
    clip: [f32; 4],
    curves: Vec<Curve>,
    /// Argument of the table's first entry.
    start: f32,
    /// From there to the argument of the last one.
    width: f32,
    table: Table,
}

/// What it was made from: the table follows from it.
impl std::fmt::Debug for CurveMapping {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let extension = EXTENSIONS[usize::from(self.extrapolates)];
        write!(f, "CurveMapping({extension} {:?} {:?} {:?})", self.limits, self.clip, self.curves)
    }
}

impl CurveMapping {
    /// Reads the property `mapping`; nothing means Blender's default.
    pub fn read(given: Option<&Json>, layout: Layout, place: &str) -> Result<Data> {
        let default = layout.default();
        let part = Part::new(given.unwrap_or(&default), place);
        let [extend, use_clip, clip, curves] = part.members(["extend", "use_clip", "clip", "curves"])?;
        let extrapolates = extend.part().name(EXTENSIONS)? == "EXTRAPOLATED";
        let use_clip = use_clip.part().flag()?;
        let corners: [f32; 4] = clip.part().numbers(CLIP_LIMITS)?;
        if corners[0] > corners[2] || corners[1] > corners[3] {
            return Err(clip.part().wrong("a rectangle: [min x, min y, max x, max y]"));
        }
        let mut parsed = Vec::new();
        for curve in curves.part().items([layout.curves(); 2], "curves")? {
            let mut points: Vec<Point> = Vec::new();
            for point in curve.part().items([2, usize::MAX], "points")? {
                let [x, y, handles] = &point.part().items([3, 3], "items: x, y and the handle type")?[..] else {
                    unreachable!("there are three items")
                };
                let place = [x.part().number([f32::MIN, f32::MAX])?, y.part().number([f32::MIN, f32::MAX])?];
                points.push(Point { place, handles: handles.part().name(HANDLES)? });
            }
            if !points.is_sorted_by(|a, b| a.place[0] <= b.place[0]) {
                return Err(curve.part().wrong("points in rising order of their x"));
            }
            parsed.push(Curve::new(points, [corners[0], corners[2]], extrapolates));
        }
        let mapping = Self::new(layout, parsed, extrapolates, corners, use_clip);
        let is_finite = mapping.start.is_finite() && mapping.width.is_finite() && mapping.table.is_finite();
        if !is_finite || mapping.width <= 0.0 || !mapping.curves.iter().all(Curve::is_finite) {
            return Err(Error::new(
                place,
                "points that make a curve upright, infinite or undefined",
                "two or more points at different places, so that every value is finite",
                "Move the points apart, or remove those on top of others.",
            ));
        }
        Ok(Data::Curves(Arc::new(mapping)))
    }

    fn new(layout: Layout, curves: Vec<Curve>, extrapolates: bool, clip: [f32; 4], use_clip: bool) -> Self {
        let first = |curve: &Curve| curve.points[0].place[0];
        let last = |curve: &Curve| curve.points[curve.points.len() - 1].place[0];
        let start = curves.iter().map(first).fold(f32::INFINITY, f32::min);
        let width = curves.iter().map(last).fold(f32::NEG_INFINITY, f32::max) - start;
        let table = Table::new(layout.channels(), true, |index| {
            let x = start + (index as f32 / CELLS as f32) * width;
            (0..layout.channels()).map(|channel| value_of(layout, &curves, channel, x)).collect()
        });
        let limits = (use_clip && layout == Layout::Float).then_some([clip[1], clip[3]]);
        Self { layout, extrapolates, limits, clip, curves, start, width, table }
    }

    /// In a few words: the extension, the clip rectangle and the number of points of each curve.
    pub fn describe(&self) -> String {
        let extension = EXTENSIONS[usize::from(self.extrapolates)];
        let clipped = if self.limits.is_some() { " clipped" } else { "" };
        let counts: Vec<String> = self.curves.iter().map(|curve| curve.points.len().to_string()).collect();
        format!("{extension}{clipped} in {:?}, points {}", self.clip, counts.join(" "))
    }

    /// A channel as Blender itself evaluates it, for constants.
    pub fn value(&self, channel: usize, x: f32) -> f32 {
        let value = value_of(self.layout, &self.curves, channel, x);
        match self.limits {
            Some([low, _]) if value < low => low,
            Some([_, high]) if value > high => high,
            _ => value,
        }
    }

    /// A channel as Cycles evaluates it: the curve's value at `x`.
    #[inline]
    pub fn look_up<R: Real>(&self, channel: usize, x: R) -> R {
        self.at(channel, self.place(x))
    }

    /// The place in the table, 0 at its start and 1 at its end.
    #[inline(always)]
    fn place<R: Real>(&self, x: R) -> R {
        (x - R::of(self.start)) / R::of(self.width)
    }

    /// A channel at a place in the table.
    #[inline(always)]
    fn at<R: Real>(&self, channel: usize, place: R) -> R {
        let entries = self.table.entries(channel);
        let [first, second, before_last, last] =
            [entries[0], entries[1], entries[CELLS - 1], entries[CELLS]].mapped(R::of);
        let (zero, one, cells) = (R::of(0.0), R::of(1.0), R::of(CELLS as f32));
        if self.extrapolates && place < zero {
            first + ((first - second) * -place) * cells
        } else if self.extrapolates && place > one {
            last + ((last - before_last) * (place - one)) * cells
        } else {
            self.table.value(channel, self.table.place(place))
        }
    }

    /// Encloses [`Self::look_up`].
    pub fn enclose(&self, channel: usize, x: Interval) -> Interval {
        let place = (x - Interval::point(self.start)).divide(Interval::point(self.width));
        let mut found = self.table.enclose(channel, place);
        if !self.extrapolates {
            return found;
        }
        let entries = self.table.entries(channel);
        let cells = Interval::point(CELLS as f32);
        let beyond = |end: usize, inner: usize, distance: Interval| {
            let [end, inner] = [end, inner].mapped(|index| Interval::point(entries[index]));
            end + ((end - inner) * distance) * cells
        };
        if place.low < 0.0 {
            let distance = Interval::new((-place.high).max(0.0), -place.low);
            let before = beyond(0, 1, distance);
            found = if place.high < 0.0 && !place.may_be_nan { before } else { found.hull(before) };
        }
        if place.high > 1.0 {
            let distance = Interval::new(place.low.max(1.0), place.high) - Interval::ONE;
            let behind = beyond(CELLS, CELLS - 1, distance);
            found = if place.low > 1.0 && !place.may_be_nan { behind } else { found.hull(behind) };
        }
        found
    }

    /// Table, range and slopes beyond it for the nodes' WGSL.
    fn shader(&self) -> String {
        let steps = |inner: usize, end: usize| {
            let step = |channel: usize| {
                let entries = self.table.entries(channel);
                if self.extrapolates { entries[end] - entries[inner] } else { 0.0 }
            };
            vector(&(0..self.layout.channels()).map(step).collect::<Vec<_>>())
        };
        let kind = if self.layout == Layout::Float { "f32" } else { "vec3f" };
        format!(
            "const CURVE_START: f32 = {};\nconst CURVE_WIDTH: f32 = {};\n\
             const STEP_BELOW: {kind} = {};\nconst STEP_ABOVE: {kind} = {};\n{}",
            literal(self.start),
            literal(self.width),
            steps(1, 0),
            steps(CELLS - 1, CELLS),
            self.table.shader(),
        )
    }
}

/// A channel's value by Blender's curves; the last curve of a colour comes before the others.
fn value_of(layout: Layout, curves: &[Curve], channel: usize, x: f32) -> f32 {
    curves[channel].value(if layout == Layout::Color { curves[3].value(x) } else { x })
}

/// The evaluator of the three nodes: inputs are a factor and a float, colour or vector.
pub struct Curves {
    mapping: Arc<CurveMapping>,
}

impl Curves {
    /// The evaluator for the curves in the property `mapping` of a mode.
    pub fn new(mode: &Mode) -> Self {
        let Data::Curves(mapping) = mode.data("mapping") else { unreachable!("this property reads curves") };
        Self { mapping: Arc::clone(mapping) }
    }

    fn channels(&self) -> std::ops::Range<usize> {
        0..self.mapping.layout.channels()
    }
}

/// Points that are taken through the steps of the evaluation together.
const ABREAST: usize = 64;

impl Evaluate for Curves {
    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        // Apart from the lookups, the steps hold no decisions and take several points at once.
        let mapping = &*self.mapping;
        for (channel, output) in outputs.iter_mut().enumerate() {
            let output = &mut **output;
            let [factors, values] = [0, 1 + channel].mapped(|column| &inputs[column].values[..output.len()]);
            let batches = output.chunks_mut(ABREAST).zip(factors.chunks(ABREAST)).zip(values.chunks(ABREAST));
            for ((results, factors), values) in batches {
                for (result, &value) in results.iter_mut().zip(values) {
                    *result = mapping.place(value);
                }
                for result in &mut *results {
                    *result = mapping.at(channel, *result);
                }
                for ((result, &factor), &value) in results.iter_mut().zip(factors).zip(values) {
                    *result = (R::of(1.0) - factor) * value + factor * *result;
                }
            }
        }
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let factor = inputs[0];
        for (channel, output) in outputs.iter_mut().enumerate() {
            let value = inputs[1 + channel];
            let curve = self.mapping.enclose(channel, value);
            let plain = (Interval::ONE - factor) * value + factor * curve;
            let between = factor.low >= 0.0 && factor.high <= 1.0 && !factor.may_be_nan;
            let tight = between && value.is_finite() && curve.is_finite();
            *output = if tight { plain.meet(value.lerp(curve, factor)) } else { plain };
        }
    }

    fn simplify_constants(&self, inputs: &[Option<f32>]) -> Option<Simplified> {
        // Where an infinite value leads along an extrapolated curve, the formula gives NaN.
        (inputs[0] == Some(0.0)).then(|| Simplified::Inputs(self.channels().map(|channel| 1 + channel).collect()))
    }

    fn fold_constants(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let factor = inputs[0];
        let mixed = |channel: usize| {
            let value = inputs[1 + channel];
            (1.0 - factor) * value + factor * self.mapping.value(channel, value)
        };
        Some(self.channels().map(mixed).collect())
    }

    fn fold_constants_late(&self, inputs: &[f32]) -> Option<Vec<f32>> {
        let mapping = &*self.mapping;
        let mixed = |channel: usize| {
            let value = inputs[1 + channel];
            // Three components are divided by one number: multiplied by its reciprocal.
            let curve = if mapping.layout == Layout::Float {
                mapping.look_up(channel, value)
            } else {
                mapping.at(channel, (value - mapping.start) * (1.0 / mapping.width))
            };
            value + inputs[0] * (curve - value)
        };
        Some(self.channels().map(mixed).collect())
    }

    fn shader_constants(&self) -> String {
        self.mapping.shader()
    }
}

/// What the comparison with Cycles tries: the default, every handle type, both extensions, clip rectangles within
/// and beyond the points, two to five points, points close together.
pub fn probes(layout: Layout) -> Vec<Json> {
    let sets: [&[(f64, f64, &str)]; 7] = [
        &[(0.0, 0.0, "AUTO"), (1.0, 1.0, "AUTO")],
        &[(0.1, 0.35, "AUTO"), (0.4, 0.2, "AUTO"), (0.85, 0.9, "AUTO")],
        &[
            (0.0, 0.2, "AUTO_CLAMPED"),
            (0.4, 0.9, "AUTO_CLAMPED"),
            (0.6, 0.95, "AUTO_CLAMPED"),
            (1.0, 0.1, "AUTO_CLAMPED"),
        ],
        &[(-0.5, 1.2, "VECTOR"), (0.25, -0.3, "VECTOR"), (1.5, 0.6, "VECTOR")],
        &[
            (0.0, 0.0, "AUTO"),
            (0.2, 0.8, "VECTOR"),
            (0.201, 0.1, "AUTO_CLAMPED"),
            (0.7, 0.3, "AUTO"),
            (1.25, 0.9, "AUTO"),
        ],
        &[(0.2, 0.9, "VECTOR"), (0.7, 0.15, "AUTO")],
        &[(0.15, 0.1, "AUTO_CLAMPED"), (0.55, 0.85, "AUTO"), (0.9, 0.4, "VECTOR"), (0.95, 0.45, "AUTO")],
    ];
    let curve = |set: usize| {
        json!(sets[set % sets.len()].iter().map(|(x, y, handles)| json!([x, y, handles])).collect::<Vec<_>>())
    };
    let unit = [0.0, 0.0, 1.0, 1.0];
    let probe = |extend: &str, use_clip: bool, clip: [f64; 4], first: usize| {
        // Each curve another set; the combined one of colours comes from the other end.
        let curves: Vec<Json> =
            (0..layout.curves()).map(|number| curve(first + if number == 3 { 5 } else { number })).collect();
        json!({"extend": extend, "use_clip": use_clip, "clip": clip, "curves": curves})
    };
    vec![
        layout.default(),
        probe("EXTRAPOLATED", true, unit, 1),
        probe("HORIZONTAL", true, unit, 2),
        probe("EXTRAPOLATED", false, [-0.5, -1.0, 1.5, 2.0], 3),
        probe("HORIZONTAL", false, [-2.0, -2.0, 2.0, 2.0], 4),
        probe("EXTRAPOLATED", true, [0.3, 0.2, 0.6, 0.7], 5),
        probe("HORIZONTAL", true, [0.25, 0.25, 0.75, 0.5], 6),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mapping(layout: Layout, given: &Json) -> Arc<CurveMapping> {
        match CurveMapping::read(Some(given), layout, "mapping").expect("curves") {
            Data::Curves(curves) => curves,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn curves_are_those_of_blender() {
        // `CurveMapping.evaluate` of Blender 5.0.1 at -0.7, 0.33, 0.62, 2.5. The numbers are a probe's.
        let golden: [(usize, [f32; 4]); 7] = [
            (0, [-0.7, 0.33, 0.62, 2.5]),
            (1, [1.200_380_1, 0.193_093_96, 0.327_260_52, 8.310_97]),
            (2, [0.2, 0.839_106_9, 0.948_607_3, 0.100_000_58]),
            (3, [1.6, -0.242_399_98, -0.033_600_003, 1.319_999_7]),
            (4, [0.0, 0.114_970_84, 0.246_837_82, 0.9]),
            (5, [2.25, 0.704_999_9, 0.269_999_77, -2.55]),
            (6, [0.1, 0.647_789_96, 0.843_281_3, 0.45]),
        ];
        for (probe, values) in golden {
            let curves = mapping(Layout::Float, &probes(Layout::Float)[probe]);
            for (x, value) in [-0.7, 0.33, 0.62, 2.5].into_iter().zip(values) {
                assert_eq!(curves.curves[0].value(x), value, "{curves:?} at {x}");
            }
        }
    }

    #[test]
    fn degenerate_handles_are_those_of_blender() {
        let point = |x, y, handles| Point { place: [x, y], handles };
        // The second point's handle lies left of the first point: upright at the start.
        let points = vec![point(0.1, 0.7, "AUTO"), point(0.3, 0.2, "AUTO"), point(0.85, 1.4, "AUTO")];
        let upright = Curve::new(points, [0.0, 1.0], true);
        assert_eq!([-0.7, 0.33, 2.5].map(|x| upright.value(x)), [20_000.7, 0.200_595_33, 58.900_997]);
        // Two points in one place.
        let points = vec![point(0.0, 0.5, "AUTO"), point(0.0, 0.5, "VECTOR"), point(1.0, 1.0, "VECTOR")];
        let doubled = Curve::new(points, [0.0, 1.0], false);
        assert_eq!([-0.7, 0.33, 0.62, 2.5].map(|x| doubled.value(x)), [0.5, 0.664_999_9, 0.809_999_76, 0.999_999_5]);
    }

    #[test]
    fn a_folded_float_curve_is_limited_by_the_clip_rectangle() {
        let mut probe = probes(Layout::Float)[6].clone();
        let clipped = mapping(Layout::Float, &probe);
        assert_eq!([clipped.value(0, -0.7), clipped.value(0, 0.62)], [0.25, 0.5]);
        // What varies is not.
        assert_eq!(clipped.look_up(0, -0.7_f32), 0.1);
        probe["use_clip"] = json!(false);
        assert_eq!(mapping(Layout::Float, &probe).value(0, -0.7), 0.1);
    }

    #[test]
    fn enclosures_hold_values_within_and_beyond_the_table() {
        for layout in [Layout::Float, Layout::Color, Layout::Vector] {
            for probe in probes(layout) {
                let curves = mapping(layout, &probe);
                for (low, high) in [(-3.0, -1.0), (-0.6, 0.3), (0.4, 0.41), (0.9, 2.0), (4.0, 9.0)] {
                    for channel in 0..layout.channels() {
                        let bounds = curves.enclose(channel, Interval::new(low, high));
                        for step in 0..=300 {
                            let x = (low + (high - low) * step as f32 / 300.0).min(high);
                            let value = curves.look_up(channel, x);
                            assert!(bounds.contains(f64::from(value)), "{curves:?} at {x}: {value} in {bounds:?}");
                            let exact = curves.look_up(channel, f64::from(x));
                            assert!(
                                bounds.contains(exact) && (exact - f64::from(value)).abs() < 1e-3,
                                "{exact} {value}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn the_probes_are_described_apart() {
        for layout in [Layout::Float, Layout::Color, Layout::Vector] {
            let mut words: Vec<String> = probes(layout).iter().map(|probe| mapping(layout, probe).describe()).collect();
            words.sort();
            words.dedup();
            assert_eq!(words.len(), probes(layout).len());
        }
    }

    #[test]
    fn wrong_curves_are_refused_at_their_place() {
        for (path, wrong, place) in [
            ("/extend", json!("REPEAT"), "mapping.extend"),
            ("/use_clip", json!(1), "mapping.use_clip"),
            ("/clip", json!([1, 0, 0, 1]), "mapping.clip"),
            ("/curves", json!([]), "mapping.curves"),
            ("/curves/0", json!([[0, 0, "AUTO"]]), "mapping.curves[0]"),
            ("/curves/0", json!([[1, 0, "AUTO"], [0, 0, "AUTO"]]), "mapping.curves[0]"),
            ("/curves/0/0/2", json!("FREE"), "mapping.curves[0][0][2]"),
            ("/curves/0/0", json!([0, 0]), "mapping.curves[0][0]"),
            // One place for all points: the direction beyond the ends is 0 / 0.
            ("/curves/0", json!([[0.5, 0.5, "VECTOR"], [0.5, 0.5, "VECTOR"]]), "mapping"),
        ] {
            let mut value = Layout::Float.default();
            *value.pointer_mut(path).expect("it is there") = wrong;
            let found = CurveMapping::read(Some(&value), Layout::Float, "mapping").expect_err(path);
            assert_eq!(found.place, place);
        }
    }
}
