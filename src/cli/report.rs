//! `cloudparity report`: the pages of a run directory.

use crate::base::error::Result;
use crate::report::inputs::Makers;
use std::path::PathBuf;
use std::process::ExitCode;

/// What makes the pictures and figures of a comparison.
const DIFF: &str = "cloudparity diff --ours OURS.exr --reference REFERENCE.exr -o RUN";

/// The command that makes each file of a run directory.
pub(super) const MAKERS: Makers<'static> = &[
    ("run.json", "cloudparity demo -o RUN"),
    ("diff.json", DIFF),
    ("ours.png", DIFF),
    ("reference.png", DIFF),
    ("difference.png", DIFF),
    ("probe.json", "cloudparity probe SCENE --json > RUN/probe.json"),
    ("slices.json", "cloudparity demo -o RUN"),
    ("modes.json", "cloudparity modes --json > RUN/modes.json"),
    ("bounds.json", "cloudparity bounds SCENE --json > RUN/bounds.json"),
    ("bench.json", "cloudparity bench SCENE --json > RUN/bench.json"),
    ("study/results.json", "cloudparity study FILE.study.toml -o RUN/study"),
    ("tuning/tuning.json", "cloudparity tune FILE.tune.toml -o RUN/tuning"),
    ("models.json", "cloudparity compare-models SCENE -o RUN"),
    ("stability.json", "cloudparity stability SCENE -o RUN"),
    ("explain.txt", "cloudparity explain SCENE > RUN/explain.txt"),
    ("scene.json", "cp SCENE RUN/scene.json"),
];

/// Write index.html, report.md and figures.csv from what a run directory holds; print the page's path.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity report FOLDER")]
pub(super) struct Arguments {
    /// The run directory, or the folder of a study or a tuning.
    #[arg(value_name = "DIR")]
    directory: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let page = crate::report::write_report(&arguments.directory, MAKERS)?;
    super::print(&format!("{}\n", page.display()))?;
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::MAKERS;
    use crate::report::inputs::FILES;

    #[test]
    fn every_file_of_a_run_directory_has_its_command() {
        let made: Vec<&str> = MAKERS.iter().map(|(name, _)| *name).collect();
        let read: Vec<&str> = FILES.iter().map(|(name, _)| *name).collect();
        assert_eq!(made, read);
    }
}
