//! Findings about the reference: where Cycles' pictures are not what light transport says, each with the smallest scene that shows it.
//!
//! A finding is a claim, small scenes of which Cycles renders replicas (`cases`), and figures of these with what they should be: a closed
//! form of what Cycles is claimed to do (`expected`), or the truth, which it is claimed to miss. Replicas are by seed, or disjoint subsets of one
//! sequence of samples: the first share what depends on the number of a sample alone.

mod cases;
mod expected;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::numbers::uncertain;
use crate::base::plain_text::csv_cell;
use crate::base::progress::Progress;
use crate::bridge::{self, CyclesKernel, Message, releases};
use crate::measure::errors::Uncertain;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Format of the results.
pub const FORMAT: &str = "cloudparity-findings/1";

const PURPOSE: Purpose = Purpose { mark: "findings-folder.json", format: FORMAT, of: Json::Null };

/// A figure is equal to a closed form within so many standard errors.
const EQUAL: f64 = 2.0;

/// A figure differs from a number beyond so many standard errors: a chance of 6e-7.
const DIFFERENT: f64 = 5.0;

/// Pictures are of single precision: so much of a figure that has no noise is rounding, in units of it.
const ROUNDING: f64 = 4.0 * f32::EPSILON as f64;

/// Names of all findings.
pub fn names() -> Vec<&'static str> {
    cases::findings().iter().map(|finding| finding.name).collect()
}

/// What is asked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Asked {
    /// Releases of Blender, as 5.0.1.
    pub releases: Vec<String>,
    /// Names of findings; none: all.
    pub only: Vec<String>,
}

/// A picture of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Replica {
    /// Cycles' seed.
    pub seed: u32,
    /// Number of its first sample.
    pub offset: u32,
    /// Samples of it; none: all of the scene's.
    pub length: Option<u32>,
}

/// How Cycles goes through media.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Integrator {
    /// In the release's own way.
    Own,
    /// By null collision, which only some releases have.
    NullCollision,
    /// By ray marching, with a step rate.
    March(f64),
}

/// A small scene and its replicas.
#[derive(Debug, Clone)]
struct Case {
    name: String,
    /// As `blend/cycles_findings.py` reads it.
    scene: Json,
    /// That file names of the scene are relative to. No picture depends on where it lies.
    folder: Option<PathBuf>,
    samples: u32,
    /// Width and height in pixels.
    size: [u32; 2],
    integrator: Integrator,
    replicas: Vec<Replica>,
}

impl Case {
    /// What a picture depends on: the request to the script, but for folders.
    fn request(&self) -> Json {
        let (biased, rate) = match self.integrator {
            Integrator::Own => (Json::Null, 1.0),
            Integrator::NullCollision => (json!(false), 1.0),
            Integrator::March(rate) => (json!(true), rate),
        };
        json!({
            "scene": self.scene, "samples": self.samples, "resolution": self.size, "biased": biased,
            "step_rate": rate, "replicas": self.replicas,
        })
    }
}

/// A finding.
struct Finding {
    name: &'static str,
    title: &'static str,
    claim: &'static str,
    advice: &'static str,
    cases: Vec<Case>,
    /// Figures of what was measured, in the order of the cases. A case that the release cannot render has no replicas; its figures are NaN.
    rows: fn(&[Measured]) -> Vec<Row>,
}

/// The colour channels of a replica.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// Mean over pixels and channels.
    pub mean: f64,
    /// Pixels below zero.
    pub negative: u64,
    /// The least pixel.
    pub least: f64,
    /// That Cycles took.
    pub seconds: f64,
}

/// What a case came to in a release.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The finding.
    pub finding: String,
    /// The case.
    pub name: String,
    /// As the release calls itself.
    pub blender: String,
    /// The request to `cycles_findings.py` that makes these pictures again.
    pub request: Json,
    /// Pixels of a picture.
    pub pixels: u64,
    /// One per replica.
    pub replicas: Vec<Picture>,
}

