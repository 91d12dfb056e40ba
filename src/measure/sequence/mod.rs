//! Sequences: what making frames from fewer rays, or with those before, costs in error, flicker and lag, and saves in time.
//!
//! Each motion of a sequence file is gone through by each way of making frames ([`crate::engines::reconstruction`]). With the frames I of a way
//! and E of the same engine without it, one ray through each pixel's centre and no jitter, d = I - E and M the mean of E, over all pixels,
//! channels and frames behind the warm-up:
//!
//! ```text
//! difference = sqrt(mean d^2) / M      flicker = sqrt(mean (d_t - d_{t-1})^2) / M      lag = sum d_t (E_{t-1} - E_t) / sum (E_{t-1} - E_t)^2
//! ```
//!
//! Lag is the past that a picture shows, in frames: a blend that leaves a weight w to frames before has w / (1 - w) where the picture moves evenly. All
//! three have no noise. Some frames have a truth by path tracing: relMSE against it, and its change by the way, have standard errors.

pub mod file;

use crate::base::error::Result;
use crate::base::files;
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose, to_json};
use crate::base::numbers::{figure, uncertain};
use crate::base::plain_text::csv_cell;
use crate::base::progress::Progress;
use crate::engines::reconstruction::{Reconstruction, Sequence, Shooter, Shot};
use crate::engines::render::{EngineJitter, EngineRenderer, EngineSettings};
use crate::engines::{Engine, Selection};
use crate::gpu::Backend;
use crate::integrators::path;
use crate::integrators::path::Subject;
use crate::measure::errors::{self, Uncertain};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome, Settings};
use crate::measure::seeds;
use crate::measure::timing::{Seconds, machine};
use crate::measure::truth::{PixelRays, Truth};
use crate::scene::Scene;
use crate::scene::image::Image;
use crate::view::camera::Camera;
use cpu_time::ProcessTime;
use file::{Motion, Named, SequenceFile};
use glam::DVec2;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Format of the results.
pub const FORMAT: &str = "cloudparity-sequence-results/1";

const PURPOSE: Purpose = Purpose { mark: "sequence-folder.json", format: FORMAT, of: Json::Null };

/// What a way of making frames came to under a motion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// The motion.
    pub motion: String,
    /// The way.
    pub way: String,
    /// Rays over pixels, mean of all frames.
    pub rays: f64,
    /// Processor time of a frame.
    pub seconds: Seconds,
    /// Root of the mean squared difference from the same engine without it, over the mean.
    pub difference: f64,
    /// The same of differences from frame to frame.
    pub flicker: f64,
    /// Frames of the past; none where nothing moves.
    pub lag: Option<f64>,
    /// relMSE against path tracing.
    pub relmse: Uncertain,
    /// relMSE minus that of the same engine without it.
    pub relmse_change: Uncertain,
    /// The last frame, relative to the folder.
    pub picture: String,
}

/// Replicas of a frame's truth.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FrameTruth {
    /// Processor time.
    pub seconds: f64,
    /// Files, relative to the folder.
    pub replicas: Vec<String>,
}

/// Everything that was found: `sequence.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// [`FORMAT`].
    pub format: String,
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// The file.
    pub sequence: SequenceFile,
    /// What did the work.
    pub machine: String,
    /// By motion, then by way.
    pub measured: Vec<Measured>,
}

impl Results {
    /// The way that comes closest to the engine without any, in less time and with no more flicker than another of its motion; none where that is
    /// worth its error. Not judged by path tracing: what blurs a picture takes some of a light model's error away, which is no merit.
    pub fn better_than(&self, one: &Measured) -> Option<&Measured> {
        let is_better = |other: &&Measured| {
            other.motion == one.motion
                && other.seconds.median < one.seconds.median
                && other.difference < one.difference
                && other.flicker <= one.flicker
        };
        self.measured.iter().filter(is_better).min_by(|a, b| a.difference.total_cmp(&b.difference))
    }

