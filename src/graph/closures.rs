//! The closures that a material's Volume is made of, and the one program that feeds them.
//!
//! Add Shader and Mix Shader are resolved: what is left is a sum of closures, each with the factors that mixes
//! put before it. The inputs of all closures are compiled together, so that common parts are evaluated once;
//! an input that turns out constant is a number, any other a column of the program's results.
//!
//! What Blender does, measured: a socket without a closure adds nothing; a muted node passes on what `bypass`
//! says; closures pass through sockets of groups of any type; a value or colour that is linked where a closure
//! belongs emits.

use crate::base::error::{Error, Result};
use crate::graph::flatten::{Flattener, Source, is_link, with_flattener};
use crate::graph::{Operand, Output, Program, Target, passes, target, world};
use crate::nodes::closure::{ClosureRole, VolumeClosure};
use crate::nodes::{self, Mode, NodeType, Role, emission};
use crate::scene::{Graph, Input, Node, Scene, SocketType, Volume};

/// A material may add up this many closures. A chain of additions of a node to itself doubles them each time.
const MOST_CLOSURES: usize = 256;

/// A component of an input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// The same everywhere.
    Constant(f32),
    /// A column of the program's results.
    Column(usize),
}

/// What a Mix Shader multiplies a closure by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factor {
    /// The mix's Fac, not yet clamped to [0, 1].
    pub value: Value,
    /// The closure is the mix's first one: 1 - Fac counts.
    pub complement: bool,
}

/// A closure of the sum.
pub struct Closure {
    /// Place of the node: group names joined by `/`.
    pub label: String,
    /// Its type.
    pub node_type: &'static NodeType,
    /// Its mode.
    pub mode: Mode,
    /// Its formula in that mode.
    pub formula: Box<dyn VolumeClosure>,
    /// Components of its value inputs in socket order.
    pub inputs: Vec<Value>,
    /// Factors of the mixes that it went through.
    pub factors: Vec<Factor>,
}

impl Closure {
    /// Index of the first component of an input among [`Self::inputs`], if it exists in this mode.
    pub fn input(&self, identifier: &str) -> Option<usize> {
        let mut first = 0;
        for socket in self.node_type.inputs_of(&self.mode) {
            if socket.identifier == identifier {
                return Some(first);
            }
            first += socket.kind.components();
        }
        None
    }
}

/// A material's Volume as a sum of closures.
pub struct ClosureSum {
    /// Computes the columns, one output per column.
    pub program: Program,
    /// The closures, without those that a constant factor of 0 removes.
    pub closures: Vec<Closure>,
}

/// A closure before its inputs are compiled.
struct Found {
    label: String,
    node_type: &'static NodeType,
    mode: Mode,
    formula: Box<dyn VolumeClosure>,
    inputs: Vec<Source>,
    factors: Vec<(Source, bool)>,
}

impl ClosureSum {
    /// Compiles the closures of a material for the object that it is on.
    pub fn compile(graph: &Graph, volume: &Volume) -> Result<Self> {
        let (mut flat, found) = with_flattener(graph, volume, |flattener| {
            let output = target::output_with_volume(graph)?;
            flattener.closures_at(output, "Volume")
        })?;
        for closure in &found {
            let sources = closure.inputs.iter().chain(closure.factors.iter().map(|(source, _)| source));
            flat.outputs.push((closure.label.clone(), SocketType::Float, sources.cloned().collect()));
        }
        let mut program = passes::run(flat);
        let mut columns: Vec<Output> = Vec::new();
        let mut closures = Vec::new();
        for (found, output) in found.into_iter().zip(std::mem::take(&mut program.outputs)) {
            let mut values = output.operands.into_iter().map(|operand| column(&mut columns, &found.label, operand));
            let inputs = values.by_ref().take(found.inputs.len()).collect();
            let factors: Vec<Factor> =
                values.zip(&found.factors).map(|(value, &(_, complement))| Factor { value, complement }).collect();
            let vanishes = |factor: &Factor| match factor.value {
                Value::Constant(value) => {
                    if factor.complement {
                        value >= 1.0
                    } else {
                        value <= 0.0
                    }
                }
                Value::Column(_) => false,
            };
            if !factors.iter().any(vanishes) {
                let Found { label, node_type, mode, formula, .. } = found;
                closures.push(Closure { label, node_type, mode, formula, inputs, factors });
            }
        }
        program.outputs = columns;
        Ok(Self { program, closures })
    }
}

