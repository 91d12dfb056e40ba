//! Tables of 257 entries over [0, 1]: what Cycles evaluates of ramps and curves.
//!
//! The entries are computed once, in f32, as Blender does. Between two entries a lookup interpolates
//! linearly, or takes the lower one.
//!
//! In WGSL a table is an array that a function copies into a variable, because not every language that it is
//! translated to can index a constant. (A variable of the whole module would do, but WGSL promises 8 KiB for
//! all of those together, which is less than two tables.) Ends where nothing changes are left out, and a
//! table that is a straight line or a few steps needs no array at all.

use crate::base::arrays::{Mapped, each};
use crate::nodes::bounds::Interval;
use crate::nodes::real::Real;
use std::fmt::Write;

/// Cells of a table; it has one entry more.
pub const CELLS: usize = 256;

/// Steps up to which a shader compares instead of reading an array. A ramp has at most 32 stops.
const LONGEST_CHAIN: usize = 34;

/// What rounding may change in a lookup, relative to the largest entry: four roundings, fused or not.
const ROUNDING: f64 = 1e-6;

/// A table of one or several channels.
#[derive(Clone, PartialEq)]
pub struct Table {
    /// Entries of each channel.
    channels: Vec<Vec<f32>>,
    /// The same entry by entry for a table of four channels, whose lookups read them all; the last one twice.
    rows: Option<Box<[[f32; 4]; CELLS + 2]>>,
    interpolates: bool,
    /// Half of the largest difference between neighbours, per channel.
    half_steps: Vec<f32>,
}

/// A position in a table.
#[derive(Clone, Copy)]
pub struct TablePosition<R> {
    index: usize,
    /// From 0, at the entry, to 1.
    rest: R,
    /// 0, with twice the uncertainty of the place for number types that carry one.
    doubt: R,
}

impl Table {
    /// The table whose entry number i has the channels `entry(i)`.
    pub fn new(channels: usize, interpolates: bool, entry: impl Fn(usize) -> Vec<f32>) -> Self {
        let rows: Vec<Vec<f32>> = (0..=CELLS).map(entry).collect();
        let channels: Vec<Vec<f32>> =
            (0..channels).map(|channel| rows.iter().map(|row| row[channel]).collect()).collect();
        let largest = |entries: &[f32]| {
            entries
                .windows(2)
                .map(|pair| 0.5 * pair[1] - 0.5 * pair[0])
                .fold(0.0, |most: f32, step| most.max(step.abs()))
        };
        let half_steps = channels.iter().map(|entries| largest(entries)).collect();
        let row = |index: usize| each(|channel| rows[index.min(CELLS)][channel]);
        let rows = (channels.len() == 4).then(|| Box::new(each(row)));
        Self { channels, rows, interpolates, half_steps }
    }

    /// Entries of a channel.
    pub fn entries(&self, channel: usize) -> &[f32] {
        &self.channels[channel]
    }

    /// Whether no entry is infinite or NaN.
    pub fn is_finite(&self) -> bool {
        self.channels.iter().flatten().all(|entry| entry.is_finite())
    }

    /// A factor in cells: below 0 and for NaN at the first entry, above 1 at the last one.
    #[inline(always)]
    pub fn position<R: Real>(factor: R) -> R {
        factor.saturate() * R::of(CELLS as f32)
    }

    /// Where a factor reads.
    #[inline]
    pub fn place<R: Real>(&self, factor: R) -> TablePosition<R> {
        let position = Self::position(factor);
        let cell = position.to_int();
        self.place_of(position, cell, position - R::of(cell as f32))
    }

