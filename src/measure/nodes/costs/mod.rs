//! What a point of every node in every mode costs: f32 and f64 on one thread of the CPU, WGSL on the adapter, and Cycles on one
//! thread, in one run.
//!
//! Textures read their coordinate and keep Blender's defaults for the rest; all inputs of other nodes are linked. On the CPU the
//! node's own kernel is timed on columns in the cache, for `COPIES` nodes that read different attributes. On the adapter the same
//! graph is evaluated, and a graph that passes the attributes on to as many outputs of the same kinds is taken off. What Cycles
//! renders: `costs/renders.rs`. Both sides go through the same points again and again, so that a processor has learnt the
//! decisions that it can learn; among points that it has not seen, functions of the C library cost up to twice as much, wherever
//! they are called. Ours on the CPU is the least processor time of several repetitions, Cycles' the least time by the
//! clock, since its waiting threads take processor time, too: what else a machine does only adds to both. Costs are those of one
//! machine, ratios those of one run.

mod renders;

use crate::base::error::{Error, Result};
use crate::base::files;
use crate::base::identity::{Identity, Resume};
use crate::base::ledger::{Found, Purpose};
use crate::base::progress::Progress;
use crate::bridge::{CyclesKernel, probe};
use crate::gpu::{FieldKernel, Gpu};
use crate::graph::evaluate::{Evaluation, Points};
use crate::graph::{Operand, Program, Target};
use crate::measure::experiment;
use crate::measure::experiment::{Desk, Done, Experiment};
use crate::measure::nodes::suite::{attribute_nodes, modes};
use crate::measure::timing::machine;
use crate::nodes::{self, Column, Mode, NodeType, Oracle, Role};
use crate::scene::bare_scene;
use cpu_time::ThreadTime;
use renders::{Render, Renders};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value as Json, json};
use std::path::Path;
use std::time::Instant;

/// Format of the file of costs.
pub const COSTS_FORMAT: &str = "cloudparity-node-costs/1";

/// Nodes of one graph of ours.
const COPIES: usize = 4;

/// Points of a column, as evaluation has them.
const BLOCK: usize = 512;

/// Columns that are gone through again and again; one where Cycles sees a point [`OFTEN`] times in a row.
const BLOCKS: usize = 16;

/// Evaluations in a row after which a processor knows a point's decisions.
const OFTEN: usize = 16;

/// Seconds of one measurement on the CPU, at least and at most.
const SECONDS: [f64; 2] = [0.015, 0.2];

/// Seconds of ours that one evaluation stands for, at most: a graph that costs more gets fewer points.
const EVALUATION_SECONDS: f64 = 2.0;

/// Points of an evaluation, at least.
const FEWEST: usize = 4096;

/// Times that Blender goes through the renders, at most; every time repeats each render.
const ROUNDS: usize = 2;

/// Modes that one Blender process measures.
const TOGETHER: usize = 16;

/// What to measure.
pub struct Settings {
    /// Points of a render at most.
    pub points: usize,
    /// Repetitions; the least time counts.
    pub repeats: usize,
    /// Only the node of this label.
    pub node: Option<String>,
    /// Only modes whose words hold this text.
    pub mode: Option<String>,
    /// Ask Cycles, too.
    pub with_cycles: bool,
    /// Whose rows are gone on with.
    pub resume: Resume,
}

/// `node-costs.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Costs {
    /// [`COSTS_FORMAT`].
    pub format: String,
    /// The builds that measured the rows.
    pub builds: Vec<Identity>,
    /// Processor and adapter in words.
    pub machine: String,
    /// What Cycles' times are.
    #[serde(default)]
    pub cycles: String,
    /// Points of a render at most.
    #[serde(default)]
    pub points: usize,
    /// Repetitions.
    #[serde(default)]
    pub repeats: usize,
    /// One per node and mode.
    pub rows: Vec<NodeCost>,
}

/// Nanoseconds per point of one node in one mode.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeCost {
    /// Blender's label of the node.
    pub node: String,
    /// The mode in words.
    pub mode: String,
    /// f32 on one thread.
    pub cloudparity_ns: f64,
    /// f64 on one thread.
    pub oracle_ns: f64,
    /// WGSL on the adapter, transfers of the values alone taken off; none without an adapter.
    pub wgsl_ns: Option<f64>,
    /// Cycles on one thread; the implicit conversion of an output is part of it.
    pub cycles_ns: Option<f64>,
    /// How far the least two of Cycles' repetitions are apart, with and without the node together.
    pub cycles_spread_ns: Option<f64>,
    /// Cycles' over ours in f32; none where one of them costs nothing.
    pub ratio: Option<f64>,
}

