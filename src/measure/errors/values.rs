//! Figures of the difference between two evaluations at the same points.
//!
//! The error of a point is the largest |ours - theirs| of its components, divided by
//! max(1, max |theirs|) over all points: relative for fields with large values, absolute for the rest.
//! Errors are taken where both sides are finite. Values are *equal* when their bits are, or both are
//! zero (Cycles' film loses the sign of zero), or both are NaN.

use crate::base::error::{Error, Result};
use serde::Serialize;

/// Points kept in [`Figures::worst`].
const WORST: usize = 5;

/// Whether two values count as the same.
pub fn equal(ours: f32, theirs: f32) -> bool {
    ours.to_bits() == theirs.to_bits() || ours == theirs || (ours.is_nan() && theirs.is_nan())
}

/// Distance of two finite values in units in the last place: how many f32 values lie between.
pub fn ulp_distance(ours: f32, theirs: f32) -> u32 {
    // Bit patterns in the order of the numbers; both zeros are 0.
    let ordered = |value: f32| {
        let bits = value.to_bits() as i32;
        i64::from(if bits < 0 { i32::MIN.wrapping_sub(bits) } else { bits })
    };
    u32::try_from((ordered(ours) - ordered(theirs)).unsigned_abs()).unwrap_or(u32::MAX)
}

/// A comparison with the error of every point, so that several can be joined.
#[derive(Debug, Clone, Default)]
pub struct Comparison {
    /// Seconds of our evaluation.
    pub seconds: f64,
    /// max(1, max |theirs|).
    scale: f64,
    errors: Vec<f64>,
    bounds: Vec<f64>,
    beyond_bounds: usize,
    points: usize,
    differing: usize,
    nonzero: usize,
    one_sided: usize,
    worst: Vec<WorstPoint>,
}

/// One point with a large error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstPoint {
    /// Object-space coordinates.
    pub point: [f32; 3],
    /// Our components.
    pub ours: Value,
    /// The reference's components.
    pub reference: Value,
    /// The error; none where one side is not finite.
    pub error: Option<f64>,
}

/// A number, three numbers, or what JSON has no number for.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Value {
    /// A finite number.
    Number(f32),
    /// NaN or an infinity.
    Text(String),
    /// The components of a vector or colour.
    List(Vec<Value>),
}

impl Value {
    fn new(components: &[f32]) -> Self {
        match components {
            [value] if value.is_finite() => Self::Number(*value),
            [value] => Self::Text(value.to_string()),
            several => Self::List(several.chunks(1).map(Self::new).collect()),
        }
    }
}

/// The figures of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Figures {
    /// Points compared.
    pub points: usize,
    /// Points whose values are not the same.
    pub differing: usize,
    /// Largest error.
    pub max_error: f64,
    /// 99.9th percentile of the error (nearest rank).
    pub p999_error: f64,
    /// Root mean squared error.
    pub rms_error: f64,
    /// Mean error.
    pub mean_error: f64,
    /// Share of points where the reference is not 0.
    pub nonzero_share: f64,
    /// Points where exactly one side is finite.
    pub one_sided_nonfinite: usize,
    /// Seconds of our evaluation.
    pub seconds: f64,
    /// Largest error that agrees, if there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub limit: Option<f64>,
    /// What rounding explains, where it was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rounding_bound: Option<RoundingBound>,
    /// The differing points with the largest errors; those with one finite side first.
    pub worst: Vec<WorstPoint>,
}

/// The derived bound on what two conforming evaluations may differ by, over all points, in the
/// unit of the errors.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RoundingBound {
    /// Median.
    pub median: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Largest; serialises as null where some point has none.
    pub max: f64,
    /// Points whose error is beyond their own bound.
    pub beyond: usize,
}

impl Figures {
    /// Whether this agrees with the reference; none where there is no limit to judge by. An adapter
    /// that fuses may go beyond the limit if every point stays within its own rounding bound.
    pub fn agrees(&self) -> Option<bool> {
        let limit = self.limit?;
        let explained = self.rounding_bound.as_ref().is_some_and(|bound| bound.beyond == 0);
        let within = if limit == 0.0 { self.differing == 0 } else { self.max_error <= limit || explained };
        Some(within && self.one_sided_nonfinite == 0)
    }
}

impl Comparison {
    /// Compares values that hold, point by point, the same number of components.
    pub fn new(positions: &[[f32; 3]], ours: &[f32], theirs: &[f32]) -> Result<Self> {
        let points = positions.len();
        if ours.len() != theirs.len() || points == 0 || !ours.len().is_multiple_of(points) {
            return Err(Error::new(
                "comparison of values",
                format!("{} of ours and {} of the reference for {points} points", ours.len(), theirs.len()),
                "as many components on both sides",
                "Compare the same outputs at the same points.",
            ));
        }
        let width = ours.len() / points;
        let largest = theirs.iter().filter(|value| value.is_finite()).fold(0.0_f64, |m, v| m.max(f64::from(v.abs())));
        let scale = largest.max(1.0);
        let mut found = Self { points, scale, errors: Vec::with_capacity(points), ..Self::default() };
        for ((point, ours), theirs) in positions.iter().zip(ours.chunks(width)).zip(theirs.chunks(width)) {
            let pairs = || ours.iter().copied().zip(theirs.iter().copied());
            found.nonzero += usize::from(theirs.iter().any(|value| *value != 0.0));
            let one_sided = pairs().any(|(a, b)| a.is_finite() != b.is_finite());
            let differs = pairs().any(|(a, b)| !equal(a, b));
            let error = pairs()
                .filter(|(a, b)| a.is_finite() && b.is_finite())
                .fold(0.0_f64, |most, (a, b)| most.max((f64::from(a) - f64::from(b)).abs()))
                / scale;
            found.errors.push(error);
            found.one_sided += usize::from(one_sided);
            if differs {
                found.differing += 1;
                found.worst.push(WorstPoint {
                    point: *point,
                    ours: Value::new(ours),
                    reference: Value::new(theirs),
                    error: (!one_sided).then_some(error),
                });
                // Kept short now and then instead of sorted for every point.
                if found.worst.len() > 1000 {
                    found.keep_worst();
                }
            }
        }
        found.keep_worst();
        Ok(found)
    }

