//! Study files (`*.study.toml`): what is varied, and the runs that follow from it.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::engines;
use crate::engines::Engine;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::render::{EngineJitter, EngineSettings};
use crate::measure::study::curves::PARTS;
use crate::measure::study::errors::FEWEST_REPLICAS;
use crate::media::density_cache::CacheFormat;
use crate::scene::{self, Scene};
use glam::{DMat3, DVec3};
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Most samples of a curve.
const MOST_SAMPLES: u32 = 1 << 16;

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-study/1";

/// A study file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StudyFile {
    /// [`FORMAT`].
    pub format: String,
    /// Headline of what is made of it.
    pub title: String,
    /// Pixels of every picture.
    pub resolution: [u32; 2],
    /// What errors are measured against.
    #[serde(default)]
    pub truth: Truth,
    /// How time is measured.
    #[serde(default)]
    pub timing: Timing,
    /// Unbiased renderers whose error against time is shown beside the runs'.
    #[serde(default, skip_serializing_if = "Curves::is_empty")]
    pub curves: Curves,
    /// What is varied.
    pub axes: Axes,
}

/// Curves of unbiased renderers, by their samples per pixel.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Curves {
    /// Samples of path tracing, each a render of its own.
    pub path: Vec<u32>,
    /// Most samples of Cycles by density model, a multiple of [`PARTS`]; smaller numbers, down to a [`PARTS`]th, come from the same render.
    pub cycles: IndexMap<String, u32>,
}

impl Curves {
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// Path tracing of the same medium, in independent replicas.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Truth {
    /// Paths per pixel and replica.
    pub samples: u32,
    /// Replicas, at least 6: they say how uncertain the truth is.
    pub replicas: u32,
    /// Voxels per axis of the grid by which path tracing sees a published density model.
    pub voxels: usize,
}

impl Default for Truth {
    fn default() -> Self {
        Self { samples: 64, replicas: 8, voxels: 128 }
    }
}

impl Truth {
    pub(crate) fn check(&self, place: &str) -> Result<()> {
        let Self { samples, replicas, voxels } = *self;
        if samples > 0 && (FEWEST_REPLICAS as u32..=64).contains(&replicas) && (8..=512).contains(&voxels) {
            return Ok(());
        }
        Err(Error::new(
            format!("{place}, truth"),
            format!("{samples} samples, {replicas} replicas, {voxels} voxels"),
            format!("at least 1 sample, {FEWEST_REPLICAS} to 64 replicas, 8 to 512 voxels"),
            "Correct the file.",
        ))
    }
}

/// How time is measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Timing {
    /// Timed renders after one that does not count; their median counts.
    pub repeats: u32,
    /// What renders the runs.
    #[serde(skip_serializing_if = "Worker::is_cpu")]
    pub on: Worker,
}

impl Default for Timing {
    fn default() -> Self {
        Self { repeats: 3, on: Worker::Cpu }
    }
}

/// What renders a study's runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Worker {
    /// All cores, timed by processor time.
    #[default]
    Cpu,
    /// The adapter: timed by its timestamps, or by processor time where it is software.
    Adapter,
}

impl Worker {
    fn is_cpu(&self) -> bool {
        *self == Self::Cpu
    }
}

/// What is varied. Every combination is a run, but for those that mean nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes {
    /// Scenes.
    pub scenes: Vec<SceneAxis>,
    /// Density models: `graph` is the scene's own.
    pub densities: Vec<String>,
    /// Light models by name.
    pub lights: Vec<String>,
    /// Steps of a view ray.
    pub steps: Vec<u32>,
    /// Steps towards the sun.
    pub light_steps: Vec<u32>,
    /// Density caches of the graph.
    #[serde(default = "no_cache")]
    pub caches: Vec<CacheAxis>,
    /// Rays per pixel and axis.
    #[serde(default = "one_ray")]
    pub sub_pixels: Vec<u32>,
    /// Where in its steps a ray takes its samples.
    #[serde(default = "no_jitter")]
    pub jitter: Vec<EngineJitter>,
    /// Defects of the published densities that their engines keep.
    #[serde(default = "no_defects", skip_serializing_if = "are_mended")]
    pub defects: Vec<Defects>,
}

pub(crate) fn no_cache() -> Vec<CacheAxis> {
    vec![CacheAxis { cells: 0, format: CacheFormat::F16 }]
}

fn one_ray() -> Vec<u32> {
    vec![1]
}

