//! One graph compared: with Cycles, in WGSL, with its bounds.

use crate::base::error::{Error, Result};
use crate::gpu::Gpu;
use crate::graph::Program;
use crate::graph::bounds::Bounds3;
use crate::graph::bounds_check::Survey;
use crate::graph::evaluate::Points;
use crate::measure::errors::values::equal;
use crate::measure::nodes::random_graphs::{Compile, Failure, Kind, Trial, Values, WGSL_LIMIT, link, node};
use crate::nodes::{Nudge, nudged};
use crate::scene::{Input, Node, Scene};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;
use std::ops::Range;

/// Builds of the C library that a spread is made from.
const SEEDS: u64 = 34;

/// The same where those do not reach the value of Cycles: with many calls, few of so many builds agree with it in all.
const MORE_SEEDS: u64 = 1024;

/// Magnitudes of ordinary values. Beyond them textures leave the range of whole numbers, and squares overflow.
const ORDINARY: Range<f32> = 1e-12..1e6;

/// Share of a graph's values that may be beyond [`WGSL_LIMIT`] without an explanation.
const UNEXPLAINED_SHARE: f64 = 1e-3;

/// Random boxes per graph, and samples in each.
const BOXES: usize = 24;
const SAMPLES: usize = 24;

/// f32 on the CPU against Cycles.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct CpuFigures {
    /// Components compared.
    pub values: usize,
    /// Those that are equal.
    pub equal: usize,
    /// The others that are among those that the C library may lead to.
    pub within_spread: usize,
    /// Those that are not.
    pub differing: usize,
    /// Outputs compared.
    pub outputs: usize,
    /// Those that the C library takes part in.
    pub outputs_of_library: usize,
}

/// WGSL against f32 on the CPU, where everything that a value is made from is an ordinary number. Differences are relative to
/// an output's magnitude: the 99th percentile of its values, at least 1.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct WgslFigures {
    /// Components compared.
    pub values: usize,
    /// Median difference.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
    /// 99.9th percentile.
    pub p999: f64,
    /// Values beyond the limit.
    pub beyond: usize,
    /// Those of them that are within their own rounding bound ([`Program::rounding_bounds`]).
    pub bounded: usize,
    /// The others that f32 does not determine: the CPU's own value moves as far where last bits do. They jump, or are very
    /// badly conditioned.
    pub undetermined: usize,
    /// The rest.
    pub unexplained: usize,
}

/// All differences of WGSL.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Differences {
    /// Of all values.
    pub all: Vec<f32>,
    /// Without those beyond the limit that have an explanation.
    pub determined: Vec<f32>,
}

/// Samples against bounds over boxes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BoundsFigures {
    /// Random boxes.
    pub boxes: usize,
    /// Samples of all of them.
    pub samples: usize,
    /// Samples outside of their box's bounds.
    pub violations: usize,
}

/// Where the components of every output stand among those of a point.
fn layout(program: &Program) -> Vec<Range<usize>> {
    let mut first = 0;
    program
        .outputs
        .iter()
        .map(|output| {
            let range = first..first + output.operands.len();
            first = range.end;
            range
        })
        .collect()
}

/// The values that a program takes under several nudges: for every component at every point the smallest, the largest, and
/// whether it was ever NaN.
struct Spread {
    ends: Vec<[f32; 2]>,
    nan: Vec<bool>,
}

impl Spread {
    /// Over evaluations that `evaluate` makes, one per seed.
    fn over(seeds: Range<u64>, evaluate: impl Fn(u64) -> Result<Vec<f32>> + Send + Sync) -> Result<Self> {
        let evaluations: Vec<Vec<f32>> = seeds.into_par_iter().map(evaluate).collect::<Result<_>>()?;
        let count = evaluations.first().map_or(0, Vec::len);
        let mut spread = Self { ends: vec![[f32::INFINITY, f32::NEG_INFINITY]; count], nan: vec![false; count] };
        for values in &evaluations {
            for ((value, ends), nan) in values.iter().zip(&mut spread.ends).zip(&mut spread.nan) {
                if value.is_nan() {
                    *nan = true;
                } else {
                    *ends = [ends[0].min(*value), ends[1].max(*value)];
                }
            }
        }
        Ok(spread)
    }

