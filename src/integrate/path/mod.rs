//! Path tracing of participating media without bias, on the CPU.
//!
//! [`render`] gives a picture, [`render_replicas`] several with other seeds that share the majorants.
//! The algorithm is that of `tracer`; `volume` is what it asks of a medium.
//!
//! A picture is made in passes of a fixed number of samples, a pass in ranges of paths that are traced
//! on all cores. Ranges are summed in order, so that equal settings and seeds give equal bits
//! whatever the number of threads.

mod tracer;
mod volume;

pub use tracer::Counters;

use super::camera::Camera;
use super::film::Warp;
use super::lights::world_radiance;
use super::sampled_lights::sampled_lights;
use super::{Progress, json};
use crate::error::{Error, Result};
use crate::image::Image;
use crate::scene::Scene;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::time::Instant;
use tracer::{Tracer, Work};
use volume::Volume;

/// Paths of one pass: enough to keep all cores busy, few enough to show progress.
const PASS_PATHS: u64 = 1 << 20;

/// Paths of one range: the last paths of a range share batches with nobody.
const RANGE_PATHS: u64 = 1 << 15;

/// Rays per path of which majorants take account: of a long path most rays are short.
const RAYS_PER_PATH: u32 = 8;

/// How much work, and which random numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathSettings {
    /// Paths per pixel.
    pub samples: u32,
    /// Chooses the random numbers: pictures of different seeds are independent.
    pub seed: u32,
}

impl Default for PathSettings {
    fn default() -> Self {
        Self { samples: 64, seed: 0 }
    }
}

/// Most paths per pixel.
const MOST_SAMPLES: u32 = 1 << 24;

impl PathSettings {
    fn check(&self) -> Result<()> {
        if (1..=MOST_SAMPLES).contains(&self.samples) {
            return Ok(());
        }
        Err(Error::new(
            "setting samples",
            self.samples.to_string(),
            format!("1 to {MOST_SAMPLES}"),
            "Correct the setting.",
        ))
    }
}

/// Renders a scene by path tracing. The picture's provenance names the scene, settings, counters and times.
pub fn render(scene: &Scene, settings: &PathSettings, progress: Progress<'_>) -> Result<Image> {
    let mut images = render_replicas(scene, settings, &[settings.seed], progress)?;
    Ok(images.remove(0))
}

/// [`render`] once per seed; the seed of `settings` does not count.
pub fn render_replicas(
    scene: &Scene,
    settings: &PathSettings,
    seeds: &[u32],
    progress: Progress<'_>,
) -> Result<Vec<Image>> {
    settings.check()?;
    let begin = Instant::now();
    progress(0.0, "majorants");
    let tracer = Tracer::new(scene, settings)?;
    let preparation = begin.elapsed().as_secs_f64();
    let total = seeds.len() as f64;
    let mut images = Vec::with_capacity(seeds.len());
    for (number, &seed) in seeds.iter().enumerate() {
        let begin = Instant::now();
        let report = |done: f64| progress((number as f64 + done) / total, "paths");
        let (mut image, counters) = tracer.render(settings.samples, seed, &report)?;
        let seconds = begin.elapsed().as_secs_f64();
        let [boxes, leaves] = tracer.tree();
        for (name, value) in [
            ("renderer", format!("cloudparity {} path", env!("CARGO_PKG_VERSION"))),
            ("scene", scene.name.clone()),
            ("scene_sha256", scene.content_hash()),
            ("settings", json(&PathSettings { seed, ..settings.clone() })),
            ("film", json(&scene.film)),
            ("integrator", json(&scene.integrator)),
            ("backend", format!("CPU, {} threads", rayon::current_num_threads())),
            ("majorant_boxes", boxes.to_string()),
            ("majorant_leaves", leaves.to_string()),
            ("paths", counters.paths.to_string()),
            ("collisions", counters.collisions.to_string()),
            ("null_share", format!("{:.4}", counters.null_collisions / (counters.collisions.max(1) as f64))),
            ("scatterings", counters.scatterings.to_string()),
            ("violations", counters.violations.to_string()),
            ("preparation_seconds", format!("{preparation:.3}")),
            ("render_seconds", format!("{seconds:.3}")),
        ] {
            image.provenance.insert(name.to_owned(), value);
        }
        images.push(image);
    }
    Ok(images)
}

impl Tracer {
    fn new(scene: &Scene, settings: &PathSettings) -> Result<Self> {
        let size = scene.image_size();
        let events = scene.integrator.volume_bounces.min(scene.integrator.max_bounces).saturating_add(1);
        let paths = f64::from(size[0]) * f64::from(size[1]) * f64::from(settings.samples);
        // The camera ray, and per event a shadow ray and a sampled one.
        let rays = paths * f64::from(1 + 2 * events.min(RAYS_PER_PATH));
        let finite = |name: &str, values: [f64; 3]| {
            let fine = values.iter().all(|value| value.is_finite() && *value >= 0.0);
            let error = || {
                Error::new(name, format!("radiance {values:?}"), "finite radiance, none below 0", "Correct the color.")
            };
            if fine { Ok(values) } else { Err(error()) }
        };
        Ok(Self {
            camera: Camera::new(scene, size)?,
            size,
            filter: Warp::new(scene.film.pixel_filter, f64::from(scene.film.filter_width)),
            transparent: scene.film.transparent,
            exposure: f64::from(scene.film.exposure),
            lights: sampled_lights(scene)?,
            world: finite("$.world", world_radiance(scene))?,
            volume: Volume::new(scene, rays)?,
            events,
        })
    }

    /// Boxes that were bounded for the majorants, and their leaves.
    fn tree(&self) -> [usize; 2] {
        self.volume.majorants.as_ref().map_or([0; 2], |majorants| [majorants.boxes, majorants.leaves()])
    }

    /// One replica.
    fn render(&self, samples: u32, seed: u32, progress: &(dyn Fn(f64) + Sync)) -> Result<(Image, Counters)> {
        let [width, height] = self.size.map(|side| side as usize);
        let pixels = (width * height) as u64;
        let per_pass = (PASS_PATHS / pixels).clamp(1, u64::from(samples)) as u32;
        let mut sums = vec![[0.0; 4]; width * height];
        let mut counters = Counters::default();
        for first_sample in (0..samples).step_by(per_pass as usize) {
            let samples_now = per_pass.min(samples - first_sample);
            let total = pixels * u64::from(samples_now);
            let ranges: Vec<_> = (0..total)
                .step_by(RANGE_PATHS as usize)
                .map(|start| Work {
                    items: start..total.min(start + RANGE_PATHS),
                    first_sample,
                    samples: samples_now,
                    seed,
                })
                .collect();
            let parts: Vec<_> = ranges.par_iter().map(|work| self.trace(work)).collect::<Result<_>>()?;
            for part in parts {
                for (sum, found) in sums[part.first_pixel..].iter_mut().zip(part.pixels) {
                    for (sum, found) in sum.iter_mut().zip(found) {
                        *sum += found;
                    }
                }
                counters.add(&part.counters);
            }
            progress(f64::from(first_sample + samples_now) / f64::from(samples));
        }
        let mut image = Image::new(width, height);
        let scale = 1.0 / f64::from(samples);
        for (pixel, sum) in image.pixels.iter_mut().zip(sums) {
            let [red, green, blue, opacity] = sum.map(|value| value * scale);
            let alpha = if self.transparent { opacity } else { 1.0 };
            let [red, green, blue] = [red, green, blue].map(|radiance| (radiance * self.exposure) as f32);
            *pixel = [red, green, blue, alpha as f32];
        }
        Ok((image, counters))
    }
}
