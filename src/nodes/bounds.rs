//! Intervals: what a node's output can be over a box of inputs.

/// A closed interval of f32 values; every evaluator's value lies within it. NaN is possible only
/// where `may_be_nan` is set.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub low: f32,
    /// Upper end.
    pub high: f32,
    /// The value may also be NaN.
    pub may_be_nan: bool,
}

impl Interval {
    /// No statement at all.
    pub const EVERYTHING: Self = Self { low: f32::NEG_INFINITY, high: f32::INFINITY, may_be_nan: true };

    /// One value.
    pub fn point(value: f32) -> Self {
        Self { low: value, high: value, may_be_nan: value.is_nan() }
    }

    /// From `low` to `high`.
    pub fn new(low: f32, high: f32) -> Self {
        Self { low, high, may_be_nan: false }
    }
}
