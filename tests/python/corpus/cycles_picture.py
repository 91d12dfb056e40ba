"""Cycles' picture of a .blend as it is, not of the scene that was exported from it.

So what the exporter loses or mistakes shows, which a reference built from the scene file would repeat. The
settings are those of every reference (cycles_settings, reference_render), at the size and samples asked for.
Run by itself: the request, a JSON object, is the only argument.
"""

import json
import sys

import bpy

from blender_file import open_blend
from cycles_settings import apply_exr, apply_settings


def picture(request):
    """Render {"blend", "exr", "resolution", "samples", "seed", "left_out", "sample_world"} into the EXR."""
    open_blend(request["blend"])
    scene = bpy.context.scene
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
