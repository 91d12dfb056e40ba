//! The path integrator against closed forms and tabulated truths.
//!
//! How a figure is judged stands in `support/estimate.rs`.

mod support;

use cloudparity::gpu::Backend;
use cloudparity::integrators::path;
use cloudparity::integrators::path::{PathSettings, Tracking};
use cloudparity::media::majorant::{Effort, Majorants};
use cloudparity::scene::image::Image;
use cloudparity::scene::{Input, Light, LightKind, Scene};
use std::f64::consts::PI;
use support::cube::{SCATTERING, SUN, color, homogeneous, phase, ramp, set, slanted_sun, sphere};
use support::estimate::{ROUNDING, bounces, estimate, furnace, meets};

#[test]
fn an_absorbing_cube_follows_beer_lambert_without_noise() {
    let mut scene = furnace();
    scene.world.color = [1.0, 0.5, 0.25];
    set(&mut scene, "Color", color([0.0; 3]));
    let found = estimate(&scene, 4);
    for (channel, world) in [1.0, 0.5, 0.25].into_iter().enumerate() {
        meets(found[channel], world * (-2.0_f64).exp(), 0.0);
        assert!(found[channel].1 < ROUNDING, "a homogeneous medium needs no samples");
    }
}

#[test]
fn single_scattering_of_a_sun_meets_its_closed_forms() {
    let root = 2.0_f64.sqrt();
    let slanted =
        (-root).exp() * (1.0 - (-1.0_f64).exp()) + (-(1.0 + root)).exp() * ((root - 1.0).exp() - 1.0) / (root - 1.0);
    for anisotropy in [0.0, 0.6, -0.3] {
        let mut scene = homogeneous();
        scene.film.transparent = true;
        set(&mut scene, "Anisotropy", Input::Number(anisotropy as f32));
        let found = estimate(&scene, 1 << 13);
        let straight = SUN * phase(anisotropy, 0.0) * (-1.0_f64).exp() * (1.0 - (-2.0_f64).exp());
        for channel in 0..3 {
            meets(found[channel], SCATTERING[channel] * straight, 0.0);
        }
        meets(found[3], 1.0 - (-2.0_f64).exp(), 0.0);
        slanted_sun(&mut scene);
        let found = estimate(&scene, 1 << 13);
        for channel in 0..3 {
            meets(found[channel], SCATTERING[channel] * SUN * phase(anisotropy, 1.0 / root) * slanted, 0.0);
        }
    }
}

#[test]
fn emission_meets_its_closed_form_with_and_without_density() {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.film.transparent = true;
    set(&mut scene, "Emission Strength", Input::Number(0.5));
    set(&mut scene, "Color", color([0.0; 3]));
    for (density, expected) in [(0.0_f64, 1.0), (0.7, 0.5 * (1.0 - (-1.4_f64).exp()) / 0.7)] {
        set(&mut scene, "Density", Input::Number(density as f32));
        let found = estimate(&scene, 4);
        meets(found[0], expected, 0.0);
        assert!((found[3].0 - (1.0 - (-2.0 * density).exp())).abs() < ROUNDING, "emission adds no alpha");
    }
}

#[test]
fn emission_is_scattered_as_far_as_bounces_allow() {
    // Extinction 1, albedo 0.8, emission 0.1 per metre; truths of an independent random walk, 1e-4.
    let mut scene = homogeneous();
    scene.lights.clear();
    set(&mut scene, "Color", color([0.8; 3]));
    set(&mut scene, "Emission Strength", Input::Number(0.1));
    for (number, truth) in [(0, 0.12928), (1, 0.14981), (4, 0.16575), (64, 0.16738)] {
        bounces(&mut scene, number);
        meets(estimate(&scene, 1 << 11)[0], truth, 1e-4);
    }
}

