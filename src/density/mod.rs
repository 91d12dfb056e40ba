//! Density models beside the node graph: clouds of published engines, rebuilt from what they compute.
//!
//! All of them answer through [`DensityModel`], in a *local box* from -0.5 to 0.5 on every axis whose side is one unit of length.

pub mod coarse;
pub mod comparison;
pub mod graph;
pub mod perlin_fbm;
pub mod schema;
pub mod statistics;

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::integrate::real_time::RealTimeSettings;
use crate::lighting::{LightModel, Variant};
use crate::post::god_rays::GodRays;
use crate::scene::Scene;
use coarse::CoarseDensity;
use glam::DVec3;
use std::sync::{Arc, OnceLock};

/// A density in the local box.
pub trait DensityModel: Send + Sync {
    /// Densities at places of the local box, in their order; never negative. NaN only where a graph gives NaN.
    fn densities(&self, places: &[DVec3]) -> Vec<f64>;

    /// Extinction of a view ray per unit of density and unit of length, per channel.
    fn extinction(&self) -> [f64; 3];

    /// The same for the adapter, or why there is none.
    fn shader(&self) -> Result<ModelShader>;

    /// Its averages, where they were made: light models that ask for them need them.
    fn coarse(&self) -> Option<&CoarseDensity> {
        None
    }
}

/// A density model as a WGSL module with its data.
pub struct ModelShader {
    /// File in `shaders/`.
    pub path: &'static str,
    /// Its text: defines the import path `cloudparity::density_model` with `fn density(place: vec3f) -> f32`.
    pub source: &'static str,
    /// Contents of binding 0 of group 1, a uniform buffer.
    pub uniform: Vec<u8>,
    /// Contents of the bindings from 1 on, read-only storage buffers.
    pub storage: Vec<Vec<u8>>,
}

impl ModelShader {
    /// The buffers of group 1, in the order of their bindings.
    pub(crate) fn buffers(&self, gpu: &Gpu) -> Vec<wgpu::Buffer> {
        let uniform = gpu.upload("model", &self.uniform, wgpu::BufferUsages::UNIFORM);
        let storage = self.storage.iter().map(|data| gpu.upload("model data", data, wgpu::BufferUsages::STORAGE));
        std::iter::once(uniform).chain(storage).collect()
    }
}

/// A density shared by several engines.
impl<T: DensityModel + ?Sized> DensityModel for Arc<T> {
    fn densities(&self, places: &[DVec3]) -> Vec<f64> {
        self.as_ref().densities(places)
    }

    fn extinction(&self) -> [f64; 3] {
        self.as_ref().extinction()
    }

    fn shader(&self) -> Result<ModelShader> {
        self.as_ref().shader()
    }

    fn coarse(&self) -> Option<&CoarseDensity> {
        self.as_ref().coarse()
    }
}

/// Cubic Hermite step from 0 below `low` to 1 above `high`.
pub fn smooth<T: num_traits::Float>(low: T, high: T, value: T) -> T {
    let three = T::one() + T::one() + T::one();
    let t = ((value - low) / (high - low)).max(T::zero()).min(T::one());
    t * t * (three - (t + t))
}

/// A density model by name: of a published engine, or a scene's own.
pub struct Model {
    /// Name on the command line.
    pub id: &'static str,
    /// Name in words.
    pub title: &'static str,
    /// What it is, in a sentence or two.
    pub about: &'static str,
    /// Its parameters.
    pub parameters: &'static [schema::Parameter],
    /// Levels of quality: a name, and the parameters that it sets.
    pub qualities: &'static [(&'static str, &'static [(&'static str, f64)])],
    /// How it is built.
    pub build: Build,
}

/// How an engine is built.
pub enum Build {
    /// From its parameters, after seconds of animation.
    Alone(fn(&schema::Values, Variant, f64) -> Result<Engine>),
    /// From a scene's material and parameters.
    OfScene(fn(&Scene, &schema::Values, Variant) -> Result<Engine>),
}

/// A model with all that its engine brings along.
pub struct Engine {
    /// Name of the model.
    pub model: &'static str,
    /// Which form.
    pub variant: Variant,
    /// The parameters that it was built from.
    pub values: schema::Values,
    /// The density.
    pub density: Box<dyn DensityModel>,
    /// The engine's light; a scene brings its own sun and world.
    pub light: LightModel,
    /// How the engine marches.
    pub march: RealTimeSettings,
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
    /// Its engine for a scene, after `seconds` of animation.
    pub fn engine(&self, scene: &Scene, values: &schema::Values, variant: Variant, seconds: f64) -> Result<Engine> {
        match self.build {
            Build::Alone(build) => build(values, variant, seconds),
            Build::OfScene(build) => build(scene, values, variant),
        }
    }

    /// The default values, changed by a level of quality and by texts `NAME=VALUE`, in this order.
    pub fn values(&self, quality: Option<&str>, texts: &[String]) -> Result<schema::Values> {
        let mut values = schema::Values::defaults(self.parameters);
        if let Some(wanted) = quality {
            let Some((_, settings)) = self.qualities.iter().find(|(name, _)| *name == wanted) else {
                let known: Vec<&str> = self.qualities.iter().map(|(name, _)| *name).collect();
                return Err(Error::new(
                    "--quality",
                    format!("\"{wanted}\""),
                    format!("one of {}", known.join(", ")),
                    "Correct the name.",
                ));
            };
            for &(name, value) in *settings {
                values.set(self.parameters, name, value, "a level of quality")?;
            }
        }
        values.set_texts(self.parameters, texts)?;
        Ok(values)
    }
}
