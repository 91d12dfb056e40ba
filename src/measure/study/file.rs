//! Study files (`*.study.toml`): what is varied, and the runs that follow from it.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::engines;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::render::EngineJitter;
use crate::measure::combination::{CacheAxis, Combination, Quality, no_cache};
use crate::measure::scenes::{SceneAxis, check_resolution, load_scenes};
use crate::measure::study::curves::PARTS;
use crate::measure::toml_files::{at, read_toml};
use crate::measure::truth::Truth;
use crate::scene::Scene;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Most samples of a curve.
const MOST_SAMPLES: u32 = 1 << 16;

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
    /// Unbiased renderers whose error against time is shown beside the runs'.
    #[serde(default, skip_serializing_if = "Curves::is_empty")]
    pub curves: Curves,
    /// What is varied.
    pub axes: Axes,
}

/// Curves of unbiased renderers, by their samples per pixel.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Curves {
    /// Samples of path tracing, each a render of its own.
    pub path: Vec<u32>,
    /// Most samples of Cycles by density model, a multiple of [`PARTS`]; smaller numbers, down to a [`PARTS`]th, come from the same render.
    pub cycles: IndexMap<String, u32>,
}

impl Curves {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// How time is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Timing {
    /// Timed renders after one that does not count; their median counts.
    pub repeats: u32,
    /// What renders the runs.
    #[serde(skip_serializing_if = "Worker::is_cpu")]
    pub on: Worker,
}

impl Default for Timing {
    fn default() -> Self {
        Self { repeats: 3, on: Worker::Cpu }
    }
}

/// What renders a study's runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Worker {
    /// All cores, timed by processor time.
    #[default]
    Cpu,
    /// The adapter: timed by its timestamps, or by processor time where it is software.
    Adapter,
}

impl Worker {
    fn is_cpu(&self) -> bool {
        *self == Self::Cpu
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
    /// Defects of the published densities that their engines keep.
    #[serde(default = "no_defects", skip_serializing_if = "are_mended")]
    pub defects: Vec<Defects>,
}

fn one_ray() -> Vec<u32> {
    vec![1]
}

fn no_defects() -> Vec<Defects> {
    vec![Defects::NONE]
}

fn are_mended(defects: &[Defects]) -> bool {
    defects == [Defects::NONE]
}

fn no_jitter() -> Vec<EngineJitter> {
    vec![EngineJitter::None]
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
        let study: Self = read_toml(text, place, "docs/studies.md")?;
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
        check_resolution(self.resolution, place)?;
        self.truth.check(place)?;
        if !(1..=100).contains(&self.timing.repeats) {
            return wrong("timing.repeats", self.timing.repeats.to_string(), "1 to 100".into());
        }
        let axes = &self.axes;
        if let Some(samples) = self.curves.path.iter().find(|samples| !(1..=MOST_SAMPLES).contains(*samples)) {
            return wrong("curves.path", samples.to_string(), format!("1 to {MOST_SAMPLES} samples"));
        }
        for (density, &samples) in &self.curves.cycles {
            let name = format!("curves.cycles.{density}");
            if !axes.densities.contains(density) {
                return wrong(
                    &name,
                    format!("\"{density}\""),
                    format!("one of axes.densities: {}", axes.densities.join(", ")),
                );
            }
            if samples == 0 || !samples.is_multiple_of(PARTS) || samples > MOST_SAMPLES {
                return wrong(&name, samples.to_string(), format!("a multiple of {PARTS} up to {MOST_SAMPLES}"));
            }
        }
        let lengths = [
            ("scenes", axes.scenes.len()),
            ("densities", axes.densities.len()),
            ("lights", axes.lights.len()),
            ("steps", axes.steps.len()),
            ("light_steps", axes.light_steps.len()),
            ("caches", axes.caches.len()),
            ("sub_pixels", axes.sub_pixels.len()),
            ("jitter", axes.jitter.len()),
            ("defects", axes.defects.len()),
        ];
        if let Some((name, _)) = lengths.iter().find(|(_, length)| *length == 0) {
            return wrong(&format!("axes.{name}"), "an empty list".into(), "at least one value".into());
        }
        for (index, name) in axes.densities.iter().enumerate() {
            engines::find(name).map_err(|error| at(error, place, &format!("axes.densities[{index}]")))?;
        }
        for (index, name) in axes.lights.iter().enumerate() {
            models::find(name).map_err(|error| at(error, place, &format!("axes.lights[{index}]")))?;
        }
        for (quality, values) in [
            (&Quality::STEPS, &axes.steps),
            (&Quality::LIGHT_STEPS, &axes.light_steps),
            (&Quality::SUB_PIXELS, &axes.sub_pixels),
        ] {
            values.iter().try_for_each(|&value| quality.check(value, place, "axes"))?;
        }
        if let Some(cache) = axes.caches.iter().find(|cache| cache.cells > 1024) {
            return wrong("axes.caches", format!("{} cells", cache.cells), "0 to 1024 cells".into());
        }
        Ok(())
    }

    /// The scenes, at the resolution of the study.
    pub fn scenes(&self, folder: &Path) -> Result<Vec<Scene>> {
        load_scenes(&self.axes.scenes, folder, self.resolution, "axes.scenes")
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
                    for ((&sub_pixels, &jitter), defects) in axes
                        .sub_pixels
                        .iter()
                        .flat_map(|rays| axes.jitter.iter().map(move |jitter| (rays, jitter)))
                        .flat_map(|one| axes.defects.iter().map(move |defects| (one, defects)))
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
                            defects: defects.clone(),
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
        if combination.density != engines::graph::MODEL.id && combination.cache != self.axes.caches[0] {
            return Some(
                "the density is no graph: it has no density cache, and one of the caches stands for all".into(),
            );
        }
        let model = engines::find(&combination.density).expect("it was checked");
        let Ok(kept) = combination.defects.of_model(model) else {
            return Some(format!("density model {} has none of the defects {}", model.id, combination.defects));
        };
        let before = self.axes.defects.iter().take_while(|other| **other != combination.defects);
        if before.filter_map(|other| other.of_model(model).ok()).any(|other| other == kept) {
            return Some(format!("density model {} has these defects in an earlier value of the axis", model.id));
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
        // A graph has no defects, so that none is all; PF-4 is not among what it could keep.
        let kept = STUDY.replace("caches =", "defects = [\"none\", \"PF-4\", \"all\"]\ncaches =");
        let (with_defects, left_out) =
            StudyFile::parse(&kept, "test").expect("a study").expand(std::slice::from_ref(&scene));
        assert_eq!((with_defects.len(), left_out.len()), (16 + 3 * 8, 3 * 32 - 40));
        assert!(with_defects.iter().all(|one| one.density == "perlin-fbm" || one.defects.is_none()));
        assert!(left_out.iter().any(|skipped| skipped.reason.contains("none of the defects PF-4")));
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
        assert!(error("caches =", "defects = []\ncaches =").place.contains("axes.defects"));
        assert!(error("caches =", "defects = [\"PF-99\"]\ncaches =").to_string().contains("PF-4, PF-5"));
        assert!(error("caches =", "variant = \"fixed\"\ncaches =").remedy.contains("defects = "));
        assert!(error("cells = 32", "cells = 4096").place.contains("axes.caches"));
        let curves = |text: &str| error("[axes]", &format!("[curves]\n{text}\n[axes]"));
        assert!(curves("path = [0]").place.contains("curves.path"));
        assert!(curves("cycles = { graph = 20 }").expected.contains("multiple of 16"));
        assert!(curves("cycles = { fog = 16 }").expected.contains("perlin-fbm"));
    }
}
