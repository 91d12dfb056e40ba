//! `cloudparity view`: a window.

use super::choice::choice;
use super::display::table;
use super::engine::EngineArguments;
use super::picture::SceneArguments;
use crate::base::display_table::DisplayTable;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, listed};
use crate::base::numbers::uncertain;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::engines::graph::at_time;
use crate::engines::{self, Engine, parameters};
use crate::gpu::Backend;
use crate::integrators::path::GivenMedium;
use crate::measure::combination::no_cache;
use crate::measure::errors;
use crate::measure::images::{self, FlipPair};
use crate::measure::pictures::{DiffRequest, DisplaySettings, Tolerances};
use crate::measure::study::pareto_front::Metric;
use crate::measure::tuning::file::TunedEngine;
use crate::measure::tuning::preset::{FORMAT, Preset, SCENES};
use crate::report::settings::{self, Recorded, Setting, Settings, Subject};
use crate::scene::Scene;
use crate::scene::image::Image;
use crate::viewer::compare::Mode;
use crate::viewer::quality::Choice;
use crate::viewer::{self, Changes, Record, Source};
use indexmap::IndexMap;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

/// Open a window: an engine's picture of a scene under the mouse, beside the truth, with its error and its time.
///
/// Drag to go around; with Shift or the middle button to move; with Ctrl or the right button to turn the sun; the wheel for the distance.
/// Every number of the material, the system and its light is beside the picture. When the view rests, path tracing without bias
/// accumulates, and the error has a standard error from then on. What is recorded goes into folders that `cloudparity report` reads;
/// what is saved is a preset that render, publish and view take.
#[derive(clap::Args)]
#[command(after_help = "Examples:
  cloudparity view CLOUD.scene.json
  cloudparity view CLOUD.scene.json --model bolt --resolution 320x180
  cloudparity view CLOUD.scene.json --truth CYCLES.seed-*.exr --shown wipe")]
pub(super) struct Arguments {
    #[command(flatten)]
    scene: SceneArguments,
    /// Instead of a model and its options, an engine as a tuned preset (*.preset.json) has it.
    #[arg(long, value_name = "FILE")]
    preset: Option<PathBuf>,
    /// Pictures that are right, of the scene's own view and size, such as replicas of Cycles: the truth of that view in the place of path
    /// tracing.
    #[arg(long, value_name = "FILE", num_args = 1..)]
    truth: Vec<PathBuf>,
    /// Part, layer or pass of --truth, in files with several.
    #[arg(long, value_name = "PART", requires = "truth")]
    truth_part: Option<String>,
    /// The folder of a study, or of pairs that were recorded here: of its settings that nothing beats, the budget of milliseconds picks one.
    #[arg(long, value_name = "DIR")]
    study: Option<PathBuf>,
    #[command(flatten)]
    engine: EngineArguments,
    /// Where it runs; all cores where there is no adapter.
    #[arg(long, value_parser = choice::<Backend>(), default_value_t = Backend::Gpu)]
    backend: Backend,
    /// What is seen at first.
    #[arg(long, value_parser = choice::<Mode>(), default_value_t = Mode::Engine)]
    shown: Mode,
    /// The folder for what is recorded and saved.
    #[arg(short, long, value_name = "DIR", default_value = "out/view")]
    output: PathBuf,
    /// Write a picture of the window (PNG), and close it.
    #[arg(long, value_name = "FILE")]
    photograph: Option<PathBuf>,
    /// Samples a pixel of the truth before the picture of the window is taken.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "photograph")]
    photograph_after: u32,
}

/// Colours along each axis of the table of the view transform.
const COLOURS: usize = 97;

/// Points of the window: a picture of 16:9 beside the numbers.
const WINDOW: [f32; 2] = [1360.0, 640.0];

