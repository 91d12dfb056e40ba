//! `cloudparity bounds`: checks the bounds of the density against samples and says how tight they are.

use crate::base::error::Result;
use crate::graph::Program;
use crate::graph::bounds_check::{self, Survey};
use crate::scene::Scene;
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
    let program = Program::density(&scene)?;
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
    let report = survey.run(&program)?;
    let text = if arguments.json {
        serde_json::to_string_pretty(&report).expect("JSON serialises") + "\n"
    } else {
        report.to_string()
    };
    super::print(&text)?;
    let in_grid = report.grid.as_ref().map_or(0, |grid| grid.violations);
    Ok(if report.violations + in_grid == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
