//! Our evaluators of a field, and their values beside those of live Cycles at the same points.

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::bridge::{CyclesKernel, Message, probe};
use crate::gpu::Gpu;
use crate::graph::evaluate::{Arithmetic, Points};
use crate::graph::{Program, Target};
use crate::measure::errors::values::{Comparison, Figures};
use crate::scene::Scene;
use indexmap::IndexMap;
use serde::Serialize;
use std::time::Instant;

/// Largest error of the generated WGSL against Cycles that counts as agreement, relative to
/// max(1, max |Cycles|), on an adapter that rounds every operation or fuses as Cycles' own AVX2 kernel
/// does: the two kernels of Cycles differ by up to 7.2e-7 per Voronoi texture and 1.7e-6 per
/// undistorted Noise texture, which this scene adds up. What else WGSL permits is bounded point by
/// point by [`Program::rounding_bounds`].
pub const GPU_LIMIT: f64 = 3e-6;

/// Points per job. Several jobs show progress and keep Cycles' buffers small.
const CHUNK: usize = 1 << 18;

choice! {
    "lowercase",
    /// One of our evaluators.
    #[derive(Hash)]
    pub enum Evaluator {
        /// f32 on the CPU, equal to Cycles bit for bit.
        Cpu,
        /// WGSL on the adapter.
        Gpu,
        /// f64 with f32 coordinates, on the CPU: shows how well conditioned the field is.
        Oracle,
    }
}

impl Evaluator {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Cpu, Self::Gpu, Self::Oracle];

    /// The name in reports.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Largest error that counts as agreement; the oracle is not judged.
    pub fn limit(self) -> Option<f64> {
        match self {
            Self::Cpu => Some(0.0),
            Self::Gpu => Some(GPU_LIMIT),
            Self::Oracle => None,
        }
    }
}

/// Values of all outputs of `program`, point by point, and the seconds that the evaluation took.
pub fn evaluate(
    program: &Program,
    points: Points<'_>,
    evaluator: Evaluator,
    gpu: Option<&Gpu>,
) -> Result<(Vec<f32>, f64)> {
    let opened = if evaluator == Evaluator::Gpu && gpu.is_none() { Some(Gpu::open()?) } else { None };
    let kernel = match (evaluator, gpu.or(opened.as_ref())) {
        (Evaluator::Gpu, Some(gpu)) => Some(gpu.field(program)?),
        _ => None,
    };
    let begin = Instant::now();
    let values = match (evaluator, &kernel) {
        (Evaluator::Oracle, _) => {
            program.evaluate(points, Arithmetic::Oracle)?.into_iter().map(|value| value as f32).collect()
        }
        (_, Some(kernel)) => kernel.evaluate(points)?,
        _ => program.evaluate_single(points)?,
    };
    Ok((values, begin.elapsed().as_secs_f64()))
}

/// The evaluator that ours are compared with.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reference {
    /// Always Cycles.
    pub renderer: &'static str,
    /// Its kernel.
    pub kernel: &'static str,
    /// Blender's version.
    pub blender: String,
    /// Seconds of rendering.
    pub seconds: f64,
}

/// What to probe.
#[derive(Debug, Clone)]
pub struct Request<'a> {
    /// The scene, with all settings applied.
    pub scene: &'a Scene,
    /// The socket.
    pub target: Target,
    /// Object-space positions.
    pub positions: &'a [[f32; 3]],
    /// Which of ours.
    pub evaluators: &'a [Evaluator],
    /// Whether the WGSL is also compared with its own rounding bound at every point, for adapters
    /// that fuse: [`Program::rounding_bounds`].
    pub rounding_bound: bool,
}

/// What each of our evaluators found, in the order asked for.
pub type Comparisons = Vec<(Evaluator, Comparison)>;

/// Compares at the same points for every request, with one Blender process for all of them.
/// Returns, per request, the evaluators' comparisons in order, and the reference.
pub fn compare(requests: &[Request<'_>], receive: impl FnMut(Message)) -> Result<(Vec<Comparisons>, Reference)> {
    // What ours cannot do is said before Cycles spends minutes.
    let programs: Vec<Program> = requests
        .iter()
        .map(|request| Program::compile(request.scene, std::slice::from_ref(&request.target)))
        .collect::<Result<_>>()?;
    let needs_gpu = requests.iter().any(|request| request.evaluators.contains(&Evaluator::Gpu));
    let gpu = if needs_gpu { Some(Gpu::open()?) } else { None };
    let mut jobs = Vec::new();
    for request in requests {
        if request.positions.is_empty() {
            return Err(Error::new("points", "0", "at least one point", "Ask for more points.").with_setting("points"));
        }
        for positions in request.positions.chunks(CHUNK) {
            let targets = vec![request.target.clone()];
            jobs.push(probe::Job { scene: request.scene, positions, attributes: &[], targets, repeat: 1, samples: 1 });
        }
    }
    let answers = probe::ask(&jobs, CyclesKernel::Sse42, receive)?;
    let seconds = answers.jobs.iter().flat_map(|answer| &answer.render_seconds).sum();
    let reference = Reference { renderer: "Cycles", kernel: "sse42", blender: answers.blender, seconds };
    let mut parts = answers.jobs.into_iter();
    let mut found = Vec::new();
    for (request, program) in requests.iter().zip(&programs) {
        let count = request.positions.len().div_ceil(CHUNK);
        let theirs: Vec<f32> = parts.by_ref().take(count).flat_map(|mut answer| answer.values.remove(0)).collect();
        let mut comparisons = Vec::new();
        for &evaluator in request.evaluators {
            let (ours, seconds) = evaluate(program, Points::new(request.positions), evaluator, gpu.as_ref())?;
            let mut comparison = Comparison::new(request.positions, &ours, &theirs)?;
            comparison.seconds = seconds;
            if request.rounding_bound && evaluator == Evaluator::Gpu {
                comparison.bound(&program.rounding_bounds(Points::new(request.positions))?);
            }
            comparisons.push((evaluator, comparison));
        }
        found.push(comparisons);
    }
    Ok((found, reference))
}

/// Comparisons as figures by evaluator name, with each evaluator's limit.
pub fn figures(comparisons: Comparisons) -> IndexMap<&'static str, Figures> {
    comparisons
        .into_iter()
        .map(|(evaluator, comparison)| (evaluator.name(), comparison.figures(evaluator.limit())))
        .collect()
}
