//! Presets (`*.preset.json`): an engine's settings as a tuning found them, to be used in other scenes.
//!
//! A preset is settings, which another build may use: it is not refused. Its errors are results of the builds that it names; whoever uses
//! it under another one is told so, and a picture names them all.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::json;
use crate::base::kinds::{self, FileKind};
use crate::base::ledger::to_json;
use crate::engines::Engine;
use crate::engines::light::{LightModel, models};
use crate::engines::parameters::assignment;
use crate::measure::combination::Combination;
use crate::measure::toml_files::remedy;
use crate::measure::tuning::file::{Owner, TunedEngine, owner};
use crate::measure::tuning::{Scored, TuningResults};
use crate::scene::Scene;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-preset/1";

/// An engine's settings.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Preset {
    /// [`FORMAT`].
    pub format: String,
    /// The builds that had part in the search; none in a file that names none.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// What it is for.
    pub title: String,
    /// Density model, light model and quality.
    pub engine: TunedEngine,
    /// Parameters of the light model, of the density model (`density.NAME`) and of the scene (`scene.NAME`).
    pub parameters: IndexMap<String, f64>,
    /// Where it comes from: held-out errors, seed, evaluations.
    #[serde(default)]
    pub provenance: serde_json::Value,
}

/// Where a preset's provenance says which scenes it was found in.
pub const SCENES: &str = "scenes";

impl Preset {
    /// The preset of a tuning.
    pub fn of(results: &TuningResults) -> Self {
        let best = &results.published[0];
        Self {
            format: FORMAT.into(),
            builds: results.builds.clone(),
            title: results.file.title.clone(),
            engine: results.file.engine.clone(),
            parameters: results.parameters.clone(),
            provenance: json!({
                "optimiser": results.optimiser,
                "seed": results.file.search.seed,
                "evaluations": results.evaluations,
                "held_out_flip": Scored::mean_flip(&results.tuned.held_out),
                "best_published": best.name,
                "best_published_held_out_flip": Scored::mean_flip(&best.held_out),
            }),
        }
    }

    /// The preset of settings that were measured; their jitter and god rays are settings of a picture, which presets do not hold.
    pub fn of_combination(
        combination: &Combination,
        title: String,
        builds: Vec<Identity>,
        provenance: serde_json::Value,
    ) -> Result<Self> {
        let Combination { density, light, steps, light_steps, cache, light_volume, sub_pixels, defects, .. } =
            combination;
        let mut words = light.split_whitespace();
        let light = words.next().unwrap_or_default().to_owned();
        let mut parameters = IndexMap::new();
        for word in words {
            let (name, value) = assignment(word)?;
            parameters.insert(name.to_owned(), value);
        }
        let engine = TunedEngine {
            density: density.clone(),
            light,
            steps: *steps,
            light_steps: *light_steps,
            cache: *cache,
            light_volume: *light_volume,
            sub_pixels: *sub_pixels,
            defects: defects.clone(),
        };
        Ok(Self { format: FORMAT.into(), builds, title, engine, parameters, provenance })
    }

    /// Names of the scenes that it was found in; none where the file does not say.
    pub fn scenes(&self) -> Vec<&str> {
        self.provenance[SCENES].as_array().into_iter().flatten().filter_map(serde_json::Value::as_str).collect()
    }

    /// Writes the preset.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::write_atomically(path, to_json(self).as_bytes())
    }

    /// Reads a preset.
    pub fn load(path: &Path) -> Result<Self> {
        kinds::want(path, FileKind::Preset)?;
        let text = files::read_text(path, "a preset (*.preset.json)")?;
        let place = path.display().to_string();
        // Of a repeated key the second value would count, without a word.
        if let Err(cause) = json::parse(&text)
            && cause.to_string().starts_with(json::REPEATED)
        {
            let at = format!("{place}, line {}, column {}", cause.line(), cause.column());
            return Err(Error::new(at, cause.to_string(), "every key once in an object", "Remove one of the two."));
        }
        let mut deserializer = serde_json::Deserializer::from_str(&text);
        let preset: Self = serde_path_to_error::deserialize(&mut deserializer).map_err(|cause| {
            let at = format!("{place}, line {}, $.{}", cause.inner().line(), cause.path());
            let message = cause.inner().to_string();
            let remedy = remedy(&message, "docs/tuning.md");
            Error::new(at, message, "a preset", remedy)
        })?;
        if preset.format == FORMAT {
            return Ok(preset);
        }
        Err(Error::new(
            format!("{place}, $.format"),
            format!("\"{}\"", preset.format),
            format!("\"{FORMAT}\""),
            "Take a preset that this version wrote.",
        ))
    }

    /// The scene with the preset's values, and its engine in it.
    pub fn build(&self, scene: &Scene) -> Result<(Scene, Engine, Combination)> {
        self.build_at(scene, 0.0)
    }

    /// The same after `seconds` of animation.
    pub fn build_at(&self, scene: &Scene, seconds: f64) -> Result<(Scene, Engine, Combination)> {
        let combination = self.engine.combination(&scene.name);
        let (scene, mut engine) = build_at(scene, &combination, &of_medium(&self.parameters), seconds)?;
        engine.light = lit(&engine.light, &self.engine.light, &self.parameters)?;
        Ok((scene, engine, combination))
    }
}

/// Parameters of density models and scenes.
pub(super) fn of_medium(values: &IndexMap<String, f64>) -> Vec<(Owner, &str, f64)> {
    let all = values.iter().map(|(name, &value)| (owner(name), value));
    all.filter(|((owner, _), _)| *owner != Owner::Light).map(|((owner, own), value)| (owner, own, value)).collect()
}

/// A light model under a name, with parameters.
pub(super) fn lit(own: &LightModel, named: &str, values: &IndexMap<String, f64>) -> Result<LightModel> {
    let mut light = own.clone();
    models::find(named)?.apply(&mut light)?;
    for (name, &value) in values {
        if let (Owner::Light, own) = owner(name) {
            models::set(&mut light, own, value, name)?;
        }
    }
    Ok(light)
}

/// A scene and an engine in it, with parameters of both.
pub(super) fn build(
    scene: &Scene,
    combination: &Combination,
    changed: &[(Owner, &str, f64)],
) -> Result<(Scene, Engine)> {
    build_at(scene, combination, changed, 0.0)
}

fn build_at(
    scene: &Scene,
    combination: &Combination,
    changed: &[(Owner, &str, f64)],
    seconds: f64,
) -> Result<(Scene, Engine)> {
    let mut scene = scene.clone();
    let mut parameters = Vec::new();
    for (owner, name, value) in changed {
        match owner {
            Owner::Scene => scene.set(&format!("{name}={value}"))?,
            _ => parameters.push(format!("{name}={value}")),
        }
    }
    let engine = combination.engine_at(&scene, &parameters, seconds)?;
    Ok((scene, engine))
}