    /// Where a position from 0 to 256 reads, with the number of its cell, `position.to_int()`, and the rest above it.
    #[inline(always)]
    pub fn place_of<R: Real>(&self, position: R, cell: i32, rest: R) -> TablePosition<R> {
        let index = cell.clamp(0, CELLS as i32) as usize;
        // A lookup is continuous, or it jumps at every entry: either way the neighbouring cell counts too.
        #[allow(clippy::eq_op, reason = "zero as a number, but not as a bound of its error")]
        let doubt = match (R::IS_PLAIN, self.interpolates) {
            (true, _) => R::of(0.0),
            (false, true) => rest - rest,
            (false, false) => position.floor() - position.floor(),
        };
        TablePosition { index, rest, doubt }
    }

    /// A channel's value at a place.
    #[inline]
    pub fn value<R: Real>(&self, channel: usize, place: TablePosition<R>) -> R {
        let entries = &self.channels[channel];
        let value = self.between(place.rest, entries[place.index], entries[(place.index + 1).min(CELLS)]);
        self.doubted(channel, place, value)
    }

    /// The values of all channels of a table of four. Panics for another table.
    #[inline(always)]
    pub fn values<R: Real>(&self, place: TablePosition<R>) -> [R; 4] {
        let rows = self.rows.as_ref().expect("a table of four channels");
        // (The index is below already; here a compiler sees it.)
        let index = place.index.min(CELLS);
        let (low, high) = (rows[index], rows[index + 1]);
        let value = |channel: usize| self.between(place.rest, low[channel], high[channel]);
        let values: [R; 4] = each(value);
        if R::IS_PLAIN { values } else { each(|channel| self.doubted(channel, place, values[channel])) }
    }

    /// The value between two entries. Both count only where the place is beyond the first: 0 times an entry may be -0.
    #[inline(always)]
    fn between<R: Real>(&self, rest: R, low: f32, high: f32) -> R {
        let (low, high) = (R::of(low), R::of(high));
        let mixed = (R::of(1.0) - rest) * low + rest * high;
        if self.interpolates && rest > R::of(0.0) { mixed } else { low }
    }

    /// The value with the doubt of its place, for numbers that carry one.
    #[inline(always)]
    fn doubted<R: Real>(&self, channel: usize, place: TablePosition<R>, value: R) -> R {
        if R::IS_PLAIN { value } else { value - place.doubt * R::of(self.half_steps[channel]) }
    }

