//! How path tracing grows: time and memory against pixels, samples, bounces, objects, the size of the scene, threads, and any number that a
//! material stores.
//!
//! A ladder is one quantity at rising values, everything else as the scene has it. Each rung is measured in a process of its own, so that its peak of memory is
//! its own, and again on every round, so that a machine that becomes slow for a while harms one value of each rung. What counts is
//! the median. The slope between two rungs is that of the logarithms: 1 where twice as much takes twice as long.

use crate::base::error::{Error, Result};
use crate::base::identity::Identity;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::CyclesKernel;
use crate::gpu::Backend;
use crate::integrators::path::{self, PathSettings};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment, Outcome};
use crate::measure::speed::median;
use crate::measure::timing::{Clock, machine, peak_memory, timed_picture_by};
use crate::scene::{LightKind, Matrix, Scene};
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::fmt::Write as _;
use std::path::Path;

/// Name of the stored number that is divided where a scene is made larger, so that it stays as thick for light.
const DENSITY: &str = "Density";

/// What grows.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Pixels along the longer side.
    Width,
    /// Samples of a pixel.
    Samples,
    /// Scattering events beyond the first.
    Bounces,
    /// Copies of the object in its box, side by side, each smaller by so much that all fit.
    Objects,
    /// Lengths of the whole scene over those that it has, at the same optical thickness.
    Size,
    /// Threads; times are those on the wall.
    Threads,
    /// A stored number of the material, by the name that it is set by.
    Input(String),
}

impl Quantity {
    /// For readers.
    pub fn label(&self) -> String {
        match self {
            Self::Width => "pixels along the longer side".into(),
            Self::Samples => "samples of a pixel".into(),
            Self::Bounces => "bounces".into(),
            Self::Objects => "objects".into(),
            Self::Size => "size of the scene".into(),
            Self::Threads => "threads (time on the wall)".into(),
            Self::Input(name) => name.clone(),
        }
    }

    /// The quantity of a name: a stored number's, where it is none of the others.
    pub fn named(name: &str) -> Self {
        match name {
            "width" => Self::Width,
            "samples" => Self::Samples,
            "bounces" => Self::Bounces,
            "objects" => Self::Objects,
            "size" => Self::Size,
            "threads" => Self::Threads,
            _ => Self::Input(name.to_owned()),
        }
    }

    /// Hardware has no processor time; what its software stand-in does is the processor's work.
    fn clock(&self, backend: Backend) -> Result<Clock> {
        let is_hardware = backend.open()?.is_some_and(|gpu| !gpu.adapter().is_software());
        Ok(if *self == Self::Threads || is_hardware { Clock::Wall } else { Clock::Processor })
    }
}

/// One quantity at rising values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Ladder {
    /// What grows.
    pub quantity: Quantity,
    /// Its values, rising; whole numbers but for sizes and inputs.
    pub values: Vec<f64>,
}

impl Ladder {
    /// Refuses what cannot be made of a scene.
    pub fn check(&self, scene: &Scene, settings: Settings) -> Result<()> {
        self.values.iter().try_for_each(|&value| self.rung(value, settings).apply(scene).map(drop))
    }

    fn rung(&self, value: f64, Settings { width, samples, backend, .. }: Settings) -> Rung {
        Rung { quantity: self.quantity.clone(), value, width, samples, backend }
    }
}

/// What all rungs share.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Pixels along the longer side, where that does not grow.
    pub width: u32,
    /// Samples of a pixel, where these do not grow.
    pub samples: u32,
    /// Rounds; the median counts.
    pub repeats: u32,
    /// Where paths are traced.
    #[serde(default, skip_serializing_if = "Backend::is_cpu")]
    pub backend: Backend,
}

/// A rung of a ladder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rung {
    /// What grows.
    pub quantity: Quantity,
    /// Its value.
    pub value: f64,
    /// Pixels along the longer side, where that does not grow.
    pub width: u32,
    /// Samples of a pixel, where these do not grow.
    pub samples: u32,
    /// Where paths are traced.
    #[serde(default, skip_serializing_if = "Backend::is_cpu")]
    pub backend: Backend,
}

