"""Exports a .blend file with a volume material as a scene.

Request: {"blend": "F.blend", "object": null or "NAME" or ["NAME", ...], "frame": null or NUMBER, "camera":
null or "NAME", "material": null or "NAME", "include_hidden": null or BOOLEAN, "folder": null or "PATH",
"refused": null or {NODE TYPE: [REASON, WHAT TO DO]}, "world_nodes": null or {NODE TYPE: null or [OUTPUT,
...]}}: what scene_reader.Wish says; with `world_nodes`, a world of these nodes (all outputs, or the named
ones) is a graph.
Result: {"scene": {...}, "files": {NAME: PATH}}: the scene in the format cloudparity-scene/1, and the files
that belong beside the scene file under these names. What has to be made for it is written to `folder`.
Scripts in the file never run.
"""

import protocol


def handle(request, messages):
    """Open the file of the request and return its scene."""
    from blender_file import open_blend
    from scene_reader import Wish, read_scene

    messages.activity(f"opening {request['blend']}")
    taken_out = open_blend(request["blend"])
    names = request.get("object")
    wish = Wish(
        objects=[names] if isinstance(names, str) else names,
        frame=request.get("frame"),
        camera=request.get("camera"),
        material=request.get("material"),
        include_hidden=bool(request.get("include_hidden")),
    )
    found = read_scene(
        request["blend"],
        wish,
        messages,
        taken_out,
        request.get("folder"),
        request.get("refused"),
        request.get("world_nodes"),
    )
    return {"scene": found.scene, "files": found.files}


if __name__ == "__main__":
    protocol.serve("export_scene.py", handle, reads=lambda request: [request["blend"]])
