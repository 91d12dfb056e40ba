//! What voxels of a published density cost beside the density itself, in path tracing: the mean of the picture, the null collisions, and
//! the time to equal error.
//!
//! Each way renders the same replicas (other random numbers). With the variance v of a pixel over replicas, its mean m and the picture's
//! mean M, the relative variance of a replica is the mean of v / (m^2 + (0.01 M)^2) over pixels and channels; time to equal error is
//! proportional to it times the time of a replica.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::engines::Engine;
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{GivenMedium, PathSettings, Subject};
use crate::measure::voxels;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::Serialize;
use std::sync::Arc;
use std::time::Instant;

/// Seed of the first replica.
const SEED: u32 = 4000;

/// What one way came to.
#[derive(Debug, Clone, Serialize)]
pub struct VoxelRow {
    /// Voxels per axis; none is the density itself.
    pub voxels: Option<usize>,
    /// Collisions of all replicas, null collisions included.
    pub collisions: u64,
    /// Those where the extinction exceeded its majorant.
    pub violations: u64,
    /// Share of null collisions.
    pub null_share: f64,
    /// Mean radiance of the picture over replicas and channels.
    pub mean: f64,
    /// Standard error of it.
    pub standard_error: f64,
    /// Its difference from that of the density itself, relative, and the standard error of that.
    pub difference: f64,
    /// See `difference`.
    pub difference_error: f64,
    /// Processor seconds before the first path: voxels, majorants.
    pub preparation_seconds: f64,
    /// Processor seconds of a replica's paths.
    pub seconds: f64,
    /// Relative variance of a replica.
    pub relative_variance: f64,
    /// Time to equal error over that of the density itself; preparation left out.
    pub time_to_equal_error: f64,
}

/// Renders an engine's medium itself and as grids of voxels, `replicas` times each.
pub fn run(
    scene: &Scene,
    engine: &Engine,
    voxels_per_axis: &[usize],
    settings: &PathSettings,
    replicas: u32,
    progress: Progress<'_>,
) -> Result<Vec<VoxelRow>> {
    if replicas < 2 {
        let found = replicas.to_string();
        return Err(Error::new("setting replicas", found, "at least 2: a spread needs two", "Correct the setting."));
    }
    let seeds: Vec<u32> = (SEED..SEED + replicas).collect();
    let ways: Vec<Option<usize>> = std::iter::once(None).chain(voxels_per_axis.iter().copied().map(Some)).collect();
    let mut rows: Vec<VoxelRow> = Vec::new();
    for (number, &way) in ways.iter().enumerate() {
        let report = |done: f64, what: &str| progress((number as f64 + done) / ways.len() as f64, what);
        let begin = ProcessTime::now();
        let clock = Instant::now();
        let (given, grid);
        let subject = match way {
            None => {
                given = GivenMedium { identity: engine.medium_identity(), object: Arc::new(engine.medium()?) };
                Subject { scene, medium: Some(&given) }
            }
            Some(count) => {
                grid = voxels::scene(scene, engine, count)?.0;
                Subject { scene: &grid, medium: None }
            }
        };
        let mut images = Vec::new();
        path::render_each(subject, settings, Backend::Cpu, &seeds, &report, &mut |_, image| {
            images.push(image);
            Ok(())
        })?;
        let whole = begin.elapsed().as_secs_f64();
        let number = |image: &Image, name: &str| {
            image.provenance.get(name).and_then(|text| text.parse::<f64>().ok()).unwrap_or(f64::NAN)
        };
        // Paths run on all cores: the share of the clock that they took is the share of the processor's time.
        let paths: f64 = images.iter().map(|image| number(image, "render_seconds")).sum();
        let share = (paths / clock.elapsed().as_secs_f64()).min(1.0);
        let sum = |name: &str| images.iter().map(|image| number(image, name)).sum::<f64>();
        let (mean, standard_error) = mean_of(&images);
        let relative_variance = relative_variance(&images);
        let seconds = whole * share / f64::from(replicas);
        let (difference, difference_error, time_to_equal_error) = match rows.first() {
            None => (0.0, 0.0, 1.0),
            Some(own) => (
                mean / own.mean - 1.0,
                (standard_error.powi(2) + own.standard_error.powi(2)).sqrt() / own.mean,
                relative_variance * seconds / (own.relative_variance * own.seconds),
            ),
        };
        rows.push(VoxelRow {
            voxels: way,
            collisions: sum("collisions") as u64,
            violations: sum("violations") as u64,
            null_share: sum("null_share") / f64::from(replicas),
            mean,
            standard_error,
            difference,
            difference_error,
            preparation_seconds: whole * (1.0 - share),
            seconds,
            relative_variance,
            time_to_equal_error,
        });
    }
    Ok(rows)
}

/// Mean of the pictures and its standard error: a replica's mean is one draw.
fn mean_of(images: &[Image]) -> (f64, f64) {
    let means: Vec<f64> = images
        .iter()
        .map(|image| {
            let sum: f64 = image.pixels.iter().flat_map(|pixel| &pixel[..3]).map(|&value| f64::from(value)).sum();
            sum / (3 * image.pixels.len()) as f64
        })
        .collect();
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|one| (one - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, (variance / count).sqrt())
}

fn relative_variance(images: &[Image]) -> f64 {
    let count = images.len() as f64;
    let (whole, _) = mean_of(images);
    let pixels = images[0].pixels.len();
    let mut sum = 0.0;
    for pixel in 0..pixels {
        for channel in 0..3 {
            let values = || images.iter().map(|image| f64::from(image.pixels[pixel][channel]));
            let mean = values().sum::<f64>() / count;
            let variance = values().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
            sum += variance / (mean * mean + (0.01 * whole).powi(2));
        }
    }
    sum / (3 * pixels) as f64
}
