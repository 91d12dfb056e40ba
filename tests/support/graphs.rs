//! Node graphs of materials, written down.

use cloudparity::scene::Graph;
use serde_json::{Value as Json, json};

/// A link to an output.
pub fn link(node: &str, socket: &str) -> Json {
    json!({"node": node, "socket": socket})
}

/// A node.
pub fn node(name: &str, kind: &str, properties: Json, inputs: Json) -> Json {
    json!({"name": name, "type": kind, "location": [0.0, 0.0], "properties": properties, "inputs": inputs})
}

/// A graph whose Volume is fed by `end`, with groups.
pub fn graph_with(end: Json, nodes: &[Json], groups: &[Json]) -> Graph {
    let output = node(
        "Material Output",
        "ShaderNodeOutputMaterial",
        json!({"is_active_output": true, "target": "ALL"}),
        json!({"Volume": end}),
    );
    let nodes: Vec<&Json> = std::iter::once(&output).chain(nodes).collect();
    serde_json::from_value(json!({"material": "Material", "nodes": nodes, "groups": groups})).expect("a graph")
}

/// The same without groups.
pub fn graph(end: Json, nodes: &[Json]) -> Graph {
    graph_with(end, nodes, &[])
}
