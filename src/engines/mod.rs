//! Density models beside the node graph: clouds of published engines, rebuilt from what they compute.
//!
//! All of them answer through [`DensityModel`], in a *local box* from -0.5 to 0.5 on every axis whose side is one unit of length.

pub mod defects;
pub mod graph;
pub mod light;
pub mod march;
pub mod parameters;
pub mod passes;
pub mod perlin_fbm;
pub mod render;

use crate::base::error::{Error, Result};
use crate::engines::defects::{Defect, Defects};
use crate::engines::light::LightModel;
use crate::engines::march::RealTimeSettings;
use crate::engines::passes::compositing::Compositing;
use crate::engines::passes::god_rays::GodRays;
use crate::media::averages::CoarseDensity;
use crate::media::density::DensityModel;
use crate::scene::Scene;
use std::sync::OnceLock;

/// A density model by name: of a published engine, or a scene's own.
pub struct Model {
    /// Name on the command line.
    pub id: &'static str,
    /// Name in words.
    pub title: &'static str,
    /// What it is, in a sentence or two.
    pub about: &'static str,
    /// Its parameters.
    pub parameters: &'static [parameters::Parameter],
    /// Levels of quality: a name, and the parameters that it sets.
    pub qualities: &'static [(&'static str, &'static [(&'static str, f64)])],
    /// What the original does wrong and can be kept, in the order of their numbers.
    pub defects: &'static [Defect],
    /// How it is built.
    pub build: Build,
}

/// How an engine is built.
pub enum Build {
    /// From its parameters with the defects that are kept, after seconds of animation.
    Alone(fn(&parameters::Values, &Defects, f64) -> Result<Engine>),
    /// From a scene's material and parameters: nothing is published, so there is no defect to keep.
    OfScene(fn(&Scene, &parameters::Values) -> Result<Engine>),
}

/// A model with all that its engine brings along.
pub struct Engine {
    /// Name of the model.
    pub model: &'static str,
    /// The defects that it keeps, as a list.
    pub defects: Defects,
    /// The parameters that it was built from.
    pub values: parameters::Values,
    /// The density.
    pub density: Box<dyn DensityModel>,
    /// The engine's light; a scene brings its own sun and world.
    pub light: LightModel,
    /// How the engine marches.
    pub march: RealTimeSettings,
    /// How its pixels are put over a background.
    pub compositing: Compositing,
    /// The engine's god rays.
    pub god_rays: GodRays,
    /// What is to be said about the parameters.
    pub warnings: Vec<String>,
    /// Averages of the density, made when a light model asks for them.
    pub averages: OnceLock<CoarseDensity>,
}

impl Engine {
    /// Averages of the density.
    pub fn coarse(&self) -> &CoarseDensity {
        self.averages.get_or_init(|| CoarseDensity::of(self.density.as_ref()))
    }

    /// The same engine with another density.
    pub fn with_density(&self, density: Box<dyn DensityModel>) -> Self {
        Self {
            density,
            defects: self.defects.clone(),
            values: self.values.clone(),
            light: self.light.clone(),
            march: self.march.clone(),
            god_rays: self.god_rays,
            warnings: self.warnings.clone(),
            averages: std::sync::OnceLock::new(),
            ..*self
        }
    }
}

/// All models.
pub fn models() -> &'static [&'static Model] {
    static MODELS: [&Model; 2] = [&graph::MODEL, &perlin_fbm::MODEL];
    &MODELS
}

/// A model by its name.
pub fn find(id: &str) -> Result<&'static Model> {
    models().iter().copied().find(|model| model.id == id).ok_or_else(|| {
        let known: Vec<&str> = models().iter().map(|model| model.id).collect();
        Error::new("density model", format!("\"{id}\""), format!("one of {}", known.join(", ")), "Correct the name.")
    })
}

impl Model {
    /// Its engine for a scene, after `seconds` of animation. An error where a defect to be kept is not the model's.
    pub fn engine(
        &self,
        scene: &Scene,
        values: &parameters::Values,
        defects: &Defects,
        seconds: f64,
    ) -> Result<Engine> {
        let defects = defects.of_model(self)?;
        match self.build {
            Build::Alone(build) => build(values, &defects, seconds),
            Build::OfScene(build) => build(scene, values),
        }
    }

    /// The default values, changed by a level of quality and by texts `NAME=VALUE`, in this order.
    pub fn values(&self, quality: Option<&str>, texts: &[String]) -> Result<parameters::Values> {
        let mut values = parameters::Values::defaults(self.parameters);
        if let Some(wanted) = quality {
            let Some((_, settings)) = self.qualities.iter().find(|(name, _)| *name == wanted) else {
                let known: Vec<&str> = self.qualities.iter().map(|(name, _)| *name).collect();
                return Err(Error::new(
                    "level of quality",
                    format!("\"{wanted}\""),
                    format!("one of {}", known.join(", ")),
                    "Correct the name.",
                )
                .with_setting("quality"));
            };
            for &(name, value) in *settings {
                values.set(self.parameters, name, value, "a level of quality")?;
            }
        }
        values.set_texts(self.parameters, texts)?;
        Ok(values)
    }
}
