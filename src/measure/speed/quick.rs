//! Some minutes of benchmarks beside a baseline: has anything become slower?
//!
//! Times of two runs are not comparable: another machine, another clock, other work beside. So each time is divided by that of a *yardstick*, a
//! fixed piece of arithmetic that no change of the program touches, which runs before and after each repetition. The ratio's median
//! counts; the median absolute deviation of the repetitions gives its standard error. A baseline holds the ratios of several processes, whose standard
//! deviation says what comes from one to the next (where its memory lies, what the processor does beside). A workload is slower where its ratio
//! is above the baseline's by more than [`SURE`] standard deviations of both together, and by more than [`LEAST`].

use crate::base::error::{Error, Result};
use crate::base::identity::Identity;
use crate::base::ledger::{read_record, to_json};
use crate::base::progress::Progress;
use crate::base::{choice::choice, files};
use crate::engines::defects::Defects;
use crate::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use crate::engines::{self, Engine};
use crate::gpu::{FieldKernel, Gpu};
use crate::graph::Program;
use crate::graph::bounds::Bounds3;
use crate::graph::evaluate::Points;
use crate::integrators::path::PathSettings;
use crate::measure::speed::{median, workloads};
use crate::measure::timing;
use crate::scene::Scene;
use cpu_time::ProcessTime;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::hint::black_box;
use std::path::Path;

/// Format of a baseline.
pub const FORMAT: &str = "cloudparity-bench-baseline/1";

/// Standard deviations from which on a difference is no chance: of 15 workloads without a change one is called slower in a hundred runs.
pub const SURE: f64 = 3.3;

/// Part of a ratio below which a difference is of no interest.
pub const LEAST: f64 = 0.03;

choice! {
    "kebab-case",
    /// How a workload compares with its baseline.
    pub enum Change {
        /// Beyond chance.
        Slower,
        /// Beyond chance.
        Faster,
        /// Within chance, or too little to care about.
        Same,
        /// The baseline does not have it.
        New,
    }
}

/// A workload's times in a round.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The workload.
    pub what: String,
    /// Processor seconds of one repetition: median.
    pub seconds: f64,
    /// Over the yardstick's: median.
    pub ratio: f64,
    /// Standard error of the ratio, from the spread of the repetitions.
    pub standard_error: f64,
}

/// A workload's ratios over the rounds of a baseline.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaselineRow {
    /// The workload.
    pub what: String,
    /// Mean of the rounds' ratios.
    pub ratio: f64,
    /// Their standard deviation.
    pub spread: f64,
}

/// What runs are compared with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Baseline {
    /// [`FORMAT`].
    pub format: String,
    /// The build that it is of.
    pub build: Identity,
    /// Processor, system and threads.
    pub machine: String,
    /// The adapter; none where there was none.
    pub adapter: Option<String>,
    /// The scene.
    pub scene_sha256: String,
    /// Rounds.
    pub rounds: u32,
    /// The workloads.
    pub rows: Vec<BaselineRow>,
}

/// A workload beside its baseline.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Compared {
    /// Now.
    #[serde(flatten)]
    pub row: Row,
    /// Then.
    pub baseline: Option<BaselineRow>,
    /// Ratio over the baseline's, less 1.
    pub change: Option<f64>,
    /// What that means.
    pub verdict: Change,
}

impl Row {
    /// Beside what a baseline has of it.
    pub fn beside(self, baseline: Option<&Baseline>) -> Compared {
        let found = baseline.and_then(|baseline| baseline.rows.iter().find(|row| row.what == self.what)).cloned();
        let change = found.as_ref().map(|then| self.ratio / then.ratio - 1.0);
        let verdict = match (&found, change) {
            (Some(then), Some(change)) => {
                let deviation = self.standard_error.hypot(then.spread) / then.ratio;
                let is_sure = change.abs() > SURE * deviation && change.abs() > LEAST;
                match (is_sure, change > 0.0) {
                    (false, _) => Change::Same,
                    (true, true) => Change::Slower,
                    (true, false) => Change::Faster,
                }
            }
            _ => Change::New,
        };
        Compared { row: self, baseline: found, change, verdict }
    }
}

