//! "Add a published system" of ARCHITECTURE.md, followed with a toy: one file of its own and one line that registers it.

mod fog;
#[path = "../support/mod.rs"]
mod support;

use cloudparity::engines;
use cloudparity::engines::defects::Defects;
use cloudparity::engines::domain::Domain;
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use cloudparity::engines::{Engine, Model};
use cloudparity::gpu::Gpu;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Projection, Scene};
use cloudparity::view::camera::Camera;
use glam::DVec2;
use std::sync::Once;
use support::{project, scene};

/// The toy, registered: the one line.
fn toy() -> &'static Model {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| engines::register(&fog::MODEL).expect("a new name"));
    engines::find("toy-fog").expect("it was just registered")
}

fn engine(scene: &Scene, texts: &[&str], defects: &Defects) -> Engine {
    let model = toy();
    let texts: Vec<String> = texts.iter().map(|text| (*text).to_owned()).collect();
    model.engine(scene, &model.values(None, &texts).expect("values"), defects, 0.0).expect("an engine")
}

fn picture(scene: &Scene, engine: &Engine, gpu: Option<&Gpu>) -> Image {
    let settings = EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };
    EngineRenderer::new(scene, engine, gpu).expect("a renderer").picture(&settings, &|_, _| ()).expect("a picture")
}

/// A scene without light, whose camera looks down into the fog from above it.
fn dark() -> Scene {
    let mut scene = scene("homogeneous-cube");
    scene.camera.projection = Projection::Perspective;
    scene.camera.matrix_world =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 4.0], [0.0, 0.0, 0.0, 1.0]];
    scene.film.resolution = [24, 16];
    scene.film.resolution_percentage = 100;
    scene.world.color = [0.0; 3];
    scene.lights.clear();
    scene
}

#[test]
fn a_toy_of_one_file_and_one_line_marches_as_its_formula_says() {
    let scene = dark();
    let engine = engine(&scene, &["march_steps=4096"], &Defects::NONE);
    let found = picture(&scene, &engine, None);
    let camera = Camera::new(&scene, scene.image_size()).expect("a camera");
    let (extinction, glow, glass) = (0.25, 2.0, 0.5);
    let mut lit = 0;
    for (index, pixel) in found.pixels.iter().enumerate() {
        let raster = DVec2::new((index % 24) as f64 + 0.5, 15.5 - (index / 24) as f64);
        let ray = camera.ray(raster);
        let start = ray.origin + ray.direction * ray.near;
        // Height as a part of the slab at a distance: h0 + r t.
        let [first, second] = [-1.0, 1.0].map(|height: f64| (height - start.z) / ray.direction.z);
        let (enter, leave) = (first.min(second).max(0.0), first.max(second));
        let expected = if leave > enter {
            lit += 1;
            let (rate, begin) = (ray.direction.z / 2.0, (start.z + ray.direction.z * enter + 1.0) / 2.0);
            let through = (-extinction * (leave - enter)).exp();
            // The integral of glow (h0 + r t) e exp(-e t) over the way.
            let mean = begin * (1.0 - through) + rate * ((1.0 - through) / extinction - (leave - enter) * through);
            glass * glow * mean
        } else {
            0.0
        };
        // The source is taken in the middle of each step, which is exact for a linear one in a thin step: what is left is the square of
        // its depth, (0.25 x 50 m / 4096)^2 / 12 at most, and the rounding of the picture to f32.
        let error = (f64::from(pixel[0]) - expected).abs();
        assert!(error <= 2e-6 * expected.abs().max(1e-3), "pixel {index}: {} {expected}", pixel[0]);
    }
    assert!(lit > 100, "{lit} rays meet the fog");
    let kept = picture(&scene, &self::engine(&scene, &["march_steps=4096"], &Defects::ALL), None);
    for (kept, found) in kept.pixels.iter().zip(&found.pixels) {
        assert_eq!(kept[0] * 0.5, found[0], "the defect takes the glass away");
    }
    assert!(found.provenance["domain"].starts_with("slab") && found.provenance["passes"].contains("toy-glass"));
    assert!(found.provenance["light_terms"].contains("toy::glow"));
}

#[test]
fn the_adapter_shows_the_same_with_the_toy_s_own_term_and_pass() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("an adapter");
    let scene = dark();
    for domain in [None, Some(Domain::Object), Some(Domain::Slab { bottom: 0.25, top: 0.5 })] {
        let model = toy();
        let values = model.values(None, &[]).expect("values");
        let engine = model.engine_in(domain, &scene, &values, &Defects::NONE, 0.0).expect("an engine");
        let [ours, theirs] = [None, Some(&gpu)].map(|gpu| picture(&scene, &engine, gpu));
        let largest = ours.pixels.iter().map(|pixel| pixel[0]).fold(0.0, f32::max);
        assert!(largest > 0.0, "{domain:?}");
        for (ours, theirs) in ours.pixels.iter().zip(&theirs.pixels) {
            // 64 steps of some eight roundings and an exponential of 4 units in the last place each, all of one sign.
            let bound = 64.0 * 12.0 * f32::EPSILON * largest;
            assert!((ours[0] - theirs[0]).abs() <= bound, "{domain:?}: {} {}", ours[0], theirs[0]);
        }
    }
}

#[test]
fn what_the_toy_does_not_know_is_refused() {
    let scene = dark();
    let model = toy();
    let values = model.values(None, &[]).expect("values");
    let shell = Domain::Shell { centre: [0.0; 3], inner: 1.0, outer: 2.0 };
    let error = model.engine_in(Some(shell), &scene, &values, &Defects::NONE, 0.0).err().expect("no such domain");
    assert!(error.to_string().contains("toy-fog") && error.to_string().contains("slab"), "{error}");
    assert!("TF-2".parse::<Defects>().expect_err("no such defect").to_string().contains("TF-1"));
    assert!(engines::register(&fog::MODEL).expect_err("twice").to_string().contains("toy-fog"));
}

#[test]
fn the_guide_names_everything_that_the_toy_needs() {
    let text = std::fs::read_to_string(project("ARCHITECTURE.md")).expect("the map");
    let (_, guide) = text.split_once("## Add a published system").expect("the guide");
    let guide = guide.split("\n## ").next().expect("a section");
    let toy = std::fs::read_to_string(project("tests/toy_system/fog.rs")).expect("the toy");
    // What the guide puts in backquotes as a field or a trait is what the toy fills in or implements.
    for word in ["Model", "Request", "Domain", "LightTerm", "Pass", "PassKernel", "Defect", "Density", "Engine"] {
        assert!(guide.contains(&format!("`{word}`")), "the guide does not name {word}");
        assert!(toy.contains(word), "the toy does without {word}");
    }
}
