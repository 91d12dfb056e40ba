//! Numerical stability: f32, on the CPU and in WGSL, against f64 over stiff and extreme cases.
//!
//! [`run`] measures three kinds of rows. [`functions`]: the scalar functions of the integrators over all that may reach them. [`fields`]: the
//! scene's density at extreme places and under extreme values of its inputs. [`pictures`]: small pictures by every integrator under
//! extreme cameras, lights, objects and settings.
//!
//! The *error* of a value is its distance from the f64 value over the larger of that value's magnitude and the row's *scale*: the
//! smallest normal f32 for functions, so that the error is relative everywhere; the largest magnitude of the row for fields and pictures.
//! A row has a *limit* of this error with its reason, and a *bound* per value: what f32 may be off by, derived ([`Bound`] says how) and never
//! fitted. Every value within the limit is a pass. A row beyond it, but with every value within its bound, has reached the limit of f32:
//! `limit`, with the bound's reason. Anything else fails, and so does a value that is NaN or infinite.

pub mod fields;
pub mod functions;
pub mod guards;
pub mod pictures;
mod text;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::gpu::Gpu;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::path::Path;

/// What was found about a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Verdict {
    /// Every value is finite and within the limit.
    Pass,
    /// Beyond the limit, but every value within the derived bound of what f32 may be off by.
    Limit,
    /// A value is NaN or infinite, or beyond its bound.
    Fails,
}

impl Verdict {
    /// The verdict in a word.
    pub fn word(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Limit => "limit",
            Self::Fails => "FAILS",
        }
    }
}

/// What a row measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// A scalar function.
    Function,
    /// The density of the scene.
    Field,
    /// A picture.
    Picture,
}

/// A row of the table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judgement {
    /// Unique name: subject, case and evaluator.
    pub id: String,
    /// What was measured.
    pub subject: Subject,
    /// What is varied, and over which range.
    pub varied: String,
    /// What was compared with what.
    pub evaluator: String,
    /// Number of values.
    pub values: usize,
    /// Those that are NaN or infinite.
    pub nonfinite: usize,
    /// Largest error; the module's head defines it.
    pub max_error: f64,
    /// Largest error over its bound; 1 is as far off as f32 may be. None where nothing bounds a value that is off.
    pub share_of_bound: Option<f64>,
    /// Largest error of a pass.
    pub limit: f64,
    /// Where limit and bound come from.
    pub reason: String,
    /// What keeps the values finite and accurate: names in [`guards::GUARDS`].
    pub guards: Vec<String>,
    /// Whether it is what Cycles does, and how that is known.
    pub cycles: String,
    /// What was found.
    pub verdict: Verdict,
}

/// All rows of a scene. Serialises as `stability.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Table {
    /// Name of the scene.
    pub scene: String,
    /// Name of the scene whose pictures were taken: itself, or a lighter one.
    pub pictures_of: String,
    /// Hash of its content.
    pub scene_sha256: String,
    /// The builds that measured it; none in a file from before builds had an identity.
    #[serde(default)]
    pub builds: Vec<Identity>,
    /// The adapter that ran the WGSL; none: rows of WGSL are missing.
    pub adapter: Option<String>,
    /// Seconds of the suite.
    pub seconds: f64,
    /// What was not measured, and why.
    pub left_out: Vec<String>,
    /// The rows.
    pub rows: Vec<Judgement>,
    /// The guards that rows name, with their files and what shows them at work.
    pub guards: Vec<guards::Described>,
}

/// How far a value of f32 may be from that of f64, and the f64 value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bound {
    /// The f64 value.
    pub truth: f64,
    /// Largest distance from it.
    pub distance: f64,
}

/// What a row is, before its values are judged.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// See [`Judgement::id`].
    pub id: String,
    /// See [`Judgement::subject`].
    pub subject: Subject,
    /// See [`Judgement::varied`].
    pub varied: String,
    /// See [`Judgement::evaluator`].
    pub evaluator: String,
    /// See [`Judgement::limit`].
    pub limit: f64,
    /// See [`Judgement::reason`].
    pub reason: String,
    /// See [`Judgement::guards`].
    pub guards: Vec<&'static str>,
    /// See [`Judgement::cycles`].
    pub cycles: String,
}