fn no_defects() -> Vec<Defects> {
    vec![Defects::NONE]
}

fn are_mended(defects: &[Defects]) -> bool {
    defects == [Defects::NONE]
}

fn no_jitter() -> Vec<EngineJitter> {
    vec![EngineJitter::None]
}

/// A scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneAxis {
    /// The scene file, relative to the study file.
    pub file: String,
    /// Its name in the results; the scene's own if not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Changes of stored values: `"Density=10"`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
    /// Scattering events beyond the first, instead of the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub volume_bounces: Option<u32>,
    /// Azimuth from +x towards +y and elevation, in degrees, from where the suns shine.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sun: Option<[f64; 2]>,
    /// The same of the camera, which looks at the centre of the volume's bounds from the distance that it has.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<[f64; 2]>,
}

/// A density cache.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CacheAxis {
    /// Cells along the longest side; 0 evaluates the graph at each place.
    pub cells: u32,
    /// How values are stored.
    #[serde(default = "half")]
    pub format: CacheFormat,
}

fn half() -> CacheFormat {
    CacheFormat::F16
}

/// One point of the axes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Combination {
    /// Name of the scene.
    pub scene: String,
    /// Density model.
    pub density: String,
    /// Light model.
    pub light: String,
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards the sun.
    pub light_steps: u32,
    /// Density cache of the graph.
    pub cache: CacheAxis,
    /// Rays per pixel and axis.
    pub sub_pixels: u32,
    /// Where in its steps a ray takes its samples.
    pub jitter: EngineJitter,
    /// Defects that the engine keeps; left out where there are none, so that runs of studies without them keep their names.
    #[serde(default, skip_serializing_if = "Defects::is_none")]
    pub defects: Defects,
}

/// A combination that is left out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Skipped {
    /// Which.
    pub combination: Combination,
    /// Why it would say nothing.
    pub reason: String,
}

impl StudyFile {
    /// Reads and checks a study file.
    pub fn load(path: &Path) -> Result<Self> {
        let text = files::read_text(path, "a study file (*.study.toml)")?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Reads a study from text; `place` names where it stands.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let study: Self = read_toml(text, place, "docs/studies.md")?;
        study.check(place)?;
        Ok(study)
    }

    fn check(&self, place: &str) -> Result<()> {
        let wrong = |name: &str, found: String, expected: String| {
            Err(Error::new(format!("{place}, {name}"), found, expected, "Correct the study file."))
        };
        if self.format != FORMAT {
            return wrong("format", format!("\"{}\"", self.format), format!("\"{FORMAT}\""));
        }
        check_resolution(self.resolution, place)?;
        self.truth.check(place)?;
        if !(1..=100).contains(&self.timing.repeats) {
            return wrong("timing.repeats", self.timing.repeats.to_string(), "1 to 100".into());
        }
        let axes = &self.axes;
        if let Some(samples) = self.curves.path.iter().find(|samples| !(1..=MOST_SAMPLES).contains(*samples)) {
            return wrong("curves.path", samples.to_string(), format!("1 to {MOST_SAMPLES} samples"));
        }
        for (density, &samples) in &self.curves.cycles {
            let name = format!("curves.cycles.{density}");
            if !axes.densities.contains(density) {
                return wrong(
                    &name,
                    format!("\"{density}\""),
                    format!("one of axes.densities: {}", axes.densities.join(", ")),
                );
            }
            if samples == 0 || !samples.is_multiple_of(PARTS) || samples > MOST_SAMPLES {
                return wrong(&name, samples.to_string(), format!("a multiple of {PARTS} up to {MOST_SAMPLES}"));
            }
        }
        let lengths = [
            ("scenes", axes.scenes.len()),
            ("densities", axes.densities.len()),
            ("lights", axes.lights.len()),
            ("steps", axes.steps.len()),
            ("light_steps", axes.light_steps.len()),
            ("caches", axes.caches.len()),
            ("sub_pixels", axes.sub_pixels.len()),
            ("jitter", axes.jitter.len()),
            ("defects", axes.defects.len()),
        ];
        if let Some((name, _)) = lengths.iter().find(|(_, length)| *length == 0) {
            return wrong(&format!("axes.{name}"), "an empty list".into(), "at least one value".into());
        }
        for (index, name) in axes.densities.iter().enumerate() {
            engines::find(name).map_err(|error| at(error, place, &format!("axes.densities[{index}]")))?;
        }
        for (index, name) in axes.lights.iter().enumerate() {
            models::find(name).map_err(|error| at(error, place, &format!("axes.lights[{index}]")))?;
        }
        for (quality, values) in [
            (&Quality::STEPS, &axes.steps),
            (&Quality::LIGHT_STEPS, &axes.light_steps),
            (&Quality::SUB_PIXELS, &axes.sub_pixels),
        ] {
            values.iter().try_for_each(|&value| quality.check(value, place, "axes"))?;
        }
        if let Some(cache) = axes.caches.iter().find(|cache| cache.cells > 1024) {
            return wrong("axes.caches", format!("{} cells", cache.cells), "0 to 1024 cells".into());
        }
        Ok(())
    }

