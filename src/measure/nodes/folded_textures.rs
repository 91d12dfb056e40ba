//! Values of textures that Blender folds, asked of Blender.
//!
//! A texture whose inputs are all constant never reaches Cycles: Blender evaluates it by functions of its own, which are some
//! 5e-7 from Cycles' kernels and are not reproduced here. So its value is asked for once, by a render of a material with
//! that constant subgraph, and stored beside the node ([`crate::scene::Folded`]). A texture that reads another one is asked for
//! with that one's value: round after round.

use crate::base::error::Result;
use crate::bridge::{CyclesKernel, Message, probe};
use crate::graph::closures::ClosureSum;
use crate::graph::{FoldedTexture, Program, Target};
use crate::measure::nodes::constants::{FoldedBy, constant};
use crate::scene::{Folded, Graph, Release, Scene, bare_scene};
use serde_json::{Map, Value as Json, json};
use std::collections::HashSet;

/// Chains of folded textures are followed this far.
const MOST_ROUNDS: usize = 16;

/// A texture to ask for, with its graph's place among those that are asked together.
type Wanted = (usize, FoldedTexture);

/// Stores Blender's values in the graphs of a scene, whose nodes the properties in the file describe; says how many.
pub fn store(scene: &mut Scene, mut receive: impl FnMut(Message)) -> Result<usize> {
    rounds(scene.graph().blender, &mut receive, |found| {
        let mut wanted = Vec::new();
        for (place, value) in found {
            let graph = graphs_of(scene).nth(*place).expect("the graph that was asked for");
            keep(graph, value);
        }
        for (volume, graph) in scene.volumes()? {
            let place = place_of(scene, &graph.material);
            let textures = ClosureSum::compile(graph, volume)?.program.folded_textures;
            wanted.extend(textures.into_iter().map(|texture| (place, texture)));
        }
        let properties = |(place, texture): &Wanted| {
            let graph = std::iter::once(scene.graph()).chain(&scene.other_graphs).nth(*place);
            graph.and_then(|graph| properties_of(graph, texture)).unwrap_or_default()
        };
        Ok(wanted.iter().map(|wanted| (wanted.clone(), properties(wanted))).collect())
    })
}

/// [`store`] for the targets of several scenes at once.
pub fn store_for(scenes: &mut [(&mut Scene, &[Target])], mut receive: impl FnMut(Message)) -> Result<usize> {
    let release = scenes.first().map_or(Release::default(), |(scene, _)| scene.graph().blender);
    rounds(release, &mut receive, |found| {
        for (place, value) in found {
            keep(scenes[*place].0.graph_mut(), value);
        }
        let mut wanted = Vec::new();
        for (place, (scene, targets)) in scenes.iter().enumerate() {
            // What does not compile is reported by who compares it.
            let Ok(program) = Program::compile(scene, targets) else { continue };
            for texture in program.folded_textures {
                let properties = properties_of(scene.graph(), &texture).unwrap_or_default();
                wanted.push(((place, texture), properties));
            }
        }
        Ok(wanted)
    })
}

/// A texture's value and where it belongs.
type Found = (usize, (FoldedTexture, Vec<f32>));

/// Asks until nothing new is wanted; `step` keeps what was found and says what is wanted then.
fn rounds(
    release: Release,
    receive: &mut dyn FnMut(Message),
    mut step: impl FnMut(&[Found]) -> Result<Vec<(Wanted, Map<String, Json>)>>,
) -> Result<usize> {
    let (mut found, mut count, mut asked) = (Vec::new(), 0, HashSet::new());
    for _ in 0..MOST_ROUNDS {
        let mut wanted = step(&found)?;
        // JSON has no number for a NaN or an infinity; what has such a value would be asked for in every round.
        wanted.retain(|((place, texture), _)| {
            let FoldedTexture { group, node, mode, inputs, .. } = texture;
            let bits: Vec<u32> = inputs.iter().map(|value| value.to_bits()).collect();
            inputs.iter().all(|value| value.is_finite())
                && asked.insert((*place, group.clone(), node.clone(), mode.words(), bits))
        });
        if wanted.is_empty() {
            return Ok(count);
        }
        found = ask(wanted, release, receive)?;
        count += found.len();
    }
    step(&found)?;
    Ok(count)
}

