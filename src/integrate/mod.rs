//! Pictures of a scene: the camera, the medium, the light in it, and the integrators.
//!
//! [`render`] is the public way in. [`march`] is deterministic; its twin on the adapter lives in
//! `shaders/integrate/`.

mod adapter;
pub mod camera;
pub mod environment;
pub mod film;
pub mod light_grid;
pub mod lights;
pub mod majorant;
pub mod march;
pub mod media;
pub mod medium;
mod memory;
pub mod path;
pub mod phase;
pub mod sampled_lights;
pub mod sampler;

use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::image::Image;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};

/// Where the work runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// f64 with the f32 density, on all cores.
    Cpu,
    /// f32 on the adapter.
    Gpu,
}

impl Backend {
    /// The adapter, where one is asked for.
    fn open(self) -> Result<Option<Gpu>> {
        match self {
            Self::Cpu => Ok(None),
            Self::Gpu => Gpu::open().map(Some),
        }
    }
}

/// How light finds its way to a view sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LightMode {
    /// Shadow rays evaluate the density: slow, without interpolation.
    Exact,
    /// Density and light are baked at the vertices of a grid and interpolated.
    Grid,
}

/// Quality of the deterministic integrator. Lengths are world metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MarchSettings {
    /// Longest step along a view ray; 0 takes 1/192 of the medium's mean world side.
    pub view_step: f64,
    /// Longest step along a shadow ray in mode `exact`; 0 takes the view step.
    pub shadow_step: f64,
    /// Directions of the quadrature over the world.
    pub world_directions: u32,
    /// Bands of spherical harmonics that carry the world in mode `grid` when the medium scatters
    /// anisotropically; the rest, of relative size g^(bands + 1), is left out. 0 to 3.
    pub world_bands: u32,
    /// Rays per pixel and axis.
    pub sub_pixels: u32,
    /// A view ray ends once every channel's transmittance is below this; what lies behind is lost.
    pub exit_transmittance: f64,
    /// How light reaches the samples.
    pub light: LightMode,
    /// Cells along the longest world side of the light grid.
    pub grid_cells: u32,
}

impl Default for MarchSettings {
    fn default() -> Self {
        Self {
            view_step: 0.0,
            shadow_step: 0.0,
            world_directions: 64,
            world_bands: 2,
            sub_pixels: 3,
            exit_transmittance: 1e-4,
            light: LightMode::Grid,
            grid_cells: 192,
        }
    }
}

impl MarchSettings {
    /// The settings with every 0 that means "from the scene" replaced by its value.
    pub fn resolved(&self, scene: &Scene) -> Result<Self> {
        let wrong = |name: &str, found: String, expected: &str| {
            Err(Error::new(format!("setting {name}"), found, expected, "Correct the setting."))
        };
        for (name, value, low, high) in [
            ("world_directions", self.world_directions, 1, 1 << 16),
            ("world_bands", self.world_bands, 0, lights::LARGEST_BAND as u32),
            ("sub_pixels", self.sub_pixels, 1, 64),
            ("grid_cells", self.grid_cells, 1, 1024),
        ] {
            if !(low..=high).contains(&value) {
                return wrong(name, value.to_string(), &format!("{low} to {high}"));
            }
        }
        for (name, value) in [
            ("view_step", self.view_step),
            ("shadow_step", self.shadow_step),
            ("exit_transmittance", self.exit_transmittance),
        ] {
            if !(value >= 0.0 && value.is_finite()) {
                return wrong(name, value.to_string(), "a finite number, at least 0");
            }
        }
        let mut settings = self.clone();
        if settings.view_step == 0.0 {
            settings.view_step = mean_world_side(scene) / 192.0;
        }
        if settings.shadow_step == 0.0 {
            settings.shadow_step = settings.view_step;
        }
        Ok(settings)
    }
}

/// Mean length in metres of the edges of the medium's box.
fn mean_world_side(scene: &Scene) -> f64 {
    let matrix = crate::scene::matrix_to_glam(&scene.volume.matrix_world);
    let bounds = &scene.volume.bounds;
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let side = |axis: usize| columns[axis].length() * f64::from(bounds.max[axis] - bounds.min[axis]);
    (0..3).map(side).sum::<f64>() / 3.0
}

/// What a run tells while it works: the fraction done, and of what.
pub type Progress<'a> = &'a (dyn Fn(f64, &str) + Sync);

/// Memory that a picture takes at most while it is made: the pixels, and their channels for the file.
const BYTES_PER_PIXEL: u64 = 2 * 16;

/// Renders a scene by ray marching. The picture's provenance names the scene, the settings, the
/// backend and the time.
pub fn render(scene: &Scene, settings: &MarchSettings, backend: Backend, progress: Progress<'_>) -> Result<Image> {
    let begin = std::time::Instant::now();
    let settings = settings.resolved(scene)?;
    memory::check(scene.image_size(), BYTES_PER_PIXEL)?;
    let gpu = backend.open()?;
    let mut image = march::render(scene, &settings, gpu.as_ref(), progress)?;
    let adapter = gpu.as_ref().map_or_else(
        || format!("CPU, {} threads", rayon::current_num_threads()),
        |gpu| format!("GPU, {}", json(gpu.adapter())),
    );
    for (name, value) in [
        ("renderer", format!("cloudparity {} march", env!("CARGO_PKG_VERSION"))),
        ("scene", scene.name.clone()),
        ("scene_sha256", scene.content_hash()),
        ("settings", json(&settings)),
        ("film", json(&scene.film)),
        ("backend", adapter),
        ("render_seconds", format!("{:.3}", begin.elapsed().as_secs_f64())),
    ] {
        image.provenance.insert(name.to_owned(), value);
    }
    Ok(image)
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("settings serialise")
}