/// The value that an operand is, as a column of its own unless it is a constant or has one already.
fn column(columns: &mut Vec<Output>, label: &str, operand: Operand) -> Value {
    if let Operand::Constant(value) = operand {
        return Value::Constant(value);
    }
    let known = columns.iter().position(|column| column.operands[0] == operand);
    Value::Column(known.unwrap_or_else(|| {
        columns.push(Output { name: label.to_owned(), kind: SocketType::Float, operands: vec![operand] });
        columns.len() - 1
    }))
}

impl<'a> Flattener<'a> {
    /// The closures behind an input of an output node of the material's, or the world's, own tree.
    fn closures_at(&mut self, output: &'a Node, end: &str) -> Result<Vec<Found>> {
        let mut found = Vec::new();
        self.closures(0, output, end, &output.inputs[end], &mut Vec::new(), &mut found)?;
        Ok(found)
    }

    /// What a world sends: the sum of its emissions, Color * Strength times the shares of mixes, in the order in which Cycles
    /// multiplies and adds.
    pub(super) fn world_radiance(&mut self) -> Result<Vec<Source>> {
        let output = target::output_with_surface(self.graph)?;
        let mut sum: Option<Vec<Source>> = None;
        for closure in self.closures_at(output, "Surface")? {
            let mut weight = None;
            for (value, complement) in closure.factors {
                let mut share = self.clamped(output, value);
                if complement {
                    share = self.math(0, output, "SUBTRACT", vec![Source::Constant(1.0), share]).remove(0);
                }
                weight = Some(match weight {
                    Some(before) => self.math(0, output, "MULTIPLY", vec![before, share]).remove(0),
                    None => share,
                });
            }
            let mut channels = Vec::new();
            for channel in 0..3 {
                let [color, strength] = [channel, 3].map(|input| closure.inputs[input].clone());
                let mut sent = self.math(0, output, "MULTIPLY", vec![color, strength]);
                if let Some(weight) = &weight {
                    sent = self.math(0, output, "MULTIPLY", vec![sent.remove(0), weight.clone()]);
                }
                if let Some(sum) = &sum {
                    sent = self.math(0, output, "ADD", vec![sum[channel].clone(), sent.remove(0)]);
                }
                channels.append(&mut sent);
            }
            sum = Some(channels);
        }
        Ok(sum.unwrap_or_else(|| vec![Source::Constant(0.0); 3]))
    }

    /// Collects the closures behind an input of `node`; `factors` are those of the mixes on the way.
    fn closures(
        &mut self,
        tree: usize,
        node: &'a Node,
        socket: &str,
        input: &'a Input,
        factors: &mut Vec<(Source, bool)>,
        found: &mut Vec<Found>,
    ) -> Result<()> {
        match input {
            Input::Link { node: name, socket: output } => {
                let from = self.find(tree, name, &format!("{}: input {socket}", self.place(tree, &node.name)))?;
                self.guarded(tree, from, |flattener| flattener.closures_of(tree, from, output, factors, found))
            }
            Input::GroupInput(identifier) => match self.trees[tree].group {
                Some((_, group_node, parent)) => match group_node.inputs.get(identifier) {
                    Some(outside) => self.closures(parent, group_node, identifier, outside, factors, found),
                    None => Ok(()),
                },
                None => Err(Error::new(
                    format!("{}: input {socket}", self.place(tree, &node.name)),
                    format!("group_input \"{identifier}\" outside of a group"),
                    "a link to a closure",
                    "Only nodes of a group can read its inputs.",
                )),
            },
            // A value that a group's socket stores: of a number where a closure belongs.
            Input::Number(value) => self.emitting(tree, node, vec![Source::Constant(*value); 3], factors, found),
            Input::List(values) if values.len() >= 3 => {
                let color = values[..3].iter().map(|&value| Source::Constant(value)).collect();
                self.emitting(tree, node, color, factors, found)
            }
            Input::List(_) | Input::Text(_) => Err(Error::new(
                format!("{}: input {socket}", self.place(tree, &node.name)),
                "a list of fewer than three numbers, or a text",
                "a link to a closure",
                "Correct the value's type.",
            )),
        }
    }

