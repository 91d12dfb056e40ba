//! Values of Blender 5.0.1 that are committed, so that a machine without Blender notices when a
//! texture changes.

mod support;

use cloudparity::graph::evaluate::Points;
use cloudparity::graph::{Program, Target};
use cloudparity::scene::bare_scene;
use serde_json::{Value as Json, json};

/// A pow of the C library, twice per cell and octave: 1 ulp between builds, at values up to 5.
const MINKOWSKI_TOLERANCE: f32 = 2e-6;

fn numbers(value: &Json) -> Vec<f32> {
    value.as_array().expect("a list").iter().map(|number| number.as_f64().expect("a number") as f32).collect()
}

/// The texture with the position as Vector and an attribute as W.
fn evaluate(entry: &Json, positions: &[[f32; 3]], w: &[[f32; 3]]) -> Vec<f32> {
    let dimensions =
        entry["properties"]["voronoi_dimensions"].as_str().or(entry["properties"]["noise_dimensions"].as_str());
    let dimensions = dimensions.expect("a texture has dimensions");
    let mut inputs = entry["inputs"].clone();
    if dimensions != "1D" {
        inputs["Vector"] = json!({"node": "Coordinates", "socket": "Object"});
    }
    if dimensions == "1D" || dimensions == "4D" {
        inputs["W"] = json!({"node": "Separate", "socket": "X"});
    }
    let nodes = json!([
        {"name": "Coordinates", "type": "ShaderNodeTexCoord"},
        {"name": "Attribute", "type": "ShaderNodeAttribute",
         "properties": {"attribute_type": "GEOMETRY", "attribute_name": "w"}},
        {"name": "Separate", "type": "ShaderNodeSeparateXYZ",
         "inputs": {"Vector": {"node": "Attribute", "socket": "Vector"}}},
        {"name": "Node", "type": entry["type"], "properties": entry["properties"], "inputs": inputs},
    ]);
    let scene = bare_scene("golden", json!({"material": "Material", "nodes": nodes, "groups": []}));
    let target = Target::output("Node", entry["output"].as_str().expect("an output"));
    let program = Program::compile(&scene.expect("the graph is legal"), &[target]).expect("the graph compiles");
    let attributes = [("w".to_owned(), w.to_vec())];
    program.evaluate_single(Points { positions, attributes: &attributes }).expect("evaluates")
}

#[test]
fn textures_give_the_golden_values() {
    let text = std::fs::read_to_string(support::project("parity/golden-values.json")).expect("committed");
    let document: Json = serde_json::from_str(&text).expect("JSON");
    let points = document["points"].as_array().expect("a list");
    let positions: Vec<[f32; 3]> =
        points.iter().map(|point| numbers(&point["position"]).try_into().expect("three numbers")).collect();
    let w: Vec<[f32; 3]> = points.iter().map(|point| [point["w"].as_f64().expect("a number") as f32; 3]).collect();
    let entries = document["values"].as_array().expect("a list");
    assert_eq!(entries.len(), 73, "every committed value is checked");
    let mut wrong = Vec::new();
    for entry in entries {
        let expected: Vec<f32> = entry["expected"].as_array().expect("a list").iter().flat_map(numbers).collect();
        let found = evaluate(entry, &positions, &w);
        let tolerance = if entry["properties"]["distance"] == "MINKOWSKI" { MINKOWSKI_TOLERANCE } else { 0.0 };
        let equal = found.len() == expected.len()
            && found.iter().zip(&expected).all(|(ours, golden)| (ours - golden).abs() <= tolerance);
        if !equal {
            wrong.push(format!("{entry}: found {found:?}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
