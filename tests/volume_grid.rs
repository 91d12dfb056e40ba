//! OpenVDB files: what is written is read again, and a file that is none is refused.

mod support;

use assert_cmd::Command;
use cloudparity::bridge::volume_grid;
use cloudparity::gpu::Gpu;
use cloudparity::graph::Program;
use cloudparity::graph::bounds::Bounds3;
use cloudparity::graph::evaluate::{Arithmetic, Points};
use cloudparity::graph::wgsl::{Language, standalone};
use cloudparity::media::objects::ObjectMedium;
use cloudparity::scene::volume_grid::{DENSITY, GridHandle, VolumeGrid};
use cloudparity::scene::{Bounds, Input, Scene, Shape};
use glam::{DAffine3, DVec3};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

fn ramp() -> VolumeGrid {
    let density = |place: &DVec3| (place.x + 2.0 * place.y + 4.0 * place.z + 8.0) as f32;
    VolumeGrid::sample(DVec3::new(-1.0, -0.5, 0.0), DVec3::new(1.0, 0.5, 0.5), 17, |places| {
        Ok(places.iter().map(density).collect())
    })
    .expect("a grid")
}

#[test]
fn voxels_stand_on_the_faces_of_the_box() {
    let grid = ramp();
    assert_eq!(grid.values.shape(), [17, 9, 5]);
    let place = |index: DVec3| grid.to_object.transform_point3(index);
    assert!(place(DVec3::ZERO).abs_diff_eq(DVec3::new(-1.0, -0.5, 0.0), 1e-12));
    assert!(place(DVec3::new(16.0, 8.0, 4.0)).abs_diff_eq(DVec3::new(1.0, 0.5, 0.5), 1e-12));
    // At the index (3, 1, 2): place (-0.625, -0.375, 0.25).
    assert_eq!(grid.values[[3, 1, 2]], -0.625 - 0.75 + 1.0 + 8.0);
}

#[test]
fn absurd_sizes_are_refused() {
    let none = |_: &[DVec3]| panic!("nothing is evaluated");
    let error = VolumeGrid::sample(DVec3::ZERO, DVec3::ONE, 4096, none).expect_err("too many voxels");
    assert!(error.to_string().contains("voxels"), "{error}");
    let error = VolumeGrid::sample(DVec3::ZERO, DVec3::ZERO, 8, none).expect_err("no volume");
    assert!(error.to_string().contains("a box with a volume"), "{error}");
}

#[test]
fn what_is_written_is_read_again() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("ramp.vdb");
    let mut grid = ramp();
    // A constant block, which OpenVDB would store as a tile.
    grid.values.slice_mut(ndarray::s![0..8, 0..8, ..]).fill(3.0);
    volume_grid::write(&grid, &file, false).expect("written");
    assert_eq!(volume_grid::read(&file, DENSITY).expect("read").values, grid.values);
    let read = volume_grid::read(&file, DENSITY).expect("read");
    assert!(read.to_object.abs_diff_eq(grid.to_object, 1e-12), "{:?}", read.to_object);
    // Values that 11 bits do not hold.
    grid.values.mapv_inplace(|value| value / 3.0);
    volume_grid::write(&grid, &file, true).expect("written");
    let half = volume_grid::read(&file, DENSITY).expect("read").values;
    let largest = half.iter().zip(&grid.values).map(|(a, b)| (a - b).abs() / b).fold(0.0, f32::max);
    // Rounding to 11 bits.
    assert!(largest > 0.0 && largest <= 2.0_f32.powi(-11), "{largest}");
    let error = volume_grid::read(&file, "flame").expect_err("no such grid");
    assert!(error.to_string().contains("density"), "{error}");
    let error = volume_grid::read(&support::project("README.md"), DENSITY).expect_err("no OpenVDB file");
    assert!(error.to_string().contains("an OpenVDB file"), "{error}");
}

