//! `cloudparity measure drift`: what other releases of Blender make of the same nodes.

use crate::base::error::Result;
use crate::base::files;
use crate::bridge::releases::RELEASES;
use crate::cli::choice::choice;
use crate::cli::resume::{ExperimentArguments, whole};
use crate::measure::nodes::drift::{Asked, measure};
use crate::measure::nodes::node_releases::NodeReleases;
use crate::scene::{Release, Scene};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Compare every mode of every node with several releases of Blender, each by its own Cycles, at equal points.
///
/// A release gets an environment of its own, made when it is first asked for: some 400 MB are fetched from the Python package index. Writes
/// drift.json and the table drift.md. A release that cannot be had is left out with the reason; exit status 2 then.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity drift --releases 4.2.23,4.5.15 -o DRIFT")]
pub(super) struct Arguments {
    /// Releases, by the numbers of their packages.
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values = RELEASES)]
    releases: Vec<String>,
    /// The release whose values our evaluators have.
    #[arg(long, value_name = "RELEASE", value_parser = choice::<Release>(), default_value_t)]
    blender: Release,
    /// Points per mode (Voronoi Texture: two ninths of it).
    #[arg(long, value_name = "N", default_value_t = 1152)]
    points: usize,
    /// Seed of the values.
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    seed: u64,
    /// Only this node, by Blender's label: "Math", "Voronoi Texture".
    #[arg(long, value_name = "LABEL")]
    node: Option<String>,
    /// Scenes of which each release renders pictures; none: nodes alone.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    scenes: Vec<PathBuf>,
    /// Of pictures: width and height in pixels.
    #[arg(long, value_name = "WxH", default_value = "48x27", value_parser = super::picture::parse_resolution)]
    resolution: [u32; 2],
    /// Of pictures: samples per pixel and replica.
    #[arg(long, value_name = "N", default_value_t = 256)]
    samples: u32,
    /// Of pictures: replicas of each side, at least 6.
    #[arg(long, value_name = "N", default_value_t = 8)]
    replicas: u32,
    /// Also put which releases have the values of which nodes into this file, as `parity/node-releases.json` holds it.
    #[arg(long, value_name = "FILE")]
    summary: Option<PathBuf>,
    /// The folder for the results.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    #[command(flatten)]
    experiment: ExperimentArguments,
}

/// A scene with pictures of a size.
pub(super) fn of_size(path: &Path, resolution: [u32; 2]) -> Result<Scene> {
    let mut scene = Scene::load(path)?;
    scene.film.resolution = resolution;
    scene.film.resolution_percentage = 100;
    Ok(scene)
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let Arguments { releases, points, seed, node, output, experiment, samples, replicas, blender, .. } = arguments;
    let (releases, node) = (releases.clone(), node.clone());
    let asked = Asked {
        releases,
        points: *points,
        seed: *seed,
        node,
        samples: *samples,
        replicas: *replicas,
        blender: *blender,
    };
    let load = |path: &PathBuf| of_size(path, arguments.resolution);
    let scenes = arguments.scenes.iter().map(load).collect::<Result<Vec<_>>>()?;
    let bar = super::progress_bar(1000);
    let progress = super::progress_on(&bar);
    let outcome = measure(asked, scenes, output, &experiment.settings(), &progress)?;
    bar.finish_and_clear();
    let Some(drift) = whole(outcome) else { return Ok(ExitCode::SUCCESS) };
    if let Some(path) = &arguments.summary {
        let mut known = NodeReleases::load(path)?;
        known.put(&drift);
        files::write_atomically(path, known.to_text().as_bytes())?;
    }
    super::print(&drift.summary())?;
    Ok(if drift.left_out.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(super::COULD_NOT) })
}
