//! Figures of the path integrator and how they are judged.
//!
//! Each figure is the mean of [`REPLICAS`] independent pictures, its standard error the spread of
//! their means: the replica is the unit of statistics, whatever the samples within it share. A figure
//! passes within 4 standard errors, and only where the standard error is below 0.2 % of it.
//! Seeds are fixed, so that a test passes or fails for good.

use super::cube::{color, homogeneous, set};
use cloudparity::gpu::Backend;
use cloudparity::integrators::path;
use cloudparity::integrators::path::PathSettings;
use cloudparity::scene::Scene;
use cloudparity::scene::image::Image;

/// Independent pictures of a figure.
pub const REPLICAS: u32 = 16;

/// f32 pixels and settings round by 6e-8; estimators without noise are met to this.
pub const ROUNDING: f64 = 1e-6;

/// Pictures with different seeds.
fn replicas(scene: &Scene, samples: u32, backend: Backend) -> Vec<Image> {
    let settings = PathSettings { samples, ..PathSettings::default() };
    // The random numbers of both backends are partly the same.
    let first = if backend == Backend::Cpu { 0 } else { 1000 };
    let seeds: Vec<u32> = (first..first + REPLICAS).collect();
    path::render_replicas(scene, &settings, backend, &seeds, &|_, _| {}).expect("the scene renders")
}

/// Mean over replicas and its standard error, channel by channel.
pub fn estimate(scene: &Scene, samples: u32) -> [(f64, f64); 4] {
    estimate_on(Backend::Cpu, scene, samples)
}

/// [`estimate`] on a backend.
pub fn estimate_on(backend: Backend, scene: &Scene, samples: u32) -> [(f64, f64); 4] {
    let means: Vec<[f64; 4]> = replicas(scene, samples, backend).iter().map(Image::mean).collect();
    let count = f64::from(REPLICAS);
    std::array::from_fn(|channel| {
        let mean = means.iter().map(|means| means[channel]).sum::<f64>() / count;
        let squares: f64 = means.iter().map(|means| (means[channel] - mean).powi(2)).sum();
        (mean, (squares / (count - 1.0) / count).sqrt())
    })
}

/// Passes within 4 standard errors of the figure and of the truth, if the figure is sharp enough to tell.
#[track_caller]
pub fn meets((found, error): (f64, f64), expected: f64, truth_error: f64) {
    let together = error.hypot(truth_error);
    println!("{found:.6} ({error:.1e}), expected {expected:.6}: {:+.1} errors", (found - expected) / together);
    assert!(error <= 0.002 * expected, "the standard error {error:e} is too large to test {expected}");
    let allowed = 4.0 * together + ROUNDING * expected;
    assert!((found - expected).abs() <= allowed, "{found} ({error:e}) is not {expected} ({truth_error:e})");
}

/// [`meets`], colour channel by channel, of two estimates.
#[track_caller]
pub fn all_meet(found: [(f64, f64); 4], expected: [(f64, f64); 4]) {
    for channel in 0..3 {
        meets(found[channel], expected[channel].0, expected[channel].1);
    }
}

/// A scene without lights in a world of radiance 1.
pub fn furnace() -> Scene {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    set(&mut scene, "Color", color([1.0; 3]));
    scene
}

/// Both limits of the number of bounces.
pub fn bounces(scene: &mut Scene, number: u32) {
    scene.integrator.volume_bounces = number;
    scene.integrator.max_bounces = number;
}
