//! The renders that say what a node costs in Cycles.
//!
//! A render of a few cheap nodes costs no more than its spread. So a graph here holds many copies of a node, every point is
//! evaluated several times, and all outputs are summed into one socket per kind, which alone leaves the graph. The same graph
//! without the node sums what its copies read instead of what they put out; both hold the same additions. The difference is the
//! node and the implicit conversions of its outputs.

use crate::base::error::Result;
use crate::graph::Target;
use crate::measure::nodes::suite::{attribute_name, attribute_nodes, normal};
use crate::nodes::{Mode, NodeType};
use crate::scene::bare_scene;
use crate::scene::{Scene, SocketType};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Map, Value as Json, json};

/// Attributes of the mesh.
const ATTRIBUTES: usize = 4;

/// Copies of the node in a graph: the fewest that are enough.
const COPIES: [usize; 4] = [4, 8, 16, 32];

/// Evaluations of a point in a render.
const SAMPLES: [usize; 4] = [1, 4, 16, 64];

/// Nanoseconds of all copies at a point that are enough, by the node's cost here.
const ENOUGH: f64 = 400.0;

/// Seconds of a render that are enough, by the node's cost here.
const ENOUGH_SECONDS: f64 = 0.05;

/// One graph and the socket of each kind that sums it.
#[derive(PartialEq)]
pub(super) struct Render {
    pub(super) scene: Scene,
    pub(super) targets: Vec<Target>,
    pub(super) samples: usize,
    /// Whether attributes are colours.
    pub(super) colours: bool,
}

/// The two graphs of a mode.
pub(super) struct Renders {
    pub(super) copies: usize,
    pub(super) with: Render,
    pub(super) without: Render,
}

/// Sums of a graph under construction.
struct Sums {
    nodes: Vec<Json>,
    float: Option<Json>,
    vector: Option<Json>,
    /// Number of the next addition.
    number: usize,
}

impl Renders {
    /// `nanoseconds` is about what a point of the node costs.
    pub(super) fn new(
        node_type: &'static NodeType,
        properties: &Map<String, Json>,
        nanoseconds: f64,
        points: usize,
    ) -> Result<Self> {
        let mode = Mode::read(node_type, properties, node_type.label)?;
        let is_enough = |copies: &usize| *copies as f64 * nanoseconds >= ENOUGH;
        let copies = COPIES.into_iter().find(is_enough).unwrap_or(COPIES[COPIES.len() - 1]);
        let seconds = copies as f64 * nanoseconds * points as f64 * 1e-9;
        let is_enough = |samples: &usize| *samples as f64 * seconds >= ENOUGH_SECONDS;
        let samples = SAMPLES.into_iter().find(is_enough).unwrap_or(SAMPLES[SAMPLES.len() - 1]);
        let colours =
            !is_texture(node_type) && node_type.inputs_of(&mode).any(|socket| socket.kind == SocketType::Color);
        let render = |with_node: bool| -> Result<Render> {
            let (scene, targets) = graph(node_type, &mode, with_node.then_some(properties), copies, colours)?;
            Ok(Render { scene, targets, samples, colours })
        };
        Ok(Self { copies, with: render(true)?, without: render(false)? })
    }
}

/// Whether only coordinates are linked, the other inputs keeping Blender's defaults.
pub(super) fn is_texture(node_type: &NodeType) -> bool {
    node_type.type_name.contains("Tex")
}

/// Values of the attributes: colours in [0, 1], coordinates of deviation 3.
pub(super) fn attributes(colours: bool, points: usize) -> Vec<(String, Vec<[f32; 3]>)> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let mut component = || if colours { random.random() } else { normal(&mut random, 3.0) };
    let mut draw = || (0..points).map(|_| std::array::from_fn(|_| component())).collect();
    (0..ATTRIBUTES).map(|number| (attribute_name(number), draw())).collect()
}

fn link(node: &str, socket: &str) -> Json {
    json!({"node": node, "socket": socket})
}

fn is_vector(kind: SocketType) -> bool {
    kind.components() == 3
}

/// Names of what the copies read: attributes scaled and moved by numbers of their own, so that no two copies are the same node.
fn sources(number: usize) -> [String; 2] {
    [format!("Float {number}"), format!("Vector {number}")]
}

fn source_nodes(number: usize, colours: bool) -> [Json; 2] {
    let [float, vector] = sources(number);
    let attribute = number % ATTRIBUTES;
    // Between 1/2 and 1, and never 1, which would fold.
    let factor = 0.5 + 0.5 / (number + 2) as f32;
    // Spread evenly, by the golden ratio; colours stay in [0, 1].
    let place = ((number + 1) as f32 * 0.618_034).fract();
    let offset = if colours { (1.0 - factor) * place } else { 3.0 * place - 1.5 };
    let inputs = |source: Json, factor: Json, offset: Json, names: [&str; 3]| json!({names[0]: source, names[1]: factor, names[2]: offset});
    [
        json!({
            "name": float, "type": "ShaderNodeMath", "properties": {"operation": "MULTIPLY_ADD"},
            "inputs": inputs(
                link(&format!("Separate {attribute}"), "X"),
                json!(factor),
                json!(offset),
                ["Value", "Value_001", "Value_002"],
            ),
        }),
        json!({
            "name": vector, "type": "ShaderNodeVectorMath", "properties": {"operation": "MULTIPLY_ADD"},
            "inputs": inputs(
                link(&format!("Attribute {attribute}"), "Vector"),
                json!([factor, factor, factor]),
                json!([offset, offset, offset]),
                ["Vector", "Vector_001", "Vector_002"],
            ),
        }),
    ]
}

