"""Builds a material's node tree from the graph of a scene: the inverse of graph_reader.

Whatever the graph asks for and Blender would change on the way (an unknown node, socket or property, a value
beyond a socket's limits) is an InputError: a graph that is built is the graph that was given.
"""

import re

import bpy

from graph_reader import is_available
from node_data import BUILT_PROPERTIES, build_node_data
from protocol import InputError
from rna import set_value

INTERFACE_TYPES = {
    "float": "NodeSocketFloat",
    "integer": "NodeSocketInt",
    "boolean": "NodeSocketBool",
    "vector": "NodeSocketVector",
    "color": "NodeSocketColor",
    "shader": "NodeSocketShader",
}
OWN_IDENTIFIER = re.compile(r"Socket_(\d+)")
# Blender hands out Socket_0, Socket_1, ... and offers no way to choose. A wanted number is reached by
# creating and removing sockets, which is done up to this number; beyond it, and for the identifiers of files
# older than Blender 4.0, a free one is used and reported.
LARGEST_REPRODUCED_NUMBER = 4096


class SharedGroups:
    """The node groups of several graphs. Blender knows groups by name: equal names mean equal groups."""

    def __init__(self, graphs):
        self.descriptions = {}
        self.built = {}
        for graph in graphs:
            for group in graph["groups"]:
                if self.descriptions.setdefault(group["name"], group) != group:
                    raise InputError(
                        f"{graph.place}.groups",
                        f'another group "{group["name"]}" than in the graph of another material',
                        "one group of each name",
                        "rename one of them",
                    )


def build_material(graph, object_for, warn, groups=None):
    """Build the graph and return the new material; `groups` are SharedGroups if it is not the only graph.

    `object_for(pointer)` returns the Blender object for the `object` of a Texture Coordinate node;
    `warn(place, message)` is told of every group socket whose identifier could not be reproduced.
    """
    return _GraphBuilder(graph, object_for, warn, groups or SharedGroups([graph])).build()


def build_world(graph, object_for, warn, groups):
    """`build_material` of a world's graph; returns the new world."""
    return _GraphBuilder(graph, object_for, warn, groups).build_world()


class _GraphBuilder:
    def __init__(self, graph, object_for, warn, groups):
        self._graph = graph
        self._object_for = object_for
        self._warn = warn
        self._descriptions = groups.descriptions
        self._groups = groups.built

    def build(self):
        material = bpy.data.materials.new(self._graph["material"])
        material.node_tree.nodes.clear()
        self._fill_tree(material.node_tree, self._graph["nodes"], "graph", _Identifiers())
        return material

    def build_world(self):
        world = bpy.data.worlds.new(self._graph["material"])
        world.node_tree.nodes.clear()
        self._fill_tree(world.node_tree, self._graph["nodes"], "world.graph", _Identifiers())
        return world

    def _group(self, name, place):
        """The node group `name` and its _Identifiers, built when first asked for."""
        if name not in self._descriptions:
            raise InputError(
                place,
                f'group "{name}"',
                f"one of {sorted(self._descriptions)}",
                "add the group to graph.groups",
            )
        if name not in self._groups:
            self._groups[name] = None
            description = self._descriptions[name]
            tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
            identifiers = _build_interface(tree, description, self._warn)
            self._fill_tree(tree, description["nodes"], f"graph.groups[{name}]", identifiers)
            self._groups[name] = (tree, identifiers)
        if self._groups[name] is None:
            raise InputError(
                place, f'group "{name}" inside itself', "groups without a cycle", "remove the node"
            )
        return self._groups[name]

    def _fill_tree(self, tree, entries, place, identifiers):
        nodes = {}
        for entry in entries:
            nodes[entry["name"]] = self._build_node(
                tree, entry, f"{place}.nodes[{entry['name']}]", identifiers
            )
        group_input = tree.nodes.new("NodeGroupInput") if identifiers.inputs else None
        # A reroute takes on the type of what feeds it, but only while nothing reads it yet.
        for entry in sorted(entries, key=lambda entry: _reroutes_before(entry, entries)):
            for name, value in entry["inputs"].items():
                where = f"{place}.nodes[{entry['name']}].inputs[{name}]"
                socket = nodes[entry["name"]].input(name, where)
                if isinstance(value, dict):
                    tree.links.new(socket, _link_source(value, nodes, group_input, identifiers, where))
                else:
                    set_value(socket, "default_value", value, where)

    def _build_node(self, tree, entry, place, identifiers):
        try:
            node = tree.nodes.new(entry["type"])
        except RuntimeError:
            raise InputError(
                place, f"type {entry['type']!r}", "a node type of Blender", "mend the type"
            ) from None
        node.name = entry["name"]
        if node.name != entry["name"]:
            raise InputError(
                place, "this name twice", "one node of each name in a tree", "rename one of them"
            )
        node.label = entry.get("label", "")
        node.location = entry["location"]
        sockets = _Identifiers()
        if entry["type"] == "ShaderNodeGroup":
            node.node_tree, sockets = self._group(entry["group"], place)
        elif entry["type"] == "NodeGroupOutput":
            sockets = _Identifiers(inputs=identifiers.outputs)
        elif entry["type"] == "NodeReroute":
            node.socket_idname = INTERFACE_TYPES[entry["socket_type"]]
        for name, value in entry.get("properties", {}).items():
            where = f"{place}.properties.{name}"
            if name == "texture_mapping":
                _build_texture_mapping(node, value, where)
                continue
            if name in BUILT_PROPERTIES:
                build_node_data(node, name, value, where)
                continue
            if isinstance(value, dict):
                value = self._object_for(value)
            set_value(node, name, value, where)
        node.mute = entry.get("muted", False)
        built = _Node(node, sockets)
        for name, value in entry.get("outputs", {}).items():
            where = f"{place}.outputs[{name}]"
            set_value(built.output(name, where), "default_value", value, where)
        return built


