//! Parity suites: scenes rendered by Cycles and by path tracing under the same settings, judged by statistics.
//!
//! A suite file lists entries; [`run`] takes each through reference (cached), render and comparison, and keeps what
//! it finds per entry, so that an interrupted run goes on. A table sums up.

use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::numbers::signed_percent;
use crate::base::plain_text::markdown;
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::pictures::{DiffRequest, DiffResult, DisplaySettings, StatisticsSettings, Tolerances, Verdict};
use crate::measure::suite::{Case, Entry, FORMAT, Pictures, Suite};
use serde::{Deserialize, Serialize};
use serde_json::Value as Json;
use std::fmt::Write as _;
use std::path::Path;

/// What an entry came to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EntryResult {
    /// Name of the entry.
    pub name: String,
    /// What it shows.
    pub about: String,
    /// The answer.
    pub verdict: Verdict,
    /// Why, where it is not "agrees".
    pub reasons: Vec<String>,
    /// Relative difference of the image mean per colour channel, with its interval and standard error.
    pub bias: Vec<Bias>,
    /// Share of the reference that a difference may have besides noise.
    pub systematic_allowance: f64,
    /// Replicas per side.
    pub replicas: u32,
    /// Samples per pixel of a replica.
    pub samples: u32,
    /// Checks that agree, and all.
    pub checks: [usize; 2],
    /// relMSE without noise.
    pub debiased_relmse: Option<f64>,
    /// Hash of all that it depends on.
    pub identity: String,
    /// The builds that rendered and judged it.
    pub builds: Vec<Identity>,
}

/// Difference of the image mean of one channel, as shares of the reference.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Bias {
    /// Channel name.
    pub channel: String,
    /// (ours - reference) / reference.
    pub relative: Option<f64>,
    /// Ends of the interval.
    pub interval: [Option<f64>; 2],
    /// Standard error.
    pub standard_error: Option<f64>,
}

/// A suite, all entries or those named, as an experiment.
struct Parity<'a> {
    cases: Vec<Case>,
    /// Results that are there, in the order of the suite.
    results: Vec<EntryResult>,
    told: &'a mut dyn FnMut(&EntryResult),
}

/// Runs the entries of a suite file, all or those named, in a folder. Results come in the order of the suite; `told` hears of each as
/// soon as it is there.
pub fn run(
    file: &Path,
    only: &[String],
    output: &Path,
    settings: &Settings,
    progress: Progress<'_>,
    told: &mut dyn FnMut(&EntryResult),
) -> Result<Outcome<Vec<EntryResult>>> {
    let suite = Suite::load(file)?;
    let folder = file.parent().unwrap_or(Path::new("."));
    let cases = suite.chosen(only)?.into_iter().map(|entry| Case::new(entry, folder)).collect::<Result<_>>()?;
    let mut parity = Parity { cases, results: Vec::new(), told };
    experiment::run(&mut parity, Some(output), settings, progress)
}

impl Experiment for Parity<'_> {
    /// The position of an entry.
    type Job = usize;
    type Record = EntryResult;
    type Summary = Vec<EntryResult>;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: FORMAT, of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<usize>> {
        Ok((0..self.cases.len()).collect())
    }

    fn inputs(&self, job: &usize) -> Result<Json> {
        Ok(self.cases[*job].inputs())
    }

    fn label(&self, job: &usize) -> String {
        self.cases[*job].entry.name.clone()
    }

    fn run(&mut self, job: &usize, desk: &Desk<'_>) -> Result<Found<EntryResult>> {
        let case = &self.cases[*job];
        let Pictures { references, ours, build } = case.pictures(desk)?;
        desk.report(0.9, "comparison");
        let references = references.into_iter().map(|reference| reference.path).collect();
        let request = DiffRequest {
            out: Some(desk.folder()?.join(&case.entry.name)),
            display: Some(DisplaySettings::of(&case.scene.display, None)),
            statistics: Some(StatisticsSettings {
                sub_pixels: case.entry.sub_pixels(),
                ..StatisticsSettings::default()
            }),
            ..DiffRequest::new(ours, references, Tolerances::default())
        };
        let result =
            request.run(|script, request| bridge::run_script(script, request, CyclesKernel::Default, |_| ()))?;
        let mut builds = vec![build, desk.ledger.own().clone()];
        builds.dedup();
        let found = entry_result(&case.entry, &result);
        Ok(Found::Record(EntryResult { identity: desk.key.to_owned(), builds, ..found }))
    }

    fn heard(&mut self, _job: &usize, record: &EntryResult, desk: &Desk<'_>) -> Result<()> {
        (self.told)(record);
        self.results.push(record.clone());
        write(&self.results, desk.folder()?)
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Vec<EntryResult>> {
        // Those of other shards came last.
        self.results = experiment::records(found);
        write(&self.results, desk.folder()?)?;
        Ok(std::mem::take(&mut self.results))
    }
}

/// `parity.json` and `parity.md`.
fn write(results: &[EntryResult], folder: &Path) -> Result<()> {
    files::write_atomically(&folder.join("parity.json"), to_json(&results).as_bytes())?;
    files::write_atomically(&folder.join("parity.md"), table(results).as_bytes())
}

fn entry_result(entry: &Entry, result: &DiffResult) -> EntryResult {
    let statistics = result.statistics.as_ref();
    let bias = statistics.map_or_else(Vec::new, |statistics| {
        statistics
            .means
            .iter()
            .map(|mean| Bias {
                channel: mean.channel.clone(),
                relative: mean.relative_bias,
                interval: [mean.relative_low, mean.relative_high],
                standard_error: mean.relative_standard_error,
            })
            .collect()
    });
    let agreeing = result.checks.iter().filter(|check| check.outcome == Verdict::Agrees).count();
    EntryResult {
        name: entry.name.clone(),
        about: entry.about.clone(),
        verdict: result.verdict,
        reasons: if result.verdict == Verdict::Agrees { Vec::new() } else { result.reasons.clone() },
        bias,
        systematic_allowance: statistics.map_or(0.0, |statistics| statistics.systematic_allowance),
        replicas: statistics.map_or(0, |statistics| statistics.replicas.ours),
        samples: entry.samples,
        checks: [agreeing, result.checks.len()],
        debiased_relmse: statistics.and_then(|statistics| statistics.relmse.debiased),
        identity: String::new(),
        builds: Vec::new(),
    }
}

/// The rows as a Markdown table.
pub fn table(rows: &[EntryResult]) -> String {
    let mut text = String::from(
        "| scene | verdict | checks | replicas x samples | bias of the mean (99 % interval), per channel | largest \
         standard error | allowance |\n| --- | --- | --- | --- | --- | --- | --- |\n",
    );
    for row in rows {
        let biases: Vec<String> = row
            .bias
            .iter()
            .map(|bias| {
                let [low, high] = bias.interval.map(signed_percent);
                format!("{} {} ({low} to {high})", bias.channel, signed_percent(bias.relative))
            })
            .collect();
        let error = row.bias.iter().filter_map(|bias| bias.standard_error).fold(0.0, f64::max);
        writeln!(
            text,
            "| {}: {} | {} | {} of {} | {} x {} | {} | {:.3} % | {:.1} % |",
            markdown(&row.name),
            markdown(&row.about),
            row.verdict.words(),
            row.checks[0],
            row.checks[1],
            row.replicas,
            row.samples,
            biases.join("; "),
            100.0 * error,
            100.0 * row.systematic_allowance
        )
        .expect("writing to a string cannot fail");
    }
    text
}
