//! The Pareto front, the settings that nothing beats: those for which no other is both faster and closer to the truth.

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::measure::study::Measured;

choice! {
    "snake_case",
    /// An error by which runs are compared.
    pub enum Metric {
        /// Relative mean squared error.
        Relmse,
        /// Root of the mean squared error.
        Rms,
        /// HDR-FLIP.
        Flip,
    }
}

impl Metric {
    /// The error of a run; none where it was not computed.
    pub fn of(self, run: &Measured) -> Option<f64> {
        match self {
            Self::Relmse => Some(run.errors.relmse.value),
            Self::Rms => Some(run.errors.rms.value),
            Self::Flip => run.flip,
        }
    }
}

/// The runs that no other run beats in both time and error, by rising time.
pub fn pareto_front<'a>(runs: impl IntoIterator<Item = &'a Measured>, metric: Metric) -> Vec<&'a Measured> {
    let mut all: Vec<(&Measured, f64)> = runs
        .into_iter()
        .filter_map(|run| Some((run, metric.of(run)?)))
        .filter(|(_, error)| error.is_finite())
        .collect();
    all.sort_by(|a, b| a.0.seconds.median.total_cmp(&b.0.seconds.median).then(a.1.total_cmp(&b.1)));
    let mut best = f64::INFINITY;
    all.retain(|(_, error)| {
        let is_better = *error < best;
        best = best.min(*error);
        is_better
    });
    all.into_iter().map(|(run, _)| run).collect()
}

/// What a user can afford.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Budget {
    /// Seconds of processor time.
    Seconds(f64),
    /// An error.
    Error(f64),
}

/// The run of a Pareto front that a budget allows: the least error in a time, or the shortest time for an error.
pub fn recommend<'a>(front: &[&'a Measured], metric: Metric, budget: Budget) -> Result<&'a Measured> {
    let found = match budget {
        Budget::Seconds(most) => front.iter().rev().find(|run| run.seconds.median <= most),
        Budget::Error(most) => front.iter().find(|run| metric.of(run).is_some_and(|error| error <= most)),
    };
    found.copied().ok_or_else(|| {
        let (place, found, expected) = match (budget, front.first(), front.last()) {
            (_, None, _) | (_, _, None) => {
                ("the Pareto front", "no run with this error".to_owned(), "at least one run".to_owned())
            }
            (Budget::Seconds(most), Some(first), _) => (
                "the time that is allowed",
                format!("{:.3} ms", 1e3 * most),
                format!("at least the {:.3} ms of the fastest run", 1e3 * first.seconds.median),
            ),
            (Budget::Error(most), _, Some(last)) => (
                "the error that is allowed",
                format!("{most}"),
                format!("at least the {:.4} of the closest run", metric.of(last).unwrap_or(f64::NAN)),
            ),
        };
        Error::new(place, found, expected, "Allow more, or study other settings.")
    })
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::run_of;
    use super::*;

    #[test]
    fn the_front_holds_what_nothing_beats() {
        let runs = [
            run_of(1.0, 0.5),
            run_of(2.0, 0.6),
            run_of(3.0, 0.2),
            run_of(3.0, 0.3),
            run_of(9.0, 0.2),
            run_of(0.5, 0.9),
        ];
        let front = pareto_front(&runs, Metric::Relmse);
        let times: Vec<f64> = front.iter().map(|run| run.seconds.median).collect();
        assert_eq!(times, [0.5, 1.0, 3.0]);
        let time = |budget| recommend(&front, Metric::Relmse, budget).map(|run| run.seconds.median);
        assert_eq!(time(Budget::Seconds(2.5)).expect("one fits"), 1.0);
        assert_eq!(time(Budget::Error(0.5)).expect("one fits"), 1.0);
        assert_eq!(time(Budget::Error(0.2)).expect("one fits"), 3.0);
        assert!(time(Budget::Seconds(0.1)).expect_err("too fast").expected.contains("500.000 ms"));
        assert!(time(Budget::Error(0.1)).expect_err("too close").expected.contains("0.2"));
        assert!(recommend(&[], Metric::Relmse, Budget::Seconds(1.0)).is_err());
        assert!(pareto_front(&runs, Metric::Flip).is_empty());
    }
}
