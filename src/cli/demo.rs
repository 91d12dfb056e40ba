//! `cloudparity demo`: the main job on the committed cloud, ending in a report.

use crate::base::error::Result;
use crate::cli::demonstration;
use crate::cli::demonstration::Settings;
use crate::measure::pictures::Verdict;
use std::path::PathBuf;
use std::process::ExitCode;

/// Probe, render and compare the cloud, and write a report.
///
/// Exit status 0: field and picture agree with Cycles; 1: one of them differs; 2: could not tell.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity demo -o out/demo")]
pub(super) struct Arguments {
    /// The folder for all results.
    #[arg(short, long, value_name = "DIR", default_value = "out/demo")]
    output: PathBuf,
    /// Render the reference in Cycles now (about nine minutes on two cores) instead of taking the
    /// committed one.
    #[arg(long)]
    live: bool,
    /// Leave out the comparison of every mode of every node.
    #[arg(long)]
    without_modes: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    demonstration::check_writable(&arguments.output)?;
    let settings = Settings { output: arguments.output.clone(), live: arguments.live, modes: !arguments.without_modes };
    let bar = super::progress_bar(1000);
    let report = super::progress_on(&bar);
    let outcome = demonstration::run(&settings, &report)?;
    bar.finish_and_clear();
    super::print(&format!("{}\n", outcome.report.display()))?;
    Ok(match (outcome.picture, outcome.field) {
        (Some(Verdict::Differs), _) | (_, Some(false)) => ExitCode::FAILURE,
        (Some(Verdict::Agrees), Some(true)) => ExitCode::SUCCESS,
        _ => ExitCode::from(super::COULD_NOT),
    })
}
