//! From the node graph of a scene file to a program that evaluates.
//!
//! `flatten` inlines groups, follows reroutes and muted nodes and inserts conversions; the passes
//! in `passes` fold constants by Blender's rules, merge equal nodes and drop what the targets do
//! not reach; [`Program`] is what is left, in evaluation order. [`evaluate`] runs it on the CPU,
//! [`wgsl`] writes it as a shader, [`bounds`] encloses it over a box. [`closures`] compiles everything that a
//! medium needs into one program.

pub mod bounds;
pub mod bounds_check;
pub mod build;
pub mod closures;
pub mod constants;
pub mod evaluate;
mod flatten;
mod passes;
pub mod target;
pub mod wgsl;
pub mod world;
mod world_coordinates;
mod zero_signs;

pub use target::Target;

use crate::base::error::Result;
use crate::base::files;
use crate::nodes::{Mode, NodeEvaluator, NodeType, Nudge};
use crate::scene::{Scene, SocketType};

/// Where a scalar component comes from.
#[derive(Debug, Clone, PartialEq)]
pub enum Operand {
    /// A number.
    Constant(f32),
    /// Component 0 to 2 of the object-space position.
    Position(usize),
    /// Component of a per-point attribute, by its number in [`Program::attributes`].
    Attribute(usize, usize),
    /// A component that an instruction computes.
    Register(usize),
}

/// One node of the program.
pub struct Instruction {
    /// Place of the node: group names joined by `/`.
    pub label: String,
    /// The node's type.
    pub node_type: &'static NodeType,
    /// Its mode, with the wanted outputs.
    pub mode: Mode,
    /// Components of the existing inputs, in socket order.
    pub inputs: Vec<Operand>,
    /// Registers of the wanted outputs' components: the first, counted upwards.
    pub first_register: usize,
    /// Wanted outputs: identifier, kind.
    pub outputs: Vec<(&'static str, SocketType)>,
    /// The evaluator.
    pub evaluator: Box<dyn NodeEvaluator>,
}

impl Instruction {
    /// Number of output components.
    pub fn components(&self) -> usize {
        self.outputs.iter().map(|(_, kind)| kind.components()).sum()
    }
}

/// A value that the program computes.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// The target that asked for it.
    pub name: String,
    /// Kind of value.
    pub kind: SocketType,
    /// Its components.
    pub operands: Vec<Operand>,
}

/// A specialised graph.
#[derive(Clone)]
pub struct Program {
    /// Nodes in evaluation order.
    pub instructions: Vec<Instruction>,
    /// Values asked for.
    pub outputs: Vec<Output>,
    /// Names of the per-point attributes that it reads.
    pub attributes: Vec<String>,
    /// Number of registers.
    pub registers: usize,
    /// What the passes did, for `cloudparity explain`.
    pub notes: Vec<Note>,
    /// Textures with constant inputs that were folded by our arithmetic: Blender has functions of its own for them, and the scene file
    /// stores no value of Blender for these inputs.
    pub folded_textures: Vec<FoldedTexture>,
}

/// A texture whose inputs are constant, and which Blender folds.
#[derive(Clone)]
pub struct FoldedTexture {
    /// The group whose tree it is in; none for the material's own.
    pub group: Option<String>,
    /// Name of the node in that tree.
    pub node: String,
    /// Its type.
    pub node_type: &'static NodeType,
    /// Its mode.
    pub mode: Mode,
    /// Components of the inputs.
    pub inputs: Vec<f32>,
}

/// One thing that a pass did.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Note {
    /// Place of the node.
    pub node: String,
    /// Blender's type.
    pub node_type: String,
    /// What happened: inlined, folded, simplified, merged, dropped, converted, bypassed, replaced.
    pub action: &'static str,
    /// The reason, with the value or the other node's place.
    pub reason: String,
}

impl Program {
    /// A hash of all that its values depend on: types and modes of its nodes, constants to the bit, links, outputs.
    pub fn content_hash(&self) -> String {
        let operands = |operands: &[Operand]| -> String {
            operands
                .iter()
                .map(|operand| match operand {
                    Operand::Constant(value) => format!("c{:08x} ", value.to_bits()),
                    other => format!("{other:?} "),
                })
                .collect()
        };
        let mut text = String::new();
        for node in &self.instructions {
            let Instruction { node_type, mode, inputs, first_register, .. } = node;
            text += &format!("{} {mode:?} {} r{first_register}\n", node_type.type_name, operands(inputs));
        }
        for output in &self.outputs {
            text += &format!("{:?} {}\n", output.kind, operands(&output.operands));
        }
        files::sha256(text.as_bytes())
    }

    /// Compiles the graph of `scene` for these targets.
    pub fn compile(scene: &Scene, targets: &[Target]) -> Result<Self> {
        let flat = flatten::flatten(scene.graph(), &scene.volume, targets)?;
        Ok(passes::run(flat))
    }

    /// [`Self::compile`] with the constants that are folded under a nudge: for evaluation under the same.
    pub fn compile_nudged(scene: &Scene, targets: &[Target], nudge: Nudge) -> Result<Self> {
        let flat = flatten::flatten(scene.graph(), &scene.volume, targets)?;
        Ok(passes::run_nudged(flat, Some(nudge)))
    }

    /// Compiles the density of the scene's volume.
    pub fn density(scene: &Scene) -> Result<Self> {
        Self::compile(scene, &[target::density(scene)?])
    }

    /// Number of output components over all outputs.
    pub fn output_components(&self) -> usize {
        self.outputs.iter().map(|output| output.operands.len()).sum()
    }
}