    /// Encloses a channel's values for the factors of an interval.
    pub fn enclose(&self, channel: usize, factor: Interval) -> Interval {
        let entries = &self.channels[channel];
        // Scaling by 256 is exact.
        let [first, last] = factor.saturate().ends().mapped(|end| end * CELLS as f64);
        let (from, to) = (first as usize, last as usize);
        let extremes = |entries: &[f32]| {
            entries.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &x| (low.min(x), high.max(x)))
        };
        if !self.interpolates {
            let (low, high) = extremes(&entries[from..=to]);
            return Interval::new(low, high).flushed();
        }
        let at = |position: f64, index: usize| {
            let t = position - index as f64;
            let [low, high] = [index, (index + 1).min(CELLS)].mapped(|index| f64::from(entries[index]));
            (1.0 - t) * low + t * high
        };
        // Corners within the interval, and its ends.
        let corners = &entries[(from + 1).min(to + 1)..=to];
        let (low, high) = extremes(corners);
        let ends = [at(first, from), at(last, to)];
        let low = ends.into_iter().fold(f64::from(low), f64::min);
        let high = ends.into_iter().fold(f64::from(high), f64::max);
        let (least, most) = extremes(&entries[from..=last.ceil() as usize]);
        let error = ROUNDING * f64::from(least.abs().max(most.abs()));
        let found = Interval::with_error(low, high, error, false);
        // A mean of entries that are not negative is not either, however it is rounded.
        if least >= 0.0 { Interval { low: found.low.max(0.0), ..found } } else { found }
    }

    /// The WGSL function `table_value`: the value at a position from 0 to 256. Of three channels each has a
    /// position of its own, as components of a vector.
    pub fn shader(&self) -> String {
        let kind = self.kind();
        let position = if self.channels.len() == 3 { kind } else { "f32" };
        let head = format!("fn table_value(position: {position}) -> {kind} {{\n");
        let row = |index: usize| self.row(index);
        let same = |a: usize, b: usize| self.channels.iter().all(|entries| entries[a] == entries[b]);
        let first = (1..=CELLS).find(|&index| !same(0, index)).map_or(CELLS, |index| index - 1);
        let last = (0..CELLS).rev().find(|&index| !same(CELLS, index)).map_or(0, |index| index + 1);
        if first >= last {
            return format!("{head}    return {};\n}}\n", row(0));
        }
        let starts: Vec<usize> = (first + 1..=last).filter(|&index| !same(index - 1, index)).collect();
        if !self.interpolates && starts.len() < LONGEST_CHAIN {
            let mut text = head;
            for &start in &starts {
                line(
                    &mut text,
                    format_args!("    if position < {start}.0 {{\n        return {};\n    }}", row(start - 1)),
                );
            }
            line(&mut text, format_args!("    return {};\n}}", row(last)));
            return text;
        }
        let place = |limits: [usize; 2]| {
            let [low, high] =
                limits.map(|index| if position == "f32" { format!("{index}.0") } else { format!("{kind}({index}.0)") });
            format!("clamp(position, {low}, {high}) - {low}")
        };
        if self.interpolates && self.is_line(first, last) {
            return format!(
                "{head}    let t = ({}) * {:?}f;\n    return (1.0 - t) * {} + t * {};\n}}\n",
                place([first, last]),
                1.0 / (last - first) as f32,
                row(first),
                row(last),
            );
        }
        let count = last - first + 1;
        let rows: Vec<String> = (first..=last).map(|index| format!("    {},\n", row(index))).collect();
        let mut text =
            format!("const TABLE: array<{kind}, {count}> = array<{kind}, {count}>(\n{});\n\n", rows.concat());
        line(&mut text, format_args!("{head}    var table = TABLE;\n    let place = {};", place([first, last])));
        let top = if self.interpolates { count - 2 } else { count - 1 };
        let whole = if position == "f32" { "i32" } else { "vec3i" };
        line(&mut text, format_args!("    let cell = clamp({whole}(place), {whole}(0), {whole}({top}));"));
        text += match (self.interpolates, self.channels.len()) {
            (false, _) => "    return table[cell];\n}\n",
            (true, 3) => {
                "    let t = place - vec3f(cell);
    let low = vec3f(table[cell.x].x, table[cell.y].y, table[cell.z].z);
    let high = vec3f(table[cell.x + 1].x, table[cell.y + 1].y, table[cell.z + 1].z);
    return (1.0 - t) * low + t * high;
}
"
            }
            (true, _) => {
                "    let t = place - f32(cell);
    return (1.0 - t) * table[cell] + t * table[cell + 1];
}
"
            }
        };
        text
    }

    /// WGSL type of an entry.
    fn kind(&self) -> &'static str {
        match self.channels.len() {
            1 => "f32",
            3 => "vec3f",
            _ => "vec4f",
        }
    }

    /// An entry as WGSL.
    fn row(&self, index: usize) -> String {
        vector(&self.channels.iter().map(|entries| entries[index]).collect::<Vec<_>>())
    }

    /// Whether the entries between two lie on the straight line through these exactly.
    fn is_line(&self, first: usize, last: usize) -> bool {
        self.channels.iter().all(|entries| {
            let [start, end] = [first, last].mapped(|index| f64::from(entries[index]));
            (first..=last).all(|index| {
                (f64::from(entries[index]) - start) * (last - first) as f64 == (end - start) * (index - first) as f64
            })
        })
    }
}

/// A number as WGSL. Subnormal ones count as 0, as for every implementation that flushes them.
pub fn literal(value: f32) -> String {
    if value.is_subnormal() { "0.0f".to_owned() } else { format!("{value:?}f") }
}