impl Baseline {
    /// Of the rows of several rounds; at least two, of the same workloads.
    pub fn of(rounds: &[Vec<Row>], scene: &Scene, adapter: Option<String>) -> Result<Self> {
        if rounds.len() < 2 {
            return Err(Error::new(
                "the rounds of a baseline",
                rounds.len().to_string(),
                "at least 2: one round says nothing of the next",
                "Measure more rounds.",
            ));
        }
        let count = rounds.len() as f64;
        let row = |place: usize| {
            let ratios: Vec<f64> = rounds.iter().map(|round| round[place].ratio).collect();
            let mean = ratios.iter().sum::<f64>() / count;
            let squares: f64 = ratios.iter().map(|ratio| (ratio - mean).powi(2)).sum();
            BaselineRow { what: rounds[0][place].what.clone(), ratio: mean, spread: (squares / (count - 1.0)).sqrt() }
        };
        Ok(Self {
            format: FORMAT.into(),
            build: Identity::current().clone(),
            machine: timing::machine(),
            adapter,
            scene_sha256: scene.content_hash(),
            rounds: rounds.len() as u32,
            rows: (0..rounds[0].len()).map(row).collect(),
        })
    }

    /// Reads a baseline of a scene.
    pub fn load(path: &Path, scene: &Scene) -> Result<Self> {
        let found: Self = read_record(path)?.ok_or_else(|| {
            Error::new(path.display().to_string(), "no file", "a baseline", "Write a baseline first.")
        })?;
        let wrong = |name: &str, found: &str, expected: &str| {
            let place = format!("{}, $.{name}", path.display());
            Err(Error::new(place, found, expected, "Write another baseline."))
        };
        if found.format != FORMAT {
            return wrong("format", &found.format, FORMAT);
        }
        if found.scene_sha256 != scene.content_hash() {
            return wrong("scene_sha256", &found.scene_sha256, &scene.content_hash());
        }
        Ok(found)
    }

    /// Writes it.
    pub fn write(&self, path: &Path) -> Result<()> {
        files::write_atomically(path, to_json(self).as_bytes())
    }
}

/// What a round is.
pub struct Settings<'a> {
    /// Repetitions of each workload.
    pub repeats: u32,
    /// A workload that does a part more than it should: a slowdown that is to be found.
    pub planted: Option<(&'a str, f64)>,
}

/// Pixels of the frames, and of path tracing.
const FRAME: [u32; 2] = [192, 108];
const TRACED: [u32; 2] = [96, 54];

/// Points of a field, of the path tracer's samples and so on: some tenths of a second each on two cores.
const POINTS: usize = 200_000;
const SAMPLES: u32 = 2;
const BOXES: usize = 16;

/// Work of the yardstick: some tenths of a second of one core.
const LENGTHS: u32 = 1 << 12;
const ROUNDS: u32 = 1 << 13;

/// A fixed piece of arithmetic on all cores: a hash of integers and sums of f32, which neither memory nor this program's code has a part in.
fn yardstick() -> f32 {
    (0..LENGTHS)
        .into_par_iter()
        .map(|seed| {
            let (mut state, mut sum) = (seed.wrapping_mul(747_796_405).wrapping_add(1), 0.0_f32);
            for _ in 0..ROUNDS {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                state ^= state >> 16;
                sum = sum.mul_add(0.999, (state >> 8) as f32 * 5.960_464_5e-8);
            }
            sum
        })
        .sum()
}

/// Processor seconds of work.
fn seconds(work: impl FnOnce() -> Result<()>) -> Result<f64> {
    let begin = ProcessTime::now();
    work()?;
    Ok(begin.elapsed().as_secs_f64())
}

/// One workload: what it does a part (1: all) of.
struct Workload<'a> {
    what: &'static str,
    work: Box<dyn Fn(f64) -> Result<()> + 'a>,
}

