//! Planted differences: each comparison must fail when one thing is changed, and pass before.

mod support;

use assert_cmd::Command;
use cloudparity::graph::Program;
use cloudparity::graph::evaluate::Points;
use cloudparity::measure::errors::values::Comparison;
use cloudparity::scene::{Input, Scene};
use std::path::Path;
use support::require;

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_cloudparity"))
}

/// Every number that a node of the cloud stores in an input, by group (none: the material), node and socket.
fn constants(scene: &Scene) -> Vec<(Option<usize>, usize, String)> {
    let graph = scene.graph();
    let trees = std::iter::once((None, &graph.nodes))
        .chain(graph.groups.iter().enumerate().map(|(number, group)| (Some(number), &group.nodes)));
    trees
        .flat_map(|(group, nodes)| {
            nodes.iter().enumerate().flat_map(move |(node, found)| {
                let numbers = found.inputs.iter().filter(|(_, input)| matches!(input, Input::Number(_)));
                numbers.map(move |(socket, _)| (group, node, socket.clone()))
            })
        })
        .collect()
}

fn density(scene: &Scene, positions: &[[f32; 3]]) -> Vec<f32> {
    let program = Program::density(scene).expect("the cloud compiles");
    program.evaluate_single(Points::new(positions)).expect("values")
}

#[test]
fn one_constant_of_one_node_changes_the_field() {
    let scene = support::scene("procedural-clouds");
    // Through the dense part, so that no clamp hides what stands before it.
    let positions: Vec<[f32; 3]> = (0..400).map(|index| [index as f32 / 200.0 - 1.0, 0.3, 0.02]).collect();
    let reference = density(&scene, &positions);
    let compare = |ours: &[f32]| {
        let figures = Comparison::new(&positions, ours, &reference).expect("as many values").figures(Some(0.0));
        (figures.agrees(), figures.differing)
    };
    assert_eq!(compare(&density(&scene, &positions)), (Some(true), 0));
    let mut seen = Vec::new();
    let mut unseen = Vec::new();
    for (group, node, socket) in constants(&scene) {
        let mut planted = scene.clone();
        let graph = planted.graph_mut();
        let nodes = match group {
            Some(group) => &mut graph.groups[group].nodes,
            None => &mut graph.nodes,
        };
        let name = format!("{}.{socket}", nodes[node].name);
        let Some(Input::Number(value)) = nodes[node].inputs.get_mut(&socket) else { unreachable!("listed above") };
        *value += 0.01;
        match compare(&density(&planted, &positions)) {
            (Some(false), 1..) => seen.push(name),
            (Some(true), 0) => unseen.push(name),
            other => panic!("{name}: the verdict contradicts the count: {other:?}"),
        }
    }
    // Some constants have no influence: inputs of unread nodes and of the closure, a factor on zero.
    for name in ["Group.001.Socket_23", "Group.001.Socket_2", "Math.006.Value_001", "Voronoi Texture.004.Lacunarity"] {
        assert!(seen.iter().any(|seen| seen == name), "{name} is not seen; seen: {seen:?}; unseen: {unseen:?}");
    }
    assert!(seen.len() >= 40, "seen: {seen:?}; unseen: {unseen:?}");
}

/// The scene file, built to a .blend and exported again.
fn round_trip(folder: &Path, text: &str) -> String {
    let [before, blend, after] = ["before.scene.json", "built.blend", "after.scene.json"].map(|name| folder.join(name));
    std::fs::write(&before, text).expect("a temporary file");
    program().arg("export").arg(&before).arg("-o").arg(&blend).assert().success();
    program().arg("export").arg(&blend).arg("-o").arg(&after).assert().success();
    std::fs::read_to_string(after).expect("the export")
}

#[test]
fn one_socket_of_the_export_changes_the_scene_file() {
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = support::project("parity/scenes/procedural-clouds.scene.json");
    let text = std::fs::read_to_string(path).expect("the committed scene");
    let value: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let planted_text = text.replacen("\"Socket_10\": 0.2,", "\"Socket_10\": 0.20000002,", 1);
    assert_ne!(planted_text, text);
    let again = round_trip(folder.path(), &planted_text);
    let again_value: serde_json::Value = serde_json::from_str(&again).expect("JSON");
    assert_ne!(again_value, value, "one unit in the last place of one socket is seen");
    let planted_value: serde_json::Value = serde_json::from_str(&planted_text).expect("JSON");
    assert_eq!(again_value, planted_value, "and nothing else is");
}

#[test]
fn one_pixel_of_an_image_fails_the_comparison() {
    if !require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let save = |name: &str, pixel: (usize, usize)| {
        let path = folder.path().join(name);
        exr::prelude::write_rgba_file(&path, 32, 24, |x, y| {
            let value = (x + y) as f32 / 64.0;
            let planted = if (x, y) == pixel { 0.01 } else { 0.0 };
            (value, value + planted, value, 1.0_f32)
        })
        .expect("a writable folder");
        path
    };
    let reference = save("reference.exr", (99, 99));
    for (name, pixel, status) in [("same.exr", (99, 99), 0), ("planted.exr", (7, 5), 1), ("corner.exr", (31, 23), 1)] {
        let ours = save(name, pixel);
        let mut diff = program();
        diff.arg("diff").arg("--ours").arg(&ours).arg("--reference").arg(&reference);
        diff.args(["--max-error", "0.001"]).assert().code(status);
    }
}
