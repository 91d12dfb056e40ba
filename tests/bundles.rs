//! Shader bundles: what their files draw is what the engine draws, a changed number is a changed picture, and what a bundle has not is said.

mod support;

use cloudparity::engines;
use cloudparity::engines::Engine;
use cloudparity::engines::bundle::Bundle;
use cloudparity::engines::defects::Defects;
use cloudparity::engines::domain::Domain;
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use cloudparity::gpu::Gpu;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Projection, Scene};
use std::path::Path;

const SETTINGS: EngineSettings =
    EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };

/// A unit in the last place of f32, relative to the value, at most.
const ULP: f64 = 1.0 / 8_388_608.0;

fn engine(scene: &Scene, model: &str, domain: Option<Domain>, changes: &[&str]) -> Engine {
    let model = engines::find(model).expect("it is there");
    let changes: Vec<String> = changes.iter().map(|&text| text.into()).collect();
    let values = model.values(None, &changes).expect("in range");
    model.engine_in(domain, scene, &values, &Defects::NONE, 0.0).expect("an engine")
}

fn small(mut scene: Scene) -> Scene {
    scene.film.resolution = [16, 9];
    scene.film.resolution_percentage = 100;
    scene
}

fn values(image: &Image) -> Vec<f64> {
    image.pixels.as_flattened().iter().map(|&value| f64::from(value)).collect()
}

fn on_cores(scene: &Scene, engine: &Engine) -> Vec<f64> {
    let renderer = EngineRenderer::new(scene, engine, None).expect("a renderer");
    values(&renderer.picture(&SETTINGS, &|_, _| ()).expect("a picture"))
}

fn adapter() -> Option<Gpu> {
    support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"))
}

/// What a bundle in a folder draws.
fn drawn(folder: &Path, gpu: &Gpu) -> Vec<f64> {
    values(&Bundle::load(folder).expect("it reads back").picture(gpu).expect("a picture"))
}

/// Compares a bundle's picture with the CPU's in f64, and with one of a planted change; the bound is that of the engine on the adapter
/// (tests/engine_graph.rs) with places that are known less well: a bundle's rays begin where f32 knows the camera's place, the sum of three
/// products of some size, so that a place is off by 8 roundings of the camera's distance in all. The camera is moved by that much along each axis,
/// both ways; twice the largest change of a value bounds what places do, 200 roundings of the brightest value the arithmetic.
fn check(what: &str, scene: &Scene, engine: &Engine, gpu: &Gpu) {
    let folder = tempfile::tempdir().expect("a folder");
    Bundle::new(scene, engine).expect("a bundle").write(folder.path()).expect("written");
    let truths = on_cores(scene, engine);
    let found = drawn(folder.path(), gpu);
    let brightest = truths.iter().copied().fold(0.0, f64::max);
    assert!(brightest > 0.01, "{what}: nothing is seen");
    let arithmetic = 200.0 * ULP * brightest;
    let away = scene.camera.matrix_world.iter().map(|row| f64::from(row[3]).powi(2)).sum::<f64>().sqrt();
    let step = 8.0 * ULP * (away + engine.container.unit.min(1e4));
    let mut bounds = vec![arithmetic; truths.len()];
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let mut moved = scene.clone();
            let place = &mut moved.camera.matrix_world[axis][3];
            *place = (f64::from(*place) + sign * step) as f32;
            for ((bound, found), truth) in bounds.iter_mut().zip(on_cores(&moved, engine)).zip(&truths) {
                *bound = bound.max(arithmetic + 2.0 * (found - truth).abs());
            }
        }
    }
    let shares: Vec<f64> =
        found.iter().zip(&truths).zip(&bounds).map(|((found, truth), bound)| (found - truth).abs() / bound).collect();
    let share = shares.iter().copied().fold(0.0, f64::max);
    println!("{what} on {}: {share:.2} of the bound", gpu.adapter().name);
    assert!(share <= 1.0, "{what}: {share} of the bound");

    // A hundredth more extinction is no rounding.
    let path = folder.path().join("bundle.json");
    let mut manifest: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&path).expect("it is there")).expect("JSON");
    let fields = manifest["kernels"][1]["uniform"].as_array_mut().expect("fields");
    let field = fields.iter_mut().find(|field| field["name"] == "extinction").expect("it has one");
    for value in field["values"].as_array_mut().expect("numbers") {
        *value = (value.as_f64().expect("a number") * 1.01).into();
    }
    std::fs::write(&path, manifest.to_string()).expect("written");
    let changed = drawn(folder.path(), gpu);
    let beyond =
        changed.iter().zip(&truths).zip(&bounds).filter(|((found, truth), bound)| (**found - **truth).abs() > **bound);
    assert!(beyond.count() > truths.len() / 100, "{what}: a planted change is not seen");
}

#[test]
fn a_bundle_draws_what_the_engine_draws() {
    let Some(gpu) = adapter() else { return };
    let clouds = small(support::scene("procedural-clouds"));
    check("cloud", &clouds, &engine(&clouds, "graph", None, &["march_steps=24", "light_steps=3"]), &gpu);
    let mut parallel = clouds.clone();
    parallel.camera.projection = Projection::Orthographic;
    parallel.camera.ortho_scale = 3.0;
    check("parallel rays", &parallel, &engine(&parallel, "graph", None, &["march_steps=24", "light_steps=3"]), &gpu);
    let mut stretched = clouds.clone();
    stretched.volume.matrix_world[0][0] *= 1.7;
    stretched.volume.matrix_world[0][2] = 0.4;
    check("a box that is sheared", &stretched, &engine(&stretched, "perlin-fbm", None, &[]), &gpu);
    let mut alone = clouds.clone();
    alone.film.transparent = true;
    check("a transparent film", &alone, &engine(&alone, "perlin-fbm", None, &[]), &gpu);
}

#[test]
fn what_a_bundle_has_not_is_refused() {
    let clouds = small(support::scene("procedural-clouds"));
    let shell = Domain::Shell { centre: [0.0, 0.0, -100.0], inner: 100.0, outer: 102.0 };
    let refused = |scene: &Scene, engine: &Engine, word: &str| {
        let error = Bundle::new(scene, engine).err().expect("refused").to_string();
        assert!(error.contains(word), "{error}");
    };
    refused(&clouds, &engine(&clouds, "graph", Some(shell), &[]), "a box or a slab");
    let mut panorama = clouds.clone();
    panorama.camera.projection = Projection::Equirectangular;
    panorama.camera.panorama = Some(cloudparity::scene::Panorama {
        longitude_min: -1.0,
        longitude_max: 1.0,
        latitude_min: -1.0,
        latitude_max: 1.0,
    });
    refused(&panorama, &engine(&panorama, "graph", None, &[]), "a panorama");
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("bundle.json"), "{\"format\": 3").expect("written");
    let error = Bundle::load(folder.path()).err().expect("refused").to_string();
    assert!(error.contains("line 1"), "{error}");
}