impl Measured {
    /// A case that the release cannot render.
    fn nothing(finding: &Finding, case: &Case) -> Self {
        Self {
            finding: finding.name.to_owned(),
            name: case.name.clone(),
            blender: String::new(),
            request: Json::Null,
            pixels: 0,
            replicas: Vec::new(),
        }
    }

    fn means(&self) -> Vec<f64> {
        self.replicas.iter().map(|replica| replica.mean).collect()
    }

    /// Mean over the replicas, and its standard error from their spread.
    fn mean(&self) -> Uncertain {
        of_sample(&self.means())
    }

    /// Share of pixels below zero.
    fn negative(&self) -> Uncertain {
        let shares: Vec<f64> =
            self.replicas.iter().map(|replica| replica.negative as f64 / self.pixels as f64).collect();
        of_sample(&shares)
    }

    /// One mean over another; standard error by propagation to first order.
    fn ratio(over: &Self, under: &Self) -> Uncertain {
        let (over, under) = (over.mean(), under.mean());
        let value = over.value / under.value;
        let relative = (over.standard_error / over.value).hypot(under.standard_error / under.value);
        Uncertain { value, standard_error: (value * relative).abs() }
    }

    fn scaled(value: f64, standard_error: f64, factor: f64) -> Uncertain {
        Uncertain { value: factor * value, standard_error: factor * standard_error }
    }

    /// Standard deviation of the replicas over their mean; standard error of normal variables.
    fn relative_spread(found: &Self) -> Uncertain {
        let (of, count) = (found.mean(), found.replicas.len() as f64);
        let value = of.standard_error * count.sqrt() / of.value;
        Uncertain { value, standard_error: value / (2.0 * (count - 1.0)).sqrt() }
    }

    /// Correlation of the means of two lists of replicas; standard error of normal variables without correlation, 1 / sqrt(n - 1), which
    /// is what a correlation has to exceed.
    fn correlation(one: &Self, other: &Self) -> Uncertain {
        let (one, other) = (one.means(), other.means());
        let centred = |values: &[f64]| {
            let mean = of_sample(values).value;
            values.iter().map(|value| value - mean).collect::<Vec<_>>()
        };
        let (a, b) = (centred(&one), centred(&other));
        let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        Uncertain {
            value: product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt(),
            standard_error: 1.0 / (one.len().min(other.len()) as f64 - 1.0).sqrt(),
        }
    }

    /// Ratio of the variances of two lists of replicas; standard error of normal variables of one variance (to first order), which is what
    /// a ratio has to exceed.
    fn variance_ratio(over: &Self, under: &Self) -> Uncertain {
        let variance = |found: &Self| {
            let of = of_sample(&found.means());
            of.standard_error * of.standard_error * found.replicas.len() as f64
        };
        let freedom = |found: &Self| 2.0 / (found.replicas.len() as f64 - 1.0);
        Uncertain { value: variance(over) / variance(under), standard_error: (freedom(over) + freedom(under)).sqrt() }
    }
}

/// Mean and its standard error.
fn of_sample(values: &[f64]) -> Uncertain {
    let count = values.len() as f64;
    let value = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|one| (one - value) * (one - value)).sum();
    Uncertain { value, standard_error: (squares / (count - 1.0) / count).sqrt() }
}

/// What is claimed of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Claim {
    /// It is this, a closed form, within two standard errors.
    Equals(f64),
    /// It is not this, by more than five standard errors.
    Differs(f64),
    /// It is more, by more than five standard errors.
    Above(f64),
    /// It is less, by more than five standard errors.
    Below(f64),
    /// Nothing.
    Reported,
}

impl Claim {
    /// What is claimed, in a word; nothing where nothing is.
    fn name(self) -> &'static str {
        match self {
            Self::Equals(_) => "equals",
            Self::Differs(_) => "differs",
            Self::Above(_) => "above",
            Self::Below(_) => "below",
            Self::Reported => "",
        }
    }

    /// Of which number.
    fn number(self) -> Option<f64> {
        match self {
            Self::Equals(number) | Self::Differs(number) | Self::Above(number) | Self::Below(number) => Some(number),
            Self::Reported => None,
        }
    }
}

