//! Light transport against closed forms: cube of edge 2, one central ray, single scattering.

mod support;

use cloudparity::bridge::reference::{ReferenceSettings, reference};
use cloudparity::gpu::Backend;
use cloudparity::integrators;
use cloudparity::integrators::{LightMode, MarchSettings};
use cloudparity::scene::image::Image;
use cloudparity::scene::{Input, Scene};
use serde_json::json;
use std::f64::consts::PI;
use support::cube::{SCATTERING, SUN, color, exact, homogeneous, phase, ramp, set, slanted_sun, sphere};

/// The steps below are fine enough that the closed form is met to this: the midpoint rule errs by
/// (step / 2)^2 / 6 of second derivatives of order 1, and f32 results by 6e-8.
const TOLERANCE: f64 = 1e-4;

fn render(scene: &Scene, settings: &MarchSettings) -> [f64; 4] {
    let image = integrators::render(scene, settings, Backend::Cpu, &|_, _| {}).expect("the scene renders");
    image.mean()
}

#[track_caller]
fn close(found: f64, expected: f64, tolerance: f64) {
    let error = (found / expected - 1.0).abs();
    assert!(error <= tolerance, "{found} is not {expected}: relative error {error:e}");
}

#[test]
fn an_absorbing_cube_follows_beer_lambert_and_alpha_is_what_is_lost() {
    let mut scene = homogeneous();
    scene.world.color = [1.0, 0.5, 0.25];
    scene.lights.clear();
    set(&mut scene, "Color", color([0.0; 3]));
    for light in [LightMode::Exact, LightMode::Grid] {
        let settings = MarchSettings { light, ..exact() };
        scene.film.transparent = false;
        let found = render(&scene, &settings);
        for (channel, world) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            close(found[channel], world * (-2.0_f64).exp(), 1e-6);
        }
        assert_eq!(found[3], 1.0);
        scene.film.transparent = true;
        let found = render(&scene, &settings);
        assert_eq!(found[..3], [0.0; 3]);
        close(found[3], 1.0 - (-2.0_f64).exp(), 1e-6);
    }
}

#[test]
fn alpha_is_one_minus_the_mean_transmittance_of_the_channels() {
    let mut scene = homogeneous();
    scene.film.transparent = true;
    scene.lights.clear();
    let [color_value, absorption] = [[0.2_f32, 0.5, 0.8], [0.1_f32, 0.3, 0.7]];
    set(&mut scene, "Color", color(color_value));
    set(&mut scene, "Absorption Color", color(absorption));
    let transmittance = |c: f32, a: f32| {
        let extinction = f64::from(c) + (1.0 - f64::from(c)) * (1.0 - f64::from(a).sqrt());
        (-2.0 * extinction).exp()
    };
    let mean = (0..3).map(|channel| transmittance(color_value[channel], absorption[channel])).sum::<f64>() / 3.0;
    close(render(&scene, &exact())[3], 1.0 - mean, 1e-6);
}

#[test]
fn single_scattering_of_a_sun_from_above_meets_its_closed_form() {
    for anisotropy in [0.0, 0.6, -0.3] {
        let mut scene = homogeneous();
        set(&mut scene, "Anisotropy", Input::Number(anisotropy as f32));
        let common = SUN * phase(anisotropy, 0.0) * (-1.0_f64).exp() * (1.0 - (-2.0_f64).exp());
        for (light, tolerance) in [(LightMode::Exact, TOLERANCE), (LightMode::Grid, TOLERANCE)] {
            let found = render(&scene, &MarchSettings { light, ..exact() });
            for channel in 0..3 {
                close(found[channel], SCATTERING[channel] * common, tolerance);
            }
        }
    }
}