/// What workloads work on, made once.
struct Materials<'a> {
    scene: Scene,
    program: Program,
    points: Vec<(&'static str, Vec<[f32; 3]>)>,
    boxes: Vec<Bounds3>,
    /// Names of their frames on the CPU and on the adapter.
    engines: Vec<([&'static str; 2], Engine)>,
    kernel: Option<FieldKernel<'a>>,
}

impl<'a> Materials<'a> {
    fn new(scene: &Scene, gpu: Option<&'a Gpu>) -> Result<Self> {
        let mut scene = scene.clone();
        scene.film.resolution_percentage = 100;
        let program = Program::density(&scene)?;
        let all = workloads(&scene, &program, (POINTS as f64 * MOST) as usize)?;
        let names = ["field, random order", "field, tiles", "field, non-zero points"];
        let points = names.into_iter().zip(all).map(|(name, workload)| (name, workload.points)).collect();
        let crate::scene::Bounds { min, max } = scene.volume.bounds;
        let boxes = (0..BOXES.pow(3))
            .map(|index| {
                let place = [index % BOXES, index / BOXES % BOXES, index / BOXES / BOXES];
                let corner = |more: usize| -> [f32; 3] {
                    std::array::from_fn(|axis| {
                        min[axis] + (max[axis] - min[axis]) * (place[axis] + more) as f32 / BOXES as f32
                    })
                };
                Bounds3 { low: corner(0), high: corner(1) }
            })
            .collect();
        let engine = |model: &str, quality: Option<&str>| -> Result<Engine> {
            let model = engines::find(model)?;
            model.engine(&scene, &model.values(quality, &[])?, &Defects::NONE, 0.0)
        };
        let engines = vec![
            (["frame, exact density", "WGSL, frame, exact density"], engine("graph", None)?),
            (["frame, cached density", "WGSL, frame, cached density"], engine("graph", Some("medium"))?),
            (["frame, perlin-fbm", "WGSL, frame, perlin-fbm"], engine("perlin-fbm", None)?),
            (["frame, skill", "WGSL, frame, skill"], engine("skill", None)?),
        ];
        let kernel = gpu.map(|gpu| gpu.field(&program)).transpose()?;
        Ok(Self { scene, program, points, boxes, engines, kernel })
    }

    fn workloads<'b>(&'b self, gpu: Option<&'b Gpu>) -> Vec<Workload<'b>> {
        let mut all = Vec::new();
        let mut add = |what: &'static str, work: Box<dyn Fn(f64) -> Result<()> + 'b>| all.push(Workload { what, work });
        for (what, points) in &self.points {
            add(what, Box::new(|part| self.program.evaluate_single(Points::new(some(points, part))).map(drop)));
        }
        add("bounds", Box::new(|part| self.program.bounds_many(some(&self.boxes, part)).map(drop)));
        add("path tracing", Box::new(|part| self.path(part)));
        for ([name, _], engine) in &self.engines {
            add(name, Box::new(move |part| self.frame(engine, None, part)));
        }
        // Another adapter's clock is not the yardstick's.
        let Some(gpu) = gpu.filter(|gpu| gpu.adapter().is_software()) else { return all };
        if let Some(kernel) = &self.kernel {
            let (_, points) = &self.points[0];
            add("WGSL, field", Box::new(|part| kernel.evaluate(Points::new(some(points, part))).map(drop)));
        }
        for ([_, name], engine) in &self.engines {
            add(name, Box::new(move |part| self.frame(engine, Some(gpu), part)));
        }
        all
    }

    fn frame(&self, engine: &Engine, gpu: Option<&Gpu>, part: f64) -> Result<()> {
        let settings = EngineSettings { jitter: EngineJitter::None, frame: 0, sub_pixels: 1, god_rays: false };
        let scene = self.sized(FRAME, part);
        black_box(EngineRenderer::new(&scene, engine, gpu)?.picture(&settings, &|_, _| ())?);
        Ok(())
    }

    /// The scene with more rows.
    fn sized(&self, [width, height]: [u32; 2], part: f64) -> Scene {
        let mut scene = self.scene.clone();
        scene.film.resolution = [width, (f64::from(height) * part).round() as u32];
        scene
    }

    fn path(&self, part: f64) -> Result<()> {
        let scene = self.sized(TRACED, part);
        let settings = PathSettings { samples: SAMPLES, ..PathSettings::default() };
        timing::timed_picture(&scene, &settings).map(drop)
    }
}

/// So much of a list that holds [`MOST`] times the work.
fn some<T>(list: &[T], part: f64) -> &[T] {
    &list[..((list.len() as f64 * part / MOST).round() as usize).min(list.len())]
}

/// Part of all work that a planted slowdown may make of it; lists hold so much, and workloads do the rest without one.
const MOST: f64 = 1.5;

/// Measures all workloads once: a round.
pub fn run(scene: &Scene, settings: &Settings<'_>, progress: Progress<'_>) -> Result<Vec<Row>> {
    let gpu = Gpu::open().ok();
    let materials = Materials::new(scene, gpu.as_ref())?;
    let all = materials.workloads(gpu.as_ref());
    if let Some((name, part)) = settings.planted {
        if !all.iter().any(|workload| workload.what == name) {
            let known: Vec<&str> = all.iter().map(|workload| workload.what).collect();
            return Err(Error::new(
                "the planted workload",
                format!("\"{name}\""),
                known.join("; "),
                "Correct the name.",
            ));
        }
        if !(0.0..=MOST - 1.0).contains(&part) {
            return Err(Error::new("the planted part", part.to_string(), "0 to 0.5", "Correct the number."));
        }
    }
    let count = all.len();
    let mut rows = Vec::with_capacity(count);
    for (number, Workload { what, work }) in all.into_iter().enumerate() {
        progress(number as f64 / count as f64, what);
        let more = settings.planted.filter(|(name, _)| *name == what).map_or(0.0, |(_, part)| part);
        work(1.0 + more)?;
        let mut times = Vec::new();
        for _ in 0..settings.repeats.max(3) {
            let measure = || {
                black_box(yardstick());
                Ok(())
            };
            let before = seconds(measure)?;
            let own = seconds(|| work(1.0 + more))?;
            let after = seconds(measure)?;
            times.push((own / (0.5 * (before + after)), own));
        }
        let ratios: Vec<f64> = times.iter().map(|(ratio, _)| *ratio).collect();
        let ratio = median(ratios.clone());
        let deviation = median(ratios.iter().map(|one| (one - ratio).abs()).collect());
        // Of a normal distribution: sigma is 1.4826 median absolute deviations, and a median's error 1.2533 times a mean's.
        let standard_error = 1.2533 * 1.4826 * deviation / (times.len() as f64).sqrt();
        let seconds = median(times.iter().map(|(_, seconds)| *seconds).collect());
        rows.push(Row { what: what.into(), seconds, ratio, standard_error });
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng as _, SeedableRng as _};

    fn row(ratio: f64, standard_error: f64) -> Row {
        Row { what: "field".into(), seconds: 0.1, ratio, standard_error }
    }

    fn baseline(ratio: f64, spread: f64) -> Baseline {
        Baseline {
            format: FORMAT.into(),
            build: Identity::unknown(),
            machine: String::new(),
            adapter: None,
            scene_sha256: String::new(),
            rounds: 8,
            rows: vec![BaselineRow { what: "field".into(), ratio, spread }],
        }
    }

    #[test]
    fn a_fifth_more_time_is_found_and_noise_is_not() {
        let then = baseline(2.0, 0.03);
        let verdict = |ratio| row(ratio, 0.02).beside(Some(&then)).verdict;
        assert_eq!(verdict(2.4), Change::Slower);
        assert_eq!(verdict(1.6), Change::Faster);
        assert_eq!(verdict(2.05), Change::Same);
        // Sure, but too little to care about.
        assert_eq!(row(2.05, 1e-4).beside(Some(&baseline(2.0, 1e-4))).verdict, Change::Same);
        // Much, but nothing that is known.
        assert_eq!(row(2.4, 0.3).beside(Some(&then)).verdict, Change::Same);
        assert_eq!(Row { what: "other".into(), ..row(2.0, 0.0) }.beside(Some(&then)).verdict, Change::New);
        assert_eq!(row(2.0, 0.0).beside(None).verdict, Change::New);
    }

    /// Rounds that differ by chance alone are rarely called slower. A baseline of eight rounds does not know its own spread well: Student's t of 7 degrees
    /// of freedom has 0.9 % above 3.3 / sqrt(1 + 1/8).
    #[test]
    fn false_alarms_are_rare() {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        let mut normal = || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let (mut alarms, trials) = (0, 2000);
        for _ in 0..trials {
            let ratios: Vec<f64> = (0..8).map(|_| 2.0 + 0.04 * normal()).collect();
            let mean = ratios.iter().sum::<f64>() / 8.0;
            let spread = (ratios.iter().map(|ratio| (ratio - mean).powi(2)).sum::<f64>() / 7.0).sqrt();
            let now = row(2.0 + 0.04 * normal(), 0.0);
            alarms += u32::from(now.beside(Some(&baseline(mean, spread))).verdict == Change::Slower);
        }
        let share = f64::from(alarms) / f64::from(trials);
        // 0.9 % and three standard errors of 2000 trials.
        assert!(share < 0.009 + 3.0 * (0.009_f64 / f64::from(trials)).sqrt(), "{share}");
    }

    #[test]
    fn a_planted_part_is_more_work() {
        let list = [0; 300];
        assert_eq!([some(&list, 1.0).len(), some(&list, 1.2).len(), some(&list, 1.5).len()], [200, 240, 300]);
    }
}
