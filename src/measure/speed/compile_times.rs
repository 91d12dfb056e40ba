//! How long kernels take to compile: the graph to a program, the program to a linked module, naga's validation, the adapter's
//! pipeline; several scenes in one run.
//!
//! Drivers keep what they have compiled, on disk, too. So every repetition compiles a text of its own: it holds a comparison with
//! another number, which no invocation meets.

use crate::base::error::Result;
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::gpu::{Gpu, Layout};
use crate::graph::Program;
use crate::graph::constants::SharedConstants;
use crate::graph::wgsl::{self, Linker};
use crate::integrators::{march, path};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment};
use crate::measure::speed::median;
use crate::media::medium::Medium;
use crate::scene::Scene;
use serde::{Deserialize, Serialize};
use serde_json::{Value as Json, json};
use std::sync::Arc;
use std::time::Instant;

/// A kernel that is compiled.
struct Compiled {
    name: &'static str,
    path: &'static str,
    source: &'static str,
    layouts: &'static [Layout],
    constants: Option<&'static SharedConstants>,
}

const KERNELS: [Compiled; 3] = [
    Compiled {
        name: "points",
        path: "graph/density_at_points.wgsl",
        source: include_str!("../../../shaders/graph/density_at_points.wgsl"),
        layouts: &[],
        constants: None,
    },
    Compiled {
        name: "march",
        path: "integrators/march/march.wgsl",
        source: include_str!("../../../shaders/integrators/march/march.wgsl"),
        layouts: march::gpu::LAYOUTS,
        constants: Some(&march::gpu::CONSTANTS),
    },
    Compiled {
        name: "path",
        path: "integrators/path/path.wgsl",
        source: include_str!("../../../shaders/integrators/path/path.wgsl"),
        layouts: path::LAYOUTS,
        constants: Some(&path::CONSTANTS),
    },
];

/// Milliseconds of compiling one kernel of one scene: medians.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CompileTime {
    /// Name of the scene.
    pub scene: String,
    /// The kernel: densities at points, the march with everything in it, path tracing.
    pub kernel: &'static str,
    /// Nodes that the program evaluates.
    pub instructions: usize,
    /// Bytes of the linked module as WGSL.
    pub bytes: usize,
    /// The graph to a program.
    pub graph_ms: f64,
    /// Generation, composition and parsing of the text.
    pub link_ms: f64,
    /// naga's validation.
    pub validate_ms: f64,
    /// The adapter's pipeline; none without an adapter.
    pub pipeline_ms: Option<f64>,
    /// All of it.
    pub total_ms: f64,
    /// The total over that of the first scene's same kernel.
    pub ratio: f64,
}

/// One compilation of one kernel of one scene, in milliseconds.
#[derive(Serialize, Deserialize)]
struct Once {
    graph: f64,
    link: f64,
    validate: f64,
    pipeline: Option<f64>,
    instructions: usize,
    bytes: usize,
}

/// The density that the kernels of a scene read. Scenes without one, of several media or densities, have no kernels: they are
/// rendered on the CPU, and the error says why.
pub fn density(scene: &Scene) -> Result<Arc<Program>> {
    // Several closures have one density where they share it, which the medium finds out.
    Program::density(scene).map(Arc::new).or_else(|_| Medium::new(scene).map(|medium| medium.density.program().clone()))
}

/// Kernels that are compiled again and again.
struct Running<'a> {
    scenes: &'a [Scene],
    repeats: usize,
    gpu: Option<&'a Gpu>,
    /// Not two equal texts, in this process or in one before.
    number: u32,
}

/// Compiles every kernel of every scene `repeats` times, the scenes in turn. Every scene needs a [`density`]. Nothing is kept: ratios are of
/// one run.
pub fn run(scenes: &[Scene], repeats: usize, gpu: Option<&Gpu>, progress: Progress<'_>) -> Result<Vec<CompileTime>> {
    let mut running = Running { scenes, repeats, gpu, number: fresh_number() };
    experiment::run(&mut running, None, &experiment::Settings::default(), progress)?.all()
}

