//! Attribution files (`*.attribution.toml`): scenes, engines, and how exact the exact is.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use crate::engines::Selection;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::render::EngineJitter;
use crate::measure::attribution::stage::Stage;
use crate::measure::combination::{CacheAxis, Combination, Quality, no_cache};
use crate::measure::scenes::{SceneAxis, check_resolution, load_scenes};
use crate::measure::toml_files::{at, read_toml};
use crate::measure::truth::Truth;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-attribution/1";

/// Most orders of replacement.
const MOST_ORDERS: u32 = 10_000;

/// An attribution file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttributionFile {
    /// [`FORMAT`].
    pub format: String,
    /// Headline of what is made of it.
    pub title: String,
    /// Pixels of every picture.
    pub resolution: [u32; 2],
    /// How light is path traced.
    #[serde(default)]
    pub truth: Truth,
    /// Pictures by Cycles as what engines are measured against, instead of path tracing; what is left where every stage is exact is then the
    /// difference of the two renderers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cycles: Option<ByCycles>,
    /// How fine what counts as exact is.
    #[serde(default)]
    pub exact: Exact,
    /// Orders of replacement that are drawn where all of them ask for more pictures.
    #[serde(default = "orders")]
    pub orders: u32,
    /// The scenes.
    pub scenes: Vec<SceneAxis>,
    /// What is measured in each.
    pub engines: Vec<Measured>,
}

fn orders() -> u32 {
    12
}

/// Pictures by Cycles, as many replicas as path tracing has: disjoint subsets of one sequence of samples, whose spread has what all
/// seeds share.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ByCycles {
    /// Samples per pixel and replica.
    pub samples: u32,
}

/// How fine the exact twins of stages are that march.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Exact {
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards a sun.
    pub light_steps: u32,
    /// Rays per pixel and replica that the pixel filter draws, at most the samples of the truth: they are the rays of its first ones.
    pub rays: u32,
}

impl Default for Exact {
    fn default() -> Self {
        Self { steps: 128, light_steps: 64, rays: 32 }
    }
}

/// An engine.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Its name in the results.
    pub name: String,
    /// Density model with its parameters: `"perlin-fbm coverage=0.4"`.
    pub density: String,
    /// Light model, likewise.
    #[serde(default = "own_light")]
    pub light: String,
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards the sun.
    pub light_steps: u32,
    /// Density cache of a scene's graph.
    #[serde(default = "uncached")]
    pub cache: CacheAxis,
    /// Rays per pixel and axis.
    #[serde(default = "one")]
    pub sub_pixels: u32,
    /// Where in its steps a ray takes its samples.
    #[serde(default = "unjittered")]
    pub jitter: EngineJitter,
    /// Defects that it keeps.
    #[serde(default)]
    pub defects: Defects,
    /// Whether god rays are added.
    #[serde(default)]
    pub god_rays: bool,
    /// Stages that it is given as exact: what is left is shared among the others.
    #[serde(default)]
    pub exact: Vec<Stage>,
    /// Errors that are put into it, to see whether they are found where they are.
    #[serde(default)]
    pub plant: Planted,
}

fn own_light() -> String {
    models::OWN.into()
}

fn uncached() -> CacheAxis {
    no_cache()[0]
}

fn one() -> u32 {
    1
}

fn unjittered() -> EngineJitter {
    EngineJitter::None
}

/// Errors that are put into an engine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Planted {
    /// Factor on extinction: the field.
    pub extinction: f64,
    /// Added to the anisotropy of every lobe: the phase function.
    pub anisotropy: f64,
    /// Pixels by which the picture moves to the right and up: the pixel filter.
    pub shift: [f64; 2],
    /// What finished values are raised to: the display.
    pub gamma: f64,
}

impl Default for Planted {
    fn default() -> Self {
        Self { extinction: 1.0, anisotropy: 0.0, shift: [0.0; 2], gamma: 1.0 }
    }
}

impl AttributionFile {
    /// Reads and checks an attribution file.
    pub fn load(path: &Path) -> Result<Self> {
        kinds::want(path, FileKind::Attribution)?;
        let text = files::read_text(path, "an attribution file (*.attribution.toml)")?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Reads an attribution from text; `place` names where it stands.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let found: Self = read_toml(text, place, "docs/attribution.md")?;
        found.check(place)?;
        Ok(found)
    }