impl Sums {
    fn add(&mut self, kind: SocketType, value: Json) {
        self.number += 1;
        let name = format!("Sum {}", self.number);
        let (sum, kind, inputs, output) = match is_vector(kind) {
            true => (&mut self.vector, "ShaderNodeVectorMath", ["Vector", "Vector_001"], "Vector"),
            false => (&mut self.float, "ShaderNodeMath", ["Value", "Value_001"], "Value"),
        };
        let Some(known) = sum.take() else {
            *sum = Some(value);
            return;
        };
        self.nodes.push(json!({
            "name": name, "type": kind, "properties": {"operation": "ADD"},
            "inputs": {inputs[0]: known, inputs[1]: value},
        }));
        *sum = Some(link(&name, output));
    }
}

/// The graph with this many copies of a node of these properties, or without them, in the order of evaluation: few values wait
/// for their readers.
fn graph(
    node_type: &'static NodeType,
    mode: &Mode,
    properties: Option<&Map<String, Json>>,
    copies: usize,
    colours: bool,
) -> Result<(Scene, Vec<Target>)> {
    let inputs: Vec<_> = node_type
        .inputs_of(mode)
        .filter(|socket| !is_texture(node_type) || matches!(socket.identifier, "Vector" | "W"))
        .collect();
    let is_read = |vector: bool| inputs.iter().any(|socket| is_vector(socket.kind) == vector);
    // Whose sources the graph without the node would lack: those that take the place of no output.
    let is_lost =
        |vector: bool| is_read(vector) && !node_type.outputs_of(mode).any(|socket| is_vector(socket.kind) == vector);
    let mut sums =
        Sums { nodes: (0..ATTRIBUTES).flat_map(attribute_nodes).collect(), float: None, vector: None, number: 0 };
    sums.nodes.extend((0..inputs.len().min(copies)).flat_map(|number| source_nodes(number, colours)));
    for copy in 0..copies {
        if copy + inputs.len() < copies {
            sums.nodes.extend(source_nodes(copy + inputs.len(), colours));
        }
        let [float, vector] = sources(copy);
        let [float, vector] = [link(&float, "Value"), link(&vector, "Vector")];
        if is_lost(false) {
            sums.add(SocketType::Float, float.clone());
        }
        if is_lost(true) {
            sums.add(SocketType::Vector, vector.clone());
        }
        let name = format!("Copy {copy}");
        if let Some(properties) = properties {
            let linked: Map<String, Json> = inputs
                .iter()
                .enumerate()
                .map(|(number, socket)| {
                    let [float, vector] = sources((copy + number) % copies);
                    let source = if is_vector(socket.kind) { link(&vector, "Vector") } else { link(&float, "Value") };
                    (socket.identifier.to_owned(), source)
                })
                .collect();
            sums.nodes
                .push(json!({"name": name, "type": node_type.type_name, "properties": properties, "inputs": linked}));
        }
        for output in node_type.outputs_of(mode) {
            let value = match (properties, is_vector(output.kind)) {
                (Some(_), _) => link(&name, output.identifier),
                // What no copy reads is not scaled for every copy either.
                (None, true) if !is_read(true) => link(&format!("Attribute {}", copy % ATTRIBUTES), "Vector"),
                (None, false) if !is_read(false) => link(&format!("Separate {}", copy % ATTRIBUTES), "X"),
                (None, true) => vector.clone(),
                (None, false) => float.clone(),
            };
            sums.add(output.kind, value);
        }
    }
    let targets = [&sums.float, &sums.vector]
        .into_iter()
        .flatten()
        .map(|sum| Target::output(sum["node"].as_str().unwrap_or_default(), sum["socket"].as_str().unwrap_or_default()))
        .collect();
    Ok((bare_scene("costs", json!({"material": "Material", "nodes": sums.nodes, "groups": []}))?, targets))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::graph::Program;

    #[test]
    fn nothing_is_merged_or_left_out() {
        let properties = json!({"operation": "MULTIPLY_ADD"});
        let properties = properties.as_object().expect("an object");
        let renders = Renders::new(&crate::nodes::math::TYPE, properties, 1.0, 16_384).expect("graphs");
        let count = |render: &Render| {
            Program::compile(&render.scene, &render.targets).expect("a graph that compiles").instructions.len()
        };
        assert_eq!((renders.copies, renders.with.samples), (32, 64));
        assert_eq!(count(&renders.with), count(&renders.without) + renders.copies);
    }
}
