//! Worlds of nodes: what they send, how they light a medium, and what is wrong with others.

mod support;

use cloudparity::gpu::Backend;
use cloudparity::graph::world::WorldValues;
use cloudparity::integrators;
use cloudparity::integrators::MarchSettings;
use cloudparity::integrators::path;
use cloudparity::integrators::path::PathSettings;
use cloudparity::scene::{Graph, Scene};
use cloudparity::view::environment::Environment;
use glam::DVec3;
use serde_json::{Value as Json, json};
use std::f64::consts::PI;
use support::cube::{color, homogeneous, set};

fn node(name: &str, kind: &str, properties: Json, inputs: Json) -> Json {
    json!({"name": name, "type": format!("ShaderNode{kind}"), "properties": properties, "inputs": inputs})
}

fn link(node: &str, socket: &str) -> Json {
    json!({"node": node, "socket": socket})
}

/// A world whose Background "B" is at Surface.
fn world(nodes: &[Json]) -> Graph {
    let output = node("World Output", "OutputWorld", json!({}), json!({"Surface": link("B", "Background")}));
    let nodes: Vec<Json> = nodes.iter().cloned().chain([output]).collect();
    serde_json::from_value(json!({"material": "World", "nodes": nodes, "groups": []})).expect("well formed")
}

/// Radiance (strength x, 2 strength x, 3 strength x) where x is above 0, by Generated.
fn half_lit() -> Graph {
    world(&[
        node("Seen", "TexCoord", json!({}), json!({})),
        node("Parts", "SeparateXYZ", json!({}), json!({"Vector": link("Seen", "Generated")})),
        node("Above", "Math", json!({"operation": "MAXIMUM"}), json!({"Value": link("Parts", "X"), "Value_001": 0.0})),
        node(
            "Color",
            "CombineXYZ",
            json!({}),
            json!({
            "X": link("Above", "Value"), "Y": link("Twice", "Value"), "Z": link("Thrice", "Value")}),
        ),
        node(
            "Twice",
            "Math",
            json!({"operation": "MULTIPLY"}),
            json!({"Value": link("Above", "Value"), "Value_001": 2.0}),
        ),
        node(
            "Thrice",
            "Math",
            json!({"operation": "MULTIPLY"}),
            json!({"Value": link("Above", "Value"), "Value_001": 3.0}),
        ),
        node("B", "Background", json!({}), json!({"Color": link("Color", "Vector"), "Strength": 4.0})),
    ])
}

fn lit_by(graph: Graph) -> Scene {
    let mut scene = homogeneous();
    scene.lights.clear();
    scene.world.color = [1.0; 3];
    scene.world.strength = 1.0;
    scene.world.graph = Some(graph);
    scene
}

fn seen(graph: &Graph, direction: [f64; 3]) -> [f64; 3] {
    let mut found = [f64::NAN; 3];
    let values = WorldValues::compile(graph).expect("it compiles");
    values.radiance(&[DVec3::from(direction)], |_, radiance| found = radiance);
    found
}

#[test]
fn coordinates_of_a_world_are_those_of_cycles() {
    // Measured in Blender 5.0.1: the direction, its negative, and 0.
    let outputs = [
        ("TexCoord", "Generated", 1.0),
        ("TexCoord", "Object", 1.0),
        ("TexCoord", "Normal", -1.0),
        ("TexCoord", "Reflection", -1.0),
        ("TexCoord", "UV", 0.0),
        ("NewGeometry", "Position", 1.0),
        ("NewGeometry", "Normal", -1.0),
        ("NewGeometry", "True Normal", -1.0),
        ("NewGeometry", "Incoming", -1.0),
    ];
    for (kind, output, factor) in outputs {
        let graph = world(&[
            node("N", kind, json!({}), json!({})),
            node("B", "Background", json!({}), json!({"Color": link("N", output), "Strength": 1.0})),
        ]);
        let found = seen(&graph, [0.6, 0.0, -0.8]);
        assert_eq!(found, [0.6, 0.0, -0.8].map(|value| f64::from(value as f32) * factor), "{kind} {output}");
    }
}