#[test]
fn single_scattering_of_a_slanted_sun_meets_its_closed_form() {
    let root = 2.0_f64.sqrt();
    let path =
        (-root).exp() * (1.0 - (-1.0_f64).exp()) + (-1.0 - root).exp() * ((root - 1.0).exp() - 1.0) / (root - 1.0);
    for anisotropy in [0.0, 0.6, -0.3] {
        let mut scene = homogeneous();
        slanted_sun(&mut scene);
        set(&mut scene, "Anisotropy", Input::Number(anisotropy as f32));
        let common = SUN * phase(anisotropy, 1.0 / root) * path;
        // The grid smooths the kink at the cube's edge over a cell of 2/128.
        for (light, tolerance) in [(LightMode::Exact, TOLERANCE), (LightMode::Grid, 1e-3)] {
            let found = render(&scene, &MarchSettings { light, ..exact() });
            for channel in 0..3 {
                close(found[channel], SCATTERING[channel] * common, tolerance);
            }
        }
    }
}

#[test]
fn a_planted_difference_of_a_percent_of_density_is_seen() {
    let mut scene = homogeneous();
    set(&mut scene, "Density", Input::Number(1.01));
    let found = render(&scene, &exact());
    let expected = SCATTERING[0] * SUN * phase(0.0, 0.0) * (-1.0_f64).exp() * (1.0 - (-2.0_f64).exp());
    let error = (found[0] / expected - 1.0).abs();
    assert!(error > 10.0 * TOLERANCE, "one percent of density went unseen: {error:e}");
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
        let found = render(&scene, &exact());
        close(found[0], expected, 1e-6);
        assert!((found[3] - (1.0 - (-2.0 * density).exp())).abs() < 1e-6, "emission adds no alpha: {}", found[3]);
    }
}

#[test]
fn ramps_of_density_meet_their_closed_forms() {
    // E1, E2: along the view, absorbing; E3: towards the sun; E4: along the view, scattering.
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 2.0);
    set(&mut scene, "Color", color([0.0; 3]));
    scene.world.color = [1.0; 3];
    close(render(&scene, &exact())[0], (-2.0_f64).exp(), TOLERANCE);
    let sphere = 4.0 * PI;
    let mut scene = homogeneous();
    ramp(&mut scene, "Z", 2.0);
    set(&mut scene, "Color", color([1.0; 3]));
    for light in [LightMode::Exact, LightMode::Grid] {
        let found = render(&scene, &MarchSettings { light, ..exact() });
        close(found[0], SUN / sphere * (-1.5_f64).exp() * (1.0 - (-2.0_f64).exp()), TOLERANCE);
    }
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 4.0);
    set(&mut scene, "Color", color([1.0; 3]));
    let found = render(&scene, &MarchSettings { view_step: 0.004, ..exact() });
    let steps = 200_000;
    let width = 2.0 / f64::from(steps);
    let integral: f64 = (0..steps)
        .map(|step| (f64::from(step) + 0.5) * width)
        .map(|t| 2.0 * t * (-2.0 * t).exp() * (-t * t).exp() * width)
        .sum();
    close(found[0], SUN / sphere * integral, TOLERANCE);
}

#[test]
fn every_channel_follows_beer_lambert_with_its_own_extinction_and_emission_behind_it() {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.world.color = [1.0, 0.5, 0.25];
    let [color_value, absorption] = [[0.2_f32, 0.5, 0.8], [0.1_f32, 0.3, 0.7]];
    set(&mut scene, "Color", color(color_value));
    set(&mut scene, "Absorption Color", color(absorption));
    set(&mut scene, "Emission Strength", Input::Number(0.5));
    let extinction_of = |c: f32, a: f32| f64::from(c) + (1.0 - f64::from(c)) * (1.0 - f64::from(a).sqrt());
    // Before a black world nothing is there to be scattered.
    let mut black = scene.clone();
    black.world.color = [0.0; 3];
    for specialise in [true, false] {
        let found = render(&black, &MarchSettings { specialise, ..exact() });
        for channel in 0..3 {
            let extinction = extinction_of(color_value[channel], absorption[channel]);
            close(found[channel], 0.5 * (1.0 - (-2.0 * extinction).exp()) / extinction, 1e-6);
        }
    }
    // Absorption alone has one extinction per channel through the absorption colour.
    set(&mut scene, "Color", color([0.0; 3]));
    for specialise in [true, false] {
        let found = render(&scene, &MarchSettings { specialise, ..exact() });
        for (channel, world) in [1.0, 0.5, 0.25].into_iter().enumerate() {
            let extinction = extinction_of(0.0, absorption[channel]);
            let through = (-2.0 * extinction).exp();
            close(found[channel], world * through + 0.5 * (1.0 - through) / extinction, 1e-6);
        }
    }
}

