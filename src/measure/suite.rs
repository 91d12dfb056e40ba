//! Parity suites (`*.suite.json`): scenes, how much of each is rendered, and the pictures of both sides.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::bridge::reference::{
    FIRST_REPLICA_SEED, MOST_SUBSETS, Reference, ReferenceSettings, WorldSampling, cache_folder, keys, references,
};
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{PathSettings, State};
use crate::measure::experiment::Desk;
use crate::scene::image::Image;
use crate::scene::{self, Scene};
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-suite/1";

/// Seed of our first replica. Cycles' begin at [`FIRST_REPLICA_SEED`], so the two sides' are disjoint.
const FIRST_SEED: u32 = 100;

/// Fewest replicas: below, a single pixel can hardly be told from another (section 8.2 of the specification of
/// transport: the critical t for 64 x 64 pixels is 8.4 with 8 replicas, 20.7 with 4).
const FEWEST_REPLICAS: u32 = 8;

/// A suite file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Suite {
    /// Always `cloudparity-suite/1`.
    pub format: String,
    /// What is compared.
    pub entries: Vec<Entry>,
}

/// A scene, what is changed in it, and how much is rendered.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Short name, used for files.
    pub name: String,
    /// What it shows, in a line.
    pub about: String,
    /// The scene file, relative to the suite file.
    pub scene: String,
    /// Stored values to change, each `NAME=VALUE`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// Scattering events beyond the first, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_bounces: Option<u32>,
    /// Width and height of a replica in pixels, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resolution: Option<[u32; 2]>,
    /// Samples per pixel of each replica, on both sides.
    pub samples: u32,
    /// How replicas are made.
    pub replicas: Replicas,
    /// Whether Cycles samples the world as a light: needed for a picture as world, wrong with several lobes.
    #[serde(default)]
    pub sample_world: bool,
}

/// How replicas are made.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Replicas {
    /// That many renders per side, each with its own seed.
    Seeds(u32),
    /// That many per side: of Cycles disjoint subsets of one sequence of samples, whose spread has what all seeds share; of ours seeds.
    Subsets(u32),
    /// One render per side at that many times the resolution per axis; the images at each position of the sub-pixels are the
    /// replicas, in pairs. For scenes whose preparation in Cycles takes minutes.
    SubPixels(u32),
}

impl Suite {
    /// Reads and checks a suite file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a parity suite (*.suite.json)")?;
        let place = path.display().to_string();
        let suite: Self = scene::parse(&text, &place, "a parity suite (parity/parity.suite.json is one)")?;
        if suite.format != FORMAT {
            return Err(Error::new(
                format!("{place}: $.format"),
                format!("\"{}\"", suite.format),
                format!("\"{FORMAT}\""),
                "Use the version of the program that wrote the file.",
            ));
        }
        for (number, entry) in suite.entries.iter().enumerate() {
            let wrong = |field: &str, found: String, expected: &str| {
                Err(Error::new(format!("{place}: $.entries[{number}].{field}"), found, expected, "Correct the value."))
            };
            let plain = |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter);
            if entry.name.is_empty() || !entry.name.chars().all(plain) {
                return wrong("name", format!("\"{}\"", entry.name), "letters, digits, - and _: it names a folder");
            }
            if suite.entries[..number].iter().any(|other| other.name == entry.name) {
                return wrong("name", format!("\"{}\" a second time", entry.name), "names that differ");
            }
            if !(1..=path::MOST_SAMPLES).contains(&entry.samples) {
                return wrong("samples", entry.samples.to_string(), "1 to 16777216");
            }
            let (count, most) = match entry.replicas {
                Replicas::Seeds(count) => (count, 1024),
                Replicas::Subsets(count) => (count, MOST_SUBSETS),
                Replicas::SubPixels(factor) => (factor.saturating_mul(factor), 64 * 64),
            };
            if !(FEWEST_REPLICAS..=most).contains(&count) {
                return wrong(
                    "replicas",
                    format!("{count} replicas"),
                    "8 or more, at most 64 by subset; 3 to 64 sub-pixels per axis",
                );
            }
        }
        Ok(suite)
    }

    /// All entries, or those named.
    pub(crate) fn chosen(&self, only: &[String]) -> Result<Vec<&Entry>> {
        if let Some(name) = only.iter().find(|name| self.entries.iter().all(|entry| entry.name != **name)) {
            let known: Vec<&str> = self.entries.iter().map(|entry| entry.name.as_str()).collect();
            return Err(Error::new(
                format!("entry {name}"),
                "no such entry",
                known.join(", "),
                "Give the name of an entry of the suite.",
            )
            .with_setting("only"));
        }
        Ok(self.entries.iter().filter(|entry| only.is_empty() || only.contains(&entry.name)).collect())
    }
}

