"""The work of reference.py: Cycles renders a scene, and the EXR carries its provenance as attributes."""

import json
import os
import re
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio

from blender_file import open_empty
from cycles_settings import apply_exr, apply_settings
from protocol import InputError
from scene_builder import build_scene
from scene_io import check_format, replaced_file, scene_hash

ATTRIBUTE_PREFIX = "cloudparity:"
MULTILAYER_PASSES = ("use_pass_emit", "use_pass_environment")
MULTILAYER_CYCLES_PASSES = ("use_pass_volume_direct", "use_pass_volume_indirect")
SAMPLE_STATUS = re.compile(r"Sample (\d+)/(\d+)")
WORLD_SAMPLING = ("NONE", "AUTOMATIC")
KERNEL_VARIABLE = "CYCLES_CPU_NO_AVX2"


def render_reference(request, messages):
    """Render the request (see reference.py) and return its result.

    Replicas share the process and the built scene; each render starts from its seed alone, so its pixels are
    those of a process of its own.
    """
    scene = request["scene"]
    check_format(scene)
    replicas = request.get("replicas") or [{"seed": request["seed"], "exr": request["exr"]}]
    open_empty()
    build_scene(scene, messages.warning, request.get("folder"))
    results = []
    for index, replica in enumerate(replicas):
        settings = apply_request(bpy.context.scene, request, replica["seed"])
        clock = Clock()
        _report_progress(messages, index, len(replicas), clock)
        with tempfile.TemporaryDirectory() as folder:
            rendered = Path(folder) / "render.exr"
            times = _render(rendered, clock)
            provenance = _provenance(request, replica, settings, times)
            with replaced_file(replica["exr"]) as temporary:
                copy_with_attributes(rendered, temporary, provenance)
        results.append({"exr": replica["exr"], "seconds": times["render_seconds"], "settings": settings})
    blender = {"blender": bpy.app.version_string}
    return ({"replicas": results} if request.get("replicas") else results[0]) | blender


def apply_request(target, request, seed):
    """Set what the request and the comparison ask for; return the settings that identify the render."""
    scene = request["scene"]
    render, cycles = target.render, target.cycles
    apply_settings(target, request["samples"], seed, request["threads"])
    apply_exr(render.image_settings, request["multilayer"], codec="ZIP")
    render.resolution_percentage = scene["film"]["resolution_percentage"]
    if request["resolution"] is not None:
        render.resolution_x, render.resolution_y = request["resolution"]
        render.resolution_percentage = 100
    if request["film_transparent"] is not None:
        render.film_transparent = request["film_transparent"]
    if request["volume_bounces"] is not None:
        cycles.volume_bounces = request["volume_bounces"]
        cycles.max_bounces = max(cycles.max_bounces, request["volume_bounces"])
    cycles.volume_biased = request["volume_biased"]
    cycles.volume_step_rate = request["step_rate"]
    cycles.volume_max_steps = 65536
    target.camera.data.dof.use_dof = False
    for material in bpy.data.materials:
        material.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"
    target.world.cycles.sampling_method = _world_sampling(request)
    if request["multilayer"]:
        view_layer = target.view_layers[0]
        for name in MULTILAYER_PASSES:
            setattr(view_layer, name, True)
        for name in MULTILAYER_CYCLES_PASSES:
            setattr(view_layer.cycles, name, True)
    return {
        "resolution": [
            render.resolution_x * render.resolution_percentage // 100,
            render.resolution_y * render.resolution_percentage // 100,
        ],
        "samples": cycles.samples,
        "seed": cycles.seed,
        "pixel_filter": cycles.pixel_filter_type,
        "film_transparent": render.film_transparent,
        "volume_bounces": cycles.volume_bounces,
        "max_bounces": cycles.max_bounces,
        "volume_biased": cycles.volume_biased,
        "step_rate": request["step_rate"],
        "volume_max_steps": cycles.volume_max_steps,
        "world_sampling": target.world.cycles.sampling_method,
        "threads": request["threads"],
        "multilayer": request["multilayer"],
        "kernel": "sse42" if os.environ.get(KERNEL_VARIABLE) == "1" else "default",
    }


def _world_sampling(request):
    """How Cycles samples the world as a light: NONE or AUTOMATIC.

    In media with several lobes Cycles 5.0.1 counts too brightly what it samples as a light and meets by
    chance as well, so NONE is the default; a constant world is not sampled as a light anyway. A picture as
    world in a
    medium of one lobe needs AUTOMATIC: by chance alone, small bright parts are hardly ever met.
    """
    method = request.get("world_sampling") or "NONE"
    if method not in WORLD_SAMPLING:
        raise InputError(
            "request.world_sampling", repr(method), f"one of {', '.join(WORLD_SAMPLING)}", "mend the request"
        )
    return method


