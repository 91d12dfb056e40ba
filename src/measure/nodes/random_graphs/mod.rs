//! Random graphs of many nodes against Cycles: every node in any mode, conversions, groups, muted nodes, reroutes, folding and
//! simplification together.
//!
//! [`generate`] makes a graph from a seed; [`run`] compares graphs, and [`shrink::shrink`] makes a failing one small. What is
//! compared:
//!
//! * f32 on the CPU with Cycles' SSE4.2 kernel: equal bits. Where the C library takes part, two builds of it may differ; the
//!   value of Cycles must then lie among those that ours takes when results of the library move by a unit in the last place
//!   ([`Nudge::Library`]), through all that comes after. Nothing is added to that.
//! * WGSL with the CPU, where all that a value is made from is an ordinary number: 99.9 % of the differences of all graphs must be
//!   below [`WGSL_LIMIT`]. Values that f32 does not determine to that (they move as much when rounding does) are counted.
//! * Bounds over random boxes with samples in them.

mod compare;
mod generate;
pub mod shrink;

pub use compare::{BoundsFigures, CpuFigures, Differences, WgslFigures};
pub use generate::generate;

use crate::base::choice::choice;
use crate::base::error::{Error, Result};
use crate::base::files;
use crate::bridge::{CyclesKernel, Message, probe};
use crate::gpu::Gpu;
use crate::graph::evaluate::Points;
use crate::graph::{Program, Target};
use crate::measure::nodes::folded_textures;
use crate::nodes::Nudge;
use crate::scene::{Input, Node, Scene};
use serde::Serialize;
use serde_json::{Map, Value as Json, json};
use std::path::{Path, PathBuf};

/// Largest difference between WGSL and the CPU, relative to an output's magnitude, that 99.9 % of the values may have.
pub const WGSL_LIMIT: f64 = 5e-5;

/// A graph, what is compared of it, and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// The graph in a scene.
    pub scene: Scene,
    /// What is compared: every output of every node of the material's tree, in the order of their making, so that the first
    /// difference is where it is born.
    pub targets: Vec<Target>,
    /// Object-space positions.
    pub positions: Vec<[f32; 3]>,
    /// Values of the attributes.
    pub attributes: Vec<(String, Vec<[f32; 3]>)>,
}

impl Trial {
    /// The points as evaluators want them.
    pub fn points(&self) -> Points<'_> {
        Points { positions: &self.positions, attributes: &self.attributes }
    }

    /// The same at these points alone.
    pub fn at(&self, indices: &[usize]) -> Self {
        let at = |values: &[[f32; 3]]| indices.iter().map(|&index| values[index]).collect();
        Self {
            scene: self.scene.clone(),
            targets: self.targets.clone(),
            positions: at(&self.positions),
            attributes: self.attributes.iter().map(|(name, values)| (name.clone(), at(values))).collect(),
        }
    }
}

/// A random graph.
pub struct RandomGraph {
    /// What it was made from.
    pub seed: u64,
    /// The graph with its points; those of even numbers hold ordinary values only.
    pub trial: Trial,
}

choice! {
    "lowercase",
    /// What can go wrong.
    #[derive(Hash)]
    pub enum Kind {
        /// Ours does not compile the graph.
        Compiler,
        /// Blender does not build the graph.
        Blender,
        /// f32 on the CPU is not what Cycles computes.
        Cpu,
        /// The shader does not compose, or the adapter refuses it.
        Shader,
        /// WGSL is not what the CPU computes.
        Wgsl,
        /// A value lies outside of its bounds.
        Bounds,
    }
}

impl Kind {
    /// In words.
    pub fn name(self) -> &'static str {
        match self {
            Self::Compiler => "does not compile",
            Self::Blender => "Blender refuses it",
            Self::Cpu => "CPU against Cycles",
            Self::Shader => "no shader",
            Self::Wgsl => "WGSL against CPU",
            Self::Bounds => "bounds",
        }
    }
}

/// One failure of a graph.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Failure {
    /// What went wrong.
    pub kind: Kind,
    /// Number of the target, where one output is to blame.
    #[serde(skip)]
    pub target: Option<usize>,
    /// Number of the point, where one is to blame.
    #[serde(skip)]
    pub point: Option<usize>,
    /// In words: where, ours, theirs.
    pub detail: String,
}

