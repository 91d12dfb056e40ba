//! Random graphs of many nodes against Cycles: conversions, groups, muted nodes, reroutes, folding and
//! simplification together.

use super::statistics::{equal, ulp_distance};
use super::suite::{attribute_name, attribute_nodes, bare_scene, modes, normal, special_or_normal};
use crate::blender::{Kernel, Message, probe};
use crate::error::Result;
use crate::files;
use crate::graph::evaluate::Points;
use crate::graph::{Program, Target};
use crate::nodes::{self, InputSocket, Mode, NodeType, Role};
use crate::scene::{Scene, SocketType};
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use serde_json::{Map, Value as Json, json};
use std::path::{Path, PathBuf};

/// Attributes that a graph reads; the position comes besides.
const ATTRIBUTES: usize = 2;

/// Share of special values among the attributes' components: in long chains more of them would
/// turn nearly every value into NaN.
const SPECIAL_SHARE: f64 = 0.03;

/// Largest distance of a value behind a C library function. Builds of the library are within 1 ulp of
/// each other, and the arithmetic behind one may magnify that.
const LIBRARY_ULPS: u32 = 64;

/// Share of points that may be farther off behind a C library function: cancellation and jumps.
const LIBRARY_SHARE: f64 = 0.01;

/// Operations that call the C library.
const LIBRARY: &[&str] = &[
    "POWER",
    "LOGARITHM",
    "EXPONENT",
    "SINE",
    "COSINE",
    "TANGENT",
    "ARCSINE",
    "ARCCOSINE",
    "ARCTANGENT",
    "ARCTAN2",
    "SINH",
    "COSH",
    "TANH",
    "MINKOWSKI",
];

/// Constants that evaluators and simplifications treat specially.
const CONSTANTS: [f32; 10] = [0.0, 1.0, -1.0, 0.5, 2.0, -3.0, 1e-6, 1e3, 4.0, 0.333_333_34];

/// A random graph.
pub struct RandomGraph {
    /// What it was made from.
    pub seed: u64,
    /// The graph in a scene.
    pub scene: Scene,
    /// What is compared: every output of every node, so that the first difference is where it is born.
    pub targets: Vec<Target>,
    /// Calls the C library somewhere.
    pub library: bool,
    /// Object-space positions.
    pub positions: Vec<[f32; 3]>,
    /// Values of the attributes.
    pub attributes: Vec<(String, Vec<[f32; 3]>)>,
}

/// What was found for one graph.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// Seed of the graph.
    pub seed: u64,
    /// Nodes that are evaluated after all passes.
    pub nodes: usize,
    /// Calls the C library somewhere.
    pub library: bool,
    /// Values compared.
    pub values: usize,
    /// Values that are not equal.
    pub differing: usize,
    /// Whether that is allowed: none without the C library.
    pub pass: bool,
    /// The first difference: target, ours, Cycles'.
    pub first: Option<String>,
    /// Where a failing graph was saved.
    pub saved: Option<PathBuf>,
}

/// An output that later nodes may read.
#[derive(Clone)]
struct Value {
    node: String,
    socket: String,
    kind: SocketType,
    /// Depends on the point.
    varies: bool,
}

impl Value {
    fn link(&self) -> Json {
        json!({"node": self.node, "socket": self.socket})
    }
}

struct Builder {
    random: ChaCha8Rng,
    nodes: Vec<Json>,
    groups: Vec<Json>,
    values: Vec<Value>,
    targets: Vec<Target>,
    library: bool,
}

/// The graph of a seed, with `points` points.
pub fn generate(seed: u64, points: usize) -> Result<RandomGraph> {
    let mut builder = Builder {
        random: ChaCha8Rng::seed_from_u64(seed),
        nodes: vec![json!({"name": "Coordinates", "type": "ShaderNodeTexCoord"})],
        groups: Vec::new(),
        values: vec![Value {
            node: "Coordinates".into(),
            socket: "Object".into(),
            kind: SocketType::Vector,
            varies: true,
        }],
        targets: Vec::new(),
        library: false,
    };
    for number in 0..ATTRIBUTES {
        builder.nodes.extend(attribute_nodes(number));
        let value = |node: &str, socket: &str, kind: SocketType| Value {
            node: format!("{node} {number}"),
            socket: socket.into(),
            kind,
            varies: true,
        };
        builder.values.push(value("Attribute", "Vector", SocketType::Vector));
        builder.values.extend(["X", "Y", "Z"].map(|axis| value("Separate", axis, SocketType::Float)));
    }
    let count = builder.random.random_range(4..=20);
    for number in 0..count {
        builder.add(number)?;
    }
    let random = &mut builder.random;
    let mut draw = || {
        let row: [f32; 3] = std::array::from_fn(|_| {
            if random.random_bool(SPECIAL_SHARE) { special_or_normal(random) } else { normal(random, 3.0) }
        });
        row
    };
    let positions = (0..points).map(|_| draw()).collect();
    let attributes =
        (0..ATTRIBUTES).map(|number| (attribute_name(number), (0..points).map(|_| draw()).collect())).collect();
    let graph = json!({"material": "Material", "nodes": builder.nodes, "groups": builder.groups});
    let scene = bare_scene(&format!("random-graph-{seed}"), graph)?;
    Ok(RandomGraph { seed, scene, targets: builder.targets, library: builder.library, positions, attributes })
}

