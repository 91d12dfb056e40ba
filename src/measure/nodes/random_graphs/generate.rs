//! Making random graphs that Blender can build.

use crate::base::error::Result;
use crate::graph::{Program, Target};
use crate::measure::nodes::random_graphs::{RandomGraph, Trial, reads_generated_for_constant};
use crate::measure::nodes::suite::{attribute_name, attribute_nodes, json_number, normal, special_or_normal};
use crate::nodes::{self, InputSocket, Mode, NodeType, PropertyValues, Role};
use crate::scene::SocketType;
use crate::scene::bare_scene;
use rand::seq::IndexedRandom;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Map, Value as Json, json};

/// Attributes that a graph reads; the position comes besides.
const ATTRIBUTES: usize = 3;

/// Nodes of the material's tree besides those that every graph has.
const NODES: std::ops::RangeInclusive<usize> = 4..=40;

/// Share of special values among the components of every other point: more of them would turn nearly every value
/// into NaN.
const SPECIAL_SHARE: f64 = 0.08;

/// Constants that evaluators and simplifications treat specially.
const CONSTANTS: [f32; 10] = [0.0, 1.0, -1.0, 0.5, 2.0, -3.0, 1e-6, 1e3, 4.0, 0.333_333_34];

/// Stored values at the ends of what f32 holds.
const EXTREME: [f32; 8] = [-0.0, 1e30, -1e30, 1e-40, -1e-45, 1e-30, 16_777_217.0, -1e9];

/// How often a node is drawn again that cannot be compared.
const ATTEMPTS: usize = 5;

/// An output that later nodes may read.
#[derive(Clone)]
struct Value {
    link: Json,
    kind: SocketType,
    /// Depends on the point, whatever the inputs of its group are.
    varies: bool,
}

/// A group that may be used again.
#[derive(Clone)]
struct Shared {
    name: String,
    inputs: Vec<(String, SocketType)>,
    /// With whether it varies whatever the inputs are.
    outputs: Vec<(String, SocketType, bool)>,
    /// Levels of groups, this one included.
    depth: usize,
}

/// The nodes of a tree, what they offer, and the outputs of the nodes that were just added.
#[derive(Clone, Default)]
struct Tree {
    nodes: Vec<Json>,
    values: Vec<Value>,
    fresh: Vec<Target>,
    /// Levels of groups around it.
    depth: usize,
}

#[derive(Clone)]
struct Builder {
    random: ChaCha8Rng,
    types: Vec<&'static NodeType>,
    sources: Vec<&'static NodeType>,
    groups: Vec<Json>,
    shared: Vec<Shared>,
    /// Number of the next node: names do not repeat.
    number: usize,
}

/// The graph of a seed, with `points` points.
pub fn generate(seed: u64, points: usize) -> Result<RandomGraph> {
    let of_role = |wanted: fn(&NodeType) -> bool| -> Vec<&'static NodeType> {
        let all = nodes::registry().iter().copied();
        all.filter(|node| node.type_name.starts_with("ShaderNode") && wanted(node)).collect()
    };
    let mut builder = Builder {
        random: ChaCha8Rng::seed_from_u64(seed),
        types: of_role(|node| matches!(node.role, Role::Evaluated(_))),
        sources: of_role(|node| matches!(node.role, Role::Source(_)) && !source_outputs(node).is_empty()),
        groups: Vec::new(),
        shared: Vec::new(),
        number: 0,
    };
    let mut tree = builder.tree(0, 0..ATTRIBUTES);
    let mut targets = Vec::new();
    let count = builder.random.random_range(NODES);
    for _ in 0..count {
        for _ in 0..ATTEMPTS {
            let (mut next, mut longer) = (builder.clone(), tree.clone());
            next.add(&mut longer)?;
            let is_sound = next.is_sound(&longer);
            // What was drawn stays drawn: the next attempt is another one.
            builder.random = next.random.clone();
            if is_sound {
                (builder, tree) = (next, longer);
                targets.append(&mut tree.fresh);
                break;
            }
        }
    }
    let random = &mut builder.random;
    let mut draw = |index: usize| -> [f32; 3] {
        std::array::from_fn(|_| {
            let special = index % 2 == 1 && random.random_bool(SPECIAL_SHARE);
            if special { special_or_normal(random) } else { normal(random, 3.0) }
        })
    };
    let positions = (0..points).map(&mut draw).collect();
    let attributes =
        (0..ATTRIBUTES).map(|number| (attribute_name(number), (0..points).map(&mut draw).collect())).collect();
    let scene = builder.scene(&format!("random-graph-{seed}"), &tree)?;
    Ok(RandomGraph { seed, trial: Trial { scene, targets, positions, attributes } })
}