    /// The scenes, at the resolution of the study.
    pub fn scenes(&self, folder: &Path) -> Result<Vec<Scene>> {
        load_scenes(&self.axes.scenes, folder, self.resolution, "axes.scenes")
    }

    /// Every combination of the axes, those that mean nothing apart.
    pub fn expand(&self, scenes: &[Scene]) -> (Vec<Combination>, Vec<Skipped>) {
        let (mut wanted, mut skipped) = (Vec::new(), Vec::new());
        let axes = &self.axes;
        for (scene, density) in
            scenes.iter().flat_map(|scene| axes.densities.iter().map(move |density| (scene, density)))
        {
            for (light, &steps) in
                axes.lights.iter().flat_map(|light| axes.steps.iter().map(move |steps| (light, steps)))
            {
                for (&light_steps, &cache) in
                    axes.light_steps.iter().flat_map(|steps| axes.caches.iter().map(move |cache| (steps, cache)))
                {
                    for ((&sub_pixels, &jitter), defects) in axes
                        .sub_pixels
                        .iter()
                        .flat_map(|rays| axes.jitter.iter().map(move |jitter| (rays, jitter)))
                        .flat_map(|one| axes.defects.iter().map(move |defects| (one, defects)))
                    {
                        let combination = Combination {
                            scene: scene.name.clone(),
                            density: density.clone(),
                            light: light.clone(),
                            steps,
                            light_steps,
                            cache,
                            sub_pixels,
                            jitter,
                            defects: defects.clone(),
                        };
                        match self.meaningless(scene, &combination) {
                            Some(reason) => skipped.push(Skipped { combination, reason }),
                            None => wanted.push(combination),
                        }
                    }
                }
            }
        }
        wanted.sort_by_key(Combination::cost);
        (wanted, skipped)
    }

    /// Why a combination would only repeat another one.
    fn meaningless(&self, scene: &Scene, combination: &Combination) -> Option<String> {
        if combination.density != engines::graph::MODEL.id && combination.cache != self.axes.caches[0] {
            return Some(
                "the density is no graph: it has no density cache, and one of the caches stands for all".into(),
            );
        }
        let model = engines::find(&combination.density).expect("it was checked");
        let Ok(kept) = combination.defects.of_model(model) else {
            return Some(format!("density model {} has none of the defects {}", model.id, combination.defects));
        };
        let before = self.axes.defects.iter().take_while(|other| **other != combination.defects);
        if before.filter_map(|other| other.of_model(model).ok()).any(|other| other == kept) {
            return Some(format!("density model {} has these defects in an earlier value of the axis", model.id));
        }
        let is_dark = scene.lights.iter().all(|light| light.strength == 0.0);
        if is_dark && combination.light_steps != self.axes.light_steps[0] {
            return Some("the scene has no sun: one number of light steps stands for all".into());
        }
        let of_the_sun = ["octaves", "octaves-deep", "silver"];
        if is_dark && of_the_sun.contains(&combination.light.as_str()) {
            return Some("the scene has no sun, and the light model differs from \"single\" in sunlight alone".into());
        }
        None
    }
}

/// The scenes of a list, which have different names, at a resolution; `place` says where the list stands.
pub fn load_scenes(axes: &[SceneAxis], folder: &Path, resolution: [u32; 2], place: &str) -> Result<Vec<Scene>> {
    let mut scenes: Vec<Scene> = Vec::new();
    for axis in axes {
        let mut scene = Scene::load(&folder.join(&axis.file))?;
        axis.prepare(&mut scene, resolution)?;
        if scenes.iter().any(|other| other.name == scene.name) {
            return Err(Error::new(
                format!("{place}, {}", axis.file),
                format!("a second scene named \"{}\"", scene.name),
                "scenes of different names, by which results are told apart",
                "Give one of them another name, or take it out.",
            ));
        }
        scenes.push(scene);
    }
    Ok(scenes)
}

