//! `cloudparity grid`: OpenVDB files of densities.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge;
use crate::cli::engine::DefectsArgument;
use crate::graph::Program;
use crate::graph::evaluate::Points;
use crate::scene::Scene;
use crate::scene::volume_grid::{DENSITY, VolumeGrid};
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Write the density of a scene, or of a density model in its box, as an OpenVDB grid; or read a grid.
///
/// The grid lies in the frame of the scene's volume object. Voxels stand on the faces of its box and between them; negative densities
/// are written as 0.
#[derive(clap::Args)]
#[command(
    after_help = "Examples:\n  cloudparity grid CLOUD.scene.json -o CLOUD.vdb --voxels 256\n  cloudparity grid CLOUD.vdb -o VALUES.npy"
)]
pub(super) struct Arguments {
    /// A scene file, or a .vdb to read.
    input: PathBuf,
    /// The .vdb to write; with a .vdb as input, the .npy for its values [x, y, z].
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Voxels along the longest side.
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u32).range(2..=4096))]
    voxels: u32,
    /// Store 16 instead of 32 bits.
    #[arg(long)]
    half: bool,
    /// A density model instead of the scene's graph.
    #[arg(long, value_name = "MODEL")]
    model: Option<String>,
    #[command(flatten)]
    defects: DefectsArgument,
    /// A parameter of the model. May be given several times.
    #[arg(short, long = "parameter", value_name = "NAME=VALUE")]
    parameters: Vec<String>,
    /// A stored value of the scene to change. May be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Grid to read.
    #[arg(long, default_value = DENSITY)]
    name: String,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    if is_vdb(&arguments.input) {
        return read(arguments);
    }
    if !is_vdb(&arguments.output) {
        return Err(Error::new(
            "--output",
            arguments.output.display().to_string(),
            "a file whose name ends in .vdb",
            "Correct the name.",
        ));
    }
    let scene = Scene::load_with(&arguments.input, &arguments.set)?;
    let [low, high] = [scene.volume.bounds.min, scene.volume.bounds.max].map(|end| DVec3::from(end.map(f64::from)));
    let grid = match &arguments.model {
        Some(id) => {
            let engine =
                super::engine::build(&scene, id, &arguments.defects.read()?, (None, &arguments.parameters), 0.0)?;
            VolumeGrid::sample(low, high, arguments.voxels, |places| {
                let places: Vec<[f32; 3]> = places.iter().map(|place| place.as_vec3().to_array()).collect();
                engine.density.values(&places)
            })?
        }
        None => {
            let program = Program::density(&scene)?;
            VolumeGrid::sample(low, high, arguments.voxels, |places| {
                let places: Vec<[f32; 3]> = places.iter().map(|place| place.as_vec3().to_array()).collect();
                let mut values = program.evaluate_single(Points::new(&places))?;
                // NaN stays to be seen: the writer refuses it.
                values.iter_mut().filter(|value| **value < 0.0).for_each(|value| *value = 0.0);
                Ok(values)
            })?
        }
    };
    bridge::volume_grid::write(&grid, &arguments.output, arguments.half)?;
    let [x, y, z] = [0, 1, 2].map(|axis| grid.values.shape()[axis]);
    let largest = grid.values.iter().copied().fold(0.0, f32::max);
    super::print(&format!("{}: {x} x {y} x {z} voxels, largest value {largest}\n", arguments.output.display()))?;
    Ok(ExitCode::SUCCESS)
}

fn read(arguments: &Arguments) -> Result<ExitCode> {
    let grid = bridge::volume_grid::read(&arguments.input, &arguments.name)?;
    files::write_array(&arguments.output, &grid.values)?;
    let [x, y, z] = [0, 1, 2].map(|axis| grid.values.shape()[axis]);
    let first = grid.to_object.translation;
    let last = grid.to_object.transform_point3(DVec3::new(x as f64, y as f64, z as f64) - 1.0);
    super::print(&format!("{x} x {y} x {z} voxels from {first} to {last}: {}\n", arguments.output.display()))?;
    Ok(ExitCode::SUCCESS)
}

fn is_vdb(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vdb"))
}
