//! Studies: error against time over scenes, density models, light models and quality settings.
//!
//! A study file names values on axes ([`mod@file`]). Every combination is rendered as an engine renders it, timed, and compared with path
//! tracing of the same medium ([`errors`]). Each result is a file of its own, named by what it depends on, so an interrupted study
//! goes on where it stopped and a changed one measures what is new. Nothing is measured beside anything else.
//!
//! Errors and times lead to the settings that nothing beats ([`front`]).

pub mod curves;
pub mod errors;
pub mod file;
pub mod front;
pub mod truth;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::base::ledger::{Ledger, Purpose, Sharing, read_record, to_json};
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::Kernel;
use crate::engines::Engine;
use crate::engines::light::models;
use crate::engines::render::EngineRenderer;
use crate::gpu::Gpu;
use crate::measure::pictures;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use curves::{CurvePoint, MissingCurve, Renderer};
use errors::Errors;
use file::{Combination, Skipped, StudyFile, Worker};
use front::Metric;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Instant;
use truth::TruthRecord;

/// Format of a study's folder.
pub const FORMAT: &str = "cloudparity-study-results/1";

/// The figures of a study: name and file without its extension.
pub const FIGURES: [(&str, &str); 3] =
    [("time", "study"), ("convergence", "study_convergence"), ("pictures", "study_pictures")];

/// Part of a ledger that holds runs.
const RUNS: &str = "runs";

/// Seeds of the truth count on from it.
const SEED: u32 = 7000;

/// Seeds of a second truth, against which a front is verified.
const VERIFYING_SEED: u32 = 8000;

/// Difference of two measurements of an error, in standard errors, up to which they agree. With the eight replicas of a truth by default
/// chance alone exceeds it once in 5,000 (14 degrees of freedom) to once in 600 tests (7).
const LARGEST_T: f64 = 5.0;

/// A study that is about to be run.
pub struct Study {
    file: StudyFile,
    scenes: Vec<Scene>,
    /// What is run, cheapest first.
    pub wanted: Vec<Combination>,
    /// What is left out.
    pub skipped: Vec<Skipped>,
}

/// What a run's seconds are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Clock {
    /// Processor time of all threads.
    #[default]
    Processor,
    /// Time that the adapter spent in its dispatches, by its timestamps.
    Timestamps,
}

impl Clock {
    /// The clock for runs on all cores, or on an adapter: software has no time of its own, and its work is that of the processor.
    fn of(gpu: Option<&Gpu>) -> Self {
        match gpu {
            Some(gpu) if gpu.has_timestamps() && !gpu.adapter().is_software() => Self::Timestamps,
            _ => Self::Processor,
        }
    }

    /// Seconds of work.
    fn time(self, gpu: Option<&Gpu>, work: impl FnOnce() -> Result<()>) -> Result<f64> {
        let begin = ProcessTime::now();
        let stamped = match gpu.filter(|_| self == Self::Timestamps) {
            Some(gpu) => gpu.timed(work)?.1.map(|times| times.seconds()),
            None => work().map(|()| None)?,
        };
        Ok(stamped.unwrap_or_else(|| begin.elapsed().as_secs_f64()))
    }

    /// Name for readers.
    pub fn label(self) -> &'static str {
        match self {
            Self::Processor => "processor time of all threads",
            Self::Timestamps => "time on the adapter by its timestamps",
        }
    }
}

/// Time of repeated renders in seconds, by the results' [`Clock`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Seconds {
    /// What counts.
    pub median: f64,
    /// The fastest.
    pub smallest: f64,
    /// The slowest.
    pub largest: f64,
}

/// What a combination came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Hash of all that it depends on.
    pub id: String,
    /// The settings.
    pub combination: Combination,
    /// Errors against the truth.
    pub errors: Errors,
    /// HDR-FLIP against the mean of the truth, where it could be computed.
    pub flip: Option<f64>,
    /// Time of a render.
    pub seconds: Seconds,
    /// Wall time of the median render.
    pub wall_seconds: f64,
    /// Processor time of what is done once: textures, caches.
    pub prepare_seconds: f64,
    /// relMSE times seconds: cost per unit of error; less is better.
    pub cost: f64,
    /// The picture, relative to the folder.
    pub picture: String,
    /// The truth, by its hash.
    pub truth: String,
}

