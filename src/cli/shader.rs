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
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// The language.
    #[arg(long, value_parser = choice::<wgsl::Language>(), default_value_t = wgsl::Language::Wgsl)]
    target: wgsl::Language,
    /// Change a stored value first.
    #[arg(long = "set", value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// The file to write.
    #[arg(short, long)]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load_with(&arguments.scene, &arguments.set)?;
    let program = Program::density(&scene)?;
    files::write_atomically(&arguments.output, &wgsl::standalone(&program, arguments.target)?)?;
    Ok(ExitCode::SUCCESS)
}
