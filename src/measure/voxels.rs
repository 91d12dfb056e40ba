//! A published density as Cycles can see it: an OpenVDB grid of voxels under nodes of Blender.
//!
//! Our own path tracing reads the density itself; Cycles has no node for it.

use crate::base::error::{Error, Result};
use crate::base::files::sha256;
use crate::engines::Engine;
use crate::engines::light::SourceFactor;
use crate::media::objects::length_scale;
use crate::media::region::Region;
use crate::scene::volume_grid::{DENSITY, GridHandle, VolumeGrid};
use crate::scene::{Bounds, Graph, GraphSource, Scene, Shape};
use glam::{DAffine3, DMat3, DVec3};
use ndarray::{Array3, Axis};
use serde_json::json;

/// The scene with a grid of `voxels` per axis in the middle of equal parts of the box in place of its volume, under the engine's extinction,
/// albedo and phase function.
pub fn scene(scene: &Scene, engine: &Engine, voxels: usize) -> Result<(Scene, VolumeGrid)> {
    let SourceFactor::Albedo([albedo, ..]) = engine.light.source else {
        return Err(Error::new(
            format!("density model {}", engine.model),
            "a source that is no albedo times extinction",
            "one that has an albedo",
            "Leave out the defect that takes it away.",
        )
        .with_setting("defects"));
    };
    let Region { low, high } = engine.density.bounds;
    let step = (high - low) / voxels as f64;
    let to_object = DAffine3 { matrix3: DMat3::from_diagonal(step), translation: low + step / 2.0 };
    let mut values = Array3::zeros([voxels; 3]);
    for (x, mut plane) in values.axis_iter_mut(Axis(0)).enumerate() {
        let places: Vec<[f32; 3]> = (0..voxels * voxels)
            .map(|index| DVec3::new(x as f64, (index / voxels) as f64, (index % voxels) as f64))
            .map(|place| to_object.transform_point3(place).as_vec3().to_array())
            .collect();
        plane.iter_mut().zip(engine.density.values(&places)?).for_each(|(value, density)| *value = density);
    }
    let grid = VolumeGrid { values, to_object };
    let side = engine.container.unit;
    let extinction = engine.extinction;
    let phase = &engine.light.phase;
    let bytes: Vec<u8> = grid.values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let hash = sha256(&bytes);
    let mut medium = scene.clone();
    let [low, high] = grid.extent().map(|corner| corner.as_vec3().to_array());
    medium.volume.shape = Shape::Grid { file: "memory.vdb".into(), sha256: hash.clone() };
    medium.volume.bounds = Bounds { min: low, max: high };
    medium.volume.grid = Some(GridHandle::new(&grid, hash));
    // Closures count per length of the object.
    let largest = extinction.into_iter().fold(0.0, f64::max);
    let strength = largest / side / length_scale(&medium.volume);
    let tint = extinction.map(|channel| channel / largest);
    let colour = |part: &dyn Fn(f64) -> f64| [part(tint[0]), part(tint[1]), part(tint[2]), 1.0];
    let node = |name: &str, kind: &str, properties: serde_json::Value, inputs: serde_json::Value| {
        // Blender's builder places every node.
        json!({"name": name, "type": kind, "location": [0.0, 0.0], "properties": properties, "inputs": inputs})
    };
    let link = |node: &str, socket: &str| json!({"node": node, "socket": socket});
    let scaled = |name: &str, factor: f64| {
        let inputs = json!({"Value": link("Attribute", "Fac"), "Value_001": factor});
        node(name, "ShaderNodeMath", json!({"operation": "MULTIPLY"}), inputs)
    };
    let lobe = |name: &str, share: &str, anisotropy: f64| {
        let inputs = json!({
            "Color": colour(&|tint| tint * albedo), "Density": link(share, "Value"), "Anisotropy": anisotropy,
        });
        node(name, "ShaderNodeVolumeScatter", json!({}), inputs)
    };
    let sum = |name: &str, first: &str, second: &str| {
        let inputs = json!({"Shader": link(first, "Volume"), "Shader_001": link(second, "Volume")});
        node(name, "ShaderNodeAddShader", json!({}), inputs)
    };
    let absorbed = json!({"Color": colour(&|tint| 1.0 - tint * (1.0 - albedo)), "Density": link("All", "Value")});
    let both = json!({"Shader": link("Lobes", "Shader"), "Shader_001": link("Absorption", "Volume")});
    let graph = json!({
        "material": medium.volume.material,
        "groups": [],
        "nodes": [
            node("Output", "ShaderNodeOutputMaterial", json!({}), json!({"Volume": link("Sum", "Shader")})),
            node("Attribute", "ShaderNodeAttribute", json!({"attribute_name": DENSITY}), json!({})),
            scaled("All", strength),
            scaled("First Share", strength * (1.0 - phase.second)),
            scaled("Second Share", strength * phase.second),
            lobe("First", "First Share", phase.anisotropy[0]),
            lobe("Second", "Second Share", phase.anisotropy[1]),
            sum("Lobes", "First", "Second"),
            node("Absorption", "ShaderNodeVolumeAbsorption", json!({}), absorbed),
            node("Sum", "ShaderNodeAddShader", json!({}), both),
        ],
    });
    let graph: Graph = serde_json::from_value(graph).expect("a graph");
    medium.graph = GraphSource::Inline(graph);
    Ok((medium, grid))
}
