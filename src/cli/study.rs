//! `cloudparity study` and `cloudparity recommend`: error against time.

use super::choice::choice;
use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::{Identity, listed};
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::study::pareto_front::{self, Budget, Metric};
use crate::measure::study::{Results, Study};
use serde_json::json;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

/// Render every combination of a study file's axes, and measure its error against path tracing and its time.
///
/// Every result is kept as soon as it is there: an interrupted study goes on where it stopped. Writes results.json, results.csv and the
/// figure error against time (study.svg, .png, .pdf). With --verify the Pareto fronts of an earlier run are measured again from scratch;
/// exit status 1 where an error does not come out the same within its uncertainty.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The study file (*.study.toml).
    file: PathBuf,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Say what would be run and what is left out, and why; run nothing.
    #[arg(long)]
    list: bool,
    /// Measure the settings on the Pareto fronts again, against new truths.
    #[arg(long, conflicts_with = "list")]
    verify: bool,
    /// Only render what takes longest and is not timed: the truths, and Cycles' pictures for its curves.
    #[arg(long, conflicts_with_all = ["list", "verify"])]
    prepare: bool,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let study = Study::load(&arguments.file)?;
    if arguments.list {
        let mut text = String::new();
        for combination in &study.wanted {
            line(&mut text, format_args!("run {}", json!(combination)));
        }
        for skipped in &study.skipped {
            line(&mut text, format_args!("left out, because {}: {}", skipped.reason, json!(skipped.combination)));
        }
        line(&mut text, format_args!("{} runs, {} left out", study.wanted.len(), study.skipped.len()));
        super::print(&text)?;
        return Ok(ExitCode::SUCCESS);
    }
    let settings = arguments.experiment.settings();
    let bar = super::progress_bar(1000);
    let progress = |done: f64, what: &str| {
        bar.set_position((done * 1000.0) as u64);
        bar.set_message(what.to_owned());
    };
    if arguments.prepare {
        let outcome = study.prepare(&arguments.output, &settings, &progress)?;
        bar.finish_and_clear();
        let Some(prepared) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
        for missing in &prepared.missing_curves {
            eprintln!("warning: the curve of {} is left out: {}", missing.renderer.label(), missing.reason);
        }
        let mut text = String::new();
        for record in &prepared.truths {
            line(
                &mut text,
                format_args!(
                    "truth of {} in {}: {:.1} s of processor time",
                    record.density, record.scene, record.seconds
                ),
            );
        }
        super::print(&text)?;
        return Ok(ExitCode::SUCCESS);
    }
    if arguments.verify {
        let results = Results::load(&arguments.output)?;
        let outcome = study.verify(&results, &arguments.output, &settings, &progress)?;
        bar.finish_and_clear();
        let Some(found) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
        let text = serde_json::to_string_pretty(&found).expect("figures serialise") + "\n";
        files::write_atomically(&arguments.output.join("verified.json"), text.as_bytes())?;
        let agree = found.iter().filter(|one| one.agrees).count();
        let mut text = String::new();
        for one in &found {
            let answer = if one.agrees { "agrees" } else { "differs" };
            line(
                &mut text,
                format_args!(
                    "{answer}: relMSE {:.5} ({:.5}), again {:.5} ({:.5}), t {:.2}: {}",
                    one.first.value,
                    one.first.standard_error,
                    one.second.value,
                    one.second.standard_error,
                    one.t,
                    json!(one.combination)
                ),
            );
        }
        line(&mut text, format_args!("{agree} of {} agree", found.len()));
        super::print(&text)?;
        return Ok(if agree == found.len() { ExitCode::SUCCESS } else { ExitCode::FAILURE });
    }
    let outcome = study.run(&arguments.output, &settings, &progress)?;
    bar.finish_and_clear();
    let Some(results) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    for left_out in &results.left_out {
        eprintln!("warning: left out: {left_out}");
    }
    super::print(&summary(&results))?;
    results.draw(&arguments.output)?;
    Ok(ExitCode::SUCCESS)
}

