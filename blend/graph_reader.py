"""Reads a material's node tree into the graph of a scene.

Sockets and properties are read by reflection, so a node type that is new to this module needs no line here.
Special cases are the things that are no plain value: groups, group inputs and outputs, reroutes, frames, the
object of Texture Coordinate, `texture_mapping`, color ramps and curves (node_data.py), and the three nodes
that keep a value in an output socket.
"""

import bpy
import numpy as np

from node_data import is_node_data, read_node_data, reason_against
from protocol import InputError
from scene_io import matrix_rows, shortest, shortest_list

SOCKET_TYPES = {
    "VALUE": "float",
    "INT": "integer",
    "BOOLEAN": "boolean",
    "VECTOR": "vector",
    "RGBA": "color",
    "SHADER": "shader",
}
INTERFACE_TYPES = {
    "NodeSocketFloat": "float",
    "NodeSocketInt": "integer",
    "NodeSocketBool": "boolean",
    "NodeSocketVector": "vector",
    "NodeSocketColor": "color",
    "NodeSocketShader": "shader",
}
# Strings name attributes of the geometry (Principled Volume); a mesh has none of them and they count as 1.
# CUSTOM is the empty socket at the end of a group output, which only the editor uses.
VALUELESS_SOCKET_TYPES = {"STRING", "CUSTOM"}
OUTPUT_VALUE_NODES = {"ShaderNodeValue", "ShaderNodeRGB", "ShaderNodeNormal"}
LAYOUT_NODES = {"NodeFrame", "NodeGroupInput"}
# In shaders since Blender 5.2. A scene file is of one frame: its outputs are the numbers that Cycles gets.
SCENE_TIME = "GeometryNodeInputSceneTime"
OUTPUT_NODES = {"ShaderNodeOutputMaterial", "ShaderNodeOutputWorld"}
IDENTITY_MAPPING = {
    "translation": [0.0, 0.0, 0.0],
    "rotation": [0.0, 0.0, 0.0],
    "scale": [1.0, 1.0, 1.0],
    "mapping_x": "X",
    "mapping_y": "Y",
    "mapping_z": "Z",
}


class Inexpressible(Exception):
    """A node that the graph format has no words for. Fatal only if it reaches the volume."""

    def __init__(self, found, expected, remedy):
        super().__init__(found)
        self.reason = (found, expected, remedy)


def is_available(socket):
    """Whether the socket exists in the present mode of its node.

    The open file is asked, not what is evaluated of it: in evaluated groups of 5.3 every socket exists.
    """
    tree = socket.id_data
    if tree.is_evaluated:
        node = tree.original.nodes[socket.node.name]
        sockets = node.outputs if socket.is_output else node.inputs
        socket = next((twin for twin in sockets if twin.identifier == socket.identifier), socket)
    return socket.enabled and not socket.is_unavailable


def live_links(tree):
    """Return the links that carry a value, as {(node name, input identifier): link}. A muted link, and a link
    at a socket of another mode, carries none; nor does one from muted nodes or reroutes that nothing feeds,
    and none that Blender draws in red, as of a closure at the socket of a number (measured in 5.0.1 and
    5.3.0): Blender then uses the value that the reading socket stores."""
    links = {
        (link.to_node.name, link.to_socket.identifier): link
        for link in tree.links
        if not link.is_muted
        and link.is_valid
        and is_available(link.from_socket)
        and is_available(link.to_socket)
    }
    return {key: link for key, link in links.items() if _is_fed(link.from_socket, links)}


def _is_fed(source, links):
    """Whether a value arrives at the output `source` of a node, `links` being those of its tree."""
    for _ in range(len(links) + 1):
        node = source.node
        if node.mute:
            inside = next(
                (link.from_socket for link in node.internal_links if link.to_socket == source), None
            )
        elif node.bl_idname == "NodeReroute":
            inside = node.inputs[0]
        else:
            return True
        link = None if inside is None else links.get((node.name, inside.identifier))
        if link is None:
            return False
        source = link.from_socket
    return False  # a ring of reroutes


def active_group_output(tree):
    """Return the group output node that is in use, or None."""
    return next(
        (node for node in tree.nodes if node.bl_idname == "NodeGroupOutput" and node.is_active_output), None
    )


def volume_output(material):
    """Return the material output that Cycles uses if its Volume input carries a link, else None."""
    if material is None or material.node_tree is None:
        return None
    output = material.node_tree.get_output_node("CYCLES")
    if output is None or (output.name, "Volume") not in live_links(material.node_tree):
        return None
    return output


