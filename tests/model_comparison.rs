//! Two density models side by side: units, the light they share, and what is refused.

mod support;

use assert_cmd::cargo::cargo_bin_cmd;
use cloudparity::base::error::Result;
use cloudparity::engines;
use cloudparity::engines::defects::Defects;
use cloudparity::gpu::Gpu;
use cloudparity::graph::evaluate::{Arithmetic, Points};
use cloudparity::measure::densities::comparison::{Comparison, Settings, run};
use cloudparity::scene::Scene;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use std::path::Path;

const SETTINGS: Settings =
    Settings { places: 64, samples: 64, sub_pixels: 1, mean_depth: Some(1.0), timed_points: 2000 };

fn compare(scene: &Scene, changes: &[&str], settings: &Settings, folder: &Path) -> Result<Comparison> {
    let model = engines::find("perlin-fbm").expect("it is there");
    let changes: Vec<String> = ["texture_size=32"].iter().chain(changes).map(|&text| text.into()).collect();
    let values = model.values(None, &changes).expect("in range");
    run(scene, &[(model, values)], settings, folder, &|_, _| ())
}

/// A homogeneous cube in the sun alone, single scattering.
fn scene() -> Scene {
    let mut scene = support::scene("linear-ramp");
    scene.film.resolution = [48, 27];
    scene.world.color = [0.0; 3];
    scene.set_volume_bounces(0);
    let graph = support::scene("homogeneous-cube");
    *scene.graph_mut() = graph.graph().clone();
    scene
}

#[test]
fn a_homogeneous_cube_has_known_figures_and_both_lights_agree() {
    let folder = tempfile::tempdir().expect("a folder");
    // The light "single" is single scattering; its steps are many, so that only their error of second order is left.
    let fine = ["march_steps=128", "light_steps=64"];
    let found = compare(&scene(), &fine, &SETTINGS, folder.path()).expect("a comparison");
    let [graph, model] = found.sides.as_slice() else { panic!("two sides") };
    for side in [graph, model] {
        // Sums of 262,144 places in f64, of densities in f32.
        assert!((side.statistics.mean_depth - 1.0).abs() < 1e-6, "{}: {}", side.id, side.statistics.mean_depth);
        assert!(side.cpu_nanoseconds > 0.0);
    }
    let statistics = &graph.statistics;
    assert_eq!((statistics.filled, statistics.covered), (1.0, 1.0));
    assert!(statistics.standard_deviation < 1e-6 && statistics.spectrum.iter().all(|power| *power < 1e-12));
    assert!(model.statistics.filled < 0.5, "the mask leaves most of the box empty");
    let radiance = |light: &str, density: &str| {
        let picture = found.pictures.iter().find(|picture| (picture.light == light) && picture.density == density);
        picture.expect("every picture is there").mean_radiance
    };
    for (density, tolerance) in [
        // The noise of 83,000 paths is some 0.3 %, and a ray that ends at a transmittance of 0.01 loses less than that.
        ("graph", 0.02),
        // The grid is not the model's texture, of two times 32 texels a side: 9 % at 32 voxels, 0.9 % at 64, 0.4 % at 256.
        ("perlin-fbm", 0.03),
    ] {
        let ratio = radiance("path", density) / radiance("single", density);
        assert!((ratio - 1.0).abs() < tolerance, "{density}: {ratio}");
    }
    assert!(radiance("as-published", "graph") / radiance("path", "graph") < 0.9, "the published light differs");
    assert!(folder.path().join("models-path-perlin-fbm.exr").is_file());
}

#[test]
fn what_cannot_be_compared_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let refused = |scene: &Scene, changes: &[&str], settings: &Settings| {
        compare(scene, changes, settings, folder.path()).expect_err("refused").to_string()
    };
    let error = refused(&scene(), &["mask_radius=0"], &SETTINGS);
    assert!(error.contains("perlin-fbm") && error.contains("optical depth of 0"), "{error}");
    let error = refused(&scene(), &[], &Settings { mean_depth: Some(0.0), ..SETTINGS });
    assert!(error.contains("mean depth"), "{error}");
    let error = refused(&scene(), &[], &Settings { places: 1, ..SETTINGS });
    assert!(error.contains("places"), "{error}");
    let mut flat = scene();
    flat.volume.bounds.max[2] = flat.volume.bounds.min[2];
    let error = refused(&flat, &[], &SETTINGS);
    assert!(error.contains("a box with a volume"), "{error}");
}

