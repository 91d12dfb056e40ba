//! Programs that are not compiled from a graph: one node at an affine image of the position.

use crate::base::texture::TextureHandle;
use crate::graph::{Instruction, Operand, Output, Program};
use crate::nodes::{Mode, NodeType, Role, affine, math, texture_lookup};
use crate::scene::SocketType;

/// The position itself as rows of an affine image.
pub const IDENTITY: [[f32; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

impl Program {
    /// The same number everywhere.
    pub fn constant(name: &str, value: f32) -> Self {
        let output = Output { name: name.into(), kind: SocketType::Float, operands: vec![Operand::Constant(value)] };
        Self {
            instructions: Vec::new(),
            outputs: vec![output],
            attributes: Vec::new(),
            registers: 0,
            notes: Vec::new(),
            folded_textures: Vec::new(),
        }
    }

    /// The value of a texture whose index is an affine image of the position: rows of four.
    pub fn of_texture(name: &str, texture: TextureHandle, to_index: [[f32; 4]; 3]) -> Self {
        Self::of_node(name, &texture_lookup::TYPE, mode(&texture_lookup::TYPE).with_texture(texture), to_index)
    }

    /// The first output of a node whose first input is a vector, an affine image of the position (rows of four); others have their defaults.
    ///
    /// # Panics
    /// Where the node begins with another input, or does not evaluate: a mistake of the caller.
    pub fn of_node(name: &str, node_type: &'static NodeType, mode: Mode, to_input: [[f32; 4]; 3]) -> Self {
        let mut program = Self::constant(name, 0.0);
        let position = [0, 1, 2].map(Operand::Position);
        let inputs = if to_input == IDENTITY {
            position.to_vec()
        } else {
            let mut inputs = position.to_vec();
            for column in 0..4 {
                inputs.extend(to_input.iter().map(|row| Operand::Constant(row[column])));
            }
            program.push("place", &affine::TYPE, self::mode(&affine::TYPE), inputs)
        };
        let mut inputs = inputs;
        let others = node_type.inputs_of(&mode).skip(1).flat_map(|socket| socket.default);
        inputs.extend(others.map(|&value| Operand::Constant(value)));
        let output = node_type.outputs_of(&mode).next().expect("a node has an output");
        let (identifier, kind) = (output.identifier, output.kind);
        let operands = program.push(name, node_type, mode.with_wanted(vec![identifier]), inputs);
        program.outputs = vec![Output { name: name.into(), kind, operands }];
        program
    }

    /// The same program with its only number multiplied by a factor.
    ///
    /// # Panics
    /// Where it has another number of outputs: a mistake of the caller.
    pub fn scaled(&self, factor: f32) -> Self {
        let mut program = self.clone();
        let [Output { operands, .. }] = self.outputs.as_slice() else { panic!("a program of one number") };
        let [value] = operands.as_slice() else { panic!("a program of one number") };
        let properties = serde_json::json!({"operation": "MULTIPLY"});
        let properties = properties.as_object().expect("it is written so");
        let mode = Mode::read(&math::TYPE, properties, math::TYPE.label).expect("Math multiplies");
        let wanted = math::TYPE.outputs_of(&mode).map(|output| output.identifier).collect();
        let inputs = vec![value.clone(), Operand::Constant(factor)];
        program.outputs[0].operands = program.push("factor", &math::TYPE, mode.with_wanted(wanted), inputs);
        program
    }

    /// The same program with other numbers for its constants that are not 0, in the order in which a linker writes them.
    ///
    /// # Panics
    /// Where there are not as many: a mistake of the caller.
    pub fn with_constants(&self, numbers: &[f32]) -> Self {
        let mut program = self.clone();
        let mut numbers = numbers.iter();
        let inputs = program.instructions.iter_mut().flat_map(|node| node.inputs.iter_mut());
        for operand in inputs.chain(program.outputs.iter_mut().flat_map(|output| output.operands.iter_mut())) {
            if let Operand::Constant(value) = operand
                && *value != 0.0
            {
                *value = *numbers.next().expect("a number for each constant");
            }
        }
        assert!(numbers.next().is_none(), "a constant for each number");
        program
    }

    /// Adds an instruction, and gives its outputs' components.
    fn push(&mut self, label: &str, node_type: &'static NodeType, mode: Mode, inputs: Vec<Operand>) -> Vec<Operand> {
        let Role::Evaluated(build) = node_type.role else { panic!("{} does not evaluate", node_type.label) };
        let components: usize = node_type.inputs_of(&mode).map(|socket| socket.kind.components()).sum();
        assert_eq!(components, inputs.len(), "inputs of {}", node_type.label);
        let outputs = node_type.outputs_of(&mode).filter(|output| mode.wants(output.identifier));
        let outputs = outputs.map(|output| (output.identifier, output.kind)).collect();
        let evaluator = build(&mode);
        let first_register = self.registers;
        let instruction =
            Instruction { label: label.into(), node_type, mode, inputs, first_register, outputs, evaluator };
        self.registers += instruction.components();
        self.instructions.push(instruction);
        (first_register..self.registers).map(Operand::Register).collect()
    }
}

impl Clone for Instruction {
    fn clone(&self) -> Self {
        let Role::Evaluated(build) = self.node_type.role else { unreachable!("an instruction evaluates") };
        Self {
            label: self.label.clone(),
            node_type: self.node_type,
            mode: self.mode.clone(),
            inputs: self.inputs.clone(),
            first_register: self.first_register,
            outputs: self.outputs.clone(),
            evaluator: build(&self.mode),
        }
    }
}

/// A node's mode with its defaults, all outputs wanted.
fn mode(node_type: &'static NodeType) -> Mode {
    let mode = Mode::read(node_type, &serde_json::Map::new(), node_type.label).expect("defaults are legal");
    let outputs = node_type.outputs_of(&mode).map(|output| output.identifier).collect();
    mode.with_wanted(outputs)
}