#[test]
fn the_command_writes_a_scene_and_a_model() {
    if !support::require("bpy") {
        return;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let scene = support::project("parity/scenes/linear-ramp.scene.json");
    for (name, model) in [("ramp", None), ("cloud", Some("perlin-fbm"))] {
        let file = folder.path().join(format!("{name}.vdb"));
        let mut command = Command::cargo_bin("cloudparity").expect("the program");
        command.arg("grid").arg(&scene).arg("-o").arg(&file).args(["--voxels", "24"]);
        if let Some(model) = model {
            command.args(["--model", model, "-p", "texture_size=32"]);
        }
        command.assert().success();
        let grid = volume_grid::read(&file, DENSITY).expect("read");
        // The model is empty at the faces: only what is not is active.
        assert!(grid.values.iter().any(|&value| value > 0.0));
        if model.is_none() {
            assert!(grid.to_object.translation.abs_diff_eq(DVec3::splat(-1.0), 0.1));
        }
    }
}

/// A scene whose volume is a grid with the given values, 0.5 apart, the first at (-1, -1, -1).
fn grid_scene(values: ndarray::Array3<f32>, to_world: [f32; 3]) -> Scene {
    let mut scene = support::scene("linear-ramp");
    let to_object = DAffine3::from_scale_rotation_translation(DVec3::splat(0.5), glam::DQuat::IDENTITY, -DVec3::ONE);
    let grid = VolumeGrid { values, to_object };
    let [low, high] = grid.extent().map(|corner| corner.as_vec3().to_array());
    scene.volume.shape = Shape::Grid { file: "memory.vdb".into(), sha256: "none".into() };
    scene.volume.bounds = Bounds { min: low, max: high };
    for axis in 0..3 {
        scene.volume.matrix_world[axis][axis] = to_world[axis];
    }
    scene.volume.grid = Some(GridHandle::new(&grid, "none".into()));
    let node = |name: &str, kind: &str, inputs: serde_json::Value| serde_json::json!({"name": name, "type": kind, "inputs": inputs});
    let link = |node: &str, socket: &str| serde_json::json!({"node": node, "socket": socket});
    let graph = serde_json::json!({
        "material": "Material",
        "groups": [],
        "nodes": [
            node("Output", "ShaderNodeOutputMaterial", serde_json::json!({"Volume": link("Scatter", "Volume")})),
            node("Attribute", "ShaderNodeAttribute", serde_json::json!({})),
            node("Scatter", "ShaderNodeVolumeScatter", serde_json::json!({
                "Color": [1.0, 0.5, 0.25, 1.0], "Density": link("Attribute", "Fac"), "Anisotropy": 0.3
            })),
        ],
    });
    let mut graph: cloudparity::scene::Graph = serde_json::from_value(graph).expect("a graph");
    graph.nodes[1].properties.insert("attribute_name".into(), "density".into());
    *scene.graph_mut() = graph;
    scene
}

fn noise(size: usize) -> ndarray::Array3<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    ndarray::Array3::from_shape_simple_fn((size, size + 1, size + 2), || random.random_range(0.0..4.0_f32))
}

/// Extinction of the red channel at places of the object.
fn extinction(scene: &Scene, places: &[[f32; 3]]) -> Vec<f64> {
    let medium = ObjectMedium::new(scene.graph(), &scene.volume).expect("a medium");
    let values = medium.evaluate(places).expect("values");
    (0..places.len()).map(|index| values.coefficients(index).extinction[0]).collect()
}

#[test]
fn values_are_interpolated_and_fade_over_one_voxel() {
    let values = noise(5);
    let scene = grid_scene(values.clone(), [1.0; 3]);
    let at = |index: [f32; 3]| index.map(|index| 0.5 * index - 1.0);
    let places = [[2.0, 3.0, 4.0], [2.5, 3.0, 4.0], [-0.25, 3.0, 4.0], [5.0, 3.0, 4.0], [2.0, 3.5, 4.5]].map(at);
    let value = |x: usize, y: usize, z: usize| f64::from(values[[x, y, z]]);
    let expected = [
        value(2, 3, 4),
        (value(2, 3, 4) + value(3, 3, 4)) / 2.0,
        0.75 * value(0, 3, 4),
        0.0,
        (value(2, 3, 4) + value(2, 4, 4) + value(2, 3, 5) + value(2, 4, 5)) / 4.0,
    ];
    for (found, expected) in extinction(&scene, &places).into_iter().zip(expected) {
        // Coordinates and six interpolations in f32.
        assert!((found - expected).abs() < 1e-5, "{found}, not {expected}");
    }
}

#[test]
fn coefficients_are_per_length_of_the_object() {
    let values = noise(4);
    let place = [[-0.3, 0.1, 0.2]];
    let plain = extinction(&grid_scene(values.clone(), [1.0; 3]), &place)[0];
    for scale in [[2.0, 2.0, 2.0], [1.0, 1.0, 3.0], [0.5, 2.0, 1.0]] {
        let found = extinction(&grid_scene(values.clone(), scale), &place)[0];
        let divisor = (scale.iter().map(|&part| f64::from(part).powi(2)).sum::<f64>() / 3.0).sqrt();
        assert!((found * divisor / plain - 1.0).abs() < 1e-12, "{scale:?}: {found}, {plain}");
    }
}

/// Principled Volume multiplies its Density by the grid by itself, as in the material that Blender makes for smoke.
#[test]
fn principled_volume_multiplies_by_the_grid() {
    let linked = grid_scene(noise(4), [1.0; 3]);
    let mut own = linked.clone();
    let closure = &mut own.graph_mut().nodes[2];
    closure.kind = "ShaderNodeVolumePrincipled".into();
    closure.inputs.insert("Density".into(), Input::Number(2.0));
    // At a voxel, between voxels, and in the fade beyond the last one.
    let places = [[-0.5, 0.0, 0.5], [-0.3, 0.1, 0.2], [-1.2, 0.1, 0.2]];
    // Volume Scatter of Density 1 has an extinction of the grid; of Principled Volume the red channel has colour 1.
    let expected = extinction(&linked, &places);
    for (found, expected) in extinction(&own, &places).into_iter().zip(&expected) {
        // A product by 2 is exact.
        assert_eq!(found, 2.0 * expected);
    }
    own.graph_mut().nodes[2].inputs.insert("Density".into(), Input::Number(-2.0));
    assert!(extinction(&own, &places).iter().all(|&value| value == 0.0));
    let program = Program::density(&own).expect("a density");
    assert!(standalone(&program, Language::Wgsl).is_ok());
}