#[test]
fn several_models_stand_side_by_side() {
    let folder = tempfile::tempdir().expect("a folder");
    let settings = Settings { places: 24, samples: 4, mean_depth: Some(1.0), ..SETTINGS };
    let models: Vec<(&engines::Model, _)> = ["bolt", "skill", "clusters"]
        .map(|id| engines::find(id).expect("it is there"))
        .map(|model| (model, model.values(None, &["march_steps=8".into()]).expect("in range")))
        .into();
    let found = run(&scene(), &models, &settings, folder.path(), &|_, _| ()).expect("a comparison");
    let ids: Vec<&str> = found.sides.iter().map(|side| side.id.as_str()).collect();
    assert_eq!(ids, ["graph", "bolt", "skill", "clusters"]);
    for side in &found.sides {
        assert!((side.statistics.mean_depth - 1.0).abs() < 1e-6, "{}: {}", side.id, side.statistics.mean_depth);
        assert!(folder.path().join(format!("models-path-{}.exr", side.id)).is_file());
        let own = found.pictures.iter().filter(|picture| picture.density == side.id);
        assert!(own.clone().all(|picture| picture.bias.is_some() == (picture.light != "path")));
        assert_eq!(4 * own.count(), found.pictures.len());
    }
    let twice = [models[0].clone(), models[0].clone()];
    let error = run(&scene(), &twice, &settings, folder.path(), &|_, _| ()).expect_err("refused").to_string();
    assert!(error.contains("bolt twice"), "{error}");
    let error = run(&scene(), &[], &settings, folder.path(), &|_, _| ()).expect_err("refused").to_string();
    assert!(error.contains("one at least"), "{error}");
}

#[test]
fn a_box_that_is_no_cube_is_compared() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut flat = scene();
    flat.volume.matrix_world[2][2] = 0.5;
    let found = compare(&flat, &["march_steps=128", "light_steps=64"], &SETTINGS, folder.path()).expect("a comparison");
    for side in &found.sides {
        // As of a cube.
        assert!((side.statistics.mean_depth - 1.0).abs() < 1e-6, "{}: {}", side.id, side.statistics.mean_depth);
    }
    let radiance = |light: &str, density: &str| {
        let picture = found.pictures.iter().find(|picture| picture.light == light && picture.density == density);
        picture.expect("every picture is there").mean_radiance
    };
    // Both know metres along each axis. The noise of paths, what a ray leaves that ends early, and steps, as of a cube.
    for (density, tolerance) in [("graph", 0.02), ("perlin-fbm", 0.03)] {
        let ratio = radiance("path", density) / radiance("single", density);
        assert!((ratio - 1.0).abs() < tolerance, "{density}: {ratio}");
    }
}

#[test]
fn the_density_alone_is_the_same_on_the_adapter() {
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("an adapter");
    let model = engines::find("perlin-fbm").expect("it is there");
    for defects in [Defects::NONE, Defects::ALL] {
        let values = model.values(None, &["texture_size=32".into()]).expect("in range");
        let engine = model.engine(&support::scene("linear-ramp"), &values, &defects, 1.0).expect("in range");
        let kernel = gpu.field(engine.density.program()).expect("a kernel");
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let positions: Vec<[f32; 3]> =
            (0..20_000).map(|_| std::array::from_fn(|_| random.random_range(-0.5..0.5))).collect();
        let found = kernel.evaluate(Points::new(&positions)).expect("values");
        let expected = engine.density.program().evaluate(Points::new(&positions), Arithmetic::Oracle).expect("values");
        let largest = expected.iter().copied().fold(0.0, f64::max);
        let error = found.iter().zip(&expected).map(|(&a, &b)| (f64::from(a) - b).abs()).fold(0.0, f64::max);
        // A place in f32 is 2^-24 off; a texel of 1/64 of the box, times the largest slope of 1 per texel, 64 times that; the mask's
        // texels of 1/128 less. 1e-4 leaves an order of magnitude.
        assert!(largest > 10.0 && error < 1e-4 * largest, "{defects}: {error} of {largest}");
    }
}

#[test]
fn the_command_makes_a_page() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    cargo_bin_cmd!("cloudparity")
        .arg("compare-models")
        .arg(support::project("parity/scenes/clouds-in-daylight.scene.json"))
        .arg("-o")
        .arg(folder.path())
        .args(["--resolution", "32x18", "--places", "24", "--samples", "2", "--sub-pixels", "1", "--mean-depth", "2"])
        .args(["--timed-points", "2000", "-p", "texture_size=32"])
        .assert()
        .success();
    let page = std::fs::read_to_string(folder.path().join("index.html")).expect("a page");
    assert!(page.contains("Density models side by side") && page.contains("Light as published"));
    let lights = 2 + cloudparity::engines::light::models::LIGHTS.len();
    assert_eq!(page.matches("data:image/png").count(), 2 * lights, "two densities under every light");
    assert!(page.contains("data:image/svg+xml"), "the figure of both fields");
    let figures = std::fs::read_to_string(folder.path().join("figures.csv")).expect("figures");
    assert!(figures.contains("models,perlin-fbm,,covered,"), "{figures}");
    let report = std::fs::read_to_string(folder.path().join("report.md")).expect("a report");
    assert!(report.contains("## Density models side by side"));
}
