//! Settings of an engine whose error and time are known, whoever measured them: a study, or a person who recorded pairs in the window.
//!
//! A recorded pair has a file `record.json` in its folder ([`Recorded`]). Pairs of one view, medium and size are comparable, as the runs of
//! one scene and density of a study are: a *subject*.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{read_record, to_json};
use crate::engines::{Selection, parameters};
use crate::gpu::Backend;
use crate::measure::combination::Combination;
use crate::measure::errors::Errors;
use crate::measure::scenes::SceneAxis;
use crate::measure::study::pareto_front::{self, Metric};
use crate::measure::study::{Measured, Results};
use crate::measure::timing::{Clock, Seconds};
use crate::measure::tuning::file::{Owner, owner};
use crate::measure::tuning::preset::Preset;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;

/// Format of a recorded pair.
pub const FORMAT: &str = "cloudparity-record/1";

/// Name of its file.
pub const FILE: &str = "record.json";

/// An engine's picture that a person recorded beside the truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recorded {
    /// [`FORMAT`].
    pub format: String,
    /// The build that made both.
    pub build: Identity,
    /// Name of the scene.
    pub scene: String,
    /// Hash of what the truth is of: view, lights, size, medium. Errors of equal ones are comparable.
    pub subject: String,
    /// Pixels.
    pub resolution: [u32; 2],
    /// The engine.
    pub preset: Preset,
    /// Errors against the replicas of the truth.
    pub errors: Errors,
    /// HDR-FLIP against their mean, where it could be computed.
    pub flip: Option<f64>,
    /// Wall time of the picture in milliseconds, without preparation.
    pub milliseconds: f64,
    /// Where it was made.
    pub backend: Backend,
    /// Processor or adapter, in words.
    pub worker: String,
}

impl Recorded {
    /// Writes it into the folder of its pair.
    pub fn write(&self, folder: &Path) -> Result<()> {
        files::write_atomically(&folder.join(FILE), to_json(self).as_bytes())
    }

    /// The hash of a subject: of the scene as it was looked at, and of what its medium is beside it.
    pub fn subject_of(scene: &Scene, medium: &str) -> String {
        files::sha256(format!("{} {medium}", scene.content_hash()).as_bytes())
    }

    fn load(path: &Path) -> Result<Option<Self>> {
        let Some(found) = read_record::<Self>(path)? else { return Ok(None) };
        if found.format == FORMAT {
            return Ok(Some(found));
        }
        Err(Error::new(
            format!("{}, $.format", path.display()),
            format!("\"{}\"", found.format),
            format!("\"{FORMAT}\""),
            "Record the pair again, or move its folder away.",
        ))
    }
}

/// A setting with its error and time.
#[derive(Debug, Clone)]
pub struct Setting {
    /// Errors and times. Its combination's scene and density are the subject's names.
    pub run: Measured,
    /// The setting itself.
    pub preset: Preset,
    /// What was set, in words.
    pub words: String,
    /// Pixels of its picture.
    pub resolution: [u32; 2],
    /// Where it was made.
    pub backend: Backend,
    /// The scene's file, and how it was changed; none where that is not known.
    pub scene: Option<SceneAxis>,
}

impl Setting {
    /// Time, errors and settings in a line.
    pub fn describe(&self) -> String {
        format!("{}: {}", self.run.figures(), self.words)
    }

    /// Milliseconds of processor, adapter or wall a pixel, by the clock of its [`Settings`].
    pub fn milliseconds_a_pixel(&self) -> f64 {
        let [width, height] = self.resolution.map(f64::from);
        1e3 * self.run.seconds.median / (width * height)
    }
}

/// All settings of a folder.
pub struct Settings {
    /// The builds that measured them.
    pub builds: Vec<Identity>,
    /// What made the pictures.
    pub machine: String,
    /// What their seconds are.
    pub clock: Clock,
    /// The settings.
    pub list: Vec<Setting>,
}

/// Settings of one subject: scene, density, settings.
pub type Subject<'a> = (&'a str, &'a str, Vec<&'a Setting>);

impl Settings {
    /// Reads what a study left in a folder, or the pairs that were recorded in it.
    pub fn load(folder: &Path) -> Result<Self> {
        if !folder.join("results.json").exists() {
            let found = Self::of_pairs(folder)?;
            if !found.list.is_empty() {
                return Ok(found);
            }
        }
        Self::of_study(&Results::load(folder)?)
    }

    /// The runs of a study.
    pub fn of_study(results: &Results) -> Result<Self> {
        let axes = results.study.axes.scenes.as_slice();
        let setting = |run: &Measured| {
            let Combination { scene, density, .. } = &run.combination;
            let provenance = json!({
                "study": results.study.title, "scene": scene, "resolution": results.study.resolution, "clock": results.clock,
                "machine": results.machine, "seconds": run.seconds, "errors": run.errors, "flip": run.flip,
            });
            let title = format!("{density} in {scene}: {}", run.combination.describe());
            let named = axes.iter().find(|axis| axis.name.as_deref() == Some(scene));
            Ok(Setting {
                preset: Preset::of_combination(&run.combination, title, results.builds.clone(), provenance)?,
                words: run.combination.describe(),
                resolution: results.study.resolution,
                backend: results.study.timing.backend,
                scene: named.or(if let [only] = axes { Some(only) } else { None }).cloned(),
                run: run.clone(),
            })
        };
        Ok(Self {
            builds: results.builds.clone(),
            machine: results.machine.clone(),
            clock: results.clock,
            list: results.runs.iter().map(setting).collect::<Result<_>>()?,
        })
    }