/// What was found for one graph.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GraphComparison {
    /// Seed of the graph.
    pub seed: u64,
    /// Nodes of the graph, those of groups once.
    pub nodes: usize,
    /// Nodes that are evaluated after all passes.
    pub instructions: usize,
    /// Against Cycles.
    pub cpu: Option<CpuFigures>,
    /// Against the CPU; none without an adapter or without a shader.
    pub wgsl: Option<WgslFigures>,
    /// Why there is no shader: WGSL has no infinite constants.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub no_wgsl: Option<String>,
    /// Samples against bounds.
    pub bounds: Option<BoundsFigures>,
    /// What went wrong, one of each kind.
    pub failures: Vec<Failure>,
    /// What is left of the graph for each failure, and where it was saved.
    pub saved: Vec<Saved>,
    /// All differences of WGSL.
    #[serde(skip)]
    pub differences: Differences,
}

/// A failing graph made small.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Saved {
    /// How it fails.
    pub failure: Failure,
    /// Nodes that are left in the material's tree.
    pub nodes: usize,
    /// The scene file.
    pub path: PathBuf,
}

/// Compiles a graph, its folded constants under a nudge where there is one. Tests plant errors here.
pub type Compile = dyn Fn(&Scene, &[Target], Option<Nudge>) -> Result<Program> + Sync;

/// The compiler.
pub fn compile(scene: &Scene, targets: &[Target], nudge: Option<Nudge>) -> Result<Program> {
    match nudge {
        None => Program::compile(scene, targets),
        Some(nudge) => Program::compile_nudged(scene, targets, nudge),
    }
}

/// Whether a texture reads Generated because Cycles made its linked coordinate a constant. A probe cannot show that: it gives
/// the nodes attributes in the place of Generated, where a socket is not linked, but does not know which links Cycles will fold.
/// Its grid's own Generated coordinates come in then. (`tests/python/test_probe.py` compares the rule by them.)
fn reads_generated_for_constant(program: &Program) -> bool {
    program.notes.iter().any(|note| note.action == "replaced")
}

/// Per target, its components point by point.
pub type Values = Vec<Vec<f32>>;

/// What ours are compared with.
pub trait Reference {
    /// Values of every trial, or why there are none.
    fn values(&mut self, trials: &[&Trial]) -> Vec<Result<Values>>;
}

/// Live Cycles. The function hears how far Blender is.
pub struct Cycles<F>(pub F);

impl<F: FnMut(Message)> Reference for Cycles<F> {
    fn values(&mut self, trials: &[&Trial]) -> Vec<Result<Values>> {
        let jobs: Vec<probe::Job<'_>> = trials
            .iter()
            .map(|trial| probe::Job {
                scene: &trial.scene,
                positions: &trial.positions,
                attributes: &trial.attributes,
                targets: trial.targets.clone(),
                repeat: 1,
                samples: 1,
            })
            .collect();
        match probe::ask(&jobs, CyclesKernel::Sse42, &mut self.0) {
            Ok(answers) => answers.jobs.into_iter().map(|answer| Ok(answer.values)).collect(),
            // One graph that Blender refuses ends the process for all: halves find out which.
            Err(_) if trials.len() > 1 => {
                let (first, second) = trials.split_at(trials.len() / 2);
                let mut found = self.values(first);
                found.extend(self.values(second));
                found
            }
            Err(cause) => vec![Err(cause)],
        }
    }
}

/// How graphs are judged.
pub struct Judge<'a> {
    /// The adapter, where WGSL is compared.
    pub gpu: Option<&'a Gpu>,
    /// The compiler.
    pub compile: &'a Compile,
}

/// Compares the graphs; all of them are handed to the reference together.
///
/// Textures that Blender folds have to have its values already ([`with_folded_textures`]).
pub fn run(graphs: &[RandomGraph], judge: &Judge<'_>, reference: &mut dyn Reference) -> Vec<GraphComparison> {
    let trials: Vec<&Trial> = graphs.iter().map(|graph| &graph.trial).collect();
    let theirs = reference.values(&trials);
    graphs.iter().zip(theirs).map(|(graph, theirs)| judge.outcome(graph, theirs)).collect()
}

/// Gives textures that Blender folds its values, as an export does.
pub fn with_folded_textures(graphs: &mut [RandomGraph], receive: impl FnMut(Message)) -> Result<()> {
    let mut scenes: Vec<(&mut Scene, &[Target])> = graphs
        .iter_mut()
        .map(|RandomGraph { trial: Trial { scene, targets, .. }, .. }| (scene, targets.as_slice()))
        .collect();
    folded_textures::store_for(&mut scenes, receive).map(|_| ())
}

