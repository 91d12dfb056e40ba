//! A study and a tuning file to begin with, fit to a scene: what `cloudparity init` writes.

use crate::base::error::Result;
use crate::engines::defects::Defects;
use crate::engines::{self, graph};
use crate::measure::study::file::StudyFile;
use crate::measure::tuning::file::TuningFile;
use crate::scene::{Scene, matrix_to_glam};
use glam::DVec3;

/// Pixels along the longer side: few, so that the first answer comes in minutes.
const LONGER_SIDE: f64 = 96.0;

/// The text of a study file; `file` is the scene file as seen from it. An error where an engine cannot show the scene.
pub fn study(scene: &Scene, file: &str) -> Result<String> {
    check(scene)?;
    let [width, height] = resolution(scene);
    let [title, file, name] = [&scene.name, file, &scene.name].map(quoted);
    let text = format!(
        "# Error against time: which light model, how many steps, which cache? docs/studies.md explains every key.
format = \"cloudparity-study/1\"
title = {title}
resolution = [{width}, {height}]

[truth]                # path tracing, against which errors are measured
samples = 64
replicas = 8

[timing]
repeats = 3

[curves]               # path tracing of so many samples, to compare with
path = [1, 4, 16]

[axes]                 # every combination is rendered
scenes = [{{ file = {file}, name = {name} }}]
densities = [\"graph\"]
lights = [\"single\", \"octaves\", \"combined\"]
steps = [8, 16, 32, 64]
light_steps = [2, 6]
caches = [{{ cells = 0 }}, {{ cells = 64, format = \"unorm8\" }}]
"
    );
    StudyFile::parse(&text, "the study file to begin with")?;
    Ok(text)
}

/// The text of a tuning file, whose views go around the volume from where the camera stands, and likewise its suns.
pub fn tuning(scene: &Scene, file: &str) -> Result<String> {
    check(scene)?;
    let [width, height] = resolution(scene);
    let (camera, sun) = (camera_angles(scene), sun_angles(scene));
    let view = |name: &str, turned: f64, sun_turned: f64, sun_height: Option<f64>| {
        let camera = format!("camera = {}", angles([camera[0] + turned, camera[1]]));
        let sun = sun.map(|[azimuth, height]| {
            format!(", sun = {}", angles([azimuth + sun_turned, sun_height.unwrap_or(height)]))
        });
        let file = quoted(file);
        format!("    {{ file = {file}, name = \"{name}\", {camera}{} }},\n", sun.unwrap_or_default())
    };
    let train: String = [
        view("from the camera", 0.0, 0.0, None),
        view("from the other side", 180.0, 0.0, None),
        view("low sun at the side", 0.0, 90.0, Some(12.0)),
        view("against a low sun", 60.0, 180.0, Some(25.0)),
    ]
    .concat();
    let held_out: String =
        [view("held out: from the left", -90.0, 30.0, None), view("held out: from the right", 90.0, -60.0, Some(35.0))]
            .concat();
    let title = quoted(&scene.name);
    let text = format!(
        "# The light of an engine fitted to path tracing on the views of train, judged on held_out. docs/tuning.md explains every key.
format = \"cloudparity-tune/1\"
title = {title}
resolution = [{width}, {height}]
train = [
{train}]
held_out = [
{held_out}]

[truth]
samples = 64
replicas = 8

[engine]
density = \"graph\"
light = \"octaves\"
steps = 48
light_steps = 6
cache = {{ cells = 64, format = \"f16\" }}

[search]
population = 12
generations = 40

[parameters]           # cloudparity lights lists what there is
exposure = {{ range = [0.1, 4.0], logarithmic = true }}
contribution = {{ range = [0.05, 1.2] }}
attenuation = {{ range = [0.05, 0.95] }}
eccentricity = {{ range = [0.0, 1.0] }}
powder_strength = {{ range = [0.0, 1.0] }}
powder_length = {{ range = [0.001, 1.0], logarithmic = true }}
ambient_bottom = {{ range = [0.0, 4.0] }}
ambient_top = {{ range = [0.0, 4.0] }}
"
    );
    TuningFile::parse(&text, "the tuning file to begin with")?;
    Ok(text)
}

/// Whether an engine shows the scene: what studies and tunings are of.
fn check(scene: &Scene) -> Result<()> {
    let values = graph::MODEL.values(None, &[])?;
    let engine = engines::find(graph::MODEL.id)?.engine(scene, &values, &Defects::NONE, 0.0)?;
    engines::render::EngineRenderer::new(scene, &engine, None).map(|_| ())
}

/// The picture's shape with few pixels.
fn resolution(scene: &Scene) -> [u32; 2] {
    let size = scene.image_size().map(f64::from);
    let factor = (LONGER_SIDE / size[0].max(size[1])).min(1.0);
    size.map(|side| (side * factor).round().max(1.0) as u32)
}

/// Azimuth and elevation of the camera as seen from the middle of the volume, in degrees.
fn camera_angles(scene: &Scene) -> [f64; 2] {
    let bounds = &scene.volume.bounds;
    let [low, high] = [bounds.min, bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
    let middle = matrix_to_glam(&scene.volume.matrix_world).transform_point3((low + high) / 2.0);
    of(matrix_to_glam(&scene.camera.matrix_world).w_axis.truncate() - middle)
}

/// The same of the first light; none where there is no light.
fn sun_angles(scene: &Scene) -> Option<[f64; 2]> {
    scene.lights.first().map(|light| of(matrix_to_glam(&light.matrix_world).z_axis.truncate()))
}

fn of(way: DVec3) -> [f64; 2] {
    [way.y.atan2(way.x).to_degrees(), way.z.atan2(way.truncate().length()).to_degrees()]
}

/// Whole degrees, the azimuth from -180 to 180.
fn angles([azimuth, elevation]: [f64; 2]) -> String {
    let azimuth = (azimuth + 180.0).rem_euclid(360.0) - 180.0;
    format!("[{:.0}, {:.0}]", azimuth.round() + 0.0, elevation.round() + 0.0)
}

/// A TOML string.
fn quoted(text: impl AsRef<str>) -> String {
    toml::Value::String(text.as_ref().to_owned()).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn files_to_begin_with_are_read_and_fit_the_scene() {
        let mut scene = Scene::load(Path::new("parity/scenes/clouds-in-daylight.scene.json")).expect("a scene");
        scene.name = "a \"quoted\" name\nof two lines".into();
        scene.film.resolution = [600, 800];
        let text = study(&scene, "daylight.scene.json").expect("a study");
        let file = StudyFile::parse(&text, "test").expect("it is read");
        assert_eq!((file.title.as_str(), file.resolution), (scene.name.as_str(), [72, 96]));
        let text = tuning(&scene, "daylight.scene.json").expect("a tuning file");
        let file = TuningFile::parse(&text, "test").expect("it is read");
        // The first view is that of the scene, to half a degree.
        let found = file.train[0].camera.expect("angles");
        assert!((0..2).all(|number| (found[number] - camera_angles(&scene)[number]).abs() <= 0.5), "{found:?}");
    }

    #[test]
    fn a_scene_that_no_engine_shows_has_no_study() {
        let mut scene = Scene::load(Path::new("parity/scenes/clouds-in-daylight.scene.json")).expect("a scene");
        scene.lights[0].kind = crate::scene::LightKind::Point { radius: 0.0, soft_falloff: true };
        assert!(study(&scene, "x").expect_err("a point light").expected.contains("suns"));
    }
}
