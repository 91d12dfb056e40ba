//! `cloudparity study` and `cloudparity recommend`: error against time.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, listed};
use crate::cli::resume::{ExperimentArguments, whole};
use crate::engines::render::EngineJitter;
use crate::measure::combination::Combination;
use crate::measure::study::pareto_front::{self, Budget, Metric};
use crate::measure::study::{Measured, Results, Study};
use crate::report::settings::{self, Setting, Settings, Subject};
use serde_json::json;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Render every combination of a study file's axes, and measure its error against path tracing and its time.
///
/// Every result is kept as soon as it is there: an interrupted study goes on where it stopped. Writes results.json, results.csv and the
/// figure error against time (study.svg, .png, .pdf). With --verify the Pareto fronts of an earlier run are measured again from scratch;
/// exit status 1 where an error does not come out the same within its uncertainty.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cloudparity study CLOUD.study.toml -o STUDY\n  cloudparity study CLOUD.study.toml -o STUDY --list"
)]
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
    let progress = super::progress_on(&bar);
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

/// Recommend a setting from a study, or from pairs that were recorded in the window: the least error in a time, or the shortest time for an
/// error.
#[derive(clap::Args)]
#[command(
    group = clap::ArgGroup::new("budget").required(true).multiple(false),
    after_help = "Example: cloudparity recommend STUDY --max-ms 50"
)]
pub(super) struct RecommendArguments {
    /// The folder of the study, or of the pairs.
    #[arg(value_name = "DIR")]
    directory: PathBuf,
    /// Milliseconds that a picture may take, by the study's clock.
    #[arg(long, group = "budget", value_name = "MS")]
    max_ms: Option<f64>,
    /// The largest relative mean squared error.
    #[arg(long, group = "budget", value_name = "ERROR")]
    max_relmse: Option<f64>,
    /// Largest HDR-FLIP.
    #[arg(long, group = "budget", value_name = "FLIP")]
    max_flip: Option<f64>,
    /// With --max-ms: the error that is to be least.
    #[arg(long, value_parser = choice::<Metric>(), default_value_t = Metric::Relmse)]
    metric: Metric,
    /// Only this scene.
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Only this density model.
    #[arg(long, value_name = "MODEL")]
    density: Option<String>,
    /// Pixels of the picture that is wanted, WIDTHxHEIGHT. Times are then those of the study in proportion to pixels: an estimate.
    #[arg(long, value_name = "WxH", value_parser = super::picture::parse_resolution)]
    resolution: Option<[u32; 2]>,
    /// Also write the setting as a preset (*.preset.json), which `cloudparity render --preset` takes; of one scene and density.
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn recommend(arguments: &RecommendArguments) -> Result<ExitCode> {
    let settings = Settings::load(&arguments.directory)?;
    if settings.builds != [Identity::current().clone()] {
        let builds = listed(&settings.builds, ToString::to_string);
        eprintln!("note: measured by another build ({builds}) than this one, {}", Identity::current());
    }
    let pixels = |[width, height]: [u32; 2]| f64::from(width) * f64::from(height);
    let wanted = |name: &Option<String>, found: &str| name.as_deref().is_none_or(|name| name == found);
    let subjects: Vec<_> = settings
        .subjects()
        .into_iter()
        .filter(|(scene, density, _)| wanted(&arguments.scene, scene) && wanted(&arguments.density, density))
        .collect();
    let listed = |subjects: Vec<Subject<'_>>| {
        let names: Vec<String> = subjects.iter().map(|(scene, density, _)| format!("{density} in {scene}")).collect();
        if names.is_empty() { "a study with runs".to_owned() } else { names.join("; ") }
    };
    if subjects.is_empty() {
        return Err(Error::new(
            "--scene, --density",
            "nothing of that name in the study",
            listed(settings.subjects()),
            "Correct the names.",
        ));
    }
    if arguments.output.is_some() && subjects.len() > 1 {
        return Err(Error::new(
            "--output",
            format!("settings of {}", listed(subjects)),
            "one scene and one density: a preset is one setting",
            "Name them (--scene, --density).",
        ));
    }
    let mut text = String::new();
    let mut documents = Vec::new();
    for (scene, density, all) in subjects {
        // All pictures of a subject have one size: a picture's time over theirs.
        let measured = all[0].resolution;
        let scale = arguments.resolution.map_or(1.0, |wanted| pixels(wanted) / pixels(measured));
        let (metric, budget) = match (arguments.max_ms, arguments.max_relmse, arguments.max_flip) {
            (Some(time), ..) => (arguments.metric, Budget::Seconds(time / 1e3 / scale)),
            (_, Some(error), _) => (Metric::Relmse, Budget::Error(error)),
            (.., error) => (Metric::Flip, Budget::Error(error.expect("one of the three is required"))),
        };
        let front = settings::front(&all, metric);
        let runs: Vec<&Measured> = front.iter().map(|setting| &setting.run).collect();
        let run = pareto_front::recommend(&runs, metric, budget)
            .map_err(|error| Error { place: format!("{density} in {scene}: {}", error.place), ..error })?;
        let setting = front.iter().find(|setting| std::ptr::eq(&setting.run, run)).expect("it is one of them");
        if let Some(path) = &arguments.output {
            setting.preset.write(path)?;
        }
        line(&mut text, format_args!("{density} in {scene}: {}", setting.describe().trim_start()));
        if let Some([width, height]) = arguments.resolution {
            let estimate = 1e3 * run.seconds.median * scale;
            line(
                &mut text,
                format_args!("  about {estimate:.1} ms at {width} x {height}, in proportion to pixels (an estimate)"),
            );
        }
        let file = arguments.output.as_deref().unwrap_or(Path::new("RECOMMENDED.preset.json"));
        let size = arguments.resolution.unwrap_or(measured);
        line(&mut text, format_args!("  {}", command(setting, size, file)));
        let [width, height] = measured;
        line(
            &mut text,
            format_args!(
                "  measured at {width} x {height} pixels, {}, on {}",
                settings.clock.label(),
                settings.machine
            ),
        );
        documents.push(json!({
            "resolution": measured, "clock": settings.clock, "machine": settings.machine, "run": run,
            "preset": setting.preset,
            "estimated_seconds": arguments.resolution.map(|_| run.seconds.median * scale),
        }));
    }
    if let Some(path) = &arguments.output {
        line(&mut text, format_args!("{}: the preset", path.display()));
    } else {
        line(&mut text, format_args!("add -o RECOMMENDED.preset.json for the preset"));
    }
    if arguments.json {
        text = serde_json::to_string_pretty(&documents).expect("runs serialise") + "\n";
    }
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}

/// The command that makes a setting's picture with its preset.
fn command(setting: &Setting, [width, height]: [u32; 2], preset: &Path) -> String {
    let Combination { jitter, god_rays, .. } = &setting.run.combination;
    let axis = setting.scene.as_ref();
    // Studies name scenes as they see them from their own folder.
    let file = axis.map_or_else(|| "SCENE".to_owned(), |axis| super::quoted(Path::new(&axis.file)));
    let mut text = format!("cloudparity render {file} -o PICTURE.png --preset {}", super::quoted(preset));
    for set in axis.iter().flat_map(|axis| &axis.set) {
        text += &format!(" --set {}", super::quoted(Path::new(set)));
    }
    if *jitter != EngineJitter::None {
        text += &format!(" --jitter {jitter}");
    }
    if *god_rays {
        text += " --god-rays";
    }
    if !setting.backend.is_cpu() {
        text += " --backend gpu";
    }
    text += &format!(" --resolution {width}x{height}");
    if axis.is_some_and(|axis| axis.sun.is_some() || axis.camera.is_some()) {
        text += "  # the study turned the scene's sun or camera, which this does not";
    }
    text
}