impl Entry {
    /// The scene with its changes, at the resolution of the renders.
    fn load(&self, folder: &Path) -> Result<Scene> {
        let mut scene = Scene::load_with(&folder.join(&self.scene), &self.set)?;
        if let Some(bounces) = self.volume_bounces {
            scene.set_volume_bounces(bounces);
        }
        let size = self.resolution.unwrap_or_else(|| scene.image_size());
        let factor = self.sub_pixels().unwrap_or(1);
        scene.film.resolution = size.map(|side| side * factor);
        scene.film.resolution_percentage = 100;
        Ok(scene)
    }

    /// How Cycles renders it.
    pub(crate) fn reference_settings(&self) -> ReferenceSettings {
        ReferenceSettings {
            samples: self.samples,
            world_sampling: if self.sample_world { WorldSampling::Automatic } else { WorldSampling::None },
            by_subset: matches!(self.replicas, Replicas::Subsets(_)),
            ..ReferenceSettings::default()
        }
    }

    pub(crate) fn sub_pixels(&self) -> Option<u32> {
        match self.replicas {
            Replicas::Seeds(_) | Replicas::Subsets(_) => None,
            Replicas::SubPixels(factor) => Some(factor),
        }
    }

    /// How many renders each side takes.
    fn renders(&self) -> u32 {
        match self.replicas {
            Replicas::Seeds(count) | Replicas::Subsets(count) => count,
            Replicas::SubPixels(_) => 1,
        }
    }

    /// Seeds of our renders. They stay below those of Cycles, which its cached pictures are known by: that the two sides share none is what
    /// counts, and two scenes may.
    fn seeds(&self) -> std::ops::Range<u32> {
        FIRST_SEED..FIRST_SEED + self.renders()
    }

    /// Seeds of Cycles' renders.
    fn reference_seeds(&self) -> Vec<u32> {
        match self.replicas {
            Replicas::Seeds(count) | Replicas::Subsets(count) => {
                (FIRST_REPLICA_SEED..FIRST_REPLICA_SEED + count).collect()
            }
            Replicas::SubPixels(_) => vec![self.reference_settings().seed],
        }
    }
}

/// An entry with its scene, ready to be rendered.
pub(crate) struct Case {
    pub(crate) entry: Entry,
    /// At the resolution of the renders.
    pub(crate) scene: Scene,
    /// Keys of Cycles' pictures, whether they are in the cache or not.
    references: Vec<String>,
}

/// Both sides' pictures of an entry.
pub(crate) struct Pictures {
    pub(crate) references: Vec<Reference>,
    pub(crate) ours: Vec<PathBuf>,
    /// The build that rendered ours.
    pub(crate) build: Identity,
}

/// Our pictures of an entry: names below the folder of the experiment.
#[derive(Serialize, Deserialize)]
struct OurPictures {
    files: Vec<String>,
}

impl Case {
    /// An entry whose suite file lies in `folder`. Needs bpy, whose version is part of the references' keys.
    pub(crate) fn new(entry: &Entry, folder: &Path) -> Result<Self> {
        let scene = entry.load(folder)?;
        let references = keys(&scene, &entry.reference_settings(), &entry.reference_seeds())?;
        Ok(Self { entry: entry.clone(), scene, references })
    }

    /// All that both sides' pictures depend on, but for the build.
    pub(crate) fn inputs(&self) -> Json {
        json!({"entry": self.entry, "references": self.references, "scene": self.scene})
    }

