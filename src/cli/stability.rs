//! `cloudparity stability`: f32 on the CPU and in WGSL against f64 over stiff and extreme cases.

use crate::base::error::Result;
use crate::cli::picture::SceneArguments;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::gpu::Gpu;
use crate::measure::stability;
use crate::measure::stability::fields;
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Measure numerical stability: f32 on the CPU and in WGSL against f64 over stiff and extreme cases, with what guards each.
///
/// Optical depths of 1e-6 to 1e6 per step, densities of 0 to 1e8, eccentricities to 1 - 1e-6, coordinates and Time to 1e6, scales to 0,
/// cameras inside and on the boundary, rays in faces, suns below the horizon, 1 and 10,000 steps. Exit status 1: a row fails; 2: no adapter.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity stability CLOUD.scene.json -o STABILITY")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Take the pictures of this scene instead: a heavy graph takes a software adapter a minute for each.
    #[arg(long, value_name = "SCENE")]
    pictures_of: Option<PathBuf>,
    /// A folder for stability.json and .csv, which the report shows.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Ask live Cycles for the fields' values, too.
    #[arg(long)]
    cycles: bool,
    /// JSON instead of text.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = arguments.scene.load()?;
    if arguments.cycles {
        super::need_bpy("fields are")?;
    }
    let pictures_of = match &arguments.pictures_of {
        Some(path) => Scene::load(path)?,
        None => scene.clone(),
    };
    let gpu = Gpu::open();
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let (folder, settings) = (arguments.output.as_deref(), arguments.experiment.settings());
    let outcome = stability::run(&scene, &pictures_of, gpu.as_ref().ok(), folder, &settings, &progress)?;
    let Some(mut table) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    if arguments.cycles {
        fields::ask_cycles(&scene, &mut table.rows, super::report_to(&bar))?;
    }
    bar.finish_and_clear();
    if let Some(folder) = &arguments.output {
        table.write(folder)?;
    }
    super::print(&if arguments.json { table.json() } else { table.text() })?;
    if let Err(error) = &gpu {
        eprintln!("left out: WGSL: {error}");
    }
    Ok(match (table.holds(), gpu) {
        (false, _) => ExitCode::FAILURE,
        (true, Err(_)) => ExitCode::from(super::COULD_NOT),
        _ => ExitCode::SUCCESS,
    })
}