impl Measured {
    /// Time, errors and settings in a line.
    pub fn describe(&self) -> String {
        format!(
            "{:8.2} ms, relMSE {:.4} ({:.4}), bias {:+.2} %{}: {}",
            1e3 * self.seconds.median,
            self.errors.relmse.value,
            self.errors.relmse.standard_error,
            100.0 * self.errors.bias.value,
            self.flip.map_or(String::new(), |flip| format!(", FLIP {flip:.4}")),
            self.combination.describe(),
        )
    }
}

/// Everything that a study found: `results.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// [`FORMAT`].
    pub format: String,
    /// The program's version.
    pub version: String,
    /// The builds that measured it; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// The study.
    pub study: StudyFile,
    /// What did the work.
    pub machine: String,
    /// What the runs' seconds are.
    #[serde(default)]
    pub clock: Clock,
    /// Truths.
    pub truths: Vec<TruthRecord>,
    /// Runs, cheapest first.
    pub runs: Vec<Measured>,
    /// Runs that no other of their scene and density beats in time and relMSE, by id.
    #[serde(default)]
    pub front: Vec<String>,
    /// Unbiased renderers' error against time, by samples.
    #[serde(default)]
    pub curves: Vec<CurvePoint>,
    /// Curves that could not be made, with the reason.
    #[serde(default)]
    pub missing_curves: Vec<MissingCurve>,
    /// Combinations that were left out, with the reason.
    pub skipped: Vec<Skipped>,
}

impl Study {
    /// Reads a study file and its scenes, and expands its axes.
    pub fn load(path: &Path) -> Result<Self> {
        let file = StudyFile::load(path)?;
        let scenes = file.scenes(path.parent().unwrap_or(Path::new(".")))?;
        Ok(Self::new(file, scenes))
    }

    /// A study over scenes that are there.
    pub fn new(file: StudyFile, scenes: Vec<Scene>) -> Self {
        let (wanted, skipped) = file.expand(&scenes);
        Self { file, scenes, wanted, skipped }
    }

    fn scene(&self, name: &str) -> &Scene {
        self.scenes.iter().find(|scene| scene.name == name).expect("combinations are of the study's scenes")
    }

    /// Renders what errors are measured against, and what takes longest: truths, and Cycles' pictures. What is there already is left
    /// alone; an interrupted truth goes on with the replicas that are missing. Says how long each truth took.
    pub fn prepare(&self, folder: &Path, resume: &Resume, progress: Progress<'_>) -> Result<Vec<TruthRecord>> {
        let ledger = open(folder, resume)?;
        let places = self.places();
        let mut records = Vec::new();
        for (index, combination) in places.iter().enumerate() {
            let (scene, density) = (self.scene(&combination.scene), combination.density.as_str());
            // What has no engine has no runs, and needs no truth. A density cache, which takes long, is not needed to know.
            let bare = Combination { cache: file::no_cache()[0], ..(*combination).clone() };
            if self.engine(scene, &bare).is_err() {
                continue;
            }
            let report = |done: f64, what: &str| progress((index as f64 + done) / places.len() as f64, what);
            let id = self.file.truth.id(&ledger, scene, density, SEED);
            records.push(self.file.truth.replicas(scene, density, &id, SEED, &ledger, &report)?.0);
            if self.file.curves.cycles.contains_key(density)
                && let Err(error) = self.cycles_picture(scene, density, &report)
            {
                log::warn!("the curve of Cycles is left out: {error}");
            }
        }
        Ok(records)
    }

    /// A combination of each scene and density, in the order of the axes.
    fn places(&self) -> Vec<&Combination> {
        let mut places: Vec<&Combination> = Vec::new();
        for scene in &self.scenes {
            for density in &self.file.axes.densities {
                let is_here = |one: &&Combination| one.scene == scene.name && one.density == *density;
                places.extend(self.wanted.iter().find(is_here));
            }
        }
        places
    }

