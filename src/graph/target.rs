//! Naming a value of the graph: a socket by its place, or an input of the closing node.

use crate::base::error::{Error, Result};
use crate::nodes::{self, Role};
use crate::scene::{DEEPEST_NESTING, Graph, Input, Node, Scene};
use serde::{Deserialize, Serialize};

/// A socket somewhere in the graph.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Target {
    /// Group nodes from the material's tree down.
    pub groups: Vec<String>,
    /// Node name.
    pub node: String,
    /// Identifier of an output of that node.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output: Option<String>,
    /// Identifier of an input of that node.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<String>,
}

impl Target {
    /// An output of a node of the material's own tree.
    pub fn output(node: &str, socket: &str) -> Self {
        Self { groups: Vec::new(), node: node.into(), output: Some(socket.into()), input: None }
    }

    /// An input of a node of the material's own tree.
    pub fn input(node: &str, socket: &str) -> Self {
        Self { groups: Vec::new(), node: node.into(), output: None, input: Some(socket.into()) }
    }

    /// `Group.001/Math.004.Value`.
    pub fn name(&self) -> String {
        let socket = self.output.as_deref().or(self.input.as_deref()).unwrap_or_default();
        let mut parts = self.groups.clone();
        parts.push(self.node.clone());
        format!("{}.{socket}", parts.join("/"))
    }

    /// Reads `NODE.SOCKET` or `GROUP NODE/NODE.SOCKET`. A node name without its groups is searched
    /// in every tree; several finds are an error that lists them. A slash in front of the first name
    /// says that it stands in the material's own tree. SOCKET is an output's identifier, or the name that Blender's interface shows of a
    /// group's output: files of Blender 2.9 to 3.6 have other identifiers than later ones.
    pub fn parse(text: &str, graph: &Graph) -> Result<Self> {
        let place = format!("target {text}");
        let mut finds = Vec::new();
        search(graph, &graph.nodes, &mut Vec::new(), &mut |groups, node| {
            let path: String = groups.iter().flat_map(|group| ["/", group]).chain(["/", &node.name]).collect();
            for name in [path.as_str(), &path[1..], node.name.as_str()] {
                if let Some(socket) = text.strip_prefix(name).and_then(|rest| rest.strip_prefix('.')) {
                    let target = Self {
                        groups: groups.to_vec(),
                        node: node.name.clone(),
                        output: Some(socket.to_owned()),
                        input: None,
                    };
                    finds.push((name.len(), target));
                    break;
                }
            }
        });
        // "Math.001.Value" also reads as socket "001.Value" of "Math": the longest name wins.
        let longest = finds.iter().map(|(length, _)| *length).max();
        finds.retain(|(length, _)| Some(*length) == longest);
        match finds.len() {
            1 => {
                let mut target = finds.remove(0).1;
                target.output = Some(output_identifier(graph, &target, &place)?);
                Ok(target)
            }
            0 => Err(Error::new(
                place,
                "no node of that name",
                "NODE.SOCKET with a node of the graph, such as \"Noise Texture.Fac\"",
                "cloudparity explain lists the nodes.",
            )
            .with_setting("target")),
            _ => Err(Error::new(
                place,
                format!("{} nodes of that name", finds.len()),
                finds.iter().map(|(_, find)| format!("/{}", find.name())).collect::<Vec<_>>().join(" or "),
                "Write the names of the group nodes that lead to it.",
            )
            .with_setting("target")),
        }
    }
}

/// The identifier of the output that a target asks for by its identifier or, of a group, by its name.
fn output_identifier(graph: &Graph, target: &Target, place: &str) -> Result<String> {
    let asked = target.output.clone().unwrap_or_default();
    let mut nodes: &[Node] = &graph.nodes;
    for name in &target.groups {
        let group = nodes.iter().find(|node| node.name == *name).and_then(|node| graph.group(node.group.as_deref()?));
        nodes = group.map_or(&[], |group| &group.nodes);
    }
    let node = nodes.iter().find(|node| node.name == target.node);
    // Other nodes' outputs depend on their mode: the compiler knows them.
    let Some(group) = node.and_then(|node| graph.group(node.group.as_deref()?)) else { return Ok(asked) };
    if group.outputs.iter().any(|socket| socket.identifier == asked) {
        return Ok(asked);
    }
    let named: Vec<_> = group.outputs.iter().filter(|socket| socket.name == asked).collect();
    if let [only] = named.as_slice() {
        return Ok(only.identifier.clone());
    }
    let candidates: Vec<String> =
        group.outputs.iter().map(|socket| format!("{} ({})", socket.identifier, socket.name)).collect();
    Err(Error::new(
        place.to_owned(),
        match named.len() {
            0 => format!("no output \"{asked}\" of the group \"{}\"", group.name),
            count => format!("{count} outputs named \"{asked}\" of the group \"{}\"", group.name),
        },
        format!("one of {}", candidates.join(", ")),
        "Name an output by its identifier, or by its name where only one has it.",
    )
    .with_setting("target"))
}

/// Calls `visit` for every node of every tree, once per place where a group is used.
fn search(graph: &Graph, nodes: &[Node], groups: &mut Vec<String>, visit: &mut impl FnMut(&[String], &Node)) {
    for node in nodes {
        visit(groups, node);
        let inner = node.group.as_ref().and_then(|name| graph.group(name));
        // The loader refuses groups that hold themselves; the limit keeps a scene made in memory finite.
        if let Some(group) = inner.filter(|_| groups.len() < DEEPEST_NESTING) {
            groups.push(node.name.clone());
            search(graph, &group.nodes, groups, visit);
            groups.pop();
        }
    }
}