#[test]
fn an_emission_that_is_the_density_meets_its_closed_form() {
    // E2: density and emission t along the view, absorbing only; then the same with an Emission node.
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 2.0);
    set(&mut scene, "Color", color([0.0; 3]));
    let slope = json!({"node": "Slope", "socket": "Value"});
    let mut separate = scene.clone();
    set(&mut scene, "Emission Strength", Input::Link { node: "Slope".into(), socket: "Value".into() });
    let expected = 1.0 - (-2.0_f64).exp();
    close(render(&scene, &exact())[0], expected, TOLERANCE);
    let nodes = json!([
        {"name": "Glow", "type": "ShaderNodeEmission", "inputs": {"Color": [1.0, 0.5, 0.25, 1.0], "Strength": slope}},
        {"name": "Add", "type": "ShaderNodeAddShader", "inputs": {
            "Shader": {"node": "Principled Volume", "socket": "Volume"}, "Shader_001": {"node": "Glow", "socket": "Emission"}}},
    ]);
    close_with(&mut separate, nodes);
    let found = render(&separate, &exact());
    for (channel, share) in [1.0, 0.5, 0.25].into_iter().enumerate() {
        close(found[channel], share * expected, TOLERANCE);
    }
    if support::require("vulkan") {
        let settings = MarchSettings { light: LightMode::Grid, ..exact() };
        let theirs =
            integrators::render(&scene, &settings, Backend::Gpu, &|_, _| {}).expect("the scene renders").mean();
        close(theirs[0], expected, TOLERANCE);
    }
}

#[test]
fn a_sphere_of_constant_density_meets_its_closed_forms() {
    let (radius, density) = (0.7_f64, 3.0_f64);
    let mut scene = homogeneous();
    sphere(&mut scene);
    scene.film.resolution = [1, 1];
    set(&mut scene, "Color", color([1.0; 3]));
    // Steps of 0.05 / 50 along the view: the sphere begins 0.05 behind the provably empty part, so that no step
    // holds its face. A shadow ray's depth is off by up to half a step of 1e-4 of density 3, in either
    // direction: 1.5e-4 at worst, far less in the mean over 1,400 samples.
    let settings = MarchSettings { view_step: 0.001, shadow_step: 1e-4, ..exact() };
    let steps = 400_000;
    let width = 2.0 * radius / f64::from(steps);
    let integral: f64 = (0..steps)
        .map(|step| -radius + (f64::from(step) + 0.5) * width)
        .map(|y| {
            let up = (radius * radius - y * y).sqrt();
            density * (-density * (y + radius)).exp() * (-density * up).exp() * width
        })
        .sum();
    close(integral * SUN / (4.0 * PI), 0.217395, 5e-6);
    close(render(&scene, &settings)[0], integral * SUN / (4.0 * PI), TOLERANCE);
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    set(&mut scene, "Color", color([0.0; 3]));
    close(render(&scene, &settings)[0], (-2.0 * radius * density).exp(), TOLERANCE);
}

#[test]
fn coefficients_are_per_world_metre_whatever_the_scale_of_the_object() {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    set(&mut scene, "Color", color([0.0; 3]));
    scene.volume.matrix_world =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    close(render(&scene, &exact())[0], (-4.0_f64).exp(), 1e-6);
}

#[test]
fn the_world_lights_an_anisotropic_medium_alike_in_both_modes() {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.film.transparent = true;
    scene.world.color = [1.0; 3];
    for (anisotropy, tolerance) in [(0.0, 1e-2), (0.6, 2e-2)] {
        set(&mut scene, "Anisotropy", Input::Number(anisotropy));
        let coarse = MarchSettings { view_step: 0.1, shadow_step: 0.1, world_directions: 256, ..exact() };
        let exact = render(&scene, &coarse);
        let grid = render(&scene, &MarchSettings { light: LightMode::Grid, grid_cells: 32, ..coarse });
        // Cells of 2/32 at the faces, and at g = 0.6 the harmonics beyond band 2 (g^3 = 0.2 of a band
        // that the transmittance of a convex body hardly has).
        close(grid[0], exact[0], tolerance);
    }
}

