//! Brick Texture (`ShaderNodeTexBrick`): rows of bricks with mortar between them.
//!
//! Rows lie along y, z is ignored. Every `squash_frequency`-th row has bricks of another width, every
//! `offset_frequency`-th is shifted along x. Each brick mixes Color1 and Color2 by a hash of its row
//! and column plus Bias; Factor is the share of mortar, 1 at a brick's edge and falling inwards over
//! Mortar Smooth times Mortar Size.
//!
//! The place within a brick is a difference of the *rounded* coordinate and a multiple of the size, so
//! coordinates, sizes and quotients round to f32; see [`Real::round_coordinate`].

mod lanes;

use crate::base::arrays::{Mapped, each};
use crate::nodes::real::Real;
use crate::nodes::{
    Column, Evaluate, InputSocket, Interval, NodeType, OutputSocket, Property, Role, always, vector_at,
};
use crate::scene::{Release, SocketType};

/// Frequencies of the interface start at 1; 0 is legal in a file and means neither offset nor squash.
const FREQUENCIES: [i32; 2] = [0, 99];

/// The node type.
pub static TYPE: NodeType = NodeType {
    type_name: "ShaderNodeTexBrick",
    label: "Brick Texture",
    module: "brick_texture",
    shader: include_str!("../../shaders/nodes/brick_texture.wgsl"),
    properties: &[
        Property::other("texture_mapping"),
        Property::number("offset", 0.5, [0.0, 1.0], &[0.5, 0.3]),
        Property::integer("offset_frequency", 2, FREQUENCIES, &[2, 3]),
        Property::number("squash", 1.0, [0.0, 99.0], &[1.0, 0.7]),
        Property::integer("squash_frequency", 2, FREQUENCIES, &[2, 3]),
    ],
    inputs: &[
        InputSocket::coordinate(always),
        InputSocket::color("Color1", "Color1", &[0.8; 3]),
        InputSocket::color("Color2", "Color2", &[0.2; 3]),
        InputSocket::color("Mortar", "Mortar", &[0.0; 3]),
        InputSocket::float("Scale", "Scale", &[5.0], always),
        InputSocket::float("Mortar Size", "Mortar Size", &[0.02], always),
        InputSocket::float("Mortar Smooth", "Mortar Smooth", &[0.1], always),
        InputSocket::float("Bias", "Bias", &[0.0], always),
        InputSocket::float("Brick Width", "Brick Width", &[0.5], always),
        InputSocket::float("Row Height", "Row Height", &[0.25], always),
    ],
    outputs: &[
        OutputSocket::new("Color", SocketType::Color, always),
        OutputSocket::new("Fac", SocketType::Float, always),
    ],
    role: Role::Evaluated(|mode| {
        Box::new(BrickTexture {
            layout: Layout {
                offset: mode.number("offset"),
                offset_frequency: mode.integer("offset_frequency"),
                squash: mode.number("squash"),
                squash_frequency: mode.integer("squash_frequency"),
            },
            release: mode.release(),
            color: mode.wants("Color"),
            factor: mode.wants("Fac"),
        })
    }),
};

/// First columns of the inputs.
const FIRST_COLOR: usize = 3;
const SECOND_COLOR: usize = 6;
const MORTAR: usize = 9;
const SCALE: usize = 12;
const MORTAR_SIZE: usize = 13;
const MORTAR_SMOOTH: usize = 14;
const BIAS: usize = 15;
const WIDTH: usize = 16;
const HEIGHT: usize = 17;

/// How rows differ.
struct Layout {
    offset: f32,
    offset_frequency: i32,
    squash: f32,
    squash_frequency: i32,
}

impl Layout {
    /// Whether bricks of this row have another width, and whether the row is shifted.
    fn differs(&self, row: i32) -> [bool; 2] {
        if self.offset_frequency == 0 || self.squash_frequency == 0 {
            return [false; 2];
        }
        [row % self.squash_frequency == 0, row % self.offset_frequency == 0]
    }
}

/// The node in one mode.
struct BrickTexture {
    layout: Layout,
    release: Release,
    color: bool,
    factor: bool,
}

/// Random number in [0, 1] of a brick (an integer hash with wrapping arithmetic).
#[inline(always)]
fn brick_value<R: Real>(row: i32, column: i32) -> R {
    const MASK: u32 = 0x7FFF_FFFF;
    let start = ((row as u32) << 16).wrapping_add(column as u32 & 0xFFFF).wrapping_add(1013) & MASK;
    let n = (start >> 13) ^ start;
    let square = n.wrapping_mul(n).wrapping_mul(60_493).wrapping_add(19_990_303);
    R::from_hash_31((n.wrapping_mul(square).wrapping_add(1_376_312_589) & MASK) as i32)
}

