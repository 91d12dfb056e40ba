//! The path integrator in media in full: closures, lobes, several objects, varying emission, environment images;
//! against closed forms and quadrature along the central ray of a cube of edge 2, which runs along +Y.
//!
//! How a figure is judged stands in `support/estimate.rs`.

mod support;

use cloudparity::gpu::Backend;
use cloudparity::integrators::path;
use cloudparity::integrators::path::PathSettings;
use cloudparity::scene::image::Image;
use cloudparity::scene::{Graph, Scene, WorldImage};
use cloudparity::view::environment::Environment;
use glam::DVec3;
use serde_json::{Value as Json, json};
use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};
use support::cube::{SUN, homogeneous, phase, slanted_sun};
use support::estimate::{ROUNDING, bounces, estimate, meets};
use support::graphs::{graph, link, node};

/// Rayleigh's phase function in 1/sr.
fn rayleigh(cosine: f64) -> f64 {
    3.0 * (1.0 + cosine * cosine) / (16.0 * PI)
}

/// Integral from -1 to 1 by midpoints: relative error 1e-8 of second derivatives of order 1. Steps end at the faces
/// of objects, which lie at multiples of 1/4.
fn along_the_ray(function: impl Fn(f64) -> f64) -> f64 {
    let steps = 8000;
    let width = 2.0 / f64::from(steps);
    (0..steps).map(|step| function(-1.0 + (f64::from(step) + 0.5) * width) * width).sum()
}

/// The cube with this graph, sun and black world.
fn cube(graph: Graph) -> Scene {
    let mut scene = homogeneous();
    *scene.graph_mut() = graph;
    bounces(&mut scene, 0);
    scene
}

/// A white Volume Scatter.
fn scatter(name: &str, phase: &str, density: Json, anisotropy: Json) -> Json {
    let mut inputs = json!({"Color": [1.0, 1.0, 1.0, 1.0], "Density": density});
    if phase == "HENYEY_GREENSTEIN" {
        inputs["Anisotropy"] = anisotropy;
    }
    node(name, "ShaderNodeVolumeScatter", json!({ "phase": phase }), inputs)
}

fn absorption(name: &str, color: [f32; 4], density: f32) -> Json {
    node(name, "ShaderNodeVolumeAbsorption", json!({}), json!({"Color": color, "Density": density}))
}

/// Add Shader of two closures.
fn add(name: &str, first: Json, second: Json) -> Json {
    node(name, "ShaderNodeAddShader", json!({}), json!({"Shader": first, "Shader_001": second}))
}

/// Nodes whose Math node "Ramp" is `slope` times (y + 1) / 2.
fn ramp(slope: f32) -> Vec<Json> {
    vec![
        node("Coordinate", "ShaderNodeTexCoord", json!({"from_instancer": false, "object": null}), json!({})),
        node("Separate", "ShaderNodeSeparateXYZ", json!({}), json!({"Vector": link("Coordinate", "Generated")})),
        node(
            "Ramp",
            "ShaderNodeMath",
            json!({"operation": "MULTIPLY", "use_clamp": false}),
            json!({"Value": link("Separate", "Y"), "Value_001": slope}),
        ),
    ]
}