/// The Material Output whose Volume closes the graph.
pub(super) fn output_with_volume(graph: &Graph) -> Result<&Node> {
    let missing = |found: &str| {
        Error::new(
            format!("material {}", graph.material),
            found,
            "a Material Output whose Volume input is linked to a volume closure",
            "Link a Principled Volume to the Volume socket of the Material Output.",
        )
    };
    let output =
        active_output(&graph.nodes, "ShaderNodeOutputMaterial").ok_or_else(|| missing("no Material Output"))?;
    match output.inputs.get("Volume") {
        Some(Input::Link { .. }) => Ok(output),
        _ => Err(missing("no link to its Volume input")),
    }
}

/// The closing node of the scene's material: the only closure that feeds Volume of the Material Output, through
/// reroutes and groups at most. It has a Density input. With it, the group nodes from the material's tree down to it.
fn closing_node(scene: &Scene) -> Result<(Vec<String>, &Node)> {
    let graph = scene.graph();
    let place = format!("material {}", graph.material);
    let missing = |found: String| {
        Error::new(
            place.clone(),
            found,
            "a Material Output whose Volume input is linked to a volume closure",
            "Link a Principled Volume to the Volume socket of the Material Output.",
        )
    };
    let mut groups = Vec::new();
    // The trees around the one that is searched, the innermost last: what a group's own input is linked to stands there.
    let mut trees: Vec<&[Node]> = vec![&graph.nodes];
    let mut reader = output_with_volume(graph)?;
    let mut input = Some(&reader.inputs["Volume"]);
    // Every round leaves a node behind; a ring of reroutes would leave the same ones for ever.
    let rounds = graph.nodes.len() + graph.groups.iter().map(|group| group.nodes.len()).sum::<usize>();
    for _ in 0..=rounds * DEEPEST_NESTING {
        let nodes = *trees.last().expect("the material's own tree is never left");
        let (name, socket) = match input {
            Some(Input::Link { node, socket }) => (node, socket),
            Some(Input::GroupInput(group_input)) if !groups.is_empty() => {
                let caller: String = groups.pop().expect("it is not empty");
                trees.pop();
                let outside = trees.last().expect("a group stands in a tree");
                reader = outside.iter().find(|node| node.name == caller).expect("the group was entered by its name");
                input = reader.inputs.get(group_input);
                continue;
            }
            _ => return Err(missing(format!("no link to the closure that node {} passes on", reader.name))),
        };
        let node = nodes.iter().find(|node| node.name == *name).ok_or_else(|| {
            Error::new(
                format!("{place}: node {}", reader.name),
                format!("a link from \"{name}\", which does not exist"),
                "a link from a node of the same tree",
                "Export the scene again.",
            )
        })?;
        if !node.muted && node.kind == "NodeReroute" {
            (reader, input) = (node, node.inputs.get("Input"));
            continue;
        }
        let inner = node.group.as_ref().filter(|_| !node.muted).and_then(|name| graph.group(name));
        if let Some(inner) = inner.filter(|_| groups.len() < DEEPEST_NESTING) {
            let Some(output) = inner.nodes.iter().find(|node| node.kind == "NodeGroupOutput") else {
                return Err(missing(format!("group {} without an output", inner.name)));
            };
            groups.push(node.name.clone());
            trees.push(&inner.nodes);
            (reader, input) = (output, output.inputs.get(socket));
            continue;
        }
        let has_density = nodes::find(&node.kind).is_some_and(|node_type| {
            matches!(node_type.role, Role::Closure(_))
                && node_type.inputs.iter().any(|socket| socket.identifier == "Density")
        });
        if !has_density || node.muted {
            let path: String = groups.iter().flat_map(|group| [group, "/"]).collect();
            return Err(Error::new(
                format!("{place}: node {path}{}", node.name),
                if node.muted { format!("a muted {}", node.kind) } else { node.kind.clone() },
                "a closure with one Density that closes the graph: Principled Volume, Volume Scatter or Volume \
                 Absorption",
                "Name the wanted value as NODE.SOCKET (cloudparity eval), or close the graph with one such closure.",
            )
            .with_setting("target"));
        }
        return Ok((groups, node));
    }
    Err(missing("a ring of reroutes".to_owned()))
}

/// The World Output whose Surface closes a world's graph.
pub(super) fn output_with_surface(graph: &Graph) -> Result<&Node> {
    let output = active_output(&graph.nodes, "ShaderNodeOutputWorld");
    let linked = output.filter(|output| matches!(output.inputs.get("Surface"), Some(Input::Link { .. })));
    linked.ok_or_else(|| {
        Error::new(
            format!("world {}", graph.material),
            if output.is_none() { "no World Output" } else { "no link to its Surface input" },
            "a World Output whose Surface input is linked to a Background",
            "Link a Background to the Surface socket of the World Output, or take the graph out of $.world.",
        )
    })
}

/// The output of type `kind` that Cycles uses: one with the target Cycles before one for all renderers,
/// among equals the active one, else the first.
fn active_output<'a>(nodes: &'a [Node], kind: &str) -> Option<&'a Node> {
    let rank = |node: &Node| {
        let target = node.properties.get("target").and_then(|value| value.as_str()).unwrap_or("ALL");
        let active = node.properties.get("is_active_output").and_then(serde_json::Value::as_bool).unwrap_or(false);
        (target != "CYCLES", !active)
    };
    let usable = |node: &&Node| {
        node.kind == kind && node.properties.get("target").and_then(|value| value.as_str()) != Some("EEVEE")
    };
    nodes.iter().filter(usable).min_by_key(|node| rank(node))
}

/// The Density input of the closing node.
pub fn density(scene: &Scene) -> Result<Target> {
    let (groups, node) = closing_node(scene)?;
    Ok(Target { groups, ..Target::input(&node.name, "Density") })
}