/// One measurement of a rung.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Once {
    /// Seconds before the first sample: the graph, the tree of bounds.
    pub preparation: f64,
    /// Seconds of all samples.
    pub paths: f64,
    /// Bytes that were resident at most; none where the system does not say.
    pub memory: Option<u64>,
    /// Leaves of the tree of bounds.
    pub leaves: u64,
    /// Tentative collisions.
    pub collisions: u64,
}

/// A rung with its medians, and the slopes from the rung before: preparation, paths, memory.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Value of the quantity.
    pub value: f64,
    /// Medians.
    pub median: Once,
    /// The least and the largest time of preparation and paths together.
    pub spread: [f64; 2],
    /// From the rung before; none at the first, at a value of 0 and where nothing was measured.
    pub slopes: [Option<f64>; 3],
}

/// What was measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Growth {
    /// The builds that measured it.
    pub builds: Vec<Identity>,
    /// The processor and its threads.
    pub machine: String,
    /// Name of the scene.
    pub scene: String,
    /// What all rungs share.
    pub settings: Settings,
    /// Ladder by ladder.
    pub ladders: Vec<(Quantity, Vec<Row>)>,
}

impl Rung {
    /// Renders it in this process.
    pub fn measure(&self, scene: &Scene) -> Result<Once> {
        let (scene, settings) = self.apply(scene)?;
        if !self.backend.is_cpu() {
            // Whichever rung comes first would compile the kernel, which drivers keep.
            path::render(&scene, &PathSettings { samples: 1, ..settings }, self.backend, None, &|_, _| ())?;
        }
        let (image, [preparation, paths]) =
            timed_picture_by(self.quantity.clock(self.backend)?, self.backend, &scene, &settings)?;
        image.check_finite("the picture of a rung")?;
        let count = |name: &str| image.provenance.get(name).and_then(|text| text.parse().ok()).unwrap_or(0);
        let (leaves, collisions) = (count("majorant_leaves"), count("collisions"));
        Ok(Once { preparation, paths, memory: peak_memory(), leaves, collisions })
    }

    /// The scene and the settings that it stands for.
    fn apply(&self, scene: &Scene) -> Result<(Scene, PathSettings)> {
        let mut scene = scene.clone();
        let (mut width, mut samples) = (self.width, self.samples);
        let whole = || {
            let is_whole = self.value.fract() == 0.0 && (0.0..=1e6).contains(&self.value);
            is_whole.then_some(self.value as u32).ok_or_else(|| {
                Error::new(
                    self.quantity.label(),
                    self.value.to_string(),
                    "a whole number up to a million",
                    "Correct the values.",
                )
            })
        };
        match &self.quantity {
            Quantity::Width => width = whole()?.max(1),
            Quantity::Samples => samples = whole()?.max(1),
            Quantity::Bounces => scene.set_volume_bounces(whole()?),
            Quantity::Objects => copy_objects(&mut scene, whole()?.max(1)),
            Quantity::Size => enlarge(&mut scene, self.value)?,
            // The process has them.
            Quantity::Threads => {}
            Quantity::Input(name) => scene.set(&format!("{name}={}", self.value))?,
        }
        let longer = scene.image_size().into_iter().max().unwrap_or(1);
        let sides =
            scene.image_size().map(|side| (side as f64 * f64::from(width) / f64::from(longer)).round().max(1.0));
        scene.film.resolution = sides.map(|side| side as u32);
        scene.film.resolution_percentage = 100;
        Ok((scene, PathSettings { samples, ..PathSettings::default() }))
    }
}