/// Puts a second cube of this edge into the scene, turned about X, its centre on the ray.
fn with_second(mut scene: Scene, mut graph: Graph, edge: f32, place: f32, turn: f32) -> Scene {
    let mut second = scene.volume.clone();
    second.object = "Second".into();
    second.material = "Other".into();
    graph.material = "Other".into();
    let (s, c) = turn.sin_cos();
    let half = edge / 2.0;
    second.matrix_world = [
        [half, 0.0, 0.0, 0.0],
        [0.0, half * c, -half * s, place],
        [0.0, half * s, half * c, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    scene.other_volumes.push(second);
    scene.other_graphs.push(graph);
    scene
}

#[test]
fn overlapping_objects_absorb_by_the_sum_of_their_depths() {
    let white = [0.0, 0.0, 0.0, 1.0];
    let one = |density: f32| graph(link("A", "Volume"), &[absorption("A", white, density)]);
    // The second cube sticks out of the first; the ray crosses it at an angle.
    let turn = 0.4_f64;
    let mut scene = with_second(cube(one(0.3)), one(0.8), 1.0, 1.0, turn as f32);
    scene.lights.clear();
    scene.world.color = [1.0, 0.5, 0.25];
    let through = (-0.6 - 0.8 / turn.cos()).exp();
    let found = estimate(&scene, 1 << 14);
    for (channel, world) in [1.0, 0.5, 0.25].into_iter().enumerate() {
        meets(found[channel], world * through, 0.0);
    }
}

#[test]
fn a_white_furnace_of_two_objects_with_different_lobes_is_white() {
    let forward = graph(link("S", "Volume"), &[scatter("S", "HENYEY_GREENSTEIN", json!(1.5), json!(0.6))]);
    let coloured = graph(
        link("C", "Volume"),
        &[node(
            "C",
            "ShaderNodeVolumeCoefficients",
            json!({"phase": "RAYLEIGH"}),
            json!({"Scatter Coefficients": [2.0, 1.5, 1.0], "Absorption Coefficients": [0.0, 0.0, 0.0]}),
        )],
    );
    let mut scene = with_second(cube(forward), coloured, 1.5, 0.5, 0.3);
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    bounces(&mut scene, 1 << 20);
    let found = estimate(&scene, 1 << 12);
    for channel in 0..3 {
        meets(found[channel], 1.0, 0.0);
    }
}

#[test]
fn overlapping_objects_scatter_each_by_its_own_lobe() {
    let forward = graph(link("S", "Volume"), &[scatter("S", "HENYEY_GREENSTEIN", json!(0.5), json!(0.6))]);
    let inner = graph(link("S", "Volume"), &[scatter("S", "RAYLEIGH", json!(0.8), json!(null))]);
    let scene = with_second(cube(forward), inner, 1.0, 0.0, 0.0);
    let truth = along_the_ray(|y| {
        let inside = if y.abs() < 0.5 { 1.0 } else { 0.0 };
        let behind = 0.5 * (y + 1.0) + 0.8 * (y + 0.5).clamp(0.0, 1.0);
        let above = 0.5 + 0.8 * 0.5 * inside;
        SUN * (-behind - above).exp() * (0.5 * phase(0.6, 0.0) + 0.8 * inside * rayleigh(0.0))
    });
    meets(estimate(&scene, 1 << 14)[0], truth, 0.0);
}

#[test]
fn constant_and_varying_mixtures_of_lobes_meet_their_closed_forms() {
    // Lobes in constant proportions, a slanted sun.
    let nodes = [
        scatter("A", "HENYEY_GREENSTEIN", json!(0.6), json!(0.6)),
        scatter("B", "RAYLEIGH", json!(0.4), json!(null)),
        add("Sum", link("A", "Volume"), link("B", "Volume")),
    ];
    let mut scene = cube(graph(link("Sum", "Shader"), &nodes));
    slanted_sun(&mut scene);
    let root = 2.0_f64.sqrt();
    let integral =
        (-root).exp() * (1.0 - (-1.0_f64).exp()) + (-(1.0 + root)).exp() * ((root - 1.0).exp() - 1.0) / (root - 1.0);
    let mixed = 0.6 * phase(0.6, FRAC_1_SQRT_2) + 0.4 * rayleigh(FRAC_1_SQRT_2);
    meets(estimate(&scene, 1 << 13)[0], SUN * mixed * integral, 0.0);
    // One lobe's anisotropy, and with it nothing else, varies along the ray; the sun shines across.
    let mut nodes = ramp(0.8);
    nodes.push(scatter("A", "HENYEY_GREENSTEIN", json!(0.6), link("Ramp", "Value")));
    nodes.push(scatter("B", "RAYLEIGH", json!(0.4), json!(null)));
    nodes.push(add("Sum", link("A", "Volume"), link("B", "Volume")));
    let scene = cube(graph(link("Sum", "Shader"), &nodes));
    let truth = along_the_ray(|y| {
        let lobes = 0.6 * phase(0.4 * (y + 1.0), 0.0) + 0.4 * rayleigh(0.0);
        SUN * (-(y + 1.0) - 1.0).exp() * lobes
    });
    meets(estimate(&scene, 1 << 13)[0], truth, 0.0);
}

#[test]
fn sampled_directions_of_a_varying_mixture_follow_it() {
    // Two scatterings in a furnace: with absorption the brightness depends on how far directions turn. The same
    // medium, written with constants and so that its lobes look varying, has to be equally bright; and brighter or
    // darker than with one of its lobes alone.
    let brightness = |varying: bool, lobes: &[&str]| {
        // Zero times the ramp keeps the value and loses the constancy.
        let mut nodes = ramp(1e-30);
        let anisotropy = node(
            "Anisotropy",
            "ShaderNodeMath",
            json!({"operation": "ADD", "use_clamp": false}),
            json!({"Value": link("Ramp", "Value"), "Value_001": 0.9}),
        );
        nodes.push(anisotropy);
        let g = if varying { link("Anisotropy", "Value") } else { json!(0.9) };
        nodes.push(scatter("A", "HENYEY_GREENSTEIN", json!(1.0), g));
        nodes.push(scatter("B", "RAYLEIGH", json!(1.0), json!(null)));
        nodes.push(absorption("C", [0.0, 0.0, 0.0, 1.0], 0.5));
        let lobes = match lobes {
            [one] => link(one, "Volume"),
            _ => {
                nodes.push(add("Both", link("A", "Volume"), link("B", "Volume")));
                link("Both", "Shader")
            }
        };
        nodes.push(add("Sum", lobes, link("C", "Volume")));
        let mut scene = cube(graph(link("Sum", "Shader"), &nodes));
        scene.lights.clear();
        scene.world.color = [1.0; 3];
        bounces(&mut scene, 1);
        estimate(&scene, 3 << 11)[0]
    };
    let constant = brightness(false, &["A", "B"]);
    let varying = brightness(true, &["A", "B"]);
    meets(varying, constant.0, constant.1);
    assert_ne!(varying.0, constant.0, "the second is sampled through events that wait");
    for lobe in ["A", "B"] {
        let alone = brightness(true, &[lobe]);
        assert!((alone.0 - constant.0).abs() > 10.0 * alone.1.hypot(constant.1), "lobe {lobe} alone: {alone:?}");
    }
}

#[test]
fn sums_of_closures_meet_their_closed_form() {
    let color = [0.2_f64, 0.5, 0.8];
    let nodes = [
        node(
            "S",
            "ShaderNodeVolumeScatter",
            json!({"phase": "HENYEY_GREENSTEIN"}),
            json!({"Color": [0.2, 0.5, 0.8, 1.0], "Density": 0.9, "Anisotropy": 0.4}),
        ),
        absorption("A", [0.2, 0.5, 0.8, 1.0], 0.5),
        node(
            "C",
            "ShaderNodeVolumeCoefficients",
            json!({"phase": "HENYEY_GREENSTEIN"}),
            json!({"Scatter Coefficients": [0.1, 0.3, 0.2], "Absorption Coefficients": [0.3, 0.2, 0.1],
                "Anisotropy": 0.4}),
        ),
        add("First", link("S", "Volume"), link("A", "Volume")),
        add("Sum", link("First", "Shader"), link("C", "Volume")),
    ];
    let found = estimate(&cube(graph(link("Sum", "Shader"), &nodes)), 1 << 13);
    for channel in 0..3 {
        let scattering = 0.9 * color[channel] + [0.1, 0.3, 0.2][channel];
        let extinction = scattering + 0.5 * (1.0 - color[channel]) + [0.3, 0.2, 0.1][channel];
        let length = (1.0 - (-2.0 * extinction).exp()) / extinction;
        meets(found[channel], SUN * scattering * phase(0.4, 0.0) * (-extinction).exp() * length, 0.0);
    }
}

#[test]
fn varying_emission_meets_its_closed_form_even_without_extinction() {
    let emission = |absorbing: f32| {
        let mut nodes = ramp(0.5);
        nodes.push(node(
            "E",
            "ShaderNodeEmission",
            json!({}),
            json!({"Color": [1.0, 0.5, 0.25, 1.0], "Strength": link("Ramp", "Value")}),
        ));
        nodes.push(absorption("A", [0.0, 0.0, 0.0, 1.0], absorbing));
        nodes.push(add("Sum", link("E", "Emission"), link("A", "Volume")));
        let mut scene = cube(graph(link("Sum", "Shader"), &nodes));
        scene.lights.clear();
        scene
    };
    for absorbing in [0.0, 0.7] {
        let truth = along_the_ray(|y| 0.25 * (y + 1.0) * (-absorbing * (y + 1.0)).exp());
        let found = estimate(&emission(absorbing as f32), 1 << 11);
        for (channel, color) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            meets(found[channel], color * truth, 0.0);
        }
    }
}

/// A world that is this picture; the folder has to live as long as the scene.
fn surround(scene: &mut Scene, picture: &Image) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sky.exr");
    picture.write_exr(&path, false).expect("it is written");
    let bytes = std::fs::read(&path).expect("it is read");
    scene.world.color = [1.0; 3];
    scene.world.image = Some(WorldImage { file: "sky.exr".into(), sha256: cloudparity::base::files::sha256(&bytes) });
    scene.folder = folder.path().to_owned();
    folder
}

