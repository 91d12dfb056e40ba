//! Pictures by Cycles, cached by content.
//!
//! A request is identified by everything that decides its pixels: the scene with its overrides, the
//! settings, and Blender's version. The same request is rendered once; after that its EXR comes
//! from the cache folder.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
pub use crate::bridge::cache::{CACHE_VARIABLE, cache_folder};
use crate::bridge::{CyclesKernel, Message, module_version, releases, run_script};
use crate::scene::Scene;
use serde::Serialize;
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};

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
    /// Whether the world is sampled as a light.
    pub world_sampling: WorldSampling,
    /// Replicas are disjoint subsets of one sequence of samples instead of renders with other seeds: these share what Cycles draws by the
    /// number of a sample alone, such as the order of its estimator of transmittance. The replica that is called by seed
    /// [`FIRST_REPLICA_SEED`] + k then is subset k.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub by_subset: bool,
}

/// How Cycles finds the light of the world.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "SCREAMING_SNAKE_CASE")]
pub enum WorldSampling {
    /// By chance alone: right for every medium, noisy where the world has small bright parts.
    #[default]
    None,
    /// As a light too, where it is not constant: less noise, and too bright in Cycles 5.0.1 where the medium has
    /// more than one phase lobe.
    Automatic,
}

/// A level of effort: samples and replicas.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// Seconds for small pictures: 64 samples, 8 replicas.
    Ci,
    /// Minutes: 1024 samples, 4 replicas.
    Standard,
    /// To be stored: 4096 samples, 4 replicas.
    Converged,
}

impl Quality {
    /// Samples per pixel of each replica.
    pub fn samples(self) -> u32 {
        match self {
            Self::Ci => 64,
            Self::Standard => 1024,
            Self::Converged => 4096,
        }
    }

    /// Number of replicas.
    pub fn replicas(self) -> u32 {
        match self {
            Self::Ci => 8,
            Self::Standard | Self::Converged => 4,
        }
    }
}

/// Seed of the first of several replicas; the others count on from it. Ours begin at 100, so the seeds of the two
/// sides are disjoint.
pub const FIRST_REPLICA_SEED: u32 = 5000;

impl Default for ReferenceSettings {
    fn default() -> Self {
        Self {
            samples: 256,
            seed: 101,
            volume_biased: false,
            step_rate: 0.1,
            threads: 0,
            multilayer: false,
            world_sampling: WorldSampling::None,
            by_subset: false,
        }
    }
}

/// Subsets that a sequence of samples has: fixed, so that a subset does not depend on how many are rendered.
pub const MOST_SUBSETS: u32 = 64;

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

/// The picture of `scene` by Cycles: from the folder `cache`, or rendered into it now.
pub fn reference(
    scene: &Scene,
    settings: &ReferenceSettings,
    cache: &Path,
    receive: impl FnMut(Message),
) -> Result<Reference> {
    let mut found = references(scene, settings, &[settings.seed], cache, receive)?;
    Ok(found.remove(0))
}

/// The pictures of `scene` by Cycles with each of `seeds` (that of `settings` is not used). Those that the folder
/// `cache` lacks are rendered in one process, and each is kept as soon as it is done.
pub fn references(
    scene: &Scene,
    settings: &ReferenceSettings,
    seeds: &[u32],
    cache: &Path,
    mut receive: impl FnMut(Message),
) -> Result<Vec<Reference>> {
    releases::with_values_of(scene.graph().blender, || references_here(scene, settings, seeds, cache, &mut receive))
}