/// One node in one mode.
struct Case {
    node: &'static str,
    mode: String,
    attributes: Vec<(String, Vec<[f32; 3]>)>,
    program: Program,
    /// The attributes passed on to as many outputs of the same kinds.
    idle_program: Program,
    renders: Renders,
}

/// Times of one case, one per repetition.
#[derive(Default)]
struct Times {
    single: Vec<f64>,
    oracle: Vec<f64>,
    wgsl: Vec<f64>,
    /// The cost and its spread.
    cycles: Option<[f64; 2]>,
}

/// The costs of nodes while they are measured.
struct Running<'a> {
    settings: &'a Settings,
    gpu: Option<&'a Gpu>,
    path: Option<&'a Path>,
    /// What is known: rows of an earlier run, then those of this one.
    costs: Costs,
    /// Modes that one Blender process measures.
    parts: Vec<Vec<(&'static NodeType, Map<String, Json>)>>,
}

/// Measures every mode; with `path`, rows are written there as they come, and what stands there already is not measured again. The file
/// is the record of what is done: it is what is committed, and what a run for a single node adds to.
pub fn run(settings: &Settings, gpu: Option<&Gpu>, path: Option<&Path>, progress: Progress<'_>) -> Result<Costs> {
    let costs = begin(settings, gpu, path)?;
    let mut wanted = Vec::new();
    for (node_type, properties) in wanted_modes(settings)? {
        let mode = Mode::read(node_type, &properties, node_type.label)?.words().join(" ");
        let is_measured = |row: &NodeCost| {
            row.node == node_type.label
                && row.mode == mode
                && (row.cycles_ns.is_some() || !settings.with_cycles)
                && (row.wgsl_ns.is_some() || gpu.is_none())
        };
        if !costs.rows.iter().any(is_measured) {
            wanted.push((node_type, properties));
        }
    }
    let parts = wanted.chunks(TOGETHER).map(<[_]>::to_vec).collect();
    let mut running = Running { settings, gpu, path, costs, parts };
    experiment::run(&mut running, None, &experiment::Settings::of(settings.resume.clone()), progress)?.all()
}

impl Experiment for Running<'_> {
    /// The position of a part.
    type Job = usize;
    type Record = Vec<NodeCost>;
    type Summary = Costs;

    fn purpose(&self) -> Purpose {
        Purpose { mark: "experiment.json", format: COSTS_FORMAT, of: Json::Null }
    }

    fn plan(&self) -> Result<Vec<usize>> {
        Ok((0..self.parts.len()).collect())
    }

    fn inputs(&self, job: &usize) -> Result<Json> {
        let modes: Vec<Json> =
            self.parts[*job].iter().map(|(node, properties)| json!([node.label, properties])).collect();
        Ok(json!({"modes": modes, "points": self.settings.points, "repeats": self.settings.repeats}))
    }

    fn label(&self, job: &usize) -> String {
        self.parts[*job].first().map_or_else(String::new, |(node, _)| node.label.to_owned())
    }

    fn run(&mut self, job: &usize, _desk: &Desk<'_>) -> Result<Found<Vec<NodeCost>>> {
        let cases = self.parts[*job]
            .iter()
            .map(|(node_type, properties)| Case::new(node_type, properties, self.settings.points))
            .collect::<Result<Vec<_>>>()?;
        let times = measure(&cases, self.settings, self.gpu)?;
        Ok(Found::Record(cases.iter().zip(&times).map(|(case, times)| case.row(times)).collect()))
    }

    fn heard(&mut self, _job: &usize, record: &Vec<NodeCost>, _desk: &Desk<'_>) -> Result<()> {
        for row in record {
            let known = self.costs.rows.iter_mut().find(|known| known.node == row.node && known.mode == row.mode);
            match known {
                Some(known) => known.clone_from(row),
                None => self.costs.rows.push(row.clone()),
            }
        }
        match self.path {
            Some(path) => write(&self.costs, path),
            None => Ok(()),
        }
    }

    fn summary(&mut self, _found: Vec<Done<Self>>, _desk: &Desk<'_>) -> Result<Costs> {
        Ok(self.costs.clone())
    }
}