#[test]
fn mixes_weigh_by_their_clamped_factor_and_sums_add() {
    let background = |name: &str, strength: f64| {
        node(name, "Background", json!({}), json!({"Color": [1.0, 0.5, 0.25, 1.0], "Strength": strength}))
    };
    let seen_with = |factor: f64| {
        let factor = json!({"Value": link("Parts", "X"), "Value_001": factor});
        let nodes = [
            background("First", 8.0),
            background("Second", -2.0),
            background("Third", 1.0),
            node("Seen", "TexCoord", json!({}), json!({})),
            node("Parts", "SeparateXYZ", json!({}), json!({"Vector": link("Seen", "Generated")})),
            node("Fac", "Math", json!({"operation": "ADD"}), factor),
            node(
                "Mix",
                "MixShader",
                json!({}),
                json!({
                "Fac": link("Fac", "Value"),
                "Shader": link("First", "Background"), "Shader_001": link("Second", "Background")}),
            ),
            node(
                "Sum",
                "AddShader",
                json!({}),
                json!({
                "Shader": link("Mix", "Shader"), "Shader_001": link("Third", "Background")}),
            ),
            node("World Output", "OutputWorld", json!({}), json!({"Surface": link("Sum", "Shader")})),
        ];
        let graph = json!({"material": "World", "nodes": nodes, "groups": []});
        seen(&serde_json::from_value(graph).expect("well formed"), [0.0, 1.0, 0.0])[0]
    };
    for (factor, expected) in [(0.25, 0.75 * 8.0 - 0.25 * 2.0 + 1.0), (-1.0, 9.0), (3.0, -1.0)] {
        assert_eq!(seen_with(factor), expected);
    }
}

#[test]
fn what_is_no_number_counts_as_nothing() {
    let graph = world(&[
        node("Seen", "TexCoord", json!({}), json!({})),
        node("Parts", "SeparateXYZ", json!({}), json!({"Vector": link("Seen", "Generated")})),
        node(
            "Big",
            "Math",
            json!({"operation": "MULTIPLY"}),
            json!({"Value": link("Parts", "X"), "Value_001": 1000.0}),
        ),
        node("Exp", "Math", json!({"operation": "EXPONENT"}), json!({"Value": link("Big", "Value")})),
        node("B", "Background", json!({}), json!({"Color": [1.0, 1.0, 1.0, 1.0], "Strength": link("Exp", "Value")})),
    ]);
    assert_eq!(seen(&graph, [1.0, 0.0, 0.0]), [0.0; 3]);
    assert_eq!(seen(&graph, [0.0, 1.0, 0.0]), [1.0; 3]);
}

#[test]
fn the_table_of_a_graph_has_its_mean_and_samples_it() {
    let scene = lit_by(half_lit());
    let environment = Environment::load(&scene).expect("it compiles").expect("there is one");
    // The mean of max(x, 0) over the sphere is 1/4; midpoints of 4096 x 2048 places err by (2 pi / 4096)^2 / 24.
    for (channel, mean) in environment.mean_radiance().into_iter().enumerate() {
        assert!((mean - 4.0 * (channel + 1) as f64 / 4.0).abs() < 1e-4, "{mean}");
    }
    let side = 256;
    let mut sum = [0.0; 3];
    for index in 0..side * side {
        let uniform = [index / side, index % side].map(|place| (f64::from(place) + 0.5) / f64::from(side));
        let (direction, density) = environment.sample(uniform).expect("it is not black");
        for (sum, radiance) in sum.iter_mut().zip(environment.radiance(direction)) {
            *sum += radiance / density / f64::from(side * side);
        }
    }
    // The integral is pi times the factors. A cell of the table is as bright as its middle to 1 part in 170 on average; 65536
    // places even that out.
    for (channel, sum) in sum.into_iter().enumerate() {
        let truth = 4.0 * (channel + 1) as f64 * PI;
        assert!((sum / truth - 1.0).abs() < 1e-3, "{sum} is not {truth}");
    }
}

/// Means of replicas and the largest standard error among channels, relative to the mean.
fn rendered(scene: &Scene, samples: u32, backend: Backend, first: u32) -> ([f64; 3], f64) {
    let settings = PathSettings { samples, ..PathSettings::default() };
    let seeds: Vec<u32> = (first..first + 8).collect();
    let images = path::render_replicas(scene, &settings, backend, &seeds, &|_, _| {}).expect("it renders");
    let means: Vec<[f64; 4]> = images.iter().map(cloudparity::scene::image::Image::mean).collect();
    let count = means.len() as f64;
    let mut largest = 0.0_f64;
    let mean = std::array::from_fn(|channel| {
        let mean = means.iter().map(|mean| mean[channel]).sum::<f64>() / count;
        let square = means.iter().map(|found| (found[channel] - mean).powi(2)).sum::<f64>() / (count - 1.0);
        largest = largest.max((square / count).sqrt() / mean.abs().max(1e-30));
        mean
    });
    (mean, largest)
}