#[test]
fn what_march_cannot_do_is_an_error_that_says_so() {
    let refused = |scene: &Scene| {
        integrators::render(scene, &exact(), Backend::Cpu, &|_, _| {}).expect_err("it is refused").to_string()
    };
    let mut scene = homogeneous();
    scene.integrator.volume_bounces = 3;
    assert!(refused(&scene).contains("single scattering"));
    let mut scene = homogeneous();
    ramp(&mut scene, "Y", 1.0);
    set(&mut scene, "Anisotropy", Input::Link { node: "Slope".into(), socket: "Value".into() });
    assert!(refused(&scene).contains("Anisotropy"));
    let mut scene = homogeneous();
    scene.volume.shape = cloudparity::scene::Shape::Mesh { vertices: Vec::new(), triangles: Vec::new() };
    assert!(refused(&scene).contains("mesh"));
    let mut scene = homogeneous();
    let second = cloudparity::scene::Volume { object: "Second".into(), ..scene.volume.clone() };
    scene.other_volumes.push(second);
    assert!(refused(&scene).contains("a second volume object"));
    let mut scene = homogeneous();
    scene.world.image = Some(cloudparity::scene::WorldImage { file: "sky.exr".into(), sha256: String::new() });
    assert!(refused(&scene).contains("sky.exr"));
    let mut scene = homogeneous();
    close_with_two_lobes(&mut scene);
    assert!(refused(&scene).contains("another phase function"));
}

/// Adds nodes, of which the Add Shader called "Add" closes the graph.
fn close_with(scene: &mut Scene, nodes: serde_json::Value) {
    let nodes: Vec<cloudparity::scene::Node> = serde_json::from_value(nodes).expect("the nodes are well formed");
    let graph = &mut scene.graph_mut().nodes;
    graph.extend(nodes);
    let output = graph.iter_mut().find(|node| node.kind == "ShaderNodeOutputMaterial").expect("the scene has one");
    output.inputs.insert("Volume".into(), Input::Link { node: "Add".into(), socket: "Shader".into() });
}

/// The closure of the scene plus Rayleigh scattering.
fn close_with_two_lobes(scene: &mut Scene) {
    let nodes = json!([
        {"name": "Scatter", "type": "ShaderNodeVolumeScatter", "properties": {"phase": "RAYLEIGH"}, "inputs": {}},
        {"name": "Add", "type": "ShaderNodeAddShader", "inputs": {
            "Shader": {"node": "Principled Volume", "socket": "Volume"},
            "Shader_001": {"node": "Scatter", "socket": "Volume"}}},
    ]);
    close_with(scene, nodes);
}

#[test]
fn march_knows_closures_that_share_their_density() {
    // A cube of Volume Scatter and Volume Absorption is the Principled Volume of the same coefficients.
    let mut principled = homogeneous();
    ramp(&mut principled, "Y", 2.0);
    set(&mut principled, "Anisotropy", Input::Number(0.4));
    let expected = render(&principled, &exact());
    let mut scene = principled.clone();
    let slope = json!({"node": "Slope", "socket": "Value"});
    let [r, g, b] = SCATTERING;
    let nodes = json!([
        {"name": "Scatter", "type": "ShaderNodeVolumeScatter", "properties": {"phase": "HENYEY_GREENSTEIN"},
         "inputs": {"Color": [r, g, b, 1.0], "Density": slope, "Anisotropy": 0.4}},
        {"name": "Absorption", "type": "ShaderNodeVolumeAbsorption",
         "inputs": {"Color": [r, g, b, 1.0], "Density": slope}},
        {"name": "Add", "type": "ShaderNodeAddShader", "inputs": {
            "Shader": {"node": "Scatter", "socket": "Volume"}, "Shader_001": {"node": "Absorption", "socket": "Volume"}}},
    ]);
    close_with(&mut scene, nodes);
    let found = render(&scene, &exact());
    for channel in 0..3 {
        // The same sums of f32 constants in another order.
        close(found[channel], expected[channel], 1e-6);
    }
}