    /// Pairs in the folders of a folder, in the order of their names.
    fn of_pairs(folder: &Path) -> Result<Self> {
        let mut folders: Vec<_> =
            std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        folders.sort();
        let mut subjects: Vec<(String, String)> = Vec::new();
        let mut found = Self { builds: Vec::new(), machine: String::new(), clock: Clock::Wall, list: Vec::new() };
        let mut workers: Vec<String> = Vec::new();
        for pair in folders {
            let Some(record) = Recorded::load(&pair.join(FILE))? else { continue };
            if !subjects.iter().any(|(hash, _)| *hash == record.subject) {
                let before =
                    subjects.iter().filter(|(_, name)| name.split(", view ").next() == Some(&record.scene)).count();
                let name = match before {
                    0 => record.scene.clone(),
                    before => format!("{}, view {}", record.scene, before + 1),
                };
                subjects.push((record.subject.clone(), name));
            }
            let (_, name) = subjects.iter().find(|(hash, _)| *hash == record.subject).expect("it was just put there");
            if !found.builds.contains(&record.build) {
                found.builds.push(record.build.clone());
            }
            if !workers.contains(&record.worker) {
                workers.push(record.worker.clone());
            }
            found.list.push(of_pair(record, name, &pair)?);
        }
        found.machine = workers.join("; ");
        Ok(found)
    }

    /// Settings by scene and density, in the order in which these come.
    pub fn subjects(&self) -> Vec<Subject<'_>> {
        let mut subjects: Vec<Subject<'_>> = Vec::new();
        for setting in &self.list {
            let key = (setting.run.combination.scene.as_str(), setting.run.combination.density.as_str());
            match subjects.iter_mut().find(|one| (one.0, one.1) == key) {
                Some(one) => one.2.push(setting),
                None => subjects.push((key.0, key.1, vec![setting])),
            }
        }
        subjects
    }
}

/// The settings of a subject that no other beats in time and error, by rising time.
pub fn front<'a>(settings: &[&'a Setting], metric: Metric) -> Vec<&'a Setting> {
    let front = pareto_front::pareto_front(settings.iter().map(|setting| &setting.run), metric);
    let of = |run: &Measured| settings.iter().copied().find(|setting| std::ptr::eq(&setting.run, run));
    front.into_iter().filter_map(of).collect()
}

fn of_pair(record: Recorded, scene: &str, folder: &Path) -> Result<Setting> {
    let Recorded { preset, errors, flip, milliseconds, resolution, backend, subject, .. } = record;
    let mut combination = preset.engine.combination(scene);
    let words = words(&preset)?;
    combination.density = Selection::parse(&preset.engine.density)?.model.id.to_owned();
    let seconds = milliseconds / 1e3;
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(Setting {
        run: Measured {
            id: name.clone(),
            combination,
            errors,
            flip,
            seconds: Seconds { median: seconds, smallest: seconds, largest: seconds },
            wall_seconds: seconds,
            prepare_seconds: 0.0,
            cost: errors.relmse.value * seconds,
            picture: format!("{name}/ours.exr"),
            truth: subject,
        },
        preset,
        words: format!("{name}: {words}"),
        resolution,
        backend,
        scene: Some(SceneAxis::new(folder.join("scene.json").display().to_string())),
    })
}

/// What a preset sets, where it is not what the system and its light have anyway.
fn words(preset: &Preset) -> Result<String> {
    let combination = preset.engine.combination("");
    let Selection { model, settings } = Selection::parse(&preset.engine.density)?;
    let defaults = parameters::Values::defaults(model.parameters);
    let mut texts = vec![Combination { light: preset.engine.light.clone(), ..combination }.describe()];
    let mut density: Vec<(String, f64)> = Vec::new();
    for text in &settings {
        let (name, value) = parameters::assignment(text)?;
        density.push((name.to_owned(), value));
    }
    for (name, &value) in &preset.parameters {
        match owner(name) {
            (Owner::Density, own) => {
                density.retain(|(other, _)| other != own);
                density.push((own.to_owned(), value));
            }
            (Owner::Light, _) | (Owner::Scene, _) => texts.push(format!("{name}={value}")),
        }
    }
    let is_said = |name: &str| ["march_steps", "light_steps"].contains(&name);
    let changed = density.iter().filter(|(name, value)| !is_said(name) && defaults.given(name) != Some(*value));
    texts.extend(changed.map(|(name, value)| format!("{name}={value}")));
    Ok(texts.join(", "))
}
