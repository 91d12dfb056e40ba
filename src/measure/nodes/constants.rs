//! Every node in every mode with constant inputs alone: Blender and Cycles fold such nodes by rules of their own, which are
//! part of the values.
//!
//! Blender evaluates a node whose inputs are constant before Cycles sees the graph, if it has a function for the node
//! ([`FoldedBy::Blender`]); what Blender cannot evaluate makes its readers vary, and Cycles folds those, if it can
//! ([`FoldedBy::Cycles`]). Inputs are linked: a stored value is limited to its socket's range, a linked one is not.

use crate::base::error::Result;
use crate::bridge::{CyclesKernel, Message, probe};
use crate::graph::evaluate::Points;
use crate::graph::{Program, Target};
use crate::measure::errors::values::equal;
use crate::measure::nodes::limits;
use crate::measure::nodes::suite::{ModeComparison, Tally, json_number, modes_of, normal};
use crate::nodes::{self, Mode, NodeType, Role};
use crate::scene::{Release, Scene, SocketType, bare_scene};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Map, Value as Json, json};

/// Who folds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FoldedBy {
    /// Inputs come from Value and Combine XYZ, which Blender folds.
    Blender,
    /// Inputs come from Separate Color and Combine Color, which only Cycles folds.
    Cycles,
}

/// Numbers at which folding and simplification branch.
const SPECIAL: [f32; 12] = [0.0, 1.0, -1.0, 0.5, -0.5, 2.0, 3.0, -2.0, 1e-3, 0.25, 1e5, -1e5];

/// Share of [`SPECIAL`] among the numbers.
const SPECIAL_SHARE: f64 = 0.35;

/// Nodes of one type in one mode, each with other constants.
pub struct Case {
    node: &'static str,
    mode: String,
    scene: Scene,
    targets: Vec<Target>,
    /// Output of each target, and what its inputs are.
    described: Vec<(&'static str, String)>,
    cpu: Vec<limits::Limit>,
}

fn number(random: &mut ChaCha8Rng) -> f32 {
    if random.random_bool(SPECIAL_SHARE) {
        SPECIAL[random.random_range(0..SPECIAL.len())]
    } else if random.random() {
        random.random()
    } else {
        normal(random, 3.0)
    }
}

/// Nodes that give a constant of `kind`, and the link to it.
pub(super) fn constant(kind: SocketType, values: &[f32], by: FoldedBy, name: &str, graph: &mut Vec<Json>) -> Json {
    let list: Vec<Json> = values.iter().map(|&value| json_number(value)).collect();
    match (kind.components(), by) {
        (1, FoldedBy::Blender) => {
            graph.push(json!({"name": name, "type": "ShaderNodeValue", "outputs": {"Value": list[0]}}));
            json!({"node": name, "socket": "Value"})
        }
        (1, FoldedBy::Cycles) => {
            // (The socket of an RGB node keeps no negative channel.)
            let [value, color] = ["value", "color"].map(|word| format!("{name} {word}"));
            graph.push(json!({"name": value, "type": "ShaderNodeValue", "outputs": {"Value": list[0]}}));
            graph.push(json!({
                "name": color, "type": "ShaderNodeCombineColor", "inputs": {"Red": {"node": value, "socket": "Value"}},
            }));
            graph.push(json!({
                "name": name, "type": "ShaderNodeSeparateColor",
                "inputs": {"Color": {"node": color, "socket": "Color"}},
            }));
            json!({"node": name, "socket": "Red"})
        }
        (_, by) => {
            let (kind, sockets, output) = match by {
                FoldedBy::Blender => ("ShaderNodeCombineXYZ", ["X", "Y", "Z"], "Vector"),
                FoldedBy::Cycles => ("ShaderNodeCombineColor", ["Red", "Green", "Blue"], "Color"),
            };
            let mut inputs = Map::new();
            for (axis, socket) in sockets.iter().enumerate() {
                let value = format!("{name} {socket}");
                graph.push(json!({"name": value, "type": "ShaderNodeValue", "outputs": {"Value": list[axis]}}));
                inputs.insert((*socket).into(), json!({"node": value, "socket": "Value"}));
            }
            graph.push(json!({"name": name, "type": kind, "inputs": inputs}));
            json!({"node": name, "socket": output})
        }
    }
}

impl Case {
    fn new(
        node_type: &'static NodeType,
        properties: &Map<String, Json>,
        by: FoldedBy,
        sets: usize,
        seed: u64,
    ) -> Result<Self> {
        let mode = Mode::read(node_type, properties, node_type.label)?;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut graph = Vec::new();
        let (mut targets, mut described, mut cpu) = (Vec::new(), Vec::new(), Vec::new());
        for set in 0..sets {
            let mut inputs = Map::new();
            let mut words = Vec::new();
            for (place, socket) in node_type.inputs_of(&mode).enumerate() {
                let values: Vec<f32> = (0..socket.kind.components()).map(|_| number(&mut random)).collect();
                words.push(format!("{} {values:?}", socket.identifier));
                let name = format!("Input {set} {place}");
                inputs.insert(socket.identifier.into(), constant(socket.kind, &values, by, &name, &mut graph));
            }
            let name = format!("Node {set}");
            graph.push(json!({"name": name, "type": node_type.type_name, "properties": properties, "inputs": inputs}));
            for output in node_type.outputs_of(&mode) {
                targets.push(Target::output(&name, output.identifier));
                described.push((output.identifier, words.join(", ")));
                cpu.push(limits::cpu(node_type, &mode, output.identifier));
            }
        }
        let words = mode.words().join(" ");
        Ok(Self {
            node: node_type.label,
            mode: format!("{words} constants for {by:?}").trim_start().to_owned(),
            scene: bare_scene("constants", json!({"material": "Material", "nodes": graph, "groups": []}))?,
            targets,
            described,
            cpu,
        })
    }