    /// Measures what is missing in a folder, and sums up.
    pub fn run(&self, folder: &Path, resume: &Resume, progress: Progress<'_>) -> Result<Results> {
        let ledger = open(folder, resume)?;
        let gpu = self.adapter()?;
        let mut truths: HashMap<String, (TruthRecord, Option<Vec<Image>>)> = HashMap::new();
        let mut runs = Vec::with_capacity(self.wanted.len());
        let mut skipped = self.skipped.clone();
        for (index, combination) in self.wanted.iter().enumerate() {
            let done = index as f64 / self.wanted.len() as f64;
            let scene = self.scene(&combination.scene);
            let truth_id = self.file.truth.id(&ledger, scene, &combination.density, SEED);
            let id = self.run_id(&ledger, combination, &truth_id, gpu.as_ref());
            if let Some(found) = ledger.read::<Measured>(RUNS, &id)? {
                let is_known = truths.contains_key(&truth_id);
                if !is_known {
                    let entry = match truth::record(scene, &combination.density, &truth_id, &ledger)? {
                        Some(record) => (record, None),
                        None => {
                            let (record, images) = self.file.truth.replicas(
                                scene,
                                &combination.density,
                                &truth_id,
                                SEED,
                                &ledger,
                                progress,
                            )?;
                            (record, Some(images))
                        }
                    };
                    truths.insert(truth_id, entry);
                }
                runs.push(found);
                continue;
            }
            let mut skip = |error: Error| {
                skipped.push(Skipped { combination: combination.clone(), reason: error.to_string() });
            };
            let (engine, engine_seconds) = match self.engine(scene, combination) {
                Ok(engine) => engine,
                Err(error) => {
                    skip(error);
                    continue;
                }
            };
            let begin = ProcessTime::now();
            let renderer = match EngineRenderer::new(scene, &engine, gpu.as_ref()) {
                Ok(renderer) => renderer,
                Err(error) => {
                    skip(error);
                    continue;
                }
            };
            let prepare_seconds = engine_seconds + begin.elapsed().as_secs_f64();
            let entry = match truths.remove(&truth_id) {
                Some((record, Some(images))) => (record, images),
                _ => {
                    let report = |_: f64, what: &str| progress(done, what);
                    self.file.truth.replicas(scene, &combination.density, &truth_id, SEED, &ledger, &report)?
                }
            };
            progress(done, &format!("run {} of {}", index + 1, self.wanted.len()));
            let (image, seconds, wall_seconds) = self.time(&renderer, gpu.as_ref(), combination)?;
            let picture = format!("pictures/{id}.exr");
            image.write_exr(&folder.join(&picture), false)?;
            let errors = errors::measure(&image, &entry.1)?;
            let found = Measured {
                id,
                combination: combination.clone(),
                errors,
                flip: None,
                seconds,
                wall_seconds,
                prepare_seconds,
                cost: errors.relmse.value * seconds.median,
                picture,
                truth: truth_id.clone(),
            };
            truths.insert(truth_id, (entry.0, Some(entry.1)));
            ledger.write(RUNS, &found.id, &found)?;
            runs.push(found);
        }
        let mut truths: Vec<TruthRecord> = truths.into_values().map(|(record, _)| record).collect();
        truths.sort_by(|a, b| (&a.scene, &a.density).cmp(&(&b.scene, &b.density)));
        let (curves, missing_curves) = self.curves(&truths, &ledger, progress)?;
        let mut results = Results {
            format: FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            builds: ledger.builds(),
            study: self.file.clone(),
            machine: match &gpu {
                Some(gpu) => format!("{}; adapter {} ({})", machine(), gpu.adapter().name, gpu.adapter().driver),
                None => machine(),
            },
            clock: Clock::of(gpu.as_ref()),
            truths,
            runs,
            front: Vec::new(),
            curves,
            missing_curves,
            skipped,
        };
        results.front = results.fronts().into_iter().flat_map(|(_, _, runs)| runs).map(|run| run.id.clone()).collect();
        results.write(folder)?;
        if let Err(error) = results.add_flip(&ledger) {
            log::warn!("HDR-FLIP is left out: {error}");
        }
        results.write(folder)?;
        Ok(results)
    }

    /// The curves of unbiased renderers, and those that could not be made: Cycles' need bpy where the cache has no picture.
    fn curves(
        &self,
        truths: &[TruthRecord],
        ledger: &Ledger,
        progress: Progress<'_>,
    ) -> Result<(Vec<CurvePoint>, Vec<MissingCurve>)> {
        let (mut points, mut missing) = (Vec::new(), Vec::new());
        let folder = ledger.folder().expect("a study is kept");
        for record in truths {
            let scene = self.scene(&record.scene);
            let place = curves::Place { scene, density: &record.density, truth: record };
            let mut images = None;
            let mut truth = || -> Result<Vec<Image>> {
                if images.is_none() {
                    images = Some(record.read(folder)?);
                }
                Ok(images.clone().unwrap_or_default())
            };
            progress(1.0, &format!("path tracing of {} in {}", record.density, record.scene));
            points.extend(self.path_curve(&place, ledger, &mut truth)?);
            match self.cycles_curve(&place, ledger, &mut truth, progress) {
                Ok(found) => points.extend(found),
                Err(error) => missing.push(MissingCurve {
                    renderer: Renderer::Cycles,
                    scene: record.scene.clone(),
                    density: record.density.clone(),
                    reason: error.to_string(),
                }),
            }
        }
        Ok((points, missing))
    }

