//! `cloudparity build`: a scene file to a .blend.

use crate::base::error::Result;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::scene::Scene;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Make a .blend from a scene file.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The scene file.
    scene: PathBuf,
    /// The .blend to write.
    #[arg(short, long)]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let scene = Scene::load(&arguments.scene)?;
    let bar = super::progress_bar(1000);
    let output = std::path::absolute(&arguments.output).unwrap_or_else(|_| arguments.output.clone());
    let request = json!({"scene": scene, "blend": output, "folder": scene.folder});
    bridge::run_script("build_scene.py", &request, CyclesKernel::Default, super::report_to(&bar))?;
    bar.finish_and_clear();
    Ok(ExitCode::SUCCESS)
}