/// Makes a failing graph small and saves what is left of it, once for each of its failures.
pub fn keep(
    graph: &RandomGraph,
    outcome: &mut GraphComparison,
    judge: &Judge<'_>,
    reference: &mut dyn Reference,
    folder: &Path,
) -> Result<()> {
    for failure in &outcome.failures {
        let left = match failure.kind {
            // What does not compile says where.
            Kind::Compiler => shrink::Shrunk { trial: graph.trial.clone(), failure: failure.clone() },
            _ => shrink::shrink(&graph.trial, failure, judge, reference),
        };
        let kind = failure.kind;
        let path = save(&left.trial, &left.failure, &format!("random-graph-{}-{kind}", graph.seed), folder)?;
        outcome.saved.push(Saved { failure: left.failure, nodes: left.trial.scene.graph().nodes.len(), path });
    }
    Ok(())
}

impl Judge<'_> {
    fn outcome(&self, graph: &RandomGraph, theirs: Result<Values>) -> GraphComparison {
        let trial = &graph.trial;
        let content = trial.scene.graph();
        let mut outcome = GraphComparison {
            seed: graph.seed,
            nodes: content.nodes.len() + content.groups.iter().map(|group| group.nodes.len()).sum::<usize>(),
            instructions: 0,
            cpu: None,
            wgsl: None,
            no_wgsl: None,
            bounds: None,
            failures: Vec::new(),
            saved: Vec::new(),
            differences: Differences::default(),
        };
        let program = match (self.compile)(&trial.scene, &trial.targets, None) {
            Ok(program) => program,
            Err(cause) => {
                outcome.failures.push(Failure::of(Kind::Compiler, &cause));
                return outcome;
            }
        };
        outcome.instructions = program.instructions.len();
        match theirs.and_then(|theirs| compare::with_cycles(trial, self.compile, &program, &theirs)) {
            Ok((figures, failure)) => {
                outcome.cpu = Some(figures);
                outcome.failures.extend(failure);
            }
            Err(cause) => outcome.failures.push(Failure::of(Kind::Blender, &cause)),
        }
        if let Some(gpu) = self.gpu {
            match compare::with_wgsl(trial, &program, gpu) {
                compare::Wgsl::Compared(figures, differences, failure) => {
                    outcome.wgsl = Some(figures);
                    outcome.differences = differences;
                    outcome.failures.extend(failure);
                }
                compare::Wgsl::Impossible(reason) => outcome.no_wgsl = Some(reason),
                compare::Wgsl::Refused(failure) => outcome.failures.push(failure),
            }
        }
        match compare::with_bounds(trial, self.compile, graph.seed) {
            Ok((figures, failure)) => {
                outcome.bounds = Some(figures);
                outcome.failures.extend(failure);
            }
            Err(cause) => outcome.failures.push(Failure::of(Kind::Compiler, &cause)),
        }
        outcome
    }

    /// The failure of this kind that each trial has, if it has one.
    fn failures(&self, trials: &[&Trial], kind: Kind, reference: &mut dyn Reference) -> Vec<Option<Failure>> {
        let theirs: Vec<Option<Result<Values>>> = match kind {
            Kind::Cpu | Kind::Blender => reference.values(trials).into_iter().map(Some).collect(),
            _ => trials.iter().map(|_| None).collect(),
        };
        trials.iter().zip(theirs).map(|(trial, theirs)| self.failure(trial, kind, theirs)).collect()
    }

    fn failure(&self, trial: &Trial, kind: Kind, theirs: Option<Result<Values>>) -> Option<Failure> {
        let program = match (self.compile)(&trial.scene, &trial.targets, None) {
            Ok(program) => program,
            Err(cause) => return (kind == Kind::Compiler).then(|| Failure::of(kind, &cause)),
        };
        match (kind, theirs) {
            (Kind::Blender, Some(Err(cause))) => Some(Failure::of(kind, &cause)),
            // The step made another difference than that which is looked for.
            (Kind::Cpu, _) if reads_generated_for_constant(&program) => None,
            (Kind::Cpu, Some(Ok(theirs))) => {
                compare::with_cycles(trial, self.compile, &program, &theirs).ok().and_then(|(_, failure)| failure)
            }
            (Kind::Wgsl | Kind::Shader, _) => match compare::with_wgsl(trial, &program, self.gpu?) {
                compare::Wgsl::Compared(_, _, failure) if kind == Kind::Wgsl => failure,
                compare::Wgsl::Refused(failure) if kind == Kind::Shader => Some(failure),
                _ => None,
            },
            (Kind::Bounds, _) => compare::with_bounds(trial, self.compile, 1).ok().and_then(|(_, failure)| failure),
            _ => None,
        }
    }
}

