//! Published systems whose densities are node graphs: their bounds hold, no parameters make a value that is no number, each defect shows, and
//! their clouds are scenes of their own.

mod support;

use cloudparity::engines;
use cloudparity::engines::defects::Defects;
use cloudparity::engines::domain::Domain;
use cloudparity::engines::parameters::Values;
use cloudparity::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use cloudparity::engines::{Engine, Model};
use cloudparity::gpu::Backend;
use cloudparity::graph::bounds::Bounds3;
use cloudparity::graph::bounds_check::{Survey, layer, points_in};
use cloudparity::integrators::path;
use cloudparity::integrators::path::{GivenMedium, PathSettings, Subject};
use cloudparity::media::objects::Media;
use cloudparity::media::region::Region;
use cloudparity::scene::Scene;
use cloudparity::view::environment::Environment;
use glam::{DMat3, DMat4, DVec3};
use rand::{Rng as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;
use support::published;

const SETTINGS: EngineSettings =
    EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };

fn systems() -> Vec<&'static Model> {
    ["bolt", "best", "bfwe", "takram", "skill", "clusters"].map(|id| engines::find(id).expect("it is there")).to_vec()
}

fn layer_scene(resolution: [u32; 2]) -> Scene {
    let mut scene = support::scene("cloud-layer");
    scene.film.resolution = resolution;
    scene
}

fn engine(model: &Model, scene: &Scene, defects: &Defects, quality: Option<&str>) -> Engine {
    model.engine(scene, &model.values(quality, &[]).expect("in range"), defects, 0.0).expect("an engine")
}

fn picture(scene: &Scene, engine: &Engine) -> Vec<f32> {
    let renderer = EngineRenderer::new(scene, engine, None).expect("a renderer");
    renderer.picture(&SETTINGS, &|_, _| ()).expect("a picture").pixels.as_flattened().to_vec()
}

#[test]
fn values_lie_within_their_bounds() {
    let scene = layer_scene([8, 5]);
    for model in systems() {
        for defects in [Defects::NONE, Defects::ALL] {
            for quality in model.qualities.iter().map(|(name, _)| Some(*name)) {
                let engine = engine(model, &scene, &defects, quality);
                // 10,000 boxes of a density with its own values, fewer of its presets.
                let boxes = if quality == Some(model.qualities[0].0) { 10_000 } else { 500 };
                let survey =
                    Survey { layer: layer(&scene, 1.0), boxes, samples: 20, grid: 0, cells: 0, refine: 0, seed: 3 };
                let report = survey.run(engine.density.program()).expect("bounds");
                assert_eq!(report.violations, 0, "{} {quality:?}, defects {defects}: {report}", model.id);
            }
        }
    }
}

#[test]
fn no_parameters_make_a_value_that_is_no_number() {
    let scene = layer_scene([6, 4]);
    let mut random = ChaCha8Rng::seed_from_u64(8);
    // More of them: minutes for thousands.
    let sets = published::count("CLOUDPARITY_PARAMETER_SETS", 200);
    for model in systems() {
        let mut seen = 0;
        for number in 0..sets {
            let values = published::random_values(model, &mut random);
            let defects = if number % 2 == 0 { Defects::NONE } else { Defects::ALL };
            let seconds = [0.0, 1e6][usize::from(number % 5 == 0)];
            let engine = model.engine(&scene, &values, &defects, seconds).expect("an engine");
            let found = picture(&scene, &engine);
            assert!(found.iter().all(|value| value.is_finite() && *value >= 0.0), "{} {values:?}", model.id);
            let first = found[0];
            seen += usize::from(found.iter().any(|value| *value != first));
        }
        assert!(4 * seen > sets, "{}: {seen} of {sets} sets show anything", model.id);
    }
}

