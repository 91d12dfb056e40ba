"""Cycles' picture of a .blend as it is, not of the scene that was exported from it.

So what the exporter loses or mistakes shows, which a reference built from the scene file would repeat. The
settings are those of every reference (cycles_settings, reference_render), at the size and samples asked for.
Run by itself: the request, a JSON object, is the only argument.
"""

import json
import sys

import bpy
from mathutils import Matrix

from blender_file import open_blend
from cycles_settings import apply_exr, apply_settings


def wish(scene, path):
    """Show what was asked for besides what the .blend shows: a material's cube, what is hidden, a camera."""
    with open(path, encoding="utf-8") as file:
        exported = json.load(file)
    for volume in [exported["volume"], *exported.get("other_volumes", [])]:
        item = bpy.data.objects.get(volume["object"])
        if item is not None:
            item.hide_render = False
        elif volume["object"] == f"Cube of {volume['material']}":
            bpy.ops.mesh.primitive_cube_add(size=2)
            bpy.context.object.data.materials.append(bpy.data.materials[volume["material"]])
    camera = exported["camera"]
    if scene.camera is None or scene.camera.name != camera["name"]:
        scene.camera = bpy.data.objects.get(camera["name"])
    if scene.camera is None:
        scene.camera = bpy.data.objects.new(camera["name"], bpy.data.cameras.new(camera["name"]))
        scene.collection.objects.link(scene.camera)
        scene.camera.matrix_world = Matrix(camera["matrix_world"])
        scene.camera.data.clip_end = camera["clip_end"]


def picture(request):
    """Render the "blend" of a request, as what was wished of it became the "scene", into its "exr"."""
    domains = open_blend(request["blend"]).domains
    scene = bpy.context.scene
    wish(scene, request["scene"])
    # A domain is empty without the cache of its simulation; opening has taken its modifier away.
    for domain in domains:
        domain.hide_render = True
    apply_settings(scene, request["samples"], request["seed"], threads=1)
    apply_exr(scene.render.image_settings, multilayer=False, codec="ZIP")
    scene.render.resolution_x, scene.render.resolution_y = request["resolution"]
    scene.render.resolution_percentage = 100
    scene.cycles.volume_biased = False
    scene.camera.data.dof.use_dof = False
    for material in bpy.data.materials:
        material.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"
    if scene.world is not None:
        scene.world.cycles.sampling_method = "AUTOMATIC" if request["sample_world"] else "NONE"
    for name in request["left_out"]:
        bpy.data.objects[name].hide_render = True
    bpy.ops.render.render()
    bpy.data.images["Render Result"].save_render(request["exr"], scene=scene)


if __name__ == "__main__":
    picture(json.loads(sys.argv[1]))