impl Failure {
    fn of(kind: Kind, cause: &Error) -> Self {
        Self { kind, target: None, point: None, detail: cause.to_string() }
    }
}

/// Saves a graph as `NAME.scene.json`, and beside it as `NAME.failure.json` what failed, where, and with which attributes.
pub fn save(trial: &Trial, failure: &Failure, name: &str, folder: &Path) -> Result<PathBuf> {
    let path = folder.join(format!("{name}.scene.json"));
    let mut scene = trial.scene.clone();
    name.clone_into(&mut scene.name);
    let text = |json: &Json| serde_json::to_string_pretty(json).expect("plain values serialise") + "\n";
    files::write_atomically(&path, text(&serde_json::to_value(&scene).expect("scene types serialise")).as_bytes())?;
    let point = failure.point.filter(|&index| index < trial.positions.len());
    let attributes: Map<String, Json> = trial
        .attributes
        .iter()
        .map(|(name, values)| (name.clone(), point.map_or(Json::Null, |index| vector(values[index]))))
        .collect();
    let record = json!({
        "scene": path.file_name().map(|name| name.to_string_lossy()),
        "failure": failure,
        "target": failure.target.and_then(|index| trial.targets.get(index)).map(Target::name),
        "position": point.map(|index| vector(trial.positions[index])),
        "attributes": attributes,
    });
    files::write_atomically(&folder.join(format!("{name}.failure.json")), text(&record).as_bytes())?;
    Ok(path)
}

/// A node without inputs and properties.
fn node(name: &str, kind: &str) -> Node {
    Node {
        name: name.to_owned(),
        kind: kind.to_owned(),
        label: None,
        location: Some([0.0; 2]),
        muted: false,
        bypass: None,
        group: None,
        socket_type: None,
        properties: Map::new(),
        outputs: indexmap::IndexMap::new(),
        inputs: indexmap::IndexMap::new(),
        folded: Vec::new(),
    }
}

/// A link to a node's output.
fn link(node: &str, socket: &str) -> Input {
    Input::Link { node: node.to_owned(), socket: socket.to_owned() }
}

/// Three components; what JSON has no number for as text.
fn vector(values: [f32; 3]) -> Json {
    values
        .map(|value| if value.is_finite() { super::suite::json_number(value) } else { value.to_string().into() })
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nodes::{self, Role};
    use std::collections::BTreeSet;

    #[test]
    fn graphs_compile_and_repeat() {
        for seed in 0..20 {
            let graph = generate(seed, 4).expect("a graph");
            // As text: there are NaNs among the attributes.
            let again = generate(seed, 4).expect("the same graph");
            assert_eq!(format!("{:?}", graph.trial), format!("{:?}", again.trial));
            let program = Program::compile(&graph.trial.scene, &graph.trial.targets);
            let program = program.unwrap_or_else(|error| panic!("seed {seed}: {error}"));
            assert_eq!(program.outputs.len(), graph.trial.targets.len());
        }
    }

    #[test]
    fn graphs_hold_every_node_and_all_that_a_graph_may_be() {
        let mut found = BTreeSet::new();
        let (mut muted_groups, mut muted_nodes, mut shared, mut nested) = (0, 0, 0, 0);
        for seed in 0..100 {
            let graph = generate(seed, 2).expect("a graph");
            let content = graph.trial.scene.graph();
            let inner = || content.groups.iter().flat_map(|group| &group.nodes);
            for node in content.nodes.iter().chain(inner()) {
                found.insert(node.kind.clone());
                muted_groups += usize::from(node.muted && node.group.is_some());
                muted_nodes += usize::from(node.muted && node.group.is_none());
            }
            nested += inner().filter(|node| node.group.is_some()).count();
            let uses = |name: &str| content.nodes.iter().filter(|node| node.group.as_deref() == Some(name)).count();
            shared += content.groups.iter().filter(|group| uses(&group.name) > 1).count();
        }
        for node_type in nodes::registry() {
            let is_evaluated =
                matches!(node_type.role, Role::Evaluated(_)) && node_type.type_name.starts_with("ShaderNode");
            assert!(!is_evaluated || found.contains(node_type.type_name), "{} is in no graph", node_type.label);
        }
        for kind in ["NodeReroute", "ShaderNodeValue", "ShaderNodeGroup"] {
            assert!(found.contains(kind), "{kind} is in no graph");
        }
        assert!(muted_nodes > 5 && muted_groups > 2 && shared > 5 && nested > 5);
    }
}