def read_graph(material, warn, depsgraph=None, refused=None):
    """Return the graph (a JSON object) of a material that has a volume_output.

    `warn(place, message)` is told of every node that is left out because it cannot be expressed. Such a node
    that reaches the volume raises InputError. Objects are where `depsgraph` puts them; without one, where the
    open file does. `refused` {node type: [reason, what to do instead]} says why a type is not supported.
    """
    return _GraphReader(material, volume_output(material), "Volume", warn, depsgraph, refused or {}).read()


def read_world_graph(world, warn, depsgraph=None, refused=None):
    """`read_graph` of a world, whose Surface the active output reads; `material` is the world's name."""
    output = world.node_tree.get_output_node("CYCLES")
    return _GraphReader(world, output, "Surface", warn, depsgraph, refused or {}).read()


class Reach:
    """The nodes of a tree, and of the groups in it, that an input depends on."""

    def __init__(self, socket):
        self._links = {}
        # (tree, node name, output identifier) of what is read. The tree is its address.
        self.outputs = set()
        # Nodes by (tree, node name).
        self.nodes = {(socket.id_data.as_pointer(), socket.node.name): socket.node}
        self._walk(socket)

    def links_of(self, tree):
        """`live_links` of a tree."""
        key = tree.as_pointer()
        if key not in self._links:
            self._links[key] = live_links(tree)
        return self._links[key]

    def _walk(self, socket):
        """Walk against the links, in and out of groups, and note every node met."""
        seen = set()
        pending = [(socket, ())]
        while pending:
            socket, callers = pending.pop()
            link = self.links_of(socket.id_data).get((socket.node.name, socket.identifier))
            if link is None:
                continue
            source = link.from_socket
            key = (source.as_pointer(), tuple(caller.as_pointer() for caller in callers))
            if key not in seen:
                seen.add(key)
                pending += self._inputs_behind(source, callers)

    def _inputs_behind(self, source, callers):
        """The inputs that the output socket `source` depends on, each with its chain of group nodes."""
        node = source.node
        tree = node.id_data.as_pointer()
        self.nodes[tree, node.name] = node
        self.outputs.add((tree, node.name, source.identifier))
        if node.bl_idname == "NodeGroupInput":
            if not callers:
                return []
            outside = next(item for item in callers[-1].inputs if item.identifier == source.identifier)
            return [(outside, callers[:-1])]
        if node.mute:
            return [(link.from_socket, callers) for link in node.internal_links if link.to_socket == source]
        if node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
            inner = active_group_output(node.node_tree)
            if inner is None:
                return []
            self.nodes[node.node_tree.as_pointer(), inner.name] = inner
            return [(item, (*callers, node)) for item in inner.inputs if item.identifier == source.identifier]
        return [(item, callers) for item in node.inputs if is_available(item)]

    def reads(self, kind, identifier):
        """Whether the output `identifier` of a node of type `kind` is read."""
        return any(
            self.nodes[tree, name].bl_idname == kind and output == identifier
            for tree, name, output in self.outputs
        )


def unique_name(item):
    """The name of a data-block, with its library where another one has that name in the file."""
    if item.library is None:
        return item.name
    collections = {
        "OBJECT": bpy.data.objects,
        "MATERIAL": bpy.data.materials,
        "NODETREE": bpy.data.node_groups,
        "WORLD": bpy.data.worlds,
    }
    collection = collections.get(item.id_type)
    if collection is None or sum(other.name == item.name for other in collection) == 1:
        return item.name
    return f"{item.name} ({item.library.name})"


