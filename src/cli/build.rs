//! A scene file as a .blend.

use crate::base::error::Result;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::scene::Scene;
use serde_json::json;
use std::path::Path;

/// Makes the .blend of a scene file.
pub(super) fn build(scene: &Path, blend: &Path) -> Result<()> {
    let scene = Scene::load(scene)?;
    let bar = super::progress_bar(1000);
    let output = std::path::absolute(blend).unwrap_or_else(|_| blend.to_owned());
    let request = json!({"scene": scene, "blend": output, "folder": scene.folder});
    bridge::run_script("build_scene.py", &request, CyclesKernel::Default, super::report_to(&bar))?;
    bar.finish_and_clear();
    Ok(())
}