#[test]
fn ramps_of_density_meet_their_closed_forms() {
    // E1: along the view, absorbing.
    let mut scene = furnace();
    ramp(&mut scene, "Y", 2.0);
    set(&mut scene, "Color", color([0.0; 3]));
    meets(estimate(&scene, 1 << 12)[0], (-2.0_f64).exp(), 0.0);
    let sphere_angle = 4.0 * PI;
    // E3: towards the sun.
    let mut scene = homogeneous();
    ramp(&mut scene, "Z", 2.0);
    set(&mut scene, "Color", color([1.0; 3]));
    meets(estimate(&scene, 1 << 13)[0], SUN / sphere_angle * (-1.5_f64).exp() * (1.0 - (-2.0_f64).exp()), 0.0);
    // E4: along the view, scattering.
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 4.0);
    set(&mut scene, "Color", color([1.0; 3]));
    let steps = 200_000;
    let width = 2.0 / f64::from(steps);
    let integral: f64 = (0..steps)
        .map(|step| (f64::from(step) + 0.5) * width)
        .map(|t| 2.0 * t * (-2.0 * t).exp() * (-t * t).exp() * width)
        .sum();
    meets(estimate(&scene, 1 << 14)[0], SUN / sphere_angle * integral, 0.0);
}

#[test]
fn a_sphere_in_the_cube_meets_its_closed_forms() {
    let radius = 0.7_f64;
    let mut scene = furnace();
    sphere(&mut scene);
    set(&mut scene, "Color", color([0.0; 3]));
    meets(estimate(&scene, 1 << 18)[0], (-6.0 * radius).exp(), 0.0);
    let mut scene = homogeneous();
    sphere(&mut scene);
    set(&mut scene, "Color", color([1.0; 3]));
    let steps = 200_000;
    let width = 2.0 * radius / f64::from(steps);
    let integral: f64 = (0..steps)
        .map(|step| -radius + (f64::from(step) + 0.5) * width)
        .map(|y| 3.0 * (-3.0 * (y + radius)).exp() * (-3.0 * (radius * radius - y * y).sqrt()).exp() * width)
        .sum();
    meets(estimate(&scene, 1 << 13)[0], SUN / (4.0 * PI) * integral, 0.0);
}

/// A figure and its standard error.
type Truth = (f64, f64);

#[test]
fn every_number_of_bounces_has_its_brightness() {
    // Extinction 2, albedo 0.9, world 1; truths of an independent random walk with their standard errors.
    let mut scene = furnace();
    set(&mut scene, "Density", Input::Number(2.0));
    set(&mut scene, "Color", color([0.9; 3]));
    let table: [(u32, Truth, Truth); 5] = [
        (0, (0.20556, 2.7e-4), (0.09086, 1.9e-4)),
        (1, (0.33472, 3.0e-4), (0.20617, 2.6e-4)),
        (2, (0.42875, 3.0e-4), (0.33716, 2.8e-4)),
        (4, (0.54671, 2.6e-4), (0.53865, 2.3e-4)),
        (16, (0.66393, 1.5e-4), (0.65831, 1.1e-4)),
    ];
    for (number, isotropic, forward) in table {
        bounces(&mut scene, number);
        for (anisotropy, (truth, error)) in [(0.0, isotropic), (0.8, forward)] {
            set(&mut scene, "Anisotropy", Input::Number(anisotropy));
            meets(estimate(&scene, 1 << 13)[0], truth, error);
        }
    }
    set(&mut scene, "Anisotropy", Input::Number(0.0));
    bounces(&mut scene, 1024);
    meets(estimate(&scene, 1 << 12)[0], 0.66528, 1.5e-4);
}

#[test]
fn a_white_furnace_is_white_however_thick() {
    // Optical depth 50, homogeneous: every path ends in the world with weight 1.
    let mut scene = furnace();
    bounces(&mut scene, 1 << 20);
    set(&mut scene, "Density", Input::Number(25.0));
    let found = estimate(&scene, 64);
    for channel in 0..3 {
        meets(found[channel], 1.0, 0.0);
    }
    // A ramp up to optical depth 25, with a phase function that prefers a direction.
    ramp(&mut scene, "Y", 25.0);
    set(&mut scene, "Anisotropy", Input::Number(0.6));
    meets(estimate(&scene, 1 << 11)[0], 1.0, 0.0);
}

#[test]
fn a_white_furnace_stays_white_with_the_cloud_in_it() {
    // At ten times its density the cloud is thick: paths scatter dozens of times, through a thousand leaves.
    let mut scene = support::scene("clouds-close");
    scene.set("Density=10").expect("an input of the material");
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    scene.film.transparent = false;
    scene.film.resolution = [16, 9];
    bounces(&mut scene, 1 << 20);
    for (channel, found) in estimate(&scene, 16).into_iter().take(3).enumerate() {
        println!("channel {channel}");
        meets(found, 1.0, 0.0);
    }
}