#[test]
fn a_medium_across_the_far_clip_is_left_out_and_the_near_clip_cuts_it() {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    set(&mut scene, "Color", color([0.0; 3]));
    scene.camera.clip_end = 5.0;
    close(render(&scene, &exact())[0], 1.0, 1e-6);
    scene.camera.clip_end = 100.0;
    scene.camera.clip_start = 4.5;
    close(render(&scene, &exact())[0], (-1.5_f64).exp(), 1e-6);
}

#[test]
fn the_adapter_renders_the_cloud_as_the_cpu_does() {
    if !support::require("vulkan") {
        return;
    }
    let mut scene = support::scene("procedural-clouds");
    scene.film.resolution = [64, 36];
    let settings = MarchSettings { grid_cells: 48, sub_pixels: 2, world_directions: 16, ..MarchSettings::default() };
    let picture = |scene: &Scene, backend| {
        integrators::render(scene, &settings, backend, &|_, _| {}).expect("the scene renders").pixels
    };
    let ours = picture(&scene, Backend::Gpu);
    let twin = picture(&scene, Backend::Cpu);
    let brightest = twin.iter().flatten().copied().fold(0.0_f32, f32::max);
    // A ray adds up 200 steps in f32: 200 roundings of 6e-8 are 1.2e-5 at worst, and the adapter's
    // exp errs by a few ulps more.
    let tolerance = 5e-5 * brightest;
    for (index, (ours, twin)) in ours.iter().zip(&twin).enumerate() {
        for channel in 0..4 {
            let error = (ours[channel] - twin[channel]).abs();
            assert!(error <= tolerance, "pixel {index}: {ours:?} is not {twin:?}");
        }
    }
    // Software adapters end the loops of an invocation after 65,535 iterations; fine steps go far beyond.
    let mut few = scene.clone();
    few.film.resolution = [6, 4];
    let fine = MarchSettings { view_step: 0.002, sub_pixels: 1, ..settings.clone() };
    let mean = |backend| integrators::render(&few, &fine, backend, &|_, _| {}).expect("the scene renders").mean();
    let (on_adapter, on_cpu) = (mean(Backend::Gpu), mean(Backend::Cpu));
    // 2,000 steps in f32: ten times the roundings of above.
    assert!(
        on_adapter.iter().zip(on_cpu).all(|(ours, twin)| (ours - twin).abs() <= 5e-4 * twin),
        "{on_adapter:?} {on_cpu:?}"
    );
    // A tenth of a percent more sun has to be seen.
    scene.lights[0].strength *= 1.001;
    let planted = picture(&scene, Backend::Cpu);
    assert!(planted.iter().flatten().zip(ours.iter().flatten()).any(|(a, b)| (a - b).abs() > tolerance));
}

#[test]
fn cycles_agrees_with_march_on_the_homogeneous_cube_and_renders_it_once() {
    if !support::require("bpy") {
        return;
    }
    let mut scene = homogeneous();
    scene.film.resolution = [8, 8];
    let cache = tempfile::tempdir().expect("a folder");
    let settings = ReferenceSettings { samples: 16, ..ReferenceSettings::default() };
    let ask = |scene: &Scene| reference(scene, &settings, cache.path(), |_| {}).expect("Cycles renders");
    let first = ask(&scene);
    assert!(!first.cached);
    let again = ask(&scene);
    assert!(again.cached && again.path == first.path);
    let picture = Image::read_exr(&first.path).expect("the reference is an image");
    assert_eq!(picture.provenance["scene_sha256"], scene.content_hash());
    let ours = render(&scene, &exact());
    let theirs = picture.mean();
    for channel in 0..3 {
        // Light from above travels one unit to every point of the central ray: Cycles' estimator has
        // no noise here, so only the steps of ours are left.
        close(ours[channel], theirs[channel], TOLERANCE);
    }
    set(&mut scene, "Density", Input::Number(1.01));
    let planted = Image::read_exr(&ask(&scene).path).expect("the reference is an image").mean();
    assert!((planted[0] / ours[0] - 1.0).abs() > 10.0 * TOLERANCE, "one percent of density went unseen");
}