#[test]
fn a_white_furnace_in_a_white_picture_is_white() {
    let nodes = [
        scatter("A", "HENYEY_GREENSTEIN", json!(1.2), json!(0.7)),
        scatter("B", "RAYLEIGH", json!(0.8), json!(null)),
        add("Sum", link("A", "Volume"), link("B", "Volume")),
    ];
    let mut scene = cube(graph(link("Sum", "Shader"), &nodes));
    scene.lights.clear();
    bounces(&mut scene, 1 << 20);
    let mut picture = Image::new(8, 4);
    picture.pixels.fill([1.0; 4]);
    let _folder = surround(&mut scene, &picture);
    meets(estimate(&scene, 1 << 12)[0], 1.0, 0.0);
}

#[test]
fn single_scattering_of_a_picture_with_a_bright_pixel_meets_quadrature() {
    let density = 0.1_f64;
    let mut scene = cube(graph(link("S", "Volume"), &[scatter("S", "HENYEY_GREENSTEIN", json!(density), json!(0.5))]));
    scene.film.transparent = true;
    let mut picture = Image::new(16, 8);
    picture.pixels.fill([0.1, 0.2, 0.3, 1.0]);
    // The picture finds it, and the phase function the dim rest.
    picture.pixels[2 * 16 + 5] = [30.0, 20.0, 10.0, 1.0];
    let _folder = surround(&mut scene, &picture);
    let environment = Environment::new(&picture, 1.0).expect("a legal picture");
    // Midpoints of 256 x 512 cells of equal solid angle and 16 steps along the ray. The radiance has kinks at 16
    // columns: relative error of order (16 / 512)^2 / 12 = 8e-5 in the bright pixel; 2e-4 is allowed for all.
    let (rings, turns, steps) = (256, 512, 16);
    let mut truth = [0.0; 3];
    for ring in 0..rings {
        let z = -1.0 + 2.0 * (f64::from(ring) + 0.5) / f64::from(rings);
        for turn in 0..turns {
            let (s, c) = (TAU * (f64::from(turn) + 0.5) / f64::from(turns)).sin_cos();
            let flat = (1.0 - z * z).sqrt();
            let towards = DVec3::new(flat * c, flat * s, z);
            let lit: f64 = (0..steps)
                .map(|step| -1.0 + 2.0 * (f64::from(step) + 0.5) / f64::from(steps))
                .map(|y| {
                    let sideways = (1.0 - y * towards.y.signum()) / towards.y.abs();
                    let way = sideways.min(1.0 / towards.z.abs()).min(1.0 / towards.x.abs());
                    (-density * (y + 1.0 + way)).exp() * 2.0 / f64::from(steps)
                })
                .sum();
            let weight = lit * density * phase(0.5, towards.y) * 4.0 * PI / f64::from(rings * turns);
            for (truth, radiance) in truth.iter_mut().zip(environment.radiance(towards)) {
                *truth += radiance * weight;
            }
        }
    }
    // The sun beside it, which is chosen now and then instead.
    let sun = SUN * phase(0.5, 0.0) * (-density).exp() * (1.0 - (-2.0 * density).exp());
    for (with_sun, extra) in [(true, sun), (false, 0.0)] {
        if !with_sun {
            scene.lights.clear();
        }
        let found = estimate(&scene, 1 << 16);
        for channel in 0..3 {
            meets(found[channel], truth[channel] + extra, 2e-4 * truth[channel]);
        }
        let alpha = 1.0 - (-2.0 * density).exp();
        assert!((found[3].0 - alpha).abs() < 10.0 * ROUNDING, "alpha {} is not {alpha}", found[3].0);
    }
}

