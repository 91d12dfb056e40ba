//! Groups, reroutes, muted nodes and implicit conversions resolved into one flat list of nodes.

use crate::base::error::{Error, Result};
use crate::graph::{Note, Target, world_coordinates};
use crate::nodes::{self, Mode, NodeType, Role, SourceContext, SourceValue, refused};
use crate::scene::volume_grid::DENSITY;
use crate::scene::{DEEPEST_NESTING, Folded, Graph, Group, Input, Node, Release, Socket, SocketType, Volume};
use std::collections::{HashMap, HashSet};

/// Where a component comes from, before registers are numbered.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Source {
    Constant(f32),
    /// A number that Cycles takes for a constant and Blender does not.
    LateConstant(f32),
    /// A number that is known here and that neither Blender nor Cycles folds: it simplifies nothing.
    Runtime(f32),
    Position(usize),
    Attribute(usize, usize),
    /// Node number, component counted over all its existing outputs.
    Node(usize, usize),
}

/// A node with its inputs resolved to components.
pub(super) struct FlatNode {
    pub label: String,
    pub node_type: &'static NodeType,
    pub mode: Mode,
    pub inputs: Vec<Source>,
    /// All inputs are constant for Blender, which evaluates the node itself, by its own rules.
    pub constant: bool,
    /// First of three inputs that are the coordinate of a texture that varies. Where the coordinate itself is a constant,
    /// Cycles takes it for a socket without a link, and the texture reads Generated instead.
    pub coordinate: Option<usize>,
    /// For every socket of a node of Cycles, whether it is linked; empty for what stands for no such node.
    pub linked: Vec<bool>,
    /// Where a texture with constant inputs stands in the file, and what is stored of its values; none for any other node.
    pub folded: Option<Box<StoredTexture>>,
}

/// A texture that Blender evaluates by a function of its own.
pub(super) struct StoredTexture {
    /// The group whose tree it is in; none for the material's own.
    pub group: Option<String>,
    /// The node.
    pub node: String,
    /// Values of Blender, by inputs.
    pub known: Vec<Folded>,
}

/// The flat graph; `nodes` are in evaluation order.
pub(super) struct Flat {
    pub nodes: Vec<FlatNode>,
    pub outputs: Vec<(String, SocketType, Vec<Source>)>,
    pub attributes: Vec<String>,
    pub notes: Vec<Note>,
    /// Generated coordinates as an affine map of the position.
    pub generated: [[f32; 4]; 3],
}

/// Inputs of an affine map of the position with these rows.
pub(super) fn affine_inputs(rows: [[f32; 4]; 3]) -> Vec<Source> {
    let mut inputs: Vec<Source> = (0..3).map(Source::Position).collect();
    for column in 0..4 {
        inputs.extend(rows.iter().map(|row| Source::Constant(row[column])));
    }
    inputs
}

/// A resolved value and its type.
pub(super) type Resolved = (SocketType, Vec<Source>);

/// A tree in the place where it is used.
pub(super) struct Tree<'a> {
    path: Vec<String>,
    nodes: &'a [Node],
    /// Nodes by name.
    by_name: HashMap<&'a str, &'a Node>,
    /// The group and the group node, unless this is the material's own tree.
    pub(super) group: Option<(&'a Group, &'a Node, usize)>,
}

impl<'a> Tree<'a> {
    fn new(path: Vec<String>, nodes: &'a [Node], group: Option<(&'a Group, &'a Node, usize)>) -> Self {
        let mut by_name = HashMap::with_capacity(nodes.len());
        for node in nodes {
            // The loader refuses repeated names; of a scene made in memory the first one counts.
            by_name.entry(node.name.as_str()).or_insert(node);
        }
        Self { path, nodes, by_name, group }
    }
}

/// Links may lead through this many nodes. The flattener follows them by recursion, on a stack of
/// its own that holds this many levels.
const DEEPEST_CHAIN: usize = 25_000;

/// Bytes of stack per node of a chain: about twice what an unoptimised build uses.
const STACK_PER_NODE: usize = 16 * 1024;