    /// Builds of the C library, constants that the compiler folds among what they compute.
    fn of_library(trial: &Trial, compile: &Compile, seeds: Range<u64>) -> Result<Self> {
        let known = nudged::calls();
        let shared = compile(&trial.scene, &trial.targets, Some(Nudge::Library(0)))?;
        let folds = nudged::calls() > known;
        Self::over(seeds, |seed| {
            let nudge = Nudge::Library(seed);
            if folds {
                compile(&trial.scene, &trial.targets, Some(nudge))?.evaluate_nudged(trial.points(), nudge)
            } else {
                shared.evaluate_nudged(trial.points(), nudge)
            }
        })
    }

    fn holds(&self, index: usize, value: f32) -> bool {
        let [low, high] = self.ends[index];
        if value.is_nan() { self.nan[index] } else { low <= value && value <= high }
    }

    /// How far a value moves; infinitely where it is NaN at times.
    fn width(&self, index: usize) -> f64 {
        let [low, high] = self.ends[index];
        match self.nan[index] {
            true => f64::INFINITY,
            // Two infinities have no difference.
            false if low == high => 0.0,
            false => f64::from(high) - f64::from(low),
        }
    }
}

/// A value that is not what it should be.
struct ValueIndex {
    target: usize,
    point: usize,
    /// Number of the component among those of the point.
    component: usize,
}

/// Compares f32 on the CPU with Cycles.
pub(super) fn with_cycles(
    trial: &Trial,
    compile: &Compile,
    program: &Program,
    theirs: &Values,
) -> Result<(CpuFigures, Option<Failure>)> {
    let count = trial.positions.len();
    let (layout, width) = (layout(program), program.output_components());
    if let Some((target, range)) =
        layout.iter().enumerate().find(|(target, range)| theirs.get(*target).map(Vec::len) != Some(range.len() * count))
    {
        return Err(Error::new(
            format!("target {}", trial.targets[target].name()),
            format!("{} values", theirs.get(target).map_or(0, Vec::len)),
            format!("{}: {} components of {count} points", range.len() * count, range.len()),
            "This is a defect of the program: an output has another type than Blender's.",
        ));
    }
    let reference = |place: &ValueIndex| {
        theirs[place.target][place.point * layout[place.target].len() + place.component - layout[place.target].start]
    };
    let ours = program.evaluate_single(trial.points())?;
    let mut figures = CpuFigures { outputs: layout.len(), values: ours.len(), ..CpuFigures::default() };
    figures.outputs_of_library = program.outputs_of_library(trial.points())?.into_iter().filter(|flag| *flag).count();
    let mut differing: Vec<ValueIndex> = Vec::new();
    for (target, range) in layout.iter().enumerate() {
        let places =
            (0..count).flat_map(|point| range.clone().map(move |component| ValueIndex { target, point, component }));
        differing.extend(places.filter(|place| !equal(ours[place.point * width + place.component], reference(place))));
    }
    figures.equal = figures.values - differing.len();
    let all = differing.len();
    let mut detail = String::new();
    for seeds in [0..SEEDS, SEEDS..MORE_SEEDS] {
        if differing.is_empty() {
            break;
        }
        let points: Vec<usize> =
            differing.iter().map(|place| place.point).collect::<BTreeSet<_>>().into_iter().collect();
        let spread = Spread::of_library(&trial.at(&points), compile, seeds)?;
        let index = |place: &ValueIndex| {
            points.binary_search(&place.point).expect("a differing point") * width + place.component
        };
        differing.retain(|place| !spread.holds(index(place), reference(place)));
        if let Some(place) = differing.first() {
            let [low, high] = spread.ends[index(place)];
            detail = if low == high {
                "nothing that the C library decides".into()
            } else {
                format!("{low} to {high} by library")
            };
        }
        // Where no build of the library moves anything, no further one will.
        if differing.iter().all(|place| spread.width(index(place)) == 0.0) {
            break;
        }
    }
    figures.differing = differing.len();
    figures.within_spread = all - differing.len();
    let failure = differing.first().map(|place| Failure {
        kind: Kind::Cpu,
        target: Some(place.target),
        point: Some(place.point),
        detail: format!(
            "{} at point {}: ours {}, Cycles {} ({detail}); {} of {} values",
            trial.targets[place.target].name(),
            place.point,
            ours[place.point * width + place.component],
            reference(place),
            figures.differing,
            figures.values
        ),
    });
    Ok((figures, failure))
}

