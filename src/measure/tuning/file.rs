//! Tuning files (`*.tune.toml`): what is tuned, on which views, and with what effort.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use crate::engines;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::parameters;
use crate::measure::combination::{CacheAxis, Quality, no_cache};
use crate::measure::light_volume;
use crate::measure::scenes::{SceneAxis, check_resolution};
use crate::measure::toml_files::{at, read_toml};
use crate::measure::truth::Truth;
use crate::media::light_volume::LightVolumeSettings;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-tune/1";

/// Most generations of a search.
const MOST_GENERATIONS: u32 = 100_000;

/// A tuning file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TuningFile {
    /// [`FORMAT`].
    pub format: String,
    /// Headline of what is made of it.
    pub title: String,
    /// Pixels of every picture.
    pub resolution: [u32; 2],
    /// What errors are measured against.
    #[serde(default)]
    pub truth: Truth,
    /// The engine whose parameters are tuned. Its cost stays.
    pub engine: TunedEngine,
    /// How the search goes.
    #[serde(default)]
    pub search: Search,
    /// Values of parameters that are not searched, in the place of the light model's and the density's own.
    #[serde(default, skip_serializing_if = "IndexMap::is_empty")]
    pub fixed: IndexMap<String, f64>,
    /// The parameters: ranges by name.
    pub parameters: IndexMap<String, Searched>,
    /// Views by which parameters are chosen.
    pub train: Vec<SceneAxis>,
    /// Views that the search never sees, by which the result is judged.
    pub held_out: Vec<SceneAxis>,
}

/// An engine at fixed quality.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TunedEngine {
    /// Density model: `graph` is the scene's own.
    pub density: String,
    /// The light model whose constants the tuned ones start from.
    pub light: String,
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards the sun.
    pub light_steps: u32,
    /// Density cache of the graph.
    #[serde(default = "one_cache")]
    pub cache: CacheAxis,
    /// Light that path tracing finds beforehand in every view; published light models are compared without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_volume: Option<LightVolumeSettings>,
    /// Rays per pixel and axis.
    #[serde(default = "one")]
    pub sub_pixels: u32,
    /// Defects of the published density that the engine keeps.
    #[serde(default)]
    pub defects: Defects,
}

fn one_cache() -> CacheAxis {
    no_cache()[0]
}

fn one() -> u32 {
    1
}

/// How the search goes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Search {
    /// Seed of the random numbers.
    pub seed: u32,
    /// Candidates of a generation.
    pub population: u32,
    /// Generations at most.
    pub generations: u32,
    /// Standard deviation of the first generation, as a share of each range.
    pub deviation: f64,
    /// What is lowered: the mean over the training views.
    pub objective: Objective,
}

impl Default for Search {
    fn default() -> Self {
        Self { seed: 1, population: 12, generations: 40, deviation: 0.25, objective: Objective::Flip }
    }
}

/// An error that a search lowers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Objective {
    /// HDR-FLIP.
    Flip,
    /// Relative mean squared error.
    Relmse,
}

/// The range of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Searched {
    /// Smallest and largest value.
    pub range: [f64; 2],
    /// Whether values are spread by their logarithm.
    #[serde(default)]
    pub logarithmic: bool,
    /// Where the search begins; the middle of the range if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial: Option<f64>,
}

impl Searched {
    /// The value at a point of the unit interval.
    pub fn value(&self, at: f64) -> f64 {
        let [low, high] = self.range;
        let at = at.clamp(0.0, 1.0);
        // Exactly the ends at the ends, so that a range may end where a parameter does.
        if at == 0.0 {
            low
        } else if at == 1.0 {
            high
        } else if self.logarithmic {
            (low.ln() + (high.ln() - low.ln()) * at).exp().clamp(low, high)
        } else {
            (low + (high - low) * at).clamp(low, high)
        }
    }

    /// The point of the unit interval where the search begins.
    pub fn begin(&self) -> f64 {
        let [low, high] = self.range;
        match self.initial {
            None => 0.5,
            Some(value) if self.logarithmic => (value.ln() - low.ln()) / (high.ln() - low.ln()),
            Some(value) => (value - low) / (high - low),
        }
    }
}

