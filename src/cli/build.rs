//! A scene file as a .blend.

use crate::base::error::Result;
use crate::bridge;
use crate::bridge::{CyclesKernel, releases};
use crate::scene::{Release, Scene};
use serde_json::json;
use std::path::Path;

/// Makes the .blend of a scene file.
pub(super) fn build(scene: &Path, blend: &Path) -> Result<()> {
    let scene = Scene::load(scene)?;
    let bar = super::progress_bar(1000);
    let output = std::path::absolute(blend).unwrap_or_else(|_| blend.to_owned());
    let request = json!({"scene": scene, "blend": output, "folder": scene.folder});
    // A graph with the values of 5.1 or later may hold what 5.0 does not have, and the file says by its header whose values it means.
    // What has those of 4.5 has no such mark: no file of 4.5 names the values of its nodes.
    let values = scene.graph().blender.max(Release::default());
    releases::with_values_of(values, || {
        bridge::run_script("build_scene.py", &request, CyclesKernel::Default, super::report_to(&bar))
    })?;
    bar.finish_and_clear();
    Ok(())
}
