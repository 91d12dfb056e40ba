//! The homogeneous cube of edge 2, one central ray, and changes to it that have closed forms.

use cloudparity::integrators::{LightMode, MarchSettings};
use cloudparity::scene::{Input, Node, Scene};
use serde_json::json;
use std::f64::consts::PI;

/// Irradiance of the sun, which travels straight down.
pub const SUN: f64 = 10.0;

/// Scattering per metre of the three channels; the extinction is 1.
pub const SCATTERING: [f64; 3] = [0.6, 0.3, 0.9];

/// The committed scene with four pixels, each the central ray.
pub fn homogeneous() -> Scene {
    let mut scene = super::scene("homogeneous-cube");
    scene.film.resolution = [2, 2];
    scene
}

/// Changes an input of the closure.
pub fn set(scene: &mut Scene, socket: &str, value: Input) {
    let nodes = &mut scene.graph_mut().nodes;
    let closure = nodes.iter_mut().find(|node| node.name == "Principled Volume").expect("the scene has one");
    closure.inputs.insert(socket.to_owned(), value);
}

/// A color as a value of a socket.
pub fn color(value: [f32; 3]) -> Input {
    Input::List(vec![value[0], value[1], value[2], 1.0])
}

/// Henyey-Greenstein in 1/sr.
pub fn phase(anisotropy: f64, cosine: f64) -> f64 {
    let square = anisotropy * anisotropy;
    (1.0 - square) / (4.0 * PI * (1.0 + square - 2.0 * anisotropy * cosine).powf(1.5))
}

/// A sun that travels (0, -1, -1)/sqrt(2): it shines along its local -Z.
pub fn slanted_sun(scene: &mut Scene) {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    scene.lights[0].matrix_world =
        [[1.0, 0.0, 0.0, 0.0], [0.0, half, half, 0.0], [0.0, -half, half, 0.0], [0.0, 0.0, 0.0, 1.0]];
}

/// Density `slope * Generated[axis]`.
pub fn ramp(scene: &mut Scene, axis: &str, slope: f32) {
    let nodes = json!([
        {"name": "Coordinate", "type": "ShaderNodeTexCoord", "location": [0.0, 0.0],
         "properties": {"from_instancer": false, "object": null}, "inputs": {}},
        {"name": "Separate", "type": "ShaderNodeSeparateXYZ", "location": [0.0, 0.0], "properties": {},
         "inputs": {"Vector": {"node": "Coordinate", "socket": "Generated"}}},
        {"name": "Slope", "type": "ShaderNodeMath", "location": [0.0, 0.0],
         "properties": {"operation": "MULTIPLY", "use_clamp": false},
         "inputs": {"Value": {"node": "Separate", "socket": axis}, "Value_001": slope}},
    ]);
    density_from(scene, nodes, "Slope");
}

/// Density 3 within 0.7 of the centre, else 0.
pub fn sphere(scene: &mut Scene) {
    let nodes = json!([
        {"name": "Coordinate", "type": "ShaderNodeTexCoord", "location": [0.0, 0.0],
         "properties": {"from_instancer": false, "object": null}, "inputs": {}},
        {"name": "Length", "type": "ShaderNodeVectorMath", "location": [0.0, 0.0],
         "properties": {"operation": "LENGTH"},
         "inputs": {"Vector": {"node": "Coordinate", "socket": "Object"}}},
        {"name": "Inside", "type": "ShaderNodeMath", "location": [0.0, 0.0],
         "properties": {"operation": "LESS_THAN", "use_clamp": false},
         "inputs": {"Value": {"node": "Length", "socket": "Value"}, "Value_001": 0.7}},
        {"name": "Sphere", "type": "ShaderNodeMath", "location": [0.0, 0.0],
         "properties": {"operation": "MULTIPLY", "use_clamp": false},
         "inputs": {"Value": {"node": "Inside", "socket": "Value"}, "Value_001": 3.0}},
    ]);
    density_from(scene, nodes, "Sphere");
}

/// Adds nodes and links the last one's Value to the density.
fn density_from(scene: &mut Scene, nodes: serde_json::Value, last: &str) {
    let nodes: Vec<Node> = serde_json::from_value(nodes).expect("the nodes are well formed");
    scene.graph_mut().nodes.extend(nodes);
    set(scene, "Density", Input::Link { node: last.into(), socket: "Value".into() });
}

/// Single scattering by short steps, light along rays of its own, one ray per pixel to its end.
pub fn exact() -> MarchSettings {
    MarchSettings {
        view_step: 0.01,
        shadow_step: 0.05,
        sub_pixels: 1,
        light: LightMode::Exact,
        exit_transmittance: 0.0,
        ..MarchSettings::default()
    }
}
