//! Pictures by Cycles, cached by content.
//!
//! A request is identified by everything that decides its pixels: the scene with its overrides, the
//! settings, and Blender's version. The same request is rendered once; after that its EXR comes
//! from the cache folder.

use super::{Kernel, Message, module_version, run_script};
use crate::error::{Error, Result};
use crate::files;
use crate::scene::Scene;
use serde::Serialize;
use serde_json::json;
use std::path::{Path, PathBuf};

/// Environment variable that names the cache folder.
pub const CACHE_VARIABLE: &str = "CLOUDPARITY_CACHE";

/// What a reference costs and which random numbers it draws. The rest (size, film, bounces, pixel
/// filter) is the scene's.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReferenceSettings {
    /// Samples per pixel.
    pub samples: u32,
    /// Seed; disjoint seeds are independent replicas.
    pub seed: u32,
    /// Ray marching instead of null collision.
    pub volume_biased: bool,
    /// Factor on the step of ray marching.
    pub step_rate: f64,
    /// Threads; 0 takes all. Does not change the pixels.
    pub threads: u32,
    /// All passes, as parts of one file.
    pub multilayer: bool,
}

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self { samples: 256, seed: 101, volume_biased: false, step_rate: 0.1, threads: 0, multilayer: false }
    }
}

/// A reference and where it came from.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    /// The picture in the cache.
    pub path: PathBuf,
    /// SHA-256 of the request.
    pub key: String,
    /// It was there already.
    pub cached: bool,
}

/// The picture of `scene` by Cycles: from the folder `cache`, or rendered into it now. The pixel filter is the box
/// whatever the scene says: it is the one that both sides share exactly.
pub fn reference(
    scene: &Scene,
    settings: &ReferenceSettings,
    cache: &Path,
    receive: impl FnMut(Message),
) -> Result<Reference> {
    let blender = module_version("bpy", "bpy.app.version_string").map_err(|cause| {
        Error::new(
            "interpreter",
            cause,
            "the module bpy",
            "Run make setup, or compare with a reference that exists already.",
        )
    })?;
    let key = request_key(scene, settings, &blender);
    let path = cache.join(format!("{key}.exr"));
    if path.exists() {
        return Ok(Reference { path, key, cached: true });
    }
    std::fs::create_dir_all(cache).map_err(|cause| Error::io(cache, "a folder for references", &cause))?;
    let size = scene.image_size();
    let request = json!({
        "scene": scene,
        "folder": scene.folder,
        "exr": path,
        "resolution": size,
        "samples": settings.samples,
        "seed": settings.seed,
        "film_transparent": scene.film.transparent,
        "volume_bounces": scene.integrator.volume_bounces,
        "volume_biased": settings.volume_biased,
        "step_rate": settings.step_rate,
        "threads": settings.threads,
        "multilayer": settings.multilayer,
        "metadata": {
            "scene_sha256": scene.content_hash(),
            "request_sha256": key,
            "requested_by": concat!("cloudparity ", env!("CARGO_PKG_VERSION")),
        },
    });
    run_script("reference.py", &request, Kernel::Default, receive)?;
    Ok(Reference { path, key, cached: false })
}

/// SHA-256 of what decides the pixels: scene, settings (without the number of threads), version,
/// and the scripts that turn a scene into a render.
fn request_key(scene: &Scene, settings: &ReferenceSettings, blender: &str) -> String {
    let settings = ReferenceSettings { threads: 0, ..settings.clone() };
    let scripts: String = super::SCRIPTS
        .iter()
        .filter(|(name, _)| RENDER_SCRIPTS.contains(name))
        .map(|(_, text)| files::sha256(text.as_bytes()))
        .collect();
    let request = json!({"scene": scene, "settings": settings, "blender": blender, "scripts": scripts});
    files::sha256(request.to_string().as_bytes())
}

/// The scripts whose text decides what is rendered.
const RENDER_SCRIPTS: [&str; 6] =
    ["reference.py", "reference_render.py", "cycles_settings.py", "scene_builder.py", "graph_builder.py", "rna.py"];

/// `CLOUDPARITY_CACHE`, else `~/.cache/cloudparity`.
pub fn cache_folder() -> Result<PathBuf> {
    if let Some(folder) = std::env::var_os(CACHE_VARIABLE) {
        return Ok(PathBuf::from(folder));
    }
    std::env::home_dir().map(|home| Path::new(&home).join(".cache/cloudparity")).ok_or_else(|| {
        Error::new(
            "cache folder",
            "no home folder",
            "a place to keep references",
            format!("Set {CACHE_VARIABLE} to a folder."),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_is_known_by_its_content() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes/procedural-clouds.scene.json");
        let scene = Scene::load(&path).expect("the committed scene loads");
        let settings = ReferenceSettings::default();
        let key = request_key(&scene, &settings, "5.0.1");
        assert_eq!(key, request_key(&scene, &ReferenceSettings { threads: 2, ..settings.clone() }, "5.0.1"));
        assert_ne!(key, request_key(&scene, &ReferenceSettings { seed: 102, ..settings.clone() }, "5.0.1"));
        assert_ne!(key, request_key(&scene, &settings, "5.0.2"));
        let mut changed = scene.clone();
        changed.film.transparent = !scene.film.transparent;
        assert_ne!(key, request_key(&changed, &settings, "5.0.1"));
    }
}
