//! The stability suite: what it finds on committed scenes, that it finds what is planted, and that every guard it names is at work.

mod support;

use assert_cmd::cargo::cargo_bin_cmd;
use cloudparity::engines::march::gpu::MarchKernel;
use cloudparity::gpu::Gpu;
use cloudparity::integrators::{MarchSettings, march};
use cloudparity::measure::stability;
use cloudparity::measure::stability::functions;
use cloudparity::measure::stability::functions::{Pipeline, ScalarFunction, Side};
use cloudparity::measure::stability::guards::{self, Proof};
use cloudparity::measure::stability::pictures::{Uniform, light, rays, steps};
use cloudparity::measure::stability::{Table, Verdict};
use cloudparity::media::medium::Medium;
use cloudparity::media::transfer::Integration;
use cloudparity::scene::Scene;
use cloudparity::scene::image::Image;
use cloudparity::view::camera::Camera;
use glam::{DVec2, DVec3};
use std::collections::BTreeSet;

fn adapter() -> Option<Gpu> {
    support::require("vulkan").then(|| Gpu::open().expect("the adapter that was just there"))
}

fn measured(scene: &str, pictures_of: &str) -> Table {
    let gpu = adapter();
    let [scene, pictures_of] = [scene, pictures_of].map(support::scene);
    let table = stability::run(&scene, &pictures_of, gpu.as_ref(), None, &Default::default(), &|_, _| ())
        .and_then(|outcome| outcome.all())
        .expect("the suite runs");
    let failing: Vec<_> = table.rows.iter().filter(|row| row.verdict == Verdict::Fails).collect();
    assert!(failing.is_empty(), "{failing:#?}");
    assert!(table.rows.iter().all(|row| row.nonfinite == 0), "a value is NaN or infinite");
    // A row says what it is and why.
    for row in &table.rows {
        assert!(row.values > 0 && !row.guards.is_empty(), "{row:?}");
        assert!([&row.varied, &row.evaluator, &row.reason, &row.cycles].iter().all(|text| !text.is_empty()), "{row:?}");
        assert!(row.verdict == Verdict::Pass || row.share_of_bound.is_some_and(|share| share <= 1.0), "{row:?}");
    }
    let ids: BTreeSet<_> = table.rows.iter().map(|row| &row.id).collect();
    assert_eq!(ids.len(), table.rows.len(), "a row's name is its own");
    table
}

#[test]
fn the_suite_holds_on_the_committed_cloud() {
    let table = measured("procedural-clouds", "linear-ramp");
    for id in ["field-density=1e8/cpu", "field-time=1e6/cpu", "march-camera-inside/cpu", "engine-10000-steps/cpu"] {
        assert!(table.rows.iter().any(|row| row.id == id), "{id}");
    }
    // Through files and back.
    let folder = tempfile::tempdir().expect("a temporary folder");
    table.write(folder.path()).expect("written");
    let text = std::fs::read_to_string(folder.path().join("stability.json")).expect("written");
    let read: Table = serde_json::from_str(&text).expect("a table");
    assert_eq!(read.rows.len(), table.rows.len());
    assert_eq!(table.csv().lines().count(), 1 + table.rows.len());
    let page = cloudparity::report::write_report(folder.path(), &[]).expect("a report");
    let page = std::fs::read_to_string(page).expect("a page");
    assert!(page.contains("id=\"stability\"") && page.contains("field-density=1e8&#x2f;cpu"));
}

#[test]
fn the_suite_holds_on_another_scene() {
    measured("noise-anisotropic", "homogeneous-cube");
}

#[test]
fn every_kernel_is_finite_and_within_its_bound() {
    for row in functions::rows(adapter().as_ref()).expect("measured") {
        assert!(row.nonfinite == 0 && row.share_of_bound.is_some_and(|share| share <= 1.0), "{row:?}");
    }
}