/// The document of an earlier run with these settings, or an empty one.
fn begin(settings: &Settings, gpu: Option<&Gpu>, path: Option<&Path>) -> Result<Costs> {
    let adapter =
        gpu.map_or("no adapter".to_owned(), |gpu| format!("adapter {} ({})", gpu.adapter().name, gpu.adapter().driver));
    let new = Costs {
        format: COSTS_FORMAT.to_owned(),
        builds: vec![settings.resume.build.clone()],
        machine: format!("{}; {adapter}", machine()),
        cycles: "the kernel that it chooses by itself, one thread".to_owned(),
        points: settings.points,
        repeats: settings.repeats,
        rows: Vec::new(),
    };
    let Some(path) = path.filter(|path| path.exists()) else { return Ok(new) };
    let text = files::read_text(path, "costs of nodes")?;
    let refused = |found: String, expected: String| {
        Error::new(
            path.display().to_string(),
            found,
            expected,
            "Name another file, or remove this one to measure everything again.",
        )
        .with_setting("output")
    };
    let known: Costs = serde_json::from_str(&text)
        .map_err(|cause| refused(cause.to_string(), "a document of cloudparity bench-nodes".to_owned()))?;
    // A file of a machine without a name holds no measurements yet.
    if known.rows.is_empty() {
        return Ok(new);
    }
    let conditions = |costs: &Costs| format!("{}, {} points, {} repeats", costs.machine, costs.points, costs.repeats);
    if conditions(&known) != conditions(&new) || known.format != new.format {
        return Err(refused(
            format!("costs measured under other conditions: {}", conditions(&known)),
            format!("those of this run: {}", conditions(&new)),
        ));
    }
    let builds = settings.resume.join(&path.display().to_string(), &known.builds)?;
    Ok(Costs { builds, ..known })
}

fn write(costs: &Costs, path: &Path) -> Result<()> {
    let text = serde_json::to_string_pretty(costs).expect("figures serialise") + "\n";
    files::write_atomically(path, text.as_bytes())
}

/// Every mode of every node that evaluates.
fn wanted_modes(settings: &Settings) -> Result<Vec<(&'static NodeType, Map<String, Json>)>> {
    let is_measured =
        |node: &&NodeType| matches!(node.role, Role::Evaluated(_)) && node.type_name.starts_with("ShaderNode");
    let all: Vec<&'static NodeType> = nodes::registry().iter().copied().filter(is_measured).collect();
    let wanted = settings.node.as_deref();
    let mut chosen = Vec::new();
    for node in all.iter().filter(|node| wanted.is_none_or(|label| label == node.label)) {
        for properties in modes(node) {
            let words = Mode::read(node, &properties, node.label)?.words().join(" ");
            if settings.mode.as_ref().is_none_or(|text| words.contains(text.as_str())) {
                chosen.push((*node, properties));
            }
        }
    }
    if chosen.is_empty() && all.iter().any(|node| wanted.is_none_or(|label| label == node.label)) {
        return Err(Error::new(
            "mode",
            format!("\"{}\"", settings.mode.as_deref().unwrap_or_default()),
            "a part of a mode's words, as the table shows them",
            "Leave it out to see all modes.",
        )
        .with_setting("mode"));
    }
    if chosen.is_empty() {
        let labels: Vec<&str> = all.iter().map(|node| node.label).collect();
        return Err(Error::new(
            "node",
            format!("\"{}\"", wanted.unwrap_or_default()),
            format!("one of: {}", labels.join(", ")),
            "Write Blender's label of the node.",
        )
        .with_setting("node"));
    }
    Ok(chosen)
}