/// A figure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What it is.
    pub name: String,
    /// As measured.
    pub value: Uncertain,
    /// What is claimed of it.
    pub claim: Claim,
    /// What light transport says.
    pub truth: Option<f64>,
    /// Where the expected value comes from.
    pub formula: String,
}

impl Row {
    /// Distance from a number, in standard errors; 0 where the rounding of a figure without noise explains it.
    pub fn deviation(&self, from: f64) -> f64 {
        let difference = self.value.value - from;
        let scale = self.value.standard_error.max(ROUNDING * self.value.value.abs() / EQUAL);
        if difference == 0.0 { 0.0 } else { difference / scale }
    }

    /// Whether the claim holds; none where there is none.
    pub fn holds(&self) -> Option<bool> {
        match self.claim {
            Claim::Equals(expected) => Some(self.deviation(expected).abs() <= EQUAL),
            Claim::Differs(from) => Some(self.deviation(from).abs() > DIFFERENT),
            Claim::Above(from) => Some(self.deviation(from) > DIFFERENT),
            Claim::Below(from) => Some(self.deviation(from) < -DIFFERENT),
            Claim::Reported => None,
        }
    }

    /// Name, measured, claimed, whether that holds, truth.
    fn cells(&self) -> [String; 5] {
        let from = self.claim.number();
        let claimed = match (self.claim, from) {
            (Claim::Equals(expected), _) => digits(expected),
            (Claim::Differs(other), _) => format!("not {}", digits(other)),
            (claim, Some(from)) => format!("{} {}", claim.name(), digits(from)),
            (_, None) => String::new(),
        };
        let holds = match (self.holds(), from) {
            (Some(holds), Some(from)) => {
                let deviation = self.deviation(from);
                // Of a figure without noise, a distance in errors says nothing.
                let distance = if deviation.abs() < 1e4 { format!(", {deviation:+.1} σ") } else { String::new() };
                format!("{}{distance}", if holds { "yes" } else { "no" }).replace('-', "−")
            }
            _ => String::new(),
        };
        let truth = self.truth.map_or_else(String::new, digits);
        [self.name.clone(), uncertain(self.value.value, self.value.standard_error), claimed, holds, truth]
    }
}

/// Five significant digits, which is what the errors of figures call for; what is nothing but rounding is 0.
fn digits(value: f64) -> String {
    if value.abs() < 1e-12 {
        return "0".into();
    }
    let decimals = (4.0 - value.abs().log10().floor()).clamp(0.0, 12.0) as usize;
    let text = format!("{value:.decimals$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    short.replace('-', "−")
}

/// A finding as a release shows it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Shown {
    /// Short name.
    pub name: String,
    /// Heading.
    pub title: String,
    /// The release, as it calls itself.
    pub blender: String,
    /// What is claimed.
    pub claim: String,
    /// What to do about it.
    pub advice: String,
    /// Whether the claims of all figures hold.
    pub confirmed: bool,
    /// Whether the claim of each figure holds; none where there is none.
    pub holding: Vec<Option<bool>>,
    /// Figures.
    pub rows: Vec<Row>,
    /// The same in words: name, measured, claimed, whether that holds, truth.
    pub cells: Vec<[String; 5]>,
    /// Pictures they are from.
    pub measured: Vec<Measured>,
}

/// Everything that was found: `findings.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Findings {
    /// [`FORMAT`].
    pub format: String,
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// What was asked.
    pub asked: Asked,
    /// By release and finding.
    pub findings: Vec<Shown>,
    /// What a release cannot show, with the reason.
    pub left_out: Vec<[String; 2]>,
}

