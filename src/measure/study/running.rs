//! A study as an experiment: truths, runs and curves are its jobs.

use crate::base::error::{Error, Result};
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::base::recent;
use crate::engines::Engine;
use crate::engines::render::EngineRenderer;
use crate::gpu::Gpu;
use crate::measure::combination::Combination;
use crate::measure::errors;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::provenance::Provenance;
use crate::measure::study::curve_points::{CurvePoint, MissingCurve, Renderer};
use crate::measure::study::file::Skipped;
use crate::measure::study::{FORMAT, Measured, PURPOSE, Results, Study};
use crate::measure::timing::{Clock, repeated};
use crate::measure::truth;
use crate::measure::truth::{PixelRays, TruthRecord};
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::collections::HashMap;
use std::path::Path;

/// What the truths of a study are for.
pub(super) const TRUTHS: &str = "study";

/// What is made beforehand.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// Truths of every scene and density that has an engine.
    pub truths: Vec<TruthRecord>,
    /// Curves of Cycles that could not be made, with the reason.
    pub missing_curves: Vec<MissingCurve>,
}

/// A unit of work. Combinations of truths and curves stand for their scene and density.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Job {
    /// What errors are measured against.
    Truth(Combination, PixelRays),
    /// The engine's picture and its time.
    Run(Combination),
    /// A point of path tracing's curve, of so many samples.
    PathPoint(Combination, u32),
    /// All points of Cycles, which come from one render.
    CyclesCurve(Combination),
}

/// What a job came to; its file holds the content alone.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
pub(super) enum Record {
    Truth(TruthRecord),
    Run(Box<Measured>),
    Point(Box<CurvePoint>),
    Points(Vec<CurvePoint>),
}

/// A study while it is run.
pub(super) struct Running<'a> {
    pub(super) study: &'a Study,
    gpu: Option<Gpu>,
    /// Only what takes longest and is not timed.
    only_preparation: bool,
    /// Replicas of truths that were needed.
    truths: HashMap<String, Vec<Image>>,
}

impl Study {
    /// Makes what errors are measured against, and what takes longest: truths, and Cycles' curves. What is there already is left alone; an
    /// interrupted truth goes on with the replicas that are missing.
    pub fn prepare(&self, folder: &Path, settings: &Settings, progress: Progress<'_>) -> Result<Outcome<Prepared>> {
        let done = self.go_through(folder, settings, true, progress)?;
        Ok(match done {
            Outcome::All(found) => {
                Outcome::All(Prepared { truths: found.truths, missing_curves: found.missing_curves })
            }
            Outcome::Part { done, of } => Outcome::Part { done, of },
        })
    }

    /// Measures what is missing in a folder, and sums up.
    pub fn run(&self, folder: &Path, settings: &Settings, progress: Progress<'_>) -> Result<Outcome<Results>> {
        self.go_through(folder, settings, false, progress)
    }

    fn go_through(
        &self,
        folder: &Path,
        settings: &Settings,
        only_preparation: bool,
        progress: Progress<'_>,
    ) -> Result<Outcome<Results>> {
        let gpu = self.adapter()?;
        let mut running = Running { study: self, gpu, only_preparation, truths: HashMap::new() };
        experiment::run(&mut running, Some(folder), settings, progress)
    }
}

impl Job {
    fn combination(&self) -> &Combination {
        match self {
            Self::Truth(one, _) | Self::Run(one) | Self::PathPoint(one, _) | Self::CyclesCurve(one) => one,
        }
    }

    /// Where in a pixel the rays of its truth pass, in a study with these: Cycles' rays pass by the pixel filter in each.
    fn rays(&self, of_study: PixelRays) -> PixelRays {
        match self {
            Self::Truth(_, rays) => *rays,
            Self::Run(_) | Self::PathPoint(..) => of_study,
            Self::CyclesCurve(_) => PixelRays::Filtered,
        }
    }
}

