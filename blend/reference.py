"""Renders a scene with Cycles under the settings of a comparison, into an EXR that says how it was made.

Request: {"scene": {...}, "exr": "R.exr", "resolution": [w, h] or null, "samples": 256, "seed": 101,
          "film_transparent": null or bool, "volume_bounces": null or n, "volume_biased": false,
          "step_rate": 0.1, "threads": 0, "multilayer": false, "world_sampling": "NONE" or "AUTOMATIC",
          "metadata": {"k": "v"}, "folder": null or the folder that the scene's file names are relative to}
null takes the scene's own value. `step_rate` (with `volume_biased` only) multiplies the step of ray marching.
Instead of "exr" and "seed", "replicas": [{"exr", "seed", "metadata"}] renders several in one process. Result:
{"exr", "seconds" (of the render alone), "settings": {...}, "blender"}, or {"replicas": [the same],
"blender"}.
"""

import protocol


def handle(request, messages):
    """Build the scene of the request, render it, and write the EXR."""
    from reference_render import render_reference

    return render_reference(request, messages)


if __name__ == "__main__":
    protocol.serve("reference.py", handle)