    /// The engine of a combination, and the processor time that it took to make it.
    fn engine(&self, scene: &Scene, combination: &Combination) -> Result<(Engine, f64)> {
        let begin = ProcessTime::now();
        let mut engine = combination.engine(scene, &[])?;
        models::find(&combination.light)?.apply(&mut engine.light)?;
        Ok((engine, begin.elapsed().as_secs_f64()))
    }

    /// The adapter, where the runs are rendered on it.
    fn adapter(&self) -> Result<Option<Gpu>> {
        match self.file.timing.on {
            Worker::Cpu => Ok(None),
            Worker::Adapter => Gpu::open().map(Some),
        }
    }

    /// The picture of a combination, the time of repeated renders, and the wall time of the median one.
    fn time(
        &self,
        renderer: &EngineRenderer<'_>,
        gpu: Option<&Gpu>,
        combination: &Combination,
    ) -> Result<(Image, Seconds, f64)> {
        let settings = combination.picture_settings();
        let render = || renderer.picture(&settings, &|_, _| ());
        // The first does not count: memory and caches are cold.
        let image = render()?;
        let mut times = Vec::with_capacity(self.file.timing.repeats as usize);
        for _ in 0..self.file.timing.repeats {
            let wall = Instant::now();
            let seconds = Clock::of(gpu).time(gpu, || render().map(drop))?;
            times.push((seconds, wall.elapsed().as_secs_f64()));
        }
        times.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (median, wall_seconds) = times[times.len() / 2];
        Ok((image, Seconds { median, smallest: times[0].0, largest: times[times.len() - 1].0 }, wall_seconds))
    }

    fn run_id(&self, ledger: &Ledger, combination: &Combination, truth_id: &str, gpu: Option<&Gpu>) -> String {
        let mut key = json!({"combination": combination, "truth": truth_id, "timing": self.file.timing});
        if let Some(gpu) = gpu {
            key["adapter"] = json!(gpu.adapter());
        }
        ledger.key(&key)
    }

    /// Measures the front of an earlier run again from scratch: new truths, new renders. Each pair of errors has to agree within the
    /// uncertainty that both state.
    pub fn verify(
        &self,
        results: &Results,
        folder: &Path,
        resume: &Resume,
        progress: Progress<'_>,
    ) -> Result<Vec<Verified>> {
        let ledger = open(folder, resume)?;
        let gpu = self.adapter()?;
        let mut found = Vec::new();
        let fronts: Vec<&Measured> = results.fronts().into_iter().flat_map(|(_, _, runs)| runs).collect();
        let mut truths: HashMap<String, Vec<Image>> = HashMap::new();
        for (index, run) in fronts.iter().enumerate() {
            progress(index as f64 / fronts.len() as f64, "front");
            let scene = self.scene(&run.combination.scene);
            let truth_id = self.file.truth.id(&ledger, scene, &run.combination.density, VERIFYING_SEED);
            if !truths.contains_key(&truth_id) {
                let report = |_: f64, what: &str| progress(index as f64 / fronts.len() as f64, what);
                let (_, images) = self.file.truth.replicas(
                    scene,
                    &run.combination.density,
                    &truth_id,
                    VERIFYING_SEED,
                    &ledger,
                    &report,
                )?;
                truths.insert(truth_id.clone(), images);
            }
            let (engine, _) = self.engine(scene, &run.combination)?;
            let renderer = EngineRenderer::new(scene, &engine, gpu.as_ref())?;
            let image = renderer.picture(&run.combination.picture_settings(), &|_, _| ())?;
            let again = errors::measure(&image, &truths[&truth_id])?;
            found.push(Verified::new(run, again));
        }
        Ok(found)
    }
}

/// An error that was measured twice.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verified {
    /// The run.
    pub id: String,
    /// Its settings.
    pub combination: Combination,
    /// relMSE as the study says.
    pub first: errors::Uncertain,
    /// relMSE against a new truth.
    pub second: errors::Uncertain,
    /// Difference over its standard error.
    pub t: f64,
    /// Whether they agree.
    pub agrees: bool,
}

