"""Makes the files of `meshes.suite.json`: outlines of Blender's own operators, from outside and from within.

python parity/mesh_scenes.py FOLDER
for FILE in FOLDER/*.blend; do
    cloudparity export $FILE -o parity/scenes/$(basename $FILE .blend).scene.json
done
"""

import sys
from pathlib import Path

import bpy
from mathutils import Matrix, Vector


def sphere():
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=3)
    return [bpy.context.object]


def torus():
    bpy.ops.mesh.primitive_torus_add(major_segments=20, minor_segments=10, minor_radius=0.4)
    return [bpy.context.object]


def hollow():
    """Two spheres in one mesh, the inner one inside out."""
    [inner] = sphere()
    inner.data.transform(Matrix.Scale(0.5, 4))
    inner.data.flip_normals()
    [outer] = sphere()
    outer.select_set(True)
    inner.select_set(True)
    bpy.ops.object.join()
    return [outer]


def nested():
    """Two spheres, each an object: where both are, their media add up."""
    [inner], [outer] = sphere(), sphere()
    inner.scale = (0.5, 0.5, 0.5)
    return [outer, inner]


def monkey():
    """Suzanne as she is: her eyes leave edges open."""
    bpy.ops.mesh.primitive_monkey_add()
    return [bpy.context.object]


def remeshed_monkey():
    [item] = monkey()
    remesh = item.modifiers.new("Remesh", "REMESH")
    remesh.mode, remesh.voxel_size = "VOXEL", 0.2
    return [item]


def bevelled_cube():
    bpy.ops.mesh.primitive_cube_add()
    item = bpy.context.object
    bevel = item.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.4, 3
    return [item]


# Maker, a place within, and what is seen from there.
OUTLINES = {
    "sphere": (sphere, (0.3, -0.4, 0.1), (0.0, 1.0, 0.2)),
    "torus": (torus, (0.0, -1.0, 0.05), (1.0, 0.3, 0.1)),
    "hollow": (hollow, (0.1, -0.1, 0.05), (0.2, 1.0, 0.1)),
    "nested": (nested, (0.1, -0.1, 0.05), (0.2, 1.0, 0.1)),
    "suzanne": (monkey, (0.1, 0.0, 0.3), (0.3, -1.0, 0.0)),
    "suzanne-remeshed": (remeshed_monkey, (0.1, 0.0, 0.3), (0.3, -1.0, 0.0)),
    "bevelled-cube": (bevelled_cube, (0.3, -0.4, 0.1), (0.2, 1.0, 0.2)),
}


def material(varies):
    made = bpy.data.materials.new("Medium")
    made.use_nodes = True
    tree = made.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    closure = tree.nodes.new("ShaderNodeVolumePrincipled")
    closure.inputs["Color"].default_value = (0.8, 0.6, 0.9, 1.0)
    closure.inputs["Density"].default_value = 2.0
    closure.inputs["Anisotropy"].default_value = 0.3
    tree.links.new(closure.outputs["Volume"], output.inputs["Volume"])
    if varies:
        noise = tree.nodes.new("ShaderNodeTexNoise")
        noise.inputs["Scale"].default_value = 2.0
        noise.inputs["Detail"].default_value = 1.0
        gain = tree.nodes.new("ShaderNodeMath")
        gain.operation = "MULTIPLY"
        gain.inputs[1].default_value = 4.0
        tree.links.new(noise.outputs[0], gain.inputs[0])
        tree.links.new(gain.outputs[0], closure.inputs["Density"])
    return made


def camera(place, towards):
    data = bpy.data.cameras.new("Camera")
    item = bpy.data.objects.new("Camera", data)
    item.location = place
    item.rotation_euler = Vector(towards).to_track_quat("-Z", "Y").to_euler()
    data.clip_start = 0.01
    bpy.context.collection.objects.link(item)
    bpy.context.scene.camera = item


def surroundings():
    scene = bpy.context.scene
    data = bpy.data.lights.new("Sun", "SUN")
    data.energy, data.angle = 6.0, 0.05
    sun = bpy.data.objects.new("Sun", data)
    sun.rotation_euler = (0.6, 0.5, 0.0)
    bpy.context.collection.objects.link(sun)
    world = bpy.data.worlds.new("World")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.3, 0.5, 1.0)
    scene.world = world
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = 96, 54
    scene.cycles.volume_bounces = 4


def write(folder, name, outline, is_inside, is_sheared):
    maker, place, towards = OUTLINES[outline]
    bpy.ops.wm.read_factory_settings(use_empty=True)
    surroundings()
    items = maker()
    made = material(is_sheared)
    matrix = Matrix.Identity(4)
    if is_sheared:
        matrix = Matrix(
            ((1.3, 0.4, 0.0, 0.1), (0.0, 0.8, 0.3, -0.1), (0.1, 0.0, 0.9, 0.2), (0.0, 0.0, 0.0, 1.0))
        )
        # What no location, rotation and scale give is a parent's.
        for item in items:
            parent = bpy.data.objects.new("Parent", None)
            bpy.context.collection.objects.link(parent)
            item.parent, item.matrix_parent_inverse = parent, matrix
    for item in items:
        item.data.materials.clear()
        item.data.materials.append(made)
        if len(items) == 1:
            item.name = outline
    if is_inside:
        camera(matrix @ Vector(place), matrix.to_3x3() @ Vector(towards))
    else:
        camera((2.2, -4.6, 1.9), (-2.2, 4.6, -1.9))
    bpy.context.view_layer.update()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / f"{name}.blend"))


def main():
    folder = Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for outline in OUTLINES:
        write(folder, f"mesh-{outline}", outline, is_inside=False, is_sheared=False)
        write(folder, f"mesh-{outline}-within", outline, is_inside=True, is_sheared=False)
    write(folder, "mesh-torus-sheared", "torus", is_inside=False, is_sheared=True)
    write(folder, "mesh-torus-sheared-within", "torus", is_inside=True, is_sheared=True)


main()
