"""Exports a .blend file with a volume material as a scene.

Request: {"blend": "F.blend", "object": null or "NAME"}.
Result: {"scene": {...}} in the format cloudparity-scene/1. Scripts in the file never run.
"""

import protocol


def handle(request, messages):
    """Open the file of the request and return its scene."""
    from blender_file import open_blend
    from scene_reader import read_scene

    open_blend(request["blend"])
    return {"scene": read_scene(request["blend"], request.get("object"), messages)}


if __name__ == "__main__":
    protocol.serve("export_scene.py", handle)
