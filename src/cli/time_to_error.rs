//! `cloudparity time-to-error`: how fast path tracing reaches Cycles' error.

use super::choice::choice;
use crate::base::error::Result;
use crate::cli::parity::SuiteArguments;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::integrators::path::Tracking;
use crate::measure::speed::time_to_error::{TimeSettings, run as measure};
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure how long path tracing takes to the error that Cycles has after so many samples.
///
/// For the entries of a suite with sub-pixel replicas. References come from the cache, else Cycles renders for hours. Times are
/// of the processor, so nothing else should run. Writes OUTPUT/time_to_error.json and .md.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity time-to-error --only linear-ramp -o TIMES")]
pub(super) struct Arguments {
    #[command(flatten)]
    suite: SuiteArguments,
    /// Samples per pixel of Cycles, whose error is to be reached.
    #[arg(long, value_name = "N", value_delimiter = ',', default_values_t = TimeSettings::default().levels,
        value_parser = clap::value_parser!(u32).range(1..=1_048_576))]
    samples: Vec<u32>,
    /// Step rate of Cycles' ray marching, which is a second mode to compare with.
    #[arg(long, default_value_t = 1.0, value_parser = rate)]
    marching_rate: f64,
    /// Leave Cycles' ray marching out.
    #[arg(long, conflicts_with = "marching_rate")]
    without_marching: bool,
    /// How our rays find their collisions.
    #[arg(long, value_parser = choice::<Tracking>(), value_delimiter = ',', default_values_t = TimeSettings::default().trackings)]
    tracking: Vec<Tracking>,
    /// Processor seconds beyond which one of our renders is cut short and taken in proportion.
    #[arg(long, value_name = "SECONDS", default_value_t = TimeSettings::default().longest, value_parser = rate)]
    longest: f64,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR", default_value = "out/time-to-error")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

fn rate(text: &str) -> std::result::Result<f64, String> {
    text.parse().ok().filter(|value: &f64| *value > 0.0 && value.is_finite()).ok_or("not a positive number".to_owned())
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    super::need_bpy("the pictures are")?;
    let what = TimeSettings {
        levels: arguments.samples.clone(),
        marching_rate: (!arguments.without_marching).then_some(arguments.marching_rate),
        trackings: arguments.tracking.clone(),
        longest: arguments.longest,
    };
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let SuiteArguments { suite, only } = &arguments.suite;
    let outcome = measure(suite, only, &arguments.output, &what, &arguments.experiment.settings(), &progress)?;
    bar.finish_and_clear();
    if let Some(found) = whole(outcome) {
        super::print(&found.table())?;
    }
    Ok(ExitCode::SUCCESS)
}