/// Outputs of a source that a probe knows a value of.
fn source_outputs(node: &NodeType) -> Vec<&'static str> {
    match node.type_name {
        "ShaderNodeValue" => vec!["Value"],
        "ShaderNodeRGB" => vec!["Color"],
        "ShaderNodeTexCoord" => vec!["Generated", "Object"],
        "ShaderNodeNewGeometry" => vec!["Position"],
        "ShaderNodeObjectInfo" => node.outputs.iter().map(|output| output.identifier).collect(),
        _ => Vec::new(),
    }
}

fn link(node: &str, socket: &str) -> Json {
    json!({"node": node, "socket": socket})
}

impl Builder {
    /// A tree with what varies in it: coordinates and some attributes.
    fn tree(&mut self, depth: usize, attributes: std::ops::Range<usize>) -> Tree {
        let mut tree = Tree { depth, ..Tree::default() };
        let mut offer = |link: Json, kind: SocketType| tree.values.push(Value { link, kind, varies: true });
        offer(link("Coordinates", "Object"), SocketType::Vector);
        for number in attributes.clone() {
            offer(link(&format!("Attribute {number}"), "Vector"), SocketType::Vector);
            for axis in ["X", "Y", "Z"] {
                offer(link(&format!("Separate {number}"), axis), SocketType::Float);
            }
        }
        tree.nodes.push(json!({"name": "Coordinates", "type": "ShaderNodeTexCoord"}));
        tree.nodes.extend(attributes.flat_map(attribute_nodes));
        tree
    }

    fn scene(&self, name: &str, tree: &Tree) -> Result<crate::scene::Scene> {
        let groups: Vec<&Json> = self.groups.iter().collect();
        bare_scene(name, json!({"material": "Material", "nodes": tree.nodes, "groups": groups}))
    }

    /// Whether the nodes just added compile, fold to finite constants only (Blender's functions have other rules for NaN and
    /// infinities than Cycles', which the nodes do not promise), and read no coordinates that a probe does not know.
    fn is_sound(&self, tree: &Tree) -> bool {
        let folds_to_numbers = |program: &Program| {
            let is_wild = |reason: &str| reason.contains("inf") || reason.contains("NaN");
            !program.notes.iter().any(|note| note.action == "folded" && is_wild(&note.reason))
        };
        let scene = self.scene("attempt", tree);
        scene
            .and_then(|scene| Program::compile(&scene, &tree.fresh))
            .is_ok_and(|program| folds_to_numbers(&program) && !reads_generated_for_constant(&program))
    }

    fn add(&mut self, tree: &mut Tree) -> Result<()> {
        self.number += 1;
        match self.random.random_range(0..12) {
            0 => self.reroute(tree),
            1 => self.source(tree),
            2 | 3 if tree.depth < 2 => return self.group(tree),
            _ => return self.node(tree),
        }
        Ok(())
    }

    fn pick(&mut self, tree: &Tree, varies: bool) -> Value {
        let candidates: Vec<&Value> = tree.values.iter().filter(|value| value.varies || !varies).collect();
        // Later values more often: longer chains.
        let first = self.random.random_range(0..candidates.len());
        let second = self.random.random_range(0..candidates.len());
        candidates[first.max(second)].clone()
    }

