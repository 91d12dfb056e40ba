"""Builds a .blend file from a scene.

Request: {"scene": {...}, "blend": "Y.blend", "folder": null or the folder of the scene file}.
Result: {"blend": "Y.blend"}.
"""

import protocol


def handle(request, messages):
    """Build the scene of the request in an empty file and save it."""
    from blender_file import open_empty, save_blend
    from scene_builder import build_scene
    from scene_io import check_format

    check_format(request["scene"])
    open_empty()
    build_scene(request["scene"], messages.warning, request.get("folder"))
    save_blend(request["blend"])
    return {"blend": request["blend"]}


if __name__ == "__main__":
    protocol.serve("build_scene.py", handle)
