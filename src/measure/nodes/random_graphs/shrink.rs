//! Making a failing graph small: the same failure from as few nodes, links and settings as can be.
//!
//! A step changes one thing (a link becomes an attribute with the value that it carried, a group is put in the place of its use, a
//! property gets its default, and so on), the boldest steps first, and is kept if the failure stays. All steps of a round are
//! tried together, so that a round needs one Blender, or a few.

use crate::base::error::Result;
use crate::graph::Target;
use crate::measure::nodes::random_graphs::{Failure, Judge, Reference, Trial, link, node};
use crate::nodes;
use crate::scene::{Graph, Input, Node, SocketType};
use std::collections::{BTreeMap, BTreeSet};

/// Rounds at most; each makes the graph smaller.
const ROUNDS: usize = 60;

/// Steps tried together.
const TOGETHER: usize = 32;

/// What is left of a failing graph.
pub struct Shrunk {
    /// The smallest graph that fails.
    pub trial: Trial,
    /// How it fails.
    pub failure: Failure,
}

/// Makes the graph of a failure small.
pub fn shrink(trial: &Trial, failure: &Failure, judge: &Judge<'_>, reference: &mut dyn Reference) -> Shrunk {
    let mut best = Shrunk { trial: trial.clone(), failure: failure.clone() };
    for _ in 0..ROUNDS {
        let Some(smaller) = smaller(&best, judge, reference) else { break };
        best = smaller;
    }
    best
}

/// The first step after which the failure is still there.
fn smaller(best: &Shrunk, judge: &Judge<'_>, reference: &mut dyn Reference) -> Option<Shrunk> {
    for steps in steps(best, judge).chunks(TOGETHER) {
        let trials: Vec<&Trial> = steps.iter().collect();
        let found = judge.failures(&trials, best.failure.kind, reference);
        if let Some((step, failure)) = steps.iter().zip(found).find_map(|(step, failure)| Some((step, failure?))) {
            return Some(Shrunk { trial: step.clone(), failure });
        }
    }
    None
}

/// Everything that could be left out, the boldest first; only trials that differ from what there is.
fn steps(best: &Shrunk, judge: &Judge<'_>) -> Vec<Trial> {
    let Shrunk { trial, failure } = best;
    let mut steps = Vec::new();
    let mut push = |step: Option<Trial>| {
        let differs = |step: &Trial| {
            let (old, new) = (trial, step);
            old.scene != new.scene || old.targets != new.targets || old.positions.len() != new.positions.len()
        };
        steps.extend(step.map(pruned).filter(differs));
    };
    // One output at one point.
    let whole = trial.positions.len() > 1 || trial.targets.len() > 1;
    if whole {
        let one = |keep_points: bool| {
            let mut step = match failure.point {
                Some(point) if !keep_points => trial.at(&[point]),
                _ => trial.clone(),
            };
            if let Some(target) = failure.target {
                step.targets = vec![trial.targets[target].clone()];
            }
            step
        };
        push(Some(one(false)));
        push(Some(one(true)));
        // No output is to blame: halves, then each alone.
        if failure.target.is_none() && trial.targets.len() > 1 {
            let (first, second) = trial.targets.split_at(trial.targets.len() / 2);
            for targets in [first, second] {
                push(Some(Trial { targets: targets.to_vec(), ..trial.clone() }));
            }
            for target in &trial.targets {
                push(Some(Trial { targets: vec![target.clone()], ..trial.clone() }));
            }
        }
        if failure.target.is_some() {
            return steps;
        }
    }
    let graph = trial.scene.graph();
    let values = values(trial, failure.point.unwrap_or(0), judge);
    let wanted: BTreeSet<&str> = trial.targets.iter().map(|target| target.node.as_str()).collect();
    // Something before it fails in the same way.
    for (node, socket) in values.keys() {
        if !reads_attribute(graph, node) {
            push(Some(Trial { targets: vec![Target::output(node, socket)], ..trial.clone() }));
        }
    }
    // What the nodes in question read, then what any node reads: attributes with the same values.
    push(cut(trial, &values, |reader, _| wanted.contains(reader)));
    for node in &graph.nodes {
        push(cut(trial, &values, |_, source| source == node.name));
    }
    for node in &graph.nodes {
        push(inlined(trial, &node.name));
    }
    for node in &graph.nodes {
        let change = |change: &dyn Fn(&mut Node)| changed(trial, &node.name, change);
        if node.muted {
            push(change(&|node| {
                node.muted = false;
                node.bypass = None;
            }));
        }
        if node.group.is_some() || node.kind == "ShaderNodeAttribute" {
            continue;
        }
        push(change(&|node| node.properties.clear()));
        for name in node.properties.keys() {
            push(change(&|node| {
                node.properties.shift_remove(name);
            }));
        }
        // Defaults in the place of stored values, and what a link carried in the place of the link.
        push(change(&|node| node.inputs.retain(|_, input| is_link(input))));
        for (name, input) in &node.inputs {
            if is_link(input) {
                push(change(&|node| {
                    node.inputs.shift_remove(name);
                }));
                push(constant(&values, node, name, input).and_then(|value| {
                    change(&|node| {
                        node.inputs.insert(name.clone(), value.clone());
                    })
                }));
            } else {
                push(change(&|node| {
                    node.inputs.shift_remove(name);
                }));
                push(change(&|node| {
                    let rounded = |value: f32| if value.is_finite() { value.round().clamp(-4.0, 4.0) } else { value };
                    match node.inputs.get_mut(name) {
                        Some(Input::Number(value)) => *value = rounded(*value),
                        Some(Input::List(values)) => values.iter_mut().for_each(|value| *value = rounded(*value)),
                        _ => {}
                    }
                }));
            }
        }
    }
    if trial.positions.len() == 1 {
        // The scene stays the same: steps all the same.
        if trial.positions[0].map(f32::to_bits) != [0; 3] {
            steps.push(Trial { positions: vec![[0.0; 3]], ..trial.clone() });
        }
        for (number, (_, values)) in trial.attributes.iter().enumerate() {
            for axis in 0..3 {
                let rounded = values[0][axis].round();
                if rounded.is_finite() && rounded.to_bits() != values[0][axis].to_bits() {
                    let mut step = trial.clone();
                    step.attributes[number].1[0][axis] = rounded;
                    steps.push(step);
                }
            }
        }
    }
    steps
}

