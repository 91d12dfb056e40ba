//! Study files (`*.study.toml`): what is varied, and the runs that follow from it.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use crate::engines::Selection;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::parameters::Parameter;
use crate::engines::render::EngineJitter;
use crate::gpu::Backend;
use crate::measure::combination::{CacheAxis, Combination, Quality, no_cache};
use crate::measure::light_volume;
use crate::measure::scenes::{SceneAxis, check_resolution, load_scenes};
use crate::measure::study::ablation::DefectsAxis;
use crate::measure::study::curve_points::PARTS;
use crate::measure::toml_files::{at, read_toml};
use crate::measure::truth::Truth;
use crate::media::light_volume::LightVolumeSettings;
use crate::scene::Scene;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Most samples of a curve.
const MOST_SAMPLES: u32 = 1 << 16;

/// Most combinations of the axes: at a second each, more than a day. A file of a few lines can ask for billions.
const MOST_COMBINATIONS: u64 = 100_000;

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
    /// What renders the runs: all cores, timed by processor time, or the adapter, timed by its timestamps (by processor time where
    /// it is software).
    #[serde(skip_serializing_if = "Backend::is_cpu")]
    pub backend: Backend,
}

impl Default for Timing {
    fn default() -> Self {
        Self { repeats: 3, backend: Backend::Cpu }
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
    /// Light volumes, of light models that imitate no orders of scattering; one of 0 cells is none.
    #[serde(default = "no_light_volume", skip_serializing_if = "are_without_light_volume")]
    pub light_volumes: Vec<LightVolumeSettings>,
    /// Rays per pixel and axis.
    #[serde(default = "one_ray")]
    pub sub_pixels: Vec<u32>,
    /// Where in its steps a ray takes its samples.
    #[serde(default = "no_jitter")]
    pub jitter: Vec<EngineJitter>,
    /// Defects of the published densities that their engines keep.
    #[serde(default = "no_defects", skip_serializing_if = "are_mended")]
    pub defects: Vec<DefectsAxis>,
    /// Whether god rays are added.
    #[serde(default = "no_god_rays", skip_serializing_if = "are_without_god_rays")]
    pub god_rays: Vec<bool>,
    /// Values of further parameters of density, march and passes by name. A density without the parameter ignores its axis.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub parameters: IndexMap<String, Vec<f64>>,
    /// Values of parameters of the light by name.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub light_parameters: IndexMap<String, Vec<f64>>,
}

fn no_light_volume() -> Vec<LightVolumeSettings> {
    vec![LightVolumeSettings::of_cells(0)]
}

fn are_without_light_volume(volumes: &[LightVolumeSettings]) -> bool {
    matches!(volumes, [one] if one.cells == 0)
}

fn no_god_rays() -> Vec<bool> {
    vec![false]
}

fn are_without_god_rays(god_rays: &[bool]) -> bool {
    god_rays == [false]
}

fn one_ray() -> Vec<u32> {
    vec![1]
}

fn no_defects() -> Vec<DefectsAxis> {
    vec![DefectsAxis::Kept(Defects::NONE)]
}

fn are_mended(defects: &[DefectsAxis]) -> bool {
    defects == no_defects()
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
        kinds::want(path, FileKind::Study)?;
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
        let combinations = self.combinations();
        if combinations > MOST_COMBINATIONS {
            return wrong(
                "axes",
                format!("{combinations} combinations"),
                format!("at most {MOST_COMBINATIONS}: axes of fewer values, or fewer axes"),
            );
        }
        for (density, &samples) in &self.curves.cycles {
            let name = format!("curves.cycles.{density}");
            if !self.densities().contains(density) {
                return wrong(
                    &name,
                    format!("\"{density}\""),
                    format!("one of axes.densities, with its parameters: {}", self.densities().join(", ")),
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
            ("light_volumes", axes.light_volumes.len()),
            ("sub_pixels", axes.sub_pixels.len()),
            ("jitter", axes.jitter.len()),
            ("defects", axes.defects.len()),
            ("god_rays", axes.god_rays.len()),
            ("parameters", axes.parameters.values().map(Vec::len).min().unwrap_or(1)),
            ("light_parameters", axes.light_parameters.values().map(Vec::len).min().unwrap_or(1)),
        ];
        if let Some((name, _)) = lengths.iter().find(|(_, length)| *length == 0) {
            return wrong(&format!("axes.{name}"), "an empty list".into(), "at least one value".into());
        }
        for (index, name) in axes.densities.iter().enumerate() {
            Selection::parse(name).map_err(|error| at(error, place, &format!("axes.densities[{index}]")))?;
        }
        for (index, name) in axes.lights.iter().enumerate() {
            models::check(name).map_err(|error| at(error, place, &format!("axes.lights[{index}]")))?;
        }
        for (name, values) in &axes.parameters {
            let path = format!("axes.parameters.{name}");
            let known: Vec<Selection> = axes.densities.iter().filter_map(|text| Selection::parse(text).ok()).collect();
            let Some(owner) = known.iter().find(|one| one.model.has_parameter(name)) else {
                let densities = axes.densities.join(", ");
                return wrong(
                    &path,
                    format!("\"{name}\""),
                    format!("a parameter of one of axes.densities: {densities}"),
                );
            };
            for value in values {
                Parameter::check(owner.model.parameters, name, *value, &path)?;
            }
        }
        for (name, values) in &axes.light_parameters {
            let path = format!("axes.light_parameters.{name}");
            for value in values {
                Parameter::check(models::PARAMETERS, name, *value, &path)?;
            }
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
        for volume in axes.light_volumes.iter().filter(|volume| volume.cells > 0) {
            light_volume::check(volume, &format!("{place}, axes.light_volumes"))?;
        }
        Ok(())
    }

    /// Number of combinations of the axes, those that mean nothing included; the largest number where there are more.
    fn combinations(&self) -> u64 {
        let axes = &self.axes;
        let product = |lengths: &mut dyn Iterator<Item = usize>| {
            lengths.fold(1_u64, |product, length| product.saturating_mul(length as u64))
        };
        let densities = axes.densities.iter().map(|density| {
            let own = axes.parameters.iter().filter(|(name, _)| has_parameter(density, name));
            product(&mut own.map(|(_, values)| values.len())).saturating_mul(self.defect_sets(density).len() as u64)
        });
        let others = [
            axes.scenes.len(),
            axes.lights.len(),
            axes.steps.len(),
            axes.light_steps.len(),
            axes.caches.len(),
            axes.light_volumes.len(),
            axes.sub_pixels.len(),
            axes.jitter.len(),
            axes.god_rays.len(),
        ];
        let of_lights = axes.light_parameters.values().map(Vec::len);
        densities.fold(0, u64::saturating_add).saturating_mul(product(&mut others.into_iter().chain(of_lights)))
    }

    /// The sets of defects that the axis means for a density, each once.
    fn defect_sets(&self, density: &str) -> Vec<Defects> {
        // One that is not known is refused elsewhere.
        let Ok(selection) = Selection::parse(density) else { return Vec::new() };
        let mut sets = Vec::new();
        for set in self.axes.defects.iter().flat_map(|value| value.sets(selection.model)) {
            if !sets.contains(&set) {
                sets.push(set);
            }
        }
        sets
    }

    /// The scenes, at the resolution of the study.
    pub fn scenes(&self, folder: &Path) -> Result<Vec<Scene>> {
        load_scenes(&self.axes.scenes, folder, self.resolution, "axes.scenes")
    }

    /// The densities, each with the values of the parameters that it has.
    pub fn densities(&self) -> Vec<String> {
        with_parameters(&self.axes.densities, &self.axes.parameters, has_parameter)
    }

    /// The lights with the values of their parameters.
    pub fn lights(&self) -> Vec<String> {
        with_parameters(&self.axes.lights, &self.axes.light_parameters, |_, _| true)
    }

    /// Every combination of the axes, those that mean nothing apart.
    pub fn expand(&self, scenes: &[Scene]) -> (Vec<Combination>, Vec<Skipped>) {
        let (mut wanted, mut skipped) = (Vec::new(), Vec::new());
        let axes = &self.axes;
        let (densities, lights) = (self.densities(), self.lights());
        for (scene, density) in scenes.iter().flat_map(|scene| densities.iter().map(move |density| (scene, density))) {
            let defect_sets = self.defect_sets(density);
            for (light, &steps) in lights.iter().flat_map(|light| axes.steps.iter().map(move |steps| (light, steps))) {
                let of_volumes = axes
                    .light_steps
                    .iter()
                    .flat_map(|steps| axes.caches.iter().map(move |cache| (steps, cache)))
                    .flat_map(|one| axes.light_volumes.iter().map(move |volume| (one, volume)));
                for ((&light_steps, &cache), volume) in of_volumes {
                    for (((&sub_pixels, &jitter), defects), &god_rays) in axes
                        .sub_pixels
                        .iter()
                        .flat_map(|rays| axes.jitter.iter().map(move |jitter| (rays, jitter)))
                        .flat_map(|one| defect_sets.iter().map(move |defects| (one, defects)))
                        .flat_map(|one| axes.god_rays.iter().map(move |god_rays| (one, god_rays)))
                    {
                        let combination = Combination {
                            scene: scene.name.clone(),
                            density: density.clone(),
                            light: light.clone(),
                            steps,
                            light_steps,
                            cache,
                            light_volume: (volume.cells > 0).then_some(*volume),
                            sub_pixels,
                            jitter,
                            defects: defects.clone(),
                            god_rays,
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
        let model = Selection::parse(&combination.density).expect("it was checked").model;
        for (parameter, is_first, what) in [
            ("march_steps", combination.steps == self.axes.steps[0], "steps of view rays"),
            ("light_steps", combination.light_steps == self.axes.light_steps[0], "steps towards the sun"),
            ("cache_cells", combination.cache == self.axes.caches[0], "density caches"),
        ] {
            if !is_first && !model.has_parameter(parameter) {
                return Some(format!("density model {} has no {what}, and one value stands for all", model.id));
            }
        }
        let Ok(kept) = combination.defects.of_model(model) else {
            return Some(format!("density model {} has none of the defects {}", model.id, combination.defects));
        };
        let sets = self.defect_sets(&combination.density);
        let before = sets.iter().take_while(|other| **other != combination.defects);
        if before.filter_map(|other| other.of_model(model).ok()).any(|other| other == kept) {
            return Some(format!("density model {} has these defects in an earlier value of the axis", model.id));
        }
        if combination.light_volume.is_some() && models::imitates_orders(&combination.light) {
            return Some(format!(
                "light model {} imitates the orders of scattering that a light volume has",
                combination.light
            ));
        }
        let is_dark = scene.lights.iter().all(|light| light.strength == 0.0);
        if is_dark && combination.light_steps != self.axes.light_steps[0] {
            return Some("the scene has no sun: one number of light steps stands for all".into());
        }
        let of_the_sun = ["octaves", "octaves-deep", "silver"];
        if is_dark && of_the_sun.contains(&combination.light.as_str()) && self.axes.light_parameters.is_empty() {
            return Some("the scene has no sun, and the light model differs from \"single\" in sunlight alone".into());
        }
        None
    }
}

/// Whether a density has a parameter of this name.
fn has_parameter(density: &str, name: &str) -> bool {
    Selection::parse(density).is_ok_and(|selection| selection.model.has_parameter(name))
}

/// Names with every combination of the values of the parameters that each `has`.
fn with_parameters(
    names: &[String],
    parameters: &IndexMap<String, Vec<f64>>,
    has: impl Fn(&str, &str) -> bool,
) -> Vec<String> {
    let mut all = Vec::new();
    for name in names {
        let mut texts = vec![name.clone()];
        for (parameter, values) in parameters.iter().filter(|(parameter, _)| has(name, parameter)) {
            texts = texts
                .iter()
                .flat_map(|text| values.iter().map(move |value| format!("{text} {parameter}={value}")))
                .collect();
        }
        all.extend(texts);
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_parameter_is_an_axis_of_the_densities_that_have_it() {
        let text = STUDY.replace(
            "caches =",
            "god_rays = [false, true]\n[axes.parameters]\ncoverage = [0.4, 0.6]\noctaves = [1, 5]\n\
             [axes.light_parameters]\nexposure = [1, 2]\n#",
        );
        let study = StudyFile::parse(&text, "test").expect("a study");
        let densities = study.densities();
        assert_eq!(densities.len(), 1 + 4, "{densities:?}");
        assert_eq!((densities[0].as_str(), densities[4].as_str()), ("graph", "perlin-fbm coverage=0.6 octaves=5"));
        assert_eq!(study.lights()[3], "octaves exposure=2");
        let scene = Scene::load(Path::new("parity/scenes/linear-ramp.scene.json")).expect("a scene");
        let (wanted, skipped) = study.expand(&[scene]);
        assert_eq!(study.combinations(), (wanted.len() + skipped.len()) as u64);
        assert_eq!(wanted.len(), 5 * 4 * 2 * 2 * 2);
        let wrong =
            |from: &str, to: &str| StudyFile::parse(&text.replace(from, to), "a.study.toml").expect_err("refused");
        assert!(wrong("coverage =", "covrage =").to_string().contains("covrage"));
        assert!(wrong("[0.4, 0.6]", "[0.4, 1.6]").to_string().contains("1.6"));
        assert!(wrong("[0.4, 0.6]", "[]").to_string().contains("parameters"));
        assert!(wrong("exposure = [1, 2]", "exposition = [1]").to_string().contains("exposure"));
    }

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