#[test]
fn a_white_furnace_in_a_world_of_nodes_is_white() {
    // One everywhere, but not for the compiler.
    let graph = world(&[
        node("Seen", "TexCoord", json!({}), json!({})),
        node("Length", "VectorMath", json!({"operation": "LENGTH"}), json!({"Vector": link("Seen", "Generated")})),
        node("Near", "Math", json!({"operation": "ROUND"}), json!({"Value": link("Length", "Value")})),
        node("B", "Background", json!({}), json!({"Color": link("Near", "Value"), "Strength": 1.0})),
    ]);
    let mut scene = lit_by(graph);
    set(&mut scene, "Color", color([1.0; 3]));
    scene.integrator.volume_bounces = 1 << 20;
    scene.integrator.max_bounces = 1 << 20;
    let (mean, error) = rendered(&scene, 256, Backend::Cpu, 1);
    for mean in mean {
        assert!((mean - 1.0).abs() < 5.0 * error + 1e-6, "{mean} +- {error}");
    }
    assert!(error < 0.01, "{error}: too noisy to tell");
}

#[test]
fn the_adapter_expects_what_the_cpu_expects_of_a_world_of_nodes() {
    if !support::require("vulkan") {
        return;
    }
    let mut scene = lit_by(half_lit());
    scene.film.resolution = [32, 32];
    scene.integrator.volume_bounces = 2;
    scene.integrator.max_bounces = 12;
    let (ours, error) = rendered(&scene, 64, Backend::Gpu, 500);
    let (theirs, other) = rendered(&scene, 64, Backend::Cpu, 100);
    for channel in 0..3 {
        let error = theirs[channel] * error.hypot(other).hypot(1e-5);
        assert!((ours[channel] - theirs[channel]).abs() < 5.5 * error, "{ours:?} is not {theirs:?} +- {error}");
        assert!(error < 0.01 * theirs[channel], "{error}: too noisy to tell");
    }
}

#[test]
fn a_scene_with_a_world_of_nodes_is_read_as_it_is_written() {
    let scene = lit_by(half_lit());
    let text = serde_json::to_value(&scene).expect("it serialises");
    let again = Scene::from_value(text, "again").expect("it is legal");
    assert_eq!(again.content_hash(), {
        let mut placed = scene.clone();
        // A node without a place gets one.
        placed.world.graph.clone_from(&again.world.graph);
        placed.content_hash()
    });
    let mut other = lit_by(half_lit());
    other.world.graph.as_mut().expect("there is one").nodes[2].properties["operation"] = json!("MINIMUM");
    assert_ne!(other.content_hash(), scene.content_hash());
}

#[test]
fn worlds_that_are_none_are_rejected_by_name() {
    let rejected = |change: fn(&mut Scene)| {
        let mut scene = lit_by(half_lit());
        change(&mut scene);
        let text = serde_json::to_value(&scene).expect("it serialises");
        Scene::from_value(text, "scene").expect_err("it is rejected").to_string()
    };
    let text = rejected(|scene| scene.world.strength = 2.0);
    assert!(text.contains("$.world.color") && text.contains("strength 2"), "{text}");
    let text = rejected(|scene| {
        scene.world.image = Some(cloudparity::scene::WorldImage { file: "a.exr".into(), sha256: String::new() });
    });
    assert!(text.contains("a picture and a node graph"), "{text}");
    let text = rejected(|scene| {
        let graph = scene.world.graph.as_mut().expect("there is one");
        let first = graph.nodes[0].clone();
        graph.nodes.push(first);
    });
    assert!(text.contains("$.world.graph"), "{text}");
    // What only compiling finds.
    let compiled = |graph: &Graph| WorldValues::compile(graph).expect_err("it is rejected").to_string();
    let mut graph = half_lit();
    graph.nodes.retain(|node| node.kind != "ShaderNodeOutputWorld");
    assert!(compiled(&graph).contains("no World Output"));
    let fills = node("B", "VolumeScatter", json!({}), json!({}));
    let text = compiled(&world(&[fills]));
    assert!(text.contains("world World: node B") && text.contains("fills a volume"), "{text}");
    let text = compiled(&world(&[
        node("P", "LightPath", json!({}), json!({})),
        node("B", "Background", json!({}), json!({"Strength": link("P", "Is Camera Ray")})),
    ]));
    assert!(text.contains("world World: node P"), "{text}");
    let march = integrators::render(&lit_by(half_lit()), &MarchSettings::default(), Backend::Cpu, &|_, _| {});
    let error = march.expect_err("march knows none");
    assert!(error.to_string().contains("$.world.graph"), "{error}");
}