pub(super) fn run(arguments: Arguments) -> Result<ExitCode> {
    let Arguments {
        scene,
        preset,
        truth,
        truth_part,
        study,
        engine,
        backend,
        shown,
        output,
        photograph,
        photograph_after,
    } = arguments;
    let scene = scene.load()?;
    let preset = preset.map(|path| super::engine::preset(&path, &scene)).transpose()?;
    engine.refuse_for_views(preset.is_some())?;
    let pictures = images::read(&truth, truth_part.as_deref(), "--truth-part")?;
    let size = scene.image_size().map(|side| side as usize);
    for (path, picture) in truth.iter().zip(&pictures) {
        if [picture.width, picture.height] != size {
            return Err(Error::new(
                path.display().to_string(),
                format!("{} x {} pixels", picture.width, picture.height),
                format!("{} x {}, the size of the scene's picture", size[0], size[1]),
                "Give --resolution, or another picture.",
            ));
        }
    }
    let wanted = match &preset {
        Some(preset) => engines::Selection::parse(&preset.engine.density)?.model.id,
        None => engine.model("graph"),
    };
    let front = study.map(|folder| front(&folder, &scene, wanted)).transpose()?.unwrap_or_default();
    let choices = front.iter().map(choice_of).collect();
    let front = front.into_iter().map(|setting| setting.preset).collect();
    let viewed = Viewed { scene, engine, preset, front, choices, pictures, folder: output };
    // What is wrong with the options is said here, not in a window.
    viewed.engine(&Changes::default())?;
    let photograph = photograph.map(|path| (path, photograph_after));
    viewer::open(Arc::new(viewed), backend, WINDOW, shown, photograph)?;
    Ok(ExitCode::SUCCESS)
}

/// The scene and the engine of the command line.
pub struct Viewed {
    scene: Scene,
    engine: EngineArguments,
    preset: Option<Preset>,
    /// Settings of the front, and what is known of them.
    front: Vec<Preset>,
    choices: Vec<Choice>,
    pictures: Vec<Image>,
    folder: PathBuf,
}

/// Settings of a model that nothing beats, by rising time: of the scene's own name, or else of the first scene that there is of it.
fn front(folder: &Path, scene: &Scene, model: &str) -> Result<Vec<Setting>> {
    let settings = Settings::load(folder)?;
    if settings.builds != [Identity::current().clone()] {
        let builds = listed(&settings.builds, ToString::to_string);
        eprintln!("note: {}: measured by another build ({builds}) than this one", folder.display());
    }
    let is_of_model = |text: &str| engines::Selection::parse(text).is_ok_and(|selection| selection.model.id == model);
    let subjects: Vec<Subject<'_>> =
        settings.subjects().into_iter().filter(|(_, density, _)| is_of_model(density)).collect();
    let (name, _, all) =
        subjects.iter().find(|(name, ..)| *name == scene.name).or(subjects.first()).ok_or_else(|| {
            let names: Vec<String> =
                settings.subjects().iter().map(|(name, density, _)| format!("{density} in {name}")).collect();
            Error::new(
                format!("--study {}", folder.display()),
                names.join("; "),
                format!("settings of {model}"),
                "Give --model, or another folder.",
            )
        })?;
    if *name != scene.name {
        eprintln!("note: {}: its settings were measured in {name}, and this scene is {}", folder.display(), scene.name);
    }
    Ok(settings::front(all, Metric::Relmse).into_iter().cloned().collect())
}

/// What the window knows of a setting.
fn choice_of(setting: &Setting) -> Choice {
    let error = setting.run.errors.relmse;
    Choice {
        words: setting.words.clone(),
        milliseconds_a_pixel: setting.milliseconds_a_pixel(),
        error: [error.value, error.standard_error],
    }
}

impl Viewed {
    /// What stands in the place of the options: a setting of the front, or the preset.
    fn base(&self, changes: &Changes) -> Option<&Preset> {
        changes.setting.map(|number| &self.front[number]).or(self.preset.as_ref())
    }

    /// The scene with the changes to its material.
    fn changed_scene(&self, changes: &Changes) -> Result<Scene> {
        let mut scene = self.scene.clone();
        changes.scene.iter().try_for_each(|(name, value)| scene.set(&format!("{name}={value}")))?;
        Ok(scene)
    }