def _build_texture_mapping(node, entry, place):
    if not hasattr(node, "texture_mapping"):
        raise InputError(
            place, f"this on a {node.bl_idname}", "a texture node that has a mapping", "remove the property"
        )
    for field, value in entry.items():
        set_value(node.texture_mapping, field, value, f"{place}.{field}")


def _reroutes_before(entry, entries):
    """How many reroutes stand before a reroute in its chain; more than there are for any other node."""
    by_name = {item["name"]: item for item in entries if item["type"] == "NodeReroute"}
    count = 0
    while entry is not None and entry["name"] in by_name and count < len(entries):
        source = entry["inputs"].get("Input")
        entry = by_name.get(source.get("node")) if isinstance(source, dict) else None
        count += 1
        if entry is None:
            return count
    return len(entries) + 1


class _Identifiers:
    """Which identifier in Blender stands for which one of the graph; equal where nothing is said."""

    def __init__(self, inputs=None, outputs=None):
        self.inputs = inputs or {}
        self.outputs = outputs or {}


class _Node:
    """A node that was built, with its sockets by the graph's identifiers.

    They are looked up anew each time: a reroute that takes on the type of what feeds it gets other sockets.
    """

    def __init__(self, node, identifiers):
        self._node = node
        self._identifiers = identifiers

    def input(self, identifier, place):
        return _find(self._node.inputs, self._identifiers.inputs, identifier, place)

    def output(self, identifier, place):
        return _find(self._node.outputs, self._identifiers.outputs, identifier, place)


def _find(collection, translation, identifier, place):
    sockets = {socket.identifier: socket for socket in collection}
    socket = sockets.get(translation.get(identifier, identifier))
    if socket is None or not is_available(socket):
        available = [name for name, item in sockets.items() if is_available(item)]
        raise InputError(
            place,
            f'socket "{identifier}", which this node does not have in this mode',
            f"one of {available}",
            "use the identifier of the socket, and check the modes of the node",
        )
    return socket


def _link_source(value, nodes, group_input, identifiers, place):
    if "group_input" in value:
        identifier = value["group_input"]
        actual = identifiers.inputs.get(identifier)
        socket = (
            next((item for item in group_input.outputs if item.identifier == actual), None)
            if actual
            else None
        )
        if socket is None:
            raise InputError(
                place,
                f'group input "{identifier}"',
                f"one of {list(identifiers.inputs)}",
                "add the input to the group, or link to one that exists",
            )
        return socket
    if value["node"] not in nodes:
        raise InputError(place, f'node "{value["node"]}"', "a node of the same tree", "mend the link")
    return nodes[value["node"]].output(value["socket"], place)


def _build_interface(tree, description, warn):
    """Create panels and sockets of a group; return its _Identifiers."""
    wanted = [("OUTPUT", socket) for socket in description["outputs"]]
    wanted += [("INPUT", socket) for socket in description["inputs"]]
    items = _create_sockets(tree, wanted)
    panels = {}
    identifiers = _Identifiers()
    for position, ((direction, socket), item) in enumerate(zip(wanted, items, strict=True)):
        place = f"graph.groups[{tree.name}].{direction.lower()}s[{socket['identifier']}]"
        for field, attribute in (("subtype", "subtype"), ("min", "min_value"), ("max", "max_value")):
            if field in socket:
                set_value(item, attribute, socket[field], f"{place}.{field}")
        if "default" in socket:
            set_value(item, "default_value", socket["default"], f"{place}.default")
        item.description = socket.get("description", "")
        _place_in_panel(tree.interface, item, socket.get("panel"), panels, position)
        known = identifiers.inputs if direction == "INPUT" else identifiers.outputs
        known[socket["identifier"]] = item.identifier
        if item.identifier != socket["identifier"]:
            warn(place, f"Blender names this socket {item.identifier}")
    return identifiers


def _create_sockets(tree, wanted):
    """Create a socket for each of `wanted` [(direction, socket)], if possible with its identifier."""
    numbers = {}
    for index, (_, socket) in enumerate(wanted):
        match = OWN_IDENTIFIER.fullmatch(socket["identifier"])
        if match and int(match[1]) <= LARGEST_REPRODUCED_NUMBER:
            numbers[int(match[1])] = index
    items = [None] * len(wanted)
    surplus = []
    for number in range(max(numbers, default=-1) + 1):
        if number in numbers:
            items[numbers[number]] = _new_socket(tree, *wanted[numbers[number]])
        else:
            surplus.append(
                tree.interface.new_socket(name="surplus", in_out="INPUT", socket_type="NodeSocketFloat")
            )
    for item in surplus:
        tree.interface.remove(item)
    for index, item in enumerate(items):
        if item is None:
            items[index] = _new_socket(tree, *wanted[index])
    return items


def _new_socket(tree, direction, socket):
    return tree.interface.new_socket(
        name=socket["name"], in_out=direction, socket_type=INTERFACE_TYPES[socket["type"]]
    )


def _place_in_panel(interface, item, panel, panels, position):
    """Move the socket behind its predecessors, in the root or in a panel. Panels are created at first use."""
    if panel is None:
        interface.move(item, position)
        return
    if panel not in panels:
        panels[panel] = interface.new_panel(panel)
    interface.move_to_parent(item, panels[panel], len(panels[panel].interface_items))