/// What comparing with WGSL gives.
pub(super) enum Wgsl {
    Compared(WgslFigures, Differences, Option<Failure>),
    /// The graph has no shader, and why.
    Impossible(String),
    Refused(Failure),
}

/// Whether WGSL promises something for a number, and whether textures and squares can do with it.
fn is_ordinary(value: f32) -> bool {
    value == 0.0 || ORDINARY.contains(&value.abs())
}

/// Compares WGSL with f32 on the CPU.
pub(super) fn with_wgsl(trial: &Trial, program: &Program, gpu: &Gpu) -> Wgsl {
    let refused = |cause: Error| Wgsl::Refused(Failure::of(Kind::Shader, &cause));
    let kernel = match gpu.field(program) {
        Ok(kernel) => kernel,
        Err(cause) if cause.found.starts_with("the constant") => return Wgsl::Impossible(cause.found),
        Err(cause) => return refused(cause),
    };
    match kernel.evaluate(trial.points()).and_then(|shader| differences(trial, program, &shader)) {
        Ok((figures, differences, failure)) => Wgsl::Compared(figures, differences, failure),
        Err(cause) => refused(cause),
    }
}

fn differences(
    trial: &Trial,
    program: &Program,
    shader: &[f32],
) -> Result<(WgslFigures, Differences, Option<Failure>)> {
    let count = trial.positions.len();
    let (layout, width) = (layout(program), program.output_components());
    let cpu = program.evaluate_single(trial.points())?;
    let ordinary = program.ordinary(trial.points(), is_ordinary)?;
    let mut differences = Differences::default();
    let mut figures = WgslFigures::default();
    let mut beyond: Vec<(ValueIndex, f64)> = Vec::new();
    let mut scales = Vec::new();
    for (target, range) in layout.iter().enumerate() {
        let places: Vec<ValueIndex> = (0..count)
            .filter(|point| ordinary[point * layout.len() + target])
            .flat_map(|point| range.clone().map(move |component| ValueIndex { target, point, component }))
            .collect();
        let mut magnitudes: Vec<f64> =
            places.iter().map(|place| f64::from(cpu[place.point * width + place.component].abs())).collect();
        magnitudes.sort_by(f64::total_cmp);
        let scale = percentile(&magnitudes, 0.99).max(1.0);
        scales.push(scale);
        for place in places {
            let index = place.point * width + place.component;
            let difference = (f64::from(shader[index]) - f64::from(cpu[index])).abs() / scale;
            let difference = if difference.is_nan() { f64::INFINITY } else { difference };
            figures.values += 1;
            differences.all.push(difference as f32);
            if difference > WGSL_LIMIT {
                beyond.push((place, difference));
            } else {
                differences.determined.push(difference as f32);
            }
        }
    }
    figures.beyond = beyond.len();
    let points: Vec<usize> = beyond.iter().map(|(place, _)| place.point).collect::<BTreeSet<_>>().into_iter().collect();
    let part = trial.at(&points);
    let (bounds, spread) = explanations(program, part.points())?;
    let mut failure = None;
    for (place, difference) in beyond {
        let index = points.binary_search(&place.point).expect("a point beyond the limit") * width + place.component;
        let scale = scales[place.target];
        if bounds[index].is_finite() && difference * scale <= bounds[index] {
            figures.bounded += 1;
        } else if spread.width(index) > WGSL_LIMIT * scale {
            figures.undetermined += 1;
        } else {
            figures.unexplained += 1;
            differences.determined.push(difference as f32);
            failure.get_or_insert_with(|| Failure {
                kind: Kind::Wgsl,
                target: Some(place.target),
                point: Some(place.point),
                detail: format!(
                    "{} at point {}: WGSL {}, CPU {}, {difference:.1e} of {scale:.2e}",
                    trial.targets[place.target].name(),
                    place.point,
                    shader[place.point * width + place.component],
                    cpu[place.point * width + place.component],
                ),
            });
        }
    }
    if figures.unexplained as f64 <= UNEXPLAINED_SHARE * figures.values as f64 {
        failure = None;
    }
    if let Some(failure) = &mut failure {
        failure.detail += &format!("; {} of {} values", figures.unexplained, figures.values);
    }
    let mut sorted: Vec<f64> = differences.all.iter().copied().map(f64::from).collect();
    sorted.sort_by(f64::total_cmp);
    [figures.p50, figures.p99, figures.p999] = [0.5, 0.99, 0.999].map(|share| percentile(&sorted, share));
    Ok((figures, differences, failure))
}