class _GraphReader:
    """Reads the tree of `owner`, a material or a world, whose `output` node is read at its input `end`."""

    def __init__(self, owner, output, end, warn, depsgraph, refused):
        self._owner = owner
        self._warn = warn
        self._depsgraph = depsgraph or bpy.context.evaluated_depsgraph_get()
        self._refused = refused
        self._output = output
        self._end = end
        self._reach = Reach(output.inputs[end])

    def read(self):
        self._groups = {}
        nodes = self._read_nodes(self._owner.node_tree)
        return {
            "material": unique_name(self._owner),
            "nodes": nodes,
            "groups": [self._groups[name] for name in sorted(self._groups)],
        }

    def _read_nodes(self, tree):
        entries = {}
        for node in tree.nodes:
            if self._is_left_out_by_kind(node):
                continue
            if node.bl_idname == SCENE_TIME:
                entries.update(_time_values(node))
                continue
            place = f'{self._place()}, tree "{tree.name}", node "{node.name}" ({node.bl_idname})'
            try:
                entries[node.name] = self._read_node(node, place)
            except Inexpressible as problem:
                found, expected, remedy = problem.reason
                if (tree.as_pointer(), node.name) in self._reach.nodes:
                    if node.bl_idname in self._refused:
                        reason, remedy = self._refused[node.bl_idname]
                        found = f"{node.bl_label} ({node.bl_idname}), which {reason}"
                        expected = "a supported node (`cloudparity nodes` lists them)"
                    raise InputError(place, found, expected, remedy) from None
                reached = "world" if self._end == "Surface" else "volume"
                self._warn(place, f"left out, it does not reach the {reached}: {found}")
        self._drop_dangling(entries, tree)
        return list(entries.values())

    def _place(self):
        kind = "world" if self._end == "Surface" else "material"
        return f'{kind} "{self._owner.name}"'

    def _is_left_out_by_kind(self, node):
        if node.bl_idname in LAYOUT_NODES:
            return True
        if node.bl_idname == "NodeGroupOutput":
            return not node.is_active_output
        return node.bl_idname in OUTPUT_NODES and node != self._output

    def _drop_dangling(self, entries, tree):
        """Leave out, one after the other, the nodes that are fed by a node that was left out."""
        while True:
            dangling = [
                name
                for name, entry in entries.items()
                if any(
                    isinstance(value, dict) and value.get("node", name) not in entries
                    for value in entry["inputs"].values()
                )
            ]
            if not dangling:
                return
            for name in dangling:
                del entries[name]
                self._warn(
                    f'tree "{tree.name}", node "{name}"', "left out, a node that feeds it was left out"
                )

    def _read_node(self, node, place):
        entry = {"name": node.name, "type": node.bl_idname}
        if node.label:
            entry["label"] = node.label
        entry["location"] = shortest_list(node.location_absolute, place)
        if node.mute:
            entry["muted"] = True
            entry["bypass"] = {
                link.to_socket.identifier: link.from_socket.identifier for link in node.internal_links
            }
        if node.bl_idname == "NodeReroute":
            entry["socket_type"] = _socket_type(node.inputs[0])
        elif node.bl_idname == "ShaderNodeGroup":
            entry["group"] = self._read_group(node)
        else:
            entry["properties"] = _read_properties(node, place, self._depsgraph)
        entry["inputs"] = self._read_inputs(node, place)
        if node.bl_idname in OUTPUT_VALUE_NODES:
            socket = node.outputs[0]
            entry["outputs"] = {socket.identifier: _socket_value(socket, place)}
        return entry

    def _read_group(self, node):
        tree = node.node_tree
        if tree is None:
            raise Inexpressible("a group node without group", "a group", "choose a group or delete the node")
        if tree.original.is_missing:
            return self._missing_group(node)
        name = unique_name(tree)
        if name not in self._groups:
            inputs, outputs = _read_interface(tree, self._warn)
            self._groups[name] = {
                "name": name,
                "inputs": inputs,
                "outputs": outputs,
                "nodes": self._read_nodes(tree),
            }
        return name

    def _missing_group(self, node):
        """A group that is missing in its library: Cycles takes 0 for all its outputs (measured in 5.0.1 and
        5.3.0), as for those of a group without an output node."""
        found, _, remedy = missing_reason(node.node_tree.original)
        self._warn(
            f'{self._place()}, node "{node.name}"',
            f"found {found}: its outputs are 0, as in Blender; {remedy}",
        )
        name = f"{unique_name(node.node_tree)} (missing from {node.name})"
        outputs = [
            {
                "identifier": socket.identifier,
                "name": socket.name,
                "panel": None,
                "type": _socket_type(socket),
                "description": "",
            }
            for socket in node.outputs
            if socket.type in SOCKET_TYPES
        ]
        self._groups[name] = {"name": name, "inputs": [], "outputs": outputs, "nodes": []}
        return name

    def _read_inputs(self, node, place):
        links = self._reach.links_of(node.id_data)
        inputs = {}
        for socket in node.inputs:
            if not is_available(socket) or (node == self._output and socket.identifier != self._end):
                continue
            link = links.get((node.name, socket.identifier))
            if link is not None:
                inputs[socket.identifier] = _link_source(link)
            elif socket.type == "SHADER" or socket.type in VALUELESS_SOCKET_TYPES:
                continue
            elif node.bl_idname == "ShaderNodeGroup" or not socket.hide_value or _has_hidden_value(socket):
                inputs[socket.identifier] = _socket_value(socket, f'{place}, input "{socket.identifier}"')
        return inputs


