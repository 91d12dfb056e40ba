//! How long path tracing takes to the error that Cycles has after so many samples.
//!
//! The entries of a parity suite whose replicas are sub-pixel images say which scenes, and give both sides' pictures: one
//! combined reference, in which each counts by its noise, and how noisy a sample of either is against it
//! (`blend/sample_errors.py` has the formulas). Then path tracing renders each scene anew with as many samples as the error needs, several
//! pictures where samples are few, and their error is measured too: more samples where it misses the target, fewer where fewer should do,
//! until the least number is known. Where that would take longer than [`TimeSettings::longest`], fewer samples are rendered and time and
//! error taken in proportion; the row says so.
//!
//! As an experiment, what a sample of a way of tracking gives and costs is a job, and so is each race.
//!
//! Times are seconds of processor time of all threads, on both sides: a machine that does other things beside stretches
//! them less than a clock on the wall. Preparation is what comes before the first sample: Cycles' evaluation of the density on a
//! grid, our bounds.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::plain_text::markdown;
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::bridge::reference::{ReferenceSettings, cache_folder, reference};
use crate::integrators::path;
use crate::integrators::path::{PathSettings, Tracking};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::seeds;
use crate::measure::suite::{Case, Suite};
use crate::measure::timing::{cycles_seconds, timed_picture};
use crate::scene::Scene;
use crate::scene::image::Image;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Format of the results.
const FORMAT: &str = "cloudparity-time-to-error/2";

/// Sub-pixels per axis of Cycles' ray marching: four replicas, enough to part noise from bias.
const MARCHING_SUB_PIXELS: u32 = 2;

/// Pictures of few samples, at most, whose mean error counts.
const MOST_PICTURES: u32 = 4;

/// What is measured.
#[derive(Debug, Clone)]
pub struct TimeSettings {
    /// Samples of Cycles whose error is the target.
    pub levels: Vec<u32>,
    /// Also compare with Cycles' ray marching at that step rate.
    pub marching_rate: Option<f64>,
    /// Ways of tracking.
    pub trackings: Vec<Tracking>,
    /// Seconds of processor time beyond which a render is cut short and taken in proportion.
    pub longest: f64,
}

impl Default for TimeSettings {
    fn default() -> Self {
        Self {
            levels: vec![64, 1024],
            marching_rate: Some(1.0),
            trackings: vec![Tracking::Proven, Tracking::Adaptive],
            longest: 300.0,
        }
    }
}

/// Cycles' side: a mode and what its samples cost and give.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Cycles {
    /// "null collision" or "ray marching" with its rate.
    pub mode: String,
    /// Processor seconds before the first sample.
    pub preparation: f64,
    /// Processor seconds of a sample of every pixel.
    pub per_sample: f64,
    /// relMSE of a sample of every pixel without its bias.
    pub noise_per_sample: f64,
    /// Squared bias relative to the combined reference, as part of relMSE; none below 0.
    pub squared_bias: f64,
}

impl Cycles {
    fn error(&self, samples: u32) -> f64 {
        self.squared_bias + self.noise_per_sample / f64::from(samples)
    }

    fn seconds(&self, samples: u32) -> f64 {
        self.per_sample * f64::from(samples)
    }
}

/// One race to an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ErrorRace {
    /// The entry of the suite.
    pub name: String,
    /// Cycles' mode.
    pub mode: String,
    /// Cycles' samples.
    pub samples: u32,
    /// Its relMSE, which is the target.
    pub error: f64,
    /// Its processor seconds: preparation, samples.
    pub cycles_seconds: [f64; 2],
    /// Our tracking.
    pub tracking: Tracking,
    /// Samples that the error takes us: the least number found whose pictures reach it.
    pub our_samples: u32,
    /// Our pictures of so many samples, each of another seed.
    pub our_pictures: u32,
    /// Our relMSE, the mean of the timed pictures' (in proportion where they have fewer samples).
    pub our_error: f64,
    /// Our processor seconds for a picture, the mean: preparation, samples.
    pub our_seconds: [f64; 2],
    /// Share of the samples that was rendered; below 1 the figures are taken in proportion.
    pub rendered_share: f64,
    /// Cycles' time over ours, preparation included.
    pub ratio: f64,
    /// The same without it, on both sides.
    pub ratio_without_preparation: f64,
    /// Cycles' preparation over ours: its sampled majorants against our proven ones.
    pub preparation_ratio: f64,
}

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TimeToError {
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// Cycles' modes by entry.
    pub cycles: Vec<(String, Vec<Cycles>)>,
    /// The races.
    pub rows: Vec<ErrorRace>,
}

