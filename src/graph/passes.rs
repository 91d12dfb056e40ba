//! Passes on the flat graph: fold constants, simplify, merge equal nodes, drop what is not reached,
//! number the registers.

use crate::graph::flatten::{Flat, Source, affine_inputs};
use crate::graph::zero_signs;
use crate::graph::{FoldedTexture, Instruction, Note, Operand, Output, Program};
use crate::nodes::{Column, Mode, NodeEvaluator, NodeType, Nudge, Nudged, Role, Simplified, affine, nudged};
use std::collections::HashMap;

/// A node after the first pass: what its output components are now.
struct Kept {
    label: String,
    node_type: &'static NodeType,
    mode: Mode,
    inputs: Vec<Source>,
}

fn evaluator_of(node_type: &NodeType, mode: &Mode) -> Box<dyn NodeEvaluator> {
    match node_type.role {
        Role::Evaluated(build) => build(mode),
        _ => unreachable!("the flat graph holds evaluated nodes only"),
    }
}

fn components(node_type: &'static NodeType, mode: &Mode) -> usize {
    node_type.outputs_of(mode).map(|output| output.kind.components()).sum()
}

pub(super) fn run(flat: Flat) -> Program {
    run_nudged(flat, None)
}

/// [`run`] with the constants that it folds under a nudge, where there is one.
pub(super) fn run_nudged(flat: Flat, nudge: Option<Nudge>) -> Program {
    let Flat { nodes, mut outputs, attributes, mut notes, generated } = flat;
    // replaced[n]: what each output component of flat node n turned into.
    let mut replaced: Vec<Vec<Source>> = Vec::with_capacity(nodes.len());
    // The same for links as Cycles sees them, to which a node that only renames components is a node.
    let mut links: Vec<Vec<Source>> = Vec::with_capacity(nodes.len());
    let count_of_all = nodes.len();
    let early: Vec<bool> = nodes.iter().map(|node| node.constant).collect();
    let mut kept: Vec<Kept> = Vec::new();
    let mut folded_textures = Vec::new();
    let mut known: HashMap<String, usize> = HashMap::new();
    let mut renames: HashMap<String, usize> = HashMap::new();
    for (flat_number, node) in nodes.into_iter().enumerate() {
        let mut inputs: Vec<Source> = node.inputs.iter().map(|source| follow(&replaced, source)).collect();
        let mut note = |action: &'static str, reason: String| {
            notes.push(Note {
                node: node.label.clone(),
                node_type: node.node_type.type_name.to_owned(),
                action,
                reason,
            });
        };
        if !node.constant {
            zero_signs::settle(&node, &early, &mut inputs);
        }
        if let Some(first) = node.coordinate
            && inputs[first..first + 3].iter().all(|source| as_constant(source).is_some())
        {
            // A constant is a socket without a link for Cycles, whatever its value.
            note("replaced", "its coordinate is a constant, which counts as unlinked: it reads Generated".into());
            kept.push(Kept {
                label: format!("{} Generated", node.label),
                node_type: &affine::TYPE,
                mode: generated_mode(),
                inputs: affine_inputs(generated),
            });
            inputs.splice(first..first + 3, (0..3).map(|axis| Source::Node(kept.len() - 1, axis)));
        }
        let evaluator = evaluator_of(node.node_type, &node.mode);
        let constants: Vec<Option<f32>> = inputs.iter().map(as_constant).collect();
        let count = components(node.node_type, &node.mode);
        if let Some(values) = inputs.iter().map(as_known).collect::<Option<Vec<f32>>>() {
            let folds_late = constants.iter().all(Option::is_some) && evaluator.folds_late();
            // What Blender has not folded (a simplification made it constant, or a node that Blender cannot
            // evaluate stands before it) Cycles folds by rules of its own, if it can.
            let own_rule = match (node.constant, folds_late) {
                (true, _) => evaluator.fold(&values),
                (false, true) => evaluator.fold_late(&values),
                (false, false) => None,
            };
            let stored = node.folded.as_ref().and_then(|texture| {
                let words = node.mode.words();
                let known = texture.known.iter().find(|known| known.is_for(&words, &values));
                known.filter(|known| known.outputs.len() == count).map(|known| known.outputs.clone())
            });
            let by = match (&stored, &node.folded) {
                (Some(_), _) => " (by Blender)",
                (None, Some(texture)) => {
                    folded_textures.push(FoldedTexture {
                        group: texture.group.clone(),
                        node: texture.node.clone(),
                        node_type: node.node_type,
                        mode: node.mode.clone(),
                        inputs: values.clone(),
                    });
                    if texture.known.is_empty() {
                        ""
                    } else {
                        " (by our arithmetic: what is stored of Blender's is for other inputs)"
                    }
                }
                (None, None) => "",
            };
            let values = match (stored, nudge) {
                (Some(stored), _) => stored,
                (None, Some(nudge)) => {
                    nudged::with(nudge, || evaluate_nudged(evaluator.as_ref(), &values, count, own_rule))
                }
                (None, None) => own_rule.unwrap_or_else(|| evaluate(evaluator.as_ref(), &values, count)),
            };
            note("folded", format!("constant inputs: {}{by}", list(&values)));
            let source = if node.constant || folds_late { Source::Constant } else { Source::Runtime };
            replaced.push(values.into_iter().map(source).collect());
            links.push(replaced[flat_number].clone());
            continue;
        }
        let linked: Vec<Source> = node.inputs.iter().map(|source| follow(&links, source)).collect();
        let equal = |first: usize, second: usize| as_known(&linked[first]).is_none() && linked[first] == linked[second];
        match evaluator.simplify(&constants).or_else(|| evaluator.simplify_links(&constants, &equal)) {
            Some(Simplified::Inputs(indices)) => {
                if !node.node_type.properties.is_empty() {
                    note("simplified", "passes an input on".into());
                }
                links.push(indices.iter().map(|&index| linked[index].clone()).collect());
                replaced.push(indices.into_iter().map(|index| inputs[index].clone()).collect());
                continue;
            }
            Some(Simplified::Renames(indices)) => {
                if !node.node_type.properties.is_empty() {
                    note("simplified", "hands its components on".into());
                }
                // A number of its own, beyond those of the nodes that are kept; equal ones are merged like other nodes.
                let key = format!("{} {:?} {}", node.node_type.type_name, node.mode, bits(&linked));
                let number = *renames.entry(key).or_insert(flat_number) + 2 * count_of_all;
                links.push((0..count).map(|component| Source::Node(number, component)).collect());
                // The node stays: a constant among the components of a link that varies is none for what reads it.
                replaced.push(indices.into_iter().map(|index| at_run_time(&inputs[index])).collect());
                continue;
            }
            Some(Simplified::Constant(values)) => {
                note("simplified", format!("constant whatever the other inputs are: {}", list(&values)));
                replaced.push(values.into_iter().map(Source::Constant).collect());
                links.push(replaced[flat_number].clone());
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
        links.push(replaced[flat_number].clone());
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
    // Registers and evaluators for the reached nodes only.
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
            evaluator: evaluator_of(node.node_type, &mode),
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
    Program { instructions, outputs, attributes, registers, notes, folded_textures }
}

fn follow(replaced: &[Vec<Source>], source: &Source) -> Source {
    match source {
        Source::Node(node, component) => replaced[*node][*component].clone(),
        Source::LateConstant(value) => Source::Constant(*value),
        other => other.clone(),
    }
}

fn as_constant(source: &Source) -> Option<f32> {
    match source {
        Source::Constant(value) => Some(*value),
        _ => None,
    }
}

/// What a node hands on that Cycles evaluates at every point.
fn at_run_time(source: &Source) -> Source {
    match source {
        Source::Constant(value) => Source::Runtime(*value),
        other => other.clone(),
    }
}

/// The value of what is known before any point is.
fn as_known(source: &Source) -> Option<f32> {
    match source {
        Source::Constant(value) | Source::Runtime(value) => Some(*value),
        _ => None,
    }
}

fn generated_mode() -> Mode {
    let mode = Mode::read(&affine::TYPE, &serde_json::Map::new(), affine::TYPE.label).expect("no properties");
    let outputs = affine::TYPE.outputs_of(&mode).map(|output| output.identifier).collect();
    mode.with_wanted(outputs)
}

fn operand(register_of: &[Vec<Option<usize>>], source: &Source) -> Operand {
    match source {
        Source::Constant(value) | Source::LateConstant(value) | Source::Runtime(value) => Operand::Constant(*value),
        Source::Position(axis) => Operand::Position(*axis),
        Source::Attribute(number, axis) => Operand::Attribute(*number, *axis),
        Source::Node(node, component) => {
            Operand::Register(register_of[*node][*component].expect("a read component is wanted"))
        }
    }
}

/// The node's value for constant inputs.
fn evaluate(evaluator: &dyn NodeEvaluator, values: &[f32], count: usize) -> Vec<f32> {
    let columns: Vec<Column<'_, f32>> =
        values.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: true }).collect();
    let mut result = vec![0.0; count];
    let mut slices: Vec<&mut [f32]> = result.iter_mut().map(std::slice::from_mut).collect();
    evaluator.evaluate_f32(&columns, &mut slices);
    result
}

