//! What a scene file need not say: Blender's own defaults for a new camera, film and light, the unit cube that a new cube is, and a
//! black world, so that nothing shines which nobody asked for.

use super::{Bounds, Matrix, PixelFilter, Projection, SensorFit, Shape, TextureSpace};
use serde_json::{Value as Json, json};

/// Functions that serde calls where a field is missing.
macro_rules! defaults {
    ($($name:ident: $type:ty = $value:expr;)*) => {
        $(pub(super) fn $name() -> $type { $value })*
    };
}

defaults! {
    camera: String = "Camera".into();
    projection: Projection = Projection::Perspective;
    focal_length: f32 = 50.0;
    sensor_fit: SensorFit = SensorFit::Auto;
    sensor_width: f32 = 36.0;
    sensor_height: f32 = 24.0;
    ortho_scale: f32 = 6.0;
    clip_start: f32 = 0.1;
    clip_end: f32 = 1000.0;
    resolution: [u32; 2] = [1920, 1080];
    percentage: u32 = 100;
    square: [f32; 2] = [1.0; 2];
    pixel_filter: PixelFilter = PixelFilter::BlackmanHarris;
    filter_width: f32 = 1.5;
    one: f32 = 1.0;
    max_bounces: u32 = 12;
    view_transform: String = "AgX".into();
    look: String = "None".into();
    light: String = "Light".into();
    white: [f32; 3] = [1.0; 3];
    // 0.526 degrees, as the sun is seen from the ground.
    sun_angle: f32 = 0.526_f32.to_radians();
    radius: f32 = 0.1;
    yes: bool = true;
    spot_size: f32 = std::f32::consts::FRAC_PI_4;
    blend: f32 = 0.15;
    area: String = "SQUARE".into();
    volume: String = "Volume".into();
    identity: Matrix = std::array::from_fn(|row| std::array::from_fn(|column| f32::from(u8::from(row == column))));
    shape: Shape = Shape::Box;
    bounds: Bounds = Bounds { min: [-1.0; 3], max: [1.0; 3] };
    // Where a scene is read, that of the bounds takes its place.
    texture_space: TextureSpace = TextureSpace { location: [0.0; 3], size: [1.0; 3] };
    // Where a scene is read, that of the graph takes its place.
    material: String = String::new();
}

/// Writes down what follows from the rest of a scene file and is not said there: its name, and texture spaces.
pub(super) fn complete(document: &mut Json, name: &str) {
    let Some(scene) = document.as_object_mut() else { return };
    if !scene.contains_key("name") {
        scene.insert("name".into(), json!(name));
    }
    let mut others = scene.get_mut("other_volumes").and_then(Json::as_array_mut).map(std::mem::take);
    let volumes = scene.get_mut("volume").into_iter().chain(others.iter_mut().flatten());
    for volume in volumes.filter_map(Json::as_object_mut) {
        if volume.contains_key("texture_space") {
            continue;
        }
        let corner = |name: &str| -> Option<[f64; 3]> {
            let corner = volume.get("bounds")?.get(name)?.as_array()?;
            let numbers: Vec<f64> = corner.iter().filter_map(Json::as_f64).collect();
            numbers.try_into().ok()
        };
        if let (Some(low), Some(high)) = (corner("min"), corner("max")) {
            let part = |sign: f64| -> [f64; 3] { std::array::from_fn(|axis| (high[axis] + sign * low[axis]) / 2.0) };
            volume.insert("texture_space".into(), json!({"location": part(1.0), "size": part(-1.0)}));
        }
    }
    if let (Some(others), Some(there)) = (others, scene.get_mut("other_volumes")) {
        *there = Json::Array(others);
    }
}
