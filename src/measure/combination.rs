//! The settings of an engine's picture, as files of studies and tunings give them.

use crate::base::error::{Error, Result};
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::render::{EngineJitter, EngineSettings};
use crate::engines::{Engine, Selection};
use crate::measure::light_volume;
use crate::media::density_cache::CacheFormat;
use crate::media::light_volume::LightVolumeSettings;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

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
    /// Density model, with parameters where it has some: `perlin-fbm coverage=0.4`.
    pub density: String,
    /// Light model, likewise.
    pub light: String,
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards the sun.
    pub light_steps: u32,
    /// Density cache of the graph.
    pub cache: CacheAxis,
    /// Light that path tracing finds beforehand; left out where there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_volume: Option<LightVolumeSettings>,
    /// Rays per pixel and axis.
    pub sub_pixels: u32,
    /// Where in its steps a ray takes its samples.
    pub jitter: EngineJitter,
    /// Defects that the engine keeps; left out where there are none, so that runs of studies without them keep their names.
    #[serde(default, skip_serializing_if = "Defects::is_none")]
    pub defects: Defects,
    /// Whether god rays are added; left out where they are not.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub god_rays: bool,
}

/// The axis of a file that names no caches.
pub(crate) fn no_cache() -> Vec<CacheAxis> {
    vec![CacheAxis { cells: 0, format: CacheFormat::F16 }]
}

impl Combination {
    /// The density model's engine of these settings under their light, with further parameters `NAME=VALUE` of the model.
    pub fn engine(&self, scene: &Scene, parameters: &[String]) -> Result<Engine> {
        self.engine_at(scene, parameters, 0.0)
    }

    /// The same after `seconds` of animation.
    pub fn engine_at(&self, scene: &Scene, parameters: &[String], seconds: f64) -> Result<Engine> {
        let selection = Selection::parse(&self.density)?;
        let mut settings = Vec::new();
        for (name, value) in [("march_steps", self.steps), ("light_steps", self.light_steps)] {
            if selection.model.has_parameter(name) {
                settings.push(format!("{name}={value}"));
            }
        }
        if self.cache.cells > 0 && selection.model.has_parameter("cache_cells") {
            let format = match self.cache.format {
                CacheFormat::F32 => 0,
                CacheFormat::F16 => 1,
                CacheFormat::Unorm8 => 2,
            };
            settings.push(format!("cache_cells={}", self.cache.cells));
            settings.push(format!("cache_format={format}"));
        }
        settings.extend_from_slice(parameters);
        let mut engine = selection.engine_at(scene, &settings, &self.defects, seconds)?;
        if let Some(settings) = &self.light_volume {
            // Before the light model: the medium has the system's own phase function, whatever its light is tuned to.
            engine.light_volume = Some(light_volume::found(scene, &engine, settings, &|_, _| ())?);
        }
        models::apply(&mut engine.light, &self.light)?;
        Ok(engine)
    }

    /// How the engine's picture is made.
    pub fn picture_settings(&self) -> EngineSettings {
        EngineSettings { jitter: self.jitter, frame: 0, sub_pixels: self.sub_pixels, god_rays: self.god_rays }
    }

    /// The settings in words, scene and density left out.
    pub fn describe(&self) -> String {
        let mut text = format!("{}, {} steps, {} light steps", self.light, self.steps, self.light_steps);
        if self.cache.cells > 0 {
            text += &format!(", cache of {} cells", self.cache.cells);
        }
        if let Some(volume) = &self.light_volume {
            text += &format!(", light volume of {} cells and {} paths", volume.cells, volume.paths);
        }
        if self.sub_pixels > 1 {
            text += &format!(", {0} x {0} rays", self.sub_pixels);
        }
        text += match self.jitter {
            EngineJitter::None => "",
            EngineJitter::Table => ", jitter from the table",
            EngineJitter::BlueNoise => ", blue noise",
        };
        if !self.defects.is_none() {
            text += &format!(", defects {}", self.defects);
        }
        if self.god_rays {
            text += ", god rays";
        }
        text
    }

    /// Densities per pixel, a graph's evaluation counting as several reads: what runs are ordered by.
    pub(crate) fn cost(&self) -> u64 {
        let is_graph = Selection::parse(&self.density).is_ok_and(|selection| selection.model.is_of_scene);
        let each: u64 = if is_graph && self.cache.cells == 0 { 4 } else { 1 };
        each * u64::from(self.steps) * u64::from(1 + self.light_steps) * u64::from(self.sub_pixels).pow(2)
    }
}

/// A setting of quality that is a whole number from 1 on, as files of studies and tunings give it.
pub(crate) struct Quality {
    name: &'static str,
    most: u32,
}

impl Quality {
    /// Steps of a view ray.
    pub const STEPS: Self = Self { name: "steps", most: 100_000 };
    /// Steps towards the sun.
    pub const LIGHT_STEPS: Self = Self { name: "light_steps", most: 1000 };
    /// Rays per pixel and axis.
    pub const SUB_PIXELS: Self = Self { name: "sub_pixels", most: 64 };

    /// Refuses what is out of range, at `table` of the file `place`.
    pub fn check(&self, value: u32, place: &str, table: &str) -> Result<()> {
        let Self { name, most } = self;
        if (1..=*most).contains(&value) {
            return Ok(());
        }
        let expected = format!("a whole number from 1 to {most}");
        Err(Error::new(format!("{place}, {table}.{name}"), value.to_string(), expected, "Correct the file."))
    }
}