    /// The preset with changes.
    fn changed_preset(&self, preset: &Preset, changes: &Changes) -> Result<Preset> {
        let mut preset = preset.clone();
        if let Some(quality) = &changes.quality {
            let model = engines::Selection::parse(&preset.engine.density)?.model;
            for (name, value) in model.values(Some(quality), &[])?.iter() {
                preset.parameters.insert(format!("density.{name}"), value);
            }
        }
        if let Some(light) = &changes.light {
            preset.engine.light = light.clone();
        }
        for (prefix, values) in [("scene.", &changes.scene), ("density.", &changes.density), ("", &changes.of_light)] {
            preset.parameters.extend(values.iter().map(|(name, value)| (format!("{prefix}{name}"), *value)));
        }
        Ok(preset)
    }

    /// The engine as it is now, as a preset.
    fn preset_of(&self, changes: &Changes) -> Result<Preset> {
        if let Some(preset) = self.base(changes) {
            return self.changed_preset(preset, changes);
        }
        let (_, engine) = self.engine(changes)?;
        let words: Vec<String> = engine.values.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let arguments = self.engine.changed(changes);
        let (light, texts) = arguments.light();
        let mut parameters = IndexMap::new();
        for text in texts {
            let (name, value) = parameters::assignment(text)?;
            parameters.insert(name.to_owned(), value);
        }
        parameters.extend(changes.scene.iter().map(|(name, value)| (format!("scene.{name}"), *value)));
        Ok(Preset {
            format: FORMAT.into(),
            builds: vec![crate::base::identity::Identity::current().clone()],
            title: format!("{} in {}, as it was looked at", engine.model, self.scene.name),
            engine: TunedEngine {
                density: std::iter::once(engine.model.to_owned()).chain(words).collect::<Vec<_>>().join(" "),
                light: light.to_owned(),
                steps: engine.march.steps,
                light_steps: engine.light.shadow.steps,
                cache: no_cache()[0],
                light_volume: None,
                sub_pixels: 1,
                defects: engine.defects.clone(),
            },
            parameters,
            provenance: json!({"from": "cloudparity view", SCENES: [&self.scene.name], "scene_sha256": self.scene.content_hash()}),
        })
    }

    /// A place of a name that is free, with a number that counts on.
    fn free(&self, name: impl Fn(u32) -> String) -> PathBuf {
        (1..).map(|number| self.folder.join(name(number))).find(|path| !path.exists()).expect("numbers do not end")
    }
}

impl Source for Viewed {
    fn scene(&self) -> &Scene {
        &self.scene
    }

    fn engine(&self, changes: &Changes) -> Result<(Scene, Engine)> {
        if let Some(preset) = self.base(changes) {
            let (scene, engine, _) = self.changed_preset(preset, changes)?.build_at(&self.scene, changes.seconds)?;
            return Ok((scene, engine));
        }
        let scene = self.changed_scene(changes)?;
        let engine = self.engine.changed(changes).silent(&scene, "graph")?;
        Ok((scene, engine))
    }

    fn truth(&self, changes: &Changes) -> Result<(Scene, Option<GivenMedium>)> {
        let (scene, engine, seconds) = match self.base(changes) {
            Some(preset) => {
                let mut preset = self.changed_preset(preset, changes)?;
                preset.engine.defects = Default::default();
                let (scene, engine, _) = preset.build_at(&self.scene, changes.seconds)?;
                (scene, engine, changes.seconds)
            }
            None => {
                let scene = self.changed_scene(changes)?;
                let arguments = self.engine.changed(changes).corrected();
                let engine = arguments.silent(&scene, "graph")?;
                (scene, engine, arguments.seconds())
            }
        };
        if engines::find(engine.model)?.is_of_scene {
            return Ok((at_time(&scene, seconds)?, None));
        }
        let identity = format!("{} after {seconds} s", engine.medium_identity());
        Ok((scene, Some(GivenMedium { identity, object: Arc::new(engine.medium()?) })))
    }

    fn pictures(&self) -> &[Image] {
        &self.pictures
    }

