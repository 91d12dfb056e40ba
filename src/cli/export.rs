//! `cloudparity export`: a .blend to a scene file.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::graph::closures::ClosureSum;
use crate::scene::Scene;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Read a .blend and write its volume, camera, lights and node graph as a scene file.
#[derive(clap::Args)]
pub(super) struct Arguments {
    /// The .blend; scripts in it are never run.
    blend: PathBuf,
    /// An object with a volume material, repeatable; without it all that render are exported.
    #[arg(long)]
    object: Vec<String>,
    /// The scene file to write.
    #[arg(short, long)]
    output: PathBuf,
}

pub(super) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let bar = super::progress_bar(1000);
    let blend = std::path::absolute(&arguments.blend).unwrap_or_else(|_| arguments.blend.clone());
    let chosen = (!arguments.object.is_empty()).then_some(&arguments.object);
    let request = json!({"blend": blend, "object": chosen});
    let place = arguments.blend.display().to_string();
    // Blender names objects and nodes; which file they are in is known here.
    let in_file = |error: Error| match error.place.contains(&place) {
        true => error,
        false => Error { place: format!("{place}: {}", error.place), ..error },
    };
    let result = bridge::run_script("export_scene.py", &request, CyclesKernel::Default, super::report_to(&bar));
    let result = result.map_err(in_file)?;
    bar.finish_and_clear();
    let scene = Scene::from_value(result["scene"].clone(), &place)?;
    // What the evaluators do not support is said now, by node, and not when a picture is wanted.
    for (volume, graph) in scene.volumes()? {
        ClosureSum::compile(graph, volume).map_err(in_file)?;
    }
    let text = result["text"]
        .as_str()
        .map_or_else(|| serde_json::to_string_pretty(&result["scene"]).expect("JSON serialises") + "\n", str::to_owned);
    if let (Some(source), Some(image)) = (result["world_image"].as_str(), &scene.world.image) {
        copy_beside(Path::new(source), &arguments.output.with_file_name(&image.file))?;
    }
    files::write_atomically(&arguments.output, text.as_bytes())?;
    Ok(ExitCode::SUCCESS)
}

/// Puts the picture around the scene beside the scene file; another one of that name is not overwritten.
fn copy_beside(source: &Path, target: &Path) -> Result<()> {
    let bytes = std::fs::read(source).map_err(|cause| Error::io(source, "the picture around the scene", &cause))?;
    match std::fs::read(target) {
        Ok(there) if there == bytes => Ok(()),
        Ok(_) => Err(Error::new(
            target.display().to_string(),
            "another file of the same name as the picture around the scene",
            "no such file, or the same picture",
            "Write the scene to another folder.",
        )),
        Err(_) => files::write_atomically(target, &bytes),
    }
}
