//! A published density as path tracing sees it: voxels of its values in the scene's box, under the engine's medium.

use crate::base::error::{Error, Result};
use crate::base::files::sha256;
use crate::engines::Engine;
use crate::engines::light::{SourceFactor, TwoLobes};
use crate::engines::render::{box_of, container_side};
use crate::media::density::DensityModel;
use crate::media::objects::length_scale;
use crate::scene::volume_grid::{DENSITY, GridHandle, VolumeGrid};
use crate::scene::{Bounds, Graph, GraphSource, Scene, Shape};
use glam::{DAffine3, DMat3, DVec3};
use ndarray::{Array3, Axis};
use rayon::prelude::*;
use serde_json::json;

/// Places that are evaluated together.
const BATCH: usize = 1 << 14;

/// Densities in the middle of `places`^3 equal parts of the box, by the object's x, y and z.
pub(crate) fn sample(scene: &Scene, density: &dyn DensityModel, places: usize) -> Result<Array3<f64>> {
    let to_object = grid_to_object(&scene.volume.bounds, places);
    let to_box = box_of(&scene.volume.bounds) * to_object;
    let place = |index: usize| {
        DVec3::new((index / (places * places)) as f64, (index / places % places) as f64, (index % places) as f64)
    };
    let starts: Vec<usize> = (0..places.pow(3)).step_by(BATCH).collect();
    let values: Vec<f64> = starts
        .par_iter()
        .flat_map_iter(|&start| {
            let end = places.pow(3).min(start + BATCH);
            let asked: Vec<DVec3> = (start..end).map(|index| to_box.transform_point3(place(index))).collect();
            density.densities(&asked)
        })
        .collect();
    if let Some(index) = values.iter().position(|value| !value.is_finite()) {
        return Err(Error::new(
            format!("the density at {} of object {}", to_object.transform_point3(place(index)), scene.volume.object),
            values[index].to_string(),
            "a finite density",
            "Mend the graph: cloudparity eval shows its values.",
        ));
    }
    Ok(Array3::from_shape_vec((places, places, places), values).expect("one value per place"))
}

/// Index of a place to the object's frame: places stand in the middle of equal parts of the box.
pub(crate) fn grid_to_object(bounds: &Bounds, places: usize) -> DAffine3 {
    let [low, high] = [bounds.min, bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
    let step = (high - low) / places as f64;
    DAffine3 { matrix3: DMat3::from_diagonal(step), translation: low + step / 2.0 }
}

/// The scene as path tracing sees it with an engine's medium in place of its volume: the density on a grid of `voxels`^3, with the
/// extinction, albedo and phase function of the engine.
pub fn path_scene(scene: &Scene, engine: &Engine, voxels: usize) -> Result<Scene> {
    let SourceFactor::Albedo([albedo, ..]) = engine.light.source else {
        return Err(Error::new(
            format!("density model {}", engine.model),
            "a source that is no albedo times extinction",
            "one that has an albedo",
            "Leave out the defect that takes it away, or all of them.",
        ));
    };
    let densities = sample(scene, engine.density.as_ref(), voxels)?;
    grid_scene(scene, &densities, engine.density.extinction(), albedo, &engine.light.phase)
}

/// The scene with a grid in place of its volume, under a medium of given extinction (per unit of density and side of the box), albedo
/// and phase function.
pub(crate) fn grid_scene(
    scene: &Scene,
    densities: &Array3<f64>,
    extinction: [f64; 3],
    albedo: f64,
    phase: &TwoLobes,
) -> Result<Scene> {
    let side = container_side(scene)?;
    let to_object = grid_to_object(&scene.volume.bounds, densities.len_of(Axis(0)));
    let grid = VolumeGrid { values: densities.mapv(|density| density as f32), to_object };
    let bytes: Vec<u8> = grid.values.iter().flat_map(|value| value.to_le_bytes()).collect();
    let hash = sha256(&bytes);
    let mut medium = scene.clone();
    let [low, high] = grid.extent().map(|corner| corner.as_vec3().to_array());
    medium.volume.shape = Shape::Grid { file: "memory.vdb".into(), sha256: hash.clone() };
    medium.volume.bounds = Bounds { min: low, max: high };
    medium.volume.grid = Some(GridHandle::new(grid, hash));
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
    Ok(medium)
}