impl SceneAxis {
    /// Makes a scene the one that is asked for, at a resolution.
    pub fn prepare(&self, scene: &mut Scene, resolution: [u32; 2]) -> Result<()> {
        self.set.iter().try_for_each(|assignment| scene.set(assignment))?;
        if let Some(name) = &self.name {
            scene.name.clone_from(name);
        }
        if let Some(bounces) = self.volume_bounces {
            scene.set_volume_bounces(bounces);
        }
        if let Some(angles) = self.sun {
            let axes = axes_from(angles);
            for light in &mut scene.lights {
                put(&mut light.matrix_world, axes, None);
            }
        }
        if let Some(angles) = self.camera {
            let axes = axes_from(angles);
            let bounds = &scene.volume.bounds;
            let [low, high] = [bounds.min, bounds.max].map(|corner| DVec3::from(corner.map(f64::from)));
            let centre = scene::matrix_to_glam(&scene.volume.matrix_world).transform_point3((low + high) / 2.0);
            let eye = scene::matrix_to_glam(&scene.camera.matrix_world).transform_point3(DVec3::ZERO);
            let place = centre + axes.z_axis * eye.distance(centre);
            put(&mut scene.camera.matrix_world, axes, Some(place));
        }
        scene.film.resolution = resolution;
        scene.film.resolution_percentage = 100;
        Ok(())
    }
}

/// Axes of a camera or light that looks along -z: z points to where it stands, by azimuth and elevation in degrees; x is level.
fn axes_from([azimuth, elevation]: [f64; 2]) -> DMat3 {
    let (sine, cosine) = azimuth.to_radians().sin_cos();
    let (rise, level) = elevation.to_radians().sin_cos();
    let x = DVec3::new(-sine, cosine, 0.0);
    let z = DVec3::new(level * cosine, level * sine, rise);
    DMat3::from_cols(x, z.cross(x), z)
}

/// Replaces the axes of a matrix and, if there is one, its place.
fn put(matrix: &mut [[f32; 4]; 4], axes: DMat3, place: Option<DVec3>) {
    for row in 0..3 {
        for column in 0..3 {
            matrix[row][column] = axes.col(column)[row] as f32;
        }
        if let Some(place) = place {
            matrix[row][3] = place[row] as f32;
        }
    }
}

impl Combination {
    /// The density model's engine of these settings under its own light, with further parameters `NAME=VALUE` of the model.
    pub fn engine(&self, scene: &Scene, parameters: &[String]) -> Result<Engine> {
        let model = engines::find(&self.density)?;
        let mut settings = vec![format!("march_steps={}", self.steps), format!("light_steps={}", self.light_steps)];
        if model.id == engines::graph::MODEL.id {
            let format = match self.cache.format {
                CacheFormat::F32 => 0,
                CacheFormat::F16 => 1,
                CacheFormat::Unorm8 => 2,
            };
            settings.push(format!("cache_cells={}", self.cache.cells));
            settings.push(format!("cache_format={format}"));
        }
        settings.extend_from_slice(parameters);
        model.engine(scene, &model.values(None, &settings)?, &self.defects, 0.0)
    }

    /// How the engine's picture is made.
    pub fn picture_settings(&self) -> EngineSettings {
        EngineSettings { jitter: self.jitter, frame: 0, sub_pixels: self.sub_pixels, god_rays: false }
    }

    /// The settings in words, scene and density left out.
    pub fn describe(&self) -> String {
        let mut text = format!("{}, {} steps, {} light steps", self.light, self.steps, self.light_steps);
        if self.cache.cells > 0 {
            text += &format!(", cache of {} cells", self.cache.cells);
        }
        if self.sub_pixels > 1 {
            text += &format!(", {0} x {0} rays", self.sub_pixels);
        }
        text += match self.jitter {
            EngineJitter::None => "",
            EngineJitter::Table => ", jitter from the table",
            EngineJitter::BlueNoise => ", blue noise",
        };
        if !self.defects.is_none() {
            text += &format!(", defects {}", self.defects);
        }
        text
    }

