//! Sequence files (`*.sequence.toml`): an engine, motions, and ways to make frames from fewer rays.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::kinds::{self, FileKind};
use crate::engines::Selection;
use crate::engines::defects::Defects;
use crate::engines::light::models;
use crate::engines::parameters::Range;
use crate::engines::reconstruction::Reconstruction;
use crate::engines::render::EngineJitter;
use crate::measure::combination::{CacheAxis, Combination, Quality, no_cache};
use crate::measure::scenes::{SceneAxis, check_resolution};
use crate::measure::toml_files::{at, read_toml};
use crate::measure::truth::Truth;
use crate::scene::{self, Scene};
use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The format that this version reads.
pub const FORMAT: &str = "cloudparity-sequence/1";

/// Most frames of a sequence.
const MOST_FRAMES: u32 = 10_000;

/// A sequence file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SequenceFile {
    /// [`FORMAT`].
    pub format: String,
    /// Headline of what is made of it.
    pub title: String,
    /// Pixels of every frame.
    pub resolution: [u32; 2],
    /// Frames of each motion.
    pub frames: u32,
    /// First frames, which no figure counts: histories fill up.
    pub warm_up: u32,
    /// What errors are measured against.
    #[serde(default)]
    pub truth: SequenceTruth,
    /// The scene.
    pub scene: SceneAxis,
    /// The engine.
    pub engine: EngineOfSequence,
    /// What moves.
    pub motions: Vec<Motion>,
    /// How frames are made.
    pub reconstructions: Vec<Named>,
}

/// Path tracing of single frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SequenceTruth {
    /// Every so many frames one has a truth, the last one first.
    pub every: u32,
    /// How it is made.
    pub path: Truth,
}

impl Default for SequenceTruth {
    fn default() -> Self {
        Self { every: 10, path: Truth { samples: 16, ..Truth::default() } }
    }
}

/// The engine of a sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EngineOfSequence {
    /// Density model with its parameters: `"bolt coverage=0.6"`.
    pub density: String,
    /// Light model, likewise.
    #[serde(default = "own_light")]
    pub light: String,
    /// Steps of a view ray.
    pub steps: u32,
    /// Steps towards the sun.
    pub light_steps: u32,
    /// Density cache of a scene's graph.
    #[serde(default = "uncached")]
    pub cache: CacheAxis,
    /// Where in its steps a ray takes its samples.
    #[serde(default = "unjittered")]
    pub jitter: EngineJitter,
    /// Defects that it keeps.
    #[serde(default)]
    pub defects: Defects,
}

fn own_light() -> String {
    models::OWN.into()
}

fn uncached() -> CacheAxis {
    no_cache()[0]
}

fn unjittered() -> EngineJitter {
    EngineJitter::None
}

/// What moves from the first frame to the last.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Its name.
    pub name: String,
    /// Degrees by which the camera turns about the world's z, where it stands, over the whole sequence.
    #[serde(default)]
    pub turn: f64,
    /// Metres by which it moves over the whole sequence.
    #[serde(default)]
    pub travel: [f64; 3],
    /// Seconds of the clouds' own motion from one frame to the next.
    #[serde(default)]
    pub seconds: f64,
    /// Parameters of the system, or numbers of a scene's own graph, that pass evenly from a value in the first frame to another in the last: clouds
    /// that form or vanish.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, [f64; 2]>,
}

/// A way to make frames, with its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Steps of a view ray instead of the engine's: what a way from fewer rays has to be better than.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<u32>,
    /// What it is.
    #[serde(default)]
    pub how: Reconstruction,
}

impl SequenceFile {
    /// Reads and checks a sequence file.
    pub fn load(path: &Path) -> Result<Self> {
        kinds::want(path, FileKind::Sequence)?;
        let text = files::read_text(path, "a sequence file (*.sequence.toml)")?;
        Self::parse(&text, &path.display().to_string())
    }

    /// Reads a sequence from text; `place` names where it stands.
    pub fn parse(text: &str, place: &str) -> Result<Self> {
        let found: Self = read_toml(text, place, "docs/sequences.md")?;
        found.check(place)?;
        Ok(found)
    }

