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
use crate::graph::{Operand, Output, Program, passes, target, world};
use crate::nodes::closure::{ClosureRole, VolumeClosure};
use crate::nodes::{Mode, NodeType, Role, emission};
use crate::scene::{Graph, Input, Node, SocketType, Volume};

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
