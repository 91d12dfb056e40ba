//! The path integrator on the adapter against its CPU twin: the same expectation, by replicas.

mod support;

use cloudparity::gpu::Backend;
use cloudparity::integrators::path;
use cloudparity::integrators::path::{PathSettings, Tracking};
use cloudparity::scene::Scene;
use cloudparity::scene::image::Image;

/// Replicas of each side.
const REPLICAS: u32 = 8;

/// Largest t of a difference of means, of the 24 that the tests below take: 14 degrees of freedom
/// exceed 5.5 by chance once in 13,000.
const LARGEST_T: f64 = 5.5;

/// Largest standard error of a difference relative to the mean: a noisier comparison says little.
const SENSITIVITY: f64 = 0.005;

/// The same of the cloud, which fills a fortieth of its picture: it is there for its deep majorants and heavy density.
const CLOUD_SENSITIVITY: f64 = 0.02;

fn replicas(scene: &Scene, settings: &PathSettings, backend: Backend, first_seed: u32) -> Vec<Image> {
    let seeds: Vec<u32> = (first_seed..first_seed + REPLICAS).collect();
    path::render_replicas(scene, settings, backend, &seeds, &|_, _| {}).expect("the scene renders")
}

/// Mean over replicas of the picture's mean, and the square of its standard error.
fn mean_and_error(images: &[Image], channel: usize) -> (f64, f64) {
    let means: Vec<f64> = images.iter().map(|image| image.mean()[channel]).collect();
    let count = means.len() as f64;
    let mean = means.iter().sum::<f64>() / count;
    let variance = means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0);
    (mean, variance / count)
}

fn agree(name: &str, scene: &Scene, samples: u32, sensitivity: f64) {
    agree_with(name, scene, &PathSettings { samples, ..PathSettings::default() }, sensitivity);
}

/// The CPU always takes the default tracking.
fn agree_with(name: &str, scene: &Scene, settings: &PathSettings, sensitivity: f64) {
    // The sides share their generator, so their seeds differ.
    let cpu = replicas(scene, &PathSettings { tracking: Tracking::default(), ..settings.clone() }, Backend::Cpu, 100);
    let gpu = replicas(scene, settings, Backend::Gpu, 500);
    for channel in 0..4 {
        let (ours, our_square) = mean_and_error(&gpu, channel);
        let (theirs, their_square) = mean_and_error(&cpu, channel);
        // 1e-5: f32 on the adapter, some hundred roundings in a path of ten events.
        let error = (our_square + their_square + (1e-5 * theirs).powi(2)).sqrt();
        assert!(error <= sensitivity * theirs, "{name}, channel {channel}: {error} is too noisy for {theirs}");
        let t = (ours - theirs) / error;
        assert!(t.abs() < LARGEST_T, "{name}, channel {channel}: {ours} on the adapter, {theirs} on the CPU, t = {t}");
    }
    assert_eq!(gpu[0].provenance["violations"], "0");
}

fn small(name: &str, resolution: [u32; 2]) -> Scene {
    let mut scene = support::scene(name);
    scene.film.resolution = resolution;
    scene.film.resolution_percentage = 100;
    scene
}

#[test]
fn the_adapter_expects_what_the_cpu_expects() {
    if !support::require("vulkan") {
        return;
    }
    // Many pixels and few samples: an invocation makes the samples of a pixel one after the other.
    let mut cube = small("cube-multiple-scattering", [96, 64]);
    cube.set("Principled Volume.Anisotropy=0.6").expect("a stored value");
    agree("anisotropic cube", &cube, 4, SENSITIVITY);
    let mut sun = small("cube-multiple-scattering", [96, 64]);
    if let cloudparity::scene::LightKind::Sun { angle } = &mut sun.lights[0].kind {
        *angle = 1.0;
    }
    agree("wide sun", &sun, 4, SENSITIVITY);
    let coloured = small("noise-coloured", [96, 64]);
    agree("coloured noise with emission", &coloured, 4, SENSITIVITY);
    let adaptive = PathSettings { samples: 4, tracking: Tracking::Adaptive, ..PathSettings::default() };
    agree_with("the same, tracked adaptively", &coloured, &adaptive, SENSITIVITY);
    let mut cloud = small("procedural-clouds", [128, 72]);
    cloud.film.transparent = true;
    cloud.integrator.volume_bounces = 4;
    cloud.set("Density=10").expect("an input of the group");
    agree("dense cloud", &cloud, 4, CLOUD_SENSITIVITY);
}

#[test]
fn a_light_that_the_adapter_does_not_know_is_refused() {
    if !support::require("vulkan") {
        return;
    }
    let mut scene = small("cube-multiple-scattering", [8, 8]);
    scene.lights[0].kind = cloudparity::scene::LightKind::Area { shape: "SQUARE".into(), size: [1.0, 1.0] };
    let settings = PathSettings { samples: 1, ..PathSettings::default() };
    let refused = path::render(&scene, &settings, Backend::Gpu, None, &|_, _| {}).expect_err("no area lights");
    assert_eq!(refused.settings, ["backend"], "{refused}");
}