fn is_link(input: &Input) -> bool {
    matches!(input, Input::Link { .. } | Input::GroupInput(_))
}

/// Kind and value at a point of every output that is linked in the material's tree, by node and socket.
type Known = BTreeMap<(String, String), (SocketType, Vec<f32>)>;

fn values(trial: &Trial, point: usize, judge: &Judge<'_>) -> Known {
    let mut sockets = BTreeSet::new();
    for input in trial.scene.graph().nodes.iter().flat_map(|node| node.inputs.values()) {
        if let Input::Link { node, socket } = input {
            sockets.insert((node.clone(), socket.clone()));
        }
    }
    let part = trial.at(&[point.min(trial.positions.len() - 1)]);
    let value = |(node, socket): &(String, String)| -> Result<(SocketType, Vec<f32>)> {
        let program = (judge.compile)(&part.scene, &[Target::output(node, socket)], None)?;
        Ok((program.outputs[0].kind, program.evaluate_single(part.points())?))
    };
    sockets.into_iter().filter_map(|socket| value(&socket).ok().map(|value| (socket, value))).collect()
}

/// The value of a link as a stored one; none where Blender cannot store it there.
fn constant(values: &Known, node: &Node, name: &str, input: &Input) -> Option<Input> {
    let Input::Link { node: source, socket } = input else { return None };
    let (_, value) = values.get(&(source.clone(), socket.clone()))?;
    let kind = nodes::find(&node.kind)?.inputs.iter().find(|socket| socket.identifier == name)?.kind;
    let value: Vec<f32> = match (value.len(), kind.components()) {
        (1, 3) => vec![value[0]; 3],
        (3, 1) => vec![(value[0] + value[1]) + value[2]],
        _ => value.clone(),
    };
    if value.iter().any(|value| !value.is_finite()) {
        return None;
    }
    Some(match kind {
        SocketType::Color => Input::List(value.iter().map(|value| value.abs()).chain([1.0]).collect()),
        SocketType::Vector => Input::List(value),
        _ => Input::Number(value[0]),
    })
}

/// Whether a node is an attribute or a component of one.
fn reads_attribute(graph: &Graph, name: &str) -> bool {
    let is_attribute =
        |name: &str| graph.nodes.iter().any(|node| node.name == name && node.kind == "ShaderNodeAttribute");
    let takes_apart = |node: &Node| {
        let vector = node.inputs.get("Vector");
        node.kind == "ShaderNodeSeparateXYZ" && matches!(vector, Some(Input::Link { node, .. }) if is_attribute(node))
    };
    is_attribute(name) || graph.nodes.iter().any(|node| node.name == name && takes_apart(node))
}

/// Attributes in the place of the links that `chosen` picks by reader and source.
fn cut(trial: &Trial, values: &Known, chosen: impl Fn(&str, &str) -> bool) -> Option<Trial> {
    let mut step = trial.clone();
    let mut added: Vec<Node> = Vec::new();
    let mut replaced: BTreeMap<(String, String), Input> = BTreeMap::new();
    let first = (0..).find(|number| !trial.attributes.iter().any(|(name, _)| *name == format!("cut {number}")))?;
    let mut number = first;
    for reader in &mut step.scene.graph_mut().nodes {
        // A reroute has the type of what feeds it, and inputs read attributes already.
        if reader.kind == "NodeReroute" || reader.muted {
            continue;
        }
        for input in reader.inputs.values_mut() {
            let Input::Link { node: source, socket } = input else { continue };
            if reads_attribute(trial.scene.graph(), source) || !chosen(&reader.name, source) {
                continue;
            }
            let key = (source.clone(), socket.clone());
            let Some((_, value)) = values.get(&key) else { continue };
            if !replaced.contains_key(&key) {
                let name = format!("Cut {number}");
                let attribute = format!("cut {number}");
                let mut reads = node(&name, "ShaderNodeAttribute");
                reads.properties.insert("attribute_type".into(), "GEOMETRY".into());
                reads.properties.insert("attribute_name".into(), attribute.clone().into());
                added.push(reads);
                let whole = [0, 1, 2].map(|axis: usize| value.get(axis).copied().unwrap_or(0.0));
                step.attributes.push((attribute, vec![whole; trial.positions.len()]));
                let mut end = link(&name, "Vector");
                if value.len() == 1 {
                    let separate = format!("Cut {number} component");
                    let mut separates = node(&separate, "ShaderNodeSeparateXYZ");
                    separates.inputs.insert("Vector".into(), end);
                    added.push(separates);
                    end = link(&separate, "X");
                }
                replaced.insert(key.clone(), end);
                number += 1;
            }
            *input = replaced[&key].clone();
        }
    }
    step.scene.graph_mut().nodes.extend(added);
    (number > first).then_some(step)
}

