//! `cloudparity report`: the pages of a run directory.

use crate::base::error::Result;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write index.html, report.md and figures.csv from what a run directory holds; print the page's path.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The run directory.
    directory: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let page = crate::report::write_report(&arguments.directory)?;
    super::print(&format!("{}\n", page.display()))?;
    Ok(ExitCode::SUCCESS)
}