/// Number of the step in which a quotient lies, and that number as it is multiplied afterwards: up to Blender 5.0 it is
/// -2^31 outside of i32, see [`Real::to_int`].
#[inline(always)]
fn step_of<R: Real>(quotient: R, release: Release) -> (i32, R) {
    let floor = quotient.round_coordinate().lattice_floor();
    let number = floor.to_int();
    if number == i32::MIN && release < Release::V5_1 { (number, R::of(i32::MIN as f32)) } else { (number, floor) }
}

/// Share of mortar at distance `edge` from the brick's edge.
#[inline(always)]
fn mortar<R: Real>(edge: R, size: R, smooth: R) -> R {
    let (zero, one) = (R::of(0.0), R::of(1.0));
    if edge >= size {
        return zero;
    }
    if smooth == zero {
        return one;
    }
    let g = (one - edge / size) / smooth;
    if g <= zero {
        zero
    } else if g >= one {
        one
    } else {
        R::of(3.0) * (g * g) - (R::of(2.0) * (g * g)) * g
    }
}

/// `a (1 - t) + b t` in the kernel's order.
#[inline(always)]
fn blend<R: Real>(a: [R; 3], b: [R; 3], t: R) -> [R; 3] {
    let rest = R::of(1.0) - t;
    each(|channel| a[channel] * rest + b[channel] * t)
}

impl Evaluate for BrickTexture {
    fn folds_late(&self) -> bool {
        false
    }