/// The group of a use in the place of the use.
fn inlined(trial: &Trial, name: &str) -> Option<Trial> {
    let mut step = trial.clone();
    let graph: &mut Graph = step.scene.graph_mut();
    let place = graph.nodes.iter().position(|node| node.name == name)?;
    let user = graph.nodes[place].clone();
    let group = graph.group(user.group.as_deref()?)?.clone();
    if user.muted {
        return None;
    }
    let inside = |inner: &str| format!("{name}: {inner}");
    // What an input of the group is, in the tree of the user; none where nothing can be said.
    let outside = |identifier: &str| -> Option<Input> {
        let given = user.inputs.get(identifier).cloned();
        given.or_else(|| {
            let socket = group.inputs.iter().find(|socket| socket.identifier == identifier)?;
            serde_json::from_value(socket.default.clone()?).ok()
        })
    };
    let moved = |input: &Input| -> Option<Input> {
        match input {
            Input::Link { node, socket } => Some(link(&inside(node), socket)),
            Input::GroupInput(identifier) => outside(identifier),
            stored => Some(stored.clone()),
        }
    };
    let end = group.nodes.iter().find(|node| node.kind == "NodeGroupOutput")?;
    for inner in group.nodes.iter().filter(|node| node.kind != "NodeGroupOutput") {
        let mut copy = inner.clone();
        copy.name = inside(&inner.name);
        copy.inputs = inner.inputs.iter().filter_map(|(key, input)| Some((key.clone(), moved(input)?))).collect();
        graph.nodes.push(copy);
    }
    for reader in &mut graph.nodes {
        for input in reader.inputs.values_mut() {
            if let Input::Link { node, socket } = input
                && *node == name
            {
                *input = moved(end.inputs.get(socket.as_str())?)?;
            }
        }
    }
    for target in step.targets.iter_mut().filter(|target| target.node == name) {
        let output = target.output.as_deref()?;
        let Input::Link { node, socket } = moved(end.inputs.get(output)?)? else { return None };
        *target = Target::output(&node, &socket);
    }
    let graph = step.scene.graph_mut();
    graph.nodes.remove(place);
    Some(step)
}

/// The graph with one node of the material's tree changed.
fn changed(trial: &Trial, name: &str, change: &dyn Fn(&mut Node)) -> Option<Trial> {
    let mut step = trial.clone();
    change(step.scene.graph_mut().nodes.iter_mut().find(|node| node.name == name)?);
    Some(step)
}

/// Without nodes, groups and attributes that no target needs.
fn pruned(mut trial: Trial) -> Trial {
    let mut needed: BTreeSet<String> = BTreeSet::new();
    let mut pending: Vec<String> = trial.targets.iter().map(|target| target.node.clone()).collect();
    let graph = trial.scene.graph_mut();
    while let Some(name) = pending.pop() {
        let Some(node) = graph.nodes.iter().find(|node| node.name == name) else { continue };
        if needed.insert(name) {
            pending.extend(node.inputs.values().filter_map(|input| match input {
                Input::Link { node, .. } => Some(node.clone()),
                _ => None,
            }));
        }
    }
    graph.nodes.retain(|node| needed.contains(&node.name));
    let mut used: BTreeSet<String> = BTreeSet::new();
    let mut pending: Vec<String> = graph.nodes.iter().filter_map(|node| node.group.clone()).collect();
    while let Some(name) = pending.pop() {
        let Some(group) = graph.group(&name) else { continue };
        if used.insert(name) {
            pending.extend(group.nodes.iter().filter_map(|node| node.group.clone()));
        }
    }
    graph.groups.retain(|group| used.contains(&group.name));
    let inner = graph.groups.iter().flat_map(|group| &group.nodes);
    let read: BTreeSet<String> = graph
        .nodes
        .iter()
        .chain(inner)
        .filter_map(|node| node.properties.get("attribute_name")?.as_str().map(str::to_owned))
        .collect();
    trial.attributes.retain(|(name, _)| read.contains(name));
    trial
}