    /// Densities per pixel, a graph's evaluation counting as several reads: what runs are ordered by.
    fn cost(&self) -> u64 {
        let each: u64 = if self.density == engines::graph::MODEL.id && self.cache.cells == 0 { 4 } else { 1 };
        each * u64::from(self.steps) * u64::from(1 + self.light_steps) * u64::from(self.sub_pixels).pow(2)
    }
}

/// A setting of quality that is a whole number from 1 on, as files of studies and tunings give it.
pub(crate) struct Quality {
    name: &'static str,
    most: u32,
}

impl Quality {
    /// Steps of a view ray.
    pub const STEPS: Self = Self { name: "steps", most: 100_000 };
    /// Steps towards the sun.
    pub const LIGHT_STEPS: Self = Self { name: "light_steps", most: 1000 };
    /// Rays per pixel and axis.
    pub const SUB_PIXELS: Self = Self { name: "sub_pixels", most: 64 };

    /// Refuses what is out of range, at `table` of the file `place`.
    pub fn check(&self, value: u32, place: &str, table: &str) -> Result<()> {
        let Self { name, most } = self;
        if (1..=*most).contains(&value) {
            return Ok(());
        }
        let expected = format!("a whole number from 1 to {most}");
        Err(Error::new(format!("{place}, {table}.{name}"), value.to_string(), expected, "Correct the file."))
    }
}

/// Refuses a picture without pixels, or one that no file holds.
pub(crate) fn check_resolution(resolution: [u32; 2], place: &str) -> Result<()> {
    if resolution.iter().all(|side| (1..=16384).contains(side)) {
        return Ok(());
    }
    let found = format!("{resolution:?}");
    Err(Error::new(format!("{place}, resolution"), found, "1 to 16384 pixels per side", "Correct the file."))
}

/// An error at a path within a file.
pub(crate) fn at(error: Error, place: &str, path: &str) -> Error {
    Error { place: format!("{place}, {path}"), ..error }
}

/// What to do about a file that cannot be read, by the reader's message. `variant` is what `defects` was once called.
pub(crate) fn remedy(message: &str, document: &str) -> String {
    if message.contains("unknown field `variant`") {
        return "Write defects = \"all\" in the place of \"as-published\", defects = \"none\" in that of \"fixed\"."
            .into();
    }
    format!("Correct it; {document} describes the format.")
}