/// [`references`] by the present interpreter.
fn references_here(
    scene: &Scene,
    settings: &ReferenceSettings,
    seeds: &[u32],
    cache: &Path,
    receive: &mut dyn FnMut(Message),
) -> Result<Vec<Reference>> {
    let subsets = FIRST_REPLICA_SEED..FIRST_REPLICA_SEED + MOST_SUBSETS;
    if settings.by_subset && !seeds.iter().all(|seed| subsets.contains(seed)) {
        return Err(Error::new(
            "replicas by subset",
            format!("{} of them", seeds.len()),
            format!("at most {MOST_SUBSETS}, and no seed: all are of one sequence"),
            "Take fewer, or replicas by seed.",
        ));
    }
    let blender = blender_version()?;
    let found: Vec<Reference> = seeds
        .iter()
        .map(|&seed| {
            let key = request_key(scene, &ReferenceSettings { seed, ..settings.clone() }, &blender);
            let path = cache.join(format!("{key}.exr"));
            Reference { cached: path.exists(), path, key }
        })
        .collect();
    let missing: Vec<Json> = found
        .iter()
        .zip(seeds)
        .filter(|(reference, _)| !reference.cached)
        .map(|(reference, seed)| {
            let mut replica =
                json!({"seed": seed, "exr": reference.path, "metadata": {"request_sha256": reference.key}});
            if settings.by_subset {
                replica["seed"] = json!(FIRST_REPLICA_SEED);
                replica["subset"] = json!([(seed - FIRST_REPLICA_SEED) * settings.samples, settings.samples]);
            }
            replica
        })
        .collect();
    if missing.is_empty() {
        return Ok(found);
    }
    files::make_folder(cache, "a folder for references")?;
    let request = json!({
        "scene": scene,
        "folder": scene.folder,
        "replicas": missing,
        "resolution": scene.image_size(),
        "samples": if settings.by_subset { settings.samples * MOST_SUBSETS } else { settings.samples },
        "film_transparent": scene.film.transparent,
        "volume_bounces": scene.integrator.volume_bounces,
        "volume_biased": settings.volume_biased,
        "step_rate": settings.step_rate,
        "threads": settings.threads,
        "multilayer": settings.multilayer,
        "world_sampling": settings.world_sampling,
        "metadata": {
            "scene_sha256": scene.content_hash(),
            "requested_by": format!("cloudparity {}", Identity::current().full()),
        },
    });
    run_script(
        if settings.by_subset { SUBSET_SCRIPT } else { "reference.py" },
        &request,
        CyclesKernel::Default,
        receive,
    )?;
    Ok(found)
}

/// The keys of the pictures of `scene` by Cycles with each of `seeds`, whether the cache has them or not.
pub fn keys(scene: &Scene, settings: &ReferenceSettings, seeds: &[u32]) -> Result<Vec<String>> {
    let blender = releases::with_values_of(scene.graph().blender, blender_version)?;
    Ok(seeds
        .iter()
        .map(|&seed| request_key(scene, &ReferenceSettings { seed, ..settings.clone() }, &blender))
        .collect())
}

/// Blender's version; an error where live Cycles cannot be asked.
fn blender_version() -> Result<String> {
    module_version("bpy", "bpy.app.version_string").map_err(|cause| {
        Error::new(
            "interpreter",
            cause,
            "the module bpy",
            "Run make setup, or compare with a reference that exists already.",
        )
    })
}

/// SHA-256 of what decides the pixels: scene, settings (without the number of threads), version,
/// and the scripts that turn a scene into a render.
///
/// The build is no part of it. These pixels are Cycles', and nothing of ours but the scripts has part in them: an edit of a shader must not
/// cost hours of rendering the same reference again. Which build asked for it is in the file's attribute `requested_by`.
fn request_key(scene: &Scene, settings: &ReferenceSettings, blender: &str) -> String {
    let settings = ReferenceSettings { threads: 0, ..settings.clone() };
    let scripts: String = super::SCRIPTS
        .iter()
        .filter(|(name, _)| RENDER_SCRIPTS.contains(name) || (settings.by_subset && *name == SUBSET_SCRIPT))
        .map(|(_, text)| files::sha256(text.as_bytes()))
        .collect();
    let request = json!({"scene": scene, "settings": settings, "blender": blender, "scripts": scripts});
    files::sha256(request.to_string().as_bytes())
}

/// The scripts whose text decides what is rendered.
const RENDER_SCRIPTS: [&str; 7] = [
    "reference.py",
    "reference_render.py",
    "cycles_settings.py",
    "scene_builder.py",
    "graph_builder.py",
    "node_data.py",
    "rna.py",
];

/// What renders replicas by subset.
const SUBSET_SCRIPT: &str = "subset_reference.py";

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
        let sampled = ReferenceSettings { world_sampling: WorldSampling::Automatic, ..settings.clone() };
        assert_ne!(key, request_key(&scene, &sampled, "5.0.1"));
        assert_eq!(serde_json::to_value(&sampled).unwrap()["world_sampling"], "AUTOMATIC");
        assert_ne!(key, request_key(&scene, &settings, "5.0.2"));
        let by_subset = ReferenceSettings { by_subset: true, ..settings.clone() };
        assert_ne!(key, request_key(&scene, &by_subset, "5.0.1"));
        let one_too_many: Vec<u32> = (FIRST_REPLICA_SEED..=FIRST_REPLICA_SEED + MOST_SUBSETS).collect();
        let cache = tempfile::tempdir().expect("a folder");
        let error = references_here(&scene, &by_subset, &one_too_many, cache.path(), &mut |_| ()).expect_err("refused");
        assert!(error.expected.contains("at most 64"), "{error}");
        let mut changed = scene.clone();
        changed.film.transparent = !scene.film.transparent;
        assert_ne!(key, request_key(&changed, &settings, "5.0.1"));
    }
}
