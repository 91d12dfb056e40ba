//! `cloudparity compare-models`: the density of a scene's graph beside those of published engines.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::cli::picture::SceneArguments;
use crate::engines::Selection;
use crate::measure::densities::comparison;
use crate::measure::densities::comparison::{Compared, Comparison, Settings};
use crate::report;
use crate::report::inputs::{Run, Timing};
use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

/// Put the density of a scene's graph beside those of published engines: same box, camera, light and mean optical depth.
///
/// Measures the fields (histogram, power spectrum, covered share) and what a sample costs, renders all with the first engine's light as
/// published and corrected and by path tracing, and writes models.json, pictures and the report's page.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity compare-models CLOUD.scene.json -o MODELS
  cloudparity compare-models CLOUD.scene.json --model bolt --model \"skill coverage=0.6\" --model takram -o MODELS")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// A density model, with parameters of it where wanted; may be given several times. `cloudparity models` lists them.
    #[arg(long, value_name = "MODEL", default_values_t = ["perlin-fbm".to_owned()])]
    model: Vec<String>,
    /// A level of quality of the only model.
    #[arg(long, value_name = "LEVEL")]
    quality: Option<String>,
    /// A parameter of the model, where there is one only. May be given several times.
    #[arg(short, long = "parameter", value_name = "NAME=VALUE")]
    parameters: Vec<String>,
    /// Mean optical depth from top to bottom that all densities are brought to; the first model's own if not given.
    #[arg(long, value_name = "DEPTH")]
    mean_depth: Option<f64>,
    /// Places per axis of the statistics, voxels per axis of path tracing.
    #[arg(long, default_value_t = 128)]
    places: usize,
    /// Samples per pixel of path tracing.
    #[arg(long, value_name = "N", default_value_t = 256, value_parser = clap::value_parser!(u32).range(1..))]
    samples: u32,
    /// Rays per pixel and axis of the engine.
    #[arg(long, value_name = "N", default_value_t = 2, value_parser = clap::value_parser!(u32).range(1..=64))]
    sub_pixels: u32,
    /// Points of the timing.
    #[arg(long, default_value_t = 1 << 18, value_parser = clap::builder::RangedU64ValueParser::<usize>::new().range(1000..))]
    timed_points: usize,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    if let (true, [_, second, ..]) =
        (arguments.quality.is_some() || !arguments.parameters.is_empty(), arguments.model.as_slice())
    {
        return Err(Error::new(
            format!("--model {second}"),
            "--quality or --parameter, and several models",
            "parameters beside each model's name",
            "Write --model \"bolt coverage=0.6\".",
        ));
    }
    let compared = |text: &String| {
        let Selection { model, settings } = Selection::parse(text)?;
        let all = [settings.as_slice(), &arguments.parameters].concat();
        Ok((model, model.values(arguments.quality.as_deref(), &all)?))
    };
    let models: Vec<Compared> = arguments.model.iter().map(compared).collect::<Result<_>>()?;
    let settings = Settings {
        places: arguments.places,
        samples: arguments.samples,
        sub_pixels: arguments.sub_pixels,
        mean_depth: arguments.mean_depth,
        timed_points: arguments.timed_points,
    };
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let begin = Instant::now();
    let mut found = comparison::run(&scene, &models, &settings, &arguments.output, &progress)?;
    bar.finish_and_clear();
    comparison::write(&found, &arguments.output)?;
    let run = Run {
        title: Some(format!(
            "Density models: {}",
            found.sides.iter().map(|side| side.title.as_str()).collect::<Vec<_>>().join(", ")
        )),
        scene: Some(scene.name.clone()),
        scene_sha256: Some(found.scene_sha256.clone()),
        command: Some("cloudparity compare-models".into()),
        versions: [("cloudparity".to_owned(), Identity::current().full().into())].into(),
        timings: vec![Timing { what: "statistics and pictures".into(), seconds: begin.elapsed().as_secs_f64() }],
        ..Run::default()
    };
    let text = serde_json::to_string_pretty(&run).expect("a run serialises") + "\n";
    files::write_atomically(&arguments.output.join("run.json"), text.as_bytes())?;
    comparison::show(&mut found, &scene.display, &arguments.output)?;
    let page = report::write_report(&arguments.output, super::report::MAKERS)?;
    super::print(&format!("{}{}\n", summary(&found), page.display()))?;
    Ok(ExitCode::SUCCESS)
}

fn summary(found: &Comparison) -> String {
    let mut text = String::new();
    for side in &found.sides {
        let statistics = &side.statistics;
        let adapter = side.gpu_nanoseconds.map_or(String::new(), |time| format!(", {time:.1} on the adapter"));
        writeln!(
            text,
            "{}: factor {:.4}, mean depth {:.3}, filled {:.1} %, covered {:.1} %, {:.1} ns per sample{adapter}",
            side.title,
            side.factor,
            statistics.mean_depth,
            100.0 * statistics.filled,
            100.0 * statistics.covered,
            side.cpu_nanoseconds,
        )
        .expect("writing to a string cannot fail");
    }
    text
}