def _time_values(node):
    """Value nodes in the place of a Scene Time, by name: one for each output, where the file's time is now.

    Seconds are frame times fps_base over fps, each a float (measured with Cycles 5.2.3 and 5.3.0).
    """
    scene = bpy.context.scene
    frame = np.float32(scene.frame_current_final)
    seconds = frame * np.float32(scene.render.fps_base) / np.float32(scene.render.fps)
    values = {"Seconds": seconds, "Frame": frame}
    place = f'node "{node.name}"'
    entries = {}
    for socket in node.outputs:
        name = _value_name(node, socket)
        entries[name] = {
            "name": name,
            "type": "ShaderNodeValue",
            "location": shortest_list(node.location_absolute, place),
            "properties": {},
            "inputs": {},
            "outputs": {"Value": shortest(float(values[socket.identifier]), place)},
        }
        if node.mute:
            entries[name] |= {"muted": True, "bypass": {}}
    return entries


def _value_name(node, socket):
    """The name of the Value node for an output of Scene Time: one that no node of the tree has."""
    name = f"{node.name} {socket.identifier}"
    while name in node.id_data.nodes:
        name += "'"
    return name


def _has_hidden_value(socket):
    """Whether an unlinked input whose value the interface hides has one that matters. The vector of a texture
    has none: it reads Generated coordinates."""
    value = socket.default_value
    if hasattr(socket.node, "texture_mapping"):
        return False
    return any(value) if hasattr(value, "__len__") else bool(value)


def _link_source(link):
    if link.from_node.bl_idname == "NodeGroupInput":
        return {"group_input": link.from_socket.identifier}
    if link.from_node.bl_idname == SCENE_TIME:
        return {"node": _value_name(link.from_node, link.from_socket), "socket": "Value"}
    return {"node": link.from_node.name, "socket": link.from_socket.identifier}


def _socket_type(socket):
    if socket.type not in SOCKET_TYPES:
        raise Inexpressible(
            f'socket "{socket.name}" of type {socket.type}',
            f"one of {', '.join(SOCKET_TYPES)}",
            "rebuild this part of the graph without it",
        )
    return SOCKET_TYPES[socket.type]


def _socket_value(socket, place):
    kind = _socket_type(socket)
    value = socket.default_value
    if kind == "float":
        return shortest(value, place)
    return shortest_list(value, place) if kind in ("vector", "color") else value


def missing_reason(item):
    """What was found, expected and is to be done where a linked data-block is gone."""
    return (
        f'"{item.name}" of the library {item.library.filepath}, where it is missing',
        "the library with that data-block",
        "put the library back at that path, or make what is linked local in Blender (Object, Relations, "
        "Make Local)",
    )


def _read_properties(node, place, depsgraph):
    inherited = bpy.types.ShaderNode.bl_rna.properties
    values = {}
    for prop in sorted(node.bl_rna.properties, key=lambda item: item.identifier):
        name = prop.identifier
        if name in inherited or name.startswith("show_") or name == "color_mapping":
            continue
        try:
            value = getattr(node, name)
        except (AttributeError, RuntimeError, TypeError, ValueError) as error:
            value = None
            unknown = f"a value that cannot be read ({error})"
        else:
            unknown = "a value without a name"
        # RNA gives no name for a number that this release's enumeration lacks.
        if prop.type == "ENUM" and value in (None, "", set()) and not getattr(prop, "is_enum_flag", False):
            if node.mute:
                continue
            raise Inexpressible(*_unknown_value(node, name, unknown))
        if prop.type == "POINTER":
            values.update(_read_pointer(node, name, value, place, depsgraph))
        elif prop.type == "STRING" and not value:
            continue
        elif (node.bl_idname, name) == ("ShaderNodeAttribute", "attribute_name"):
            values[name] = value
        elif prop.type in ("BOOLEAN", "INT", "ENUM") and not getattr(prop, "is_enum_flag", False):
            values[name] = list(value) if getattr(prop, "is_array", False) else value
        elif prop.type == "FLOAT":
            values[name] = shortest_list(value, place) if prop.is_array else shortest(value, place)
        else:
            raise Inexpressible(
                f'property "{name}" of type {prop.type} with value {value!r}',
                "numbers, booleans and enumerations",
                "rebuild this part of the graph without it",
            )
    return values


