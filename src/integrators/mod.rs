//! Pictures of a scene: the camera, the medium, the light in it, and the integrators.
//!
//! [`render`] is the public way in. [`march`] is deterministic; its twin on the adapter lives in
//! `shaders/integrate/`.

pub mod march;
pub mod path;

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files::json;
use crate::base::identity;
use crate::base::identity::Identity;
use crate::base::progress::Progress;
use crate::gpu::{Backend, worker};
use crate::media::density_cache::CacheSettings;
use crate::media::transfer::Integration;
use crate::scene::Scene;
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};

choice! {
    "lowercase",
    /// How light finds its way to a view sample.
    pub enum LightMode {
        /// Shadow rays evaluate the density: slow, without interpolation.
        Exact,
        /// Density and light are baked at the vertices of a grid and interpolated.
        Grid,
    }
}

choice! {
    "lowercase",
    /// Where within its steps a view ray evaluates the medium.
    ///
    /// Without jitter all rays sample the middles: errors of neighbouring pixels are alike and show as
    /// bands. With it, each ray shifts its samples by one random part of a step. The shifted rule is
    /// unbiased for the integral of the density over the whole steps, so that bands become noise; for
    /// smooth media the error of a single ray grows from second to first order in the step, and because
    /// the transmittance is convex in the depth, its mean is too large by half of the depth's variance,
    /// relative to itself.
    pub enum Jitter {
        /// In the middle.
        None,
        /// At a random part of the step, drawn per ray from pixel, ray and seed, stratified over the
        /// rays of a pixel.
        Pixel,
    }
}

/// Quality of the deterministic integrator. Lengths are world metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
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
    /// How a step adds up.
    pub integration: Integration,
    /// Where within the steps the medium is evaluated.
    pub jitter: Jitter,
    /// Chooses the random numbers of the jitter.
    pub seed: u32,
    /// View and shadow densities from a grid instead of the graph.
    pub density_cache: Option<CacheSettings>,
    /// Leave out what the scene does not need ([`march::Omission`]); the picture is the same.
    pub specialise: bool,
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
            integration: Integration::EnergyConserving,
            jitter: Jitter::None,
            seed: 0,
            density_cache: None,
            specialise: true,
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
            ("world_bands", self.world_bands, 0, crate::view::lights::LARGEST_BAND as u32),
            ("sub_pixels", self.sub_pixels, 1, 64),
            ("grid_cells", self.grid_cells, 1, 1024),
        ] {
            if !(low..=high).contains(&value) {
                return wrong(name, value.to_string(), &format!("{low} to {high}"));
            }
        }
        if let Some(CacheSettings { cells: 0, .. }) = self.density_cache {
            return wrong("density_cache", "0 cells".into(), "at least 1 cell along the longest side");
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
pub(crate) fn mean_world_side(scene: &Scene) -> f64 {
    let matrix = crate::scene::matrix_to_glam(&scene.volume.matrix_world);
    let bounds = &scene.volume.bounds;
    let columns = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
    let side = |axis: usize| columns[axis].length() * f64::from(bounds.max[axis] - bounds.min[axis]);
    (0..3).map(side).sum::<f64>() / 3.0
}

/// Memory that a picture takes at most while it is made: the pixels, and their channels for the file.
const BYTES_PER_PIXEL: u64 = 2 * 16;

/// Renders a scene by ray marching. The picture's provenance names the scene, the settings, the
/// backend and the time.
pub fn render(scene: &Scene, settings: &MarchSettings, backend: Backend, progress: Progress<'_>) -> Result<Image> {
    let begin = std::time::Instant::now();
    let settings = settings.resolved(scene)?;
    crate::view::memory::check(scene.image_size(), BYTES_PER_PIXEL)?;
    let gpu = backend.open()?;
    let mut image = march::render(scene, &settings, gpu.as_ref(), progress)?;
    for (name, value) in [
        ("renderer", format!("cloudparity {} march", env!("CARGO_PKG_VERSION"))),
        (identity::ATTRIBUTE, Identity::current().full().to_owned()),
        ("scene", scene.name.clone()),
        ("scene_sha256", scene.content_hash()),
        ("settings", json(&settings)),
        ("film", json(&scene.film)),
        ("backend", worker(gpu.as_ref())),
        ("render_seconds", format!("{:.3}", begin.elapsed().as_secs_f64())),
    ] {
        image.provenance.insert(name.to_owned(), value);
    }
    Ok(image)
}