#[test]
fn coloured_extinction_is_without_bias() {
    // One channel scatters a hundred times as much as another; the furnace is white in each.
    let mut scene = furnace();
    bounces(&mut scene, 1 << 20);
    set(&mut scene, "Density", Input::Number(1.0));
    set(&mut scene, "Color", color([0.05, 1.0, 5.0]));
    set(&mut scene, "Absorption Color", color([1.0; 3]));
    let found = estimate(&scene, 1 << 13);
    for channel in 0..3 {
        meets(found[channel], 1.0, 0.0);
    }
}

/// Density of the cube in which lights with extent are tested.
const THIN: f64 = 0.1;

/// A white, forward scattering cube of density [`THIN`] with a light 3 m above its centre.
fn thin(light: LightKind, strength: f64) -> Scene {
    let mut scene = homogeneous();
    set(&mut scene, "Density", Input::Number(THIN as f32));
    set(&mut scene, "Color", color([1.0; 3]));
    set(&mut scene, "Anisotropy", Input::Number(0.5));
    scene.lights = vec![Light { kind: light, strength: strength as f32, ..scene.lights[0].clone() }];
    scene.lights[0].matrix_world[2][3] = 3.0;
    scene
}

/// Single scattering in [`thin`] by quadrature over the central ray (midpoints of 128 steps: relative
/// error 1e-5 of second derivatives of order 1). `arriving` lists, for a place, directions towards the light
/// and radiance times solid angle without the medium.
fn thin_truth(arriving: impl Fn([f64; 3]) -> Vec<([f64; 3], f64)>) -> f64 {
    let steps = 128;
    let width = 2.0 / f64::from(steps);
    (0..steps)
        .map(|step| -1.0 + (f64::from(step) + 0.5) * width)
        .map(|y| {
            let lit: f64 = arriving([0.0, y, 0.0])
                .iter()
                .map(|([x, along, z], power)| {
                    let sideways = if *along > 0.0 { (1.0 - y) / along } else { (1.0 + y) / -along };
                    let way = sideways.min(1.0 / z.abs()).min(1.0 / x.abs());
                    // The light travels against the direction towards it, and on against the view.
                    phase(0.5, *along) * power * (-THIN * way).exp()
                })
                .sum();
            lit * THIN * (-THIN * (y + 1.0)).exp() * width
        })
        .sum()
}

/// Points of a surface, with normals, as seen from `place`: directions, radiance times solid angle.
fn surface(place: [f64; 3], points: &[([f64; 3], [f64; 3])], radiance: f64, area: f64) -> Vec<([f64; 3], f64)> {
    points
        .iter()
        .map(|(point, normal)| {
            let offset: [f64; 3] = std::array::from_fn(|axis| point[axis] - place[axis]);
            let square: f64 = offset.iter().map(|part| part * part).sum();
            let towards = offset.map(|part| part / square.sqrt());
            let cosine: f64 = -(0..3).map(|axis| towards[axis] * normal[axis]).sum::<f64>();
            (towards, radiance * cosine.max(0.0) * area / points.len() as f64 / square)
        })
        .collect()
}