#[test]
fn a_kernel_without_its_guard_fails_in_wgsl() {
    let Some(gpu) = adapter() else { return };
    // Each guard taken away, as it would be written without a thought.
    for (function, guarded, plain) in [
        (
            ScalarFunction::MeanTransmittance,
            "transfer::mean_transmittance(vec3f(input.x)).x",
            "(1.0 - exp(-input.x)) / input.x",
        ),
        (ScalarFunction::Absorbed, "transfer::absorbed(vec3f(input.x)).x", "1.0 - exp(-input.x)"),
        (
            ScalarFunction::HenyeyGreenstein,
            "phase::henyey_greenstein_by_lack(input.x, input.y)",
            "(1.0 - input.x * input.x) * phase::isotropic() \
             / pow(1.0 + input.x * input.x - 2.0 * input.x * (1.0 - input.y), 1.5)",
        ),
    ] {
        let source = functions::SHADER.replacen(guarded, plain, 1);
        assert_ne!(source, functions::SHADER, "{function:?}");
        let pipeline = Pipeline::new(&gpu, &source).expect("it compiles");
        let row = function.judge(Side::Wgsl, &pipeline.values(function, &function.arguments()).expect("values"));
        assert_eq!(row.verdict, Verdict::Fails, "{row:?}");
    }
}

fn small(scene: &str) -> (Scene, MarchSettings) {
    let mut scene = support::scene(scene);
    scene.film.resolution = [16, 9];
    scene.set_volume_bounces(0);
    let settings = MarchSettings { grid_cells: 12, sub_pixels: 1, world_directions: 16, ..MarchSettings::default() };
    let settings = settings.resolved(&scene).expect("settings");
    (scene, settings)
}

fn difference(ours: &Image, theirs: &Image) -> f64 {
    let values = |image: &Image| image.pixels.iter().flatten().copied().map(f64::from).collect::<Vec<f64>>();
    let (ours, theirs) = (values(ours), values(theirs));
    let brightest = theirs.iter().copied().fold(0.0, f64::max);
    assert!(brightest > 0.0 && ours.iter().all(|value| value.is_finite()));
    ours.iter().zip(&theirs).map(|(a, b)| (a - b).abs() / brightest).fold(0.0, f64::max)
}

fn picture(scene: &Scene, settings: &MarchSettings, gpu: Option<&Gpu>) -> Image {
    march::render(scene, settings, gpu, &|_, _| ()).expect("a picture")
}

#[test]
fn the_scale_of_camera_and_sun_changes_nothing() {
    let (scene, settings) = small("procedural-clouds");
    let mut scaled = scene.clone();
    let matrices = [&mut scaled.camera.matrix_world]
        .into_iter()
        .chain(scaled.lights.iter_mut().map(|light| &mut light.matrix_world));
    for matrix in matrices {
        // A power of two moves no bit.
        matrix[..3].iter_mut().for_each(|row| row[..3].iter_mut().for_each(|value| *value *= 1.0 / 1_048_576.0));
    }
    assert_eq!(picture(&scaled, &settings, None).pixels, picture(&scene, &settings, None).pixels);
}

#[test]
fn a_scene_far_from_the_origin_looks_the_same_on_the_adapter() {
    let Some(gpu) = adapter() else { return };
    let (mut scene, settings) = small("noise-anisotropic");
    for matrix in [&mut scene.camera.matrix_world, &mut scene.volume.matrix_world]
        .into_iter()
        .chain(scene.lights.iter_mut().map(|light| &mut light.matrix_world))
    {
        for row in &mut matrix[..3] {
            row[3] += 1e6;
        }
    }
    let found = difference(&picture(&scene, &settings, Some(&gpu)), &picture(&scene, &settings, None));
    // As near the origin (tests/march.rs).
    assert!(found <= 5e-5, "{found:e}");
}

#[test]
fn ten_thousand_steps_are_taken_on_the_adapter() {
    let Some(gpu) = adapter() else { return };
    let density = Uniform::new(4.0, [1.0; 3]);
    // 24 steps towards the sun: 10,000 of them go through 250,000 iterations of a loop.
    let mut sun = light(Some([0.3, 0.8, 0.1]), 0.5);
    sun.shadow.steps = 24;
    let settings = steps(10_000, Integration::EnergyConserving);
    let ray = &rays()[..1];
    let found = density.march_on(&gpu, &sun, &settings, ray).expect("marched")[0];
    assert_eq!((found.samples, found.dense), (10_000, 10_000));
    let through = (-4.0_f64).exp();
    // 10,000 products of a rounding each, and the exponentials'.
    assert!((found.transmittance[0] / through - 1.0).abs() < 1e4 * 4.0 / 8_388_608.0, "{found:?}");
}