/// Copies of the object on a grid in its box, so many that they fit along each axis.
fn copy_objects(scene: &mut Scene, count: u32) {
    let side = (1..).find(|side: &u32| side.pow(3) >= count).unwrap_or(1);
    let low = scene.volume.bounds.min.map(f64::from);
    let size: [f64; 3] = std::array::from_fn(|axis| f64::from(scene.volume.bounds.max[axis]) - low[axis]);
    let whole = scene.volume.clone();
    let copies = (0..count).map(|number| {
        let cell = [number % side, number / side % side, number / (side * side)].map(f64::from);
        let scale = 1.0 / f64::from(side);
        // Takes the box to its cell: first towards its own corner, then along.
        let shift = |axis: usize| low[axis] * (1.0 - scale) + size[axis] * scale * cell[axis];
        let mut copy = whole.clone();
        for row in 0..3 {
            let axes: [f64; 3] = std::array::from_fn(|axis| f64::from(whole.matrix_world[row][axis]));
            let moved: f64 = (0..3).map(|axis| axes[axis] * shift(axis)).sum();
            for axis in 0..3 {
                copy.matrix_world[row][axis] = (axes[axis] * scale) as _;
            }
            copy.matrix_world[row][3] = (f64::from(whole.matrix_world[row][3]) + moved) as _;
        }
        if number > 0 {
            copy.object = format!("{}, copy {number}", whole.object);
        }
        copy
    });
    let mut copies: Vec<_> = copies.collect();
    scene.volume = copies.remove(0);
    scene.other_volumes.extend(copies);
}

/// Multiplies all lengths of a scene, and divides its density by as much.
fn enlarge(scene: &mut Scene, by: f64) -> Result<()> {
    let wrong = |found: &str, expected: &str| {
        Error::new(
            "the size of the scene",
            found.to_owned(),
            expected.to_owned(),
            "Leave this quantity out, or take another scene.",
        )
    };
    if !(by.is_finite() && by > 0.0) {
        return Err(wrong(&by.to_string(), "factors above 0"));
    }
    if scene.lights.iter().any(|light| !matches!(light.kind, LightKind::Sun { .. })) {
        return Err(wrong("a lamp that stands somewhere", "suns alone, whose light is the same in a larger scene"));
    }
    let numbers: Vec<_> = scene.settable().into_iter().filter(|number| number.value.is_number()).collect();
    // By its label, as of a group; else the one socket of that name.
    let by_socket: Vec<_> =
        numbers.iter().filter(|number| number.exact_name.ends_with(&format!(".{DENSITY}"))).collect();
    let found = numbers.iter().find(|number| number.name == DENSITY).or(match by_socket.as_slice() {
        [only] => Some(*only),
        _ => None,
    });
    let Some((name, density)) = found.and_then(|number| Some((&number.exact_name, number.value.as_f64()?))) else {
        return Err(wrong("no number called Density", "one that keeps the scene as thick when it is larger"));
    };
    scene.set(&format!("{name}={}", density / by))?;
    let grow = |matrix: &mut Matrix, columns: std::ops::Range<usize>| {
        for row in &mut matrix[..3] {
            row[columns.clone()].iter_mut().for_each(|value| *value = (f64::from(*value) * by) as _);
        }
    };
    std::iter::once(&mut scene.volume)
        .chain(&mut scene.other_volumes)
        .for_each(|volume| grow(&mut volume.matrix_world, 0..4));
    grow(&mut scene.camera.matrix_world, 3..4);
    for length in [&mut scene.camera.clip_start, &mut scene.camera.clip_end, &mut scene.camera.ortho_scale] {
        *length = (f64::from(*length) * by) as f32;
    }
    Ok(())
}

/// Measures a rung in a process of its own.
pub type Measure<'a> = dyn Fn(&Rung) -> Result<Once> + 'a;

struct Running<'a> {
    scene: &'a Scene,
    ladders: &'a [Ladder],
    settings: Settings,
    measure: &'a Measure<'a>,
}

/// Measures ladders in a folder.
pub fn run(
    scene: &Scene,
    ladders: &[Ladder],
    settings: Settings,
    measure: &Measure<'_>,
    folder: &Path,
    how: &experiment::Settings,
    progress: Progress<'_>,
) -> Result<Outcome<Growth>> {
    let mut running = Running { scene, ladders, settings, measure };
    // What cannot be made is said before anything is measured.
    ladders.iter().try_for_each(|ladder| ladder.check(scene, settings))?;
    experiment::run(&mut running, Some(folder), how, progress)
}