    /// [`Self::closures`] of an output.
    fn closures_of(
        &mut self,
        tree: usize,
        node: &'a Node,
        output: &str,
        factors: &mut Vec<(Source, bool)>,
        found: &mut Vec<Found>,
    ) -> Result<()> {
        if node.muted {
            let through = node.bypass.as_ref().and_then(|bypass| bypass.get(output));
            let passed = through.and_then(|name| Some((name, node.inputs.get(name.as_str())?)));
            let Some((through, input)) = passed.filter(|(_, input)| is_link(input)) else {
                self.note(tree, node, "bypassed", "muted, without a link to pass on: adds nothing");
                return Ok(());
            };
            self.note(tree, node, "bypassed", format!("muted: {output} is {through}"));
            return self.closures(tree, node, through, input, factors, found);
        }
        match node.kind.as_str() {
            "NodeReroute" => match node.inputs.get("Input").filter(|input| is_link(input)) {
                Some(input) => self.closures(tree, node, "Input", input, factors, found),
                None => Ok(()),
            },
            "ShaderNodeGroup" => {
                let inner = self.enter(tree, node)?;
                let group = self.trees[inner].group.expect("an entered group").0;
                let end = group.nodes.iter().find(|node| node.kind == "NodeGroupOutput");
                match end.and_then(|end| Some((end, end.inputs.get(output)?))) {
                    Some((end, input)) => self.closures(inner, end, output, input, factors, found),
                    None => Ok(()),
                }
            }
            _ => {
                let node_type = match self.is_world {
                    true => world::closure_type(node, &self.place(tree, &node.name))?,
                    false => self.node_type(tree, node)?,
                };
                match node_type.role {
                    Role::Closure(role) => self.closure(tree, node, node_type, role, factors, found),
                    _ => {
                        // The node is marked as open already.
                        let Some((kind, sources)) = self.output_unguarded(tree, node, output)? else { return Ok(()) };
                        let color = self.convert(tree, node, kind, SocketType::Color, sources);
                        self.emitting(tree, node, color, factors, found)
                    }
                }
            }
        }
    }

    /// A node that makes or joins closures.
    fn closure(
        &mut self,
        tree: usize,
        node: &'a Node,
        node_type: &'static NodeType,
        role: ClosureRole,
        factors: &mut Vec<(Source, bool)>,
        found: &mut Vec<Found>,
    ) -> Result<()> {
        self.check_inputs(tree, node, node_type)?;
        let place = self.place(tree, &node.name);
        let mode = Mode::read(node_type, &node.properties, &place)?.with_release(self.graph.blender);
        let mut inputs = Vec::new();
        for socket in node_type.inputs_of(&mode).filter(|socket| socket.kind != SocketType::Shader) {
            inputs.extend(self.input(tree, node, socket)?);
        }
        match role {
            ClosureRole::Medium(formula) => {
                self.check_count(place, found)?;
                let (label, formula) = (self.label(tree, &node.name), formula(&mode));
                found.push(Found { label, node_type, mode, formula, inputs, factors: factors.clone() });
                Ok(())
            }
            ClosureRole::Add | ClosureRole::Mix => {
                for (socket, complement) in [("Shader", true), ("Shader_001", false)] {
                    let Some(input) = node.inputs.get(socket) else { continue };
                    if matches!(role, ClosureRole::Mix) {
                        factors.push((inputs[0].clone(), complement));
                    }
                    self.closures(tree, node, socket, input, factors, found)?;
                    if matches!(role, ClosureRole::Mix) {
                        factors.pop();
                    }
                }
                Ok(())
            }
        }
    }

    /// Refuses one closure more than [`MOST_CLOSURES`].
    fn check_count(&self, place: String, found: &[Found]) -> Result<()> {
        if found.len() < MOST_CLOSURES {
            return Ok(());
        }
        Err(Error::new(
            place,
            format!("more than {MOST_CLOSURES} closures in one material"),
            format!("at most {MOST_CLOSURES}, counted once for every way to the Material Output"),
            "Use fewer Add Shader and Mix Shader nodes.",
        ))
    }

    /// A colour where a closure belongs.
    fn emitting(
        &mut self,
        tree: usize,
        node: &Node,
        color: Vec<Source>,
        factors: &[(Source, bool)],
        found: &mut Vec<Found>,
    ) -> Result<()> {
        self.note(tree, node, "converted", "a value where a closure belongs: emits");
        let place = self.place(tree, &node.name);
        self.check_count(place.clone(), found)?;
        let mode = Mode::read(&emission::TYPE, &serde_json::Map::new(), &place)?;
        found.push(Found {
            label: self.label(tree, &node.name),
            node_type: &emission::TYPE,
            mode,
            formula: Box::new(emission::Emission),
            inputs: color.into_iter().chain([Source::Constant(1.0)]).collect(),
            factors: factors.to_vec(),
        });
        Ok(())
    }
}