impl Head {
    /// Judges values against their bounds, which are one each.
    pub fn judge(self, scale: f64, values: &[f64], bounds: &[Bound]) -> Judgement {
        assert_eq!(values.len(), bounds.len(), "a bound per value");
        let mut nonfinite = 0;
        let (mut max_error, mut share_of_bound) = (0.0_f64, 0.0_f64);
        for (&value, bound) in values.iter().zip(bounds) {
            if !(value.is_finite() && bound.truth.is_finite()) {
                nonfinite += 1;
                continue;
            }
            let distance = (value - bound.truth).abs();
            max_error = max_error.max(distance / bound.truth.abs().max(scale));
            if distance > 0.0 {
                // A bound of 0 allows nothing; one that is not finite says nothing.
                let says = bound.distance > 0.0 && bound.distance.is_finite();
                let share = if says { distance / bound.distance } else { f64::INFINITY };
                share_of_bound = share_of_bound.max(share);
            }
        }
        let verdict = if nonfinite > 0 {
            Verdict::Fails
        } else if max_error <= self.limit {
            Verdict::Pass
        } else if share_of_bound <= 1.0 {
            Verdict::Limit
        } else {
            Verdict::Fails
        };
        Judgement {
            id: self.id,
            subject: self.subject,
            varied: self.varied,
            evaluator: self.evaluator,
            values: values.len(),
            nonfinite,
            max_error,
            share_of_bound: share_of_bound.is_finite().then_some(share_of_bound),
            limit: self.limit,
            reason: self.reason,
            guards: self.guards.into_iter().map(str::to_owned).collect(),
            cycles: self.cycles,
            verdict,
        }
    }
}

/// Format of the records.
const FORMAT: &str = "cloudparity-stability/1";

/// A unit of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    /// Scalar functions.
    Kernels,
    /// The field in the case of a number.
    Field(usize),
    /// The march of engines in media of closed form.
    Engines,
    /// Pictures of the scene in the case of a number.
    Picture(usize),
}

/// Rows of a job.
#[derive(Serialize, Deserialize)]
struct Rows {
    rows: Vec<Judgement>,
    /// Why paths were not traced on the adapter.
    no_paths: Option<String>,
    seconds: f64,
}

/// The suite while it is measured.
struct Running<'a> {
    scene: &'a Scene,
    pictures_of: &'a Scene,
    gpu: Option<&'a Gpu>,
    fields: Vec<fields::Case>,
    pictures: Vec<pictures::Case>,
}

