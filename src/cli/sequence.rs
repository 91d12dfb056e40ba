//! `cloudparity measure sequence`: frames from fewer rays, and from frames before.

use crate::base::error::Result;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::sequence::measure;
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure what making frames from fewer rays, or with those before, costs and saves in a moving sequence: half and quarter resolution,
/// checkerboard, 4 x 4 upscaling, temporal blend.
///
/// Each way of a sequence file is gone through under each motion, beside the same engine without it and path tracing of single frames. Writes
/// sequence.json and sequence.csv: error, flicker, lag and time; what was interrupted goes on.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity sequence CLOUD.sequence.toml -o SEQUENCE")]
pub(super) struct Arguments {
    /// The sequence file (*.sequence.toml).
    file: PathBuf,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let outcome = measure(&arguments.file, &arguments.output, &arguments.experiment.settings(), &progress)?;
    bar.finish_and_clear();
    let Some(results) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    super::print(&results.summary())?;
    Ok(ExitCode::SUCCESS)
}
