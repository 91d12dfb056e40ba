//! Tuning: free parameters of an engine, fitted to path tracing on some views and judged on others.
//!
//! A tuning file names an engine of fixed quality, ranges of parameters, and views ([`mod@file`]). CMA-ES (Hansen and Ostermeier 2001,
//! "Completely Derandomized Self-Adaptation in Evolution Strategies", in its reference library) lowers the mean error of the training views. The
//! result stands beside every published light model with its exposure matched to the same training views, so that it is not compared
//! with a bad start; both are judged on views that no search has seen.
//!
//! As an experiment its jobs are the truths, the search, the published light models and the result. Every candidate of the search is a record,
//! kept as soon as it is measured: the same seed and errors make the same candidates, so an interrupted search is told what it had and
//! goes on.

pub mod file;
pub mod preset;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, read_record, to_json};
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::{Conversation, CyclesKernel};
use crate::engines::Engine;
use crate::engines::light::LightModel;
use crate::engines::light::models::LIGHTS;
use crate::engines::render::{EngineJitter, EngineRenderer};
use crate::measure::combination::Combination;
use crate::measure::errors;
use crate::measure::errors::Errors;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::provenance::Provenance;
use crate::measure::scenes::load_scenes;
use crate::measure::timing::{machine, repeated};
use crate::measure::truth;
use crate::measure::truth::{PixelRays, TruthRecord};
use crate::media::light_volume::LightVolume;
use crate::scene::Scene;
use crate::scene::image::Image;
use file::{Objective, TuningFile};
use indexmap::IndexMap;
use preset::Preset;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Value as Json, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Format of a tuning's folder.
pub const FORMAT: &str = "cloudparity-tuning/1";

/// Part of the ledger that holds the errors of candidates.
const EVALUATIONS: &str = "evaluations";

/// What the truths are for.
const TRUTHS: &str = "tuning";

/// Timed renders of a view; their median counts.
const REPEATS: usize = 3;

/// Factor on steps, light steps and rays per axis of the picture that shows what sampling makes of the error.
const FINER: u32 = 3;

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

/// How the search went.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Searched {
    /// The library.
    library: String,
    /// Why it ended.
    stopped: Vec<String>,
    /// Candidates that were measured.
    evaluations: usize,
    /// Least and median error of each generation.
    history: Vec<[f64; 2]>,
    /// The best parameters.
    parameters: IndexMap<String, f64>,
}

/// A unit of work.
#[derive(Debug, Clone, PartialEq)]
enum Job {
    /// The truth of a view.
    Truth(usize),
    /// The whole search; its candidates are records.
    Search,
    /// HDR-FLIP of two halves of the truths.
    Noise,
    /// A published light model.
    Published(&'static str),
    /// The tuned engine.
    Tuned,
    /// The same at a higher quality.
    Finer,
}

/// What a job came to; its file holds the content alone.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Record {
    Truth(TruthRecord),
    Search(Searched),
    Scored(Box<Scored>),
    Noise(f64),
}

/// What a tuning came to: `tuning.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TuningResults {
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
    /// What took part; none in a file from before it was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub provenance: Option<Provenance>,
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
    /// Published light models, exposure matched to the training views, best first by held-out HDR-FLIP; at least one.
    #[serde(deserialize_with = "at_least_one")]
    pub published: Vec<Scored>,
    /// The tuned engine.
    pub tuned: Scored,
    /// The tuned parameters at a higher quality: three times the steps, light steps and rays per pixel and axis. What its error still is,
    /// the light model cannot express.
    pub finer: Scored,
    /// Its parameters.
    pub parameters: IndexMap<String, f64>,
}

/// A list that is not empty: what is compared with its first has one.
fn at_least_one<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> std::result::Result<Vec<T>, D::Error> {
    let list = Vec::deserialize(deserializer)?;
    if list.is_empty() {
        return Err(serde::de::Error::invalid_length(0, &"a list of at least one"));
    }
    Ok(list)
}

impl TuningResults {
    /// By what share of the best published light model's held-out HDR-FLIP the tuned engine's is lower.
    pub fn improvement(&self) -> f64 {
        1.0 - Scored::mean_flip(&self.tuned.held_out) / Scored::mean_flip(&self.published[0].held_out)
    }