    fn check(&self, place: &str) -> Result<()> {
        let wrong = |name: &str, found: String, expected: String| {
            Err(Error::new(format!("{place}, {name}"), found, expected, "Correct the sequence file."))
        };
        if self.format != FORMAT {
            return wrong("format", format!("\"{}\"", self.format), format!("\"{FORMAT}\""));
        }
        check_resolution(self.resolution, place)?;
        if !(2..=MOST_FRAMES).contains(&self.frames) {
            return wrong("frames", self.frames.to_string(), format!("2 to {MOST_FRAMES}"));
        }
        // Flicker and lag are of a frame and the one before.
        if !(1..self.frames).contains(&self.warm_up) {
            return wrong("warm_up", self.warm_up.to_string(), format!("1 to {}: below frames", self.frames - 1));
        }
        if self.truth.every == 0 {
            return wrong("truth.every", "0".into(), "at least 1".into());
        }
        self.truth.path.check(place)?;
        let engine = &self.engine;
        Quality::STEPS.check(engine.steps, place, "engine")?;
        Quality::LIGHT_STEPS.check(engine.light_steps, place, "engine")?;
        let selection = Selection::parse(&engine.density).map_err(|error| at(error, place, "engine.density"))?;
        models::check(&engine.light).map_err(|error| at(error, place, "engine.light"))?;
        engine.defects.of_model(selection.model).map_err(|error| at(error, place, "engine.defects"))?;
        for (list, names) in [
            ("motions", self.motions.iter().map(|one| &one.name).collect::<Vec<_>>()),
            ("reconstructions", self.reconstructions.iter().map(|one| &one.name).collect()),
        ] {
            if names.is_empty() {
                return wrong(list, "an empty list".into(), "at least one".into());
            }
            if let Some(twice) = (1..names.len()).find(|&index| names[..index].contains(&names[index])) {
                let found = format!("a second \"{}\"", names[twice]);
                return wrong(&format!("{list}[{twice}].name"), found, "different names".into());
            }
        }
        for (index, motion) in self.motions.iter().enumerate() {
            let ends = motion.parameters.values().flatten();
            let mut numbers = [motion.turn, motion.seconds].into_iter().chain(motion.travel).chain(ends.copied());
            if let Some(strange) = numbers.find(|number| !number.is_finite()) {
                return wrong(&format!("motions[{index}]"), strange.to_string(), "finite numbers".into());
            }
            // Numbers of a scene's graph are known with the scene.
            for name in motion.parameters.keys().filter(|_| !selection.model.is_of_scene) {
                let place_of_file = place;
                let place = format!("motions[{index}].parameters.{name}");
                let parameter = selection.model.parameters.iter().find(|parameter| parameter.name == *name);
                if !parameter.is_some_and(|parameter| !matches!(parameter.range, Range::Whole(..))) {
                    let known = selection.model.parameters.iter();
                    let known = known.filter(|parameter| !matches!(parameter.range, Range::Whole(..)));
                    let known: Vec<&str> = known.map(|parameter| parameter.name).collect();
                    return wrong(
                        &place,
                        format!("\"{name}\""),
                        format!("one of {} that is no whole number: {}", selection.model.id, known.join(", ")),
                    );
                }
                for part in [0.0, 1.0] {
                    let settings = [selection.settings.as_slice(), &motion.settings(part)].concat();
                    selection.model.values(None, &settings).map_err(|error| at(error, place_of_file, &place))?;
                }
            }
        }
        for (index, one) in self.reconstructions.iter().enumerate() {
            if let Some(steps) = one.steps {
                Quality::STEPS.check(steps, place, &format!("reconstructions[{index}]"))?;
            }
            one.how.check(&format!("{place}, reconstructions[{index}].how"))?;
        }
        Ok(())
    }

    /// The scene at its resolution.
    pub fn scene(&self, folder: &Path) -> Result<Scene> {
        let mut scene = Scene::load(&folder.join(&self.scene.file))?;
        self.scene.prepare(&mut scene, self.resolution)?;
        // What rays find is put over the background.
        scene.film.transparent = false;
        if Selection::parse(&self.engine.density)?.model.is_of_scene {
            for motion in &self.motions {
                for setting in [0.0, 1.0].into_iter().flat_map(|part| motion.settings(part)) {
                    scene.clone().set(&setting)?;
                }
            }
        }
        Ok(scene)
    }

    /// The engine's settings in a scene.
    pub(super) fn combination(&self, scene: &Scene) -> Combination {
        let EngineOfSequence { density, light, steps, light_steps, cache, jitter, defects } = self.engine.clone();
        let scene = scene.name.clone();
        Combination {
            scene,
            density,
            light,
            steps,
            light_steps,
            cache,
            light_volume: None,
            sub_pixels: 1,
            jitter,
            defects,
            god_rays: false,
        }
    }

    /// Frames with a truth, of those that count.
    pub(super) fn frames_with_truth(&self) -> Vec<u32> {
        let mut frames: Vec<u32> = (self.warm_up..self.frames).rev().step_by(self.truth.every as usize).collect();
        frames.reverse();
        frames
    }
}