impl Running<'_> {
    fn scene(&self, combination: &Combination) -> &Scene {
        self.study.scene(&combination.scene)
    }

    fn truth_inputs(&self, job: &Job) -> Json {
        let (combination, rays) = (job.combination(), job.rays(self.study.rays()));
        self.study.file.truth.inputs(self.scene(combination), &combination.density, TRUTHS, rays)
    }

    /// Why a scene and density has no runs, and so needs no truth.
    fn refusal(&self, combination: &Combination) -> Option<Error> {
        let scene = self.scene(combination);
        let (engine, _) = match self.study.engine(scene, combination) {
            Ok(engine) => engine,
            Err(error) => return Some(error),
        };
        let settings = combination.picture_settings();
        let compiled = |gpu| EngineRenderer::new(scene, &engine, Some(gpu))?.compile(&settings);
        self.gpu.as_ref().and_then(|gpu| compiled(gpu).err())
    }

    /// The truth of a combination, by rays that pass so.
    pub(super) fn truth(&self, of: &Combination, rays: PixelRays, desk: &Desk<'_>) -> Result<TruthRecord> {
        let report = |done: f64, what: &str| desk.report(done, what);
        self.study.file.truth.obtain(self.scene(of), &of.density, TRUTHS, rays, desk.ledger, &report)
    }

    /// The replicas of a truth.
    pub(super) fn replicas(&mut self, truth: &TruthRecord, desk: &Desk<'_>) -> Result<&[Image]> {
        keep_replicas(&mut self.truths, truth, desk)
    }

    /// Renders, times and judges a combination.
    fn measure(&mut self, combination: &Combination, desk: &Desk<'_>) -> Result<Found<Record>> {
        let study = self.study;
        let scene = study.scene(&combination.scene);
        // A run's preparation is its own, whatever ran before it.
        recent::forget_all();
        let (engine, engine_seconds): (Engine, f64) = match study.engine(scene, combination) {
            Ok(found) => found,
            Err(error) => return Ok(Found::LeftOut(error.to_string())),
        };
        let begin = ProcessTime::now();
        let gpu = self.gpu.as_ref();
        let settings = combination.picture_settings();
        let renderer = EngineRenderer::new(scene, &engine, gpu);
        let renderer = match renderer.and_then(|renderer| renderer.compile(&settings).map(|()| renderer)) {
            Ok(renderer) => renderer,
            Err(error) => return Ok(Found::LeftOut(error.to_string())),
        };
        let prepare_seconds = engine_seconds + begin.elapsed().as_secs_f64();
        let truth = self.truth(combination, study.rays(), desk)?;
        let replicas = keep_replicas(&mut self.truths, &truth, desk)?;
        let render = || renderer.picture(&settings, &|_, _| ());
        // The first does not count: memory and caches are cold.
        let image = render()?;
        let repeats = study.file.timing.repeats as usize;
        let (seconds, wall_seconds) = repeated(repeats, gpu, || render().map(drop))?;
        let picture = format!("pictures/{}.exr", desk.key);
        image.write_exr(&desk.folder()?.join(&picture), false)?;
        let errors = errors::measure(&image, replicas)?;
        Ok(Found::Record(Record::Run(Box::new(Measured {
            id: desk.key.to_owned(),
            combination: combination.clone(),
            errors,
            flip: None,
            seconds,
            wall_seconds,
            prepare_seconds,
            cost: errors.relmse.value * seconds.median,
            picture,
            truth: truth.id,
        }))))
    }
}

/// The replicas of a truth, which stay in memory.
fn keep_replicas<'a>(
    truths: &'a mut HashMap<String, Vec<Image>>,
    truth: &TruthRecord,
    desk: &Desk<'_>,
) -> Result<&'a [Image]> {
    if !truths.contains_key(&truth.id) {
        truths.insert(truth.id.clone(), truth.read(desk.folder()?)?);
    }
    Ok(&truths[&truth.id])
}