pub(super) struct Flattener<'a> {
    pub(super) graph: &'a Graph,
    volume: &'a Volume,
    /// The graph is a world's: positions are directions.
    pub(super) is_world: bool,
    pub(super) trees: Vec<Tree<'a>>,
    tree_numbers: HashMap<Vec<String>, usize>,
    pub(super) flat: Flat,
    /// Flat numbers of the nodes that evaluate, by tree and name.
    done: HashMap<(usize, &'a str), usize>,
    /// Nodes between the target and the present one, by tree and name: in order, and to look up.
    open: Vec<(usize, &'a str)>,
    is_open: HashSet<(usize, &'a str)>,
    noted: HashSet<(String, &'static str, String)>,
}

/// The flat graph of these targets.
pub(super) fn flatten(graph: &Graph, volume: &Volume, targets: &[Target]) -> Result<Flat> {
    with_flattener(graph, volume, |flattener| {
        for target in targets {
            let (kind, sources) = flattener.target(target)?;
            flattener.flat.outputs.push((target.name(), kind, sources));
        }
        Ok(())
    })
    .map(|(flat, ())| flat)
}

/// Lets `work` ask for values, with a stack that is deep enough; returns the flat graph and its result.
pub(super) fn with_flattener<'a, T: Send>(
    graph: &'a Graph,
    volume: &'a Volume,
    work: impl FnOnce(&mut Flattener<'a>) -> Result<T> + Send,
) -> Result<(Flat, T)> {
    let stack = DEEPEST_CHAIN * STACK_PER_NODE;
    std::thread::scope(|scope| {
        let run = || {
            let mut flattener = Flattener::new(graph, volume);
            let result = work(&mut flattener)?;
            flattener.note_unreached();
            Ok((flattener.flat, result))
        };
        let thread = std::thread::Builder::new().stack_size(stack).spawn_scoped(scope, run);
        let thread = thread.map_err(|cause| {
            Error::new(
                "graph compiler",
                cause.to_string(),
                format!("a thread with {stack} bytes of address space for its stack"),
                "Allow the program more memory or threads.",
            )
        })?;
        thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

impl<'a> Flattener<'a> {
    fn new(graph: &'a Graph, volume: &'a Volume) -> Self {
        Self {
            graph,
            volume,
            is_world: false,
            trees: vec![Tree::new(Vec::new(), &graph.nodes, None)],
            tree_numbers: HashMap::new(),
            flat: Flat {
                nodes: Vec::new(),
                outputs: Vec::new(),
                attributes: Vec::new(),
                notes: Vec::new(),
                generated: generated_rows(&volume.texture_space),
            },
            done: HashMap::new(),
            open: Vec::new(),
            is_open: HashSet::new(),
            noted: HashSet::new(),
        }
    }

    pub(super) fn place(&self, tree: usize, node: &str) -> String {
        let material = &self.graph.material;
        let path = &self.trees[tree].path;
        let groups: String = path.iter().map(|name| format!("{name}/")).collect();
        let owner = if self.is_world { "world" } else { "material" };
        format!("{owner} {material}: node {groups}{node}")
    }

    pub(super) fn label(&self, tree: usize, node: &str) -> String {
        self.trees[tree].path.iter().map(|name| format!("{name}/")).collect::<String>() + node
    }

    pub(super) fn note(&mut self, tree: usize, node: &Node, action: &'static str, reason: impl Into<String>) {
        let (label, reason) = (self.label(tree, &node.name), reason.into());
        if self.noted.insert((label.clone(), action, reason.clone())) {
            self.flat.notes.push(Note { node: label, node_type: node.kind.clone(), action, reason });
        }
    }

    pub(super) fn find(&self, tree: usize, name: &str, from: &str) -> Result<&'a Node> {
        self.trees[tree].by_name.get(name).copied().ok_or_else(|| {
            Error::new(
                from.to_owned(),
                format!("a link from \"{name}\", which does not exist"),
                "a link from a node of the same tree",
                "Correct the name in the scene file, or export the scene again.",
            )
        })
    }

    /// The group of a group node.
    pub(super) fn group(&self, tree: usize, node: &Node) -> Result<&'a Group> {
        let name = node.group.as_deref().unwrap_or_default();
        self.graph.group(name).ok_or_else(|| {
            Error::new(
                self.place(tree, &node.name),
                format!("a group \"{name}\" that the file does not hold"),
                "one of the groups under $.graph.groups",
                "Export the scene again.",
            )
        })
    }

    /// The tree of a group node, entered once per place.
    pub(super) fn enter(&mut self, tree: usize, node: &'a Node) -> Result<usize> {
        let place = self.place(tree, &node.name);
        let group = self.group(tree, node)?;
        let name = &group.name;
        let mut path = self.trees[tree].path.clone();
        path.push(node.name.clone());
        if path.len() > DEEPEST_NESTING {
            return Err(Error::new(
                place,
                format!("groups nested more than {DEEPEST_NESTING} deep"),
                "groups that do not hold themselves",
                "Break the ring of groups.",
            ));
        }
        if let Some(&number) = self.tree_numbers.get(&path) {
            return Ok(number);
        }
        for identifier in node.inputs.keys() {
            if !group.inputs.iter().any(|socket| socket.identifier == *identifier) {
                return Err(unknown_input(
                    &place,
                    identifier,
                    group.inputs.iter().map(|socket| socket.identifier.as_str()),
                ));
            }
        }
        self.note(tree, node, "inlined", format!("group \"{name}\""));
        let number = self.trees.len();
        self.tree_numbers.insert(path.clone(), number);
        self.trees.push(Tree::new(path, &group.nodes, Some((group, node, tree))));
        Ok(number)
    }

    fn target(&mut self, target: &Target) -> Result<Resolved> {
        let from = format!("target {}", target.name());
        let mut tree = 0;
        for name in &target.groups {
            let node = self.find(tree, name, &from)?;
            tree = self.enter(tree, node)?;
        }
        let node = self.find(tree, &target.node, &from)?;
        match (&target.output, &target.input) {
            (Some(output), _) => {
                let found = self.output(tree, node, output)?;
                // Asked for from outside, a group's output has its own type again.
                let declared = self.group_output_kind(node, output);
                Ok(match found {
                    Some((found, sources)) => {
                        let declared = declared.unwrap_or(found);
                        (declared, self.convert(tree, node, found, declared, sources))
                    }
                    None => (SocketType::Float, vec![Source::Constant(0.0)]),
                })
            }
            (None, Some(input)) => {
                let node_type = self.node_type(tree, node)?;
                self.check_inputs(tree, node, node_type)?;
                let socket = node_type.inputs.iter().find(|socket| socket.identifier == input).ok_or_else(|| {
                    Error::new(from.clone(), "no such input", "an input of that node", "Check the identifier.")
                })?;
                let sources = self.input(tree, node, socket)?;
                Ok((socket.kind, sources))
            }
            (None, None) => Err(Error::new(from, "no socket", "NODE.SOCKET", "Name a socket.")),
        }
    }

    pub(super) fn node_type(&self, tree: usize, node: &Node) -> Result<&'static NodeType> {
        nodes::find(&node.kind).ok_or_else(|| nodes::refused::error(self.place(tree, &node.name), &node.kind))
    }

    /// The value of an output; none where a muted node or a reroute has nothing to pass on: Blender
    /// then ignores the link, and what reads the output has the value of an unlinked input.
    pub(super) fn output(&mut self, tree: usize, node: &'a Node, socket: &str) -> Result<Option<Resolved>> {
        let key = (tree, node.name.as_str());
        if let Some(&number) = self.done.get(&key) {
            // Met before: no need to follow its links again.
            let node_type = self.flat.nodes[number].node_type;
            return self.node_output(tree, node, node_type, socket).map(Some);
        }
        self.guarded(tree, node, |flattener| flattener.output_unguarded(tree, node, socket))
    }

    /// Follows a node's links with the node marked as open: a cycle of links and a chain that is too long are
    /// errors.
    pub(super) fn guarded<T>(
        &mut self,
        tree: usize,
        node: &'a Node,
        follow: impl FnOnce(&mut Self) -> Result<T>,
    ) -> Result<T> {
        let key = (tree, node.name.as_str());
        if self.is_open.contains(&key) {
            let first = self.open.iter().position(|known| *known == key).unwrap_or_default();
            let ring = &self.open[first..];
            let mut names: Vec<_> = ring.iter().take(8).map(|(tree, name)| self.label(*tree, name)).collect();
            if ring.len() > names.len() {
                names.push(format!("({} more)", ring.len() - names.len()));
            }
            return Err(Error::new(
                self.place(tree, &node.name),
                format!("a cycle of links: {} -> {}", names.join(" -> "), self.label(tree, &node.name)),
                "a graph without cycles",
                "Remove one of these links.",
            ));
        }
        if self.open.len() >= DEEPEST_CHAIN {
            return Err(Error::new(
                self.place(tree, &node.name),
                format!("a chain of links through more than {DEEPEST_CHAIN} nodes"),
                format!("at most {DEEPEST_CHAIN} nodes one after the other"),
                "Shorten the chain.",
            ));
        }
        self.open.push(key);
        self.is_open.insert(key);
        let result = follow(self);
        self.is_open.remove(&key);
        self.open.pop();
        result
    }

    /// [`Self::output`] of a node that is marked as open.
    pub(super) fn output_unguarded(&mut self, tree: usize, node: &'a Node, socket: &str) -> Result<Option<Resolved>> {
        if node.muted {
            return self.bypassed(tree, node, socket);
        }
        match node.kind.as_str() {
            "NodeReroute" => {
                let kind = self.reroute_type(tree, node)?;
                self.note(tree, node, "inlined", "reroute");
                match node.inputs.get("Input") {
                    Some(input) if is_link(input) => self.passed(tree, node, "Input", input, kind),
                    _ => Ok(None),
                }
            }
            "ShaderNodeGroup" => self.group_output(tree, node, socket).map(Some),
            _ => {
                let node_type = self.node_type(tree, node)?;
                self.node_output(tree, node, node_type, socket).map(Some)
            }
        }
    }

    fn group_output(&mut self, tree: usize, node: &'a Node, socket: &str) -> Result<Resolved> {
        let inner = self.enter(tree, node)?;
        let group = self.trees[inner].group.expect("an entered group").0;
        let interface = group.outputs.iter().find(|output| output.identifier == socket).ok_or_else(|| {
            Error::new(
                self.place(tree, &node.name),
                format!("a link from output \"{socket}\""),
                format!("an output of the group \"{}\"", group.name),
                "Correct the identifier, or export the scene again.",
            )
        })?;
        let Some(end) = group.nodes.iter().find(|node| node.kind == "NodeGroupOutput") else {
            // Measured in 5.0.1 and 5.3.0: 0, whatever the interface's default is. A group that is missing in its library is like this.
            self.note(tree, node, "folded", format!("\"{}\" has no Group Output: its outputs are 0", group.name));
            return Ok((interface.kind, vec![Source::Constant(0.0); interface.kind.components()]));
        };
        let passed = match end.inputs.get(socket) {
            Some(input) => self.passed(inner, end, socket, input, interface.kind)?,
            None => None,
        };
        self.at_interface(inner, end, passed, interface)
    }

    /// What a group's socket hands on: a constant converted to its type, anything else as it is, and
    /// its default where nothing arrives.
    fn at_interface(
        &mut self,
        tree: usize,
        node: &Node,
        passed: Option<Resolved>,
        interface: &crate::scene::Socket,
    ) -> Result<Resolved> {
        match passed {
            Some((found, sources)) => Ok(self.settled(tree, node, found, interface.kind, sources)),
            None => Ok((interface.kind, self.interface_default(tree, node, interface)?)),
        }
    }

    /// Constants are converted by every socket that they pass; other values by the node that reads
    /// them, because Blender inlines groups and muted nodes before it converts.
    fn settled(
        &mut self,
        tree: usize,
        node: &Node,
        found: SocketType,
        declared: SocketType,
        sources: Vec<Source>,
    ) -> Resolved {
        if found == declared {
            return (found, sources);
        }
        if !sources.iter().all(|source| self.is_constant(source)) {
            // Up to Blender 4.5 every socket of a group and of a muted node converts.
            let values = [SocketType::Float, SocketType::Vector, SocketType::Color];
            return match self.graph.blender {
                Release::V4_5 if values.contains(&declared) => {
                    (declared, self.convert(tree, node, found, declared, sources))
                }
                _ => (found, sources),
            };
        }
        let mut sources = self.convert(tree, node, found, declared, sources);
        let operation = match declared {
            SocketType::Integer => "TRUNC",
            SocketType::Boolean => "GREATER_THAN",
            _ => return (declared, sources),
        };
        if declared == SocketType::Boolean {
            sources.push(Source::Constant(0.0));
        }
        (declared, self.math(tree, node, operation, sources))
    }

    fn is_constant(&self, source: &Source) -> bool {
        match source {
            Source::Constant(_) => true,
            Source::Node(number, _) => self.flat.nodes[*number].constant,
            Source::LateConstant(_) | Source::Runtime(_) | Source::Position(_) | Source::Attribute(..) => false,
        }
    }

    /// Declared type of a group node's output.
    fn group_output_kind(&self, node: &Node, socket: &str) -> Option<SocketType> {
        let group = self.graph.group(node.group.as_deref()?)?;
        group.outputs.iter().find(|output| output.identifier == socket).map(|output| output.kind)
    }

    /// The value of a group's socket where none is stored beside the node.
    fn interface_default(&self, tree: usize, node: &Node, socket: &Socket) -> Result<Vec<Source>> {
        if socket.kind == SocketType::Shader {
            return Ok(Vec::new());
        }
        let values = socket.default_components().ok_or_else(|| {
            Error::new(
                format!("{}: socket {}", self.place(tree, &node.name), socket.identifier),
                "no value and no default",
                "a value, a link, or a default in the group's interface",
                "Export the scene again.",
            )
        })?;
        Ok(values.into_iter().map(Source::Constant).collect())
    }

    pub(super) fn reroute_type(&self, tree: usize, node: &Node) -> Result<SocketType> {
        node.socket_type.ok_or_else(|| {
            Error::new(
                format!("{}: socket_type", self.place(tree, &node.name)),
                "nothing",
                "the type of the reroute: float, integer, boolean, vector, color or shader",
                "Add it, or export the scene again.",
            )
        })
    }

    /// A muted node passes on the linked input that `bypass` names.
    fn bypassed(&mut self, tree: usize, node: &'a Node, socket: &str) -> Result<Option<Resolved>> {
        let kinds = self.socket_kinds(tree, node)?;
        let kind_of = |identifier: &str, is_output: bool| {
            let found = kinds.iter().find(|(name, output, _)| name == identifier && *output == is_output);
            found.map(|(_, _, kind)| *kind).ok_or_else(|| {
                let what = if is_output { "output" } else { "input" };
                Error::new(
                    self.place(tree, &node.name),
                    format!("{what} \"{identifier}\", which the node does not have"),
                    format!("an {what} of {}", node.kind),
                    "Correct the identifier, or export the scene again.",
                )
            })
        };
        let kind = kind_of(socket, true)?;
        let through = node.bypass.as_ref().and_then(|bypass| bypass.get(socket));
        let input_kind = through.map(|name| kind_of(name, false)).transpose()?.unwrap_or(kind);
        let input = through.and_then(|name| node.inputs.get(name.as_str())).filter(|input| is_link(input));
        let (Some(through), Some(input)) = (through, input) else {
            self.note(tree, node, "bypassed", "muted, without a link to pass on: what reads it counts as unlinked");
            return Ok(None);
        };
        self.note(tree, node, "bypassed", format!("muted: {socket} is {through}"));
        let Some((found, sources)) = self.passed(tree, node, through, input, input_kind)? else { return Ok(None) };
        let (found, sources) = self.settled(tree, node, found, input_kind, sources);
        Ok(Some(self.settled(tree, node, found, kind, sources)))
    }

    /// Identifier, whether it is an output, and kind of every socket of a node.
    fn socket_kinds(&self, tree: usize, node: &Node) -> Result<Vec<(String, bool, SocketType)>> {
        if node.kind == "ShaderNodeGroup" {
            let group = self.group(tree, node)?;
            let sockets = |list: &[Socket], output: bool| {
                list.iter().map(|socket| (socket.identifier.clone(), output, socket.kind)).collect::<Vec<_>>()
            };
            return Ok([sockets(&group.inputs, false), sockets(&group.outputs, true)].concat());
        }
        if node.kind == "NodeReroute" {
            let kind = self.reroute_type(tree, node)?;
            return Ok(vec![("Input".to_owned(), false, kind), ("Output".to_owned(), true, kind)]);
        }
        let node_type = self.node_type(tree, node)?;
        let inputs = node_type.inputs.iter().map(|socket| (socket.identifier.to_owned(), false, socket.kind));
        let outputs = node_type.outputs.iter().map(|socket| (socket.identifier.to_owned(), true, socket.kind));
        Ok(inputs.chain(outputs).collect())
    }

    fn node_output(
        &mut self,
        tree: usize,
        node: &'a Node,
        node_type: &'static NodeType,
        socket: &str,
    ) -> Result<Resolved> {
        let place = self.place(tree, &node.name);
        if self.is_world
            && let Some((kind, value)) = world_coordinates::coordinate(node, socket)
        {
            return Ok((kind, self.source(tree, node, value)));
        }
        refuse_settings(node_type, node, &place)?;
        nodes::additions::check(node_type.type_name, &node.properties, self.graph.blender, &place)?;
        let mode = Mode::of_node(node_type, node, &place)?.with_release(self.graph.blender);
        let existing: Vec<_> = node_type.outputs_of(&mode).collect();
        let Some(position) = existing.iter().position(|output| output.identifier == socket) else {
            let names: Vec<_> = existing.iter().map(|output| output.identifier).collect();
            return Err(Error::new(
                place,
                format!("a link from output \"{socket}\""),
                format!("one of the outputs of {} in this mode: {}", node_type.label, names.join(", ")),
                "Correct the identifier, or export the scene again.",
            ));
        };
        let kind = existing[position].kind;
        match &node_type.role {
            Role::Closure(_) => Err(Error::new(
                place,
                "a closure",
                "a value (float, vector or colour)",
                "Link a value output; closures only feed the Material Output.",
            )),
            Role::Source(resolve) => {
                let context = SourceContext {
                    matrix_world: &self.volume.matrix_world,
                    volume: self.volume,
                    place: &place,
                    node,
                    has_grid: self.volume.grid.is_some(),
                };
                let value = resolve(&context, &mode, socket)?;
                Ok((kind, self.source(tree, node, value)))
            }
            Role::Evaluated(_) => {
                let number = match self.done.get(&(tree, node.name.as_str())) {
                    Some(&number) => number,
                    None => self.evaluated(tree, node, node_type, mode)?,
                };
                let first: usize = existing[..position].iter().map(|output| output.kind.components()).sum();
                let sources = (0..kind.components()).map(|component| Source::Node(number, first + component)).collect();
                Ok((kind, sources))
            }
        }
    }

    fn evaluated(&mut self, tree: usize, node: &'a Node, node_type: &'static NodeType, mode: Mode) -> Result<usize> {
        let mut inputs = Vec::new();
        // Where the coordinate of a texture stands among the inputs.
        let mut coordinate = None;
        for socket in node_type.inputs_of(&mode) {
            if socket.generated_when_unlinked {
                coordinate = Some(inputs.len());
            }
            inputs.extend(self.input(tree, node, socket)?);
        }
        self.check_inputs(tree, node, node_type)?;
        let outputs = node_type.outputs_of(&mode).map(|output| output.identifier).collect();
        let label = self.label(tree, &node.name);
        let mut mode = mode.with_wanted(outputs);
        if node_type.type_name == nodes::vector_transform::TYPE.type_name {
            let place = self.place(tree, &node.name);
            mode = mode.with_frame(nodes::vector_transform::Frame::of(
                &self.volume.matrix_world,
                self.graph.blender,
                &place,
            )?);
        }
        let is_linked =
            |socket: &nodes::InputSocket| matches!(node.inputs.get(socket.identifier), Some(input) if is_link(input));
        let constant = self.folds_early(node_type, &mode, &inputs)
            && node_type.inputs_of(&mode).all(|socket| !socket.folds_only_linked || is_linked(socket));
        let mut read_late = coordinate.filter(|_| !constant);
        if let Some(first) = coordinate.filter(|_| !constant) {
            // Blender ignores the texture's own mapping where it evaluates the texture itself.
            let before = self.flat.nodes.len();
            let mapped = self.texture_mapped(tree, node, inputs[first..first + 3].to_vec())?;
            inputs.splice(first..first + 3, mapped);
            if let Some(mapping) = self.flat.nodes.get_mut(before) {
                // What the mapping reads is what Cycles replaces.
                mapping.coordinate = read_late.take().map(|_| 0);
            }
        }
        let number = self.flat.nodes.len();
        let linked = node_type.inputs_of(&mode).map(is_linked).collect();
        let folded = (constant && coordinate.is_some()).then(|| {
            let group = self.trees[tree].group.map(|(group, ..)| group.name.clone());
            Box::new(StoredTexture { group, node: node.name.clone(), known: node.folded.clone() })
        });
        self.flat.nodes.push(FlatNode {
            label,
            node_type,
            mode,
            inputs,
            constant,
            coordinate: read_late,
            linked,
            folded,
        });
        self.done.insert((tree, node.name.as_str()), number);
        Ok(number)
    }

    /// Whether Blender itself evaluates a node with these inputs. Up to 4.5 it leaves all to Cycles.
    fn folds_early(&self, node_type: &NodeType, mode: &Mode, inputs: &[Source]) -> bool {
        let Role::Evaluated(build) = node_type.role else { return false };
        if self.graph.blender == Release::V4_5 {
            return false;
        }
        inputs.iter().all(|source| self.is_constant(source)) && build(mode).folds_early()
    }

    /// A texture's coordinate behind the mapping that the texture carries itself.
    fn texture_mapped(&mut self, tree: usize, node: &Node, coordinate: Vec<Source>) -> Result<Vec<Source>> {
        use nodes::texture_mapping::{PROPERTY, TYPE, TextureMapping};
        let Some(value) = node.properties.get(PROPERTY) else { return Ok(coordinate) };
        let place = format!("{}: property {PROPERTY}", self.place(tree, &node.name));
        let Some(mapping) = TextureMapping::read(value, &place)? else { return Ok(coordinate) };
        let mut properties = serde_json::Map::new();
        properties.insert("unit".into(), mapping.unit.into());
        let constants = mapping.columns.into_iter().flatten().map(Source::Constant);
        let inputs = coordinate.into_iter().chain(constants).collect();
        Ok(self.internal(tree, node, &TYPE, &properties, inputs, 3))
    }

    /// Refuses inputs that the node type does not have: a misspelt one would leave a default in place.
    pub(super) fn check_inputs(&self, tree: usize, node: &Node, node_type: &'static NodeType) -> Result<()> {
        for identifier in node.inputs.keys() {
            if !node_type.inputs.iter().any(|socket| socket.identifier == identifier) {
                let known = node_type.inputs.iter().map(|socket| socket.identifier);
                return Err(unknown_input(&self.place(tree, &node.name), identifier, known));
            }
        }
        Ok(())
    }

    pub(super) fn input(&mut self, tree: usize, node: &'a Node, socket: &nodes::InputSocket) -> Result<Vec<Source>> {
        let own = self.own_input(tree, node, socket)?;
        match socket.times_grid {
            Some(named_by) if self.volume.grid.is_some() => self.times_grid(tree, node, named_by, own),
            _ => Ok(own),
        }
    }

    /// The product of an input, 0 where it is below, and the object's grid, which the text input `named_by` has to name.
    fn times_grid(&mut self, tree: usize, node: &Node, named_by: &str, own: Vec<Source>) -> Result<Vec<Source>> {
        if let Some(Input::Text(name)) = node.inputs.get(named_by)
            && name != DENSITY
        {
            return Err(Error::new(
                format!("{}: input {named_by}", self.place(tree, &node.name)),
                format!("\"{name}\""),
                format!("\"{DENSITY}\", the grid of the object"),
                "Name that grid.",
            ));
        }
        let grid = self.source(tree, node, SourceValue::Grid);
        let positive = self.math(tree, node, "MAXIMUM", [own, vec![Source::Constant(0.0)]].concat());
        Ok(self.math(tree, node, "MULTIPLY", [positive, grid].concat()))
    }

    /// What a Math node makes of its inputs.
    pub(super) fn math(&mut self, tree: usize, node: &Node, operation: &str, inputs: Vec<Source>) -> Vec<Source> {
        let mut properties = serde_json::Map::new();
        properties.insert("operation".into(), operation.into());
        self.internal(tree, node, &nodes::math::TYPE, &properties, inputs, 1)
    }

    /// A value within [0, 1].
    pub(super) fn clamped(&mut self, node: &Node, value: Source) -> Source {
        let mut properties = serde_json::Map::new();
        properties.insert("operation".into(), "ADD".into());
        properties.insert("use_clamp".into(), true.into());
        self.internal(0, node, &nodes::math::TYPE, &properties, vec![value, Source::Constant(0.0)], 1).remove(0)
    }

    fn own_input(&mut self, tree: usize, node: &'a Node, socket: &nodes::InputSocket) -> Result<Vec<Source>> {
        let given = node.inputs.get(socket.identifier);
        if let Some(input) = given.filter(|input| is_link(input) || !socket.generated_when_unlinked)
            && let Some((found, sources)) = self.passed(tree, node, socket.identifier, input, socket.kind)?
        {
            return Ok(self.convert(tree, node, found, socket.kind, sources));
        }
        if socket.generated_when_unlinked {
            return Ok(self.source(tree, node, SourceValue::Generated));
        }
        Ok(socket.default.iter().map(|&value| Source::Constant(value)).collect())
    }

    /// Resolves a stored value of `kind`, or a link to whatever its source is; none where the link leads to
    /// nothing.
    pub(super) fn passed(
        &mut self,
        tree: usize,
        node: &'a Node,
        socket: &str,
        input: &'a Input,
        kind: SocketType,
    ) -> Result<Option<Resolved>> {
        let place = format!("{}: input {socket}", self.place(tree, &node.name));
        let wrong = |found: String| {
            Error::new(
                place.clone(),
                found,
                match kind.components() {
                    1 => "a number or a link".to_owned(),
                    _ => "a list of three numbers or a link".to_owned(),
                },
                "Correct the value's type.",
            )
        };
        match input {
            Input::Number(value) if kind.components() == 1 => Ok(Some((kind, vec![Source::Constant(*value)]))),
            Input::List(values) if kind.components() == 3 && (3..=4).contains(&values.len()) => {
                Ok(Some((kind, values[..3].iter().map(|&value| Source::Constant(value)).collect())))
            }
            Input::Number(value) => Err(wrong(format!("the number {value}"))),
            Input::List(values) => Err(wrong(format!("a list of {} numbers", values.len()))),
            Input::Text(text) => Err(wrong(format!("the text \"{text}\""))),
            Input::Link { node: name, socket: output } => {
                let from = self.find(tree, name, &place)?;
                let passed = self.output(tree, from, output)?;
                let closure = matches!(passed, Some((SocketType::Shader, _)));
                if closure || kind == SocketType::Shader {
                    return Err(wrong("a closure".into()));
                }
                Ok(passed)
            }
            Input::GroupInput(identifier) => self.group_input(tree, &place, identifier).map(Some),
        }
    }

    fn group_input(&mut self, tree: usize, place: &str, identifier: &str) -> Result<Resolved> {
        let Some((group, group_node, parent)) = self.trees[tree].group else {
            return Err(Error::new(
                place.to_owned(),
                format!("group_input \"{identifier}\" outside of a group"),
                "a value or a link",
                "Only nodes of a group can read its inputs.",
            ));
        };
        let interface = group.inputs.iter().find(|socket| socket.identifier == identifier).ok_or_else(|| {
            Error::new(
                place.to_owned(),
                format!("group_input \"{identifier}\""),
                format!("an input of the group \"{}\"", group.name),
                "Correct the identifier, or export the scene again.",
            )
        })?;
        let passed = match group_node.inputs.get(identifier) {
            Some(input) => self.passed(parent, group_node, identifier, input, interface.kind)?,
            None => None,
        };
        self.at_interface(parent, group_node, passed, interface)
    }

    pub(super) fn convert(
        &mut self,
        tree: usize,
        node: &Node,
        from: SocketType,
        to: SocketType,
        sources: Vec<Source>,
    ) -> Vec<Source> {
        match (from.components(), to.components()) {
            (1, 3) => vec![sources[0].clone(); 3],
            (3, 1) => {
                let name = if from == SocketType::Color { "COLOR" } else { "VECTOR" };
                let mut properties = serde_json::Map::new();
                properties.insert("from".into(), name.into());
                self.internal(tree, node, &nodes::conversion::TYPE, &properties, sources, 1)
            }
            _ => sources,
        }
    }

    /// Appends a node that has no counterpart in the file.
    fn internal(
        &mut self,
        tree: usize,
        node: &Node,
        node_type: &'static NodeType,
        properties: &serde_json::Map<String, serde_json::Value>,
        inputs: Vec<Source>,
        components: usize,
    ) -> Vec<Source> {
        let label = format!("{} {}", self.label(tree, &node.name), node_type.label);
        let mode = Mode::read(node_type, properties, &label).expect("the compiler's own properties are legal");
        let outputs = node_type.outputs_of(&mode).map(|output| output.identifier).collect();
        let mode = mode.with_wanted(outputs).with_release(self.graph.blender);
        // A lookup has no grid yet, and no kernel; but its index varies.
        let constant = self.folds_early(node_type, &mode, &inputs);
        // Conversions are nodes of Cycles; matrices are parts of textures.
        let is_conversion = node_type.type_name == nodes::conversion::TYPE.type_name;
        let linked = if is_conversion { vec![true] } else { Vec::new() };
        self.flat.nodes.push(FlatNode {
            label,
            node_type,
            mode,
            inputs,
            constant,
            coordinate: None,
            linked,
            folded: None,
        });
        let number = self.flat.nodes.len() - 1;
        (0..components).map(|component| Source::Node(number, component)).collect()
    }

    fn source(&mut self, tree: usize, node: &Node, value: SourceValue) -> Vec<Source> {
        let affine = |flattener: &mut Self, rows: [[f32; 4]; 3]| {
            let none = serde_json::Map::new();
            flattener.internal(tree, node, &nodes::affine::TYPE, &none, affine_inputs(rows), 3)
        };
        match value {
            SourceValue::Constant(values) => values.into_iter().map(Source::Constant).collect(),
            SourceValue::PerObject(values) => values.into_iter().map(Source::Runtime).collect(),
            SourceValue::LateConstant(values) => values.into_iter().map(Source::LateConstant).collect(),
            SourceValue::Position => (0..3).map(Source::Position).collect(),
            SourceValue::Affine(rows) => affine(self, rows),
            SourceValue::Generated if self.is_world => (0..3).map(Source::Position).collect(),
            SourceValue::Generated => affine(self, self.flat.generated),
            SourceValue::Grid => {
                let handle = self.volume.grid.clone().expect("the node asks only where there is a grid");
                let index = affine(self, handle.to_index());
                let none = serde_json::Map::new();
                let found = self.internal(tree, node, &nodes::texture_lookup::TYPE, &none, index, 1);
                let lookup = self.flat.nodes.last_mut().expect("it was just put there");
                lookup.mode = lookup.mode.clone().with_texture(handle.texture);
                found
            }
            SourceValue::Attribute(name) => {
                let known = self.flat.attributes.iter().position(|attribute| *attribute == name);
                let number = known.unwrap_or_else(|| {
                    self.flat.attributes.push(name);
                    self.flat.attributes.len() - 1
                });
                (0..3).map(|axis| Source::Attribute(number, axis)).collect()
            }
        }
    }

    /// Lists the nodes of every entered tree that no target reached.
    fn note_unreached(&mut self) {
        for tree in 0..self.trees.len() {
            for node in self.trees[tree].nodes {
                let evaluated =
                    nodes::find(&node.kind).is_some_and(|node_type| matches!(node_type.role, Role::Evaluated(_)));
                if evaluated && !node.muted && !self.done.contains_key(&(tree, node.name.as_str())) {
                    self.note(tree, node, "dropped", "does not reach what was asked for");
                }
            }
        }
    }
}

/// Generated coordinates in object space: rows of an affine map.
fn generated_rows(space: &crate::scene::TextureSpace) -> [[f32; 4]; 3] {
    std::array::from_fn(|axis| {
        let factor = if space.size[axis] != 0.0 { 0.5 / space.size[axis] } else { 0.0 };
        let mut row = [0.0; 4];
        row[axis] = factor;
        row[3] = -(space.location[axis] * factor - 0.5);
        row
    })
}

pub(super) fn is_link(input: &Input) -> bool {
    matches!(input, Input::Link { .. } | Input::GroupInput(_))
}

/// Refuses settings of a supported node that are no field.
fn refuse_settings(node_type: &NodeType, node: &Node, place: &str) -> Result<()> {
    for part in refused::parts(node_type.type_name) {
        let refused::Part::Setting(property, value) = part.part else { continue };
        let is_set = match node.properties.get(property) {
            Some(serde_json::Value::String(found)) => found == value,
            Some(serde_json::Value::Bool(found)) => value == if *found { "true" } else { "false" },
            Some(_) => false,
            None => false,
        };
        if is_set {
            return Err(Error::new(
                format!("{place}: property {property}"),
                format!("{value}, which {}", part.reason),
                format!("another value of {}", node_type.label),
                part.instead,
            ));
        }
    }
    Ok(())
}

fn unknown_input<'a>(place: &str, identifier: &str, known: impl Iterator<Item = &'a str>) -> Error {
    Error::new(
        format!("{place}: input {identifier}"),
        "an input that the node does not have",
        format!("one of {}", known.collect::<Vec<_>>().join(", ")),
        "Correct the identifier, or export the scene again.",
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::bare_scene;
    use serde_json::{Value as Json, json};

    fn node(name: &str, kind: &str, properties: Json, inputs: Json) -> Json {
        json!({"name": name, "type": format!("ShaderNode{kind}"), "properties": properties, "inputs": inputs})
    }

    fn link(node: &str, socket: &str) -> Json {
        json!({"node": node, "socket": socket})
    }

    fn flat(nodes: &[Json], target: Target) -> Result<Flat> {
        let scene = bare_scene("test", json!({"material": "Material", "nodes": nodes, "groups": []}))?;
        flatten(scene.graph(), &scene.volume, &[target])
    }

    /// Whether Blender evaluates a Math node that reads this.
    fn folds(nodes: &[Json], read: Json) -> bool {
        let nodes: Vec<Json> =
            nodes.iter().cloned().chain([node("M", "Math", json!({}), json!({"Value": read}))]).collect();
        let flat = flat(&nodes, Target::output("M", "Value")).expect("a graph");
        flat.nodes.iter().find(|node| node.label == "M").expect("the reader").constant
    }

    #[test]
    fn what_blender_does_not_fold_makes_its_readers_vary() {
        let value = json!({"name": "V", "type": "ShaderNodeValue", "outputs": {"Value": 2.0}});
        assert!(folds(&[value], link("V", "Value")));
        assert!(folds(&[node("R", "VectorRotate", json!({}), json!({}))], link("R", "Vector")));
        for (kind, output) in [
            ("Mapping", "Vector"),
            ("VectorTransform", "Vector"),
            ("Normal", "Dot"),
            ("ObjectInfo", "Alpha"),
            ("ObjectInfo", "Location"),
        ] {
            assert!(!folds(&[node("N", kind, json!({}), json!({}))], link("N", output)), "{kind} {output}");
        }
    }

    #[test]
    fn a_mapping_of_a_texture_stands_before_it_unless_blender_folds_the_texture() {
        let mapped = |source: Json| {
            let nodes = [
                node("P", "TexCoord", json!({}), json!({})),
                node("C", "CombineXYZ", json!({}), json!({"X": 0.5})),
                node("T", "TexNoise", json!({"texture_mapping": {"scale": [2, 2, 2]}}), json!({"Vector": source})),
            ];
            let flat = flat(&nodes, Target::output("T", "Fac")).expect("a graph");
            flat.nodes.iter().any(|node| node.label == "T (texture mapping)")
        };
        assert!(mapped(link("P", "Object")));
        // Stored, the coordinate is not read: Generated is.
        assert!(mapped(json!([0.0, 0.0, 0.0])));
        assert!(!mapped(link("C", "Vector")));
    }

    #[test]
    fn the_space_of_the_camera_is_refused() {
        let nodes = [node("T", "VectorTransform", json!({"convert_to": "CAMERA"}), json!({}))];
        let error = flat(&nodes, Target::output("T", "Vector")).err().expect("refused");
        assert_eq!(error.place, "material Material: node T: property convert_to");
        assert!(error.found.contains("camera"), "{error}");
    }
}