impl Verified {
    fn new(run: &Measured, again: Errors) -> Self {
        let (first, second) = (run.errors.relmse, again.relmse);
        let error = first.standard_error.hypot(second.standard_error);
        let difference = second.value - first.value;
        let t = if difference == 0.0 { 0.0 } else { difference / error };
        let agrees = t.abs() <= LARGEST_T;
        Self { id: run.id.clone(), combination: run.combination.clone(), first, second, t, agrees }
    }
}

/// Runs of one scene and density.
type Group<'a> = (&'a str, &'a str, Vec<&'a Measured>);

impl Results {
    /// Reads what a study left in a folder.
    pub fn load(folder: &Path) -> Result<Self> {
        let path = folder.join("results.json");
        read_record(&path)?.ok_or_else(|| {
            Error::new(
                path.display().to_string(),
                "no results",
                "the folder of a study that has run",
                "Run cloudparity study FILE -o FOLDER first.",
            )
        })
    }

    /// Runs by scene and density, in the order in which these come.
    pub fn groups(&self) -> Vec<Group<'_>> {
        let mut groups: Vec<Group<'_>> = Vec::new();
        for run in &self.runs {
            let key = (run.combination.scene.as_str(), run.combination.density.as_str());
            match groups.iter_mut().find(|group| (group.0, group.1) == key) {
                Some(group) => group.2.push(run),
                None => groups.push((key.0, key.1, vec![run])),
            }
        }
        groups
    }

    /// `results.json` and `results.csv`.
    fn write(&self, folder: &Path) -> Result<()> {
        files::write_atomically(&folder.join("results.json"), to_json(self).as_bytes())?;
        files::write_atomically(&folder.join("results.csv"), self.csv().as_bytes())
    }

    /// One line per run, with every setting and figure; names hold neither commas nor quotes but for scenes' and defects, which are quoted.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "scene,density,light,steps,light_steps,cache_cells,cache_format,sub_pixels,jitter,defects,seconds,seconds_smallest,\
             seconds_largest,wall_seconds,prepare_seconds,relmse,relmse_standard_error,rms,rms_standard_error,bias,\
             bias_standard_error,flip,cost,on_front\n",
        );
        for run in &self.runs {
            let Combination { scene, density, light, steps, light_steps, cache, sub_pixels, jitter, defects } =
                &run.combination;
            let fields = [
                format!("\"{}\"", scene.replace('"', "\"\"")),
                density.clone(),
                light.clone(),
                steps.to_string(),
                light_steps.to_string(),
                cache.cells.to_string(),
                files::word(&cache.format),
                sub_pixels.to_string(),
                files::word(jitter),
                format!("\"{defects}\""),
                run.seconds.median.to_string(),
                run.seconds.smallest.to_string(),
                run.seconds.largest.to_string(),
                run.wall_seconds.to_string(),
                run.prepare_seconds.to_string(),
                run.errors.relmse.value.to_string(),
                run.errors.relmse.standard_error.to_string(),
                run.errors.rms.value.to_string(),
                run.errors.rms.standard_error.to_string(),
                run.errors.bias.value.to_string(),
                run.errors.bias.standard_error.to_string(),
                run.flip.map(|flip| flip.to_string()).unwrap_or_default(),
                run.cost.to_string(),
                self.front.contains(&run.id).to_string(),
            ];
            text += &(fields.join(",") + "\n");
        }
        text
    }

    /// The runs that nothing beats in time and relMSE, by scene and density.
    pub fn fronts(&self) -> Vec<Group<'_>> {
        let groups = self.groups().into_iter();
        groups.map(|(scene, density, runs)| (scene, density, front::front(runs, Metric::Relmse))).collect()
    }

    /// Draws [`FIGURES`] as `.svg`, `.png` and `.pdf`. Needs matplotlib, and HDR-FLIP for the pictures.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        let truth = |id: &str| self.truths.iter().find(|record| record.id == id).map(|record| &record.replicas);
        let groups: Vec<serde_json::Value> = self
            .groups()
            .into_iter()
            .map(|(scene, density, runs)| {
                let front: Vec<&str> =
                    front::front(runs.iter().copied(), Metric::Relmse).iter().map(|run| run.id.as_str()).collect();
                let is_here = |point: &&CurvePoint| point.scene == scene && point.density == density;
                let curves: Vec<&CurvePoint> = self.curves.iter().filter(is_here).collect();
                let truth = truth(&runs[0].truth);
                json!({"scene": scene, "density": density, "runs": runs, "front": front, "curves": curves, "truth": truth})
            })
            .collect();
        let figures: serde_json::Map<String, serde_json::Value> = FIGURES
            .iter()
            .map(|(name, stem)| {
                let file = |extension: &str| folder.join(format!("{stem}.{extension}"));
                ((*name).to_owned(), json!({"svg": file("svg"), "png": file("png"), "pdf": file("pdf")}))
            })
            .collect();
        let request = json!({
            "title": self.study.title, "clock": self.clock.label(), "groups": groups, "folder": folder,
            "figures": figures,
        });
        bridge::run_script("study_plot.py", &request, Kernel::Default, |_| ()).map(drop)
    }

    /// Computes HDR-FLIP where it is missing, in one run of the script, and keeps it in the files of runs and curves.
    fn add_flip(&mut self, ledger: &Ledger) -> Result<()> {
        let folder = ledger.folder().expect("a study is kept");
        let truths: HashMap<&str, &TruthRecord> =
            self.truths.iter().map(|record| (record.id.as_str(), record)).collect();
        let runs = self.runs.iter_mut().map(|run| (&run.picture, &run.truth, &mut run.flip));
        let points = self.curves.iter_mut().map(|point| (&point.picture, &point.truth, &mut point.flip));
        let missing: Vec<_> = runs.chain(points).filter(|(.., flip)| flip.is_none()).collect();
        if missing.is_empty() {
            return Ok(());
        }
        let pairs: Vec<serde_json::Value> = missing
            .iter()
            .map(|(picture, truth, _)| {
                let reference: Vec<PathBuf> =
                    truths[truth.as_str()].replicas.iter().map(|name| folder.join(name)).collect();
                json!({"ours": [folder.join(picture)], "reference": reference})
            })
            .collect();
        let request = json!({"op": "flip", "pairs": pairs});
        let found = bridge::run_script(pictures::SCRIPT, &request, Kernel::Default, |_| ())?;
        let changed: Vec<String> = missing.iter().map(|(picture, ..)| (*picture).clone()).collect();
        for (position, (.., flip)) in missing.into_iter().enumerate() {
            *flip = found["means"][position].as_f64();
        }
        for run in self.runs.iter().filter(|run| changed.contains(&run.picture)) {
            ledger.write(RUNS, &run.id, run)?;
        }
        self.curves.iter().filter(|point| changed.contains(&point.picture)).try_for_each(|point| point.write(ledger))
    }
}

