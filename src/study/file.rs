//! Study files (`*.study.toml`): what is varied, and the runs that follow from it.

use super::errors::FEWEST_REPLICAS;
use crate::density;
use crate::error::{Error, Result};
use crate::files;
use crate::integrate::CacheFormat;
use crate::integrate::engine::EngineJitter;
use crate::lighting::models;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-study/1";

/// A study file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    /// [`FORMAT`].
    pub format: String,
    /// Headline of what is made of it.
    pub title: String,
    /// Pixels of every picture.
    pub resolution: [u32; 2],
    /// What errors are measured against.
    #[serde(default)]
    pub truth: Truth,
    /// How time is measured.
    #[serde(default)]
    pub timing: Timing,
    /// What is varied.
    pub axes: Axes,
}

/// Path tracing of the same medium, in independent replicas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Truth {
    /// Paths per pixel and replica.
    pub samples: u32,
    /// Replicas, at least 6: they say how uncertain the truth is.
    pub replicas: u32,
    /// Voxels per axis of the grid by which path tracing sees a published density model.
    pub voxels: usize,
}

impl Default for Truth {
    fn default() -> Self {
        Self { samples: 64, replicas: 8, voxels: 128 }
    }
}

/// How time is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Timing {
    /// Timed renders after one that does not count; their median counts.
    pub repeats: u32,
}

impl Default for Timing {
    fn default() -> Self {
        Self { repeats: 3 }
    }
}

/// What is varied. Every combination is a run, but for those that mean nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes {
    /// Scenes.
    pub scenes: Vec<SceneAxis>,
    /// Density models: `graph` is the scene's own.
    pub densities: Vec<String>,
    /// Light models by name.
    pub lights: Vec<String>,
    /// Steps of a view ray.
    pub steps: Vec<u32>,
    /// Steps towards the sun.
    pub light_steps: Vec<u32>,
    /// Density caches of the graph.
    #[serde(default = "no_cache")]
    pub caches: Vec<CacheAxis>,
    /// Rays per pixel and axis.
    #[serde(default = "one_ray")]
    pub sub_pixels: Vec<u32>,
    /// Where in its steps a ray takes its samples.
    #[serde(default = "no_jitter")]
    pub jitter: Vec<EngineJitter>,
}

fn no_cache() -> Vec<CacheAxis> {
    vec![CacheAxis { cells: 0, format: CacheFormat::F16 }]
}

fn one_ray() -> Vec<u32> {
    vec![1]
}

fn no_jitter() -> Vec<EngineJitter> {
    vec![EngineJitter::None]
}

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneAxis {
    /// The scene file, relative to the study file.
    pub file: String,
    /// Its name in the results; the scene's own if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Changes of stored values: `"Density=10"`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// Scattering events beyond the first, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_bounces: Option<u32>,
}

/// A density cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CacheAxis {
    /// Cells along the longest side; 0 evaluates the graph at each place.
    pub cells: u32,
    /// How values are stored.
    #[serde(default = "half")]
    pub format: CacheFormat,
}

fn half() -> CacheFormat {
    CacheFormat::F16
}

/// One point of the axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Combination {
    /// Name of the scene.
    pub scene: String,
    /// Density model.
    pub density: String,
    /// Light model.
    pub light: String,
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards the sun.
    pub light_steps: u32,
    /// Density cache of the graph.
    pub cache: CacheAxis,
    /// Rays per pixel and axis.
    pub sub_pixels: u32,
    /// Where in its steps a ray takes its samples.
    pub jitter: EngineJitter,
}

/// A combination that is left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Skipped {
    /// Which.
    pub combination: Combination,
    /// Why it would say nothing.
    pub reason: String,
}