/// [`evaluate`] under the thread's nudge. A value by the node's own rule is no generic arithmetic: where the node calls the C
/// library, the value itself is nudged.
fn evaluate_nudged(
    evaluator: &dyn NodeEvaluator,
    values: &[f32],
    count: usize,
    own_rule: Option<Vec<f32>>,
) -> Vec<f32> {
    let calls = nudged::calls();
    let values: Vec<Nudged> = values.iter().map(|&value| Nudged(value)).collect();
    let columns: Vec<Column<'_, Nudged>> =
        values.iter().map(|value| Column { values: std::slice::from_ref(value), uniform: true }).collect();
    let mut result = vec![Nudged(0.0); count];
    let mut slices: Vec<&mut [Nudged]> = result.iter_mut().map(std::slice::from_mut).collect();
    evaluator.evaluate_nudged(&columns, &mut slices);
    match own_rule {
        Some(own) if nudged::calls() > calls => own.into_iter().map(nudged::folded).collect(),
        Some(own) => own,
        None => result.into_iter().map(|value| value.0).collect(),
    }
}

fn list(values: &[f32]) -> String {
    values.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Inputs as a key: constants by their bits, so that NaNs compare equal and zeros by sign.
fn bits(inputs: &[Source]) -> String {
    inputs
        .iter()
        .map(|source| match source {
            Source::Constant(value) | Source::Runtime(value) => format!("c{:08x} ", value.to_bits()),
            other => format!("{other:?} "),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::graph::evaluate::Points;
    use crate::graph::{Program, Target};
    use crate::scene::{Folded, Input, Scene, bare_scene};
    use serde_json::json;

    /// A Noise Texture whose inputs are constant, and twice its value.
    fn scene() -> Scene {
        let graph = json!({
            "material": "Material",
            "nodes": [
                {
                    "name": "Noise", "type": "ShaderNodeTexNoise",
                    "inputs": {"Vector": {"node": "Place", "socket": "Vector"}, "Scale": 5.0},
                },
                {"name": "Place", "type": "ShaderNodeCombineXYZ", "inputs": {"X": 0.3, "Y": 0.7, "Z": -0.4}},
                {
                    "name": "Double", "type": "ShaderNodeMath", "properties": {"operation": "MULTIPLY"},
                    "inputs": {"Value": {"node": "Noise", "socket": "Fac"}, "Value_001": 2.0},
                },
            ],
            "groups": [],
        });
        bare_scene("folded", graph).expect("a scene")
    }

    fn compiled(scene: &Scene) -> (Program, f32) {
        let program = Program::compile(scene, &[Target::output("Double", "Value")]).expect("it compiles");
        let value = program.evaluate_single(Points::new(&[[0.0; 3]])).expect("a value")[0];
        (program, value)
    }

    #[test]
    fn a_stored_value_of_blender_counts_for_its_inputs_alone() {
        let mut scene = scene();
        let (program, ours) = compiled(&scene);
        let [texture] = program.folded_textures.as_slice() else { panic!("one texture is folded") };
        assert_eq!((texture.node.as_str(), &texture.group), ("Noise", &None));
        let outputs = vec![0.25, 0.1, 0.2, 0.3];
        let folded = Folded { mode: texture.mode.words(), inputs: texture.inputs.clone(), outputs };
        scene.graph_mut().nodes[0].folded = vec![folded];
        let (program, stored) = compiled(&scene);
        assert!(program.folded_textures.is_empty());
        assert_eq!(stored, 0.5);
        let text = serde_json::to_string(&scene).expect("JSON");
        assert!(text.contains("\"folded\""), "{text}");
        // Another input: the stored value is for none of these, and is reported.
        scene.graph_mut().nodes[0].inputs.insert("Scale".to_owned(), Input::Number(5.5));
        let (program, other) = compiled(&scene);
        assert_eq!(program.folded_textures.len(), 1);
        assert!(other != stored && other != ours, "{other}");
        let is_reported = |reason: &str| reason.contains("for other inputs");
        assert!(program.notes.iter().any(|note| note.node == "Noise" && is_reported(&note.reason)));
    }
}