    fn uniform(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.random.random::<f32>()
    }

    fn number(&mut self) -> f32 {
        match self.random.random_range(0..20) {
            0 => EXTREME[self.random.random_range(0..EXTREME.len())],
            1..=9 => CONSTANTS[self.random.random_range(0..CONSTANTS.len())],
            _ => normal(&mut self.random, 2.0),
        }
    }

    /// A stored value of a kind, within what Blender allows: colours are not negative.
    fn constant(&mut self, kind: SocketType) -> Json {
        let mut component = |positive: bool| {
            let value = self.number();
            json_number(if positive { value.abs() } else { value })
        };
        match kind {
            SocketType::Color => json!([component(true), component(true), component(true), 1.0]),
            SocketType::Vector => json!([component(false), component(false), component(false)]),
            _ => component(false),
        }
    }

    fn reroute(&mut self, tree: &mut Tree) {
        let source = self.pick(tree, false);
        let name = format!("Reroute {}", self.number);
        // A reroute has the type of what it is linked to.
        tree.nodes.push(json!({
            "name": name, "type": "NodeReroute", "socket_type": source.kind, "inputs": {"Input": source.link},
        }));
        tree.values.push(Value { link: link(&name, "Output"), ..source });
    }

    /// A source: a constant half of the time.
    fn source(&mut self, tree: &mut Tree) {
        let node_type = *self.sources.choose(&mut self.random).expect("Value is a source");
        let node_type = if self.random.random() { &nodes::value::TYPE } else { node_type };
        let name = format!("{} {}", node_type.label, self.number);
        let mut entry = json!({"name": name, "type": node_type.type_name});
        match node_type.type_name {
            "ShaderNodeValue" => entry["outputs"] = json!({"Value": self.constant(SocketType::Float)}),
            "ShaderNodeRGB" => entry["outputs"] = json!({"Color": self.constant(SocketType::Color)}),
            _ => {}
        }
        tree.nodes.push(entry);
        let varies = matches!(node_type.type_name, "ShaderNodeTexCoord" | "ShaderNodeNewGeometry");
        for output in node_type.outputs.iter().filter(|output| source_outputs(node_type).contains(&output.identifier)) {
            tree.values.push(Value { link: link(&name, output.identifier), kind: output.kind, varies });
        }
    }

