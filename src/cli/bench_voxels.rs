//! `cloudparity bench-voxels`: path tracing of a published density itself beside grids of it.

use crate::base::error::Result;
use crate::base::identity::Identity;
use crate::cli::engine::EngineArguments;
use crate::cli::picture::SceneArguments;
use crate::integrators::path::PathSettings;
use crate::measure::speed::voxels;
use std::process::ExitCode;

/// Measure what voxels of a published density cost beside the density itself: mean, null collisions, time to equal error.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity bench-voxels CLOUD.scene.json --resolution 96x54")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    engine: EngineArguments,
    /// Voxels per axis; several are joined by commas.
    #[arg(long, value_name = "N", value_delimiter = ',', default_value = "128", value_parser = clap::value_parser!(u32).range(8..=512))]
    voxels: Vec<u32>,
    /// Samples per pixel and replica.
    #[arg(long, value_name = "N", default_value_t = 16)]
    samples: u32,
    /// Replicas of each way.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(2..=64))]
    replicas: u32,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    let engine = arguments.engine.engine(&scene, "perlin-fbm")?;
    let settings = PathSettings { samples: arguments.samples, ..PathSettings::default() };
    let counts: Vec<usize> = arguments.voxels.iter().map(|&count| count as usize).collect();
    let bar = super::progress_bar(1000);
    let report = super::progress_on(&bar);
    let rows = voxels::run(&scene, &engine, &counts, &settings, arguments.replicas, &report)?;
    bar.finish_and_clear();
    if arguments.json {
        let result = serde_json::json!({
            "builds": [Identity::current()], "scene": scene.name, "scene_sha256": scene.content_hash(),
            "model": engine.model, "samples": arguments.samples, "replicas": arguments.replicas, "rows": rows,
        });
        super::print(&(serde_json::to_string_pretty(&result).expect("figures serialise") + "\n"))?;
        return Ok(ExitCode::SUCCESS);
    }
    let mut text = format!(
        "{:<14}{:>12}{:>11}{:>7}{:>11}{:>12}{:>10}{:>9}{:>9}{:>11}{:>7}\n",
        "way",
        "collisions",
        "violations",
        "null",
        "mean",
        "difference",
        "+-",
        "prepare",
        "seconds",
        "rel. var.",
        "ratio"
    );
    for row in &rows {
        text += &format!(
            "{:<14}{:>12}{:>11}{:>7.3}{:>11.6}{:>11.3}%{:>9.3}%{:>9.2}{:>9.2}{:>11.2e}{:>7.2}\n",
            row.voxels.map_or_else(|| "itself".to_owned(), |count| format!("{count}^3 voxels")),
            row.collisions,
            row.violations,
            row.null_share,
            row.mean,
            100.0 * row.difference,
            100.0 * row.difference_error,
            row.preparation_seconds,
            row.seconds,
            row.relative_variance,
            row.time_to_equal_error
        );
    }
    text += "ratio: time to equal error over that of the density itself; processor seconds, preparation apart.\n";
    super::print(&text)?;
    Ok(ExitCode::SUCCESS)
}