impl Experiment for Running<'_> {
    /// Round and rung.
    type Job = (u32, Rung);
    type Record = Once;
    type Summary = Growth;

    fn purpose(&self) -> Purpose {
        let of = json!({"scene": self.scene.content_hash(), "ladders": self.ladders, "settings": self.settings});
        Purpose { mark: "experiment.json", format: "cloudparity-growth/1", of }
    }

    fn plan(&self) -> Result<Vec<Self::Job>> {
        let rungs = || self.ladders.iter().flat_map(|ladder| ladder.values.iter().map(move |value| (ladder, *value)));
        Ok((0..self.settings.repeats)
            .flat_map(|round| rungs().map(move |(ladder, value)| (round, ladder.rung(value, self.settings))))
            .collect())
    }

    fn inputs(&self, (round, rung): &Self::Job) -> Result<Json> {
        Ok(json!({"scene": self.scene.content_hash(), "round": round, "rung": rung, "machine": machine()}))
    }

    fn label(&self, (_, rung): &Self::Job) -> String {
        format!("{} {}", rung.value, rung.quantity.label())
    }

    fn run(&mut self, (_, rung): &Self::Job, _desk: &Desk<'_>) -> Result<Found<Once>> {
        (self.measure)(rung).map(Found::Record)
    }

    fn summary(&mut self, found: Vec<Done<Self>>, desk: &Desk<'_>) -> Result<Growth> {
        let builds = desk.ledger.builds();
        let all = experiment::records(found);
        let rungs: usize = self.ladders.iter().map(|ladder| ladder.values.len()).sum();
        let mut ladders = Vec::new();
        let mut number = 0;
        for ladder in self.ladders {
            let mut rows: Vec<Row> = Vec::new();
            for &value in &ladder.values {
                let of_rung: Vec<&Once> = all.iter().skip(number).step_by(rungs).collect();
                number += 1;
                rows.push(Row::of(value, &of_rung, rows.last()));
            }
            ladders.push((ladder.quantity.clone(), rows));
        }
        let (scene, settings) = (self.scene.name.clone(), self.settings);
        Ok(Growth { builds, machine: machine(), scene, settings, ladders })
    }
}

impl Row {
    fn of(value: f64, all: &[&Once], before: Option<&Self>) -> Self {
        let of = |part: fn(&Once) -> f64| median(all.iter().map(|once| part(once)).collect());
        let memory = all.iter().all(|once| once.memory.is_some());
        let median = Once {
            preparation: of(|once| once.preparation),
            paths: of(|once| once.paths),
            memory: memory.then(|| of(|once| once.memory.unwrap_or(0) as f64) as u64),
            leaves: all[0].leaves,
            collisions: all[0].collisions,
        };
        let times = || all.iter().map(|once| once.preparation + once.paths);
        let spread = [times().fold(f64::INFINITY, f64::min), times().fold(0.0, f64::max)];
        let figures = |once: &Once| [once.preparation, once.paths, once.memory.unwrap_or(0) as f64];
        let slopes = before.map_or([None; 3], |before| {
            let [now, then] = [figures(&median), figures(&before.median)];
            std::array::from_fn(|figure| {
                let slope = (now[figure] / then[figure]).ln() / (value / before.value).ln();
                slope.is_finite().then_some(slope)
            })
        });
        Self { value, median, spread, slopes }
    }
}

impl Growth {
    /// A table for a terminal.
    pub fn table(&self) -> String {
        let Settings { width, samples, repeats, backend } = self.settings;
        let mut text = format!(
            "{}, {width} pixels wide, {samples} samples; medians of {repeats}, slopes of logarithms from the rung before; paths on the {backend}; {}\n",
            self.scene, self.machine
        );
        let slope = |slope: Option<f64>| slope.map_or_else(|| "-".to_owned(), |slope| format!("{slope:.2}"));
        for (quantity, rows) in &self.ladders {
            let _ = writeln!(
                text,
                "\n{:<30}{:>14}{:>7}{:>12}{:>7}{:>10}{:>7}{:>10}{:>13}",
                quantity.label(),
                "preparation s",
                "slope",
                "paths s",
                "slope",
                "MiB",
                "slope",
                "leaves",
                "collisions"
            );
            for Row { value, median, slopes, .. } in rows {
                let memory =
                    median.memory.map_or_else(|| "-".to_owned(), |bytes| format!("{:.0}", bytes as f64 / 1_048_576.0));
                let _ = writeln!(
                    text,
                    "{value:<30}{:>14.3}{:>7}{:>12.3}{:>7}{memory:>10}{:>7}{:>10}{:>13}",
                    median.preparation,
                    slope(slopes[0]),
                    median.paths,
                    slope(slopes[1]),
                    slope(slopes[2]),
                    median.leaves,
                    median.collisions
                );
            }
        }
        text
    }

