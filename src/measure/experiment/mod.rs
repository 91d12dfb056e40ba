//! The harness of all experiments: a plan of jobs, a record for each, a summary of them all.
//!
//! An [`Experiment`] says what its jobs are, what each depends on and how it is done. [`run`] does the rest: it opens the ledger of the folder
//! (one process at a time, or shards), does the jobs that have no record yet, keeps each record as soon as it is there with what it took,
//! reports progress, and sums up when all records are there. A run that was killed goes on where it stopped.
//!
//! **Shards** ([`Shard`]) take jobs in turn from one plan. Several may work at the same time in one folder (on a file system that they share), each
//! on a machine of its own where times are measured: what two of them need, such as a truth, is made by one while the other waits. Or
//! each has a folder of its own, and a merge ([`Merge`]) brings the files of all into one: records are named by what they depend on, so that
//! nothing is overwritten by anything else. The shard that finds the last record sums up; so does a run without shards, which does what is
//! missing, and a merge, which refuses to do so.

mod merge;
mod shard;

pub use merge::Merge;
pub use shard::Shard;

use crate::base::error::{Error, Result};
use crate::base::identity::Resume;
use crate::base::ledger::{Begin, Found, Ledger, Purpose, Sharing};
use crate::base::progress::Progress;
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::Value as Json;
use std::path::Path;

/// An experiment: jobs, what each comes to, and what all say together.
pub trait Experiment {
    /// A unit of work: small enough that losing one does not hurt.
    type Job;
    /// What a job came to, as its file holds it.
    type Record: Serialize + DeserializeOwned;
    /// What all records say.
    type Summary;

    /// What the folder is for.
    fn purpose(&self) -> Purpose;

    /// All jobs, in the order in which they are done. A job may obtain the records of others, whatever the order.
    fn plan(&self) -> Result<Vec<Self::Job>>;

    /// The part of the folder with a job's record.
    fn part(&self, _job: &Self::Job) -> &'static str {
        "records"
    }

    /// All that a job's record depends on, but for the build.
    fn inputs(&self, job: &Self::Job) -> Result<Json>;

    /// The job in a few words, for progress.
    fn label(&self, job: &Self::Job) -> String;

    /// Does a job.
    fn run(&mut self, job: &Self::Job, desk: &Desk<'_>) -> Result<Found<Self::Record>>;

    /// Hears of every record as soon as it is there, made now or before.
    fn heard(&mut self, _job: &Self::Job, _record: &Self::Record, _desk: &Desk<'_>) -> Result<()> {
        Ok(())
    }

    /// Sums up what every job came to, in the order of the plan.
    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Self::Summary>;
}

/// A job that is done.
pub struct Done<E: Experiment + ?Sized> {
    /// The job.
    pub job: E::Job,
    /// What it came to.
    pub found: Found<E::Record>,
}

/// The records of jobs, those that were left out not.
pub fn records<E: Experiment>(found: Vec<Done<E>>) -> Vec<E::Record> {
    let record = |done: Done<E>| match done.found {
        Found::Record(record) => Some(record),
        Found::LeftOut(_) => None,
    };
    found.into_iter().filter_map(record).collect()
}

/// How an experiment is run.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    /// Whose work is gone on with.
    pub resume: Resume,
    /// Which part of the plan is done.
    pub shard: Shard,
    /// Records of which folders are taken over first.
    pub merge: Merge,
}

impl Settings {
    /// All of the plan.
    pub fn of(resume: Resume) -> Self {
        Self { resume, ..Self::default() }
    }
}

/// What a job works with.
pub struct Desk<'a> {
    /// The records.
    pub ledger: &'a Ledger,
    /// Whose work is gone on with.
    pub resume: &'a Resume,
    /// The key of the job's record.
    pub key: &'a str,
    progress: Progress<'a>,
    /// What of the run is done before the job, and after it.
    share: [f64; 2],
    label: &'a str,
}

impl Desk<'_> {
    /// The folder of the experiment.
    pub fn folder(&self) -> Result<&Path> {
        self.ledger.folder().ok_or_else(|| {
            Error::new(
                "the experiment",
                "no folder",
                "one that keeps pictures and records",
                "Name a folder for the results.",
            )
        })
    }

    /// Reports how much of the job is done, 0 to 1, and with what.
    pub fn report(&self, done: f64, what: &str) {
        let [before, after] = self.share;
        let text = if what.is_empty() { self.label.to_owned() } else { format!("{}: {what}", self.label) };
        (self.progress)(before + done.clamp(0.0, 1.0) * (after - before), &text);
    }

    /// A record that the job needs besides its own: there already, or made now.
    pub fn obtain<T: Serialize + DeserializeOwned>(
        &self,
        part: &str,
        inputs: &Json,
        make: impl FnOnce(&str) -> Result<T>,
    ) -> Result<T> {
        let key = self.ledger.key(inputs);
        self.ledger.obtain(part, &key, || make(&key))
    }
}

