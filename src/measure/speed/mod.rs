//! Speed of the field evaluators beside Cycles', on the same points in one run.
//!
//! A rate is a slope: the time for many points less the time for few, over the difference, so that
//! start-up and compilation do not count. Cycles evaluates through a render of a mesh with one face
//! per point; what that costs besides the shader is measured with a graph that only passes a
//! coordinate on, and taken off. Ratios are only formed within one run.

pub mod compile_times;
pub mod growth;
pub mod leaving_out;
pub mod limits;
pub mod perlin_fbm;
pub mod quick;
pub mod time_to_error;
pub mod variance;
pub mod voxels;

use crate::base::error::{Error, Result};
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::bridge;
use crate::bridge::{CyclesKernel, probe};
use crate::gpu::Gpu;
use crate::graph::evaluate::Points;
use crate::graph::{Program, target};
use crate::measure::domain;
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment};
use crate::measure::speed::limits::Limits;
use crate::scene::{Bounds, Input, Scene};
use rand::{Rng as _, SeedableRng as _};
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::time::Instant;

/// Rates in points per second; ratios are ours over Cycles'.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Rates {
    /// The workload.
    pub what: String,
    /// Points evaluated.
    #[serde(default)]
    pub points: Option<u64>,
    /// Cycles on the CPU.
    #[serde(default)]
    pub cycles_rate: Option<f64>,
    /// Our CPU evaluator.
    #[serde(default)]
    pub cpu_rate: Option<f64>,
    /// The generated WGSL.
    #[serde(default)]
    pub gpu_rate: Option<f64>,
    /// The same by the clock of an adapter that has one of its own: without what brings points there and values back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub kernel_rate: Option<f64>,
    /// What that adapter could do at most.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limits: Option<Limits>,
    /// `cpu_rate / cycles_rate`.
    #[serde(default)]
    pub cpu_ratio: Option<f64>,
    /// `gpu_rate / cycles_rate`.
    #[serde(default)]
    pub gpu_ratio: Option<f64>,
}

/// What to measure.
pub struct Settings {
    /// Points of the larger sample.
    pub points: usize,
    /// Repetitions; the median counts.
    pub repeats: usize,
    /// Ask Cycles too.
    pub with_cycles: bool,
}

/// Share of the larger sample that the smaller one has.
const SMALLER: usize = 5;

/// One set of points.
struct Workload {
    what: &'static str,
    points: Vec<[f32; 3]>,
}

/// The rates of a scene while they are measured.
struct Running<'a> {
    scene: &'a Scene,
    settings: &'a Settings,
    program: Program,
    workloads: Vec<Workload>,
    gpu: Option<Gpu>,
}

/// Measures every workload of a scene. Nothing is kept: ratios are of one run.
pub fn run(scene: &Scene, settings: &Settings, progress: Progress<'_>) -> Result<Vec<Rates>> {
    let program = Program::density(scene)?;
    let workloads = workloads(scene, &program, settings.points)?;
    let mut running = Running { scene, settings, program, workloads, gpu: Gpu::open().ok() };
    experiment::run(&mut running, None, &experiment::Settings::default(), progress)?.all()
}