impl Case {
    fn new(node_type: &'static NodeType, properties: &Map<String, Json>, most: usize) -> Result<Self> {
        let mode = Mode::read(node_type, properties, node_type.label)?;
        let is_texture = renders::is_texture(node_type);
        let mut graph: Vec<Json> = (0..COPIES).flat_map(attribute_nodes).collect();
        let mut targets = Vec::new();
        let mut idle_targets = Vec::new();
        for copy in 0..COPIES {
            let mut inputs = Map::new();
            for (number, socket) in node_type.inputs_of(&mode).enumerate() {
                // Other attributes in every copy.
                let source = (copy + number) % COPIES;
                let linked = match socket.kind.components() {
                    3 => json!({"node": format!("Attribute {source}"), "socket": "Vector"}),
                    _ => json!({"node": format!("Separate {source}"), "socket": "X"}),
                };
                if !is_texture || matches!(socket.identifier, "Vector" | "W") {
                    inputs.insert(socket.identifier.to_owned(), linked);
                }
            }
            let name = format!("Copy {copy}");
            graph.push(json!({"name": name, "type": node_type.type_name, "properties": properties, "inputs": inputs}));
            for output in node_type.outputs_of(&mode) {
                targets.push(Target::output(&name, output.identifier));
                idle_targets.push(match output.kind.components() {
                    3 => Target::output(&format!("Attribute {copy}"), "Vector"),
                    _ => Target::output(&format!("Separate {copy}"), "X"),
                });
            }
        }
        let scene = bare_scene("costs", json!({"material": "Material", "nodes": graph, "groups": []}))?;
        let program = Program::compile(&scene, &targets)?;
        let idle_program = Program::compile(&scene, &idle_targets)?;
        let renders = Renders::new(node_type, properties, f64::INFINITY, most)?;
        let colours = renders.with.colours;
        let mut case = Self {
            node: node_type.label,
            mode: mode.words().join(" "),
            attributes: renders::attributes(colours, BLOCK * BLOCKS),
            program,
            idle_program,
            renders,
        };
        // A first measurement says how many points an evaluation may have, and how many copies a render needs.
        let nanoseconds = case.on_cpu::<f32>(FEWEST);
        let affordable = EVALUATION_SECONDS * 1e9 / (nanoseconds.max(1e-3) * COPIES as f64);
        let points = most.min(affordable as usize).max(FEWEST.min(most));
        case.attributes = renders::attributes(colours, points);
        case.renders = Renders::new(node_type, properties, nanoseconds, points)?;
        Ok(case)
    }

    fn points(&self) -> usize {
        self.attributes[0].1.len()
    }

    /// Nanoseconds per point and node of the kernels, on this thread.
    fn on_cpu<R: Evaluation>(&self, points: usize) -> f64 {
        if self.program.instructions.is_empty() {
            // Naming columns is all there is to do.
            return 0.0;
        }
        let attributes: Vec<&Vec<[f32; 3]>> = self
            .program
            .attributes
            .iter()
            .filter_map(|name| self.attributes.iter().find(|(known, _)| known == name))
            .map(|(_, values)| values)
            .collect();
        let column = |block: usize, attribute: usize, axis: usize| -> Vec<R> {
            let values = attributes[attribute];
            (0..BLOCK).map(|index| R::of(values[(block * BLOCK + index) % values.len()][axis])).collect()
        };
        let count = if self.renders.with.samples >= OFTEN { 1 } else { BLOCKS };
        let blocks: Vec<Vec<Vec<R>>> = (0..count)
            .map(|block| (0..3 * attributes.len()).map(|index| column(block, index / 3, index % 3)).collect())
            .collect();
        let constants: Vec<Vec<Vec<R>>> = self
            .program
            .instructions
            .iter()
            .map(|instruction| {
                let constant = |operand: &Operand| match operand {
                    Operand::Constant(value) => vec![R::of(*value); BLOCK],
                    _ => Vec::new(),
                };
                instruction.inputs.iter().map(constant).collect()
            })
            .collect();
        let mut registers: Vec<Vec<R>> = vec![vec![R::default(); BLOCK]; self.program.registers];
        let mut go_through = |rounds: usize| {
            let start = ThreadTime::now();
            for round in 0..rounds {
                self.evaluate(&blocks[round % count], &constants, &mut registers);
            }
            std::hint::black_box(&registers);
            start.elapsed().as_secs_f64()
        };
        // The first round fills the caches, the second says what one costs, and the next let branches be learnt.
        go_through(1);
        let one = go_through(1).max(1e-9);
        let [least, most] = SECONDS.map(|seconds| (seconds / one) as usize);
        go_through(least);
        let rounds = points.div_ceil(BLOCK).max(least).min(most).max(1);
        go_through(rounds) * 1e9 / (rounds * BLOCK * COPIES) as f64
    }