    /// A table in plain text.
    pub fn summary(&self) -> String {
        let mut text = String::new();
        let width = self.measured.iter().map(|one| one.way.chars().count()).max().unwrap_or(0);
        for motion in &self.sequence.motions {
            text += &format!(
                "{}\n  {:width$}  {:>5}  {:>9}  {:>10}  {:>8}  {:>6}  {:>14}  change\n",
                motion.name, "way", "rays", "ms/frame", "difference", "flicker", "lag", "relMSE",
            );
            for one in self.measured.iter().filter(|one| one.motion == motion.name) {
                text += &format!(
                    "  {:width$}  {:>5}  {:>9}  {:>9} %  {:>6} %  {:>6}  {:>14}  {}{}\n",
                    one.way,
                    format!("{:.3}", one.rays),
                    format!("{:.2}", 1e3 * one.seconds.median),
                    figure(Some(100.0 * one.difference)),
                    figure(Some(100.0 * one.flicker)),
                    one.lag.map_or_else(|| "-".into(), |lag| format!("{lag:.2}")),
                    uncertain(one.relmse.value, one.relmse.standard_error),
                    uncertain(one.relmse_change.value, one.relmse_change.standard_error),
                    self.better_than(one).map_or_else(String::new, |other| format!("; not worth it: {}", other.way)),
                );
            }
        }
        text
    }

    /// One line per motion and way.
    pub fn csv(&self) -> String {
        let mut text = String::from(
            "motion,way,rays_per_pixel,seconds,seconds_smallest,seconds_largest,difference,flicker,lag_frames,relmse,\
             relmse_standard_error,relmse_change,relmse_change_standard_error,better\n",
        );
        for one in &self.measured {
            let mut fields = vec![csv_cell(&one.motion), csv_cell(&one.way)];
            let Seconds { median, smallest, largest } = one.seconds;
            let numbers = [one.rays, median, smallest, largest, one.difference, one.flicker];
            fields.extend(numbers.map(|number| number.to_string()));
            fields.push(one.lag.map(|lag| lag.to_string()).unwrap_or_default());
            let (relmse, change) = (one.relmse, one.relmse_change);
            let numbers = [relmse.value, relmse.standard_error, change.value, change.standard_error];
            fields.extend(numbers.map(|number| number.to_string()));
            fields.push(self.better_than(one).map(|other| csv_cell(&other.way)).unwrap_or_default());
            text += &(fields.join(",") + "\n");
        }
        text
    }
}

/// Goes through a sequence file in a folder, and sums up.
pub fn measure(path: &Path, folder: &Path, settings: &Settings, progress: Progress<'_>) -> Result<Outcome<Results>> {
    let file = SequenceFile::load(path)?;
    let scene = file.scene(path.parent().unwrap_or(Path::new(".")))?;
    run(file, scene, folder, settings, progress)
}