impl StudyFile {
    /// Reads and checks a study file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a study file (*.study.toml)")?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Reads a study from text; `place` names where it stands.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let deserializer = toml::Deserializer::parse(text).map_err(|cause| syntax(text, place, &cause))?;
        let study: Self = serde_path_to_error::deserialize(deserializer).map_err(|cause| {
            let path = cause.path().to_string();
            let inner = cause.into_inner();
            let mut error = syntax(text, place, &inner);
            error.place = format!("{}, {path}", error.place);
            error
        })?;
        study.check(place)?;
        Ok(study)
    }

    fn check(&self, place: &str) -> Result<()> {
        let wrong = |name: &str, found: String, expected: String| {
            Err(Error::new(format!("{place}, {name}"), found, expected, "Correct the study file."))
        };
        if self.format != FORMAT {
            return wrong("format", format!("\"{}\"", self.format), format!("\"{FORMAT}\""));
        }
        if self.resolution.iter().any(|&side| !(1..=16384).contains(&side)) {
            return wrong("resolution", format!("{:?}", self.resolution), "1 to 16384 pixels per side".into());
        }
        let Truth { samples, replicas, voxels } = self.truth;
        if samples == 0 || !(FEWEST_REPLICAS as u32..=64).contains(&replicas) || !(8..=512).contains(&voxels) {
            let found = format!("{samples} samples, {replicas} replicas, {voxels} voxels");
            return wrong(
                "truth",
                found,
                format!("at least 1 sample, {FEWEST_REPLICAS} to 64 replicas, 8 to 512 voxels"),
            );
        }
        if !(1..=100).contains(&self.timing.repeats) {
            return wrong("timing.repeats", self.timing.repeats.to_string(), "1 to 100".into());
        }
        let axes = &self.axes;
        let lengths = [
            ("scenes", axes.scenes.len()),
            ("densities", axes.densities.len()),
            ("lights", axes.lights.len()),
            ("steps", axes.steps.len()),
            ("light_steps", axes.light_steps.len()),
            ("caches", axes.caches.len()),
            ("sub_pixels", axes.sub_pixels.len()),
            ("jitter", axes.jitter.len()),
        ];
        if let Some((name, _)) = lengths.iter().find(|(_, length)| *length == 0) {
            return wrong(&format!("axes.{name}"), "an empty list".into(), "at least one value".into());
        }
        for (index, name) in axes.densities.iter().enumerate() {
            density::find(name).map_err(|error| at(error, place, &format!("axes.densities[{index}]")))?;
        }
        for (index, name) in axes.lights.iter().enumerate() {
            models::find(name).map_err(|error| at(error, place, &format!("axes.lights[{index}]")))?;
        }
        for (name, values, most) in [
            ("steps", &axes.steps, 100_000),
            ("light_steps", &axes.light_steps, 1000),
            ("sub_pixels", &axes.sub_pixels, 64),
        ] {
            if let Some(value) = values.iter().find(|value| !(1..=most).contains(*value)) {
                return wrong(&format!("axes.{name}"), value.to_string(), format!("whole numbers from 1 to {most}"));
            }
        }
        if let Some(cache) = axes.caches.iter().find(|cache| cache.cells > 1024) {
            return wrong("axes.caches", format!("{} cells", cache.cells), "0 to 1024 cells".into());
        }
        Ok(())
    }

    /// The scenes, at the resolution of the study.
    pub fn scenes(&self, folder: &Path) -> Result<Vec<Scene>> {
        let mut scenes: Vec<Scene> = Vec::new();
        for axis in &self.axes.scenes {
            let mut scene = Scene::load(&folder.join(&axis.file))?;
            self.prepare(axis, &mut scene)?;
            if scenes.iter().any(|other| other.name == scene.name) {
                return Err(Error::new(
                    format!("axes.scenes, {}", axis.file),
                    format!("a second scene named \"{}\"", scene.name),
                    "scenes of different names, by which results are told apart",
                    "Give one of them another name, or take it out.",
                ));
            }
            scenes.push(scene);
        }
        Ok(scenes)
    }

    /// Makes a scene the one that an axis asks for, at the resolution of the study.
    pub fn prepare(&self, axis: &SceneAxis, scene: &mut Scene) -> Result<()> {
        axis.set.iter().try_for_each(|assignment| scene.set(assignment))?;
        if let Some(name) = &axis.name {
            scene.name.clone_from(name);
        }
        if let Some(bounces) = axis.volume_bounces {
            scene.set_volume_bounces(bounces);
        }
        scene.film.resolution = self.resolution;
        scene.film.resolution_percentage = 100;
        Ok(())
    }

    /// Every combination of the axes, those that mean nothing apart.
    pub fn expand(&self, scenes: &[Scene]) -> (Vec<Combination>, Vec<Skipped>) {
        let (mut wanted, mut skipped) = (Vec::new(), Vec::new());
        let axes = &self.axes;
        for (scene, density) in
            scenes.iter().flat_map(|scene| axes.densities.iter().map(move |density| (scene, density)))
        {
            for (light, &steps) in
                axes.lights.iter().flat_map(|light| axes.steps.iter().map(move |steps| (light, steps)))
            {
                for (&light_steps, &cache) in
                    axes.light_steps.iter().flat_map(|steps| axes.caches.iter().map(move |cache| (steps, cache)))
                {
                    for (&sub_pixels, &jitter) in
                        axes.sub_pixels.iter().flat_map(|rays| axes.jitter.iter().map(move |jitter| (rays, jitter)))
                    {
                        let combination = Combination {
                            scene: scene.name.clone(),
                            density: density.clone(),
                            light: light.clone(),
                            steps,
                            light_steps,
                            cache,
                            sub_pixels,
                            jitter,
                        };
                        match self.meaningless(scene, &combination) {
                            Some(reason) => skipped.push(Skipped { combination, reason }),
                            None => wanted.push(combination),
                        }
                    }
                }
            }
        }
        wanted.sort_by_key(Combination::cost);
        (wanted, skipped)
    }

    /// Why a combination would only repeat another one.
    fn meaningless(&self, scene: &Scene, combination: &Combination) -> Option<String> {
        if combination.density != density::graph::MODEL.id && combination.cache != self.axes.caches[0] {
            return Some(
                "the density is no graph: it has no density cache, and one of the caches stands for all".into(),
            );
        }
        let is_dark = scene.lights.iter().all(|light| light.strength == 0.0);
        if is_dark && combination.light_steps != self.axes.light_steps[0] {
            return Some("the scene has no sun: one number of light steps stands for all".into());
        }
        let of_the_sun = ["octaves", "octaves-deep", "silver"];
        if is_dark && of_the_sun.contains(&combination.light.as_str()) {
            return Some("the scene has no sun, and the light model differs from \"single\" in sunlight alone".into());
        }
        None
    }
}