// ---------------------------------------------------------------------------------------------------------------------
// Closures as targets

/// [`target::density`] where one closure closes the graph; else what its closures read, each by itself: of every closure Density and the
/// inputs that are linked, of every Mix Shader a linked factor, and the output of what emits because it is linked where a closure belongs.
pub fn targets(scene: &Scene) -> Result<Vec<Target>> {
    let closing = target::density(scene);
    if closing.is_ok() {
        return closing.map(|only| vec![only]);
    }
    // Rings, and more closures than a material may have, are errors of this.
    ClosureSum::compile(scene.graph(), &scene.volume)?;
    let graph = scene.graph();
    let mut walk = ClosureWalk { graph, trees: vec![(&graph.nodes, None)], groups: Vec::new(), found: Vec::new() };
    walk.follow(target::output_with_volume(graph)?.inputs.get("Volume"))?;
    if walk.found.is_empty() { closing.map(|only| vec![only]) } else { Ok(walk.found) }
}

/// The one of [`targets`]; several are an error that lists them.
pub fn only_target(scene: &Scene) -> Result<Target> {
    let mut found = targets(scene)?;
    if let [_] = found.as_slice() {
        return Ok(found.remove(0));
    }
    let names: Vec<String> = found.iter().map(Target::name).collect();
    Err(Error::new(
        format!("material {}", scene.graph().material),
        "several closures, each with inputs of its own",
        format!("one of {}", names.join(", ")),
        "Name it as NODE.SOCKET of the node that is linked there.",
    )
    .with_setting("target"))
}

/// A walk from the Material Output to all closures.
struct ClosureWalk<'a> {
    graph: &'a Graph,
    /// From the material's tree to that of the group where the walk is, each with the node that calls it.
    trees: Vec<(&'a [Node], Option<&'a Node>)>,
    /// Names of the group nodes.
    groups: Vec<String>,
    found: Vec<Target>,
}

impl<'a> ClosureWalk<'a> {
    fn note(&mut self, target: Target) {
        let target = Target { groups: self.groups.clone(), ..target };
        if !self.found.contains(&target) {
            self.found.push(target);
        }
    }

    /// Goes on at what an input is linked to.
    fn follow(&mut self, input: Option<&'a Input>) -> Result<()> {
        match input {
            Some(Input::Link { node, socket }) => {
                let (nodes, _) = *self.trees.last().expect("the material's own tree is never left");
                match nodes.iter().find(|candidate| candidate.name == *node) {
                    Some(node) => self.visit(node, socket),
                    None => Ok(()),
                }
            }
            Some(Input::GroupInput(identifier)) if self.trees.len() > 1 => {
                let inner = self.trees.pop().expect("there are several");
                let name = self.groups.pop().expect("a group has a node");
                let caller = inner.1.expect("a group has a node");
                let done = self.follow(caller.inputs.get(identifier));
                self.trees.push(inner);
                self.groups.push(name);
                done
            }
            _ => Ok(()),
        }
    }