    /// Cycles' pictures from the cache, rendered where it lacks them, and ours, which are rendered where they are missing.
    pub(crate) fn pictures(&self, desk: &Desk<'_>) -> Result<Pictures> {
        let Self { entry, scene, .. } = self;
        let settings = entry.reference_settings();
        let references = references(scene, &settings, &entry.reference_seeds(), &cache_folder()?, |message| {
            desk.report(0.5 * message.done, &message.what);
        })?;
        let folder = desk.folder()?;
        let ours: OurPictures = desk.obtain("ours", &self.inputs(), |key| {
            let name = |seed: u32| format!("{}/ours-{key}.seed-{seed}.exr", entry.name);
            let seeds: Vec<u32> = entry.seeds().collect();
            let files: Vec<String> = seeds.iter().map(|&seed| name(seed)).collect();
            let settings = PathSettings { samples: entry.samples, seed: FIRST_SEED, ..PathSettings::default() };
            let report = |share: f64, what: &str| desk.report(0.5 + 0.4 * share, what);
            let place = |name: &String| folder.join(name);
            if let [_] = seeds.as_slice() {
                let state = folder.join(format!("{}/ours-{key}.state", entry.name));
                std::fs::create_dir_all(folder.join(&entry.name))
                    .map_err(|cause| Error::io(&state, "a folder for the state of a render", &cause))?;
                let state = State { path: &state, resume: desk.resume.clone() };
                let image = path::render(scene, &settings, Backend::Cpu, Some(&state), &report)?;
                image.write_exr(&place(&files[0]), false)?;
                return Ok(OurPictures { files });
            }
            // What an interrupted run has left is whole: files are written through others.
            let missing: Vec<u32> = seeds.iter().copied().filter(|&seed| !folder.join(name(seed)).exists()).collect();
            let receive = &mut |seed: u32, image: Image| image.write_exr(&folder.join(name(seed)), false);
            path::render_each(scene, &settings, Backend::Cpu, &missing, &report, receive)?;
            Ok(OurPictures { files })
        })?;
        let build = desk.ledger.maker("ours", &desk.ledger.key(&self.inputs()))?.unwrap_or_default();
        let ours = ours.files.iter().map(|name| folder.join(name)).collect();
        Ok(Pictures { references, ours, build })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loaded(change: impl FnOnce(&mut serde_json::Value)) -> Result<Suite> {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/parity.suite.json");
        let text = std::fs::read_to_string(file).expect("the committed suite");
        let mut value: serde_json::Value = serde_json::from_str(&text).expect("it is JSON");
        change(&mut value);
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("changed.suite.json");
        std::fs::write(&file, value.to_string()).expect("it is written");
        Suite::load(&file)
    }

    #[test]
    fn the_committed_suite_loads_and_so_do_its_scenes() {
        // One of them has a grid.
        crate::bridge::install();
        let suite = loaded(|_| ()).expect("the committed suite is one");
        assert!(suite.entries.len() >= 10);
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity");
        for entry in &suite.entries {
            let scene = entry.load(&folder).expect("its scene loads");
            let size = scene.image_size();
            let factor = entry.sub_pixels().unwrap_or(1);
            assert!(size[0] >= 128 * factor && size[1] >= 72 * factor, "{}: {size:?}", entry.name);
        }
    }

    #[test]
    fn a_wrong_entry_is_refused_by_its_place() {
        for (field, value, place) in [
            ("name", json!("../x"), "$.entries[1].name"),
            ("samples", json!(0), "$.entries[1].samples"),
            ("replicas", json!({"seeds": 2}), "$.entries[1].replicas"),
            ("replicas", json!({"sub_pixels": 1000}), "$.entries[1].replicas"),
            ("replicas", json!({"subsets": 65}), "$.entries[1].replicas"),
            ("colour", json!(1), "$.entries[1]"),
        ] {
            let error = loaded(|suite| suite["entries"][1][field] = value).expect_err(field);
            assert!(error.to_string().contains(place), "{error}");
        }
        let twice = |suite: &mut serde_json::Value| suite["entries"][1]["name"] = suite["entries"][0]["name"].clone();
        assert!(loaded(twice).expect_err("a name twice").found.contains("second time"));
    }
}