impl Builder {
    fn add(&mut self, number: usize) -> Result<()> {
        match self.random.random_range(0..10) {
            0 => {
                self.reroute(number);
                Ok(())
            }
            1 => {
                self.constant(number);
                Ok(())
            }
            _ => self.node(number),
        }
    }

    fn pick(&mut self, varies: bool) -> Value {
        let candidates: Vec<&Value> = self.values.iter().filter(|value| value.varies || !varies).collect();
        // Later values more often: longer chains.
        let first = self.random.random_range(0..candidates.len());
        let second = self.random.random_range(0..candidates.len());
        candidates[first.max(second)].clone()
    }

    fn number(&mut self) -> f32 {
        if self.random.random() {
            CONSTANTS[self.random.random_range(0..CONSTANTS.len())]
        } else {
            normal(&mut self.random, 2.0)
        }
    }

    fn reroute(&mut self, number: usize) {
        let source = self.pick(false);
        let node = format!("Reroute {number}");
        // A reroute has the type of what it is linked to.
        self.nodes.push(json!({
            "name": node, "type": "NodeReroute", "socket_type": source.kind, "inputs": {"Input": source.link()},
        }));
        self.values.push(Value { node, socket: "Output".into(), ..source });
    }

    fn constant(&mut self, number: usize) {
        let node = format!("Value {number}");
        let value = self.number();
        self.nodes.push(json!({"name": node, "type": "ShaderNodeValue", "outputs": {"Value": value}}));
        self.values.push(Value { node, socket: "Value".into(), kind: SocketType::Float, varies: false });
    }

    fn node(&mut self, number: usize) -> Result<()> {
        let types: Vec<&'static NodeType> = nodes::registry()
            .iter()
            .copied()
            .filter(|node| matches!(node.role, Role::Evaluated(_)) && node.type_name.starts_with("ShaderNode"))
            .collect();
        let node_type = types[self.random.random_range(0..types.len())];
        let properties = modes(node_type).choose(&mut self.random).cloned().unwrap_or_default();
        let mode = Mode::read(node_type, &properties, node_type.label)?;
        self.library |= mode.words().iter().any(|word| LIBRARY.contains(&word.as_str()));
        let texture = node_type.inputs.iter().any(|socket| socket.generated_when_unlinked);
        let mut inputs = Map::new();
        let mut varies = false;
        for (index, socket) in node_type.inputs_of(&mode).enumerate() {
            // Textures with constant inputs only are folded by Blender with another evaluation, equal to
            // 5e-7; here they vary, so that all must be equal. Their coordinate is always linked.
            let must_vary = texture && index == 0;
            if must_vary || self.random.random_bool(0.6) && !is_expensive(socket) {
                let source = self.pick(must_vary);
                varies |= source.varies;
                inputs.insert(socket.identifier.into(), source.link());
            } else {
                inputs.insert(socket.identifier.into(), self.stored(socket));
            }
        }
        let name = format!("{} {number}", node_type.label);
        let outputs: Vec<(String, SocketType)> =
            node_type.outputs_of(&mode).map(|output| (output.identifier.to_owned(), output.kind)).collect();
        let entry = json!({"name": name, "type": node_type.type_name, "properties": properties, "inputs": inputs});
        match self.random.random_range(0..10) {
            0 if !texture && can_be_muted(node_type, &mode) => self.mute(node_type, &mode, entry, name, varies),
            1 | 2 => self.group(number, entry, &outputs, varies),
            _ => {
                self.nodes.push(entry);
                self.publish(name, &outputs, varies);
            }
        }
        Ok(())
    }