/// One render of all of them. Values that JSON has no number for are left out.
fn ask(
    wanted: Vec<(Wanted, Map<String, Json>)>,
    release: Release,
    receive: &mut dyn FnMut(Message),
) -> Result<Vec<Found>> {
    let (mut graph, mut targets, mut ranges) = (Vec::new(), Vec::new(), Vec::new());
    for (number, ((_, texture), properties)) in wanted.iter().enumerate() {
        let mut inputs = Map::new();
        let mut first = 0;
        for (place, socket) in texture.node_type.inputs_of(&texture.mode).enumerate() {
            let values = &texture.inputs[first..first + socket.kind.components()];
            first += values.len();
            let name = format!("Input {number} {place}");
            inputs
                .insert(socket.identifier.into(), constant(socket.kind, values, FoldedBy::Blender, &name, &mut graph));
        }
        let name = format!("Node {number}");
        graph.push(json!({
            "name": name, "type": texture.node_type.type_name, "properties": properties, "inputs": inputs,
        }));
        let start = targets.len();
        let outputs = texture.node_type.outputs_of(&texture.mode);
        targets.extend(outputs.map(|output| Target::output(&name, output.identifier)));
        ranges.push(start..targets.len());
    }
    let mut scene = bare_scene("folded textures", json!({"material": "Material", "nodes": graph, "groups": []}))?;
    scene.graph_mut().blender = release;
    let positions = [[0.0; 3]];
    let job = probe::Job { scene: &scene, positions: &positions, attributes: &[], targets, repeat: 1, samples: 1 };
    let answers = probe::ask(&[job], CyclesKernel::Sse42, receive)?;
    let values = &answers.jobs[0].values;
    Ok(wanted
        .into_iter()
        .zip(ranges)
        .map(|(((place, texture), _), range)| (place, (texture, values[range].concat())))
        .filter(|(_, (_, values))| values.iter().all(|value| value.is_finite()))
        .collect())
}

fn graphs_of(scene: &mut Scene) -> impl Iterator<Item = &mut Graph> {
    let Scene { graph, other_graphs, .. } = scene;
    graph.inline_mut().into_iter().chain(other_graphs)
}

/// The place of a material's graph among those of a scene.
fn place_of(scene: &Scene, material: &str) -> usize {
    std::iter::once(scene.graph()).chain(&scene.other_graphs).position(|graph| graph.material == material).unwrap_or(0)
}

/// Properties of the node that a texture is, without its own mapping: Blender ignores that where it folds.
fn properties_of(graph: &Graph, texture: &FoldedTexture) -> Option<Map<String, Json>> {
    let nodes = match &texture.group {
        Some(name) => &graph.group(name)?.nodes,
        None => &graph.nodes,
    };
    let node = nodes.iter().find(|node| node.name == texture.node)?;
    let mut properties = node.properties.clone();
    properties.remove("texture_mapping");
    Some(properties)
}

/// Puts a value beside its node.
fn keep(graph: &mut Graph, (texture, outputs): &(FoldedTexture, Vec<f32>)) {
    let nodes = match &texture.group {
        Some(name) => match graph.groups.iter_mut().find(|group| group.name == *name) {
            Some(group) => &mut group.nodes,
            None => return,
        },
        None => &mut graph.nodes,
    };
    let Some(node) = nodes.iter_mut().find(|node| node.name == texture.node) else { return };
    let mode = texture.mode.words();
    if !node.folded.iter().any(|known| known.is_for(&mode, &texture.inputs)) {
        node.folded.push(Folded { mode, inputs: texture.inputs.clone(), outputs: outputs.clone() });
    }
}
