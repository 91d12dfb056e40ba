//! Tuning: free parameters of an engine, fitted to path tracing on some views and judged on others.
//!
//! A tuning file names an engine of fixed quality, ranges of parameters, and views ([`mod@file`]). CMA-ES (Hansen and Ostermeier 2001,
//! "Completely Derandomized Self-Adaptation in Evolution Strategies", in its reference library) lowers the mean error of the training views. The
//! result stands beside every published light model with its exposure matched to the same training views, so that it is not compared
//! with a bad start; both are judged on views that no search has seen. Every generation is kept as soon as it is measured: the same seed
//! and errors make the same candidates, so an interrupted search is told what it had and goes on.

pub mod file;
pub mod preset;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::base::ledger::{Ledger, Purpose, Sharing, read_record, to_json};
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::{Conversation, Kernel};
use crate::engines::Engine;
use crate::engines::light::LightModel;
use crate::engines::light::models::LIGHTS;
use crate::engines::render::{EngineJitter, EngineRenderer};
use crate::measure::study::errors;
use crate::measure::study::errors::Errors;
use crate::measure::study::file::{Combination, load_scenes};
use crate::measure::study::machine;
use crate::measure::study::truth::TruthRecord;
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use file::{Objective, TuningFile};
use indexmap::IndexMap;
use preset::Preset;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};

/// Format of a tuning's folder.
pub const FORMAT: &str = "cloudparity-tuning/1";

/// Part of a ledger that holds generations, by their number: that a search is the same is checked with its candidates.
const SEARCH: &str = "search";

/// Seeds of the truths count on from it.
const SEED: u32 = 9000;

/// Timed renders of a view; their median counts.
const REPEATS: usize = 3;

/// Factor on steps, light steps and rays per axis of the picture that shows what sampling makes of the error.
const FINER: u32 = 3;

/// How far a candidate that is made again may be from the one that was kept: what writing a number in decimals leaves.
const SAME: f64 = 1e-12;

/// A search that is about to be made.
pub struct Tuning {
    file: TuningFile,
    train: Vec<Scene>,
    held_out: Vec<Scene>,
}

/// The error of a picture in a view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ViewError {
    /// Name of the view.
    pub view: String,
    /// Mean HDR-FLIP against the mean of the truth.
    pub flip: f64,
    /// Errors against the truth.
    pub errors: Errors,
    /// The picture, relative to the folder.
    pub picture: String,
}

/// Settings and how good they are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scored {
    /// What it is: a light model's name, or "tuned".
    pub name: String,
    /// Factor on its light: matched to the training views, or tuned.
    pub exposure: f64,
    /// Training views.
    pub train: Vec<ViewError>,
    /// Views that the search has not seen.
    pub held_out: Vec<ViewError>,
    /// Processor seconds of a picture, mean over all views.
    pub seconds: f64,
}

impl Scored {
    /// Mean HDR-FLIP of views.
    pub fn mean_flip(views: &[ViewError]) -> f64 {
        views.iter().map(|view| view.flip).sum::<f64>() / views.len() as f64
    }

    /// Mean relMSE of views.
    pub fn mean_relmse(views: &[ViewError]) -> f64 {
        views.iter().map(|view| view.errors.relmse.value).sum::<f64>() / views.len() as f64
    }
}

/// A generation of the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Generation {
    /// Points of the unit cube.
    pub candidates: Vec<Vec<f64>>,
    /// Mean error of the training views, each.
    pub objectives: Vec<f64>,
}

/// What a tuning came to: `tuning.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// [`FORMAT`].
    pub format: String,
    /// The program's version.
    pub version: String,
    /// The builds that rendered and judged; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// The tuning file.
    pub file: TuningFile,
    /// What did the work.
    pub machine: String,
    /// The library that searched.
    pub optimiser: String,
    /// Why the search ended.
    pub stopped: Vec<String>,
    /// Candidates that were measured.
    pub evaluations: usize,
    /// Least and median error of each generation.
    pub history: Vec<[f64; 2]>,
    /// Truths: training views, then held-out ones.
    pub truths: Vec<TruthRecord>,
    /// Mean HDR-FLIP of two halves of the truth's replicas: what noise alone makes, at half the samples.
    pub noise_flip: f64,
    /// Published light models, exposure matched to the training views, best first by held-out HDR-FLIP.
    pub published: Vec<Scored>,
    /// The tuned engine.
    pub tuned: Scored,
    /// The tuned parameters at a higher quality: three times the steps, light steps and rays per pixel and axis. What its error still is,
    /// the light model cannot express.
    pub finer: Scored,
    /// Its parameters.
    pub parameters: IndexMap<String, f64>,
}

