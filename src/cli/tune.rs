//! `cloudparity tune`: an engine's parameters fitted to path tracing.

use crate::base::error::Result;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::tuning::{Scored, Tuning, TuningResults};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// Fit an engine's free parameters to path tracing on some views, and judge them on others.
///
/// CMA-ES lowers the error of the training views of a tuning file. Published light models, their exposure matched to the same views, are what
/// the result is compared with. Writes tuning.json, tuned.preset.json (for `render --preset`) and the figure
/// before and after (tuning.svg, .png, .pdf). An interrupted search goes on where it stopped.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity tune CLOUD.tune.toml -o TUNING")]
pub(super) struct Arguments {
    /// The tuning file (*.tune.toml).
    file: PathBuf,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let tuning = Tuning::load(&arguments.file)?;
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let outcome = tuning.run(&arguments.output, &arguments.experiment.settings(), &progress)?;
    bar.finish_and_clear();
    if let Some(results) = whole(outcome) {
        super::print(&summary(&results))?;
        results.draw(&arguments.output)?;
    }
    Ok(ExitCode::SUCCESS)
}

fn summary(results: &TuningResults) -> String {
    let mut text = String::new();
    let mut line = |scored: &Scored| {
        writeln!(
            text,
            "{:<14} exposure {:.3}: FLIP {:.4} in training, {:.4} held out; relMSE {:.4}, {:.4}; {:.2} ms",
            scored.name,
            scored.exposure,
            Scored::mean_flip(&scored.train),
            Scored::mean_flip(&scored.held_out),
            Scored::mean_relmse(&scored.train),
            Scored::mean_relmse(&scored.held_out),
            1e3 * scored.seconds,
        )
        .expect("writing to a string cannot fail");
    };
    results.published.iter().for_each(&mut line);
    line(&results.tuned);
    line(&results.finer);
    for (name, value) in &results.parameters {
        text += &format!("  {name} = {value:.6}\n");
    }
    text += &format!(
        "{} evaluations (stopped by {}), held-out FLIP {:.1} % {} than {}; noise of the truths {:.4}\n",
        results.evaluations,
        results.stopped.join(", "),
        100.0 * results.improvement().abs(),
        if results.improvement() < 0.0 { "higher" } else { "lower" },
        results.published[0].name,
        results.noise_flip,
    );
    text
}
