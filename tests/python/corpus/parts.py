"""What the files of the corpus are put together from: graphs, outlines, cameras, lights and worlds.

Everything is added to the open file, which `corpus.write` has emptied. Lengths are metres, angles radians.
"""

import math

import bpy
from mathutils import Matrix, Vector


class Graph:
    """A node tree that is filled by calls instead of by hand."""

    def __init__(self, tree):
        self.tree = tree

    def add(self, kind, inputs=None, name=None, **properties):
        """Add a node. `inputs` {identifier, name or index: value or output socket}."""
        node = self.tree.nodes.new(kind)
        if name is not None:
            node.name = name
        for key, value in properties.items():
            setattr(node, key, value)
        for key, value in (inputs or {}).items():
            self.feed(node, key, value)
        return node

    def feed(self, node, key, value):
        """Store a value in an input, or link an output socket (of a node: its first visible output) to it."""
        socket = self.socket(node.inputs, key)
        if isinstance(value, bpy.types.Node):
            value = next(output for output in value.outputs if output.enabled)
        if isinstance(value, bpy.types.NodeSocket):
            return self.tree.links.new(socket, value)
        if socket.type == "RGBA" and len(value) == 3:
            value = (*value, 1.0)
        socket.default_value = value
        return None

    @staticmethod
    def socket(sockets, key):
        """The socket of an identifier, a name or a position; of several with one name, the visible one."""
        if isinstance(key, int):
            return sockets[key]
        found = [item for item in sockets if item.identifier == key]
        found = found or [item for item in sockets if item.name == key and item.enabled]
        if len(found) != 1:
            raise KeyError(f"{key} among {[item.identifier for item in sockets]}")
        return found[0]

    def out(self, node, key):
        """An output socket."""
        return self.socket(node.outputs, key)

    # Shorthands for what nearly every material has.

    def coordinates(self, output="Object", **properties):
        """An output of a Texture Coordinate node."""
        return self.out(self.add("ShaderNodeTexCoord", **properties), output)

    def axis(self, vector, letter):
        """One component of a vector."""
        return self.out(self.add("ShaderNodeSeparateXYZ", {"Vector": vector}), letter)

    def math(self, operation, *values, **properties):
        """A Math node."""
        inputs = dict(enumerate(values))
        return self.add("ShaderNodeMath", inputs, operation=operation, **properties).outputs[0]

    def vector_math(self, operation, *values):
        """A Vector Math node; its visible output."""
        node = self.add("ShaderNodeVectorMath", operation=operation)
        for index, value in enumerate(values):
            key = "Scale" if operation == "SCALE" and index == 1 else index
            self.feed(node, key, value)
        return next(output for output in node.outputs if output.enabled)

    def noise(self, vector=None, output="Fac", inputs=None, **properties):
        """A Noise Texture."""
        given = ({} if vector is None else {"Vector": vector}) | (inputs or {})
        return self.out(self.add("ShaderNodeTexNoise", given, **properties), output)

    def voronoi(self, vector=None, output="Distance", inputs=None, **properties):
        """A Voronoi Texture."""
        given = ({} if vector is None else {"Vector": vector}) | (inputs or {})
        node = self.add("ShaderNodeTexVoronoi", **properties)
        for key, value in given.items():
            self.feed(node, key, value)
        return self.out(node, output)

    def map_range(self, value, start, end, low=0.0, high=1.0, **properties):
        """A Map Range of a number."""
        inputs = {"Value": value, "From Min": start, "From Max": end, "To Min": low, "To Max": high}
        return self.out(self.add("ShaderNodeMapRange", inputs, **properties), "Result")

    def ramp(self, factor, *stops, output="Color", **properties):
        """A Color Ramp of (position, grey or colour) stops."""
        node = self.add("ShaderNodeValToRGB", {"Fac": factor})
        ramp = node.color_ramp
        for key, value in properties.items():
            setattr(ramp, key, value)
        while len(ramp.elements) < len(stops):
            ramp.elements.new(0.5)
        for element, (position, colour) in zip(ramp.elements, stops, strict=True):
            element.position = position
            element.color = (colour,) * 3 + (1.0,) if isinstance(colour, float) else (*colour, 1.0)
        return self.out(node, output)

    def principled(self, **inputs):
        """A Principled Volume; `Absorption_Color` is its input "Absorption Color"."""
        return self.add("ShaderNodeVolumePrincipled", {k.replace("_", " "): v for k, v in inputs.items()})

    def finish(self, closure):
        """Link a closure to the output of the material."""
        output = self.add("ShaderNodeOutputMaterial", {"Volume": closure})
        for index, node in enumerate(self.tree.nodes):
            node.location = (200.0 * (index % 8), -300.0 * (index // 8))
        return output


def material(name):
    """A new material without nodes, and its graph."""
    item = bpy.data.materials.new(name)
    item.node_tree.nodes.clear()
    return item, Graph(item.node_tree)


def group(name):
    """A new node group without sockets, and its graph."""
    tree = bpy.data.node_groups.new(name, "ShaderNodeTree")
    return tree, Graph(tree)


def interface(tree, direction, name, kind="NodeSocketFloat", default=None):
    """Add a socket to the interface of a group."""
    socket = tree.interface.new_socket(name, in_out=direction, socket_type=kind)
    if default is not None:
        socket.default_value = default
    return socket


def homogeneous(name="Fog", density=0.5, **inputs):
    """A material of one Principled Volume with constant inputs."""
    item, graph = material(name)
    graph.finish(graph.principled(Density=density, **inputs))
    return item


def add_object(name, data, owner=None, location=(0, 0, 0), rotation=(0, 0, 0), scale=(1, 1, 1)):
    """Link an object with a material (or none) to the scene."""
    item = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(item)
    item.location, item.rotation_euler, item.scale = location, rotation, scale
    if owner is not None:
        data.materials.append(owner)
    return item


def outline(kind, owner, name="Volume", location=(0, 0, 0), rotation=(0, 0, 0), scale=(1, 1, 1), **size):
    """An object of one of Blender's mesh primitives, as its operators make them: `cube` is 2 m wide.

    A UV sphere is missing: its vertices come in another order each time.
    """
    operators = bpy.ops.mesh
    make = {
        "cube": operators.primitive_cube_add,
        "icosphere": operators.primitive_ico_sphere_add,
        "torus": operators.primitive_torus_add,
        "cylinder": operators.primitive_cylinder_add,
        "cone": operators.primitive_cone_add,
        "monkey": operators.primitive_monkey_add,
        "plane": operators.primitive_plane_add,
    }[kind]
    make(**size)
    item = bpy.context.object
    item.name = item.data.name = name
    item.location, item.rotation_euler, item.scale = location, rotation, scale
    if owner is not None:
        item.data.materials.append(owner)
    return item


def camera(location=(0, -6, 1), target=(0, 0, 0), **properties):
    """The active camera, looking at `target`."""
    data = bpy.data.cameras.new("Camera")
    for key, value in properties.items():
        setattr(data, key, value)
    item = add_object("Camera", data, location=location)
    direction = Vector(target) - Vector(location)
    item.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    bpy.context.scene.camera = item
    return item


def light(kind, energy, name=None, location=(0, 0, 0), target=None, rotation=(0, 0, 0), **properties):
    """A light of Blender's type `kind`."""
    data = bpy.data.lights.new(name or kind.title(), kind)
    data.energy = energy
    for key, value in properties.items():
        setattr(data, key, value)
    item = add_object(name or kind.title(), data, location=location, rotation=rotation)
    if target is not None:
        direction = Vector(target) - Vector(location)
        item.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    return item


def sun(energy=3.0, elevation=40.0, azimuth=-60.0, name="Sun", **properties):
    """A sun that stands `elevation` degrees over the horizon, `azimuth` degrees from +X."""
    height, turn = math.radians(elevation), math.radians(azimuth)
    towards = Vector((math.cos(height) * math.cos(turn), math.cos(height) * math.sin(turn), math.sin(height)))
    item = light("SUN", energy, name=name, **properties)
    item.rotation_euler = towards.to_track_quat("Z", "Y").to_euler()
    return item


def world(colour=(0.05, 0.1, 0.2), strength=1.0):
    """A world of one colour; returns its graph and its Background node."""
    item = bpy.data.worlds.new("World")
    item.node_tree.nodes.clear()
    graph = Graph(item.node_tree)
    background = graph.add("ShaderNodeBackground", {"Color": colour, "Strength": strength})
    graph.add("ShaderNodeOutputWorld", {"Surface": background})
    bpy.context.scene.world = item
    return graph, background


def stage(colour=(0.05, 0.1, 0.2), strength=1.0, location=(0, -6, 1), target=(0, 0, 0), **lens):
    """A camera, a sun and a world: what a first try has."""
    camera(location, target, **lens)
    sun()
    world(colour, strength)


def shear(item, matrix):
    """Hang an object on a parent whose inverse holds `matrix`, so that it may be sheared."""
    parent = add_object(f"{item.name} Parent", None)
    item.parent = parent
    item.matrix_parent_inverse = Matrix(matrix)


def modifier(item, kind, **properties):
    """Add a modifier to an object."""
    added = item.modifiers.new(kind.title(), kind)
    for key, value in properties.items():
        setattr(added, key, value)
    return added