impl Outcome {
    /// By what share of the best published light model's held-out HDR-FLIP the tuned engine's is lower.
    pub fn improvement(&self) -> f64 {
        1.0 - Scored::mean_flip(&self.tuned.held_out) / Scored::mean_flip(&self.published[0].held_out)
    }

    /// Reads what a tuning left in a folder.
    pub fn load(folder: &Path) -> Result<Option<Self>> {
        read_record(&folder.join("tuning.json"))
    }
}

/// A scene with its truth and engine.
struct View {
    scene: Scene,
    engine: Engine,
    /// The engine's light without any light model's settings.
    own_light: LightModel,
    record: TruthRecord,
    truth: Vec<Image>,
}

impl Tuning {
    /// Reads a tuning file and its scenes.
    pub fn load(path: &Path) -> Result<Self> {
        let file = TuningFile::load(path)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        let train = load_scenes(&file.train, folder, file.resolution, "train")?;
        let held_out = load_scenes(&file.held_out, folder, file.resolution, "held_out")?;
        if let Some(scene) = held_out.iter().find(|scene| train.iter().any(|other| other.name == scene.name)) {
            return Err(Error::new(
                "held_out",
                format!("the view \"{}\"", scene.name),
                "views that training does not have",
                "Give it another name, and another sun or camera.",
            ));
        }
        Ok(Self { file, train, held_out })
    }

    /// Renders truths, searches, and judges; what is in the folder already is not made again.
    pub fn run(&self, folder: &Path, resume: &Resume, progress: Progress<'_>) -> Result<Outcome> {
        let ledger = open(folder, &self.file, resume)?;
        let count = self.train.len() + self.held_out.len();
        let mut views = Vec::with_capacity(count);
        for (index, scene) in self.train.iter().chain(&self.held_out).enumerate() {
            let report = |done: f64, what: &str| progress((index as f64 + done) / count as f64, what);
            views.push(self.view(scene, &ledger, &report)?);
        }
        let mut conversation = Conversation::start("optimiser.py", Kernel::Default)?;
        let files: Vec<Vec<PathBuf>> =
            views.iter().map(|view| view.record.replicas.iter().map(|name| folder.join(name)).collect()).collect();
        conversation.ask(&json!({"op": "truths", "views": files}), |_| ())?;
        let (best, found) = self.search(&ledger, &mut views, &mut conversation, progress)?;
        progress(1.0, "published light models");
        let noise_flip = noise_flip(folder, &views, &mut conversation)?;
        let mut published = Vec::new();
        for named in LIGHTS {
            let mut light = IndexMap::new();
            light.insert("exposure".to_owned(), self.matched(folder, &mut views, named.id, &mut conversation)?);
            published.push(self.score(folder, &mut views, named.id, named.id, &light, &mut conversation)?);
        }
        published.sort_by(|a, b| Scored::mean_flip(&a.held_out).total_cmp(&Scored::mean_flip(&b.held_out)));
        let tuned = self.score(folder, &mut views, "tuned", &self.file.engine.light, &best, &mut conversation)?;
        let finer = self.finer().score_anew(folder, &mut views, &best, &mut conversation)?;
        let outcome = Outcome {
            format: FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            builds: ledger.builds(),
            file: self.file.clone(),
            machine: machine(),
            optimiser: found.library,
            stopped: found.stopped,
            evaluations: found.generations.iter().map(|generation| generation.objectives.len()).sum(),
            history: found.generations.iter().map(Generation::summary).collect(),
            truths: views.iter().map(|view| view.record.clone()).collect(),
            noise_flip,
            published,
            tuned,
            finer,
            parameters: best,
        };
        files::write_atomically(&folder.join("tuning.json"), to_json(&outcome).as_bytes())?;
        let preset = Preset::of(&outcome);
        files::write_atomically(&folder.join("tuned.preset.json"), to_json(&preset).as_bytes())?;
        Ok(outcome)
    }