/// Reads TOML; an error has the line and the path of what is wrong, and names the document that describes the format.
pub(crate) fn read_toml<T: serde::de::DeserializeOwned>(text: &str, place: &str, document: &str) -> Result<T> {
    let error = |cause: &toml::de::Error, path: Option<String>| {
        let line = cause.span().map(|span| text[..span.start.min(text.len())].lines().count().max(1));
        let mut place = line.map_or_else(|| place.to_owned(), |line| format!("{place}, line {line}"));
        if let Some(path) = path {
            place += &format!(", {path}");
        }
        Error::new(place, cause.message(), "a file of this kind", remedy(cause.message(), document))
    };
    let deserializer = toml::Deserializer::parse(text).map_err(|cause| error(&cause, None))?;
    serde_path_to_error::deserialize(deserializer).map_err(|cause| {
        let path = cause.path().to_string();
        error(&cause.into_inner(), Some(path))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const STUDY: &str = r#"
        format = "cloudparity-study/1"
        title = "test"
        resolution = [16, 9]

        [axes]
        scenes = [{ file = "a.scene.json" }]
        densities = ["graph", "perlin-fbm"]
        lights = ["single", "octaves"]
        steps = [8, 4]
        light_steps = [1, 2]
        caches = [{ cells = 0 }, { cells = 32, format = "unorm8" }]
    "#;

    #[test]
    fn every_combination_is_there_once_and_those_that_mean_nothing_have_a_reason() {
        let study = StudyFile::parse(STUDY, "test").expect("a study");
        let mut scene = Scene::load(Path::new("parity/scenes/linear-ramp.scene.json")).expect("a scene");
        let (wanted, skipped) = study.expand(&[scene.clone()]);
        // Graph: 2 lights x 2 x 2 steps x 2 caches; perlin-fbm the same without the second cache.
        assert_eq!((wanted.len(), skipped.len()), (24, 8));
        assert!(skipped.iter().all(|skipped| skipped.combination.density == "perlin-fbm"));
        assert!(wanted.is_sorted_by_key(Combination::cost));
        let mut seen: Vec<String> = wanted.iter().map(|one| serde_json::to_string(one).unwrap()).collect();
        seen.sort();
        seen.dedup();
        assert_eq!(seen.len(), 24);
        // A graph has no defects, so that none is all; PF-4 is not among what it could keep.
        let kept = STUDY.replace("caches =", "defects = [\"none\", \"PF-4\", \"all\"]\ncaches =");
        let (with_defects, left_out) =
            StudyFile::parse(&kept, "test").expect("a study").expand(std::slice::from_ref(&scene));
        assert_eq!((with_defects.len(), left_out.len()), (16 + 3 * 8, 3 * 32 - 40));
        assert!(with_defects.iter().all(|one| one.density == "perlin-fbm" || one.defects.is_none()));
        assert!(left_out.iter().any(|skipped| skipped.reason.contains("none of the defects PF-4")));
        scene.lights.iter_mut().for_each(|light| light.strength = 0.0);
        let (wanted, skipped) = study.expand(&[scene]);
        assert_eq!((wanted.len(), skipped.len()), (6, 26));
        assert!(skipped.iter().any(|skipped| skipped.reason.contains("no sun")));
    }

    #[test]
    fn suns_and_cameras_stand_where_the_angles_say() {
        let text = r#"{ file = "x", sun = [90.0, 30.0], camera = [0.0, 0.0] }"#;
        let axis: SceneAxis =
            toml::from_str::<IndexMap<String, SceneAxis>>(&format!("scene = {text}")).unwrap()["scene"].clone();
        let mut scene = Scene::load(Path::new("parity/scenes/clouds-in-daylight.scene.json")).expect("a scene");
        let before = scene::matrix_to_glam(&scene.camera.matrix_world).w_axis.truncate().length();
        axis.prepare(&mut scene, [8, 4]).expect("prepared");
        let light = scene::matrix_to_glam(&scene.lights[0].matrix_world);
        let towards = DVec3::new(0.0, 30f64.to_radians().cos(), 0.5);
        assert!((light.z_axis.truncate() - towards).length() < 1e-6, "{light}");
        let camera = scene::matrix_to_glam(&scene.camera.matrix_world);
        // The box is centred at the origin: the camera stands on the x axis, level, and looks along -x.
        assert!((camera.w_axis.truncate() - DVec3::X * before).length() < 1e-5, "{camera}");
        assert!(
            (camera.z_axis.truncate() - DVec3::X).length() < 1e-6
                && (camera.y_axis.truncate() - DVec3::Z).length() < 1e-6
        );
        assert!((camera.determinant() - 1.0).abs() < 1e-6, "no mirror");
        assert_eq!(scene.film.resolution, [8, 4]);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let error =
            |from: &str, to: &str| StudyFile::parse(&STUDY.replace(from, to), "a.study.toml").expect_err("refused");
        let found = error("lights =", "lamps =");
        assert!(found.to_string().contains("lamps") && found.to_string().contains("light_steps"), "{found}");
        assert!(found.place.contains("line"), "{}", found.place);
        let found = error("\"octaves\"", "\"moon\"");
        assert!(found.place.contains("axes.lights[1]") && found.expected.contains("octaves-deep"), "{found}");
        let found = error("\"graph\"", "\"grapf\"");
        assert!(found.expected.contains("perlin-fbm"), "{found}");
        assert!(error("[8, 4]", "[]").place.contains("axes.steps"));
        assert!(error("[8, 4]", "[0]").place.contains("axes.steps"));
        assert!(error("[16, 9]", "[0, 9]").place.contains("resolution"));
        assert!(error("study/1", "study/2").expected.contains(FORMAT));
        assert!(error("title = \"test\"", "title = ").place.contains("line 3"));
        assert!(error("caches =", "defects = []\ncaches =").place.contains("axes.defects"));
        assert!(error("caches =", "defects = [\"PF-99\"]\ncaches =").to_string().contains("PF-4, PF-5"));
        assert!(error("caches =", "variant = \"fixed\"\ncaches =").remedy.contains("defects = "));
        assert!(error("cells = 32", "cells = 4096").place.contains("axes.caches"));
        let curves = |text: &str| error("[axes]", &format!("[curves]\n{text}\n[axes]"));
        assert!(curves("path = [0]").place.contains("curves.path"));
        assert!(curves("cycles = { graph = 20 }").expected.contains("multiple of 16"));
        assert!(curves("cycles = { fog = 16 }").expected.contains("perlin-fbm"));
    }
}