impl Findings {
    /// Findings and figures as Markdown.
    pub fn markdown(&self) -> String {
        let mut text = String::new();
        for shown in &self.findings {
            let Shown { title, blender, claim, advice, confirmed, cells, .. } = shown;
            let verdict = if *confirmed { "confirmed" } else { "not confirmed" };
            let _ = write!(text, "## {title}\n\nBlender {blender}: **{verdict}**. {claim}\n\n");
            text += "| figure | measured | claimed | holds | truth |\n| --- | --- | --- | --- | --- |\n";
            for cells in cells {
                let _ = writeln!(text, "| {} |", cells.join(" | "));
            }
            let _ = write!(text, "\n{advice}\n\n");
        }
        for [what, reason] in &self.left_out {
            let _ = writeln!(text, "left out: {what}: {reason}");
        }
        text
    }

    /// A figure a line.
    pub fn csv(&self) -> String {
        let mut text = String::from("blender,finding,figure,value,standard_error,claim,expected,truth,holds,formula\n");
        let number = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        for shown in &self.findings {
            for row in &shown.rows {
                let holds = row.holds().map_or_else(String::new, |holds| holds.to_string());
                let _ = writeln!(
                    text,
                    "{},{},{},{},{},{},{},{},{holds},{}",
                    csv_cell(&shown.blender),
                    shown.name,
                    csv_cell(&row.name),
                    row.value.value,
                    row.value.standard_error,
                    row.claim.name(),
                    number(row.claim.number()),
                    number(row.truth),
                    csv_cell(&row.formula)
                );
            }
        }
        text
    }

    /// Draws the figure of every finding that has one, into the folder.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        let request = json!({"findings": self.findings, "folder": folder});
        bridge::run_script("findings_plot.py", &request, CyclesKernel::Default, |_| ()).map(drop)
    }
}