    /// Reads what a tuning left in a folder.
    pub fn load(folder: &Path) -> Result<Option<Self>> {
        read_record(&folder.join("tuning.json"))
    }
}

/// Whose light a picture has, by the name of a light model.
#[derive(Clone, Copy)]
enum Lit<'a> {
    /// The tuned engine's.
    Tuned(&'a str),
    /// A published light model's.
    Published(&'a str),
}

/// A scene with its truth and engine.
struct View {
    scene: Scene,
    engine: Engine,
    /// The engine's light without any light model's settings.
    own_light: LightModel,
    /// The engine's light volume, which published light models do without.
    light_volume: Option<Arc<LightVolume>>,
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
    pub fn run(&self, folder: &Path, settings: &Settings, progress: Progress<'_>) -> Result<Outcome<TuningResults>> {
        experiment::run(&mut Running { tuning: self, judge: None }, Some(folder), settings, progress)
    }

    /// Training views, then held-out ones.
    fn scenes(&self) -> impl Iterator<Item = &Scene> {
        self.train.iter().chain(&self.held_out)
    }

    fn view(&self, scene: &Scene, desk: &Desk<'_>) -> Result<View> {
        let density = &self.file.engine.density;
        let report = |done: f64, what: &str| desk.report(done, what);
        let record = self.file.truth.obtain(scene, density, TRUTHS, PixelRays::Filtered, desk.ledger, &report)?;
        let truth = record.read(desk.folder()?)?;
        let engine = self.combination(scene).engine(scene, &[])?;
        let (own_light, light_volume) = (engine.light.clone(), engine.light_volume.clone());
        Ok(View { scene: scene.clone(), engine, own_light, light_volume, record, truth })
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

    /// The picture of a view by a light model with values of parameters, and the median processor seconds of `repeats` further ones.
    fn pictures(
        &self,
        view: &mut View,
        light: Lit<'_>,
        values: &IndexMap<String, f64>,
        repeats: usize,
    ) -> Result<(Image, Option<f64>)> {
        let combination = self.combination(&view.scene);
        let changed = preset::of_medium(values);
        let own;
        let (light, light_volume) = match light {
            Lit::Tuned(light) => (light, view.light_volume.clone()),
            Lit::Published(light) => (light, None),
        };
        view.engine.light_volume = light_volume;
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
        let seconds = match repeats {
            0 => None,
            _ => Some(repeated(repeats, None, || picture().map(drop))?.0.median),
        };
        Ok((image, seconds))
    }

    /// Lowers the objective.
    fn search(&self, judge: &mut Judge, desk: &Desk<'_>) -> Result<Searched> {
        let search = &self.file.search;
        let initial: Vec<f64> = self.file.parameters.values().map(file::Searched::begin).collect();
        let started = judge.conversation.ask(
            &json!({
                "op": "start", "initial": initial, "deviation": search.deviation,
                "seed": search.seed, "population": search.population,
            }),
            |_| (),
        )?;
        let mut found = Searched {
            library: started["library"].as_str().unwrap_or_default().to_owned(),
            stopped: Vec::new(),
            evaluations: 0,
            history: Vec::new(),
            parameters: IndexMap::new(),
        };
        let mut least = f64::INFINITY;
        for number in 0..search.generations {
            let asked = judge.conversation.ask(&json!({"op": "ask"}), |_| ())?;
            let candidates: Vec<Vec<f64>> = answer(&asked["candidates"])?;
            let mut objectives = Vec::with_capacity(candidates.len());
            for (index, candidate) in candidates.iter().enumerate() {
                let done = f64::from(number) + index as f64 / candidates.len() as f64;
                desk.report(done / f64::from(search.generations), "candidates");
                let values = self.values(candidate);
                let make = |_: &str| self.objective(judge, &values, desk);
                objectives.push(desk.obtain(EVALUATIONS, &self.evaluation_inputs(&values), make)?);
            }
            for (candidate, &objective) in candidates.iter().zip(&objectives) {
                if objective < least || found.parameters.is_empty() {
                    least = objective;
                    found.parameters = self.values(candidate);
                }
            }
            let told = judge
                .conversation
                .ask(&json!({"op": "tell", "candidates": candidates, "objectives": objectives}), |_| ())?;
            found.evaluations += objectives.len();
            found.history.push(least_and_median(objectives));
            found.stopped = answer(&told["stop"])?;
            if !found.stopped.is_empty() {
                break;
            }
        }
        if found.stopped.is_empty() {
            found.stopped.push("generations".into());
        }
        Ok(found)
    }

    /// All that the error of a candidate depends on, but for the build.
    fn evaluation_inputs(&self, values: &IndexMap<String, f64>) -> Json {
        let engine = &self.file.engine;
        let truth = |scene: &Scene| self.file.truth.inputs(scene, &engine.density, TRUTHS, PixelRays::Filtered);
        let truths: Vec<Json> = self.train.iter().map(truth).collect();
        json!({"engine": engine, "values": values, "objective": self.file.search.objective, "truths": truths})
    }

    /// Parameters at a point of the unit cube.
    fn values(&self, point: &[f64]) -> IndexMap<String, f64> {
        let named = self.file.parameters.iter().zip(point);
        let found = named.map(|((name, searched), &at)| (name.clone(), searched.value(at)));
        self.file.fixed.clone().into_iter().chain(found).collect()
    }

    /// The mean error of the training views.
    fn objective(&self, judge: &mut Judge, values: &IndexMap<String, f64>, desk: &Desk<'_>) -> Result<f64> {
        let train = self.train.len();
        let (mut found, mut files) = (Vec::with_capacity(train), Vec::new());
        for (index, view) in judge.views[..train].iter_mut().enumerate() {
            let image = self.pictures(view, Lit::Tuned(&self.file.engine.light), values, 0)?.0;
            match self.file.search.objective {
                Objective::Relmse => found.push(errors::measure(&image, &view.truth)?.relmse.value),
                Objective::Flip => {
                    let path = desk.folder()?.join(format!("search/candidate-{index}.exr"));
                    image.write_exr(&path, false)?;
                    files.push(json!([index, path]));
                }
            }
        }
        if self.file.search.objective == Objective::Flip {
            found = flips(&mut judge.conversation, &files)?;
        }
        Ok(found.iter().sum::<f64>() / train as f64)
    }

    /// The exposure at which a light model's mean HDR-FLIP on the training views is least. A picture is linear in it: what the medium
    /// sends times the exposure, and what it lets through.
    fn matched(&self, judge: &mut Judge, light: &str, desk: &Desk<'_>) -> Result<f64> {
        let mut files = Vec::new();
        for (index, view) in judge.views[..self.train.len()].iter_mut().enumerate() {
            let mut both = Vec::new();
            for exposure in [0.0, 1.0] {
                let values = IndexMap::from([("exposure".to_owned(), exposure)]);
                let image = self.pictures(view, Lit::Published(light), &values, 0)?.0;
                let path = desk.folder()?.join(format!("search/{light}-exposure-{index}-{exposure}.exr"));
                image.write_exr(&path, false)?;
                both.push(path);
            }
            files.push(json!([index, both[0], both[1]]));
        }
        let found = judge.conversation.ask(&json!({"op": "expose", "pictures": files}), |_| ())?;
        answer(&found["exposure"])
    }

    /// How good a light model with these parameters is.
    fn score(
        &self,
        judge: &mut Judge,
        name: &str,
        light: Lit<'_>,
        values: &IndexMap<String, f64>,
        desk: &Desk<'_>,
    ) -> Result<Scored> {
        let (mut files, mut seconds, mut found) = (Vec::new(), 0.0, Vec::new());
        let count = judge.views.len();
        for (index, view) in judge.views.iter_mut().enumerate() {
            let (image, median) = self.pictures(view, light, values, REPEATS)?;
            seconds += median.unwrap_or(0.0) / count as f64;
            let picture = format!("pictures/{name}-{index}.exr");
            let path = desk.folder()?.join(&picture);
            image.write_exr(&path, false)?;
            files.push(json!([index, path]));
            let errors = errors::measure(&image, &view.truth)?;
            found.push(ViewError { view: view.scene.name.clone(), flip: 0.0, errors, picture });
        }
        for (view, flip) in found.iter_mut().zip(flips(&mut judge.conversation, &files)?) {
            view.flip = flip;
        }
        let held_out = found.split_off(self.train.len());
        let exposure = values.get("exposure").copied().unwrap_or(1.0);
        Ok(Scored { name: name.to_owned(), exposure, train: found, held_out, seconds })
    }
}

/// What judges pictures: the views with their truths, and the script that knows them, too.
struct Judge {
    views: Vec<View>,
    conversation: Conversation,
}

/// A tuning while it is run.
struct Running<'a> {
    tuning: &'a Tuning,
    /// Made when it is first needed: an interrupted tuning that has all records starts no script.
    judge: Option<Judge>,
}

impl Running<'_> {
    fn judge(&mut self, desk: &Desk<'_>) -> Result<&mut Judge> {
        if self.judge.is_none() {
            let views = self.tuning.scenes().map(|scene| self.tuning.view(scene, desk)).collect::<Result<Vec<_>>>()?;
            let folder = desk.folder()?;
            let files: Vec<Vec<PathBuf>> =
                views.iter().map(|view| view.record.replicas.iter().map(|name| folder.join(name)).collect()).collect();
            let mut conversation = Conversation::start("optimiser.py", CyclesKernel::Default)?;
            conversation.ask(&json!({"op": "truths", "views": files}), |_| ())?;
            self.judge = Some(Judge { views, conversation });
        }
        Ok(self.judge.as_mut().expect("it was just made"))
    }

    /// The search's record, made now where it is missing.
    fn searched(&mut self, desk: &Desk<'_>) -> Result<Searched> {
        let inputs = self.inputs(&Job::Search)?;
        let tuning = self.tuning;
        // Made beforehand: while another shard searches, this one waits.
        let judge = self.judge(desk)?;
        desk.obtain("records", &inputs, |_| tuning.search(judge, desk))
    }
}

