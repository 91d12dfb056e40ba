//! `cloudparity bounds`: checks the bounds of the density against samples and says how tight they are.

use crate::base::error::Result;
use crate::graph::bounds_check::{self, Report, Survey};
use crate::graph::{Program, closures};
use crate::scene::Scene;
use indexmap::IndexMap;
use std::path::PathBuf;
use std::process::ExitCode;

/// Check the density's bounds against samples, and measure how tight they are.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity bounds CLOUD.scene.json --boxes 10000")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// Random boxes of side 2^-1 to 2^-8 that are searched for violations.
    #[arg(long, default_value_t = 10_000)]
    boxes: usize,
    /// Random points in each box and in each cell of the grid.
    #[arg(long, value_name = "N", default_value_t = 1_000)]
    points: usize,
    /// Cells per unit of the grid on which tightness is measured; 0 for none.
    #[arg(long, default_value_t = 64)]
    cells_per_unit: u32,
    /// Cells of the grid to look at, chosen at random; 0 for all.
    #[arg(long, default_value_t = 20_000)]
    cells: usize,
    /// Divide each cell of the grid this many times into eight.
    #[arg(long, default_value_t = 0)]
    refine: u32,
    /// Height of the layer above the object's origin; only boxes in it are looked at.
    #[arg(long, default_value_t = 0.5)]
    altitude: f32,
    /// Seed of boxes and points.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Change a stored value first: "Large Noise/Scale=2". May be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    let targets = closures::targets(&scene)?;
    let mut layer = bounds_check::layer(&scene, arguments.altitude);
    layer.low[2] = layer.low[2].max(0.0).min(layer.high[2]);
    let survey = Survey {
        layer,
        boxes: arguments.boxes,
        samples: arguments.points,
        grid: arguments.cells_per_unit,
        cells: arguments.cells,
        refine: arguments.refine,
        seed: arguments.seed,
    };
    let mut reports = Vec::new();
    for target in targets {
        let program = Program::compile(&scene, std::slice::from_ref(&target))?;
        reports.push((target.name(), survey.run(&program)?));
    }
    let text = match (reports.as_slice(), arguments.json) {
        ([(_, only)], true) => serde_json::to_string_pretty(only).expect("JSON serialises") + "\n",
        ([(_, only)], false) => only.to_string(),
        (several, true) => {
            let by_name: IndexMap<&String, &Report> = several.iter().map(|(name, report)| (name, report)).collect();
            serde_json::to_string_pretty(&by_name).expect("JSON serialises") + "\n"
        }
        (several, false) => several.iter().map(|(name, report)| format!("{name}\n{report}")).collect(),
    };
    super::print(&text)?;
    let violations = |report: &Report| report.violations + report.grid.as_ref().map_or(0, |grid| grid.violations);
    let agree = reports.iter().all(|(_, report)| violations(report) == 0);
    Ok(if agree { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
