//! How long path tracing takes to the error that Cycles has after so many samples.
//!
//! The entries of a parity suite whose replicas are sub-pixel images say which scenes, and give both sides' pictures: one
//! combined reference, in which each counts by its noise, and how noisy a sample of either is against it
//! (`blend/sample_errors.py` has the formulas). Then path tracing renders each scene anew with as many samples as the error needs, and
//! that picture's error is measured too. Where that would take longer than [`TimeSettings::longest`], fewer samples are rendered and
//! time and error taken in proportion; the row says so.
//!
//! Times are seconds of processor time of all threads, on both sides: a machine that does other things beside stretches
//! them less than a clock on the wall. Preparation is what comes before the first sample: Cycles' evaluation of the density on a
//! grid, our bounds.

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::base::ledger::Ledger;
use crate::bridge;
use crate::bridge::Kernel;
use crate::bridge::reference::{ReferenceSettings, cache_folder, reference};
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::{PathSettings, Subject, Tracking};
use crate::measure::parity;
use crate::measure::parity::{Entry, Suite};
use crate::scene::Scene;
use crate::scene::image::Image;
use cpu_time::ProcessTime;
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Seed of the timed renders: none that a replica has.
const SEED: u32 = 900;

/// Sub-pixels per axis of Cycles' ray marching: four replicas, enough to part noise from bias.
const MARCHING_SUB_PIXELS: u32 = 2;

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
#[derive(Debug, Clone, Serialize)]
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
#[derive(Debug, Clone, Serialize)]
pub struct Row {
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
    /// Samples that the error takes us.
    pub our_samples: u32,
    /// Our relMSE, measured on the timed picture (in proportion where that has fewer samples).
    pub our_error: f64,
    /// Our processor seconds: preparation, samples.
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
#[derive(Debug, Clone, Serialize)]
pub struct TimeToError {
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// Cycles' modes by entry.
    pub cycles: Vec<(String, Vec<Cycles>)>,
    /// The races.
    pub rows: Vec<Row>,
}

/// Our side of a scene: the picture of so many samples, and its processor seconds.
struct Timed {
    file: PathBuf,
    preparation: f64,
    rendering: f64,
}

/// Measures the entries of a suite that have sub-pixel replicas, all or those named. References come from the cache; pictures
/// and `time_to_error.json` and `.md` go to `output`.
pub fn run(
    file: &Path,
    only: &[String],
    output: &Path,
    resume: &Resume,
    settings: &TimeSettings,
    progress: &(dyn Fn(&str) + Sync),
) -> Result<TimeToError> {
    let suite = Suite::load(file)?;
    let ledger = parity::open(output, resume)?;
    let folder = file.parent().unwrap_or(Path::new("."));
    let chosen = suite.chosen(only)?;
    let mut found = TimeToError { builds: Vec::new(), cycles: Vec::new(), rows: Vec::new() };
    for entry in chosen {
        let Some(cells) = entry.sub_pixels() else { continue };
        let report = |what: &str| progress(&format!("{}: {what}", entry.name));
        let (modes, rows) = measure((entry, cells), folder, (&ledger, resume), settings, &report)?;
        found.builds = ledger.builds();
        found.cycles.push((entry.name.clone(), modes));
        found.rows.extend(rows);
        let document = serde_json::to_string_pretty(&found).expect("figures serialise") + "\n";
        files::write_atomically(&output.join("time_to_error.json"), document.as_bytes())?;
        files::write_atomically(&output.join("time_to_error.md"), found.table().as_bytes())?;
    }
    if found.rows.is_empty() {
        return Err(Error::new(
            file.display().to_string(),
            "no entry to measure",
            "entries with sub_pixels replicas, and numbers of samples",
            "Name another suite or entry.",
        )
        .with_setting("samples"));
    }
    Ok(found)
}

fn measure(
    (entry, cells): (&Entry, u32),
    folder: &Path,
    (ledger, resume): (&Ledger, &Resume),
    settings: &TimeSettings,
    report: &(dyn Fn(&str) + Sync),
) -> Result<(Vec<Cycles>, Vec<Row>)> {
    let parity::Pictures { scene: large, references, ours, .. } =
        parity::pictures(entry, folder, ledger, resume, &|_, what| report(what))?;
    let output = &ledger.folder().expect("times are kept").join(&entry.name);
    let mut scene = large.clone();
    scene.film.resolution = large.film.resolution.map(|side| side / cells);
    let (cycles_file, our_file) = (&references[0].path, &ours[0]);
    let mut others = Vec::new();
    if let Some(rate) = settings.marching_rate {
        let mut marched = large.clone();
        marched.film.resolution = scene.film.resolution.map(|side| side * MARCHING_SUB_PIXELS);
        let marching = ReferenceSettings { volume_biased: true, step_rate: rate, ..entry.reference_settings() };
        report("ray marching by Cycles");
        let path = reference(&marched, &marching, &cache_folder()?, |_| ())?.path;
        others.push(json!({"file": path, "sub_pixels": MARCHING_SUB_PIXELS}));
    }
    report("errors");
    let ask = |others: &[Value]| {
        let request = json!({"ours": our_file, "cycles": cycles_file, "sub_pixels": cells, "others": others});
        bridge::run_script("sample_errors.py", &request, Kernel::Default, |_| ())
    };
    let errors = ask(&others)?;
    let samples = f64::from(entry.samples);
    let mut modes = vec![cycles("null collision", cycles_file, &errors["cycles"], samples, cells)?];
    if let (Some(rate), Some(other)) = (settings.marching_rate, others.first()) {
        let path = PathBuf::from(other["file"].as_str().expect("a file that was just named"));
        let name = format!("ray marching, rate {rate}");
        modes.push(cycles(&name, &path, &errors["others"][0], samples, MARCHING_SUB_PIXELS)?);
    }
    let our_noise = number(&errors["ours"], "noise")? * samples;
    let our_bias = number(&errors["ours"], "squared_bias")?.max(0.0);
    let mut rows = Vec::new();
    for &tracking in &settings.trackings {
        // What a sample costs and gives: noise differs between ways of tracking.
        let render = |count: u32| {
            report(&format!("{tracking:?}, {count} samples"));
            timed(&scene, count, tracking, output)
        };
        let first = render(entry.samples)?;
        let first_error = number(&ask(&[json!({"file": first.file, "sub_pixels": 1})])?["others"][0], "error")?;
        let per_sample = first.rendering / samples;
        // One picture's error is itself noisy by some per cent; where tracking is that of the replicas, theirs is sharper.
        let noise = if tracking == Tracking::default() { our_noise } else { (first_error - our_bias) * samples };
        for mode in &modes {
            for &level in &settings.levels {
                let target = mode.error(level);
                let needed = (noise / (target - our_bias)).ceil();
                if !(needed >= 1.0 && needed <= f64::from(path::MOST_SAMPLES)) {
                    return Err(Error::new(
                        format!("{}, {level} samples", entry.name),
                        format!("a target of {target:.3e} beside our own difference of {our_bias:.3e}"),
                        "a target above it",
                        "Give more samples to the entry of the suite: its combined reference is too noisy.",
                    ));
                }
                let needed = needed as u32;
                let affordable = (settings.longest / per_sample).max(1.0) as u32;
                let count = needed.min(affordable);
                let picture = render(count)?;
                let error = number(&ask(&[json!({"file": picture.file, "sub_pixels": 1})])?["others"][0], "error")?;
                let share = f64::from(count) / f64::from(needed);
                let our_seconds = [picture.preparation, picture.rendering / share];
                let cycles_seconds = [mode.preparation, mode.seconds(level)];
                rows.push(Row {
                    name: entry.name.clone(),
                    mode: mode.mode.clone(),
                    samples: level,
                    error: target,
                    cycles_seconds,
                    tracking,
                    our_samples: needed,
                    our_error: error * share,
                    our_seconds,
                    rendered_share: share,
                    ratio: cycles_seconds.iter().sum::<f64>() / our_seconds.iter().sum::<f64>(),
                    ratio_without_preparation: cycles_seconds[1] / our_seconds[1],
                    preparation_ratio: cycles_seconds[0] / our_seconds[0],
                });
            }
        }
    }
    Ok((modes, rows))
}

/// A mode of Cycles from the picture it made and what was found about it.
fn cycles(mode: &str, file: &Path, errors: &Value, samples: f64, cells: u32) -> Result<Cycles> {
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

/// Processor seconds that a picture by Cycles took before its first sample and from there on, as the render noted them; `file` is the
/// place of an error.
pub(crate) fn cycles_seconds(picture: &Image, file: &Path) -> Result<[f64; 2]> {
    let seconds = |name: &str| -> Result<f64> {
        picture.provenance.get(name).and_then(|text| text.parse().ok()).ok_or_else(|| {
            Error::new(
                format!("{}, attribute cloudparity:{name}", file.display()),
                "no number",
                "processor seconds that the render noted",
                "Remove the file from the cache, so that the reference is rendered again.",
            )
        })
    };
    let preparation = seconds("preparation_processor_seconds")?;
    Ok([preparation, seconds("processor_seconds")? - preparation])
}

/// A picture by path tracing on all cores, and its processor seconds: preparation, paths.
pub(crate) fn timed_picture<'a>(subject: impl Into<Subject<'a>>, settings: &PathSettings) -> Result<(Image, [f64; 2])> {
    let begin = ProcessTime::now();
    let prepared = OnceLock::new();
    let image = path::render(subject, settings, Backend::Cpu, None, &|_, what| {
        // Majorants are announced before they are made; whatever comes next is after them.
        if what != path::PREPARATION {
            prepared.get_or_init(|| begin.elapsed().as_secs_f64());
        }
    })?;
    let all = begin.elapsed().as_secs_f64();
    let preparation = prepared.get().copied().unwrap_or(0.0);
    Ok((image, [preparation, all - preparation]))
}

fn timed(scene: &Scene, samples: u32, tracking: Tracking, output: &Path) -> Result<Timed> {
    let settings = PathSettings { samples, seed: SEED, tracking, ..PathSettings::default() };
    let (image, [preparation, rendering]) = timed_picture(scene, &settings)?;
    let file = output.join(format!("timed-{tracking:?}-{samples}.exr").to_lowercase());
    image.write_exr(&file, false)?;
    Ok(Timed { file, preparation, rendering })
}

fn number(value: &Value, name: &str) -> Result<f64> {
    value[name].as_f64().ok_or_else(|| {
        Error::new("sample_errors.py", value.to_string(), format!("a number `{name}`"), "Report this defect.")
    })
}

impl TimeToError {
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
                row.name,
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