    fn evaluate<R: Evaluation>(&self, block: &[Vec<R>], constants: &[Vec<Vec<R>>], registers: &mut [Vec<R>]) {
        for (instruction, constants) in self.program.instructions.iter().zip(constants) {
            let (before, after) = registers.split_at_mut(instruction.first_register);
            let inputs: Vec<Column<'_, R>> = instruction
                .inputs
                .iter()
                .zip(constants)
                .map(|(operand, constant)| match operand {
                    Operand::Constant(_) => Column { values: constant.as_slice(), uniform: true },
                    Operand::Attribute(number, axis) => {
                        Column { values: block[3 * number + axis].as_slice(), uniform: false }
                    }
                    Operand::Register(register) => Column { values: before[*register].as_slice(), uniform: false },
                    // Nothing here reads the position: any column does.
                    Operand::Position(axis) => Column { values: block[*axis].as_slice(), uniform: false },
                })
                .collect();
            let mut outputs: Vec<&mut [R]> =
                after[..instruction.components()].iter_mut().map(Vec::as_mut_slice).collect();
            R::run(instruction.evaluator.as_ref(), &inputs, &mut outputs);
        }
    }

    /// Seconds of one evaluation of everything on the adapter.
    fn on_adapter(&self, kernel: &FieldKernel<'_>) -> Result<f64> {
        let positions = vec![[0.0; 3]; self.points()];
        let start = Instant::now();
        kernel.evaluate(Points { positions: &positions, attributes: &self.attributes })?;
        Ok(start.elapsed().as_secs_f64())
    }

    fn row(&self, times: &Times) -> NodeCost {
        let cloudparity = least_two(&times.single)[0];
        let cycles = times.cycles.map(|[cost, _]| cost);
        let ratio = cycles.filter(|cycles| *cycles > 0.0 && cloudparity > 0.0).map(|cycles| cycles / cloudparity);
        NodeCost {
            node: self.node.to_owned(),
            mode: self.mode.clone(),
            cloudparity_ns: rounded(cloudparity),
            oracle_ns: rounded(least_two(&times.oracle)[0]),
            wgsl_ns: median(&times.wgsl).map(rounded),
            cycles_ns: cycles.map(rounded),
            cycles_spread_ns: times.cycles.map(|[_, spread]| rounded(spread)),
            ratio: ratio.map(rounded),
        }
    }
}

/// The least two.
fn least_two(values: &[f64]) -> [f64; 2] {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let least = sorted.first().copied().unwrap_or(f64::NAN);
    [least, sorted.get(1).copied().unwrap_or(least)]
}

/// Four digits: more are noise.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// The middle one; none of none.
fn median(values: &[f64]) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied()
}

/// Measures cases, ours and Cycles' in turn.
fn measure(cases: &[Case], settings: &Settings, gpu: Option<&Gpu>) -> Result<Vec<Times>> {
    let kernels = cases
        .iter()
        .map(|case| gpu.map(|gpu| Ok((gpu.field(&case.program)?, gpu.field(&case.idle_program)?))).transpose())
        .collect::<Result<Vec<_>>>()?;
    let mut times: Vec<Times> = cases.iter().map(|_| Times::default()).collect();
    // The first evaluation of a kernel pays for its memory.
    for (case, kernels) in cases.iter().zip(&kernels) {
        if let Some((kernel, idle)) = kernels {
            case.on_adapter(kernel)?;
            case.on_adapter(idle)?;
        }
    }
    for _ in 0..settings.repeats {
        for ((case, kernels), times) in cases.iter().zip(&kernels).zip(&mut times) {
            times.single.push(case.on_cpu::<f32>(case.points()));
            times.oracle.push(case.on_cpu::<Oracle>(case.points()));
            if let Some((kernel, idle)) = kernels {
                let seconds = case.on_adapter(kernel)? - case.on_adapter(idle)?;
                times.wgsl.push(per_point(case, seconds));
            }
        }
    }
    if settings.with_cycles {
        for ((case, times), [with, without]) in
            cases.iter().zip(&mut times).zip(render_seconds(cases, settings.repeats)?)
        {
            let evaluations = case.points() * case.renders.copies * case.renders.with.samples;
            let spread = (with[1] - with[0]) + (without[1] - without[0]);
            times.cycles = Some([with[0] - without[0], spread].map(|seconds| seconds * 1e9 / evaluations as f64));
        }
    }
    Ok(times)
}

