//! Passes on the flat graph: fold constants, simplify, merge equal nodes, drop what is not reached,
//! number the registers.

use super::flatten::{Flat, Source};
use super::{Instruction, Note, Operand, Output, Program};
use crate::nodes::{Column, Kernel, Mode, NodeType, Role, Simplified};
use std::collections::HashMap;

/// A node after the first pass: what its output components are now.
struct Kept {
    label: String,
    node_type: &'static NodeType,
    mode: Mode,
    inputs: Vec<Source>,
}

fn kernel_of(node_type: &NodeType, mode: &Mode) -> Box<dyn Kernel> {
    match node_type.role {
        Role::Evaluated(build) => build(mode),
        _ => unreachable!("the flat graph holds evaluated nodes only"),
    }
}

fn components(node_type: &'static NodeType, mode: &Mode) -> usize {
    node_type.outputs_of(mode).map(|output| output.kind.components()).sum()
}

pub(super) fn run(flat: Flat) -> Program {
    let Flat { nodes, mut outputs, attributes, mut notes } = flat;
    // replaced[n]: what each output component of flat node n turned into.
    let mut replaced: Vec<Vec<Source>> = Vec::with_capacity(nodes.len());
    let mut kept: Vec<Kept> = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    for node in nodes {
        let inputs: Vec<Source> = node.inputs.iter().map(|source| follow(&replaced, source)).collect();
        let mut note = |action: &'static str, reason: String| {
            notes.push(Note {
                node: node.label.clone(),
                node_type: node.node_type.type_name.to_owned(),
                action,
                reason,
            });
        };
        let kernel = kernel_of(node.node_type, &node.mode);
        let constants: Vec<Option<f32>> = inputs.iter().map(as_constant).collect();
        let count = components(node.node_type, &node.mode);
        if let Some(values) = constants.iter().copied().collect::<Option<Vec<f32>>>() {
            // What only a simplification made constant, Blender has not folded: Cycles evaluates it.
            let own_rule = if node.constant { kernel.fold(&values) } else { None };
            let values = own_rule.unwrap_or_else(|| evaluate(kernel.as_ref(), &values, count));
            note("folded", format!("constant inputs: {}", list(&values)));
            replaced.push(values.into_iter().map(Source::Constant).collect());
            continue;
        }
        match kernel.simplify(&constants) {
            Some(Simplified::Inputs(indices)) => {
                if !node.node_type.properties.is_empty() {
                    note("simplified", "a neutral constant: passes its other input on".into());
                }
                replaced.push(indices.into_iter().map(|index| inputs[index].clone()).collect());
                continue;
            }
            Some(Simplified::Constant(values)) => {
                note("simplified", format!("an absorbing constant: {}", list(&values)));
                replaced.push(values.into_iter().map(Source::Constant).collect());
                continue;
            }
            None => {}
        }
        let key = format!("{} {:?} {}", node.node_type.type_name, node.mode, bits(&inputs));
        let number = *known.entry(key).or_insert_with(|| {
            kept.push(Kept { label: node.label.clone(), node_type: node.node_type, mode: node.mode, inputs });
            kept.len() - 1
        });
        if kept[number].label != node.label {
            note("merged", format!("equal to {}", kept[number].label));
        }
        replaced.push((0..count).map(|component| Source::Node(number, component)).collect());
    }
    for (_, _, sources) in &mut outputs {
        for source in sources {
            *source = follow(&replaced, source);
        }
    }
    // Components of kept nodes that are reached, from the outputs backwards.
    let mut reached: Vec<Vec<bool>> =
        kept.iter().map(|node| vec![false; components(node.node_type, &node.mode)]).collect();
    let mut mark = |source: &Source| {
        if let Source::Node(node, component) = source {
            reached[*node][*component] = true;
        }
    };
    outputs.iter().flat_map(|(_, _, sources)| sources).for_each(&mut mark);
    for number in (0..kept.len()).rev() {
        if reached[number].iter().any(|&flag| flag) {
            for source in &kept[number].inputs {
                if let Source::Node(node, component) = source {
                    reached[*node][*component] = true;
                }
            }
        }
    }
    // Registers and kernels for the reached nodes only.
    let mut registers = 0;
    let mut register_of: Vec<Vec<Option<usize>>> = Vec::new();
    let mut instructions = Vec::new();
    for (number, node) in kept.into_iter().enumerate() {
        if !reached[number].iter().any(|&flag| flag) {
            register_of.push(Vec::new());
            notes.push(Note {
                node: node.label,
                node_type: node.node_type.type_name.to_owned(),
                action: "dropped",
                reason: "nothing that is left reads it".into(),
            });
            continue;
        }
        let mut wanted = Vec::new();
        let mut numbers = Vec::new();
        let mut component = 0;
        let first_register = registers;
        for output in node.node_type.outputs_of(&node.mode) {
            let width = output.kind.components();
            let is_wanted = reached[number][component..component + width].iter().any(|&flag| flag);
            component += width;
            if is_wanted {
                wanted.push((output.identifier, output.kind));
                numbers.extend((registers..registers + width).map(Some));
                registers += width;
            } else {
                numbers.extend(std::iter::repeat_n(None, width));
            }
        }
        let mode = node.mode.with_wanted(wanted.iter().map(|(identifier, _)| *identifier).collect());
        let inputs = node.inputs.iter().map(|source| operand(&register_of, source)).collect();
        register_of.push(numbers);
        instructions.push(Instruction {
            label: node.label,
            node_type: node.node_type,
            kernel: kernel_of(node.node_type, &mode),
            mode,
            inputs,
            first_register,
            outputs: wanted,
        });
    }
    let outputs = outputs
        .into_iter()
        .map(|(name, kind, sources)| Output {
            name,
            kind,
            operands: sources.iter().map(|source| operand(&register_of, source)).collect(),
        })
        .collect();
    Program { instructions, outputs, attributes, registers, notes }
}

fn follow(replaced: &[Vec<Source>], source: &Source) -> Source {
    match source {
        Source::Node(node, component) => replaced[*node][*component].clone(),
        other => other.clone(),
    }
}

fn as_constant(source: &Source) -> Option<f32> {
    match source {
        Source::Constant(value) => Some(*value),
        _ => None,
    }
}

fn operand(register_of: &[Vec<Option<usize>>], source: &Source) -> Operand {
    match source {
        Source::Constant(value) => Operand::Constant(*value),
        Source::Position(axis) => Operand::Position(*axis),
        Source::Attribute(number, axis) => Operand::Attribute(*number, *axis),
        Source::Node(node, component) => {
            Operand::Register(register_of[*node][*component].expect("a read component is wanted"))
        }
    }
}

/// The node's value for constant inputs.
fn evaluate(kernel: &dyn Kernel, values: &[f32], count: usize) -> Vec<f32> {
    let columns: Vec<Column<'_, f32>> =
        values.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: true }).collect();
    let mut result = vec![0.0; count];
    let mut slices: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
    kernel.evaluate_f32(&columns, &mut slices);
    result
}

fn list(values: &[f32]) -> String {
    values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Inputs as a key: constants by their bits, so that NaNs compare equal and zeros by sign.
fn bits(inputs: &[Source]) -> String {
    inputs
        .iter()
        .map(|source| match source {
            Source::Constant(value) => format!("c{:08x} ", value.to_bits()),
            other => format!("{other:?} "),
        })
        .collect()
}
