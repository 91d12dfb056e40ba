//! `cloudparity eval`: values of the field, or of an inner output, at given points.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::graph::evaluate::{Arithmetic, Points};
use crate::graph::{Program, Target, closures};
use crate::measure::fields;
use crate::measure::fields::Evaluator;
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// The target that is no socket: what the world's nodes send.
const WORLD: &str = "world";

/// Evaluate the density, or an inner output, at points of the object's frame.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity eval CLOUD.scene.json --points POINTS.npy -o VALUES.npy --backend gpu")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// Points: float32 .npy of shape [n, 3].
    #[arg(long, value_name = "FILE")]
    points: PathBuf,
    /// float32 .npy to write: [n], or [n, 3] for vectors and colours.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The arithmetic, and where it runs.
    #[arg(long, alias = "evaluator", value_parser = choice::<Evaluator>(), default_value_t = Evaluator::Cpu)]
    backend: Evaluator,
    /// With --backend oracle: f64 throughout, without the f32 coordinates that define the field.
    #[arg(long)]
    unrounded: bool,
    /// Change a stored value: "Large Noise/Scale=2". May be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// NODE.SOCKET to evaluate instead of the density; `world`: the radiance of the world's nodes, points being directions.
    #[arg(long, value_name = "NODE.SOCKET")]
    target: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    if arguments.unrounded && arguments.backend != Evaluator::Oracle {
        return Err(Error::new(
            "--unrounded",
            "another backend than the oracle",
            "--backend oracle",
            "Add --backend oracle, or leave --unrounded out.",
        ));
    }
    let program = match arguments.target.as_deref() {
        Some(WORLD) => Program::world(scene.world_graph()?)?,
        Some(name) => Program::compile(&scene, &[Target::parse(name, scene.graph())?])?,
        None => Program::compile(&scene, &[closures::only_target(&scene)?])?,
    };
    let positions = files::read_points(&arguments.points)?;
    let points = Points::new(&positions);
    let values: Vec<f32> = if arguments.unrounded {
        program.evaluate(points, Arithmetic::Unrounded)?.into_iter().map(|value| value as f32).collect()
    } else {
        fields::evaluate(&program, points, arguments.backend, None)?.0
    };
    files::write_values(&arguments.output, &values, program.output_components())?;
    Ok(ExitCode::SUCCESS)
}