impl Experiment for Running<'_> {
    type Job = Job;
    type Record = Record;
    type Summary = TuningResults;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "tune.json", format: FORMAT, of: json!(self.tuning.file) }
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let mut jobs: Vec<Job> = (0..self.tuning.scenes().count()).map(Job::Truth).collect();
        jobs.extend([Job::Search, Job::Noise]);
        jobs.extend(LIGHTS.iter().map(|light| Job::Published(light.id)));
        jobs.extend([Job::Tuned, Job::Finer]);
        Ok(jobs)
    }

    fn part(&self, job: &Job) -> &'static str {
        match job {
            Job::Truth(_) => truth::PART,
            _ => "records",
        }
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        let Tuning { file, .. } = self.tuning;
        let truth = |scene: &Scene| file.truth.inputs(scene, &file.engine.density, TRUTHS, PixelRays::Filtered);
        if let Job::Truth(view) = job {
            return Ok(truth(self.tuning.scenes().nth(*view).expect("a view of the plan")));
        }
        let truths: Vec<Json> = self.tuning.scenes().map(truth).collect();
        Ok(json!({"job": format!("{job:?}"), "file": file, "truths": truths}))
    }

    fn label(&self, job: &Job) -> String {
        match job {
            Job::Truth(_) => "truths".into(),
            Job::Search => "search".into(),
            Job::Noise => "noise of the truths".into(),
            Job::Published(light) => format!("light model {light}"),
            Job::Tuned => "tuned engine".into(),
            Job::Finer => "tuned engine, finer".into(),
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        let tuning = self.tuning;
        let light = &tuning.file.engine.light;
        let record = match job {
            Job::Truth(view) => {
                let scene = tuning.scenes().nth(*view).expect("a view of the plan");
                let report = |done: f64, what: &str| desk.report(done, what);
                let density = &tuning.file.engine.density;
                Record::Truth(tuning.file.truth.render(scene, density, &self.inputs(job)?, desk.ledger, &report)?)
            }
            Job::Search => Record::Search(tuning.search(self.judge(desk)?, desk)?),
            Job::Noise => Record::Noise(noise_flip(desk.folder()?, self.judge(desk)?)?),
            Job::Published(named) => {
                let judge = self.judge(desk)?;
                let exposure = tuning.matched(judge, named, desk)?;
                let values = IndexMap::from([("exposure".to_owned(), exposure)]);
                Record::Scored(Box::new(tuning.score(judge, named, Lit::Published(named), &values, desk)?))
            }
            Job::Tuned => {
                let best = self.searched(desk)?.parameters;
                Record::Scored(Box::new(tuning.score(self.judge(desk)?, "tuned", Lit::Tuned(light), &best, desk)?))
            }
            Job::Finer => {
                let best = self.searched(desk)?.parameters;
                let finer = tuning.finer();
                let judge = self.judge(desk)?;
                for view in &mut judge.views {
                    view.engine = finer.combination(&view.scene).engine(&view.scene, &[])?;
                    view.light_volume = view.engine.light_volume.clone();
                }
                let scored = finer.score(judge, "tuned-finer", Lit::Tuned(light), &best, desk);
                // The engines of its views are no longer the tuning's.
                self.judge = None;
                Record::Scored(Box::new(scored?))
            }
        };
        Ok(Found::Record(record))
    }

    fn heard(&mut self, job: &Job, record: &Record, desk: &Desk<'_>) -> Result<()> {
        if let (Job::Truth(view), Record::Truth(truth)) = (job, record) {
            let scene = self.tuning.scenes().nth(*view).expect("a view of the plan");
            truth.check(scene, &self.tuning.file.engine.density, desk.ledger)?;
        }
        Ok(())
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<TuningResults> {
        let (mut truths, mut published, mut searched, mut noise) = (Vec::new(), Vec::new(), None, None);
        let (mut tuned, mut finer) = (None, None);
        for Done { job, found } in found {
            match (job, found) {
                (_, Found::Record(Record::Truth(truth))) => truths.push(truth),
                (_, Found::Record(Record::Search(record))) => searched = Some(record),
                (_, Found::Record(Record::Noise(flip))) => noise = Some(flip),
                (Job::Tuned, Found::Record(Record::Scored(scored))) => tuned = Some(*scored),
                (Job::Finer, Found::Record(Record::Scored(scored))) => finer = Some(*scored),
                (_, Found::Record(Record::Scored(scored))) => published.push(*scored),
                (_, Found::LeftOut(_)) => {}
            }
        }
        let (Some(searched), Some(noise_flip), Some(tuned), Some(finer)) = (searched, noise, tuned, finer) else {
            let found = "records of other kinds than their jobs make";
            return Err(Error::new("the tuning", found, "those of a search and its results", "Take another folder."));
        };
        published.sort_by(|a: &Scored, b: &Scored| {
            Scored::mean_flip(&a.held_out).total_cmp(&Scored::mean_flip(&b.held_out))
        });
        let results = TuningResults {
            format: FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            builds: desk.ledger.builds(),
            file: self.tuning.file.clone(),
            machine: machine(),
            provenance: Some(Provenance::now(None)),
            optimiser: searched.library,
            stopped: searched.stopped,
            evaluations: searched.evaluations,
            history: searched.history,
            truths,
            noise_flip,
            published,
            tuned,
            finer,
            parameters: searched.parameters,
        };
        let folder = desk.folder()?;
        files::write_atomically(&folder.join("tuning.json"), to_json(&results).as_bytes())?;
        files::write_atomically(&folder.join("tuned.preset.json"), to_json(&Preset::of(&results)).as_bytes())?;
        Ok(results)
    }
}

/// Least and median error.
fn least_and_median(mut objectives: Vec<f64>) -> [f64; 2] {
    objectives.sort_by(f64::total_cmp);
    [objectives[0], objectives[objectives.len() / 2]]
}

impl TuningResults {
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
            "objective": self.file.search.objective, "made_by": self.provenance.as_ref().map(Provenance::line),
            "svg": file("svg"), "png": file("png"), "pdf": file("pdf"),
        });
        bridge::run_script("tuning_plot.py", &request, CyclesKernel::Default, |_| ()).map(drop)
    }
}

/// Mean HDR-FLIP of the two halves of each view's replicas.
fn noise_flip(folder: &Path, judge: &mut Judge) -> Result<f64> {
    let halves: Vec<Json> = judge
        .views
        .iter()
        .map(|view| {
            let half = |first: usize| -> Vec<PathBuf> {
                view.record.replicas.iter().skip(first).step_by(2).map(|name| folder.join(name)).collect()
            };
            json!([half(0), half(1)])
        })
        .collect();
    let found = judge.conversation.ask(&json!({"op": "noise", "pairs": halves}), |_| ())?;
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
            light_volume: self.light_volume,
            sub_pixels: self.sub_pixels,
            jitter: EngineJitter::None,
            defects: self.defects.clone(),
            god_rays: false,
        }
    }
}
