//! `cloudparity eval`: values of the field, or of an inner output, at given points.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::graph::evaluate::{Arithmetic, Points};
use crate::graph::{Program, Target, target};
use crate::measure::fields;
use crate::measure::fields::Evaluator;
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Evaluate the density, or an inner output, at points of the object's frame.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// float32 .npy of shape [n, 3].
    #[arg(long)]
    points: PathBuf,
    /// float32 .npy to write: [n], or [n, 3] for vectors and colours.
    #[arg(short, long)]
    output_file: PathBuf,
    /// The arithmetic.
    #[arg(long, value_parser = choice::<Evaluator>(), default_value_t = Evaluator::Cpu)]
    evaluator: Evaluator,
    /// With --evaluator oracle: f64 throughout, without the f32 coordinates that define the field.
    #[arg(long)]
    unrounded: bool,
    /// Change a stored value: "Large Noise/Scale=2". May be given several times.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// NODE.SOCKET to evaluate instead of the density.
    #[arg(long, value_name = "NODE.SOCKET")]
    output: Option<String>,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    let target = match &arguments.output {
        Some(name) => Target::parse(name, scene.graph())?,
        None => target::density(&scene)?,
    };
    if arguments.unrounded && arguments.evaluator != Evaluator::Oracle {
        return Err(Error::new(
            "--unrounded",
            "another evaluator than the oracle",
            "--evaluator oracle",
            "Add --evaluator oracle, or leave --unrounded out.",
        ));
    }
    let program = Program::compile(&scene, &[target])?;
    let positions = files::read_points(&arguments.points)?;
    let points = Points::new(&positions);
    let values: Vec<f32> = if arguments.unrounded {
        program.evaluate(points, Arithmetic::Unrounded)?.into_iter().map(|value| value as f32).collect()
    } else {
        fields::evaluate(&program, points, arguments.evaluator, None)?.0
    };
    files::write_values(&arguments.output_file, &values, program.output_components())?;
    Ok(ExitCode::SUCCESS)
}