#[test]
fn each_defect_shows() {
    for model in systems() {
        let mut scene = layer_scene([32, 18]);
        if model.id == "takram" {
            // Below the layer, where its shadows are.
            (scene.camera.matrix_world[1][3], scene.camera.matrix_world[2][3]) = (-11.0, -0.7);
        }
        let values = match model.id {
            // Noise of one cell and more across the piece of the shell.
            "bfwe" => vec!["coverage=0.8".to_owned()],
            // A street of clouds, whose edge MS-1 is about, fog for MS-2, rays of the march for BO-15, and levels for BO-4 and BO-5.
            "bolt" => {
                ["spine_radius=6000", "fog=1", "march_ray_intensity=1", "march_ray_samples=8", "distance_levels=1"]
                    .map(str::to_owned)
                    .to_vec()
            }
            // Air for TK-11 and TK-18.
            "takram" => ["haze=1", "shafts=1"].map(str::to_owned).to_vec(),
            _ => Vec::new(),
        };
        let values = model.values(None, &values).expect("in range");
        let of = |defects: &Defects| picture(&scene, &model.engine(&scene, &values, defects, 0.0).expect("an engine"));
        let corrected = of(&Defects::NONE);
        for defect in model.defects {
            // Where the camera has eight steps, from 20 km above the base on, the floors of rays are above them.
            if defect.id == "BO-5" {
                let mut high = scene.clone();
                high.camera.matrix_world =
                    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 19.7], [0.0, 0.0, 0.0, 1.0]];
                let [kept, corrected] = [Defects::only(defect), Defects::NONE]
                    .map(|defects| picture(&high, &model.engine(&high, &values, &defects, 0.0).expect("an engine")));
                assert!(kept != corrected, "{}", defect.id);
                continue;
            }
            assert!(of(&Defects::only(defect)) != corrected, "{}", defect.id);
        }
    }
}

/// The fog of takram's manual, alone and wholly covered: 0.05 e^(0.001 eta) from where its profile of coverage, 1 - (2 eta^0.5 - 1)^2, is above
/// half of what shape takes away, at most 0.2; nothing at its faces and above it.
#[test]
fn ground_fog_is_the_layer_of_the_manual() {
    let model = engines::find("takram").expect("it is there");
    let scene = layer_scene([6, 4]);
    let set = ["coverage=1", "bottom=0", "thickness=600", "ground_fog=1"].map(str::to_owned);
    let values = model.values(None, &set).expect("in range");
    let engine = model.engine(&scene, &values, &Defects::NONE, 0.0).expect("an engine");
    let region = engine.density.bounds;
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for (part, is_foggy) in
        [(-0.01, false), (0.1, true), (0.25, true), (0.5, true), (0.6, true), (1.0, false), (1.5, false)]
    {
        let places: Vec<[f32; 3]> = (0..200)
            .map(|_| {
                let at = DVec3::new(random.random(), random.random(), part * 300.0 / 600.0);
                (region.low + (region.high - region.low) * at).as_vec3().to_array()
            })
            .collect();
        let expected = if is_foggy { 0.05 * f64::exp(1e-3 * part) } else { 0.0 };
        for found in engine.density.values(&places).expect("values") {
            // Half a dozen roundings of f32, and the height's of the box's size.
            assert!((f64::from(found) - expected).abs() < 1e-6, "{part}: {found}, not {expected}");
        }
    }
    let set = ["ground_fog=1".to_owned()];
    let above = model.engine(&scene, &model.values(None, &set).expect("in range"), &Defects::NONE, 0.0);
    let warnings = above.expect("an engine").warnings;
    assert!(warnings.iter().any(|warning| warning.contains("300 m")), "{warnings:?}");
}

#[test]
fn nothing_is_covered_without_coverage_and_an_unknown_set_is_refused() {
    let scene = layer_scene([6, 4]);
    for model in systems() {
        // A box of noise has no coverage.
        let nothing = match model.id {
            "best" => "density=0",
            "clusters" => "extinction=0",
            _ => "coverage=0",
        };
        let values = model.values(None, &[nothing.to_owned()]).expect("in range");
        let engine = model.engine(&scene, &values, &Defects::ALL, 0.0).expect("an engine");
        let found = picture(&scene, &engine);
        assert!(found.chunks(4).all(|pixel| pixel == &found[..4]), "{}: something is seen", model.id);
        // The first of two names is known.
        let known = model.qualities[0].0;
        let error = model.values(Some(&format!("{known},moon")), &[]).expect_err("unknown").to_string();
        assert!(error.contains("\"moon\"") && error.contains(known), "{error}");
    }
}