    fn flip(&self, ours: &Image, truth: &Image) -> Result<Option<f64>> {
        let folder = crate::base::temporary::folder()?;
        let [one, other] = ["ours.exr", "truth.exr"].map(|name| folder.path().join(name));
        ours.write_exr(&one, false)?;
        truth.write_exr(&other, false)?;
        let means = images::flip(&[FlipPair { ours: vec![one], reference: vec![other] }])?;
        Ok(means.first().copied())
    }

    fn view_transform(&self) -> Result<Option<DisplayTable>> {
        table(&self.scene.display, COLOURS)
    }

    fn sub_pixels(&self, changes: &Changes) -> u32 {
        self.base(changes).map_or(1, |preset| preset.engine.sub_pixels)
    }

    fn front(&self) -> &[Choice] {
        &self.choices
    }

    fn record(&self, record: &Record<'_>) -> Result<String> {
        let folder = self.free(|number| format!("pair-{number:03}"));
        files::make_folder(&folder, "a folder that can be made")?;
        let mut ours = record.shown.image.clone();
        ours.provenance.insert("milliseconds".into(), record.shown.milliseconds.to_string());
        ours.provenance.insert("worker".into(), record.shown.worker.clone());
        let path = folder.join("ours.exr");
        ours.write_exr(&path, false)?;
        let text = serde_json::to_string_pretty(record.scene).expect("a scene is JSON") + "\n";
        files::write_atomically(&folder.join("scene.json"), text.as_bytes())?;
        if record.truth.is_empty() {
            return Ok(format!("{}: the engine's picture; there is no truth of it yet", folder.display()));
        }
        let name = |number| folder.join(format!("truth.seed-{number}.exr"));
        let truth: Vec<PathBuf> = (0..record.truth.len()).map(name).collect();
        for (picture, path) in record.truth.iter().zip(&truth) {
            picture.write_exr(path, false)?;
        }
        let mut request = DiffRequest::new(vec![path], truth, Tolerances::default());
        request.out = Some(folder.clone());
        request.display = Some(DisplaySettings::of(&record.scene.display, None));
        let found =
            request.run(|script, request| bridge::run_script(script, request, CyclesKernel::Default, |_| ()))?;
        if record.truth.len() < errors::FEWEST_REPLICAS {
            let error = found.relmse.and_then(|relmse| relmse.pixel);
            let error = error.map_or(String::new(), |error| format!(", relMSE {error:.3e}"));
            let text = format!("{}: recorded{error}; its page: cloudparity report {0}", folder.display());
            return Ok(format!("{text}. recommend leaves it out: it needs {} truths", errors::FEWEST_REPLICAS));
        }
        let errors = errors::measure(&ours, record.truth)?;
        let (_, medium) = self.truth(record.changes)?;
        let medium = medium.map_or_else(|| format!("{} s", record.changes.seconds), |medium| medium.identity);
        Recorded {
            format: settings::FORMAT.into(),
            build: Identity::current().clone(),
            scene: record.scene.name.clone(),
            subject: Recorded::subject_of(record.scene, &medium),
            resolution: [ours.width as u32, ours.height as u32],
            preset: self.preset_of(record.changes)?,
            errors,
            flip: found.flip.and_then(|flip| flip.mean),
            milliseconds: record.shown.milliseconds,
            backend: record.backend,
            worker: record.shown.worker.clone(),
        }
        .write(&folder)?;
        let error = uncertain(errors.relmse.value, errors.relmse.standard_error);
        let places = [&folder, &self.folder].map(|folder| folder.display());
        Ok(format!(
            "{}: recorded, relMSE {error}; its page: cloudparity report {0}; of all pairs: cloudparity recommend {} --max-ms 50",
            places[0], places[1]
        ))
    }

    fn save_preset(&self, changes: &Changes) -> Result<String> {
        files::make_folder(&self.folder, "a folder that can be made")?;
        let path = self.free(|number| format!("view-{number:03}.preset.json"));
        self.preset_of(changes)?.write(&path)?;
        Ok(format!("{}: saved", path.display()))
    }
}