impl Experiment for Running<'_> {
    /// Repetition and scene.
    type Job = (usize, usize);
    /// Of every kernel.
    type Record = Vec<Once>;
    type Summary = Vec<CompileTime>;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: "cloudparity-bench-compile/1", of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<Self::Job>> {
        Ok((0..self.repeats).flat_map(|repeat| (0..self.scenes.len()).map(move |scene| (repeat, scene))).collect())
    }

    fn inputs(&self, (repeat, scene): &Self::Job) -> Result<Json> {
        Ok(json!({"scene": self.scenes[*scene].content_hash(), "number": scene, "repeat": repeat}))
    }

    fn label(&self, (_, scene): &Self::Job) -> String {
        self.scenes[*scene].name.clone()
    }

    fn run(&mut self, (_, scene): &Self::Job, _desk: &Desk<'_>) -> Result<Found<Vec<Once>>> {
        let mut found = Vec::with_capacity(KERNELS.len());
        for kernel in &KERNELS {
            self.number = self.number.wrapping_add(1);
            let source = with_number(kernel.source, self.number);
            found.push(Once::compile(&self.scenes[*scene], kernel, &source, self.gpu)?);
        }
        Ok(Found::Record(found))
    }

    fn summary(&mut self, found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<Vec<CompileTime>> {
        let all = experiment::records(found);
        let count = self.scenes.len();
        let mut rows: Vec<CompileTime> = Vec::new();
        for (number, scene) in self.scenes.iter().enumerate() {
            for (index, Compiled { name: kernel, .. }) in KERNELS.iter().enumerate() {
                let times: Vec<&Once> = all.iter().skip(number).step_by(count).map(|kernels| &kernels[index]).collect();
                let of = |part: fn(&Once) -> f64| median(times.iter().map(|once| part(once)).collect());
                let pipeline_ms = self.gpu.map(|_| of(|once| once.pipeline.unwrap_or(0.0)));
                let [graph_ms, link_ms, validate_ms] =
                    [of(|once| once.graph), of(|once| once.link), of(|once| once.validate)];
                let total_ms = graph_ms + link_ms + validate_ms + pipeline_ms.unwrap_or(0.0);
                let first = rows.iter().find(|row| row.kernel == *kernel).map_or(total_ms, |row| row.total_ms);
                rows.push(CompileTime {
                    scene: scene.name.clone(),
                    kernel,
                    instructions: times.last().map_or(0, |once| once.instructions),
                    bytes: times.last().map_or(0, |once| once.bytes),
                    graph_ms,
                    link_ms,
                    validate_ms,
                    pipeline_ms,
                    total_ms,
                    ratio: total_ms / first,
                });
            }
        }
        Ok(rows)
    }
}

impl Once {
    fn compile(scene: &Scene, kernel: &Compiled, source: &str, gpu: Option<&Gpu>) -> Result<Self> {
        let begin = Instant::now();
        let program = density(scene)?;
        let graph = milliseconds(begin);
        let begin = Instant::now();
        let mut linker = Linker::new(&program)?;
        if let Some(constants) = kernel.constants {
            linker.add_constants(constants);
        }
        let module = linker.link(kernel.path, source)?;
        let link = milliseconds(begin);
        let begin = Instant::now();
        wgsl::validate(&module)?;
        let validate = milliseconds(begin);
        let mut pipeline = None;
        if let Some(gpu) = gpu {
            let begin = Instant::now();
            gpu.kernel(kernel.path, &module, kernel.layouts)?;
            gpu.wait()?;
            pipeline = Some(milliseconds(begin));
        }
        let bytes = wgsl::write(&module, wgsl::Language::Wgsl)?.len();
        Ok(Self { graph, link, validate, pipeline, instructions: program.instructions.len(), bytes })
    }
}

fn milliseconds(begin: Instant) -> f64 {
    begin.elapsed().as_secs_f64() * 1e3
}

/// A number that no run before had, most probably.
fn fresh_number() -> u32 {
    let since = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    3_000_000_000 + since.subsec_nanos() % 1_000_000_000
}

/// The entry text with a comparison in front that holds for no invocation.
fn with_number(source: &str, number: u32) -> String {
    let body = source.find("fn main(").and_then(|start| source[start..].find("{\n").map(|place| start + place + 2));
    let (head, tail) = source.split_at(body.expect("an entry text has a main function"));
    format!("{head}    if invocation.x == {number}u {{ return; }}\n{tail}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_is_compiled_and_compared_with_the_first_scene() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/parity/scenes/procedural-clouds.scene.json");
        let scene = Scene::load(std::path::Path::new(path)).expect("a committed scene");
        let rows = run(&[scene.clone(), scene], 1, None, &|_, _| ()).expect("times");
        assert_eq!(rows.len(), 2 * KERNELS.len());
        assert!(rows[..KERNELS.len()].iter().all(|row| row.ratio == 1.0 && row.pipeline_ms.is_none()));
        // The same kernel of the same scene holds the same text but for the number, which has ten digits.
        assert_eq!(rows[0].bytes, rows[KERNELS.len()].bytes);
        assert!(rows[0].bytes < rows[1].bytes && rows[0].instructions > 10);
    }
}
