//! `cloudparity export`: a .blend to a scene file.

use crate::blender::{self, Kernel};
use crate::error::{Error, Result};
use crate::files;
use crate::graph::Program;
use crate::scene::Scene;
use serde_json::json;
use std::path::PathBuf;
use std::process::ExitCode;

/// Read a .blend and write its volume, camera, lights and node graph as a scene file.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The .blend; scripts in it are never run.
    blend: PathBuf,
    /// The object with the volume material, when there are several.
    #[arg(long)]
    object: Option<String>,
    /// The scene file to write.
    #[arg(short, long)]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let bar = super::progress_bar(1000);
    let blend = std::path::absolute(&arguments.blend).unwrap_or_else(|_| arguments.blend.clone());
    let request = json!({"blend": blend, "object": arguments.object});
    let place = arguments.blend.display().to_string();
    // Blender names objects and nodes; which file they are in is known here.
    let in_file = |error: Error| match error.place.contains(&place) {
        true => error,
        false => Error { place: format!("{place}: {}", error.place), ..error },
    };
    let result = blender::run_script("export_scene.py", &request, Kernel::Default, blender::report_to(&bar));
    let result = result.map_err(in_file)?;
    bar.finish_and_clear();
    let scene = Scene::from_value(result["scene"].clone(), &place)?;
    // What the evaluators do not support is said now, by node, and not when a picture is wanted.
    Program::density(&scene).map_err(in_file)?;
    let text = result["text"]
        .as_str()
        .map_or_else(|| serde_json::to_string_pretty(&result["scene"]).expect("JSON serialises") + "\n", str::to_owned);
    files::write_atomically(&arguments.output, text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}