#[test]
fn surroundings_without_averages_are_refused() {
    let density = Uniform::new(4.0, [1.0; 3]);
    let mut sun = light(Some([0.3, 0.8, 0.1]), 0.5);
    sun.terms.body.strength = 0.5;
    let settings = steps(4, Integration::EnergyConserving);
    let error = density.march(&sun, &settings, &rays()).expect_err("no averages").to_string();
    assert!(error.contains("media::averages"), "{error}");
    if let Some(gpu) = adapter() {
        let error = MarchKernel::new(&gpu, &density.marched(&sun), &settings).err().expect("no averages").to_string();
        assert!(error.contains("media::averages"), "{error}");
    }
}

#[test]
fn a_camera_inside_sees_from_its_near_clip() {
    let (mut scene, settings) = small("homogeneous-cube");
    scene.camera.clip_start = 0.4;
    scene.film.transparent = true;
    let Medium { to_object, density, extinction, .. } = Medium::new(&scene).expect("a medium");
    // The camera goes to the middle of the cube, and looks where it did.
    let middle = to_object.inverse().transform_point3(DVec3::ZERO);
    (0..3).for_each(|axis| scene.camera.matrix_world[axis][3] = middle[axis] as f32);
    let [width, height] = scene.film.resolution;
    let camera = Camera::new(&scene, [width, height]).expect("a camera");
    let found = picture(&scene, &settings, None);
    for (index, pixel) in found.pixels.iter().enumerate() {
        let raster = DVec2::new(
            f64::from(index as u32 % width) + 0.5,
            f64::from(height) - f64::from(index as u32 / width) - 0.5,
        );
        let ray = camera.ray(raster);
        let [origin, way] = [to_object.transform_point3(ray.origin), to_object.transform_vector3(ray.direction)];
        let (enter, leave) = density.bounds.segment(origin, way).expect("the ray begins inside");
        assert!(enter < 0.0 && ray.near >= 0.4);
        let depth = density.homogeneous().expect("one density") * extinction[0] * (leave - ray.near);
        let alpha = 1.0 - (-depth).exp();
        assert!(alpha > 0.01 && (f64::from(pixel[3]) - alpha).abs() < 1e-5, "{index}: {pixel:?}, {alpha}");
    }
}

/// Tests of whole pictures, by the guard that each of them shows at work.
const OF_PICTURES: &[(&str, fn())] = &[
    ("camera-scale", the_scale_of_camera_and_sun_changes_nothing),
    ("near-clip", a_camera_inside_sees_from_its_near_clip),
    ("relative-places", a_scene_far_from_the_origin_looks_the_same_on_the_adapter),
    ("loop-budget", ten_thousand_steps_are_taken_on_the_adapter),
];

#[test]
fn every_guard_is_at_work() {
    let mut of_pictures = Vec::new();
    for guard in guards::GUARDS {
        for file in guard.files {
            assert!(support::project(file).is_file(), "{}: {file}", guard.name);
        }
        match guard.proof {
            Proof::Witness(witness) => {
                let witness = witness().expect("computed");
                assert!(witness.holds(), "{}: {witness:?}", guard.name);
            }
            Proof::Pictures(_) => of_pictures.push(guard.name),
        }
    }
    assert_eq!(of_pictures, OF_PICTURES.iter().map(|(name, _)| *name).collect::<Vec<_>>());
    let names: BTreeSet<_> = guards::GUARDS.iter().map(|guard| guard.name).collect();
    assert_eq!(names.len(), guards::GUARDS.len());
}

#[test]
fn scenes_that_the_suite_does_not_know_are_refused() {
    let two = support::scene("overlapping-cubes");
    let error = stability::run(&two, &two, None, None, &Default::default(), &|_, _| ()).expect_err("two objects");
    assert!(error.place.starts_with("object") && error.expected.contains("one"), "{error}");
    cargo_bin_cmd!("cloudparity")
        .args(["stability", "nowhere.scene.json"])
        .assert()
        .code(2)
        .stderr(predicates::str::contains("nowhere.scene.json"));
}