    fn node(&mut self, tree: &mut Tree) -> Result<()> {
        let node_type = *self.types.choose(&mut self.random).expect("the registry holds nodes that evaluate");
        let properties = self.properties(node_type);
        let mode = Mode::read(node_type, &properties, node_type.label)?;
        let mut inputs = Map::new();
        let mut sources: Vec<(&'static InputSocket, Value)> = Vec::new();
        let mut varies = false;
        for (index, socket) in node_type.inputs_of(&mode).enumerate() {
            let texture = node_type.inputs.iter().any(|socket| socket.generated_when_unlinked);
            if socket.generated_when_unlinked && self.random.random_bool(0.15) {
                // Reads Generated coordinates.
                varies = true;
                continue;
            }
            // Textures with constant inputs only are folded by Blender with another evaluation, equal to
            // 5e-7; here they vary, so that all must be equal.
            let must_vary = texture && index == 0;
            if must_vary || self.random.random_bool(0.6) && !is_expensive(socket) {
                let source = self.pick(tree, must_vary);
                varies |= source.varies;
                inputs.insert(socket.identifier.into(), source.link.clone());
                sources.push((socket, source));
            } else if self.random.random_bool(0.9) {
                inputs.insert(socket.identifier.into(), self.stored(socket));
            }
        }
        let name = format!("{} {}", node_type.label, self.number);
        let mut entry = json!({"name": name, "type": node_type.type_name, "properties": properties, "inputs": inputs});
        for property in node_type.properties {
            if matches!(property.values, PropertyValues::StoredOutput(_)) && self.random.random_bool(0.8) {
                let direction: [Json; 3] = std::array::from_fn(|_| json_number(self.uniform(-1.0, 1.0)));
                entry["outputs"] = json!({property.identifier: direction});
            }
        }
        if self.random.random_bool(0.1)
            && let Some((output, through)) = passed_when_muted(node_type, &mode)
            && let Some((_, source)) = sources.iter().find(|(socket, _)| socket.identifier == through)
        {
            entry["muted"] = true.into();
            entry["bypass"] = json!({output: through});
            let kind = node_type.outputs_of(&mode).next().map_or(source.kind, |output| output.kind);
            tree.nodes.push(entry);
            tree.values.push(Value { link: link(&name, output), kind, varies: source.varies });
            return Ok(());
        }
        tree.nodes.push(entry);
        for output in node_type.outputs_of(&mode) {
            tree.values.push(Value { link: link(&name, output.identifier), kind: output.kind, varies });
            tree.fresh.push(Target::output(&name, output.identifier));
        }
        Ok(())
    }

    /// A value of every property, but for some that keep their defaults.
    fn properties(&mut self, node_type: &NodeType) -> Map<String, Json> {
        let mut properties = Map::new();
        for property in node_type.properties {
            if self.random.random_bool(0.1) {
                continue;
            }
            let value: Json = match &property.values {
                PropertyValues::Choice(names) => names[self.random.random_range(0..names.len())].into(),
                PropertyValues::Flag(_) => self.random.random::<bool>().into(),
                PropertyValues::Integer { limits, probes, .. } => {
                    let low = probes.iter().copied().min().unwrap_or(limits[0]);
                    let high = limits[1].min(low.saturating_add(8));
                    self.random.random_range(low..=high.max(low)).into()
                }
                PropertyValues::Number { limits: [low, high], probes, .. } => match probes.choose(&mut self.random) {
                    Some(&probe) if self.random.random() => json_number(probe),
                    _ => json_number(self.uniform(low.max(-4.0), high.min(4.0))),
                },
                PropertyValues::Data { probes, .. } => match probes().choose(&mut self.random) {
                    Some(probe) => self.varied(probe),
                    None => continue,
                },
                PropertyValues::Other if property.identifier == "texture_mapping" => {
                    if self.random.random_bool(0.9) {
                        continue;
                    }
                    self.texture_mapping()
                }
                PropertyValues::StoredOutput(_) | PropertyValues::Other => continue,
            };
            properties.insert(property.identifier.to_owned(), value);
        }
        properties
    }

    /// A mapping without rotation, whose matrix is exact.
    fn texture_mapping(&mut self) -> Json {
        let vector_type = *["POINT", "VECTOR"].choose(&mut self.random).expect("two");
        let mut three =
            |low: f32, high: f32| -> [Json; 3] { std::array::from_fn(|_| json_number(self.uniform(low, high))) };
        let (translation, scale) = (three(-2.0, 2.0), three(-2.0, 2.0));
        let mut axis = || *["NONE", "X", "Y", "Z"].choose(&mut self.random).expect("four");
        json!({
            "vector_type": vector_type, "translation": translation, "rotation": [0.0, 0.0, 0.0], "scale": scale,
            "mapping_x": axis(), "mapping_y": axis(), "mapping_z": axis(),
        })
    }

    /// A ramp or curves with the structure of `probe` and other numbers: positions and colours of stops, heights of points.
    fn varied(&mut self, probe: &Json) -> Json {
        let mut data = probe.clone();
        if self.random.random_bool(0.3) {
            return data;
        }
        self.vary(&mut data);
        data
    }

    fn vary(&mut self, data: &mut Json) {
        match data {
            Json::Object(fields) => {
                for (name, value) in fields.iter_mut() {
                    match (name.as_str(), &value) {
                        ("color", Json::Array(channels)) => {
                            let count = channels.len();
                            *value = (0..count).map(|_| json_number(self.uniform(0.0, 1.0))).collect();
                        }
                        ("position", Json::Number(_)) if self.random.random() => {
                            *value = json_number(self.uniform(0.0, 1.0));
                        }
                        // Limits of the view: what the points may be, not points.
                        ("clip", _) => {}
                        _ => self.vary(value),
                    }
                }
                // Blender sorts stops by itself; in the file they stand in order.
                if let Some(Json::Array(stops)) = fields.get_mut("elements") {
                    let position = |stop: &Json| stop["position"].as_f64().unwrap_or(0.0);
                    stops.sort_by(|a, b| position(a).total_cmp(&position(b)));
                }
            }
            Json::Array(items) => {
                // A point of a curve: x, y, and perhaps the kind of its handles. Its x keeps the order.
                let is_point = items.len() >= 2 && items.len() <= 3 && items[..2].iter().all(Json::is_number);
                if is_point && items.get(2).is_none_or(Json::is_string) {
                    items[1] = json_number(self.uniform(0.0, 1.0));
                } else {
                    items.iter_mut().for_each(|item| self.vary(item));
                }
            }
            _ => {}
        }
    }

    /// A stored value within the socket's limits.
    fn stored(&mut self, socket: &InputSocket) -> Json {
        if socket.kind.components() == 3 {
            return self.constant(socket.kind);
        }
        let value = match socket.identifier {
            "Detail" => self.uniform(0.0, 4.0),
            "Roughness" | "Randomness" | "Smoothness" | "Anisotropy" | "Mortar Size" | "Mortar Smooth" => {
                self.uniform(0.0, 1.0)
            }
            "Brick Width" | "Row Height" => self.uniform(0.05, 1.0),
            "Lacunarity" => self.uniform(0.0, 4.0),
            "Exponent" => self.uniform(0.1, 8.0),
            "Frequency" => self.uniform(0.1, 8.0),
            "Fac" | "Factor" | "Factor_Float" => self.uniform(-0.25, 1.25),
            "Temperature" => self.uniform(500.0, 13_000.0),
            "Scale" | "Offset" | "Gain" | "Distortion" => self.uniform(-2.0, 5.0),
            _ => self.number(),
        };
        json_number(value)
    }

    /// Uses a group: a new one, or one that was used before.
    fn group(&mut self, tree: &mut Tree) -> Result<()> {
        let allowed = 3 - tree.depth;
        let known: Vec<usize> = (0..self.shared.len()).filter(|&index| self.shared[index].depth < allowed).collect();
        let index = match known.choose(&mut self.random) {
            Some(&index) if self.random.random() => index,
            _ => self.new_group(tree.depth + 1)?,
        };
        let group = self.shared[index].clone();
        let name = format!("Use {}", self.number);
        self.number += 1;
        let mut inputs = Map::new();
        let mut sources: Vec<(String, Value)> = Vec::new();
        for (identifier, kind) in &group.inputs {
            if self.random.random_bool(0.7) {
                let source = self.pick(tree, false);
                inputs.insert(identifier.clone(), source.link.clone());
                sources.push((identifier.clone(), source));
            } else {
                inputs.insert(identifier.clone(), self.constant(*kind));
            }
        }
        let mut entry = json!({"name": name, "type": "ShaderNodeGroup", "group": group.name, "inputs": inputs});
        // Muted, it passes the first linked input of the output's type.
        if let [(output, kind, _)] = group.outputs.as_slice()
            && self.random.random_bool(0.2)
        {
            let first = group
                .inputs
                .iter()
                .find(|(identifier, input)| input == kind && sources.iter().any(|(linked, _)| linked == identifier));
            let source = first.and_then(|(identifier, _)| sources.iter().find(|(linked, _)| linked == identifier));
            if let Some((identifier, source)) = source {
                entry["muted"] = true.into();
                entry["bypass"] = json!({output.as_str(): identifier});
                tree.values.push(Value { link: link(&name, output), kind: *kind, varies: source.varies });
                tree.nodes.push(entry);
                return Ok(());
            }
        }
        tree.nodes.push(entry);
        for (output, kind, varies) in &group.outputs {
            tree.values.push(Value { link: link(&name, output), kind: *kind, varies: *varies });
            tree.fresh.push(Target::output(&name, output));
        }
        Ok(())
    }

    /// Makes a group of a few nodes; returns its number in `shared`.
    fn new_group(&mut self, depth: usize) -> Result<usize> {
        const KINDS: [SocketType; 3] = [SocketType::Float, SocketType::Vector, SocketType::Color];
        let name = format!("Group {}", self.number);
        self.number += 1;
        let attribute = self.random.random_range(0..ATTRIBUTES);
        let mut tree = self.tree(depth, attribute..attribute + 1);
        let output_count = self.random.random_range(1..=3_usize);
        let input_count = self.random.random_range(0..=4_usize);
        let inputs: Vec<(String, SocketType)> = (0..input_count)
            .map(|index| (format!("Socket_{}", output_count + index), KINDS[self.random.random_range(0..KINDS.len())]))
            .collect();
        tree.values.extend(inputs.iter().map(|(identifier, kind)| Value {
            link: json!({"group_input": identifier}),
            kind: *kind,
            varies: false,
        }));
        for _ in 0..self.random.random_range(1..=5) {
            self.add(&mut tree)?;
        }
        let mut ends = Map::new();
        let mut outputs = Vec::new();
        for index in 0..output_count {
            let source = self.pick(&tree, false);
            // Interfaces of other types than the links: constants are converted by them, other values by what reads them.
            let kind = if self.random.random_bool(0.3) {
                KINDS[self.random.random_range(0..KINDS.len())]
            } else {
                source.kind
            };
            let identifier = format!("Socket_{index}");
            ends.insert(identifier.clone(), source.link);
            outputs.push((identifier, kind, source.varies));
        }
        tree.nodes.push(json!({
            "name": "Group Output", "type": "NodeGroupOutput", "properties": {"is_active_output": true}, "inputs": ends,
        }));
        let socket = |identifier: &str, kind: SocketType| {
            // What reads it has the default where a link leads to nothing.
            let default = match kind {
                SocketType::Color => json!([0.25, 0.5, 0.75, 1.0]),
                SocketType::Vector => json!([0.25, 0.5, 0.75]),
                _ => json!(0.25),
            };
            json!({"identifier": identifier, "name": identifier, "type": kind, "default": default})
        };
        self.groups.push(json!({
            "name": name,
            "inputs": inputs.iter().map(|(identifier, kind)| socket(identifier, *kind)).collect::<Vec<_>>(),
            "outputs": outputs.iter().map(|(identifier, kind, _)| socket(identifier, *kind)).collect::<Vec<_>>(),
            "nodes": tree.nodes,
        }));
        let inner = self.shared.iter().filter(|known| uses(&tree, &known.name)).map(|known| known.depth).max();
        self.shared.push(Shared { name, inputs, outputs, depth: 1 + inner.unwrap_or(0) });
        Ok(self.shared.len() - 1)
    }
}

/// Whether a tree uses the group of this name.
fn uses(tree: &Tree, name: &str) -> bool {
    tree.nodes.iter().any(|node| node["group"] == name)
}

/// Linked Details of hundreds would cost minutes and say no more.
fn is_expensive(socket: &InputSocket) -> bool {
    socket.identifier == "Detail"
}

/// The output of a node with one, and the input that it passes when it is muted and that input is linked: the first of its type
/// that is no factor, which Blender does not pass on. None where Blender's choice is another or not known.
fn passed_when_muted(node_type: &'static NodeType, mode: &Mode) -> Option<(&'static str, &'static str)> {
    if node_type.inputs.iter().any(|socket| socket.generated_when_unlinked) {
        return None;
    }
    let mut outputs = node_type.outputs_of(mode);
    let (output, None) = (outputs.next()?, outputs.next()) else { return None };
    let mut inputs = node_type.inputs_of(mode).filter(|socket| !socket.identifier.starts_with("Fac"));
    let first = inputs.next()?;
    (first.kind == output.kind).then_some((output.identifier, first.identifier))
}
