"""Evaluates node outputs of a scene's graph at given points, with Cycles' own kernels and bit for bit.

Request: {"jobs": [{"scene": {...}, "points": "p.npy", "attributes": {"name": "a.npy"},
                    "outputs": [{"target": <target>, "file": "o.npy"}], "repeat": 1, "samples": 1,
                    "grid": {"values": "g.npy", "to_index": rows} for a Volume object}],
          "kernel": "sse42" or "default", "threads": 0}
Target: {"groups": [group node names from the material down], "node": "...", "output" or "input": identifier}.
Result: {"jobs": [{"outputs": [{"components": 1 or 3}], "render_seconds": [...]}], "kernel", "blender"}.

Points are f32 [n, 3] in the object space of the volume; each attribute is f32 [n, 3]; each output is written
as f32 [n] (float) or [n, 3] (vector, colour). More than one repeat or sample serves to measure time: renders,
and evaluations of every point in each. How it works, and its limits: point_probe.py.
"""

import os

import protocol

KERNEL_VARIABLE = "CYCLES_CPU_NO_AVX2"
# What the variable must be for each kernel. Cycles reads it once, when it starts.
KERNELS = {"sse42": "1", "default": None}


def check_kernel(request):
    """Refuse to start when the environment selects another kernel than the request."""
    kernel = request["kernel"]
    if kernel not in KERNELS:
        raise protocol.InputError(
            "request.kernel", repr(kernel), f"one of {list(KERNELS)}", "correct the request"
        )
    found = os.environ.get(KERNEL_VARIABLE)
    if found != KERNELS[kernel]:
        raise protocol.InputError(
            f"environment variable {KERNEL_VARIABLE}",
            "not set" if found is None else repr(found),
            f"{'not set' if KERNELS[kernel] is None else repr(KERNELS[kernel])} for kernel {kernel!r}",
            "set it before the script starts: Cycles chooses its kernel then",
        )


def handle(request, messages):
    """Run the jobs of the request one after the other."""
    import bpy

    from point_probe import PointProbe

    probe = PointProbe(request.get("threads", 0), messages.warning)
    results = []
    for index, job in enumerate(request["jobs"]):
        results.append(probe.run(job))
        messages.progress((index + 1) / len(request["jobs"]), f"job {index + 1} of {len(request['jobs'])}")
    return {"jobs": results, "kernel": request["kernel"], "blender": bpy.app.version_string}


if __name__ == "__main__":
    protocol.serve("probe.py", handle, before_bpy=check_kernel)