/// The rules of the encyclopedia's section 19 that a system can break: a sun below the ground, layers of no thickness, fades of 0.
#[test]
fn suns_below_the_ground_thin_layers_and_sharp_fades_give_numbers() {
    let mut scene = layer_scene([16, 9]);
    let (x, z) = (DVec3::Y, DVec3::new(0.6, 0.0, -0.8));
    let axes = DMat4::from_mat3(DMat3::from_cols(x, z.cross(x), z));
    scene.lights[0].matrix_world = cloudparity::scene::matrix_from_glam(axes);
    for model in systems() {
        let thin = ["thickness=0.001", "bottom_fade=0", "top_fade=0", "edge_fade=0", "least_transmittance=0"];
        let has = |text: &&str| model.has_parameter(text.split('=').next().unwrap_or_default());
        let thin: Vec<String> = thin.into_iter().filter(has).map(str::to_owned).collect();
        for texts in [Vec::new(), thin] {
            for defects in [Defects::NONE, Defects::ALL] {
                let values = model.values(None, &texts).expect("in range");
                let found = picture(&scene, &model.engine(&scene, &values, &defects, 0.0).expect("an engine"));
                assert!(found.iter().all(|value| value.is_finite() && *value >= 0.0), "{} {texts:?}", model.id);
            }
        }
    }
}

#[test]
fn a_cloud_as_a_scene_is_the_engines_medium() {
    let scene = layer_scene([24, 14]);
    let mut random = ChaCha8Rng::seed_from_u64(11);
    for model in systems() {
        // At the default coverage of bfwe this box is clear sky.
        let set = if model.id == "bfwe" { vec!["coverage=0.8".to_owned()] } else { Vec::new() };
        let values = model.values(None, &set).expect("in range");
        let engine = model.engine(&scene, &values, &Defects::NONE, 0.0).expect("an engine");
        let own = engine.scene(&scene).expect("a scene");
        let object = Arc::new(engine.medium().expect("a medium"));

        // Point by point: the scene's coefficients are products of at most four numbers of f32, each rounded, and so is each product.
        let media = [Media { objects: vec![Arc::clone(&object)] }, Media::new(&own).expect("media")];
        let Region { low, high } = engine.density.bounds;
        let corners = Bounds3::new(low.as_vec3().to_array(), high.as_vec3().to_array());
        let points = points_in(&corners, 40_000, &mut random);
        let places: Vec<DVec3> = points.into_iter().map(|point| DVec3::from(point.map(f64::from))).collect();
        let [of_medium, of_scene] = media.map(|media| media.evaluate(&places).expect("values"));
        let mut filled = 0;
        for (place, (first, second)) in places.iter().zip(of_medium.iter().zip(&of_scene)) {
            filled += usize::from(first.coefficients.extinction[0] > 0.0);
            let pairs = [
                (first.coefficients.extinction, second.coefficients.extinction),
                (first.coefficients.scattering, second.coefficients.scattering),
            ];
            for (first, second) in pairs.iter().flat_map(|(first, second)| first.iter().zip(second)) {
                let limit = 8.0 * f64::from(f32::EPSILON) / 2.0 * first.abs();
                assert!((first - second).abs() <= limit, "{} at {place}: {first}, not {second}", model.id);
            }
            for cosine in [-1.0, 0.1, 0.99] {
                let [first, second] = [first, second].map(|place| place.mixture.evaluate(cosine));
                // Anisotropies are rounded, too, and change the logarithm of Henyey and Greenstein's function by 100 times that at most (at 0.99); the
                // parts of the lobes are, as coefficients are.
                let limit = 200.0 * f64::from(f32::EPSILON) / 2.0 * first.abs();
                assert!((first - second).abs() <= limit, "{} at {place}: {first}, not {second}", model.id);
            }
        }
        assert!(filled > 200, "{}: {filled} of {} places have a cloud", model.id, places.len());

        // And what path tracing makes of it, whose samples and bounds come another way.
        let given = GivenMedium { identity: engine.medium_identity(), object };
        let settings = PathSettings { samples: 4, ..PathSettings::default() };
        let render = |subject: Subject<'_>| {
            let images = path::render_replicas(subject, &settings, Backend::Cpu, &[1, 2, 3, 4, 5, 6, 7, 8], &|_, _| ());
            let images = images.expect("pictures");
            assert!(images.iter().all(|image| image.provenance["violations"] == "0"), "{}", model.id);
            let means: Vec<f64> = images
                .iter()
                .map(|image| {
                    let values = image.pixels.iter().map(|pixel| f64::from(pixel[1]));
                    values.sum::<f64>() / image.pixels.len() as f64
                })
                .collect();
            let mean = means.iter().sum::<f64>() / 8.0;
            let variance = means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 7.0;
            (mean, (variance / 8.0).sqrt())
        };
        let (of_medium, first) = render(Subject { medium: Some(&given), ..Subject::from(&scene) });
        let (of_scene, second) = render(Subject::from(&own));
        // Five standard errors of independent pictures, and what f32 rounds of the coefficients.
        let limit = 5.0 * first.hypot(second) + 1e-5 * of_medium;
        println!("{}: {filled} filled, {of_medium} ({first}), {of_scene} ({second})", model.id);
        assert!((of_medium - of_scene).abs() <= limit, "{}: {of_medium}, not {of_scene}", model.id);
    }
}

