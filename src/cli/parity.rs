//! `cloudparity parity`: a suite of scenes against Cycles, judged by statistics.

use crate::base::error::Result;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::pictures::Verdict;
use crate::measure::pictures::parity;
use std::path::PathBuf;
use std::process::ExitCode;

/// Render every scene of a suite with Cycles and by path tracing, and judge whether they agree.
///
/// References come from the cache. An entry that is done and whose inputs are the same is not repeated.
/// OUTPUT/parity.md and parity.json sum up; OUTPUT/NAME holds the pictures of an entry. Exit status 0: all agree; 1: one
/// differs; 2: could not tell.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity parity --only linear-ramp -o PARITY")]
pub(super) struct Arguments {
    #[command(flatten)]
    suite: SuiteArguments,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR", default_value = "out/parity")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

/// Which entries of which suite.
#[derive(clap::Args)]
pub(super) struct SuiteArguments {
    /// The suite file.
    #[arg(default_value = "parity/parity.suite.json")]
    pub(super) suite: PathBuf,
    /// Only this entry. May be given several times.
    #[arg(long, value_name = "NAME")]
    pub(super) only: Vec<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    super::need_bpy("the pictures are")?;
    let bar = super::progress_bar(1000);
    let report = super::progress_on(&bar);
    let mut told = |result: &parity::EntryResult| {
        let mut line = format!("{}: {}", result.name, result.verdict.words());
        for reason in &result.reasons {
            line += &format!("\n  {reason}");
        }
        bar.suspend(|| eprintln!("{line}"));
    };
    let SuiteArguments { suite, only } = &arguments.suite;
    let settings = arguments.experiment.settings();
    let outcome = parity::run(suite, only, &arguments.output, &settings, &report, &mut told)?;
    bar.finish_and_clear();
    let Some(results) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    super::print(&parity::table(&results))?;
    let worst = Verdict::worst(results.iter().map(|result| result.verdict)).unwrap_or(Verdict::CouldNotTell);
    Ok(ExitCode::from(worst.exit_status()))
}