/// What both sides give and cost by the sample: Cycles in its modes, ours by one way of tracking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Samples {
    cycles: Vec<Cycles>,
    /// relMSE of a sample of every pixel by ours, without its bias.
    noise: f64,
    /// Squared bias of ours relative to the combined reference.
    squared_bias: f64,
    /// Processor seconds of a sample of every pixel by ours.
    per_sample: f64,
}

/// Our side of a scene: pictures of so many samples, and the means of their processor seconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Timed {
    /// Below the folder.
    files: Vec<String>,
    preparation: f64,
    rendering: f64,
    /// The mean of their relMSE against the combined reference.
    error: f64,
}

/// The search for the least number of samples whose error is not above a target.
#[derive(Debug, Default)]
struct Least {
    /// Most samples that missed it.
    missed: u32,
    /// Fewest samples that reached it.
    reached: Option<u32>,
}

impl Least {
    /// What to try after so many samples came to `ratio` times the target, if errors fall about as one over the samples; `None` when what missed it
    /// and what reached it are 2 % apart, or one sample, or when what reached it came out at an error that asks for no fewer.
    fn next(&mut self, samples: u32, ratio: f64) -> Option<u32> {
        let asked = (f64::from(samples) * ratio).ceil().clamp(1.0, f64::from(path::MOST_SAMPLES)) as u32;
        if ratio <= 1.0 {
            self.reached = Some(self.reached.map_or(samples, |least| least.min(samples)));
        } else {
            self.missed = self.missed.max(samples);
        }
        // Not sample by sample where a bias keeps the error from falling.
        let fewest = self.missed + 1 + self.missed / 50;
        match self.reached {
            None => (samples < path::MOST_SAMPLES).then(|| asked.max(fewest).min(path::MOST_SAMPLES)),
            Some(least) if asked >= least && least == samples => None,
            Some(least) => (fewest < least).then(|| asked.clamp(fewest, least - 1)),
        }
    }
}

/// A unit of work on a case of the suite.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Job {
    case: usize,
    tracking: Tracking,
    /// The race to the error of a mode of Cycles at so many samples; none: what a sample gives and costs.
    race: Option<(usize, u32)>,
}

/// What a job came to; its file holds the content alone.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Record {
    Samples(Samples),
    Race(Box<ErrorRace>),
}

/// The suite's cases while they are measured.
struct Running<'a> {
    cases: Vec<Case>,
    settings: &'a TimeSettings,
    found: TimeToError,
}