def _unknown_value(owner, name, found):
    """What was found, expected and is to be done where a property of `owner` holds what this release has no
    name for."""
    saved = ".".join(str(part) for part in bpy.data.version)
    label = owner.bl_rna.properties[name].name or name
    known = ", ".join(item.identifier for item in owner.bl_rna.properties[name].enum_items)
    return (
        f'property "{name}" ({label}): {found}, which Blender {bpy.app.version_string} does not know '
        f"(the file was saved by Blender {saved})",
        f"one of {known}",
        "read the file with the release that saved it, or choose another value there",
    )


def _read_pointer(node, name, value, place, depsgraph):
    """The entry of a pointer property, if it needs one."""
    if name == "texture_mapping":
        mapping = _read_texture_mapping(value, place)
        return {name: mapping} if _changes_coordinates(mapping) else {}
    if node.bl_idname == "ShaderNodeTexCoord" and name == "object":
        if value is None:
            return {name: None}
        evaluated = value.original.evaluated_get(depsgraph)
        matrix = matrix_rows(evaluated.matrix_world, place)
        return {name: {"name": unique_name(value.original), "matrix_world": matrix}}
    if value is None:
        return {}
    if is_node_data(value):
        reason = reason_against(value)
        if reason is not None:
            raise Inexpressible(*reason)
        data = read_node_data(value, f"{place}, {name}")
        for setting, found in data.items():
            if found == "":
                raise Inexpressible(*_unknown_value(value, setting, "a value without a name"))
        return {name: data}
    raise Inexpressible(
        f'property "{name}", a pointer to {type(value).__name__}',
        "a node whose settings are numbers, booleans and enumerations",
        "replace the node by nodes without such data",
    )


def _read_texture_mapping(mapping, place):
    """A texture's own mapping as a JSON object. Its limits and its flat, cube or tube mode do nothing."""
    vectors = {
        name: shortest_list(getattr(mapping, name), f"{place}, texture_mapping.{name}")
        for name in ("translation", "rotation", "scale")
    }
    names = ("vector_type", "mapping_x", "mapping_y", "mapping_z")
    choices = {name: getattr(mapping, name) for name in names}
    for name, value in choices.items():
        if not value:
            raise Inexpressible(*_unknown_value(mapping, name, "a value without a name"))
    return {"vector_type": choices.pop("vector_type"), **vectors, **choices}


def _changes_coordinates(mapping):
    """Whether a mapping as `_read_texture_mapping` returns it has an effect. That of type NORMAL makes unit
    vectors, but Cycles leaves out even that one where nothing else is set."""
    return any(mapping[name] != value for name, value in IDENTITY_MAPPING.items())


def require_identity(mapping):
    """Refuse a texture's own mapping unless it changes nothing."""
    found = _read_texture_mapping(mapping, "texture_mapping")
    if _changes_coordinates(found):
        raise Inexpressible(
            f"texture_mapping {found}",
            "the identity",
            "reset the texture mapping and put a Mapping node before the texture",
        )


def _read_interface(tree, warn):
    """The input and output sockets of a group, each list in the order of the interface."""
    sockets = {"INPUT": [], "OUTPUT": []}
    for item in tree.interface.items_tree:
        place = f'group "{tree.name}", {item.item_type.lower()} "{item.name}"'
        if item.item_type == "SOCKET":
            sockets[item.in_out].append(_read_interface_socket(item, place))
        elif item.parent.index >= 0:
            warn(place, f'nested in panel "{item.parent.name}", written as a panel of its own')
    return sockets["INPUT"], sockets["OUTPUT"]


def _read_interface_socket(item, place):
    if item.socket_type not in INTERFACE_TYPES or getattr(item, "dimensions", 3) != 3:
        raise Inexpressible(
            f"{place} of type {item.socket_type}",
            f"one of {', '.join(INTERFACE_TYPES)}, vectors with 3 dimensions",
            "change the type of the group socket",
        )
    entry = {
        "identifier": item.identifier,
        "name": item.name,
        "panel": item.parent.name if item.parent.index >= 0 else None,
        "type": INTERFACE_TYPES[item.socket_type],
    }
    if hasattr(item, "subtype"):
        entry["subtype"] = item.subtype
    if entry["type"] in ("vector", "color"):
        entry["default"] = shortest_list(item.default_value, place)
    elif entry["type"] == "float":
        entry["default"] = shortest(item.default_value, place)
    elif entry["type"] in ("integer", "boolean"):
        entry["default"] = item.default_value
    if hasattr(item, "min_value"):
        limits = (item.min_value, item.max_value)
        if entry["type"] != "integer":
            limits = shortest_list(limits, place)
        entry["min"], entry["max"] = limits
    entry["description"] = item.description
    return entry