/// Rounding bounds, and what moving the last bit of everything does.
fn explanations(program: &Program, points: Points<'_>) -> Result<(Vec<f64>, Spread)> {
    if points.positions.is_empty() {
        return Ok((Vec::new(), Spread { ends: Vec::new(), nan: Vec::new() }));
    }
    let spread = Spread::over(0..SEEDS, |seed| program.evaluate_nudged(points, Nudge::Everything(seed)))?;
    Ok((program.rounding_bounds(points)?, spread))
}

/// The value that this share of sorted values does not exceed (nearest rank); 0 of none.
pub(super) fn percentile(sorted: &[f64], share: f64) -> f64 {
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

/// Looks for values outside of the bounds of random boxes.
pub(super) fn with_bounds(trial: &Trial, compile: &Compile, seed: u64) -> Result<(BoundsFigures, Option<Failure>)> {
    let program = compile(&of_positions(&trial.scene), &trial.targets, None)?;
    let survey = Survey {
        layer: Bounds3::new([-3.0; 3], [3.0; 3]),
        boxes: BOXES,
        samples: SAMPLES,
        grid: 0,
        cells: 0,
        refine: 0,
        seed,
    };
    let report = survey.run(&program)?;
    let figures = BoundsFigures { boxes: BOXES, samples: BOXES * SAMPLES, violations: report.violations };
    let failure = (report.violations > 0).then(|| Failure {
        kind: Kind::Bounds,
        target: None,
        point: None,
        detail: format!("{} values outside; {}", report.violations, report.examples.join("; ")),
    });
    Ok((figures, failure))
}

/// The scene with functions of the position in the place of its attributes, of which nothing is known over a box.
fn of_positions(scene: &Scene) -> Scene {
    const COORDINATE: &str = "Position of bounds";
    let mut scene = scene.clone();
    let graph = scene.graph_mut();
    let replace = |nodes: &mut Vec<Node>| {
        for attribute in nodes.iter_mut().filter(|node| node.kind == "ShaderNodeAttribute") {
            let name = attribute.properties.get("attribute_name").and_then(|name| name.as_str()).unwrap_or_default();
            // Another function for every name.
            let number = name.bytes().fold(0_u8, |sum, byte| sum.wrapping_mul(31).wrapping_add(byte));
            let factor = 0.5 + f32::from(number % 16) / 8.0;
            let mut mapped = node(&attribute.name, "ShaderNodeVectorMath");
            mapped.properties.insert("operation".into(), "MULTIPLY_ADD".into());
            mapped.inputs.insert("Vector".into(), link(COORDINATE, "Object"));
            mapped.inputs.insert("Vector_001".into(), Input::List(vec![factor, -factor, factor + 0.25]));
            mapped.inputs.insert("Vector_002".into(), Input::List(vec![factor - 1.0, 0.5, -0.25]));
            *attribute = mapped;
        }
        nodes.push(node(COORDINATE, "ShaderNodeTexCoord"));
    };
    replace(&mut graph.nodes);
    graph.groups.iter_mut().for_each(|group| replace(&mut group.nodes));
    scene
}