/// Measures the entries of a suite that have sub-pixel replicas, all or those named. References come from the cache; pictures
/// and `time_to_error.json` and `.md` go to `output`.
pub fn run(
    file: &Path,
    only: &[String],
    output: &Path,
    what: &TimeSettings,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<TimeToError>> {
    let suite = Suite::load(file)?;
    let folder = file.parent().unwrap_or(Path::new("."));
    let chosen = suite.chosen(only)?.into_iter().filter(|entry| entry.sub_pixels().is_some());
    let cases: Vec<Case> = chosen.map(|entry| Case::new(entry, folder)).collect::<Result<_>>()?;
    if cases.is_empty() || what.levels.is_empty() || what.trackings.is_empty() {
        return Err(Error::new(
            file.display().to_string(),
            "nothing to measure",
            "entries with sub_pixels replicas, levels of samples and ways of tracking",
            "Name another suite or entry.",
        ));
    }
    let found = TimeToError { builds: Vec::new(), cycles: Vec::new(), rows: Vec::new() };
    experiment::run(&mut Running { cases, settings: what, found }, Some(output), settings, progress)
}

impl Running<'_> {
    /// All that what a sample gives and costs depends on.
    fn sample_inputs(&self, job: &Job) -> Json {
        let Job { case, tracking, .. } = *job;
        json!({"case": self.cases[case].inputs(), "tracking": tracking, "marching": self.settings.marching_rate})
    }

    /// What both sides give and cost by the sample.
    fn samples(&self, job: &Job, desk: &Desk<'_>) -> Result<Samples> {
        let case = &self.cases[job.case];
        let both = Both::new(case, desk)?;
        let mut others = Vec::new();
        if let Some(rate) = self.settings.marching_rate {
            let mut marched = case.scene.clone();
            marched.film.resolution = both.scene.film.resolution.map(|side| side * MARCHING_SUB_PIXELS);
            let settings =
                ReferenceSettings { volume_biased: true, step_rate: rate, ..case.entry.reference_settings() };
            desk.report(0.5, "ray marching by Cycles");
            others.push((rate, reference(&marched, &settings, &cache_folder()?, |_| ())?.path));
        }
        desk.report(0.6, "errors");
        let asked: Vec<Json> =
            others.iter().map(|(_, file)| json!({"file": file, "sub_pixels": MARCHING_SUB_PIXELS})).collect();
        let errors = both.ask(&asked)?;
        let samples = f64::from(case.entry.samples);
        let mut modes = vec![cycles("null collision", &both.cycles, &errors["cycles"], samples, both.cells)?];
        for (rate, file) in &others {
            let name = format!("ray marching, rate {rate}");
            modes.push(cycles(&name, file, &errors["others"][0], samples, MARCHING_SUB_PIXELS)?);
        }
        let our_noise = number(&errors["ours"], "noise")? * samples;
        let squared_bias = number(&errors["ours"], "squared_bias")?.max(0.0);
        desk.report(0.7, &format!("{:?}, {} samples", job.tracking, case.entry.samples));
        let first = self.timed(job, case.entry.samples, &both, desk)?;
        // One picture's error is itself noisy by some per cent; where tracking is that of the replicas, theirs is sharper.
        let by_picture = (first.error - squared_bias) * samples;
        let noise = if job.tracking == Tracking::default() { our_noise } else { by_picture };
        Ok(Samples { cycles: modes, noise, squared_bias, per_sample: first.rendering / samples })
    }

    /// A race to the error of a mode of Cycles at so many samples.
    fn race(&self, job: &Job, (mode, level): (usize, u32), desk: &Desk<'_>) -> Result<ErrorRace> {
        let case = &self.cases[job.case];
        let samples: Samples = desk.obtain("records", &self.sample_inputs(job), |_| self.samples(job, desk))?;
        let mode = &samples.cycles[mode];
        let target = mode.error(level);
        let needed = (samples.noise / (target - samples.squared_bias)).ceil();
        if !(needed >= 1.0 && needed <= f64::from(path::MOST_SAMPLES)) {
            return Err(Error::new(
                format!("{}, {level} samples", case.entry.name),
                format!("a target of {target:.3e} beside our own difference of {:.3e}", samples.squared_bias),
                "a target above it",
                "Give more samples to the entry of the suite: its combined reference is too noisy.",
            ));
        }
        let affordable = (self.settings.longest / samples.per_sample).max(1.0) as u32;
        let both = Both::new(case, desk)?;
        // As many as the noise of a sample says, and as many more or fewer as pictures then turn out to need: trees that are divided for fewer rays
        // may leave more noise, and samples are stratified.
        let (mut least, mut tried) = (Least::default(), needed as u32);
        let mut best: Option<(u32, f64, Timed)> = None;
        loop {
            let count = tried.min(affordable);
            desk.report(0.5, &format!("{count} samples"));
            let timed = self.timed(job, count, &both, desk)?;
            let share = f64::from(count) / f64::from(tried);
            let ratio = timed.error * share / target;
            let next = least.next(tried, ratio);
            // Where nothing reaches it, the most samples stand for it.
            if ratio <= 1.0 || least.reached.is_none() {
                best = Some((tried, share, timed));
            }
            match next {
                Some(next) => tried = next,
                None => break,
            }
        }
        let (our_samples, share, timed) = best.expect("the first trial is kept");
        let our_seconds = [timed.preparation, timed.rendering / share];
        let cycles_seconds = [mode.preparation, mode.seconds(level)];
        Ok(ErrorRace {
            name: case.entry.name.clone(),
            mode: mode.mode.clone(),
            samples: level,
            error: target,
            cycles_seconds,
            tracking: job.tracking,
            our_samples,
            our_pictures: timed.files.len() as u32,
            our_error: timed.error * share,
            our_seconds,
            rendered_share: share,
            ratio: cycles_seconds.iter().sum::<f64>() / our_seconds.iter().sum::<f64>(),
            ratio_without_preparation: cycles_seconds[1] / our_seconds[1],
            preparation_ratio: cycles_seconds[0] / our_seconds[0],
        })
    }

    /// Our pictures of so many samples, their processor seconds and their error: a record that races share. They are more the fewer samples they
    /// have, for the error of one picture of four samples scatters by a third.
    fn timed(&self, job: &Job, samples: u32, both: &Both, desk: &Desk<'_>) -> Result<Timed> {
        let case = &self.cases[job.case];
        let inputs = json!({"timed": case.inputs(), "tracking": job.tracking, "samples": samples});
        desk.obtain("timed", &inputs, |key| {
            let first = seeds::first(&inputs);
            let mut timed = Timed { files: Vec::new(), preparation: 0.0, rendering: 0.0, error: 0.0 };
            let mut asked = Vec::new();
            let pictures = 64_u32.div_ceil(samples).min(MOST_PICTURES);
            let share = 1.0 / f64::from(pictures);
            for picture in 0..pictures {
                let settings =
                    PathSettings { samples, seed: first + picture, tracking: job.tracking, ..PathSettings::default() };
                let (image, [preparation, rendering]) = timed_picture(&both.scene, &settings)?;
                let file = format!("{}/timed-{key}-{picture}.exr", case.entry.name);
                let path = desk.folder()?.join(&file);
                image.write_exr(&path, false)?;
                asked.push(json!({"file": path, "sub_pixels": 1}));
                timed.files.push(file);
                timed.preparation += preparation * share;
                timed.rendering += rendering * share;
            }
            let errors = both.ask(&asked)?;
            for picture in 0..asked.len() {
                timed.error += number(&errors["others"][picture], "error")? * share;
            }
            Ok(timed)
        })
    }
}