#[test]
fn lights_with_extent_deliver_what_quadrature_says() {
    let strength = 100.0;
    // Midpoints of count x count cells of a square.
    let grid = |count: i32| {
        (0..count * count).map(move |index| {
            let middle = |number: i32| (2.0 * f64::from(number) + 1.0) / f64::from(count) - 1.0;
            [middle(index % count), middle(index / count)]
        })
    };
    let down = [0.0, 0.0, -1.0];
    // A square of 2 x 2 m, 3 m above the centre.
    let area = |shape: &str| LightKind::Area { shape: shape.into(), size: [2.0, 2.0] };
    let square: Vec<_> = grid(64).map(|[x, y]| ([x, y, 3.0], down)).collect();
    let truth = thin_truth(|place| surface(place, &square, strength / (PI * 4.0), 4.0));
    meets(estimate(&thin(area("SQUARE"), strength), 1 << 14)[0], truth, 0.0);
    // The ellipse in it. A grid of 256 points a side covers a circle's area to 1e-4 at worst.
    let round: Vec<_> = grid(256).filter(|[x, y]| x * x + y * y < 1.0).map(|[x, y]| ([x, y, 3.0], down)).collect();
    let truth = thin_truth(|place| surface(place, &round, strength / (PI * PI), PI));
    meets(estimate(&thin(area("DISK"), strength), 1 << 14)[0], truth, 1e-4 * truth);
    // A disc that faces each receiver: radiance P / (4 pi^2 r^2).
    let radius = 0.5;
    let disc = |place: [f64; 3]| {
        let length = (place[1] * place[1] + 9.0).sqrt();
        let normal = [0.0, place[1] / length, -3.0 / length];
        // Orthogonal to the normal and to x.
        let side = [0.0, -normal[2], normal[1]];
        let points: Vec<_> = grid(128)
            .filter(|[x, y]| x * x + y * y < 1.0)
            .map(|[x, y]| ([radius * x, radius * y * side[1], 3.0 + radius * y * side[2]], normal))
            .collect();
        surface(place, &points, strength / (2.0 * PI * radius).powi(2), PI * radius * radius)
    };
    let truth = thin_truth(disc);
    let soft = LightKind::Point { radius: radius as f32, soft_falloff: true };
    meets(estimate(&thin(soft, strength), 1 << 14)[0], truth, 3e-4 * truth);
    // A wide sun: radiance P / (pi sin^2 a) in a cone.
    let half = 0.6_f64;
    let cone: Vec<[f64; 3]> = (0..256)
        .flat_map(|ring| (0..256).map(move |turn| (ring, turn)))
        .map(|(ring, turn)| {
            let cosine = 1.0 - (1.0 - half.cos()) * (f64::from(ring) + 0.5) / 256.0;
            let angle = 2.0 * PI * (f64::from(turn) + 0.5) / 256.0;
            let sine = (1.0 - cosine * cosine).sqrt();
            [sine * angle.cos(), sine * angle.sin(), cosine]
        })
        .collect();
    let each = strength / (PI * half.sin().powi(2)) * 2.0 * PI * (1.0 - half.cos()) / cone.len() as f64;
    let truth = thin_truth(|_| cone.iter().map(|towards| (*towards, each)).collect());
    let sun = LightKind::Sun { angle: 2.0 * half as f32 };
    meets(estimate(&thin(sun, strength), 1 << 14)[0], truth, 0.0);
}

#[test]
fn a_planted_percent_of_density_is_seen() {
    let mut scene = homogeneous();
    set(&mut scene, "Density", Input::Number(1.01));
    let (found, error) = estimate(&scene, 1 << 13)[0];
    let expected = SCATTERING[0] * SUN * phase(0.0, 0.0) * (-1.0_f64).exp() * (1.0 - (-2.0_f64).exp());
    // One percent of density changes this radiance by -0.7 %.
    assert!((found - expected).abs() > 4.0 * error, "{found} ({error:e}) against {expected}");
}

#[test]
fn equal_seeds_give_equal_bits_on_any_number_of_threads() {
    let mut scene = support::scene("procedural-clouds");
    scene.film.resolution = [24, 14];
    scene.integrator.volume_bounces = 2;
    let render = |threads: usize, seed: u32| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        let settings = PathSettings { samples: 4, seed, ..PathSettings::default() };
        pool.install(|| path::render(&scene, &settings, Backend::Cpu, None, &|_, _| {}))
            .expect("the scene renders")
            .pixels
    };
    let one = render(1, 7);
    assert_eq!(one, render(2, 7));
    assert_ne!(one, render(1, 8));
}

#[test]
fn no_density_exceeds_its_majorant_and_the_null_share_is_told() {
    let mut scene = support::scene("procedural-clouds");
    scene.film.resolution = [48, 27];
    let settings = PathSettings { samples: 16, seed: 1, ..PathSettings::default() };
    let image = path::render(&scene, &settings, Backend::Cpu, None, &|_, _| {}).expect("it renders");
    let collisions: u64 = image.provenance["collisions"].parse().expect("a number");
    assert!(collisions > 1000, "{collisions} collisions");
    assert_eq!(image.provenance["violations"], "0");
    let null: f64 = image.provenance["null_share"].parse().expect("a number");
    assert!((0.0..1.0).contains(&null), "null share {null}");
}