/// What a parameter belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Owner {
    /// The light model: `cloudparity lights` lists its parameters.
    Light,
    /// The density model: `cloudparity models` lists its parameters.
    Density,
    /// A stored value of the scene, as [`crate::scene::Scene::set`] takes it.
    Scene,
}

/// Owner and own name of a parameter: `density.NAME` and `scene.NAME`, others are the light model's.
pub fn owner(name: &str) -> (Owner, &str) {
    match name.split_once('.') {
        Some(("density", own)) => (Owner::Density, own),
        Some(("scene", own)) => (Owner::Scene, own),
        _ => (Owner::Light, name),
    }
}

impl TuningFile {
    /// Reads and checks a tuning file.
    pub fn load(path: &Path) -> Result<Self> {
        kinds::want(path, FileKind::Tuning)?;
        let text = files::read_text(path, "a tuning file (*.tune.toml)")?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Reads a tuning file from text; `place` names where it stands.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let file: Self = read_toml(text, place, "docs/tuning.md")?;
        file.check(place)?;
        Ok(file)
    }

    fn check(&self, place: &str) -> Result<()> {
        let wrong = |name: &str, found: String, expected: &str| {
            Err(Error::new(format!("{place}, {name}"), found, expected, "Correct the tuning file."))
        };
        if self.format != FORMAT {
            return wrong("format", format!("\"{}\"", self.format), &format!("\"{FORMAT}\""));
        }
        check_resolution(self.resolution, place)?;
        self.truth.check(place)?;
        let model = engines::find(&self.engine.density).map_err(|error| at(error, place, "engine.density"))?;
        self.engine.defects.of_model(model).map_err(|error| at(error, place, "engine.defects"))?;
        models::find(&self.engine.light).map_err(|error| at(error, place, "engine.light"))?;
        for (quality, value) in [
            (&Quality::STEPS, self.engine.steps),
            (&Quality::LIGHT_STEPS, self.engine.light_steps),
            (&Quality::SUB_PIXELS, self.engine.sub_pixels),
        ] {
            quality.check(value, place, "engine")?;
        }
        if let Some(settings) = &self.engine.light_volume {
            light_volume::check(settings, &format!("{place}, engine.light_volume"))?;
            let of_medium = |name: &&String| !matches!(owner(name), (Owner::Light, _));
            if let Some(name) = self.parameters.keys().chain(self.fixed.keys()).find(of_medium) {
                return wrong(
                    name,
                    "a parameter of the medium beside engine.light_volume".into(),
                    "parameters of the light alone: the light volume is that of one medium (values that stay go into engine.density)",
                );
            }
        }
        if !(1..=MOST_GENERATIONS).contains(&self.search.generations) {
            let expected = format!("a whole number from 1 to {MOST_GENERATIONS}");
            return wrong("search.generations", self.search.generations.to_string(), &expected);
        }
        if !(2..=1000).contains(&self.search.population) {
            return wrong("search.population", self.search.population.to_string(), "2 to 1000");
        }
        if !(self.search.deviation > 0.0 && self.search.deviation <= 1.0) {
            return wrong("search.deviation", self.search.deviation.to_string(), "above 0, at most 1");
        }
        if self.parameters.is_empty() || self.train.is_empty() || self.held_out.is_empty() {
            return wrong("parameters, train, held_out", "an empty list".into(), "at least one of each");
        }
        for (name, searched) in &self.parameters {
            let [low, high] = searched.range;
            let field = format!("parameters.{name}");
            if !(low < high && low.is_finite() && high.is_finite()) || (searched.logarithmic && low <= 0.0) {
                return wrong(
                    &field,
                    format!("{low} to {high}"),
                    "a range that rises, above 0 where it is logarithmic",
                );
            }
            if searched.initial.is_some_and(|value| !(low..=high).contains(&value)) {
                return wrong(&field, format!("{:?}", searched.initial), "a first value within the range");
            }
            for value in searched.range {
                check_value(model, name, value, &format!("{place}, {field}"))?;
            }
        }
        for (name, &value) in &self.fixed {
            let field = format!("fixed.{name}");
            if self.parameters.contains_key(name) {
                return wrong(&field, "a parameter that is searched, too".into(), "one or the other");
            }
            check_value(model, name, value, &format!("{place}, {field}"))?;
        }
        Ok(())
    }
}