/// Both sides' pictures of a case, which make its combined reference.
struct Both {
    /// At the resolution of a picture.
    scene: Scene,
    ours: PathBuf,
    cycles: PathBuf,
    cells: u32,
}

impl Both {
    fn new(case: &Case, desk: &Desk<'_>) -> Result<Self> {
        let mut pictures = case.pictures(desk)?;
        let cells = case.entry.sub_pixels().unwrap_or(1);
        let mut scene = case.scene.clone();
        scene.film.resolution = scene.film.resolution.map(|side| side / cells);
        Ok(Self { scene, ours: pictures.ours.swap_remove(0), cycles: pictures.references.swap_remove(0).path, cells })
    }

    /// Errors of further pictures against the combined reference.
    fn ask(&self, others: &[Json]) -> Result<Json> {
        let Self { ours, cycles, cells, .. } = self;
        let request = json!({"ours": ours, "cycles": cycles, "sub_pixels": cells, "others": others});
        bridge::run_script("sample_errors.py", &request, CyclesKernel::Default, |_| ())
    }
}

impl Experiment for Running<'_> {
    type Job = Job;
    type Record = Record;
    type Summary = TimeToError;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: FORMAT, of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let modes = 1 + usize::from(self.settings.marching_rate.is_some());
        let mut jobs = Vec::new();
        for case in 0..self.cases.len() {
            for &tracking in &self.settings.trackings {
                jobs.push(Job { case, tracking, race: None });
                for mode in 0..modes {
                    let levels = self.settings.levels.iter();
                    jobs.extend(levels.map(|&level| Job { case, tracking, race: Some((mode, level)) }));
                }
            }
        }
        Ok(jobs)
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        let samples = self.sample_inputs(job);
        Ok(match job.race {
            None => samples,
            Some(race) => json!({"samples": samples, "race": race, "longest": self.settings.longest}),
        })
    }

    fn label(&self, job: &Job) -> String {
        let name = &self.cases[job.case].entry.name;
        match job.race {
            None => format!("{name}, {:?}", job.tracking),
            Some((_, level)) => format!("{name}, {:?}: to the error of {level} samples", job.tracking),
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        Ok(Found::Record(match job.race {
            None => Record::Samples(self.samples(job, desk)?),
            Some(race) => Record::Race(Box::new(self.race(job, race, desk)?)),
        }))
    }

    fn heard(&mut self, job: &Job, record: &Record, desk: &Desk<'_>) -> Result<()> {
        self.found.add(&self.cases[job.case].entry.name, record);
        self.found.builds = desk.ledger.builds();
        self.found.write(desk.folder()?)
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<TimeToError> {
        // In the order of the plan: what other shards did came last.
        let mut all = TimeToError { builds: desk.ledger.builds(), cycles: Vec::new(), rows: Vec::new() };
        for done in &found {
            if let Found::Record(record) = &done.found {
                all.add(&self.cases[done.job.case].entry.name, record);
            }
        }
        all.write(desk.folder()?)?;
        Ok(all)
    }
}

/// A mode of Cycles from the picture it made and what was found about it.
fn cycles(mode: &str, file: &Path, errors: &Json, samples: f64, cells: u32) -> Result<Cycles> {
    let [preparation, sampling] = cycles_seconds(&Image::read_exr(file)?, file)?;
    Ok(Cycles {
        mode: mode.to_owned(),
        preparation,
        // The picture has cells^2 times the pixels.
        per_sample: sampling / samples / f64::from(cells * cells),
        noise_per_sample: number(errors, "noise")? * samples,
        squared_bias: number(errors, "squared_bias")?.max(0.0),
    })
}

fn number(value: &Json, name: &str) -> Result<f64> {
    value[name].as_f64().ok_or_else(|| {
        Error::new("sample_errors.py", value.to_string(), format!("a number `{name}`"), "Report this defect.")
    })
}

impl TimeToError {
    fn add(&mut self, name: &str, record: &Record) {
        match record {
            Record::Samples(samples) if self.cycles.iter().all(|(known, _)| known != name) => {
                self.cycles.push((name.to_owned(), samples.cycles.clone()));
            }
            Record::Samples(_) => {}
            Record::Race(race) => self.rows.push((**race).clone()),
        }
    }

    /// `time_to_error.json` and `.md`.
    fn write(&self, folder: &Path) -> Result<()> {
        files::write_atomically(&folder.join("time_to_error.json"), to_json(self).as_bytes())?;
        files::write_atomically(&folder.join("time_to_error.md"), self.table().as_bytes())
    }

    /// The races as a Markdown table.
    pub fn table(&self) -> String {
        let mut text = String::from(
            "| scene | Cycles | relMSE | Cycles: preparation + samples (s) | tracking, samples | relMSE | ours: preparation + \
             samples (s) | ratio | without preparation | preparation alone |\n\
             | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n",
        );
        for row in &self.rows {
            let [preparation, samples] = row.cycles_seconds;
            let [our_preparation, our_rendering] = row.our_seconds;
            let cut = if row.rendered_share < 1.0 {
                format!(" ({:.0} % rendered)", 100.0 * row.rendered_share)
            } else {
                String::new()
            };
            writeln!(
                text,
                "| {} | {}, {} samples | {:.2e} | {preparation:.0} + {samples:.0} | {:?}, {}{cut} | {:.2e} | \
                 {our_preparation:.1} + {our_rendering:.1} | {:.1} | {:.1} | {} |",
                markdown(&row.name),
                row.mode,
                row.samples,
                row.error,
                row.tracking,
                row.our_samples,
                row.our_error,
                row.ratio,
                row.ratio_without_preparation,
                if preparation > 1.0 { format!("{:.0}", row.preparation_ratio) } else { "-".to_owned() },
            )
            .expect("writing to a string cannot fail");
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What the search ends with, and how often it looked.
    fn found(first: u32, error: impl Fn(u32) -> f64) -> (Option<u32>, u32) {
        let (mut least, mut tried, mut looks) = (Least::default(), first, 0);
        loop {
            looks += 1;
            assert!(looks < 60, "the search ends");
            match least.next(tried, error(tried)) {
                Some(next) => tried = next,
                None => return (least.reached, looks),
            }
        }
    }

    #[test]
    fn the_least_number_of_samples_is_found_from_either_side() {
        for goal in [1_u32, 2, 3, 7, 40, 1000] {
            for first in [1, 3, 4, 50, 2000] {
                // As of independent samples, and as of samples that are stratified.
                for power in [1.0, 1.4] {
                    let (reached, looks) = found(first, |n| (f64::from(goal) / f64::from(n)).powf(power));
                    let reached = reached.expect("it can be reached");
                    assert!(reached >= goal && reached <= goal + 1 + goal / 49, "{goal} from {first}: {reached}");
                    assert!(looks <= 12, "{goal} from {first}: {looks} looks");
                }
            }
        }
        // Nine tenths of the target are bias: 100 samples need ten times what their noise alone would.
        let (reached, looks) = found(10, |n| 0.9 + 10.0 / f64::from(n));
        assert!((100..=103).contains(&reached.expect("it can be reached")) && looks <= 40, "{reached:?} after {looks}");
    }

    #[test]
    fn a_target_out_of_reach_ends_at_the_most_samples() {
        assert_eq!(found(4, |_| 1.5).0, None);
    }
}