/// The least two times that Cycles takes for each case with its node and without it. Cases that are the same without their node
/// share those renders.
fn render_seconds(cases: &[Case], repeats: usize) -> Result<Vec<[[f64; 2]; 2]>> {
    let mut wanted: Vec<(&Render, &Case)> = Vec::new();
    let mut numbers = Vec::new();
    for case in cases {
        numbers.push([&case.renders.with, &case.renders.without].map(|render| {
            let is_known = |(known, owner): &(&Render, &Case)| *known == render && owner.points() == case.points();
            wanted.iter().position(is_known).unwrap_or_else(|| {
                wanted.push((render, case));
                wanted.len() - 1
            })
        }));
    }
    let most = cases.iter().map(Case::points).max().unwrap_or(0);
    let positions = vec![[0.0; 3]; most];
    // In rounds, so that a slow while of the machine does not meet all repetitions of one render.
    let rounds = repeats.min(ROUNDS);
    let jobs: Vec<probe::Job<'_>> = (0..rounds)
        .flat_map(|_| &wanted)
        .map(|(render, case)| probe::Job {
            scene: &render.scene,
            positions: &positions[..case.points()],
            attributes: &case.attributes,
            targets: render.targets.clone(),
            repeat: repeats.div_ceil(rounds),
            samples: render.samples,
        })
        .collect();
    let answers = probe::ask_on(&jobs, CyclesKernel::Default, 1, &mut |_| ())?;
    let least = |number: usize| {
        let answers = answers.jobs.iter().skip(number).step_by(wanted.len());
        let seconds: Vec<f64> = answers.flat_map(|answer| answer.render_seconds.iter()).copied().collect();
        least_two(&seconds)
    };
    Ok(numbers.into_iter().map(|numbers| numbers.map(least)).collect())
}

/// Seconds of a whole graph of ours as nanoseconds per point and node.
fn per_point(case: &Case, seconds: f64) -> f64 {
    seconds * 1e9 / (case.points() * COPIES) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(label: &str, properties: Json) -> Case {
        let node_type = nodes::registry().iter().copied().find(|node| node.label == label).expect("a node");
        let properties = properties.as_object().cloned().unwrap_or_default();
        Case::new(node_type, &properties, 8192).expect("a case")
    }

    #[test]
    fn copies_are_evaluated_each() {
        let found = case("Math", json!({"operation": "MULTIPLY_ADD"}));
        assert_eq!(found.program.instructions.len(), COPIES);
        assert_eq!((found.program.outputs.len(), found.idle_program.outputs.len()), (COPIES, COPIES));
        assert!(found.idle_program.instructions.is_empty());
        let sine = case("Math", json!({"operation": "SINE"})).on_cpu::<f32>(1 << 16);
        let texture = case("Noise Texture", json!({})).on_cpu::<f32>(1 << 16);
        assert!(sine > 0.0 && texture > sine, "{sine} {texture}");
    }

    #[test]
    fn rows_are_kept_and_other_conditions_are_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("costs.json");
        let settings = |points| Settings {
            points,
            repeats: 1,
            node: Some("Clamp".to_owned()),
            mode: None,
            with_cycles: false,
            resume: Resume::default(),
        };
        let first = run(&settings(4096), None, Some(&path), &|_, _| ()).expect("costs");
        assert_eq!(first.rows.len(), 2);
        assert!(first.rows.iter().all(|row| row.cycles_ns.is_none() && row.ratio.is_none()));
        // Measured times differ: equal rows were read.
        let again = run(&settings(4096), None, Some(&path), &|_, _| ()).expect("costs");
        assert_eq!(again, first);
        let error = run(&settings(5000), None, Some(&path), &|_, _| ()).expect_err("other conditions");
        assert!(error.to_string().contains("other conditions"), "{error}");
        // Rows of another build are neither taken for ours nor measured again.
        let by = |mix_builds| Settings {
            resume: Resume { build: Identity::of("0.1.0", "bb"), mix_builds },
            ..settings(4096)
        };
        let error = run(&by(false), None, Some(&path), &|_, _| ()).expect_err("another build").to_string();
        assert!(error.contains("0.1.0+bb") && error.contains(&Identity::current().to_string()), "{error}");
        let mixed = run(&by(true), None, Some(&path), &|_, _| ()).expect("knowingly");
        assert_eq!((&mixed.rows, mixed.builds.len()), (&first.rows, 2));
    }
}