/// Whether a parameter is there and may have the value; what a scene stores is known with the scene.
fn check_value(model: &engines::Model, name: &str, value: f64, place: &str) -> Result<()> {
    match owner(name) {
        (Owner::Light, own) => parameters::Parameter::check(models::PARAMETERS, own, value, place).map(drop),
        (Owner::Density, own) => parameters::Parameter::check(model.parameters, own, value, place).map(drop),
        (Owner::Scene, _) => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        format = "cloudparity-tune/1"
        title = "test"
        resolution = [16, 9]
        train = [{ file = "a.scene.json" }]
        held_out = [{ file = "a.scene.json", sun = [10, 20] }]
        [engine]
        density = "perlin-fbm"
        light = "octaves"
        steps = 8
        light_steps = 2
        [parameters]
        contribution = { range = [0.1, 1.0] }
        exposure = { range = [0.5, 2.0], logarithmic = true, initial = 1.0 }
    "#;

    #[test]
    fn ranges_are_walked_from_end_to_end() {
        let file = TuningFile::parse(FILE, "test").expect("a tuning file");
        let exposure = &file.parameters["exposure"];
        assert_eq!([exposure.value(0.0), exposure.value(1.0)], [0.5, 2.0]);
        assert!((exposure.value(exposure.begin()) - 1.0).abs() < 1e-12);
        assert!((exposure.value(0.25) - 0.5f64.sqrt()).abs() < 1e-12);
        let contribution = &file.parameters["contribution"];
        assert!((contribution.value(contribution.begin()) - 0.55).abs() < 1e-12);
        assert_eq!(owner("scene.Density"), (Owner::Scene, "Density"));
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let error =
            |from: &str, to: &str| TuningFile::parse(&FILE.replace(from, to), "a.tune.toml").expect_err("refused");
        assert!(error("exposure =", "exposures =").to_string().contains("contribution"));
        assert!(error("[0.1, 1.0]", "[1.0, 0.1]").place.contains("parameters.contribution"));
        assert!(error("contribution = { range = [0.1", "attenuation = { range = [-0.1").place.contains("attenuation"));
        assert!(error("[0.5, 2.0]", "[0.0, 2.0]").place.contains("exposure"));
        assert!(error("initial = 1.0", "initial = 9.0").found.contains('9'));
        assert!(error("\"perlin-fbm\"", "\"fog\"").place.contains("engine.density"));
        assert!(error("\"octaves\"", "\"moon\"").place.contains("engine.light"));
        assert!(error("steps = 8", "steps = 8\ndefects = \"PF-99\"").to_string().contains("PF-4, PF-5"));
        let old = error("steps = 8", "steps = 8\nvariant = \"fixed\"");
        assert!(old.place.contains("line") && old.remedy.contains("defects = "), "{old}");
        let of_another =
            FILE.replace("\"perlin-fbm\"", "\"graph\"").replace("steps = 8", "steps = 8\ndefects = \"PF-4\"");
        assert!(TuningFile::parse(&of_another, "a").expect_err("refused").place.contains("engine.defects"));
        assert!(error("steps = 8", "steps = 0").place.contains("engine.steps"));
        assert!(error("train = [{ file = \"a.scene.json\" }]", "train = []").place.contains("train"));
        assert!(error("contribution =", "density.fog =").to_string().contains("fog"));
        let fixed = |text: &str| error("[parameters]", &format!("[fixed]\n{text}\n[parameters]"));
        assert!(fixed("coarse_shadow = 0.5").place.contains("fixed.coarse_shadow"));
        assert!(fixed("contribution = 0.5").found.contains("searched"));
        assert!(error("tune/1", "tune/2").expected.contains(FORMAT));
        assert!(error("title = \"test\"", "title = ").place.contains("line 3"));
    }
}