    /// A stored value within the socket's limits.
    fn stored(&mut self, socket: &InputSocket) -> Json {
        if socket.kind.components() == 3 {
            return json!([self.number(), self.number(), self.number()]);
        }
        let random = &mut self.random;
        let mut uniform = |low: f32, high: f32| low + (high - low) * random.random::<f32>();
        let value = match socket.identifier {
            "Detail" => uniform(0.0, 4.0),
            "Roughness" | "Randomness" | "Smoothness" => uniform(0.0, 1.0),
            "Lacunarity" => uniform(0.0, 4.0),
            "Exponent" => uniform(0.1, 8.0),
            "Scale" | "Offset" | "Gain" | "Distortion" => uniform(-2.0, 5.0),
            _ => self.number(),
        };
        json!(value)
    }

    fn publish(&mut self, node: String, outputs: &[(String, SocketType)], varies: bool) {
        for (socket, kind) in outputs {
            self.values.push(Value { node: node.clone(), socket: socket.clone(), kind: *kind, varies });
            self.targets.push(Target::output(&node, socket));
        }
    }

    /// Mutes a node whose inputs and output have one type: it passes its first linked input, else
    /// its first.
    fn mute(&mut self, node_type: &'static NodeType, mode: &Mode, mut entry: Json, name: String, varies: bool) {
        let Some(output) = node_type.outputs_of(mode).next() else { return };
        let existing: Vec<&str> = node_type.inputs_of(mode).map(|socket| socket.identifier).collect();
        let linked = existing.iter().find(|identifier| entry["inputs"][**identifier].is_object());
        let through = linked.or(existing.first()).copied().unwrap_or_default();
        entry["muted"] = true.into();
        entry["bypass"] = json!({output.identifier: through});
        self.nodes.push(entry);
        // What passes may be a constant; nothing that must vary may read it.
        let varies = varies && linked.is_some() && node_type.inputs_of(mode).count() == 1;
        self.values.push(Value { node: name, socket: output.identifier.into(), kind: output.kind, varies });
    }

    /// Puts a node into a group, sometimes that group into another. Interfaces of other types than
    /// the links change nothing: Blender inlines groups before it converts.
    fn group(&mut self, number: usize, entry: Json, outputs: &[(String, SocketType)], varies: bool) {
        let levels = self.random.random_range(1..=2);
        let inner_name = entry["name"].as_str().unwrap_or_default().to_owned();
        let outer_inputs: Vec<(String, Json)> = entry["inputs"]
            .as_object()
            .map(|map| map.iter().map(|(k, v)| (k.clone(), v.clone())).collect())
            .unwrap_or_default();
        let links: Vec<(usize, &(String, Json))> =
            outer_inputs.iter().enumerate().filter(|(_, (_, value))| value.is_object()).collect();
        let kinds = [SocketType::Float, SocketType::Vector, SocketType::Color];
        let input_sockets: Vec<Json> = links
            .iter()
            .map(|(index, _)| {
                let kind = kinds[self.random.random_range(0..kinds.len())];
                interface_socket(format!("Socket_{}", index + 20), format!("In {index}"), kind)
            })
            .collect();
        let output_sockets: Vec<Json> = outputs
            .iter()
            .enumerate()
            .map(|(index, (_, kind))| interface_socket(format!("Socket_{index}"), format!("Out {index}"), *kind))
            .collect();
        let mut inner = entry;
        for (index, (identifier, _)) in &links {
            inner["inputs"][identifier.as_str()] = json!({"group_input": format!("Socket_{}", index + 20)});
        }
        let mut inner_outputs: Vec<String> = outputs.iter().map(|(identifier, _)| identifier.clone()).collect();
        let mut inner_name = inner_name;
        for level in 0..levels {
            let name = format!("Group {number} {level}");
            let ends: Map<String, Json> = inner_outputs
                .iter()
                .enumerate()
                .map(|(index, socket)| (format!("Socket_{index}"), json!({"node": inner_name, "socket": socket})))
                .collect();
            self.groups.push(json!({
                "name": name, "inputs": input_sockets, "outputs": output_sockets,
                "nodes": [inner, {
                    "name": "Group Output", "type": "NodeGroupOutput",
                    "properties": {"is_active_output": true}, "inputs": ends,
                }],
            }));
            let last = level + 1 == levels;
            let inputs: Map<String, Json> = links
                .iter()
                .map(|(index, (_, link))| {
                    let socket = format!("Socket_{}", index + 20);
                    (socket.clone(), if last { link.clone() } else { json!({"group_input": socket}) })
                })
                .collect();
            inner_name = format!("Use {number} {level}");
            inner = json!({"name": inner_name, "type": "ShaderNodeGroup", "group": name, "inputs": inputs});
            inner_outputs = (0..outputs.len()).map(|index| format!("Socket_{index}")).collect();
        }
        self.nodes.push(inner);
        let outputs: Vec<(String, SocketType)> =
            inner_outputs.into_iter().zip(outputs).map(|(socket, (_, kind))| (socket, *kind)).collect();
        self.publish(inner_name, &outputs, varies);
    }
}