/// What the folder of a study is for.
const PURPOSE: Purpose = Purpose { mark: "study.json", format: FORMAT, of: serde_json::Value::Null };

/// The ledger of a study.
fn open(folder: &Path, resume: &Resume) -> Result<Ledger> {
    Ledger::open(folder, PURPOSE, resume, Sharing::Alone)
}

/// Whether the study in a folder is not, or not only, of this build.
pub fn is_of_another_build(folder: &Path) -> Result<bool> {
    Ok(PURPOSE.builds(folder)?.is_none_or(|builds| builds != [Identity::current().clone()]))
}

/// What does the work.
pub(crate) fn machine() -> String {
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    format!("{} {}, {threads} threads", std::env::consts::OS, std::env::consts::ARCH)
}

#[cfg(test)]
mod tests {
    use super::file::CacheAxis;
    use super::*;
    use crate::engines::defects::Defects;
    use crate::engines::render::EngineJitter;
    use crate::media::density_cache::CacheFormat;
    use errors::Uncertain;

    /// A run of so many seconds and such a relMSE.
    pub fn run_of(seconds: f64, relmse: f64) -> Measured {
        let exact = |value| Uncertain { value, standard_error: 0.0 };
        Measured {
            id: format!("{seconds}-{relmse}"),
            combination: Combination {
                scene: "scene".into(),
                density: "graph".into(),
                light: "single".into(),
                steps: 1,
                light_steps: 1,
                cache: CacheAxis { cells: 0, format: CacheFormat::F16 },
                sub_pixels: 1,
                jitter: EngineJitter::None,
                defects: Defects::NONE,
            },
            errors: Errors { relmse: exact(relmse), rms: exact(0.0), bias: exact(0.0) },
            flip: None,
            seconds: Seconds { median: seconds, smallest: seconds, largest: seconds },
            wall_seconds: seconds,
            prepare_seconds: 0.0,
            cost: seconds * relmse,
            picture: String::new(),
            truth: String::new(),
        }
    }
}