    fn view(&self, scene: &Scene, ledger: &Ledger, progress: Progress<'_>) -> Result<View> {
        let density = &self.file.engine.density;
        let id = self.file.truth.id(ledger, scene, density, SEED);
        let (record, truth) = self.file.truth.replicas(scene, density, &id, SEED, ledger, progress)?;
        let engine = self.combination(scene).engine(scene, &[])?;
        let own_light = engine.light.clone();
        Ok(View { scene: scene.clone(), engine, own_light, record, truth })
    }

    fn combination(&self, scene: &Scene) -> Combination {
        self.file.engine.combination(&scene.name)
    }

    /// The same tuning at a higher quality.
    fn finer(&self) -> Self {
        let mut file = self.file.clone();
        file.engine.steps *= FINER;
        file.engine.light_steps *= FINER;
        file.engine.sub_pixels *= FINER;
        Self { file, train: self.train.clone(), held_out: self.held_out.clone() }
    }

    /// The score of parameters with engines of this quality.
    fn score_anew(
        &self,
        folder: &Path,
        views: &mut [View],
        values: &IndexMap<String, f64>,
        conversation: &mut Conversation,
    ) -> Result<Scored> {
        for view in views.iter_mut() {
            view.engine = self.combination(&view.scene).engine(&view.scene, &[])?;
        }
        self.score(folder, views, "tuned-finer", &self.file.engine.light, values, conversation)
    }

    /// The picture of a view by a light model with values of parameters, and the processor seconds of `repeats` further ones, sorted.
    fn pictures(
        &self,
        view: &mut View,
        light: &str,
        values: &IndexMap<String, f64>,
        repeats: usize,
    ) -> Result<(Image, Vec<f64>)> {
        let combination = self.combination(&view.scene);
        let changed = preset::of_medium(values);
        let own;
        let (scene, engine) = if changed.is_empty() {
            view.engine.light = preset::lit(&view.own_light, light, values)?;
            (&view.scene, &view.engine)
        } else {
            let (scene, mut engine) = preset::build(&view.scene, &combination, &changed)?;
            engine.light = preset::lit(&engine.light, light, values)?;
            own = (scene, engine);
            (&own.0, &own.1)
        };
        let renderer = EngineRenderer::new(scene, engine, None)?;
        let picture = || renderer.picture(&combination.picture_settings(), &|_, _| ());
        let image = picture()?;
        let mut seconds = Vec::with_capacity(repeats);
        for _ in 0..repeats {
            let begin = ProcessTime::now();
            picture()?;
            seconds.push(begin.elapsed().as_secs_f64());
        }
        seconds.sort_by(f64::total_cmp);
        Ok((image, seconds))
    }

    /// The picture alone.
    fn picture(&self, view: &mut View, light: &str, values: &IndexMap<String, f64>) -> Result<Image> {
        Ok(self.pictures(view, light, values, 0)?.0)
    }

    /// Lowers the objective; the best parameters, and how they were found.
    fn search(
        &self,
        ledger: &Ledger,
        views: &mut [View],
        conversation: &mut Conversation,
        progress: Progress<'_>,
    ) -> Result<(IndexMap<String, f64>, Found)> {
        let folder = ledger.folder().expect("a search is kept");
        let search = &self.file.search;
        let initial: Vec<f64> = self.file.parameters.values().map(file::Searched::begin).collect();
        let started = conversation.ask(
            &json!({
                "op": "start", "initial": initial, "deviation": search.deviation,
                "seed": search.seed, "population": search.population,
            }),
            |_| (),
        )?;
        let library = started["library"].as_str().unwrap_or_default().to_owned();
        let mut found = Found { library, stopped: Vec::new(), generations: Vec::new() };
        let mut best: Option<(f64, Vec<f64>)> = None;
        for number in 0..search.generations {
            let asked = conversation.ask(&json!({"op": "ask"}), |_| ())?;
            let candidates: Vec<Vec<f64>> = answer(&asked["candidates"])?;
            let name = format!("{number:04}");
            let generation = match ledger.read::<Generation>(SEARCH, &name)? {
                Some(kept) => {
                    check_same(&kept, &candidates, &ledger.file(SEARCH, &name).unwrap_or_default())?;
                    kept
                }
                None => {
                    let report = |done: f64, what: &str| {
                        progress((f64::from(number) + done) / f64::from(search.generations), what);
                    };
                    let objectives = self.objectives(folder, views, &candidates, conversation, &report)?;
                    let generation = Generation { candidates, objectives };
                    ledger.write(SEARCH, &name, &generation)?;
                    generation
                }
            };
            for (candidate, &objective) in generation.candidates.iter().zip(&generation.objectives) {
                if best.as_ref().is_none_or(|(least, _)| objective < *least) {
                    best = Some((objective, candidate.clone()));
                }
            }
            let told = conversation.ask(
                &json!({"op": "tell", "candidates": generation.candidates, "objectives": generation.objectives}),
                |_| (),
            )?;
            found.generations.push(generation);
            found.stopped = answer(&told["stop"])?;
            if !found.stopped.is_empty() {
                break;
            }
        }
        if found.stopped.is_empty() {
            found.stopped.push("generations".into());
        }
        let (_, point) = best.expect("at least one generation has candidates");
        Ok((self.values(&point), found))
    }

