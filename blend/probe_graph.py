"""Turns the graph of a scene into a surface material that shows chosen node values to a probe.

Only the sources of coordinates are replaced, by attributes: `Object`, `Generated` (also where a texture node
reads it without a link) and the `Position` of Geometry. Constants stay constants, so Blender folds the same
nodes as in the volume. A Volume object's grid exists in no surface, so its value at each point comes in as an
attribute, too, interpolated as Cycles was measured to do (docs/volume-objects.md); what nodes make of it, the
product with the Density of Principled Volume included, is Cycles' own. Object Info and Vector Transform see
the probe's grid, which point_probe.py gives the volume's name, colour, indices and matrix then. What depends
on the ray, the camera or the surface is refused.
"""

import bpy
import numpy as np

from graph_builder import SharedGroups, build_material
from graph_reader import SOCKET_TYPES, active_group_output, is_available
from protocol import InputError
from scene_io import matrix_array

RESERVED_PREFIX = "probe "
OBJECT_ATTRIBUTE = "probe object"
GENERATED_ATTRIBUTE = "probe generated"
WORLD_ATTRIBUTE = "probe world"
GRID_ATTRIBUTE = "probe grid"
# The grid of a scene's Volume objects, and the input of Principled Volume that names it beside its Density.
DENSITY = "density"
DENSITY_ATTRIBUTE = "Density Attribute"
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

    def __init__(self, graph, targets, warn, has_grid=False):
        """`has_grid`: the object is a Volume object, whose grid the material may read."""
        self._has_grid = has_grid
        self._groups = SharedGroups([graph])
        self._empties = []
        self._matrices = {}
        self._needed = set()
        try:
            self.material = build_material(graph, self._object_for, warn, self._groups)
            trees = [self.material.node_tree, *bpy.data.node_groups]
            for tree in trees:
                _link_implicit_generated(tree)
            self.components = [self._expose(index, target) for index, target in enumerate(targets)]
            for tree in trees:
                self._replace_grid(tree)
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

    def coordinates(self, points, volume, grid=None):
        """Return {attribute name: f32 [n, 3]} for the coordinates that the material reads.

        `points` f32 [n, 3] in the object space of `volume`, the scene's description of it. `grid` is that of
        a Volume object: its values f32 [x, y, z] and the rows [3, 4] that take a point to an index.
        """
        result = {}
        for name in self._needed:
            if name == OBJECT_ATTRIBUTE:
                result[name] = points
            elif name == GRID_ATTRIBUTE:
                result[name] = np.repeat(grid_values(points, *grid)[:, None], 3, axis=1)
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
        node = _find_node(tree, target["node"], place)
        socket = _target_socket(node, self._own_identifiers(node, target), place)
        is_float = SOCKET_TYPES[socket.type] in FLOAT_TYPES
        source = _source(socket)
        if self._multiplies_by_grid(socket):
            source = self._times_grid(tree, source)
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

    def _own_identifiers(self, node, target):
        """The target with the identifiers that Blender gave a group's sockets: old files have others."""
        built = self._groups.built.get(node.node_tree.name) if node.bl_idname == "ShaderNodeGroup" else None
        if built is None:
            return target
        _, identifiers = built
        known = {"output": identifiers.outputs, "input": identifiers.inputs}
        return {
            key: known[key].get(value, value) if key in known else value
            for key, value in dict(target).items()
        }

    def _multiplies_by_grid(self, socket):
        """Whether the node of this input multiplies its value by the grid."""
        if not self._has_grid or socket.is_output or socket.identifier != "Density":
            return False
        named = socket.node.inputs.get(DENSITY_ATTRIBUTE)
        return named is not None and named.default_value == DENSITY

    def _times_grid(self, tree, source):
        """max(source, 0) times the grid, as a socket of `tree`."""
        positive = tree.nodes.new("ShaderNodeMath")
        positive.operation = "MAXIMUM"
        positive.inputs[1].default_value = 0.0
        _feed(positive.inputs[0], source)
        product = tree.nodes.new("ShaderNodeMath")
        product.operation = "MULTIPLY"
        tree.links.new(product.inputs[0], positive.outputs[0])
        tree.links.new(product.inputs[1], self._grid_socket(tree))
        return product.outputs[0]

    def _grid_socket(self, tree):
        """A socket of `tree` that holds the grid's value."""
        attribute = tree.nodes.new("ShaderNodeAttribute")
        attribute.attribute_name = GRID_ATTRIBUTE
        separate = tree.nodes.new("ShaderNodeSeparateXYZ")
        # The Fac of three components is their mean, which rounds.
        tree.links.new(separate.inputs[0], attribute.outputs["Vector"])
        self._needed.add(GRID_ATTRIBUTE)
        return separate.outputs[0]

    def _replace_grid(self, tree):
        """Give what reads the grid by an Attribute node the value of each point."""
        if not self._has_grid:
            return
        source = None
        for link in list(tree.links):
            node = link.from_node
            reads = node.bl_idname == "ShaderNodeAttribute" and node.attribute_name == DENSITY
            if reads and link.from_socket.identifier == "Fac" and not node.mute:
                source = source or self._grid_socket(tree)
                tree.links.new(link.to_socket, source)

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


def grid_values(points, values, to_index):
    """Return a grid's values f32 [n] at points in object space, f32 [n, 3], as Cycles interpolates them.

    `values` f32 [x, y, z] stand at whole indices, `to_index` [3, 4] takes a point to an index. Along x, then
    y, then z, each operation rounded; 0 outside.
    """
    index = _affine(points, to_index)
    low = np.floor(index)
    fraction = index - low
    # One more voxel on each side is empty, and farther ones are as empty as that.
    padded = np.pad(values, 1)
    limit = np.array(values.shape, np.float32)
    ends = [
        np.nan_to_num(np.clip(corner, -1, limit)).astype(np.int64) + 1
        for corner in (low, low + np.float32(1))
    ]

    def along(axis, corner):
        if axis < 0:
            x, y, z = (ends[corner[each]][:, each] for each in range(3))
            return padded[x, y, z]
        a, b = (along(axis - 1, {**corner, axis: end}) for end in (0, 1))
        return a + fraction[:, axis] * (b - a)

    return along(2, {})


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