impl Experiment for Running<'_> {
    /// The position of a workload.
    type Job = usize;
    type Record = Rates;
    type Summary = Vec<Rates>;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: "cloudparity-bench/1", of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<usize>> {
        Ok((0..self.workloads.len()).collect())
    }

    fn inputs(&self, job: &usize) -> Result<Json> {
        let Settings { points, repeats, with_cycles } = self.settings;
        Ok(
            json!({"scene": self.scene.content_hash(), "what": self.label(job), "settings": (points, repeats, with_cycles)}),
        )
    }

    fn label(&self, job: &usize) -> String {
        self.workloads[*job].what.to_owned()
    }

    fn run(&mut self, job: &usize, _desk: &Desk<'_>) -> Result<Found<Rates>> {
        let Workload { what, points } = &self.workloads[*job];
        let repeats = self.settings.repeats;
        let cpu_rate = slope(points.len(), repeats, |count| {
            self.program.evaluate_single(Points::new(&points[..count])).map(|_| ())
        })?;
        let (mut gpu_rate, mut kernel_rate, mut limits) = (None, None, None);
        if let Some(gpu) = &self.gpu {
            let kernel = gpu.field(&self.program)?;
            let evaluate = |count: usize| kernel.evaluate(Points::new(&points[..count])).map(drop);
            gpu_rate = Some(slope(points.len(), repeats, evaluate)?);
            kernel_rate = limits::rate(gpu, points.len() as f64, repeats, || evaluate(points.len()))?;
            limits = limits::measure(gpu, self.scene, points, repeats)?;
        }
        let cycles_rate =
            if self.settings.with_cycles { Some(cycles_rate(self.scene, points, repeats)?) } else { None };
        Ok(Found::Record(Rates {
            what: (*what).to_owned(),
            points: Some(points.len() as u64),
            cycles_rate,
            cpu_rate: Some(cpu_rate),
            gpu_rate,
            kernel_rate,
            limits,
            cpu_ratio: cycles_rate.map(|cycles| cpu_rate / cycles),
            gpu_ratio: gpu_rate.zip(cycles_rate).map(|(gpu, cycles)| gpu / cycles),
        }))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<Vec<Rates>> {
        Ok(experiment::records(found))
    }
}

/// Points of the layer where the field is not provably constant: in random order, as coherent 8x8
/// tiles, and those alone where the density is not zero.
fn workloads(scene: &Scene, program: &Program, count: usize) -> Result<Vec<Workload>> {
    let Bounds { min: low, max: high } = domain::region(program, scene.volume.bounds)?;
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(42);
    let mut point =
        || -> [f32; 3] {
            std::array::from_fn(|axis| {
                if low[axis] < high[axis] { random.random_range(low[axis]..high[axis]) } else { low[axis] }
            })
        };
    let scattered: Vec<[f32; 3]> = (0..count).map(|_| point()).collect();
    // A tile is what 8x8 neighbouring pixels of a picture 1024 pixels wide see at one depth.
    let pitch = (high[0] - low[0]).max(high[1] - low[1]) / 1024.0;
    let mut tiles = Vec::with_capacity(count);
    while tiles.len() < count {
        let corner = point();
        for index in 0..64 {
            let (column, row) = ((index % 8) as f32, (index / 8) as f32);
            tiles.push([corner[0] + pitch * column, corner[1] + pitch * row, corner[2]]);
        }
    }
    tiles.truncate(count);
    let mut inside = Vec::with_capacity(count);
    for _ in 0..1000 {
        let candidates: Vec<[f32; 3]> = (0..count).map(|_| point()).collect();
        let values = program.evaluate_single(Points::new(&candidates))?;
        inside.extend(candidates.iter().zip(&values).filter(|(_, value)| **value != 0.0).map(|(point, _)| *point));
        if inside.len() >= count {
            break;
        }
    }
    inside.truncate(count);
    let mut all =
        vec![Workload { what: "random order", points: scattered }, Workload { what: "8x8 tiles", points: tiles }];
    if inside.len() == count {
        all.push(Workload { what: "non-zero points alone", points: inside });
    }
    Ok(all)
}