    /// Parameters at a point of the unit cube.
    fn values(&self, point: &[f64]) -> IndexMap<String, f64> {
        let named = self.file.parameters.iter().zip(point);
        let found = named.map(|((name, searched), &at)| (name.clone(), searched.value(at)));
        self.file.fixed.clone().into_iter().chain(found).collect()
    }

    /// The mean error of the training views, for each candidate.
    fn objectives(
        &self,
        folder: &Path,
        views: &mut [View],
        candidates: &[Vec<f64>],
        conversation: &mut Conversation,
        progress: Progress<'_>,
    ) -> Result<Vec<f64>> {
        let train = self.train.len();
        let mut found = Vec::with_capacity(candidates.len() * train);
        let mut files = Vec::new();
        for (number, candidate) in candidates.iter().enumerate() {
            progress(number as f64 / candidates.len() as f64, "candidates");
            let values = self.values(candidate);
            for (index, view) in views[..train].iter_mut().enumerate() {
                let image = self.picture(view, &self.file.engine.light, &values)?;
                match self.file.search.objective {
                    Objective::Relmse => found.push(errors::measure(&image, &view.truth)?.relmse.value),
                    Objective::Flip => {
                        let path = folder.join(format!("search/candidate-{number}-{index}.exr"));
                        image.write_exr(&path, false)?;
                        files.push(json!([index, path]));
                    }
                }
            }
        }
        if self.file.search.objective == Objective::Flip {
            found = flips(conversation, &files)?;
        }
        Ok(found.chunks_exact(train).map(|errors| errors.iter().sum::<f64>() / train as f64).collect())
    }

    /// The exposure at which a light model's mean HDR-FLIP on the training views is least. A picture is linear in it: what the medium
    /// sends times the exposure, and what it lets through.
    fn matched(&self, folder: &Path, views: &mut [View], light: &str, conversation: &mut Conversation) -> Result<f64> {
        let mut files = Vec::new();
        for (index, view) in views[..self.train.len()].iter_mut().enumerate() {
            let mut both = Vec::new();
            for exposure in [0.0, 1.0] {
                let image = self.picture(view, light, &IndexMap::from([("exposure".to_owned(), exposure)]))?;
                let path = folder.join(format!("search/exposure-{index}-{exposure}.exr"));
                image.write_exr(&path, false)?;
                both.push(path);
            }
            files.push(json!([index, both[0], both[1]]));
        }
        let found = conversation.ask(&json!({"op": "expose", "pictures": files}), |_| ())?;
        answer(&found["exposure"])
    }

    /// How good a light model with these parameters is.
    fn score(
        &self,
        folder: &Path,
        views: &mut [View],
        name: &str,
        light: &str,
        values: &IndexMap<String, f64>,
        conversation: &mut Conversation,
    ) -> Result<Scored> {
        let (mut files, mut seconds, mut found) = (Vec::new(), 0.0, Vec::new());
        let count = views.len();
        for (index, view) in views.iter_mut().enumerate() {
            let (image, times) = self.pictures(view, light, values, REPEATS)?;
            seconds += times[REPEATS / 2] / count as f64;
            let picture = format!("pictures/{name}-{index}.exr");
            image.write_exr(&folder.join(&picture), false)?;
            files.push(json!([index, folder.join(&picture)]));
            let errors = errors::measure(&image, &view.truth)?;
            found.push(ViewError { view: view.scene.name.clone(), flip: 0.0, errors, picture });
        }
        for (view, flip) in found.iter_mut().zip(flips(conversation, &files)?) {
            view.flip = flip;
        }
        let held_out = found.split_off(self.train.len());
        let exposure = values.get("exposure").copied().unwrap_or(1.0);
        Ok(Scored { name: name.to_owned(), exposure, train: found, held_out, seconds })
    }
}