/// The same with a scene that is there.
pub fn run(
    file: SequenceFile,
    scene: Scene,
    folder: &Path,
    settings: &Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Results>> {
    let is_of_scene = Selection::parse(&file.engine.density)?.model.is_of_scene;
    let mut running = Running { file, scene, is_of_scene, plain: HashMap::new() };
    experiment::run(&mut running, Some(folder), settings, progress)
}

/// Positions in the lists of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Job {
    /// Of a motion's frame.
    Truth(usize, u32),
    /// A motion and a way.
    Run(usize, usize),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum Record {
    Truth(FrameTruth),
    Run(Box<Measured>),
}

/// Frames of a motion, in rows from the top.
type Frames = Vec<Vec<[f64; 3]>>;

struct Running {
    file: SequenceFile,
    scene: Scene,
    /// Whether the density is the scene's own graph.
    is_of_scene: bool,
    /// Frames without any reconstruction or jitter, by motion.
    plain: HashMap<usize, Arc<Frames>>,
}

/// An engine's renderer that shoots the rays of a frame.
struct Rays<'a, 's> {
    renderer: &'a EngineRenderer<'s>,
    settings: EngineSettings,
}

impl Shooter for Rays<'_, '_> {
    fn shoot(&self, rasters: &[DVec2]) -> Result<Vec<Shot>> {
        self.renderer.shots(rasters, &self.settings)
    }

    fn entry(&self, raster: DVec2) -> f64 {
        self.renderer.entry(raster)
    }

    fn camera(&self) -> &Camera {
        self.renderer.camera()
    }
}

fn picture(size: [usize; 2], pixels: &[[f64; 3]]) -> Image {
    let mut image = Image::new(size[0], size[1]);
    for (to, from) in image.pixels.iter_mut().zip(pixels) {
        *to = [from[0] as f32, from[1] as f32, from[2] as f32, 1.0];
    }
    image
}

impl Running {
    fn size(&self) -> [usize; 2] {
        self.file.resolution.map(|side| side as usize)
    }

    fn engine(&self, scene: &Scene, motion: &Motion, way: Option<&Named>, frame: u32) -> Result<Engine> {
        let mut combination = self.file.combination(scene);
        if let Some(steps) = way.and_then(|way| way.steps) {
            combination.steps = steps;
        }
        let settings = self.settings(motion, frame);
        combination.engine_at(scene, &settings, motion.seconds * f64::from(frame))
    }

    /// The system's parameters at a frame.
    fn settings(&self, motion: &Motion, frame: u32) -> Vec<String> {
        if self.is_of_scene { Vec::new() } else { motion.settings(self.part(frame)) }
    }

    fn part(&self, frame: u32) -> f64 {
        f64::from(frame) / f64::from(self.file.frames - 1)
    }

    /// The scene at a frame, with the numbers of its own graph.
    fn scene(&self, motion: &Motion, frame: u32) -> Result<Scene> {
        let mut scene = motion.scene(&self.scene, frame, self.file.frames);
        for setting in motion.settings(self.part(frame)).iter().filter(|_| self.is_of_scene) {
            scene.set(setting)?;
        }
        Ok(scene)
    }

    /// All frames of a motion by a way, with the processor seconds and rays of each. Without a way: no reconstruction, no jitter.
    fn frames(
        &self,
        motion: &Motion,
        way: Option<&Named>,
        report: &dyn Fn(f64),
    ) -> Result<(Frames, Vec<f64>, Vec<usize>)> {
        let how = way.map_or_else(Reconstruction::default, |way| way.how.clone());
        let jitter = way.map_or(EngineJitter::None, |_| self.file.engine.jitter);
        let mut sequence = Sequence::new(how);
        let (mut frames, mut seconds, mut rays) = (Vec::new(), Vec::new(), Vec::new());
        for frame in 0..self.file.frames {
            let scene = self.scene(motion, frame)?;
            let engine = self.engine(&scene, motion, way, frame)?;
            let renderer = EngineRenderer::new(&scene, &engine, None)?;
            let settings = EngineSettings { jitter, frame, sub_pixels: 1, god_rays: false };
            let shooter = Rays { renderer: &renderer, settings };
            let begin = ProcessTime::now();
            let made = sequence.next(self.size(), &shooter)?;
            seconds.push(begin.elapsed().as_secs_f64());
            frames.push(made.pixels);
            rays.push(made.rays);
            report(f64::from(frame + 1) / f64::from(self.file.frames));
        }
        Ok((frames, seconds, rays))
    }

    fn plain(&mut self, motion: usize, desk: &Desk<'_>) -> Result<Arc<Frames>> {
        if let Some(known) = self.plain.get(&motion) {
            return Ok(Arc::clone(known));
        }
        let report = |done: f64| desk.report(done / 2.0, "the engine without it");
        let (frames, _, _) = self.frames(&self.file.motions[motion], None, &report)?;
        let frames = Arc::new(frames);
        self.plain.insert(motion, Arc::clone(&frames));
        Ok(frames)
    }

    fn truth_inputs(&self, motion: usize, frame: u32) -> Json {
        let Motion { turn, travel, seconds, parameters, .. } = &self.file.motions[motion];
        let mut inputs = json!({
            "scene": self.scene.content_hash(), "density": self.file.engine.density, "truth": self.file.truth.path, "frame": frame,
            "frames": self.file.frames, "motion": (turn, travel, seconds),
        });
        // Records of motions without any keep their keys.
        if !parameters.is_empty() {
            inputs["parameters"] = json!(parameters);
        }
        inputs
    }

    /// Path tracing of a frame: of the scene's own medium, or of the corrected form of a published system at its time.
    fn truth(&self, motion: usize, frame: u32, desk: &Desk<'_>) -> Result<FrameTruth> {
        let moving = &self.file.motions[motion];
        let scene = self.scene(moving, frame)?;
        let seconds = moving.seconds * f64::from(frame);
        let density = [vec![self.file.engine.density.clone()], self.settings(moving, frame)].concat().join(" ");
        let medium = Truth::medium_at(&scene, &density, seconds)?;
        let path = &self.file.truth.path;
        let settings = path.path_settings(PixelRays::Centres);
        let first = seeds::first(&self.truth_inputs(motion, frame));
        let seeds: Vec<u32> = (first..first + path.replicas).collect();
        let begin = ProcessTime::now();
        let mut replicas = Vec::new();
        let subject = Subject { scene: &scene, medium: medium.as_ref() };
        let report = |done: f64, what: &str| desk.report(done, what);
        path::render_each(subject, &settings, Backend::Cpu, &seeds, &report, &mut |seed, image| {
            let name = format!("truth/{}.seed-{seed}.exr", desk.key);
            image.write_exr(&desk.folder()?.join(&name), false)?;
            replicas.push(name);
            Ok(())
        })?;
        Ok(FrameTruth { seconds: begin.elapsed().as_secs_f64(), replicas })
    }

    fn measured(&mut self, motion: usize, way: usize, desk: &Desk<'_>) -> Result<Measured> {
        let plain = self.plain(motion, desk)?;
        let (moving, named) = (&self.file.motions[motion], &self.file.reconstructions[way]);
        let report = |done: f64| desk.report(0.5 + done / 2.0, "");
        let (frames, seconds, rays) = self.frames(moving, Some(named), &report)?;
        let Differences { difference, flicker, lag } = Differences::of(&frames, &plain, self.file.warm_up as usize);
        let folder = desk.folder()?;
        let size = self.size();
        let (mut relmse, mut change) = (Vec::new(), Vec::new());
        for frame in self.file.frames_with_truth() {
            let inputs = self.truth_inputs(motion, frame);
            let key = desk.ledger.key(&inputs);
            let truth: Record =
                desk.ledger.obtain(TRUTHS, &key, || self.truth(motion, frame, desk).map(Record::Truth))?;
            let Record::Truth(truth) = truth else { continue };
            let replicas: Vec<Image> =
                truth.replicas.iter().map(|name| Image::read_exr(&folder.join(name))).collect::<Result<_>>()?;
            let [ours, without] = [&frames, plain.as_ref()].map(|all| picture(size, &all[frame as usize]));
            relmse.push(errors::measure(&ours, &replicas)?.relmse);
            change.push(errors::relmse_change(&ours, &without, &replicas)?);
        }
        let picture_name = format!("pictures/{}.exr", desk.key);
        picture(size, frames.last().expect("there are frames")).write_exr(&folder.join(&picture_name), false)?;
        let mut sorted = seconds[self.file.warm_up as usize..].to_vec();
        sorted.sort_by(f64::total_cmp);
        Ok(Measured {
            motion: moving.name.clone(),
            way: named.name.clone(),
            rays: rays.iter().sum::<usize>() as f64 / (rays.len() * size[0] * size[1]) as f64,
            seconds: Seconds {
                median: sorted[sorted.len() / 2],
                smallest: sorted[0],
                largest: sorted[sorted.len() - 1],
            },
            difference,
            flicker,
            lag,
            relmse: mean(&relmse),
            relmse_change: mean(&change),
            picture: picture_name,
        })
    }
}

/// Part of the ledger that holds truths.
const TRUTHS: &str = "truth";

/// The mean of figures whose truths are independent.
fn mean(found: &[Uncertain]) -> Uncertain {
    let count = found.len() as f64;
    let variance: f64 = found.iter().map(|one| one.standard_error.powi(2)).sum();
    Uncertain { value: found.iter().map(|one| one.value).sum::<f64>() / count, standard_error: variance.sqrt() / count }
}

/// What tells frames from those of the same engine without the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Differences {
    difference: f64,
    flicker: f64,
    lag: Option<f64>,
}

