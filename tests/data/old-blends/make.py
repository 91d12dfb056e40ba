"""Makes the file of this folder with whatever bpy it runs in: `python make.py FILE.blend`.

`blender-4.2.blend` and `blender-4.5.blend` were made so with bpy 4.2.0 and 4.5.4 from PyPI (CPython 3.11).
Older
versions are not to be had as a module for a Python of today. What changed on the way to Blender 5.0 and is
in here: actions have slots, and materials and lights always have nodes.
"""

import sys

import bpy


def make():
    """Fill an empty file: a keyframed cloud in nested groups, a camera, a light with nodes, a world of a
    colour."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.name = "Old"
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 64, 48
    scene.world = bpy.data.worlds.new("World")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.3, 0.5, 1)
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh = bpy.data.meshes.new("Cloud")
    mesh.from_pydata(corners, [], faces)
    mesh.materials.append(_material())
    cloud = bpy.data.objects.new("Cloud", mesh)
    cloud.scale = (2, 1, 0.5)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -8, 0.5), (1.5, 0, 0)
    lamp = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    lamp.data.energy, lamp.rotation_euler = 4.0, (0.5, 0.2, 0)
    lamp.data.use_nodes = True
    lamp.data.node_tree.nodes["Emission"].inputs["Color"].default_value = (1, 0.9, 0.8, 1)
    for item in (cloud, camera, lamp):
        scene.collection.objects.link(item)
    scene.camera = camera


def _material():
    material = bpy.data.materials.new("Cloud")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    volume = tree.nodes.new("ShaderNodeVolumePrincipled")
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = _group()
    group.inputs["Thickness"].default_value = 3.0
    tree.links.new(volume.inputs["Density"], group.outputs["Density"])
    tree.links.new(output.inputs["Volume"], volume.outputs["Volume"])
    return material


def _group():
    tree = bpy.data.node_groups.new("Cloud density", "ShaderNodeTree")
    socket = tree.interface.new_socket(name="Thickness", in_out="INPUT", socket_type="NodeSocketFloat")
    socket.min_value, socket.max_value = 0.0, 100.0
    tree.interface.new_socket(name="Density", in_out="OUTPUT", socket_type="NodeSocketFloat")
    entry, leave = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    noise = tree.nodes.new("ShaderNodeTexNoise")
    noise.noise_dimensions = "4D"
    noise.inputs["Scale"].default_value = 2.0
    for frame, value in ((1, 0.0), (101, 5.0)):
        noise.inputs["W"].default_value = value
        noise.inputs["W"].keyframe_insert("default_value", frame=frame)
    cells = tree.nodes.new("ShaderNodeTexVoronoi")
    mix = tree.nodes.new("ShaderNodeMix")
    mix.inputs["Factor"].default_value = 0.25
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    ramp.color_ramp.elements[0].position = 0.4
    product = tree.nodes.new("ShaderNodeMath")
    product.operation = "MULTIPLY"
    tree.links.new(mix.inputs["A"], noise.outputs[0])
    tree.links.new(mix.inputs["B"], cells.outputs["Distance"])
    tree.links.new(ramp.inputs["Fac"], mix.outputs["Result"])
    tree.links.new(product.inputs[0], ramp.outputs["Color"])
    tree.links.new(product.inputs[1], entry.outputs["Thickness"])
    tree.links.new(leave.inputs["Density"], product.outputs["Value"])
    return tree


def save(path):
    """Write the open scene and nothing else."""
    bpy.data.libraries.write(path, {bpy.context.scene}, compress=True)


if __name__ == "__main__":
    make()
    save(sys.argv[1])