/// How a search went.
struct Found {
    library: String,
    stopped: Vec<String>,
    generations: Vec<Generation>,
}

impl Generation {
    /// Least and median error.
    fn summary(&self) -> [f64; 2] {
        let mut sorted = self.objectives.clone();
        sorted.sort_by(f64::total_cmp);
        [sorted[0], sorted[sorted.len() / 2]]
    }
}

impl Outcome {
    /// Draws the held-out views before and after, and the search: `tuning.svg`, `.png` and `.pdf`.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        let file = |extension: &str| folder.join(format!("tuning.{extension}"));
        let first = self.tuned.train.len();
        let views: Vec<Json> = self
            .tuned
            .held_out
            .iter()
            .zip(&self.published[0].held_out)
            .zip(&self.truths[first..])
            .map(|((after, before), truth)| {
                let replicas: Vec<PathBuf> = truth.replicas.iter().map(|name| folder.join(name)).collect();
                json!({
                    "view": after.view, "truth": replicas,
                    "before": folder.join(&before.picture), "after": folder.join(&after.picture),
                })
            })
            .collect();
        let request = json!({
            "title": self.file.title, "before": self.published[0].name, "views": views, "history": self.history,
            "objective": self.file.search.objective,
            "svg": file("svg"), "png": file("png"), "pdf": file("pdf"),
        });
        bridge::run_script("tuning_plot.py", &request, Kernel::Default, |_| ()).map(drop)
    }
}

/// Mean HDR-FLIP of the two halves of each view's replicas.
fn noise_flip(folder: &Path, views: &[View], conversation: &mut Conversation) -> Result<f64> {
    let halves: Vec<Json> = views
        .iter()
        .map(|view| {
            let half = |first: usize| -> Vec<PathBuf> {
                view.record.replicas.iter().skip(first).step_by(2).map(|name| folder.join(name)).collect()
            };
            json!([half(0), half(1)])
        })
        .collect();
    let found = conversation.ask(&json!({"op": "noise", "pairs": halves}), |_| ())?;
    let means: Vec<f64> = answer(&found["means"])?;
    Ok(means.iter().sum::<f64>() / means.len() as f64)
}

fn flips(conversation: &mut Conversation, files: &[Json]) -> Result<Vec<f64>> {
    let found = conversation.ask(&json!({"op": "flip", "pictures": files}), |_| ())?;
    answer(&found["means"])
}

/// A value that the optimiser answered.
fn answer<T: serde::de::DeserializeOwned>(value: &Json) -> Result<T> {
    serde_json::from_value(value.clone()).map_err(|cause| {
        Error::new("optimiser.py", cause.to_string(), "what its head describes", "Report this defect.")
    })
}

/// Refuses a generation that another search made.
fn check_same(kept: &Generation, candidates: &[Vec<f64>], path: &Path) -> Result<()> {
    let is_near =
        |(a, b): (&Vec<f64>, &Vec<f64>)| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME);
    let is_same = kept.candidates.len() == candidates.len()
        && kept.objectives.len() == candidates.len()
        && kept.candidates.iter().zip(candidates).all(is_near);
    if is_same {
        return Ok(());
    }
    Err(Error::new(
        path.display().to_string(),
        "candidates that this search does not make",
        "those of the same seed, library and errors",
        "Take another folder, or remove the folder `search` in this one.",
    ))
}

/// The ledger of a tuning, whose generations follow from its file.
fn open(folder: &Path, file: &TuningFile, resume: &Resume) -> Result<Ledger> {
    let purpose = Purpose { mark: "tune.json", format: FORMAT, of: json!(file) };
    Ledger::open(folder, purpose, resume, Sharing::Alone)
}

impl file::TunedEngine {
    /// The settings of a picture of a scene, as a study has them.
    pub fn combination(&self, scene: &str) -> Combination {
        Combination {
            scene: scene.to_owned(),
            density: self.density.clone(),
            light: self.light.clone(),
            steps: self.steps,
            light_steps: self.light_steps,
            cache: self.cache,
            sub_pixels: self.sub_pixels,
            jitter: EngineJitter::None,
            defects: self.defects.clone(),
        }
    }
}