/// What a run came to.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<S> {
    /// Everything is there.
    All(S),
    /// Other shards have not done their parts.
    Part {
        /// Records that are there.
        done: usize,
        /// Jobs of the plan.
        of: usize,
    },
}

impl<S> Outcome<S> {
    /// The summary; an error where other shards have to go on first.
    pub fn all(self) -> Result<S> {
        match self {
            Self::All(summary) => Ok(summary),
            Self::Part { done, of } => Err(Error::new(
                "the plan",
                format!("{done} of {of} records"),
                "all of them",
                "Run the other shards, and merge their folders.",
            )),
        }
    }
}

/// Runs an experiment in a folder; without one nothing is kept.
pub fn run<E: Experiment>(
    experiment: &mut E,
    folder: Option<&Path>,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<E::Summary>> {
    let Settings { resume, shard, merge } = settings;
    let sharing = if shard.is_all() { Sharing::Alone } else { Sharing::Shared };
    let purpose = experiment.purpose();
    let ledger = match folder {
        Some(folder) => {
            merge.check(folder, &purpose, resume)?;
            Ledger::open(folder, purpose.clone(), resume, sharing)?
        }
        None if shard.is_all() && merge.from.is_empty() => Ledger::in_memory(purpose, resume),
        None => {
            return Err(Error::new(
                "the shard",
                "a part of a plan, and no folder",
                "a folder in which the records of all shards come together",
                "Name a folder, or run all of the plan.",
            ));
        }
    };
    if !shard.is_all() {
        ledger.note_shard(&shard.to_string())?;
    }
    let jobs = experiment.plan()?;
    let count = jobs.len();
    let keys = jobs.iter().map(|job| Ok(ledger.key(&experiment.inputs(job)?))).collect::<Result<Vec<_>>>()?;
    if let Some(folder) = folder.filter(|_| !merge.from.is_empty()) {
        let plan = jobs.iter().zip(&keys).map(|(job, key)| (experiment.part(job), key.as_str())).collect::<Vec<_>>();
        let shards = merge.bring(folder, &experiment.purpose(), &ledger, &plan)?;
        if merge.only {
            merge.nothing_missing(&ledger, &plan, &shards, &|position| experiment.label(&jobs[position]))?;
        }
    }
    let mut found: Vec<Option<Found<E::Record>>> = Vec::with_capacity(count);
    for (position, (job, key)) in jobs.iter().zip(&keys).enumerate() {
        let label = experiment.label(job);
        let share = [position, position + 1].map(|jobs| jobs as f64 / count as f64);
        let desk = Desk { ledger: &ledger, resume, key, progress, share, label: &label };
        let own = !merge.only && shard.has(position);
        let result = if own { do_job(experiment, job, &desk)? } else { ledger.find(experiment.part(job), key)? };
        if let Some(Found::Record(record)) = &result {
            experiment.heard(job, record, &desk)?;
        }
        found.push(result);
    }
    // What other shards did meanwhile.
    for ((job, key), result) in jobs.iter().zip(&keys).zip(&mut found) {
        if result.is_none() {
            *result = ledger.find(experiment.part(job), key)?;
        }
    }
    let done = found.iter().flatten().count();
    if done < count {
        return Ok(Outcome::Part { done, of: count });
    }
    let desk = Desk { ledger: &ledger, resume, key: "", progress, share: [1.0, 1.0], label: "summary" };
    let all = jobs.into_iter().zip(found.into_iter().flatten()).map(|(job, found)| Done { job, found }).collect();
    experiment.summary(all, &desk).map(Outcome::All)
}

/// The record of a job, which is done where it has none.
fn do_job<E: Experiment>(experiment: &mut E, job: &E::Job, desk: &Desk<'_>) -> Result<Option<Found<E::Record>>> {
    let (ledger, part) = (desk.ledger, experiment.part(job));
    if let Some(record) = ledger.read(part, desk.key)? {
        return Ok(Some(Found::Record(record)));
    }
    let _claim = ledger.claim(part, desk.key)?;
    if let Some(record) = ledger.read(part, desk.key)? {
        return Ok(Some(Found::Record(record)));
    }
    desk.report(0.0, "");
    let begin = Begin::now();
    let found = experiment.run(job, desk)?;
    ledger.keep(part, desk.key, &found, Some(begin.spent()))?;
    Ok(Some(found))
}

#[cfg(test)]
mod tests;