impl Motion {
    /// The scene at a frame, of so many.
    pub(super) fn scene(&self, scene: &Scene, frame: u32, frames: u32) -> Scene {
        let part = f64::from(frame) / f64::from(frames - 1);
        let mut moved = scene.clone();
        let before = scene::matrix_to_glam(&scene.camera.matrix_world);
        let place = before.w_axis.truncate();
        let turn = DMat4::from_translation(place + DVec3::from(self.travel) * part)
            * DMat4::from_rotation_z((self.turn * part).to_radians())
            * DMat4::from_translation(-place);
        moved.camera.matrix_world = scene::matrix_from_glam(turn * before);
        moved
    }

    /// Its parameters after a part of the sequence, `NAME=VALUE`.
    pub(super) fn settings(&self, part: f64) -> Vec<String> {
        let at = |(name, [from, to]): (&String, &[f64; 2])| format!("{name}={}", from + (to - from) * part);
        self.parameters.iter().map(at).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        format = "cloudparity-sequence/1"
        title = "test"
        resolution = [16, 9]
        frames = 8
        warm_up = 2
        scene = { file = "a.scene.json" }
        engine = { density = "bolt", steps = 8, light_steps = 2 }
        motions = [{ name = "turn", turn = 10.0 }, { name = "clouds", seconds = 2.0, parameters = { coverage = [0.2, 0.6] } }]
        reconstructions = [{ name = "plain" }, { name = "bayer", how = { rays = "bayer", clip = 2.0 } }]
    "#;

    #[test]
    fn files_are_read_and_mistakes_named() {
        let file = SequenceFile::parse(FILE, "test").expect("a sequence");
        assert_eq!(file.frames_with_truth(), [7]);
        assert!(file.reconstructions[0].how.is_plain() && !file.reconstructions[1].how.is_plain());
        let error = |from: &str, to: &str| SequenceFile::parse(&FILE.replace(from, to), "a").expect_err("refused");
        assert!(error("sequence/1", "sequence/2").expected.contains(FORMAT));
        assert!(error("frames = 8", "frames = 1").place.contains("frames"));
        assert!(error("warm_up = 2", "warm_up = 8").place.contains("warm_up"));
        assert!(error("warm_up = 2", "warm_up = 0").place.contains("warm_up"));
        assert!(error("\"bolt\"", "\"bold\"").place.contains("engine.density"));
        assert!(error("steps = 8, ", "steps = 8, light = \"moon\", ").place.contains("engine.light"));
        assert!(error("steps = 8, ", "steps = 8, defects = \"TK-7\", ").place.contains("engine.defects"));
        assert!(error("name = \"clouds\"", "name = \"turn\"").place.contains("motions[1]"));
        assert!(error("clip = 2.0", "clip = -2.0").place.contains("reconstructions[1].how.clip"));
        assert!(error("rays = \"bayer\"", "rays = \"byer\"").to_string().contains("checkerboard"));
        assert!(error("turn = 10.0", "turn = nan").place.contains("motions[0]"));
        assert_eq!(file.motions[1].settings(0.25), ["coverage=0.3"]);
        for (change, named) in [
            ("cover = [0.2, 0.6]", "wind_influence"),
            ("light_steps = [2.0, 6.0]", "no whole number"),
            ("coverage = [0.2, 1.5]", "coverage"),
            ("coverage = [0.2, inf]", "finite"),
        ] {
            let error = error("coverage = [0.2, 0.6]", change);
            assert!(error.place.contains("motions[1]") && error.to_string().contains(named), "{error}");
        }
    }

    #[test]
    fn cameras_turn_and_travel() {
        let scene = Scene::load(Path::new("parity/scenes/linear-ramp.scene.json")).expect("a scene");
        let motion = Motion { name: "both".into(), turn: 90.0, travel: [1.0, 2.0, 3.0], ..Motion::default() };
        let matrix = |frame: u32| scene::matrix_to_glam(&motion.scene(&scene, frame, 9).camera.matrix_world);
        let first = scene::matrix_to_glam(&scene.camera.matrix_world);
        assert!(matrix(0).abs_diff_eq(first, 1e-6));
        let moved = (matrix(8).w_axis - first.w_axis).truncate();
        assert!(moved.abs_diff_eq(DVec3::new(1.0, 2.0, 3.0), 1e-5), "{moved}");
        // From x to y, from y to -x.
        for axis in 0..3 {
            let [before, after] = [first, matrix(8)].map(|matrix| matrix.col(axis).truncate());
            assert!(after.abs_diff_eq(DVec3::new(-before.y, before.x, before.z), 1e-6));
        }
    }
}
