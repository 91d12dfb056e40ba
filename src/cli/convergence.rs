//! `cloudparity convergence`: error of ray marching against its steps and its density cache.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::cli::march::MarchArguments;
use crate::cli::picture::SceneArguments;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::convergence::{ConvergenceSettings, measure};
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// The script that draws.
const SCRIPT: &str = "convergence_plot.py";

/// Measure how ray marching converges: its error against the number of steps for both integrations, with the order
/// of convergence, and the bias of density caches. Writes convergence.json and .csv, then .svg and .png (with
/// matplotlib). What was interrupted goes on.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity convergence CLOUD.scene.json -o CONVERGENCE --resolution 64x64")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// The folder to write to.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// Steps per mean side of the medium's box, rising; the reference takes 4 times the last.
    #[arg(long, value_delimiter = ',', default_values_t = ConvergenceSettings::default().steps)]
    steps_per_side: Vec<u32>,
    /// Cells of the density caches along the longest side.
    #[arg(long, value_delimiter = ',', default_values_t = ConvergenceSettings::default().cache_cells)]
    cache_cells: Vec<u32>,
    /// Leave density caches out.
    #[arg(long, conflicts_with = "cache_cells")]
    without_caches: bool,
    #[command(flatten)]
    march: MarchArguments,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

/// Options that the measurement sets by itself.
const VARIED: [&str; 5] = ["--view-step", "--integration", "--density-cache", "--cache-format", "--cache-filter"];

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    if let Some((name, _)) = arguments.march.given().into_iter().find(|(name, given)| *given && VARIED.contains(name)) {
        return Err(Error::new(
            name,
            "an option that the measurement varies by itself",
            "--steps-per-side and --cache-cells, which say what is varied",
            format!("Leave {name} out."),
        ));
    }
    let default = ConvergenceSettings::default();
    let what = ConvergenceSettings {
        steps: arguments.steps_per_side.clone(),
        cache_cells: if arguments.without_caches { Vec::new() } else { arguments.cache_cells.clone() },
        march: arguments.march.settings(default.march, None)?,
    };
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let outcome = measure(&scene, &what, Some(&arguments.output), &arguments.experiment.settings(), &progress)?;
    bar.finish_and_clear();
    let Some(found) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    let file = |extension: &str| arguments.output.join(format!("convergence.{extension}"));
    let document = serde_json::to_string_pretty(&found).expect("figures serialise") + "\n";
    files::write_atomically(&file("json"), document.as_bytes())?;
    files::write_atomically(&file("csv"), found.csv().as_bytes())?;
    super::print(&if arguments.json { document } else { found.summary() })?;
    let request = json!({"convergence": found, "svg": file("svg"), "png": file("png")});
    bridge::run_script(SCRIPT, &request, CyclesKernel::Default, |_| ())?;
    Ok(ExitCode::SUCCESS)
}