class Clock:
    """Seconds by the wall clock and of processor time (of all threads) since a render began."""

    def __init__(self):
        self.restart()

    def restart(self):
        """Begin again at zero."""
        self._begin = (time.perf_counter(), time.process_time())
        self.first_sample = None

    def now(self):
        """Both times, [wall, processor]."""
        return [
            now - begin
            for now, begin in zip((time.perf_counter(), time.process_time()), self._begin, strict=True)
        ]


def _report_progress(messages, index, count, clock):
    """Send a progress event for each percent of the samples of render `index` of `count`.

    When the first sample is done the clock notes it.
    """
    last_percent = -1

    def report(status, *_):
        nonlocal last_percent
        match = SAMPLE_STATUS.search(str(status))
        done = int(match[1]) / int(match[2]) if match else 0.0
        if clock.first_sample is None and match and int(match[1]) > 0:
            clock.first_sample = clock.now()
        percent = int(100 * done)
        if percent > last_percent:
            last_percent = percent
            name = "Cycles" if count == 1 else f"Cycles, replica {index + 1} of {count}"
            messages.progress((index + done) / count, f"{name}: {match[0] if match else 'preparation'}")

    bpy.app.handlers.render_stats.clear()
    bpy.app.handlers.render_stats.append(report)


def _render(path, clock):
    """Render the open file into `path`; return its times in seconds.

    Processor time hardly depends on what else the machine does. The times of the preparation end where the
    first sample of every pixel is reported, so they hold that sample, too.
    """
    clock.restart()
    bpy.ops.render.render()
    wall, processor = clock.now()
    bpy.data.images["Render Result"].save_render(str(path), scene=bpy.context.scene)
    times = {"render_seconds": wall, "processor_seconds": processor}
    if clock.first_sample is not None:
        times["preparation_seconds"], times["preparation_processor_seconds"] = clock.first_sample
    return times


def _provenance(request, replica, settings, times):
    """The attributes of the EXR, {name: number or text}."""
    values = {
        "scene": request["scene"]["name"],
        "scene_sha256": scene_hash(request["scene"]),
        "renderer": f"Cycles, bpy {bpy.app.version_string} ({bpy.app.build_hash.decode()})",
        **times,
        **settings,
        **request["metadata"],
        **(replica.get("metadata") or {}),
    }
    return {ATTRIBUTE_PREFIX + name: value for name, value in values.items()}


def copy_with_attributes(source, target, attributes):
    """Copy an EXR of 32-bit floats, all parts, adding `attributes` {name: number, text, bool or list}.

    The pixels of the copy are compared with the original bit by bit.
    """
    parts = _read_parts(source)
    specs = []
    for spec, _ in parts:
        spec = oiio.ImageSpec(spec)
        spec.attribute("compression", "zip")
        for name, value in attributes.items():
            is_plain = isinstance(value, (int, float, str)) and not isinstance(value, bool)
            spec.attribute(name, value if is_plain else json.dumps(value))
        specs.append(spec)
    output = oiio.ImageOutput.create(str(target))
    opened = output.open(str(target), tuple(specs)) if len(specs) > 1 else output.open(str(target), specs[0])
    for index, (_, pixels) in enumerate(parts):
        if opened and index:
            opened = output.open(str(target), specs[index], "AppendSubimage")
        opened = opened and output.write_image(pixels)
    message = output.geterror()
    if not (opened and output.close()):
        raise InputError(str(target), message, "a file that can be written", "check the disk and the folder")
    for (_, original), (_, copy) in zip(parts, _read_parts(target), strict=True):
        if not np.array_equal(original.view(np.uint32), copy.view(np.uint32)):
            raise InputError(
                str(target), "pixels that differ from the render", "the same bits", "report this defect"
            )


def _read_parts(path):
    """All parts of an EXR: [(ImageSpec, f32 [height, width, channels])]."""
    file = oiio.ImageInput.open(str(path))
    if file is None:
        raise InputError(str(path), oiio.geterror(), "an EXR file", "check the render's messages on stderr")
    parts = []
    while file.seek_subimage(len(parts), 0):
        parts.append(
            (
                file.spec(),
                np.ascontiguousarray(file.read_image(len(parts), 0, 0, file.spec().nchannels, "float")),
            )
        )
    file.close()
    return parts