    fn check(&self, place: &str) -> Result<()> {
        let wrong = |name: &str, found: String, expected: String| {
            Err(Error::new(format!("{place}, {name}"), found, expected, "Correct the attribution file."))
        };
        if self.format != FORMAT {
            return wrong("format", format!("\"{}\"", self.format), format!("\"{FORMAT}\""));
        }
        check_resolution(self.resolution, place)?;
        self.truth.check(place)?;
        let Exact { steps, light_steps, rays } = self.exact;
        Quality::STEPS.check(steps, place, "exact")?;
        Quality::LIGHT_STEPS.check(light_steps, place, "exact")?;
        if !(1..=self.truth.samples).contains(&rays) {
            let expected = format!("1 to {}, the samples of the truth", self.truth.samples);
            return wrong("exact.rays", rays.to_string(), expected);
        }
        // A single pair has no standard error.
        if !(4..=MOST_ORDERS).contains(&self.orders) {
            return wrong("orders", self.orders.to_string(), format!("4 to {MOST_ORDERS}"));
        }
        if self.scenes.is_empty() || self.engines.is_empty() {
            let found = format!("{} scenes, {} engines", self.scenes.len(), self.engines.len());
            return wrong("scenes and engines", found, "at least one of each".into());
        }
        for (index, engine) in self.engines.iter().enumerate() {
            let path = format!("engines[{index}]");
            if self.engines[..index].iter().any(|other| other.name == engine.name) {
                return wrong(
                    &format!("{path}.name"),
                    format!("a second \"{}\"", engine.name),
                    "different names".into(),
                );
            }
            engine.check(place, &path)?;
            let selection = Selection::parse(&engine.density)?;
            if self.cycles.is_some() && !selection.model.is_of_scene {
                let expected = "graph: Cycles renders the scene's own material".into();
                return wrong(&format!("{path}.density"), format!("\"{}\" beside [cycles]", engine.density), expected);
            }
        }
        if let Some(ByCycles { samples: 0 }) = self.cycles {
            return wrong("cycles.samples", "0".into(), "at least 1".into());
        }
        Ok(())
    }

    /// The scenes at their resolution.
    pub fn load_scenes(&self, folder: &Path, place: &str) -> Result<Vec<Scene>> {
        load_scenes(&self.scenes, folder, self.resolution, place)
    }
}

impl Measured {
    fn check(&self, place: &str, path: &str) -> Result<()> {
        Quality::STEPS.check(self.steps, place, path)?;
        Quality::LIGHT_STEPS.check(self.light_steps, place, path)?;
        Quality::SUB_PIXELS.check(self.sub_pixels, place, path)?;
        let selection =
            Selection::parse(&self.density).map_err(|error| at(error, place, &format!("{path}.density")))?;
        models::check(&self.light).map_err(|error| at(error, place, &format!("{path}.light")))?;
        self.defects.of_model(selection.model).map_err(|error| at(error, place, &format!("{path}.defects")))?;
        let Planted { extinction, anisotropy, shift, gamma } = self.plant;
        let is_right = extinction > 0.0
            && gamma > 0.0
            && anisotropy.abs() < 2.0
            && [extinction, gamma, shift[0], shift[1]].iter().all(|number| number.is_finite());
        if is_right {
            return Ok(());
        }
        Err(Error::new(
            format!("{place}, {path}.plant"),
            format!("{:?}", self.plant),
            "an extinction and a gamma above 0, an anisotropy above -2 and below 2, a finite shift",
            "Correct the attribution file.",
        ))
    }

    /// Its settings in a scene.
    pub(super) fn combination(&self, scene: &Scene) -> Combination {
        let Self { density, light, steps, light_steps, cache, sub_pixels, jitter, defects, god_rays, .. } =
            self.clone();
        let scene = scene.name.clone();
        Combination {
            scene,
            density,
            light,
            steps,
            light_steps,
            cache,
            light_volume: None,
            sub_pixels,
            jitter,
            defects,
            god_rays,
        }
    }
}