/// Measures findings, and what the shared order does to scenes, in a folder.
pub fn measure(
    asked: Asked,
    scenes: &[Scene],
    folder: &Path,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Findings>> {
    asked.releases.iter().try_for_each(|release| releases::check(release))?;
    let all = cases::findings();
    if let Some(unknown) = asked.only.iter().find(|name| all.iter().all(|finding| finding.name != **name)) {
        return Err(Error::new(
            "the findings",
            format!("\"{unknown}\""),
            format!("one of {}", names().join(", ")),
            "Name one of them.",
        ));
    }
    let wanted = |finding: &Finding| asked.only.is_empty() || asked.only.iter().any(|name| name == finding.name);
    let mut findings: Vec<Finding> = all.into_iter().filter(wanted).collect();
    if !scenes.is_empty() {
        findings.push(cases::of_scenes(scenes));
    }
    experiment::run(&mut Running { asked, findings }, Some(folder), settings, progress)
}

struct Running {
    asked: Asked,
    findings: Vec<Finding>,
}

/// A release, a finding and one of its cases, by their positions.
#[derive(Debug, Clone, Copy)]
struct Job {
    release: usize,
    finding: usize,
    case: usize,
}

impl Running {
    fn case(&self, job: &Job) -> &Case {
        &self.findings[job.finding].cases[job.case]
    }
}

impl Experiment for Running {
    type Job = Job;
    type Record = Measured;
    type Summary = Findings;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let releases = 0..self.asked.releases.len();
        let last = self.asked.releases.len().saturating_sub(1);
        Ok(releases
            .flat_map(|release| {
                // Scenes are the last release's: what all seeds share came with null collision.
                let findings = self.findings.iter().enumerate();
                let wanted = findings.filter(move |(_, one)| one.name != cases::SCENES || release == last);
                wanted.flat_map(move |(finding, one)| {
                    (0..one.cases.len()).map(move |case| Job { release, finding, case })
                })
            })
            .collect())
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        Ok(json!({"release": self.asked.releases[job.release], "request": self.case(job).request()}))
    }

    fn label(&self, job: &Job) -> String {
        let finding = self.findings[job.finding].name;
        format!("{finding}: {} by Blender {}", self.case(job).name, self.asked.releases[job.release])
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Measured>> {
        let (case, folder) = (self.case(job), desk.folder()?);
        let begin = Instant::now();
        let scenes = folder.join("scenes");
        files::make_folder(&scenes, "a folder that can be made")?;
        // Blender has a working folder of its own.
        let scenes = std::path::absolute(&scenes).unwrap_or(scenes);
        let request = case.request();
        let mut whole = request.clone();
        whole["folder"] = json!(scenes);
        if let Some(folder) = &case.folder {
            whole["scene"]["folder"] = json!(folder);
        }
        let finding = self.findings[job.finding].name;
        let release = &self.asked.releases[job.release];
        whole["blend"] = json!(scenes.join(format!("{finding}-{}-{release}.blend", job.case + 1)));
        let receive = |message: Message| {
            desk.report(message.done, &format!("{:.0} s", begin.elapsed().as_secs_f64()));
        };
        let answer = releases::within(release, || {
            bridge::run_script("cycles_findings.py", &whole, CyclesKernel::Default, receive)
        });
        // What one release lacks, another has; what fails in the only one is an error of the machine.
        let answer = match answer {
            Ok(answer) => answer,
            Err(error) if error.place.starts_with("request") => return Ok(Found::LeftOut(error.to_string())),
            Err(error) => return Err(error),
        };
        let broken = |cause: serde_json::Error| {
            Error::new("the answer of cycles_findings.py", cause.to_string(), "means of replicas", "Report this.")
        };
        let Answer { blender, replicas, pixels } = serde_json::from_value(answer).map_err(broken)?;
        let (finding, name) = (finding.to_owned(), case.name.clone());
        Ok(Found::Record(Measured { finding, name, blender, request, pixels, replicas }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Findings> {
        let (mut findings, mut left_out) = (Vec::new(), Vec::new());
        for (release, _) in self.asked.releases.iter().enumerate() {
            for (index, finding) in self.findings.iter().enumerate() {
                let of = |job: &Job| job.release == release && job.finding == index;
                let (mut measured, mut done) = (Vec::new(), 0);
                for Done { job, found } in found.iter().filter(|done| of(&done.job)) {
                    done += 1;
                    match found {
                        Found::Record(record) => measured.push(record.clone()),
                        Found::LeftOut(reason) => {
                            left_out.push([self.label(job), reason.clone()]);
                            measured.push(Measured::nothing(finding, self.case(job)));
                        }
                    }
                }
                // Rows belong to cases by position: a finding that is not measured to its end cannot be read.
                if done < finding.cases.len() {
                    continue;
                }
                let mut rows = (finding.rows)(&measured);
                rows.retain(|row| !row.value.value.is_nan());
                measured.retain(|one| !one.replicas.is_empty());
                if rows.is_empty() {
                    continue;
                }
                let holding: Vec<Option<bool>> = rows.iter().map(Row::holds).collect();
                findings.push(Shown {
                    name: finding.name.to_owned(),
                    title: finding.title.to_owned(),
                    blender: measured.first().map_or_else(String::new, |one| one.blender.clone()),
                    claim: finding.claim.to_owned(),
                    advice: finding.advice.to_owned(),
                    confirmed: holding.iter().all(|holds| *holds != Some(false)),
                    holding,
                    cells: rows.iter().map(Row::cells).collect(),
                    rows,
                    measured,
                });
            }
        }
        let (format, builds, asked) = (FORMAT.into(), desk.ledger.builds(), self.asked.clone());
        let all = Findings { format, builds, asked, findings, left_out };
        let folder = desk.folder()?;
        files::write_atomically(&folder.join("findings.json"), to_json(&all).as_bytes())?;
        files::write_atomically(&folder.join("findings.md"), all.markdown().as_bytes())?;
        files::write_atomically(&folder.join("findings.csv"), all.csv().as_bytes())?;
        Ok(all)
    }
}

/// The answer of the script.
#[derive(Deserialize)]
struct Answer {
    blender: String,
    replicas: Vec<Picture>,
    pixels: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(means: &[f64]) -> Measured {
        let picture = |&mean: &f64| Picture { mean, negative: u64::from(mean < 0.0), least: mean, seconds: 1.0 };
        Measured {
            finding: "order".into(),
            name: "case".into(),
            blender: "5.0.1".into(),
            request: Json::Null,
            pixels: 4,
            replicas: means.iter().map(picture).collect(),
        }
    }

    fn row(value: f64, standard_error: f64, claim: Claim) -> Row {
        Row {
            name: "row".into(),
            value: Uncertain { value, standard_error },
            claim,
            truth: None,
            formula: String::new(),
        }
    }

    #[test]
    fn claims_hold_by_standard_errors() {
        assert_eq!(row(1.019, 0.01, Claim::Equals(1.0)).holds(), Some(true));
        assert_eq!(row(1.021, 0.01, Claim::Equals(1.0)).holds(), Some(false));
        assert_eq!(row(1.049, 0.01, Claim::Differs(1.0)).holds(), Some(false));
        assert_eq!(row(1.051, 0.01, Claim::Differs(1.0)).holds(), Some(true));
        assert_eq!(row(1.0, 0.0, Claim::Reported).holds(), None);
        // Without noise: single precision alone.
        assert_eq!(row(1.0 + 1e-7, 0.0, Claim::Equals(1.0)).holds(), Some(true));
        assert_eq!(row(1.0 + 1e-6, 0.0, Claim::Equals(1.0)).holds(), Some(false));
    }

    #[test]
    fn cells_have_the_digits_that_errors_call_for() {
        let cells = row(0.020_653, 0.000_009, Claim::Equals(0.020_658_089)).cells();
        assert_eq!(cells[1..4], ["0.020653(9)", "0.020658", "yes, −0.6 σ"]);
        assert_eq!([digits(1.0), digits(-0.5), digits(2.9e-17), digits(1.060_905)], ["1", "−0.5", "0", "1.0609"]);
    }

    #[test]
    fn figures_are_those_of_replicas() {
        let one = measured(&[1.0, 2.0, 3.0, -2.0]);
        assert_eq!(one.mean().value, 1.0);
        assert!((one.mean().standard_error - (14.0_f64 / 3.0 / 4.0).sqrt()).abs() < 1e-12);
        assert_eq!(one.negative().value, 1.0 / 16.0);
        let twice = measured(&[2.0, 4.0, 6.0, -4.0]);
        assert!((Measured::correlation(&one, &twice).value - 1.0).abs() < 1e-12);
        assert!((Measured::variance_ratio(&twice, &one).value - 4.0).abs() < 1e-12);
        assert!((Measured::ratio(&twice, &one).value - 2.0).abs() < 1e-12);
    }

    #[test]
    fn figures_of_what_a_release_cannot_render_are_no_numbers() {
        for finding in cases::findings() {
            let nothing: Vec<Measured> = finding.cases.iter().map(|case| Measured::nothing(&finding, case)).collect();
            assert!((finding.rows)(&nothing).iter().all(|row| row.value.value.is_nan()), "{}", finding.name);
            // Of one case of several, the others' figures stay.
            let mut found: Vec<Measured> = finding.cases.iter().map(|_| measured(&[0.5, 0.6, 0.55])).collect();
            *found.last_mut().expect("cases") = Measured::nothing(&finding, &finding.cases[0]);
            assert!((finding.rows)(&found).iter().any(|row| !row.value.value.is_nan()), "{}", finding.name);
        }
    }

    #[test]
    fn every_finding_reads_its_cases() {
        for finding in cases::findings() {
            assert!(!finding.cases.is_empty() && names().contains(&finding.name));
            let found: Vec<Measured> = finding
                .cases
                .iter()
                .map(|case| {
                    assert!(case.replicas.len() >= 8, "{}: {}", finding.name, case.name);
                    measured(&[0.5, 0.6, 0.55])
                })
                .collect();
            let rows = (finding.rows)(&found);
            assert!(rows.len() >= 3, "{}", finding.name);
            assert!(rows.iter().any(|row| row.holds().is_some()), "{}", finding.name);
        }
        let only = vec!["nothing".to_owned()];
        let folder = tempfile::tempdir().expect("a folder");
        let asked = Asked { releases: vec!["5.0.1".into()], only };
        let error = measure(asked, &[], folder.path(), &Settings::default(), &|_, _| ()).expect_err("refused");
        assert!(error.expected.contains("order"), "{error}");
    }
}