/// The middle one; 0 of none.
fn median(mut sorted: Vec<f64>) -> f64 {
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Points per second by the slope between a fifth of the points and all of them; median of the
/// repeats.
fn slope(count: usize, repeats: usize, mut evaluate: impl FnMut(usize) -> Result<()>) -> Result<f64> {
    let few = count / SMALLER;
    evaluate(few)?;
    let mut seconds = Vec::new();
    for _ in 0..repeats {
        let mut time = |count: usize| -> Result<f64> {
            let start = Instant::now();
            evaluate(count)?;
            Ok(start.elapsed().as_secs_f64())
        };
        let (short, long) = (time(few)?, time(count)?);
        seconds.push(long - short);
    }
    rate(count - few, seconds)
}

fn rate(points: usize, seconds: Vec<f64>) -> Result<f64> {
    let median = median(seconds);
    if median <= 0.0 {
        return Err(Error::new(
            "benchmark",
            format!("a time of {median} s for {points} points"),
            "a time that grows with the points",
            "Measure more points, on a machine that does nothing else.",
        )
        .with_setting("points"));
    }
    Ok(points as f64 / median)
}

/// Cycles' rate on these points with the kernel that it chooses by itself, without what its render
/// costs for a graph that does nothing.
fn cycles_rate(scene: &Scene, points: &[[f32; 3]], repeats: usize) -> Result<f64> {
    let few = points.len() / SMALLER;
    let idle = idle_scene(scene)?;
    let repeats = repeats.min(3);
    let whole = points.len();
    let jobs = [
        job(scene, &points[..few], repeats)?,
        job(scene, &points[..whole], repeats)?,
        job(&idle, &points[..few], repeats)?,
        job(&idle, &points[..whole], repeats)?,
    ];
    let answers = probe::ask(&jobs, CyclesKernel::Default, |_| ())?;
    let seconds = |number: usize| answers.jobs[number].render_seconds.clone();
    let (short, long, idle_short, idle_long) = (seconds(0), seconds(1), seconds(2), seconds(3));
    let differences = (0..repeats.min(long.len()))
        .map(|index| (long[index] - short[index]) - (idle_long[index] - idle_short[index]))
        .collect();
    rate(points.len() - few, differences)
}

fn job<'a>(scene: &'a Scene, positions: &'a [[f32; 3]], repeat: usize) -> Result<probe::Job<'a>> {
    Ok(probe::Job { scene, positions, attributes: &[], targets: vec![target::density(scene)?], repeat, samples: 1 })
}

/// The scene with a density that is just the height: what a render costs without the shader.
fn idle_scene(scene: &Scene) -> Result<Scene> {
    let mut idle = scene.clone();
    let closing = target::density(scene)?;
    let graph = idle.graph_mut();
    // The tree that the closing node stands in: the material's own or a group's.
    let tree = closing.groups.iter().fold(None, |tree: Option<usize>, name| {
        let nodes = tree.map_or(&graph.nodes, |number| &graph.groups[number].nodes);
        let inside = nodes.iter().find(|node| node.name == *name)?.group.as_ref()?;
        graph.groups.iter().position(|group| group.name == *inside)
    });
    let nodes = match tree {
        Some(number) => &mut graph.groups[number].nodes,
        None => &mut graph.nodes,
    };
    let coordinate = "cloudparity height";
    let node = |name: &str, kind: &str, inputs: indexmap::IndexMap<String, Input>| crate::scene::Node {
        name: name.to_owned(),
        kind: kind.to_owned(),
        label: None,
        location: Some([0.0, 0.0]),
        muted: false,
        bypass: None,
        group: None,
        socket_type: None,
        properties: serde_json::Map::new(),
        outputs: indexmap::IndexMap::new(),
        inputs,
        folded: Vec::new(),
    };
    let link = |node: &str, socket: &str| Input::Link { node: node.to_owned(), socket: socket.to_owned() };
    let separate = format!("{coordinate} component");
    nodes.push(node(coordinate, "ShaderNodeTexCoord", indexmap::IndexMap::new()));
    let inputs = [("Vector".to_owned(), link(coordinate, "Object"))].into_iter().collect();
    nodes.push(node(&separate, "ShaderNodeSeparateXYZ", inputs));
    for node in nodes {
        if node.name == closing.node {
            node.inputs.insert("Density".to_owned(), link(&separate, "Z"));
        }
    }
    Ok(idle)
}

/// Whether live Cycles can be measured here.
pub fn can_ask_cycles() -> bool {
    bridge::has_bpy()
}