#[test]
fn bounds_enclose_the_values() {
    let scene = grid_scene(noise(17), [1.0; 3]);
    let medium = ObjectMedium::new(scene.graph(), &scene.volume).expect("a medium");
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let [low, high] = [scene.volume.bounds.min, scene.volume.bounds.max];
    let mut tightness = 0.0_f64;
    for trial in 0..2000 {
        // Also boxes that reach beyond the grid.
        let size = if trial % 2 == 0 { 0.3 } else { 4.0 };
        let corner: [f32; 3] = std::array::from_fn(|axis| random.random_range(low[axis] - 1.0..high[axis] + 1.0));
        let extent: [f32; 3] = std::array::from_fn(|_| random.random_range(0.0..size));
        let far = std::array::from_fn(|axis| corner[axis] + extent[axis]);
        let found = medium.bounds_of(&[Bounds3::new(corner, far)], 0).expect("bounds")[0].extinction[0];
        let places: Vec<[f32; 3]> =
            (0..64).map(|_| std::array::from_fn(|axis| corner[axis] + extent[axis] * random.random::<f32>())).collect();
        for value in extinction(&scene, &places) {
            assert!(found.contains(value), "{value} is outside of {found:?}");
        }
        tightness = tightness.max(f64::from(found.low));
    }
    // Not everything is enclosed by 0 to the largest.
    assert!(tightness > 0.5, "{tightness}");
}

#[test]
fn a_grid_is_the_same_on_the_adapter() {
    let scene = grid_scene(noise(5), [1.0; 3]);
    let program = Program::density(&scene).expect("a density");
    let text = String::from_utf8(standalone(&program, Language::Wgsl).expect("WGSL")).expect("text");
    assert!(text.contains("@group(1) @binding(0)"), "its values are the texture of the program: {text}");
    if !support::require("vulkan") {
        return;
    }
    let gpu = Gpu::open().expect("the adapter that was just there");
    let mut random = ChaCha8Rng::seed_from_u64(9);
    // Also beyond the outermost voxels, which lie at -1 and at up to 2.
    let places: Vec<[f32; 3]> = (0..4000).map(|_| std::array::from_fn(|_| random.random_range(-2.0..3.0))).collect();
    let points = Points::new(&places);
    let found = gpu.field(&program).expect("a kernel").evaluate(points).expect("values");
    let expected = program.evaluate(points, Arithmetic::Oracle).expect("values");
    // Values up to 4. An index is an affine image of a place, of at most 8 and four roundings: off by 2^-19, with a slope of at most 4 a
    // texel along each axis; and 26 roundings of the interpolation.
    let bound = 3.0 * 4.0 * 0.5_f64.powi(19) + 4.0 * 26.0 * 0.5_f64.powi(24);
    let mut filled = 0;
    for ((place, found), expected) in places.iter().zip(found).zip(expected) {
        let error = (f64::from(found) - expected).abs();
        assert!(error <= bound, "{place:?}: {found}, not {expected}: {error:e} of {bound:e}");
        filled += usize::from(expected > 0.0);
    }
    assert!(filled > 500 && filled < 3500, "inside and outside: {filled}");
}

#[test]
fn what_is_not_known_of_grids_is_refused() {
    let scene = grid_scene(noise(3), [1.0; 3]);
    let mut other = scene.clone();
    other.graph_mut().nodes[1].properties.insert("attribute_name".into(), "flame".into());
    let error = ObjectMedium::new(other.graph(), &other.volume).err().expect("another grid").to_string();
    assert!(error.contains("flame"), "{error}");
    let mut other = scene.clone();
    let closure = &mut other.graph_mut().nodes[2];
    closure.kind = "ShaderNodeVolumePrincipled".into();
    closure.inputs.insert("Density Attribute".into(), Input::Text("flame".into()));
    let error = ObjectMedium::new(other.graph(), &other.volume).err().expect("another grid").to_string();
    assert!(error.contains("Density Attribute") && error.contains("flame"), "{error}");
    let mut mesh = scene;
    mesh.volume.grid = None;
    mesh.volume.shape = Shape::Box;
    let error = ObjectMedium::new(mesh.graph(), &mesh.volume).err().expect("a mesh has no grid").to_string();
    assert!(error.contains("Fac"), "{error}");
}