/// A socket of a group's interface; what reads it has the default where a link leads to nothing.
fn interface_socket(identifier: String, name: String, kind: SocketType) -> Json {
    let default = match kind {
        SocketType::Color => json!([0.25, 0.5, 0.75, 1.0]),
        SocketType::Vector => json!([0.25, 0.5, 0.75]),
        _ => json!(0.25),
    };
    json!({"identifier": identifier, "name": name, "type": kind, "default": default})
}

/// Linked Details of hundreds would cost minutes and say no more.
fn is_expensive(socket: &InputSocket) -> bool {
    socket.identifier == "Detail"
}

/// Whether all sockets of the mode have one type, so that Blender's internal link is the first
/// linked input.
fn can_be_muted(node_type: &'static NodeType, mode: &Mode) -> bool {
    let mut outputs = node_type.outputs_of(mode);
    match (outputs.next(), outputs.next()) {
        (Some(output), None) => node_type.inputs_of(mode).all(|socket| socket.kind == output.kind),
        _ => false,
    }
}

/// Compares the graphs, in one Blender process; graphs that fail are saved in `folder`.
pub fn run(graphs: &[RandomGraph], folder: &Path, receive: impl FnMut(Message)) -> Result<Vec<Outcome>> {
    let jobs: Vec<probe::Job<'_>> = graphs
        .iter()
        .map(|graph| probe::Job {
            scene: &graph.scene,
            positions: &graph.positions,
            attributes: &graph.attributes,
            targets: graph.targets.clone(),
            repeat: 1,
        })
        .collect();
    let answers = probe::ask(&jobs, Kernel::Sse42, receive)?;
    graphs.iter().zip(&answers.jobs).map(|(graph, answer)| graph.compare(&answer.values, folder)).collect()
}

impl RandomGraph {
    fn compare(&self, theirs: &[Vec<f32>], folder: &Path) -> Result<Outcome> {
        let program = Program::compile(&self.scene, &self.targets)?;
        let points = Points { positions: &self.positions, attributes: &self.attributes };
        let ours = program.evaluate_single(points)?;
        let width = program.output_components();
        let mut outcome = Outcome {
            seed: self.seed,
            nodes: program.instructions.len(),
            library: self.library,
            values: 0,
            differing: 0,
            pass: true,
            first: None,
            saved: None,
        };
        let mut far = 0;
        let mut first = 0;
        for (target, theirs) in self.targets.iter().zip(theirs) {
            let components = theirs.len() / self.positions.len();
            for (index, row) in theirs.chunks(components).enumerate() {
                let ours = &ours[index * width + first..index * width + first + components];
                for (a, b) in ours.iter().zip(row) {
                    outcome.values += 1;
                    if equal(*a, *b) {
                        continue;
                    }
                    outcome.differing += 1;
                    let near = a.is_finite() && b.is_finite() && ulp_distance(*a, *b) <= LIBRARY_ULPS;
                    far += usize::from(!near);
                    outcome
                        .first
                        .get_or_insert_with(|| format!("{} at point {index}: ours {a}, Cycles {b}", target.name()));
                }
            }
            first += components;
        }
        outcome.pass = match self.library {
            false => outcome.differing == 0,
            true => far as f64 <= LIBRARY_SHARE * outcome.values as f64,
        };
        if !outcome.pass {
            let path = folder.join(format!("{}.scene.json", self.scene.name));
            let text = serde_json::to_string_pretty(&self.scene).expect("scene types serialise") + "\n";
            files::write_atomically(&path, text.as_bytes())?;
            outcome.saved = Some(path);
        }
        Ok(outcome)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn graphs_compile_and_repeat() {
        for seed in 0..200 {
            let graph = generate(seed, 4).expect("a graph");
            assert_eq!(graph.scene, generate(seed, 4).expect("the same graph").scene);
            Program::compile(&graph.scene, &graph.targets).unwrap_or_else(|error| panic!("seed {seed}: {error}"));
        }
    }
}