#[test]
fn every_tracking_gives_the_same_mean_and_only_adaptive_looks_less_often() {
    let mut scene = support::scene("noise-anisotropic");
    scene.film.resolution = [16, 9];
    let rendered = |tracking: Tracking, first_seed: u32| {
        let settings = PathSettings { samples: 64, tracking, ..PathSettings::default() };
        let seeds: Vec<u32> = (first_seed..first_seed + 16).collect();
        path::render_replicas(&scene, &settings, Backend::Cpu, &seeds, &|_, _| {}).expect("it renders")
    };
    let mean_and_square = |images: &[Image], channel: usize| {
        let means: Vec<f64> = images.iter().map(|image| image.mean()[channel]).collect();
        let mean = means.iter().sum::<f64>() / 16.0;
        (mean, means.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 15.0 / 16.0)
    };
    let collisions = |images: &[Image]| -> u64 {
        images.iter().map(|image| image.provenance["collisions"].parse::<u64>().expect("a number")).sum()
    };
    let proven = rendered(Tracking::Proven, 0);
    for (tracking, first_seed) in [(Tracking::Adaptive, 100), (Tracking::Global, 200)] {
        let other = rendered(tracking, first_seed);
        for channel in 0..4 {
            let ((ours, square), (expected, other_square)) =
                (mean_and_square(&other, channel), mean_and_square(&proven, channel));
            let error = (square + other_square + (ROUNDING * expected).powi(2)).sqrt();
            assert!(error < 0.005 * expected, "{tracking:?}, channel {channel}: {error} is too noisy for {expected}");
            // 30 degrees of freedom exceed 4.5 by chance once in 10,000.
            let t = (ours - expected) / error;
            assert!(t.abs() < 4.5, "{tracking:?}, channel {channel}: {ours}, expected {expected}, t = {t}");
        }
        assert_eq!(collisions(&other) < collisions(&proven), tracking == Tracking::Adaptive, "{tracking:?}");
    }
    let is_negative = |image: &Image| image.pixels.iter().flatten().any(|value| *value < 0.0);
    assert!(!proven.iter().any(is_negative));
}

/// An input of the homogeneous cube that is `factor` over the distance from the middle, seen `offset` beside it.
fn over_distance(input: &str, factor: f64, offset: f32) -> Scene {
    let mut scene = furnace();
    scene.camera.ortho_scale = 1e-6;
    scene.camera.matrix_world[0][3] = offset;
    set(&mut scene, "Color", color([0.0; 3]));
    let nodes: Vec<cloudparity::scene::Node> = serde_json::from_value(serde_json::json!([
        {"name": "Place", "type": "ShaderNodeTexCoord"},
        {
            "name": "Length", "type": "ShaderNodeVectorMath", "properties": {"operation": "LENGTH"},
            "inputs": {"Vector": {"node": "Place", "socket": "Object"}},
        },
        {
            "name": "Over", "type": "ShaderNodeMath", "properties": {"operation": "DIVIDE"},
            "inputs": {"Value": factor, "Value_001": {"node": "Length", "socket": "Value"}},
        },
    ]))
    .expect("nodes");
    scene.graph_mut().nodes.extend(nodes);
    set(&mut scene, input, Input::Link { node: "Over".into(), socket: "Value".into() });
    scene
}

#[test]
fn a_density_without_bound_is_capped_at_what_is_found_and_reported() {
    // Beside the middle, where nothing is capped: the integral of k / sqrt(b^2 + y^2) over the cube.
    let beside = over_distance("Density", 0.5, 0.3);
    meets(estimate(&beside, 1 << 12)[0], (-2.0 * 0.5 * (1.0 / 0.3_f64).asinh()).exp(), 0.0);
    // Through the middle: k / r up to the cap c, which it reaches at r = k / c, in the eight finest cells there.
    let through = over_distance("Density", 0.05, 0.0);
    let settings = PathSettings { samples: 1 << 12, ..PathSettings::default() };
    let image = path::render(&through, &settings, Backend::Cpu, None, &|_, _| {}).expect("it renders");
    let number = |name: &str| image.provenance[name].parse::<f64>().expect("a number");
    assert_eq!(number("capped_share"), 8.0 / f64::from(1_u32 << 27));
    let cap = number("capped_extinction");
    // 16 places in each of 64 cells of a cell: the nearest is at most 1/64 of its diagonal away from the corner, and not in it.
    assert!((0.05 / 0.0068..1e4).contains(&cap), "{cap}");
    // Each of the cells has a cap of its own, of which the largest is reported: the ray goes through two of the eight.
    let through_a_cap = |cap: f64| (-0.1 * (1.0 + (cap / 0.05).ln())).exp();
    let (found, error) = estimate(&through, 1 << 12)[0];
    assert!(error <= 0.002 * found, "the standard error {error:e} is too large to tell");
    let range = through_a_cap(cap) - 4.0 * error..through_a_cap(0.05 / 0.0068) + 4.0 * error;
    assert!(range.contains(&found), "{found} ({error:e}) is not in {range:?}");
    // Nothing is reported where everything has a bound.
    let image =
        path::render(&homogeneous(), &PathSettings::default(), Backend::Cpu, None, &|_, _| {}).expect("a picture");
    assert!(!image.provenance.contains_key("capped_share"));
}