    fn evaluate<R: Real>(&self, inputs: &[Column<'_, R>], outputs: &mut [&mut [R]]) {
        for index in 0..outputs[0].len() {
            let at = |column: usize| inputs[column].values[index];
            let [x, y] = [0, 1].mapped(|axis| (at(axis) * at(SCALE)).round_coordinate());
            let (mut width, height) = (at(WIDTH), at(HEIGHT));
            let (row, row_number) = step_of(y / height, self.release);
            let [squashed, shifted] = self.layout.differs(row);
            if squashed {
                width = (width * R::of(self.layout.squash)).round_coordinate();
            }
            let shift = if shifted { (width * R::of(self.layout.offset)).round_coordinate() } else { R::of(0.0) };
            let x = (x + shift).round_coordinate();
            let (column, column_number) = step_of(x / width, self.release);
            let x = x - width * column_number;
            let y = y - height * row_number;
            let edge = x.lesser(y).lesser((width - x).lesser(height - y));
            let share = mortar(edge, at(MORTAR_SIZE), at(MORTAR_SMOOTH));
            let mut next = 0;
            if self.color {
                let mut base = vector_at(inputs, FIRST_COLOR, index);
                if share != R::of(1.0) {
                    let tint = (brick_value::<R>(row, column) + at(BIAS)).saturate();
                    base = blend(base, vector_at(inputs, SECOND_COLOR, index), tint);
                }
                let color = blend(base, vector_at(inputs, MORTAR, index), share);
                for (channel, value) in color.into_iter().enumerate() {
                    outputs[channel][index] = value;
                }
                next = 3;
            }
            if self.factor {
                outputs[next][index] = share;
            }
        }
    }

    fn evaluate_fast(&self, inputs: &[Column<'_, f32>], outputs: &mut [&mut [f32]]) -> bool {
        lanes::evaluate(self, inputs, outputs);
        true
    }

    fn enclose(&self, inputs: &[Interval], outputs: &mut [Interval]) {
        let (factor, color) = self.bounds(inputs);
        let mut next = 0;
        if self.color {
            outputs[..3].copy_from_slice(&color);
            next = 3;
        }
        if self.factor {
            outputs[next] = factor;
        }
    }
}

/// Rows, and columns of a row, that are looked at one by one; beyond, a box counts as holding any brick.
const LARGEST_COUNT: i64 = 12;

/// Error of the smooth step: the roundings of its two terms of at most 3 and 2 are below 11 * 2^-24. The value exceeds
/// 1 by such an amount where the terms round apart; it cannot fall below 0, since fl(2 g^2) g <= fl(3 g^2).
const STEP_ERROR: f64 = 1e-6;

/// Rounding of a quotient and of the place within a step, relative to the quotient; see [`place`].
const PLACE_ERROR: f64 = 1.0 / 1_048_576.0;

/// Error of a blend relative to the sum of its colours' magnitudes: three roundings per term and one of the sum.
const BLEND_ERROR: f64 = 1.0 / 2_097_152.0;

/// Numbers of the steps in which a quotient may lie, if they are few and none is out of range.
fn steps(quotient: Interval) -> Option<std::ops::RangeInclusive<i64>> {
    if !quotient.is_finite() || quotient.magnitude() > 1e9 {
        return None;
    }
    let [first, last] = [quotient.low, quotient.high].mapped(|end| end.floor() as i64);
    (last - first < LARGEST_COUNT).then_some(first..=last)
}

/// Place within step `number` of size `size`, where `quotient` is `coordinate / size`.
///
/// The evaluated quotient is within 2.5 ulp of the true one and its floor is the step, so the place is in [0, size] up to
/// 2.5 ulp of the quotient in units of the size; product and difference add less than 2 ulp. An ulp is at most 2^-23 of
/// the quotient: together below 2^-20 of it.
fn place(coordinate: Interval, size: Interval, number: i64, quotient: Interval) -> Interval {
    let error = (PLACE_ERROR * (quotient.magnitude() + 2.0)) as f32;
    let within = size * Interval::new(-error, 1.0 + error);
    (coordinate - size * Interval::point(number as f32)).meet(within)
}

/// [`place`] and what is left to the far edge, whichever is less: at most half the size.
fn edge_distance(place: Interval, size: Interval, quotient: Interval) -> Interval {
    let error = PLACE_ERROR * (quotient.magnitude() + 2.0) * size.magnitude();
    let [low, high] = (size * Interval::point(0.5)).ends();
    let half = Interval::with_error(low.min(0.0), high.max(0.0), error, false);
    let nearer = place.lesser(size - place);
    Interval { high: nearer.high.min(half.high).max(nearer.low), ..nearer }
}

/// [`mortar`] for finite intervals. No input makes it NaN then: `edge / size` is never 0 / 0, since an edge distance of at
/// least the size ends the evaluation, and an infinite quotient gives 0 or 1.
fn mortar_bounds(edge: Interval, size: Interval, smooth: Interval) -> Interval {
    let mut result: Option<Interval> = None;
    let mut add = |part: Interval| result = Some(result.map_or(part, |known| known.hull(part)));
    if edge.high >= size.low {
        add(Interval::ZERO);
    }
    if edge.low < size.high {
        if smooth.has_zero() {
            add(Interval::ONE);
        }
        if smooth.as_point() != Some(0.0) {
            let edge = Interval { high: edge.high.min(size.high), ..edge };
            let g = if size.has_zero() || smooth.has_zero() {
                Interval::new(f32::NEG_INFINITY, f32::INFINITY)
            } else {
                (Interval::ONE - edge.divide(size)).divide(smooth)
            };
            if g.high <= 0.0 {
                add(Interval::ZERO);
            } else if g.low >= 1.0 {
                add(Interval::ONE);
            } else {
                let step = |g: f32| {
                    let g = f64::from(g).clamp(0.0, 1.0);
                    3.0 * g * g - 2.0 * g * g * g
                };
                let share = Interval::with_error(step(g.low), step(g.high), STEP_ERROR, false);
                add(Interval { low: share.low.max(0.0), ..share });
            }
        }
    }
    result.unwrap_or(Interval::UNIT)
}

/// [`blend`] of one channel. Linear in each argument, hence extreme at corners; where a colour is not finite, by
/// interval arithmetic, which knows that 0 times infinity is NaN.
fn blend_bounds(a: Interval, b: Interval, t: Interval) -> Interval {
    if ![a, b, t].iter().all(|x| x.low.is_finite() && x.high.is_finite()) {
        return a * (Interval::ONE - t) + b * t;
    }
    let nan = a.may_be_nan || b.may_be_nan || t.may_be_nan;
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for t in t.ends() {
        for a in a.ends() {
            for b in b.ends() {
                let value = a * (1.0 - t) + b * t;
                (low, high) = (low.min(value), high.max(value));
            }
        }
    }
    Interval::with_error(low, high, BLEND_ERROR * (a.magnitude() + b.magnitude()), nan)
}

impl BrickTexture {
    /// Enclosures of the factor and the colour.
    fn bounds(&self, inputs: &[Interval]) -> (Interval, [Interval; 3]) {
        if let Some(found) = self.bounds_by_brick(inputs) {
            return found;
        }
        // Any brick, any distance. Up to Blender 5.0 NaN comes from what is not finite only: a division of 0 by 0 gives the brick
        // number -2^31 and a place that is a number. Since 5.1 that number is what the division gives.
        let p = [0, 1].mapped(|axis| inputs[axis] * inputs[SCALE]);
        let width = inputs[WIDTH] * Interval::point(self.layout.squash.max(1.0));
        let shifted = p[0] + width;
        // The product with a brick number of up to 2^31 may overflow, and the difference of infinities is NaN.
        let sizes = [width, inputs[HEIGHT]];
        let nan = ![p[0], p[1], shifted, inputs[MORTAR_SIZE], inputs[MORTAR_SMOOTH]].iter().all(|x| x.is_finite())
            || sizes.iter().any(|size| !size.is_finite() || size.magnitude() > 1e29)
            || (self.release >= Release::V5_1 && !self.has_numbers([shifted.hull(p[0]), p[1]], inputs));
        let share = Interval::new(0.0, 1.0 + 2.0 * STEP_ERROR as f32).or_nan(nan);
        (share, self.color_bounds(inputs, share, Interval::UNIT))
    }

    /// Whether no quotient of a coordinate and a size is NaN or infinite.
    fn has_numbers(&self, place: [Interval; 2], inputs: &[Interval]) -> bool {
        let squashed = inputs[WIDTH] * Interval::point(self.layout.squash);
        let is_number = |place: Interval, size: Interval| !size.flushed().has_zero() && place.divide(size).is_finite();
        is_number(place[0], inputs[WIDTH]) && is_number(place[0], squashed) && is_number(place[1], inputs[HEIGHT])
    }

    /// Brick by brick, where there are few and all numbers are of ordinary size.
    fn bounds_by_brick(&self, inputs: &[Interval]) -> Option<(Interval, [Interval; 3])> {
        let p = [0, 1].mapped(|axis| inputs[axis] * inputs[SCALE]);
        let (width, height) = (inputs[WIDTH], inputs[HEIGHT]);
        let (size, smooth) = (inputs[MORTAR_SIZE], inputs[MORTAR_SMOOTH]);
        let ordinary = |x: &Interval| x.is_finite() && x.magnitude() < 1e15;
        let is_size = |x: Interval| !x.has_zero() && x.low.abs().min(x.high.abs()) > 1e-15;
        if ![p[0], p[1], width, height, size, smooth].iter().all(ordinary) || !is_size(height) {
            return None;
        }
        let rows = p[1].divide(height);
        let mut found: Option<(Interval, [Interval; 3])> = None;
        for row in steps(rows)? {
            let y = edge_distance(place(p[1], height, row, rows), height, rows);
            let [squashed, shifted] = self.layout.differs(row as i32);
            let width = if squashed { width * Interval::point(self.layout.squash) } else { width };
            if !is_size(width) {
                return None;
            }
            let x = if shifted { p[0] + width * Interval::point(self.layout.offset) } else { p[0] };
            let columns = x.divide(width);
            for column in steps(columns)? {
                let x = edge_distance(place(x, width, column, columns), width, columns);
                let share = mortar_bounds(x.lesser(y), size, smooth);
                // The conversion of the hash rounds by half an ulp, in WGSL by one: covered by the addition's pad.
                let value = Interval::point(brick_value(row as i32, column as i32)) * Interval::ONE;
                let tint = (value + inputs[BIAS]).saturate();
                let color = self.color_bounds(inputs, share, tint);
                found = Some(match found {
                    None => (share, color),
                    Some((known, colors)) => (known.hull(share), each(|channel| colors[channel].hull(color[channel]))),
                });
            }
        }
        found
    }

    fn color_bounds(&self, inputs: &[Interval], share: Interval, tint: Interval) -> [Interval; 3] {
        each(|channel| {
            let first = inputs[FIRST_COLOR + channel];
            let mut base = blend_bounds(first, inputs[SECOND_COLOR + channel], tint);
            if share.high >= 1.0 {
                base = base.hull(first);
            }
            blend_bounds(base, inputs[MORTAR + channel], share)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::Oracle;

    fn node(offset: f32, offset_frequency: i32, squash: f32, squash_frequency: i32) -> BrickTexture {
        let layout = Layout { offset, offset_frequency, squash, squash_frequency };
        BrickTexture { layout, release: Release::V5_0, color: true, factor: true }
    }

    /// Colour and factor with the given colours at a place in the plane, all else by default but for changes.
    fn at<R: Real>(node: &BrickTexture, x: f32, y: f32, changes: &[(usize, f32)]) -> [R; 4] {
        let mut values = [0.0; 18];
        (values[0], values[1]) = (x, y);
        for (first, color) in [(FIRST_COLOR, 0.8), (SECOND_COLOR, 0.2), (MORTAR, 0.0)] {
            values[first..first + 3].fill(color);
        }
        values[SCALE..].copy_from_slice(&[5.0, 0.02, 0.1, 0.0, 0.5, 0.25]);
        for (column, value) in changes {
            values[*column] = *value;
        }
        let values = values.map(|value| [R::of(value)]);
        let columns = values.each_ref().map(|values| Column { values, uniform: true });
        let mut outputs = [[R::of(0.0)]; 4];
        node.evaluate(&columns, &mut outputs.each_mut().map(|output| &mut output[..]));
        outputs.map(|[value]| value)
    }

    #[test]
    fn golden_points_are_mortar() {
        let node = node(0.5, 2, 1.0, 2);
        for [x, y] in [[0.3, 0.7], [-2.6, 5.15]] {
            assert_eq!(at::<f32>(&node, x, y, &[]), [0.0, 0.0, 0.0, 1.0]);
            assert_eq!(at::<Oracle>(&node, x, y, &[])[3], Oracle(1.0));
        }
    }

    #[test]
    fn rows_follow_their_frequencies_below_zero_too() {
        // Numbers of the rows that are squashed and of those that are shifted.
        let rows = |offset_frequency, squash_frequency| {
            let layout = node(0.5, offset_frequency, 0.7, squash_frequency).layout;
            [0, 1].map(|which| (-4..=4).filter(|row| layout.differs(*row)[which]).collect::<Vec<i32>>())
        };
        assert_eq!(rows(2, 3), [vec![-3, 0, 3], vec![-4, -2, 0, 2, 4]]);
        for [offset, squash] in [[0, 3], [2, 0]] {
            assert!(rows(offset, squash).iter().all(Vec::is_empty));
        }
        // The middle of the brick from 0 to 0.5 in row 1 is an edge in row 0, which is shifted by half a brick.
        let node = node(0.5, 2, 1.0, 2);
        assert_eq!(at::<f32>(&node, 0.05, 0.075, &[])[3], 0.0);
        assert_eq!(at::<f32>(&node, 0.05, 0.025, &[])[3], 1.0);
    }

    #[test]
    fn sizes_of_zero_are_mortar_or_none() {
        let node = node(0.5, 2, 1.0, 2);
        assert_eq!(at::<f32>(&node, 0.05, 0.075, &[(WIDTH, 0.0)])[3], 1.0);
        assert_eq!(at::<f32>(&node, 0.05, 0.075, &[(HEIGHT, 0.0)])[3], 1.0);
        assert_eq!(at::<f32>(&node, 0.301, 0.7013, &[(MORTAR_SIZE, 0.0)])[3], 0.0);
        assert_eq!(at::<f32>(&node, f32::NAN, 0.5, &[])[3], 1.0);
        assert!(at::<f32>(&node, 0.301, f32::NAN, &[])[3].is_nan());
    }

    #[test]
    fn a_box_inside_a_brick_has_its_color() {
        let node = node(0.5, 2, 1.0, 2);
        let mut inputs = [Interval::ZERO; 18];
        (inputs[0], inputs[1]) = (Interval::new(0.04, 0.06), Interval::new(0.07, 0.08));
        for (first, color) in [(FIRST_COLOR, 0.8), (SECOND_COLOR, 0.2), (MORTAR, 0.0)] {
            inputs[first..first + 3].fill(Interval::point(color));
        }
        for (column, value) in [5.0, 0.02, 0.1, 0.0, 0.5, 0.25].into_iter().enumerate() {
            inputs[SCALE + column] = Interval::point(value);
        }
        let mut outputs = [Interval::EVERYTHING; 4];
        node.enclose(&inputs, &mut outputs);
        assert_eq!(outputs[3].as_point(), Some(0.0));
        let [red, ..] = at::<f32>(&node, 0.05, 0.075, &[]);
        assert!(outputs[0].contains(f64::from(red)) && outputs[0].high - outputs[0].low < 1e-5, "{:?}", outputs[0]);
    }
}