impl Combination {
    /// The settings in words, scene and density left out.
    pub fn describe(&self) -> String {
        let mut text = format!("{}, {} steps, {} light steps", self.light, self.steps, self.light_steps);
        if self.cache.cells > 0 {
            text += &format!(", cache of {} cells", self.cache.cells);
        }
        if self.sub_pixels > 1 {
            text += &format!(", {0} x {0} rays", self.sub_pixels);
        }
        if self.jitter == EngineJitter::BlueNoise {
            text += ", blue noise";
        }
        text
    }

    /// Densities per pixel, a graph's evaluation counting as several reads: what runs are ordered by.
    fn cost(&self) -> u64 {
        let each: u64 = if self.density == density::graph::MODEL.id && self.cache.cells == 0 { 4 } else { 1 };
        each * u64::from(self.steps) * u64::from(1 + self.light_steps) * u64::from(self.sub_pixels).pow(2)
    }
}

fn at(error: Error, place: &str, path: &str) -> Error {
    Error { place: format!("{place}, {path}"), ..error }
}

fn syntax(text: &str, place: &str, cause: &toml::de::Error) -> Error {
    let line = cause.span().map(|span| text[..span.start.min(text.len())].lines().count().max(1));
    let place = line.map_or_else(|| place.to_owned(), |line| format!("{place}, line {line}"));
    Error::new(place, cause.message(), "a study file", "Correct the study file; docs/studies.md describes it.")
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = r#"
        format = "cloudparity-study/1"
        title = "test"
        resolution = [16, 9]

        [axes]
        scenes = [{ file = "a.scene.json" }]
        densities = ["graph", "perlin-fbm"]
        lights = ["single", "octaves"]
        steps = [8, 4]
        light_steps = [1, 2]
        caches = [{ cells = 0 }, { cells = 32, format = "unorm8" }]
    "#;

    #[test]
    fn every_combination_is_there_once_and_those_that_mean_nothing_have_a_reason() {
        let study = StudyFile::parse(STUDY, "test").expect("a study");
        let mut scene = Scene::load(Path::new("parity/scenes/linear-ramp.scene.json")).expect("a scene");
        let (wanted, skipped) = study.expand(&[scene.clone()]);
        // Graph: 2 lights x 2 x 2 steps x 2 caches; perlin-fbm the same without the second cache.
        assert_eq!((wanted.len(), skipped.len()), (24, 8));
        assert!(skipped.iter().all(|skipped| skipped.combination.density == "perlin-fbm"));
        assert!(wanted.is_sorted_by_key(Combination::cost));
        let mut seen: Vec<String> = wanted.iter().map(|one| serde_json::to_string(one).unwrap()).collect();
        seen.sort();
        seen.dedup();
        assert_eq!(seen.len(), 24);
        scene.lights.iter_mut().for_each(|light| light.strength = 0.0);
        let (wanted, skipped) = study.expand(&[scene]);
        assert_eq!((wanted.len(), skipped.len()), (6, 26));
        assert!(skipped.iter().any(|skipped| skipped.reason.contains("no sun")));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let error =
            |from: &str, to: &str| StudyFile::parse(&STUDY.replace(from, to), "a.study.toml").expect_err("refused");
        let found = error("lights =", "lamps =");
        assert!(found.to_string().contains("lamps") && found.to_string().contains("light_steps"), "{found}");
        assert!(found.place.contains("line"), "{}", found.place);
        let found = error("\"octaves\"", "\"moon\"");
        assert!(found.place.contains("axes.lights[1]") && found.expected.contains("octaves-deep"), "{found}");
        let found = error("\"graph\"", "\"grapf\"");
        assert!(found.expected.contains("perlin-fbm"), "{found}");
        assert!(error("[8, 4]", "[]").place.contains("axes.steps"));
        assert!(error("[8, 4]", "[0]").place.contains("axes.steps"));
        assert!(error("[16, 9]", "[0, 9]").place.contains("resolution"));
        assert!(error("study/1", "study/2").expected.contains(FORMAT));
        assert!(error("title = \"test\"", "title = ").place.contains("line 3"));
        assert!(error("cells = 32", "cells = 4096").place.contains("axes.caches"));
    }
}