    /// Draws every ladder as `growth.svg`, `.png` and `.pdf`. Needs matplotlib.
    pub fn draw(&self, folder: &Path) -> Result<()> {
        let file = |extension: &str| folder.join(format!("growth.{extension}"));
        let ladders: Vec<Json> =
            self.ladders.iter().map(|(quantity, rows)| json!({"name": quantity.label(), "rows": rows})).collect();
        let request = json!({
            "title": format!("Growth of path tracing on the {}, {}", self.settings.backend, self.scene), "ladders": ladders,
            "svg": file("svg"), "png": file("png"), "pdf": file("pdf"),
        });
        bridge::run_script("growth_plot.py", &request, CyclesKernel::Default, |_| ()).map(drop)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::timing::timed_picture;

    fn scene(stem: &str) -> Scene {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("parity/scenes");
        Scene::load(&folder.join(format!("{stem}.scene.json"))).expect("a committed scene")
    }

    fn rung(quantity: Quantity, value: f64) -> Rung {
        Rung { quantity, value, width: 24, samples: 64, backend: Backend::Cpu }
    }

    fn mean(rung: &Rung, scene: &Scene) -> f64 {
        let (scene, settings) = rung.apply(scene).expect("a rung");
        let image = timed_picture(&scene, &PathSettings { seed: rung.value as u32, ..settings }).expect("a picture").0;
        image.mean()[0]
    }

    #[test]
    fn a_larger_scene_is_the_same_picture() {
        let scene = scene("homogeneous-cube");
        let [small, large] = [1.0, 1000.0].map(|factor| mean(&rung(Quantity::Size, factor), &scene));
        // 24 pixels wide, 64 samples: a standard error of some 0.1 %.
        assert!((large / small - 1.0).abs() < 0.01, "{small} {large}");
    }

    #[test]
    fn copies_fill_the_box_of_a_homogeneous_medium() {
        let scene = scene("homogeneous-cube");
        let whole = mean(&rung(Quantity::Objects, 1.0), &scene);
        let copied = mean(&rung(Quantity::Objects, 27.0), &scene);
        assert!((copied / whole - 1.0).abs() < 0.01, "{whole} {copied}");
        let (some, _) = rung(Quantity::Objects, 5.0).apply(&scene).expect("a rung");
        assert_eq!(some.other_volumes.len(), 4);
    }

    #[test]
    fn slopes_are_those_of_logarithms_and_of_nothing_else() {
        let once = |paths: f64| Once { preparation: 0.0, paths, memory: Some(1 << 20), leaves: 1, collisions: 1 };
        let first = Row::of(2.0, &[&once(3.0), &once(1.0), &once(2.0)], None);
        assert_eq!((first.median.paths, first.spread, first.slopes), (2.0, [1.0, 3.0], [None; 3]));
        let second = Row::of(8.0, &[&once(32.0)], Some(&first));
        assert_eq!(second.slopes, [None, Some(2.0), Some(0.0)]);
    }

    #[test]
    fn what_cannot_grow_is_said() {
        let error = rung(Quantity::Samples, 2.5).apply(&scene("homogeneous-cube")).map(drop).unwrap_err().to_string();
        assert!(error.contains("samples of a pixel") && error.contains("2.5"), "{error}");
        assert!(rung(Quantity::Size, 0.0).apply(&scene("homogeneous-cube")).is_err());
        assert!(rung(Quantity::Input("No such".into()), 1.0).apply(&scene("homogeneous-cube")).is_err());
    }
}