impl Differences {
    fn of(frames: &[Vec<[f64; 3]>], plain: &[Vec<[f64; 3]>], warm_up: usize) -> Self {
        let (mut square, mut change, mut along, mut motion, mut sum, mut count) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for frame in warm_up..frames.len() {
            let [now, before] = [frame, frame - 1].map(|frame| frames[frame].as_flattened());
            let [plain_now, plain_before] = [frame, frame - 1].map(|frame| plain[frame].as_flattened());
            for index in 0..now.len() {
                let difference = now[index] - plain_now[index];
                let moved = plain_before[index] - plain_now[index];
                square += difference * difference;
                change += (difference - (before[index] - plain_before[index])).powi(2);
                along += difference * moved;
                motion += moved * moved;
                sum += plain_now[index];
                count += 1.0;
            }
        }
        let level = sum / count;
        Self {
            difference: (square / count).sqrt() / level,
            flicker: (change / count).sqrt() / level,
            lag: (motion > 0.0).then(|| along / motion),
        }
    }
}

impl Experiment for Running {
    type Job = Job;
    type Record = Record;
    type Summary = Results;

    fn purpose(&self) -> Purpose {
        PURPOSE
    }

    fn plan(&self) -> Result<Vec<Job>> {
        let motions = 0..self.file.motions.len();
        let truths = motions
            .clone()
            .flat_map(|motion| self.file.frames_with_truth().into_iter().map(move |frame| Job::Truth(motion, frame)));
        let ways = self.file.reconstructions.len();
        let runs = motions.flat_map(|motion| (0..ways).map(move |way| Job::Run(motion, way)));
        Ok(truths.chain(runs).collect())
    }