#[test]
fn a_shell_and_a_slab_are_domains_of_their_own() {
    let scene = layer_scene([16, 9]);
    let radius = 6.36e6;
    let shell = Domain::Shell { centre: [0.0, 0.0, -radius], inner: radius + 1.2e5, outer: radius + 1.9e5 };
    let model = engines::find("bfwe").expect("it is there");
    let values = model.values(None, &["coverage=0.9".to_owned()]).expect("in range");
    let engine = model.engine_in(Some(shell), &scene, &values, &Defects::NONE, 0.0).expect("an engine");
    assert!((engine.extinction[0] - 400.0 * 1.02 / (radius + 1.2e5)).abs() < 1e-12);
    // Straight up through half the shell: the same cloud whether the centre is near or far, in units of the planet.
    let density = |place: DVec3| engine.density.values(&[place.as_vec3().to_array()]).expect("a value")[0];
    let values: Vec<f32> = (0..200)
        .map(|number| {
            let angle = f64::from(number) * 0.01;
            density(DVec3::new(angle.sin(), 0.0, angle.cos()) * (radius + 1.5e5))
        })
        .collect();
    assert!(values.iter().all(|value| value.is_finite()) && values.iter().any(|value| *value > 0.0));
    assert!(
        model
            .engine_in(
                Some(Domain::Slab { bottom: 0.0, top: 1.0 }),
                &scene,
                engine_values(&engine),
                &Defects::NONE,
                0.0
            )
            .is_err()
    );
}

fn engine_values(engine: &Engine) -> &Values {
    &engine.values
}

#[test]
fn a_sky_is_a_picture_around_a_scene_and_colours_its_sun() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = layer_scene([8, 5]);
    let mut suns = Vec::new();
    for model in engines::models().into_iter().filter(|model| model.sky.is_some()) {
        let sky = model.sky.expect("it has one");
        let values = Values::defaults(sky.parameters);
        for elevation in [-10.0, 3.0, 60.0] {
            let file = folder.path().join(format!("{}{elevation}.scene.json", model.id));
            sky.write(&scene, &values, Some(elevation), &file).expect("a scene");
            let under = Scene::load(&file).expect("it loads");
            let world = Environment::load(&under).expect("a readable picture").expect("a picture");
            let towards = cloudparity::scene::matrix_to_glam(&under.lights[0].matrix_world).z_axis.truncate();
            assert!((towards.z - f64::to_radians(elevation).sin()).abs() < 1e-6, "{}", model.id);
            let look = (sky.look)(&values, towards);
            suns.push(under.lights[0].color);
            let white = engines::sky::white(&scene);
            for number in 0..200 {
                let angle = f64::from(number) * 2.4;
                let up: f64 = -0.99 + f64::from(number) * 0.0099;
                let flat = (1.0 - up * up).sqrt();
                let direction = DVec3::new(flat * angle.cos(), flat * angle.sin(), up);
                let truth = (look.radiance)(direction).map(|channel| channel * white);
                let found = world.radiance(direction);
                for channel in 0..3 {
                    // Pixels are 0.7 degrees high. The gradient's root falls steeply at the horizon: to within a pixel of it, by its root, 0.11 of all.
                    let steep = if up.abs() < 0.02 { 0.11 } else { 0.004 };
                    let bound = steep * white;
                    let error = (found[channel] - truth[channel]).abs();
                    assert!(error < bound, "{} at {elevation}, {direction}: {found:?}, not {truth:?}", model.id);
                }
            }
            let engine = engine(model, &under, &Defects::NONE, None);
            assert!(picture(&under, &engine).iter().all(|value| value.is_finite() && *value >= 0.0));
        }
    }
    assert!(suns.len() == 6 && suns[1] != suns[2] && suns[4] != suns[5], "{suns:?}");
    let dark = Scene { lights: Vec::new(), ..scene.clone() };
    let sky = engines::find("bolt").expect("it is there").sky.expect("it has one");
    let file = folder.path().join("dark.scene.json");
    let error = sky.write(&dark, &Values::defaults(sky.parameters), None, &file).expect_err("refused").to_string();
    assert!(error.contains("no sun") && !file.exists(), "{error}");
}