/// Measures the suite: functions, the fields of a scene, and pictures of `pictures_of`, which may be a lighter scene; rows of WGSL where there
/// is an adapter. On the committed linear ramp it takes 28 seconds of processor time with a software adapter. Pictures of a heavy graph take
/// a minute each there, which goes into compiling it anew for every case. Without a folder nothing is kept.
pub fn run(
    scene: &Scene,
    pictures_of: &Scene,
    gpu: Option<&Gpu>,
    folder: Option<&Path>,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Table>> {
    if let Some(second) = [scene, pictures_of].into_iter().find_map(|scene| scene.other_volumes.first()) {
        return Err(Error::new(
            format!("object {}", second.object),
            "a second volume object",
            "one: the suite varies a single medium",
            "Take a scene with one volume object.",
        ));
    }
    let (fields, pictures) = (fields::cases(scene)?, pictures::cases(pictures_of)?);
    let mut running = Running { scene, pictures_of, gpu, fields, pictures };
    experiment::run(&mut running, folder, settings, progress)
}

impl Experiment for Running<'_> {
    type Job = Job;
    type Record = Rows;
    type Summary = Table;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: FORMAT, of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let fields = (0..self.fields.len()).map(Job::Field);
        let pictures = (0..self.pictures.len()).map(Job::Picture);
        Ok([Job::Kernels].into_iter().chain(fields).chain([Job::Engines]).chain(pictures).collect())
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        let (what, scene) = match job {
            Job::Kernels | Job::Engines => (format!("{job:?}"), None),
            Job::Field(number) => (format!("field {}", self.fields[*number].name), Some(self.scene)),
            Job::Picture(number) => (format!("picture {}", self.pictures[*number].name), Some(self.pictures_of)),
        };
        Ok(json!({"what": what, "scene": scene.map(Scene::content_hash), "adapter": self.gpu.map(Gpu::adapter)}))
    }

    fn label(&self, job: &Job) -> String {
        match job {
            Job::Kernels => "functions".into(),
            Job::Engines => "the march of engines".into(),
            Job::Field(number) => format!("fields: {}", self.fields[*number].name),
            Job::Picture(number) => format!("pictures: {}", self.pictures[*number].name),
        }
    }

    fn run(&mut self, job: &Job, _desk: &Desk<'_>) -> Result<Found<Rows>> {
        let begin = std::time::Instant::now();
        let (rows, no_paths) = match *job {
            Job::Kernels => (functions::rows(self.gpu)?, None),
            Job::Engines => (pictures::engine_rows(self.gpu)?, None),
            Job::Field(number) => (fields::rows(&self.fields[number], self.gpu)?, None),
            Job::Picture(number) => pictures::rows(&self.pictures[number], self.gpu)?,
        };
        Ok(Found::Record(Rows { rows, no_paths, seconds: begin.elapsed().as_secs_f64() }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Table> {
        let (mut rows, mut seconds) = (Vec::new(), 0.0);
        // By case: what the adapter does not know it refuses for all alike, and is a failure where it refuses one and traced another.
        let mut without_paths: Vec<(String, Option<String>)> = Vec::new();
        for Done { job, found } in found {
            let Found::Record(record) = found else { continue };
            seconds += record.seconds;
            rows.extend(record.rows);
            if let Job::Picture(number) = job {
                let case = &self.pictures[number];
                if case.has_paths {
                    without_paths.push((case.name.clone(), record.no_paths));
                }
            }
        }
        let refused = without_paths.iter().filter(|(_, reason)| reason.is_some()).count();
        if refused > 0 && refused < without_paths.len() {
            let (name, reason) = without_paths.into_iter().find(|(_, reason)| reason.is_some()).unwrap_or_default();
            return Err(Error::new(
                format!("pictures of the case {name}"),
                reason.unwrap_or_default(),
                "paths on the adapter, as in the other cases",
                "Report this defect.",
            ));
        }
        let guards = guards::described(&rows)?;
        Ok(Table {
            scene: self.scene.name.clone(),
            pictures_of: self.pictures_of.name.clone(),
            scene_sha256: self.scene.content_hash(),
            builds: desk.ledger.builds(),
            adapter: self.gpu.map(|gpu| format!("{} ({})", gpu.adapter().name, gpu.adapter().backend)),
            seconds,
            left_out: without_paths.into_iter().filter_map(|(_, reason)| reason).take(1).collect(),
            rows,
            guards,
        })
    }
}

impl Table {
    /// Whether no row fails, and every guard is at work.
    pub fn holds(&self) -> bool {
        self.rows.iter().all(|row| row.verdict != Verdict::Fails) && self.guards.iter().all(|guard| guard.holds)
    }

    /// Rows of a verdict.
    pub fn count(&self, verdict: Verdict) -> usize {
        self.rows.iter().filter(|row| row.verdict == verdict).count()
    }

    /// Writes `stability.json` and `stability.csv` into a folder.
    pub fn write(&self, folder: &Path) -> Result<()> {
        files::write_atomically(&folder.join("stability.json"), self.json().as_bytes())?;
        files::write_atomically(&folder.join("stability.csv"), self.csv().as_bytes())
    }

    /// The document.
    pub fn json(&self) -> String {
        serde_json::to_string_pretty(self).expect("a table serialises") + "\n"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn head(limit: f64) -> Head {
        Head {
            id: "test".into(),
            subject: Subject::Function,
            varied: "a number".into(),
            evaluator: "f32".into(),
            limit,
            reason: String::new(),
            guards: Vec::new(),
            cycles: String::new(),
        }
    }

    fn bound(truth: f64, distance: f64) -> Bound {
        Bound { truth, distance }
    }

    #[test]
    fn values_within_the_limit_pass_and_those_within_their_bounds_are_at_the_limit() {
        let verdict = |limit, value, truth| head(limit).judge(1e-30, &[value], &[truth]).verdict;
        assert_eq!(verdict(0.1, 1.05, bound(1.0, 0.0)), Verdict::Pass);
        assert_eq!(verdict(0.01, 1.05, bound(1.0, 0.06)), Verdict::Limit);
        assert_eq!(verdict(0.01, 1.05, bound(1.0, 0.04)), Verdict::Fails);
        assert_eq!(verdict(0.01, 1.05, bound(1.0, f64::NAN)), Verdict::Fails);
    }

    #[test]
    fn what_is_not_finite_fails_whatever_the_limit() {
        for value in [f64::NAN, f64::INFINITY] {
            let row = head(f64::MAX).judge(1.0, &[1.0, value], &[bound(1.0, 1e9); 2]);
            assert_eq!((row.verdict, row.nonfinite), (Verdict::Fails, 1));
        }
        assert_eq!(head(1.0).judge(1.0, &[1.0], &[bound(f64::NAN, 1.0)]).verdict, Verdict::Fails);
    }
}