    fn part(&self, job: &Job) -> &'static str {
        match job {
            Job::Truth(..) => TRUTHS,
            Job::Run(..) => "runs",
        }
    }

    fn inputs(&self, job: &Job) -> Result<Json> {
        Ok(match *job {
            Job::Truth(motion, frame) => self.truth_inputs(motion, frame),
            Job::Run(motion, way) => json!({
                "scene": self.scene.content_hash(), "engine": self.file.engine, "motion": self.file.motions[motion],
                "frames": self.file.frames, "warm_up": self.file.warm_up, "truth": self.file.truth,
                "way": self.file.reconstructions[way],
            }),
        })
    }

    fn label(&self, job: &Job) -> String {
        match *job {
            Job::Truth(motion, frame) => format!("truth of frame {frame} of {}", self.file.motions[motion].name),
            Job::Run(motion, way) => {
                format!("{} of {}", self.file.reconstructions[way].name, self.file.motions[motion].name)
            }
        }
    }

    fn run(&mut self, job: &Job, desk: &Desk<'_>) -> Result<Found<Record>> {
        Ok(Found::Record(match *job {
            Job::Truth(motion, frame) => Record::Truth(self.truth(motion, frame, desk)?),
            Job::Run(motion, way) => Record::Run(Box::new(self.measured(motion, way, desk)?)),
        }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Results> {
        let measured = experiment::records(found).into_iter().filter_map(|record| match record {
            Record::Run(run) => Some(*run),
            Record::Truth(_) => None,
        });
        let results = Results {
            format: FORMAT.into(),
            builds: desk.ledger.builds(),
            sequence: self.file.clone(),
            machine: machine(),
            measured: measured.collect(),
        };
        let folder = desk.folder()?;
        files::write_atomically(&folder.join("sequence.json"), to_json(&results).as_bytes())?;
        files::write_atomically(&folder.join("sequence.csv"), results.csv().as_bytes())?;
        Ok(results)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blend_lags_by_its_weight_over_the_rest() {
        // A ramp that moves by a thousandth of its range per frame.
        let plain: Frames = (0..200)
            .map(|frame| (0..50).map(|pixel| [f64::from(pixel) + 0.05 * f64::from(frame); 3]).collect())
            .collect();
        let mut blended = vec![plain[0].clone()];
        for frame in 1..plain.len() {
            let mixed = |pixel: usize| [0.1 * plain[frame][pixel][0] + 0.9 * blended[frame - 1][pixel][0]; 3];
            let next = (0..50).map(mixed).collect();
            blended.push(next);
        }
        // What is left of the beginning: 0.9^150, 1e-7.
        let found = Differences::of(&blended, &plain, 150);
        assert!((found.lag.expect("it moves") - 9.0).abs() < 1e-5, "{found:?}");
        assert!(found.flicker < 1e-7, "{found:?}");
        let level = 24.5 + 0.05 * 174.5;
        assert!((found.difference - 0.45 / level).abs() < 1e-6, "{found:?}");
        let none = Differences::of(&plain, &plain, 1);
        assert_eq!((none.difference, none.flicker, none.lag), (0.0, 0.0, Some(0.0)));
        let still = vec![plain[0].clone(); 5];
        assert_eq!(Differences::of(&still, &still, 1).lag, None);
    }
}
