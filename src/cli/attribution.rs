//! `cloudparity measure attribution`: which stage of an engine makes its difference from path tracing.

use crate::base::error::Result;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::attribution::measure;
use std::path::PathBuf;
use std::process::ExitCode;

/// Share the error of engines out among the stages of their pictures: field, transmittance to the sun, phase function, orders of scattering, light
/// of the world, view ray, pixel filter, compositing, display.
///
/// Each stage is replaced by its exact twin, in all orders of replacement or in some that are drawn (Shapley values), so that the shares add up to
/// the whole error. Writes attribution.json and attribution.csv, a map per stage, and the figure (attribution.svg, .png, .pdf); what was
/// interrupted goes on.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity attribution CLOUD.attribution.toml -o ATTRIBUTION")]
pub(super) struct Arguments {
    /// The attribution file (*.attribution.toml).
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
    results.draw(&arguments.output)?;
    Ok(ExitCode::SUCCESS)
}