/// One number, or a vector of three or four, as WGSL.
pub fn vector(values: &[f32]) -> String {
    let parts: Vec<String> = values.iter().map(|&value| literal(value)).collect();
    if let [one] = parts.as_slice() {
        return one.clone();
    }
    format!("vec{}f({})", parts.len(), parts.join(", "))
}

fn line(text: &mut String, parts: std::fmt::Arguments<'_>) {
    writeln!(text, "{parts}").expect("writing to a string cannot fail");
}

#[cfg(test)]
mod tests {
    use super::super::RunningError;
    use super::*;

    /// Zero up to the middle, then steep and bent.
    fn bent(interpolates: bool) -> Table {
        Table::new(1, interpolates, |index| vec![((index as f32 - 128.0) * 0.25).max(0.0).powi(2)])
    }

    #[test]
    fn enclosures_hold_values_and_touch_them() {
        for table in [bent(true), bent(false)] {
            for (low, high) in [(0.0, 0.3), (0.499, 0.502), (0.7, 0.7), (0.9, 3.0), (-1.0, 1.0)] {
                let bounds = table.enclose(0, Interval::new(low, high));
                let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
                for step in 0..=1000 {
                    let value = table.value(0, table.place((low + (high - low) * step as f32 / 1000.0).min(high)));
                    assert!(bounds.contains(f64::from(value)), "{value} in {bounds:?}");
                    (least, most) = (least.min(value), most.max(value));
                }
                assert!(bounds.low >= least - 0.01 && bounds.high <= most + 0.01, "{bounds:?} for {least} to {most}");
            }
            assert_eq!(table.enclose(0, Interval::new(-5.0, 0.5)).as_point(), Some(0.0));
            assert_eq!(table.enclose(0, Interval::EVERYTHING).low, 0.0);
        }
    }

    #[test]
    fn nan_reads_the_first_entry() {
        let table = Table::new(1, true, |index| vec![3.0 + index as f32]);
        assert_eq!(table.value(0, table.place(f32::NAN)), 3.0);
        assert_eq!(table.value(0, table.place(f32::INFINITY)), 259.0);
        assert_eq!(table.enclose(0, Interval::new(0.5, 1.0).or_nan(true)).low.round(), 3.0);
    }

    #[test]
    fn a_place_next_to_a_step_is_uncertain() {
        // An error of a few roundings around the entry 0.75.
        let x = RunningError::of(0.1) * RunningError::of(7.5);
        assert_eq!(x.value(), 0.75);
        let stepped = bent(false);
        let found = stepped.value(0, stepped.place(x));
        let step = stepped.entries(0)[192] - stepped.entries(0)[191];
        assert!(found.between_evaluations() >= f64::from(step));
        // Interpolated, the entry 0.5 is flat on one side and rises on the other.
        let x = RunningError::of(0.1) * RunningError::of(5.0);
        let smooth = bent(true);
        assert_eq!(smooth.value(0, smooth.place(x)).value(), 0.0);
        assert!(smooth.value(0, smooth.place(x)).between_evaluations() > 0.0);
    }

    #[test]
    fn shaders_leave_out_what_does_not_change() {
        let text = bent(true).shader();
        assert!(text.contains("array<f32, 129>") && text.contains("clamp(position, 128.0, 256.0) - 128.0"), "{text}");
        let line = Table::new(4, true, |index| vec![index as f32 / 256.0, 1.0, 0.0, 0.5]).shader();
        assert!(!line.contains("array") && line.contains("* 0.00390625f"), "{line}");
        let steps = Table::new(4, false, |index| vec![(index / 100) as f32; 4]).shader();
        assert!(!steps.contains("array") && steps.contains("position < 100.0") && steps.contains("position < 200.0"));
        assert!(Table::new(3, true, |_| vec![1.0, 2.0, 3.0]).shader().contains("return vec3f(1.0f, 2.0f, 3.0f);"));
        assert_eq!(literal(1e-40), "0.0f");
    }
}
