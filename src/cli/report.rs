//! `cloudparity report`: the pages of a run directory.

use crate::base::error::Result;
use crate::report::inputs::Makers;
use std::path::{Path, PathBuf};
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
    ("attribution/attribution.json", "cloudparity measure attribution FILE.attribution.toml -o RUN/attribution"),
    ("models.json", "cloudparity compare-models SCENE -o RUN"),
    ("stability.json", "cloudparity stability SCENE -o RUN"),
    ("explain.txt", "cloudparity explain SCENE > RUN/explain.txt"),
    ("scene.json", "cp SCENE RUN/scene.json"),
];

/// Write index.html, report.md, figures.csv, LaTeX tables and figures, and a certificate from what a run directory holds; print the page's path.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  cloudparity report FOLDER\n  cloudparity report --check FOLDER/certificate.json")]
pub(super) struct Arguments {
    /// The run directory, or the folder of a study or a tuning.
    #[arg(value_name = "DIR", required_unless_present = "check")]
    directory: Option<PathBuf>,
    /// Compute again what a certificate says, from the files beside it, instead: exit status 0 the same, 1 something differs, 2 could not tell.
    #[arg(long, value_name = "CERTIFICATE", conflicts_with = "directory")]
    check: Option<PathBuf>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    if let Some(certificate) = &arguments.check {
        return check(certificate);
    }
    let directory = arguments.directory.as_deref().unwrap_or(Path::new("."));
    let page = crate::report::write_report(directory, MAKERS)?;
    super::print(&format!("{}\n", page.display()))?;
    Ok(ExitCode::SUCCESS)
}

fn check(certificate: &Path) -> Result<ExitCode> {
    let found = crate::report::check_certificate(certificate, MAKERS)?;
    let mut text = String::new();
    for line in &found.differing {
        text += &format!("differs: {line}\n");
    }
    for line in &found.untold {
        text += &format!("could not tell: {line}\n");
    }
    let compared: Vec<String> = found.compared.iter().map(|(what, count)| format!("{count} {what}")).collect();
    let (words, status) = match (found.differing.is_empty(), found.untold.is_empty()) {
        (false, _) => ("differs", 1),
        (true, false) => ("could not tell", 2),
        (true, true) => ("the same", 0),
    };
    super::print(&format!("{text}{words}: compared {}\n", compared.join(", ")))?;
    Ok(ExitCode::from(status))
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