    fn visit(&mut self, node: &'a Node, socket: &str) -> Result<()> {
        if node.muted {
            let through = node.bypass.as_ref().and_then(|bypass| bypass.get(socket));
            return self.follow(through.and_then(|name| node.inputs.get(name.as_str())));
        }
        if node.kind == "NodeReroute" {
            return self.follow(node.inputs.get("Input"));
        }
        if let Some(group) = node.group.as_ref().and_then(|name| self.graph.group(name)) {
            let end = group.nodes.iter().find(|node| node.kind == "NodeGroupOutput");
            self.trees.push((&group.nodes, Some(node)));
            self.groups.push(node.name.clone());
            let done = self.follow(end.and_then(|end| end.inputs.get(socket)));
            self.trees.pop();
            self.groups.pop();
            return done;
        }
        let Some(node_type) = nodes::find(&node.kind) else { return Ok(()) };
        let Role::Closure(role) = &node_type.role else {
            self.note(Target::output(&node.name, socket));
            return Ok(());
        };
        let mode = Mode::read(node_type, &node.properties, &format!("node {}", node.name))?;
        for input in node_type.inputs_of(&mode).filter(|input| input.kind != SocketType::Shader) {
            let is_linked =
                matches!(node.inputs.get(input.identifier), Some(Input::Link { .. } | Input::GroupInput(_)));
            if is_linked || input.identifier == "Density" {
                self.note(Target::input(&node.name, input.identifier));
            }
        }
        if matches!(role, ClosureRole::Add | ClosureRole::Mix) {
            self.follow(node.inputs.get("Shader"))?;
            self.follow(node.inputs.get("Shader_001"))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bare_scene;
    use serde_json::json;

    /// Scatter and Absorption added, the second by a factor of a Mix Shader in a group, whose output has the identifier of an old file.
    fn scene() -> Scene {
        let graph = json!({
            "material": "Material",
            "nodes": [
                {"name": "Output", "type": "ShaderNodeOutputMaterial", "inputs": {"Volume": {"node": "Add", "socket": "Shader"}}},
                {
                    "name": "Add", "type": "ShaderNodeAddShader",
                    "inputs": {
                        "Shader": {"node": "Scatter", "socket": "Volume"}, "Shader_001": {"node": "Group", "socket": "Output_3"},
                    },
                },
                {"name": "Scatter", "type": "ShaderNodeVolumeScatter", "inputs": {"Density": {"node": "Noise", "socket": "Fac"}}},
                {"name": "Noise", "type": "ShaderNodeTexNoise", "inputs": {"Vector": {"node": "Place", "socket": "Object"}}},
                {"name": "Place", "type": "ShaderNodeTexCoord"},
                {"name": "Group", "type": "ShaderNodeGroup", "group": "Old", "inputs": {"Input_1": {"node": "Noise", "socket": "Fac"}}},
            ],
            "groups": [{
                "name": "Old",
                "inputs": [{"identifier": "Input_1", "name": "Amount", "panel": null, "type": "float", "default": 0.5}],
                "outputs": [
                    {"identifier": "Output_3", "name": "Medium", "panel": null, "type": "shader"},
                    {"identifier": "Output_4", "name": "Twice", "panel": null, "type": "float", "default": 0.0},
                    {"identifier": "Output_5", "name": "Same", "panel": null, "type": "float", "default": 0.0},
                    {"identifier": "Output_6", "name": "Same", "panel": null, "type": "float", "default": 0.0},
                ],
                "nodes": [
                    {
                        "name": "End", "type": "NodeGroupOutput",
                        "inputs": {
                            "Output_3": {"node": "Mix", "socket": "Shader"}, "Output_4": {"node": "Double", "socket": "Value"},
                            "Output_5": 0.0, "Output_6": 0.0,
                        },
                    },
                    {
                        "name": "Mix", "type": "ShaderNodeMixShader",
                        "inputs": {"Fac": {"group_input": "Input_1"}, "Shader_001": {"node": "Absorption", "socket": "Volume"}},
                    },
                    {"name": "Absorption", "type": "ShaderNodeVolumeAbsorption", "inputs": {"Density": 2.0}},
                    {
                        "name": "Double", "type": "ShaderNodeMath", "properties": {"operation": "MULTIPLY"},
                        "inputs": {"Value": {"group_input": "Input_1"}, "Value_001": 2.0},
                    },
                ],
            }],
        });
        bare_scene("targets", graph).expect("a scene")
    }

    #[test]
    fn several_closures_are_targets_each() {
        let scene = scene();
        let names: Vec<String> = targets(&scene).expect("targets").iter().map(Target::name).collect();
        assert_eq!(names, ["Scatter.Density", "Group/Mix.Fac", "Group/Absorption.Density"]);
        let error = only_target(&scene).expect_err("no single density").to_string();
        assert!(error.contains("Scatter.Density, Group/Mix.Fac, Group/Absorption.Density"), "{error}");
        Program::compile(&scene, &targets(&scene).expect("targets")).expect("they compile");
    }

    #[test]
    fn a_group_output_is_named_by_identifier_or_by_name() {
        let scene = scene();
        let target = |text: &str| Target::parse(text, scene.graph());
        let by_identifier = target("Group.Output_4").expect("an identifier");
        assert_eq!(target("Group.Twice").expect("a name"), by_identifier);
        assert_eq!(by_identifier.output.as_deref(), Some("Output_4"));
        let missing = target("Group.Socket_0").expect_err("a later file's identifier").to_string();
        assert!(missing.contains("Output_4 (Twice)"), "{missing}");
        let ambiguous = target("Group.Same").expect_err("two have it").to_string();
        assert!(ambiguous.contains("2 outputs named") && ambiguous.contains("Output_6 (Same)"), "{ambiguous}");
        assert_eq!(target("Group/Double.Value").expect("inside").groups, ["Group"]);
    }
}
