//! The scene around a graph that has none: what measurements and tests of nodes put their graphs into.

use super::Scene;
use crate::base::error::Result;

/// A scene that holds nothing but this graph, in a volume that is turned, sheared and moved.
pub fn bare_scene(name: &str, graph: serde_json::Value) -> Result<Scene> {
    let matrix_world = [[0.9, -1.1, 0.3, 2.5], [0.7, 1.3, -0.2, -1.25], [0.1, 0.4, 1.9, 3.3], [0.0, 0.0, 0.0, 1.0]];
    let identity = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    let document = serde_json::json!({
        "format": super::FORMAT,
        "name": name,
        "camera": {
            "name": "Camera", "projection": "perspective", "matrix_world": identity, "focal_length": 50.0,
            "sensor_fit": "AUTO", "sensor_width": 36.0, "sensor_height": 24.0, "ortho_scale": 6.0,
            "shift": [0, 0], "clip_start": 0.1, "clip_end": 100.0,
        },
        "film": {
            "resolution": [16, 16], "resolution_percentage": 100, "pixel_aspect": [1, 1], "pixel_filter": "BOX",
            "filter_width": 1.5, "exposure": 1.0, "transparent": true,
        },
        "integrator": {"volume_bounces": 0, "max_bounces": 0},
        "display": {"view_transform": "Standard", "look": "None", "exposure": 0.0, "gamma": 1.0},
        "lights": [],
        "world": {"color": [0, 0, 0], "strength": 0.0},
        "volume": {
            "object": "Cube", "matrix_world": matrix_world, "shape": {"type": "box"},
            "bounds": {"min": [-1, -1, -1], "max": [1, 1, 1]},
            "texture_space": {"location": [0, 0, 0], "size": [1, 1, 1]},
            "material": "Material", "volume_step_rate": 1.0,
        },
        "graph": graph,
    });
    Scene::from_value(document, name)
}
