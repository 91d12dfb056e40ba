"""Exports a .blend file with a volume material as a scene.

Request: {"blend": "F.blend", "object": null or "NAME" or ["NAME", ...]}.
Result: {"scene": {...}, "world_image": null or "PATH"}: the scene in the format cloudparity-scene/1, and the
picture around it, which belongs beside the scene file. Scripts in the file never run.
"""

import protocol


def handle(request, messages):
    """Open the file of the request and return its scene."""
    import bpy

    from blender_file import open_blend
    from scene_reader import environment_path, read_scene

    open_blend(request["blend"])
    names = request.get("object")
    scene = read_scene(request["blend"], [names] if isinstance(names, str) else names, messages)
    has_image = "image" in scene["world"]
    return {"scene": scene, "world_image": environment_path(bpy.context.scene.world) if has_image else None}


if __name__ == "__main__":
    protocol.serve("export_scene.py", handle, reads=lambda request: [request["blend"]])
