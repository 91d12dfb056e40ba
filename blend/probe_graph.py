"""Turns the graph of a scene into a surface material that shows chosen node values to a probe.

Only the sources of coordinates are replaced, by attributes: `Object`, `Generated` (also where a texture node
reads it without a link) and the `Position` of Geometry. Constants stay constants, so Blender folds the same
nodes as in the volume. Object Info and Vector Transform see the probe's grid, which point_probe.py gives the
volume's name, colour, indices and matrix then. What depends on the ray, the camera or the surface is refused.
"""

import bpy
import numpy as np

from graph_builder import build_material
from graph_reader import SOCKET_TYPES, active_group_output, is_available
from protocol import InputError
from scene_io import matrix_array

RESERVED_PREFIX = "probe "
OBJECT_ATTRIBUTE = "probe object"
GENERATED_ATTRIBUTE = "probe generated"
WORLD_ATTRIBUTE = "probe world"
OTHER_OBJECT_PREFIX = "probe object of "
COORDINATE_ATTRIBUTES = {
    ("ShaderNodeTexCoord", "Object"): OBJECT_ATTRIBUTE,
    ("ShaderNodeTexCoord", "Generated"): GENERATED_ATTRIBUTE,
    ("ShaderNodeNewGeometry", "Position"): WORLD_ATTRIBUTE,
}
GRID_DEPENDENT_NODES = {"ShaderNodeTexCoord", "ShaderNodeNewGeometry"}
OBJECT_DEPENDENT_NODES = {"ShaderNodeObjectInfo", "ShaderNodeVectorTransform"}
FLOAT_TYPES = {"float", "integer", "boolean"}


def aov_name(index):
    """The name of the AOV that carries target number `index`."""
    return f"probe{index:02}"


class ProbeMaterial:
    """A material with one AOV for each target. Close it to remove everything that it created.

    `components` holds 1 (float) or 3 (vector, colour) for each target. `sees_object` says that values may
    depend on the object that has the material.
    """

    def __init__(self, graph, targets, warn):
        self._empties = []
        self._matrices = {}
        self._needed = set()
        try:
            self.material = build_material(graph, self._object_for, warn)
            trees = [self.material.node_tree, *bpy.data.node_groups]
            for tree in trees:
                _link_implicit_generated(tree)
            self.components = [self._expose(index, target) for index, target in enumerate(targets)]
            for tree in trees:
                _refuse_camera_space(tree)
                self._replace_coordinates(tree)
            self.sees_object = any(
                node.bl_idname in OBJECT_DEPENDENT_NODES for tree in trees for node in tree.nodes
            )
            _close_with_black_surface(self.material.node_tree)
        except Exception:
            self.close()
            raise

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Remove all materials and node groups of the open file, and the empties of this one."""
        bpy.data.batch_remove([*bpy.data.materials, *bpy.data.node_groups, *self._empties])
        self._empties = []

    def coordinates(self, points, volume):
        """Return {attribute name: f32 [n, 3]} for the coordinates that the material reads.

        `points` f32 [n, 3] in the object space of `volume`, the scene's description of it.
        """
        result = {}
        for name in self._needed:
            if name == OBJECT_ATTRIBUTE:
                result[name] = points
            elif name == GENERATED_ATTRIBUTE:
                result[name] = generated_coordinates(points, volume["texture_space"])
            else:
                matrix = matrix_array(volume["matrix_world"])
                if name != WORLD_ATTRIBUTE:
                    matrix = _inverse(self._matrices[name.removeprefix(OTHER_OBJECT_PREFIX)]) @ matrix
                result[name] = _affine(points, matrix[:3])
        return result

    def _object_for(self, pointer):
        item = bpy.data.objects.new(pointer["name"], None)
        self._empties.append(item)
        self._matrices[item.name] = pointer["matrix_world"]
        return item

    def _expose(self, index, target):
        """Carry the value of a target up to the material's tree and into an AOV; return its components."""
        place = f"output {index}, target {dict(target)}"
        tree = self.material.node_tree
        callers = []
        for name in target["groups"]:
            caller = _find_node(tree, name, place)
            if caller.bl_idname != "ShaderNodeGroup" or caller.mute:
                raise InputError(
                    place, f'node "{name}", {caller.bl_idname}', "a group that is not muted", "correct it"
                )
            callers.append(caller)
            tree = caller.node_tree
        socket = _target_socket(_find_node(tree, target["node"], place), target, place)
        is_float = SOCKET_TYPES[socket.type] in FLOAT_TYPES
        source = _source(socket)
        for caller in reversed(callers):
            item = caller.node_tree.interface.new_socket(
                name=aov_name(index),
                in_out="OUTPUT",
                socket_type="NodeSocketFloat" if is_float else "NodeSocketVector",
            )
            inner = active_group_output(caller.node_tree) or caller.node_tree.nodes.new("NodeGroupOutput")
            _feed(_by_identifier(inner.inputs, item.identifier), source)
            source = _by_identifier(caller.outputs, item.identifier)
        aov = self.material.node_tree.nodes.new("ShaderNodeOutputAOV")
        aov.aov_name = aov_name(index)
        _feed(aov.inputs["Value" if is_float else "Color"], source)
        return 1 if is_float else 3

    def _replace_coordinates(self, tree):
        attributes = {}
        for link in list(tree.links):
            node, socket = link.from_node, link.from_socket
            if node.bl_idname not in GRID_DEPENDENT_NODES or node.mute:
                continue
            name = COORDINATE_ATTRIBUTES.get((node.bl_idname, socket.identifier))
            if name is None or (name == GENERATED_ATTRIBUTE and node.from_instancer):
                raise InputError(
                    f'tree "{tree.name}", node "{node.name}" ({node.bl_idname})',
                    f'output "{socket.identifier}", which depends on the shaded object or the ray',
                    "Object or Generated of Texture Coordinate, Position of Geometry",
                    "probe the nodes behind it with an attribute in its place",
                )
            if name == OBJECT_ATTRIBUTE and node.object is not None:
                name = OTHER_OBJECT_PREFIX + node.object.name
            if name not in attributes:
                attributes[name] = tree.nodes.new("ShaderNodeAttribute")
                attributes[name].attribute_name = name
                self._needed.add(name)
            tree.links.new(link.to_socket, attributes[name].outputs["Vector"])