    /// The scene and what is asked of it.
    pub fn subject(&mut self) -> (&mut Scene, &[Target]) {
        (&mut self.scene, &self.targets)
    }

    /// A row per output: over all sets of constants.
    fn rows(&self, theirs: &[Vec<f32>], positions: &[[f32; 3]]) -> Result<Vec<ModeComparison>> {
        let program = Program::compile(&self.scene, &self.targets)?;
        let ours = program.evaluate_single(Points::new(positions))?;
        let mut tallies: Vec<(&'static str, Tally, limits::Limit)> = Vec::new();
        let mut first = 0;
        for (number, theirs) in theirs.iter().enumerate() {
            let components = theirs.len() / positions.len();
            let (output, inputs) = &self.described[number];
            let place = tallies.iter().position(|(known, ..)| known == output).unwrap_or_else(|| {
                tallies.push((output, Tally::default(), self.cpu[number]));
                tallies.len() - 1
            });
            let (found, reference) = (&ours[first..first + components], &theirs[..components]);
            debug_assert!(
                theirs.chunks(components).all(|chunk| chunk.iter().zip(reference).all(|(a, b)| equal(*a, *b)))
            );
            let (_, tally, limit) = &mut tallies[place];
            tally.add(found, reference, limit, || inputs.clone());
            first += components;
        }
        Ok(tallies
            .into_iter()
            .map(|(output, tally, limit)| tally.row((self.node, &self.mode, output), &limit))
            .collect())
    }
}

/// Cases of every mode, for both; `node` restricts to one label.
pub fn cases(sets: usize, seed: u64, node: Option<&str>, release: Release) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for node_type in nodes::registry() {
        // Cycles takes the constant coordinate of a texture for an unlinked one: only Blender folds textures.
        let texture = node_type.inputs.iter().any(|socket| socket.generated_when_unlinked);
        let folding: &[FoldedBy] = if texture { &[FoldedBy::Blender] } else { &[FoldedBy::Blender, FoldedBy::Cycles] };
        let evaluated = matches!(node_type.role, Role::Evaluated(_)) && node_type.type_name.starts_with("ShaderNode");
        if !evaluated || node.is_some_and(|label| label != node_type.label) {
            continue;
        }
        for properties in modes_of(node_type, release) {
            for &by in folding {
                let seed = seed.wrapping_add(cases.len() as u64);
                let mut case = Case::new(node_type, &properties, by, sets, seed)?;
                case.scene.graph_mut().blender = release;
                cases.push(case);
            }
        }
    }
    Ok(cases)
}

/// Compares all cases in one Blender process.
///
/// Textures that Blender folds have to have its values already, as an export stores them ([`Case::subject`]).
pub fn run(cases: &[Case], mut receive: impl FnMut(Message)) -> Result<super::suite::ModeComparisons> {
    let positions = [[0.0; 3]; 2];
    let jobs: Vec<probe::Job<'_>> = cases
        .iter()
        .map(|case| probe::Job {
            scene: &case.scene,
            positions: &positions,
            attributes: &[],
            targets: case.targets.clone(),
            repeat: 1,
            samples: 1,
        })
        .collect();
    let answers = probe::ask(&jobs, CyclesKernel::Sse42, &mut receive)?;
    let mut rows = Vec::new();
    for (case, answer) in cases.iter().zip(&answers.jobs) {
        rows.extend(case.rows(&answer.values, &positions)?);
    }
    Ok(super::suite::ModeComparisons { rows, blender: answers.blender })
}