#[test]
fn a_density_that_is_infinite_in_a_region_is_rejected_with_its_place() {
    let mut scene = over_distance("Density", 1e38, 0.3);
    let small: Vec<cloudparity::scene::Node> = serde_json::from_value(serde_json::json!([
        {
            "name": "Small", "type": "ShaderNodeMath", "properties": {"operation": "MULTIPLY"},
            "inputs": {"Value": {"node": "Length", "socket": "Value"}, "Value_001": 1e-5},
        },
    ]))
    .expect("a node");
    scene.graph_mut().nodes.extend(small);
    let over = scene.graph_mut().nodes.iter_mut().find(|node| node.name == "Over").expect("it was put there");
    over.inputs.insert("Value_001".into(), Input::Link { node: "Small".into(), socket: "Value".into() });
    let error = path::render(&scene, &PathSettings::default(), Backend::Cpu, None, &|_, _| {})
        .expect_err("it is rejected")
        .to_string();
    assert!(error.contains("position") && error.contains("inf") && error.contains("a finite extinction"), "{error}");
}

#[test]
fn an_emission_without_bound_meets_its_closed_form() {
    let mut scene = over_distance("Emission Strength", 0.1, 0.3);
    set(&mut scene, "Density", Input::Number(0.0));
    scene.world.color = [0.0; 3];
    meets(estimate(&scene, 1 << 13)[0], 2.0 * 0.1 * (1.0 / 0.3_f64).asinh(), 0.0);
    // With absorption, from where it is emitted to the near face.
    set(&mut scene, "Density", Input::Number(0.7));
    let steps = 100_000;
    let width = 2.0 / f64::from(steps);
    let emitted = |y: f64| 0.1 / (0.09 + y * y).sqrt() * (-0.7 * (y + 1.0)).exp();
    let truth: f64 = (0..steps).map(|step| emitted(-1.0 + (f64::from(step) + 0.5) * width) * width).sum();
    meets(estimate(&scene, 1 << 13)[0], truth, 0.0);
}

#[test]
fn a_medium_across_the_far_clip_is_left_out_and_the_near_clip_cuts_it() {
    let mut scene = furnace();
    set(&mut scene, "Color", color([0.0; 3]));
    scene.camera.clip_end = 5.0;
    meets(estimate(&scene, 4)[0], 1.0, 0.0);
    scene.camera.clip_end = 100.0;
    scene.camera.clip_start = 4.5;
    meets(estimate(&scene, 4)[0], (-1.5_f64).exp(), 0.0);
}

#[test]
fn majorants_enclose_what_is_there() {
    use cloudparity::graph::Program;
    use cloudparity::graph::evaluate::Points;
    use glam::{DMat4, DVec3};
    use rand::{Rng, SeedableRng};
    let program = Program::density(&support::scene("procedural-clouds")).expect("it compiles");
    let corners = [DVec3::splat(-1.0), DVec3::splat(1.0)];
    let effort = Effort { rays: 1e5, tracking: Tracking::Proven };
    let tree =
        Majorants::build(corners, &DMat4::IDENTITY, effort, |boxes| program.bounds_many(boxes)).expect("it builds");
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    // Half of the points in the layer where the cloud is.
    let positions: Vec<[f32; 3]> = (0..100_000)
        .map(|index| {
            let height = if index % 2 == 0 { random.random_range(-1.0..1.0) } else { random.random_range(0.0..0.5) };
            [random.random_range(-1.0..1.0), random.random_range(-1.0..1.0), height]
        })
        .collect();
    let values = program.evaluate_single(Points::new(&positions)).expect("it evaluates");
    let mut filled = 0;
    for (position, value) in positions.iter().zip(values) {
        let [low, high] = tree.at(DVec3::from(position.map(f64::from)));
        let value = f64::from(value.max(0.0));
        assert!(low <= value && value <= high, "{position:?}: {value} is not between {low} and {high}");
        filled += u32::from(value > 0.0);
    }
    assert!(filled > 1000, "only {filled} points hold anything");
}
