//! `cloudparity shader`: the standalone density function in a shading language.

use super::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::engines;
use crate::engines::bundle::run_time::{Candidate, RunTime};
use crate::engines::defects::Defects;
use crate::graph::{Program, wgsl};
use crate::measure::tuning::file::{Owner, owner};
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the density function of a scene as a standalone shader.
///
/// It has an entry point that computes the density at points of a storage buffer. With --parameters those numbers of the material that its constants
/// follow from in proportion are the fields of a uniform struct, by their names in Blender; what each is stands at the beginning of the text.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity shader CLOUD.scene.json -o DENSITY.hlsl --language hlsl
  cloudparity shader CLOUD.scene.json -o DENSITY.wgsl --parameters")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// The language.
    #[arg(long, alias = "target", value_parser = choice::<wgsl::Language>(), default_value_t = wgsl::Language::Wgsl)]
    language: wgsl::Language,
    /// Change a stored value first.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Have the material's numbers in a uniform.
    #[arg(long)]
    parameters: bool,
    /// The file to write.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    let shader = match arguments.parameters {
        true => with_parameters(&scene, arguments.language)?,
        false => wgsl::standalone(&Program::density(&scene)?, arguments.language)?,
    };
    files::write_atomically(&arguments.output, &shader)?;
    Ok(ExitCode::SUCCESS)
}

fn with_parameters(scene: &Scene, language: wgsl::Language) -> Result<Vec<u8>> {
    let model = engines::find("graph")?;
    let values = model.values(None, &[])?;
    let build = |changes: &[(&str, f64)]| {
        let mut scene = scene.clone();
        changes.iter().try_for_each(|(name, value)| scene.set(&format!("{}={value}", owner(name).1)))?;
        let engine = model.engine(&scene, &values, &Defects::NONE, 0.0)?;
        Ok((scene, engine))
    };
    let (_, engine) = build(&[])?;
    let mut candidates = Candidate::all(scene, &engine)?;
    candidates.retain(|one| owner(&one.name).0 == Owner::Scene);
    let found = RunTime::find(&candidates, engine.density.bounds, &build, &|_| ())?.ok_or_else(|| {
        Error::new(
            "--parameters",
            "no number of the material that the density's constants follow from in proportion",
            "at least one",
            "Leave the option out.",
        )
    })?;
    found.shader(language)
}
