//! How long kernels take to compile: the graph to a program, the program to a linked module, naga's validation, the adapter's
//! pipeline; several scenes in one run.
//!
//! Drivers keep what they have compiled, on disk, too. So every repetition compiles a text of its own: it holds a comparison with
//! another number, which no invocation meets.

use crate::base::error::Result;
use crate::gpu::{Gpu, Layout};
use crate::graph::Program;
use crate::graph::constants::SharedConstants;
use crate::graph::wgsl::{self, Linker};
use crate::integrators::{march, path};
use crate::media::medium::Medium;
use crate::scene::Scene;
use serde::Serialize;
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
        layouts: march::adapter::LAYOUTS,
        constants: Some(&march::adapter::CONSTANTS),
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
pub struct Row {
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

/// Times of one kernel of one scene, one entry per repetition.
#[derive(Default)]
struct Times {
    graph: Vec<f64>,
    link: Vec<f64>,
    validate: Vec<f64>,
    pipeline: Vec<f64>,
    instructions: usize,
    bytes: usize,
}

/// The density that the kernels of a scene read. Scenes without one, of several media or densities, have no kernels: they are
/// rendered on the CPU, and the error says why.
pub fn density(scene: &Scene) -> Result<Arc<Program>> {
    // Several closures have one density where they share it, which the medium finds out.
    Program::density(scene).map(Arc::new).or_else(|_| Medium::new(scene).map(|medium| medium.density.program().clone()))
}

/// Compiles every kernel of every scene `repeats` times, the scenes in turn; `receive` hears what comes next. Every scene needs a
/// [`density`].
pub fn run(scenes: &[Scene], repeats: usize, gpu: Option<&Gpu>, mut receive: impl FnMut(&str)) -> Result<Vec<Row>> {
    let mut times: Vec<Times> = scenes.iter().flat_map(|_| KERNELS).map(|_| Times::default()).collect();
    // Not two equal texts, in this process or in one before.
    let mut number = fresh_number();
    for _ in 0..repeats {
        for (scene, times) in scenes.iter().zip(times.chunks_mut(KERNELS.len())) {
            receive(&scene.name);
            for (kernel, times) in KERNELS.iter().zip(times) {
                number = number.wrapping_add(1);
                times.compile(scene, kernel, &with_number(kernel.source, number), gpu)?;
            }
        }
    }
    let mut rows: Vec<Row> = Vec::new();
    for (scene, times) in scenes.iter().zip(times.chunks(KERNELS.len())) {
        for (Compiled { name: kernel, .. }, times) in KERNELS.iter().zip(times) {
            let pipeline_ms = gpu.map(|_| median(&times.pipeline));
            let [graph_ms, link_ms, validate_ms] =
                [&times.graph, &times.link, &times.validate].map(|times| median(times));
            let total_ms = graph_ms + link_ms + validate_ms + pipeline_ms.unwrap_or(0.0);
            let first = rows.iter().find(|row| row.kernel == *kernel).map_or(total_ms, |row| row.total_ms);
            rows.push(Row {
                scene: scene.name.clone(),
                kernel,
                instructions: times.instructions,
                bytes: times.bytes,
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

impl Times {
    fn compile(&mut self, scene: &Scene, kernel: &Compiled, source: &str, gpu: Option<&Gpu>) -> Result<()> {
        let begin = Instant::now();
        let program = density(scene)?;
        self.graph.push(milliseconds(begin));
        let begin = Instant::now();
        let mut linker = Linker::new(&program)?;
        kernel.constants.map(|constants| linker.add_constants(constants)).transpose()?;
        let module = linker.link(kernel.path, source)?;
        self.link.push(milliseconds(begin));
        let begin = Instant::now();
        wgsl::validate(&module)?;
        self.validate.push(milliseconds(begin));
        if let Some(gpu) = gpu {
            let begin = Instant::now();
            gpu.kernel(kernel.path, &module, kernel.layouts)?;
            gpu.wait()?;
            self.pipeline.push(milliseconds(begin));
        }
        self.instructions = program.instructions.len();
        self.bytes = wgsl::write(&module, wgsl::Language::Wgsl)?.len();
        Ok(())
    }
}

fn milliseconds(begin: Instant) -> f64 {
    begin.elapsed().as_secs_f64() * 1e3
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
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
        let rows = run(&[scene.clone(), scene], 1, None, |_| ()).expect("times");
        assert_eq!(rows.len(), 2 * KERNELS.len());
        assert!(rows[..KERNELS.len()].iter().all(|row| row.ratio == 1.0 && row.pipeline_ms.is_none()));
        // The same kernel of the same scene holds the same text but for the number, which has ten digits.
        assert_eq!(rows[0].bytes, rows[KERNELS.len()].bytes);
        assert!(rows[0].bytes < rows[1].bytes && rows[0].instructions > 10);
    }
}