fn summary(results: &Results) -> String {
    let mut text = String::new();
    for (scene, density, front) in results.pareto_fronts() {
        line(&mut text, format_args!("{density} in {scene}: nothing beats"));
        for run in front {
            line(&mut text, format_args!("  {}", run.describe()));
        }
    }
    for point in &results.curves {
        line(&mut text, format_args!("{}", point.describe()));
    }
    for missing in &results.missing_curves {
        line(
            &mut text,
            format_args!(
                "no curve of {:?}, {} in {}: {}",
                missing.renderer, missing.density, missing.scene, missing.reason
            ),
        );
    }
    line(&mut text, format_args!("{} runs, {} left out", results.runs.len(), results.skipped.len()));
    text
}

fn line(text: &mut String, parts: std::fmt::Arguments<'_>) {
    writeln!(text, "{parts}").expect("writing to a string cannot fail");
}

/// Recommend a setting from a study: the least error in a time, or the shortest time for an error.
#[derive(clap::Args)]
#[command(group = clap::ArgGroup::new("budget").required(true).multiple(false))]
pub(super) struct RecommendArguments {
    /// The folder of the study.
    directory: PathBuf,
    /// Milliseconds of processor time that a picture may take.
    #[arg(long, group = "budget")]
    max_ms: Option<f64>,
    /// Largest relMSE.
    #[arg(long, group = "budget")]
    max_relmse: Option<f64>,
    /// Largest HDR-FLIP.
    #[arg(long, group = "budget")]
    max_flip: Option<f64>,
    /// With --max-ms: the error that is to be least.
    #[arg(long, value_parser = choice::<Metric>(), default_value_t = Metric::Relmse)]
    metric: Metric,
    /// Only this scene.
    #[arg(long)]
    scene: Option<String>,
    /// Only this density model.
    #[arg(long)]
    density: Option<String>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn recommend(arguments: &RecommendArguments) -> Result<ExitCode> {
    let results = Results::load(&arguments.directory)?;
    if results.builds != [Identity::current().clone()] {
        let builds = listed(&results.builds, ToString::to_string);
        eprintln!("note: measured by another build ({builds}) than this one, {}", Identity::current());
    }
    let (metric, budget) = match (arguments.max_ms, arguments.max_relmse, arguments.max_flip) {
        (Some(time), ..) => (arguments.metric, Budget::Seconds(time / 1e3)),
        (_, Some(error), _) => (Metric::Relmse, Budget::Error(error)),
        (.., error) => (Metric::Flip, Budget::Error(error.expect("one of the three is required"))),
    };
    let wanted = |name: &Option<String>, found: &str| name.as_deref().is_none_or(|name| name == found);
    let groups: Vec<_> = results
        .groups()
        .into_iter()
        .filter(|(scene, density, _)| wanted(&arguments.scene, scene) && wanted(&arguments.density, density))
        .collect();
    if groups.is_empty() {
        let known: Vec<String> =
            results.groups().iter().map(|(scene, density, _)| format!("{density} in {scene}")).collect();
        return Err(crate::base::error::Error::new(
            "--scene, --density",
            "nothing of that name in the study",
            if known.is_empty() { "a study with runs".to_owned() } else { known.join(", ") },
            "Correct the names.",
        ));
    }
    let mut text = String::new();
    let mut documents = Vec::new();
    for (scene, density, runs) in groups {
        let run =
            pareto_front::recommend(&pareto_front::pareto_front(runs, metric), metric, budget).map_err(|error| {
                crate::base::error::Error { place: format!("{density} in {scene}: {}", error.place), ..error }
            })?;
        line(&mut text, format_args!("{density} in {scene}: {}", run.describe().trim_start()));
        documents.push(run);
    }
    if arguments.json {
        text = serde_json::to_string_pretty(&documents).expect("runs serialise") + "\n";
    }
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}