impl Experiment for Running<'_> {
    type Job = Job;
    type Record = Record;
    type Summary = Results;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let (study, subjects) = (self.study, self.study.subjects());
        let rays = study.rays();
        let mut jobs: Vec<Job> = subjects.iter().cloned().map(|subject| Job::Truth(subject, rays)).collect();
        let of_cycles = subjects.iter().filter(|subject| study.file.curves.cycles.contains_key(&subject.density));
        if !rays.are_filtered() {
            jobs.extend(of_cycles.cloned().map(|subject| Job::Truth(subject, PixelRays::Filtered)));
        }
        if !self.only_preparation {
            jobs.extend(study.wanted.iter().cloned().map(Job::Run));
        }
        for subject in subjects {
            if !self.only_preparation {
                jobs.extend(study.file.curves.path.iter().map(|&samples| Job::PathPoint(subject.clone(), samples)));
            }
            if study.file.curves.cycles.contains_key(&subject.density) {
                jobs.push(Job::CyclesCurve(subject));
            }
        }
        Ok(jobs)
    }

    fn part(&self, job: &Job) -> &'static str {
        match job {
            Job::Truth(..) => truth::PART,
            Job::Run(_) => "runs",
            Job::PathPoint(..) | Job::CyclesCurve(_) => "curves",
        }
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        let truth = self.truth_inputs(job);
        Ok(match job {
            Job::Truth(..) => truth,
            Job::Run(combination) => {
                let mut key = json!({"combination": combination, "truth": truth, "timing": self.study.file.timing});
                if let Some(gpu) = &self.gpu {
                    key["adapter"] = json!(gpu.adapter());
                }
                key
            }
            Job::PathPoint(_, samples) => json!({"renderer": Renderer::Path, "samples": samples, "truth": truth}),
            Job::CyclesCurve(combination) => {
                let most = self.study.file.curves.cycles[&combination.density];
                json!({"renderer": Renderer::Cycles, "of": most, "truth": truth})
            }
        })
    }

    fn label(&self, job: &Job) -> String {
        let Combination { scene, density, .. } = job.combination();
        match job {
            Job::Truth(_, rays) => format!("truth of {density} in {scene}, {}", rays.label()),
            Job::Run(combination) => format!("run of {density} in {scene}: {}", combination.describe()),
            Job::PathPoint(_, samples) => format!("path tracing of {density} in {scene}, {samples} samples"),
            Job::CyclesCurve(_) => format!("Cycles: {density} in {scene}"),
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        match job {
            Job::Truth(combination, _) => {
                if let Some(error) = self.refusal(combination) {
                    return Ok(Found::LeftOut(error.to_string()));
                }
                let report = |done: f64, what: &str| desk.report(done, what);
                let (file, scene) = (&self.study.file, self.scene(combination));
                let made = file.truth.render(scene, &combination.density, &self.inputs(job)?, desk.ledger, &report)?;
                Ok(Found::Record(Record::Truth(made)))
            }
            Job::Run(combination) => self.measure(combination, desk),
            Job::PathPoint(combination, samples) => {
                if let Some(error) = self.refusal(combination) {
                    return Ok(Found::LeftOut(error.to_string()));
                }
                let point = self.path_point(combination, *samples, desk)?;
                Ok(Found::Record(Record::Point(Box::new(point))))
            }
            Job::CyclesCurve(combination) => {
                if let Some(error) = self.refusal(combination) {
                    return Ok(Found::LeftOut(error.to_string()));
                }
                // Cycles needs bpy where the cache has no picture: a study can do without.
                Ok(match self.cycles_curve(combination, desk) {
                    Ok(points) => Found::Record(Record::Points(points)),
                    Err(error) => Found::LeftOut(error.to_string()),
                })
            }
        }
    }

    fn heard(&mut self, job: &Job, record: &Record, desk: &Desk<'_>) -> Result<()> {
        if let (Job::Truth(combination, _), Record::Truth(truth)) = (job, record) {
            truth.check(self.scene(combination), &combination.density, desk.ledger)?;
        }
        Ok(())
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Results> {
        let mut results = Results {
            format: FORMAT.into(),
            version: env!("CARGO_PKG_VERSION").into(),
            builds: Vec::<Identity>::new(),
            study: self.study.file.clone(),
            machine: Study::machine(self.gpu.as_ref()),
            provenance: Some(Provenance::now(self.gpu.as_ref())),
            clock: Clock::of(self.gpu.as_ref()),
            truths: Vec::new(),
            runs: Vec::new(),
            front: Vec::new(),
            curves: Vec::new(),
            missing_curves: Vec::new(),
            skipped: self.study.skipped.clone(),
            ablations: Vec::new(),
            left_out: Vec::new(),
        };
        let mut without_truth: Vec<Combination> = Vec::new();
        for Done { job, found } in found {
            match (job, found) {
                (_, Found::Record(Record::Truth(truth))) => results.truths.push(truth),
                (_, Found::Record(Record::Run(run))) => results.runs.push(*run),
                (_, Found::Record(Record::Point(point))) => results.curves.push(*point),
                (_, Found::Record(Record::Points(points))) => results.curves.extend(points),
                (Job::Truth(combination, _), Found::LeftOut(_)) => without_truth.push(combination),
                (Job::Run(combination), Found::LeftOut(reason)) => {
                    results.skipped.push(Skipped { combination, reason });
                }
                // What has no truth has no curves.
                (Job::CyclesCurve(combination), Found::LeftOut(reason)) if !without_truth.contains(&combination) => {
                    let Combination { scene, density, .. } = combination;
                    results.missing_curves.push(MissingCurve { renderer: Renderer::Cycles, scene, density, reason });
                }
                (Job::PathPoint(..) | Job::CyclesCurve(_), Found::LeftOut(_)) => {}
            }
        }
        results.truths.sort_by(|a, b| (&a.scene, &a.density, a.rays as u8).cmp(&(&b.scene, &b.density, b.rays as u8)));
        results.curves.sort_by(|a, b| (&a.scene, &a.density).cmp(&(&b.scene, &b.density)));
        results.front =
            results.pareto_fronts().into_iter().flat_map(|(_, _, runs)| runs).map(|run| run.id.clone()).collect();
        results.builds = desk.ledger.builds();
        if self.only_preparation {
            return Ok(results);
        }
        let folder = desk.folder()?;
        results.ablations = results.ablations(folder)?;
        // Before what needs packages: whatever they do, these are there.
        results.write(folder)?;
        if let Err(error) = results.add_flip(desk.ledger, folder) {
            results.left_out.push(format!("HDR-FLIP: {error}"));
        }
        results.builds = desk.ledger.builds();
        results.write(folder)?;
        Ok(results)
    }
}
