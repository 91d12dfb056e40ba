//! `cloudparity shader`: the standalone density function in a shading language.

use super::choice::choice;
use crate::base::error::Result;
use crate::base::files;
use crate::graph::{Program, wgsl};
use crate::scene::Scene;
use std::path::PathBuf;
use std::process::ExitCode;

/// Write the density function of a scene as a standalone shader.
#[derive(clap::Args)]
#[command(after_help = "Example: cloudparity shader CLOUD.scene.json -o DENSITY.hlsl --language hlsl")]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// The language.
    #[arg(long, alias = "target", value_parser = choice::<wgsl::Language>(), default_value_t = wgsl::Language::Wgsl)]
    language: wgsl::Language,
    /// Change a stored value first.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// The file to write.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    let program = Program::density(&scene)?;
    files::write_atomically(&arguments.output, &wgsl::standalone(&program, arguments.language)?)?;
    Ok(ExitCode::SUCCESS)
}