def _refuse_camera_space(tree):
    """Refuse to transform to or from the space of the camera: that of the probe is not that of the scene."""
    for link in tree.links:
        node = link.from_node
        if node.bl_idname != "ShaderNodeVectorTransform" or node.mute:
            continue
        spaces = (node.convert_from, node.convert_to)
        if "CAMERA" in spaces and spaces[0] != spaces[1]:
            raise InputError(
                f'tree "{tree.name}", node "{node.name}" ({node.bl_idname})',
                f"a transform from {spaces[0]} to {spaces[1]}, which depends on the camera",
                "WORLD and OBJECT",
                "probe the nodes behind it with an attribute in its place",
            )


def generated_coordinates(points, texture_space):
    """Return Generated for points in object space, f32 [n, 3], as Cycles does: a matrix, so that an infinite
    component makes the others NaN.

    `texture_space` has `location` and `size` of the mesh; a size of 0 gives the constant 0.5.
    """
    location = np.asarray(texture_space["location"], np.float32)
    size = np.asarray(texture_space["size"], np.float32)
    half = np.float32(0.5)
    scale = np.divide(half, size, out=np.zeros(3, np.float32), where=size != 0)
    return _affine(points, np.column_stack([np.diag(scale), -(location * scale - half)]))


def _affine(points, rows):
    """Return the image f32 [n, 3] of points under `rows` [3, 4], each operation rounded, from the left."""
    rows = np.asarray(rows, np.float32)
    with np.errstate(all="ignore"):
        terms = [points[:, axis, None] * rows[:, axis] for axis in range(3)]
        return ((terms[0] + terms[1]) + terms[2]) + rows[:, 3]


def _inverse(rows):
    try:
        return np.linalg.inv(matrix_array(rows))
    except np.linalg.LinAlgError:
        raise InputError(
            "matrix_world", str(rows), "a matrix with an inverse", "give the object a size"
        ) from None


def _link_implicit_generated(tree):
    """Link the hidden Vector input of texture nodes to Generated: without a link they read just that."""
    source = None
    for node in list(tree.nodes):
        if not hasattr(node, "texture_mapping") or node.mute:
            continue
        # Absent in the modes that take no vector: names find available sockets only.
        vector = node.inputs.get("Vector")
        if vector is not None and vector.hide_value and not vector.is_linked:
            source = source or tree.nodes.new("ShaderNodeTexCoord")
            tree.links.new(vector, source.outputs["Generated"])


def _find_node(tree, name, place):
    node = tree.nodes.get(name)
    if node is None:
        names = ", ".join(item.name for item in tree.nodes)
        raise InputError(
            place, f'node "{name}"', f'a node of tree "{tree.name}": {names}', "correct the target"
        )
    return node


def _target_socket(node, target, place):
    side = "output" if "output" in target else "input"
    sockets = node.outputs if side == "output" else node.inputs
    available = {
        socket.identifier: socket
        for socket in sockets
        if is_available(socket) and socket.type in SOCKET_TYPES
    }
    socket = available.get(target[side])
    if socket is None or socket.type == "SHADER":
        values = [name for name, item in available.items() if item.type != "SHADER"]
        raise InputError(
            place, f'{side} "{target[side]}"', f"one of {values}", "choose a socket that has a value"
        )
    return socket


def _source(socket):
    """What gives the socket its value: an output socket, or the stored value of an unlinked input."""
    if socket.is_output:
        return socket
    if socket.is_linked:
        return socket.links[0].from_socket
    value = socket.default_value
    return float(value) if SOCKET_TYPES[socket.type] in FLOAT_TYPES else list(value)[:3]


def _feed(socket, source):
    if not isinstance(source, (float, list)):
        socket.id_data.links.new(socket, source)
    elif socket.type == "RGBA":
        socket.default_value = [*source, 1.0]
    else:
        socket.default_value = source


def _by_identifier(sockets, identifier):
    return next(socket for socket in sockets if socket.identifier == identifier)


def _close_with_black_surface(tree):
    """Give the material a surface and no volume: the volume is not what the grid is made of."""
    output = tree.get_output_node("CYCLES") or tree.nodes.new("ShaderNodeOutputMaterial")
    for socket in output.inputs:
        for link in socket.links:
            tree.links.remove(link)
    emission = tree.nodes.new("ShaderNodeEmission")
    emission.inputs["Strength"].default_value = 0.0
    tree.links.new(output.inputs["Surface"], emission.outputs["Emission"])