    /// Compares every point's error with the largest one that rounding explains: `bounds` holds as
    /// many components per point as the values.
    pub fn bound(&mut self, bounds: &[f64]) {
        let width = (bounds.len() / self.points.max(1)).max(1);
        let scale = self.scale;
        self.bounds = bounds.chunks(width).map(|point| point.iter().copied().fold(0.0, f64::max) / scale).collect();
        self.beyond_bounds = self.errors.iter().zip(&self.bounds).filter(|(error, bound)| error > bound).count();
    }

    fn keep_worst(&mut self) {
        let rank = |point: &WorstPoint| point.error.unwrap_or(f64::INFINITY);
        self.worst.sort_by(|a, b| rank(b).total_cmp(&rank(a)));
        self.worst.truncate(WORST);
    }

    /// Adds another comparison's points.
    pub fn join(&mut self, other: Self) {
        self.errors.extend(other.errors);
        self.bounds.extend(other.bounds);
        self.beyond_bounds += other.beyond_bounds;
        self.points += other.points;
        self.differing += other.differing;
        self.nonzero += other.nonzero;
        self.one_sided += other.one_sided;
        self.seconds += other.seconds;
        self.worst.extend(other.worst);
        self.keep_worst();
    }

    /// Points whose values are not the same.
    pub fn differing(&self) -> usize {
        self.differing
    }

    /// Reduces to figures; `limit` is the largest error that agrees.
    pub fn figures(mut self, limit: Option<f64>) -> Figures {
        self.errors.sort_by(f64::total_cmp);
        self.bounds.sort_by(f64::total_cmp);
        let count = self.errors.len().max(1) as f64;
        let percentile = |sorted: &[f64], share: f64| {
            let rank = (share * sorted.len() as f64).ceil() as usize;
            sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        let rounding_bound = (!self.bounds.is_empty()).then(|| RoundingBound {
            median: percentile(&self.bounds, 0.5),
            p999: percentile(&self.bounds, 0.999),
            max: percentile(&self.bounds, 1.0),
            beyond: self.beyond_bounds,
        });
        Figures {
            points: self.points,
            differing: self.differing,
            max_error: self.errors.last().copied().unwrap_or(0.0),
            p999_error: percentile(&self.errors, 0.999),
            rms_error: (self.errors.iter().map(|error| error * error).sum::<f64>() / count).sqrt(),
            mean_error: self.errors.iter().sum::<f64>() / count,
            nonzero_share: self.nonzero as f64 / count,
            one_sided_nonfinite: self.one_sided,
            seconds: self.seconds,
            limit,
            rounding_bound,
            worst: self.worst,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figures(ours: &[f32], theirs: &[f32]) -> Figures {
        let positions = vec![[0.0; 3]; ours.len()];
        Comparison::new(&positions, ours, theirs).expect("equal lengths").figures(Some(0.0))
    }

    #[test]
    fn one_unit_in_the_last_place_differs() {
        let found = figures(&[0.5, f32::from_bits(0.5_f32.to_bits() + 1)], &[0.5, 0.5]);
        assert_eq!(found.differing, 1);
        assert_eq!(found.max_error, 2.0_f64.powi(-24));
        assert_eq!(found.agrees(), Some(false));
    }

    #[test]
    fn zeros_and_nans_are_equal_and_one_sided_nan_is_not() {
        assert_eq!(figures(&[-0.0, f32::NAN, f32::INFINITY], &[0.0, f32::NAN, f32::INFINITY]).differing, 0);
        let found = figures(&[f32::NAN, 1.0], &[1.0, 1.0]);
        assert_eq!((found.differing, found.one_sided_nonfinite), (1, 1));
        assert_eq!(found.worst[0].error, None);
    }

    #[test]
    fn errors_are_relative_to_the_largest_reference() {
        let found = figures(&[100.0, 1.5], &[100.0, 1.0]);
        assert_eq!(found.max_error, 0.005);
        assert_eq!(found.mean_error, 0.0025);
    }

    #[test]
    fn ulp_distance_counts_across_zero() {
        assert_eq!(ulp_distance(f32::from_bits(1), -f32::from_bits(1)), 2);
        assert_eq!(ulp_distance(1.0, f32::from_bits(1.0_f32.to_bits() + 3)), 3);
        assert_eq!(ulp_distance(0.0, -0.0), 0);
    }
}