#[test]
fn a_mesh_and_a_phase_function_that_is_no_number_are_refused() {
    let refused = |scene: &Scene| {
        let settings = PathSettings { samples: 1, ..PathSettings::default() };
        path::render(scene, &settings, Backend::Cpu, None, &|_, _| {}).expect_err("it is refused").to_string()
    };
    let mut scene = homogeneous();
    scene.volume.shape =
        serde_json::from_value(json!({"type": "mesh", "vertices": [], "triangles": []})).expect("a shape");
    assert!(refused(&scene).contains("mesh"));
    // The difference of two infinities, which the ramp keeps from being folded.
    let mut nodes = ramp(1.0);
    nodes.push(node(
        "Infinite",
        "ShaderNodeMath",
        json!({"operation": "MULTIPLY", "use_clamp": false}),
        json!({"Value": 1e38, "Value_001": link("Ramp", "Value")}),
    ));
    nodes.push(node(
        "Huge",
        "ShaderNodeMath",
        json!({"operation": "MULTIPLY", "use_clamp": false}),
        json!({"Value": 1e38, "Value_001": link("Infinite", "Value")}),
    ));
    nodes.push(node(
        "Lost",
        "ShaderNodeMath",
        json!({"operation": "SUBTRACT", "use_clamp": false}),
        json!({"Value": link("Huge", "Value"), "Value_001": link("Huge", "Value")}),
    ));
    nodes.push(scatter("S", "HENYEY_GREENSTEIN", json!(1.0), link("Lost", "Value")));
    let scene = cube(graph(link("S", "Volume"), &nodes));
    let error = refused(&scene);
    assert!(error.contains("phase function") && error.contains("position"), "{error}");
}

#[test]
fn the_adapter_refuses_what_it_does_not_know() {
    if !support::require("vulkan") {
        return;
    }
    let refused = |scene: &Scene| {
        let settings = PathSettings { samples: 1, ..PathSettings::default() };
        let error = path::render(scene, &settings, Backend::Gpu, None, &|_, _| {}).expect_err("it is refused");
        assert_eq!(error.settings, ["backend"], "{error}");
    };
    let simple = || graph(link("S", "Volume"), &[scatter("S", "HENYEY_GREENSTEIN", json!(0.5), json!(0.6))]);
    refused(&with_second(cube(simple()), simple(), 1.0, 0.0, 0.0));
    refused(&cube(graph(link("S", "Volume"), &[scatter("S", "RAYLEIGH", json!(0.5), json!(null))])));
    let mut scene = cube(simple());
    let mut picture = Image::new(8, 4);
    picture.pixels.fill([1.0; 4]);
    let _folder = surround(&mut scene, &picture);
    refused(&scene);
}
