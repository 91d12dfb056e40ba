"""Evaluates node outputs at points: each point becomes one face of a grid and one pixel of a render.

The inputs are attributes on the faces, so they are constant over a face and nothing is interpolated. An
orthographic camera looks at the grid so that each pixel sees one face, and AOV outputs carry the node outputs
into an OpenEXR file of 32-bit floats. Everything comes back bit for bit, NaN and infinities included, except
that the film adds to +0 and so turns -0 into +0. probe_graph.py prepares the material.
"""

import math
import tempfile
import time
from pathlib import Path

import bpy
import numpy as np
import OpenImageIO as oiio
from mathutils import Matrix

from blender_file import open_empty
from cycles_settings import apply_exr, apply_settings
from probe_graph import RESERVED_PREFIX, ProbeMaterial, aov_name
from protocol import InputError
from scene_builder import set_object_info
from scene_io import check_format, matrix_array, replaced_file

LARGEST_SIDE = 1024
SMALLEST_SIDE = 4  # Blender renders no smaller image.
MAX_AOVS = 30
# From the middle of a face, where the diagonal passes that splits it into triangles. In faces.
PIXEL_SHIFT = (0.171, -0.093)
# How far a corner of the grid may be from its place when the grid has the volume's matrix. In faces.
LARGEST_MISPLACEMENT = 0.02


class PointProbe:
    """Runs probe jobs in one Blender process, in an empty file."""

    def __init__(self, threads, warn):
        """`threads`: render threads, 0 for all. `warn(place, message)` is told of inexact reproductions."""
        open_empty()
        self._warn = warn
        self._scene = bpy.context.scene
        self._camera = _add_camera(self._scene)
        self._anchor = bpy.data.objects.new("probe anchor", None)
        self._scene.collection.objects.link(self._anchor)
        self._grids = {}
        apply_settings(self._scene, samples=1, seed=0, threads=threads)
        apply_exr(self._scene.render.image_settings, multilayer=True, codec="NONE")
        # Cycles ignores the width of its box filter; this is the narrowest filter that it has.
        self._scene.cycles.pixel_filter_type = "BLACKMAN_HARRIS"
        self._scene.cycles.filter_width = 0.01
        self._scene.cycles.max_bounces = 0
        self._scene.view_layers[0].use_pass_combined = False

    def run(self, job):
        """Run one job of a probe request (see probe.py) and write its output files.

        Returns {"outputs": [{"components": 1 or 3}], "render_seconds": [seconds of each repeat]}. (Processor
        time says less: of two threads that one render thread has, one waits busily.)
        """
        scene = job["scene"]
        check_format(scene)
        points = _load_vectors(job["points"], "job.points")
        attributes = _load_attributes(job.get("attributes", {}), len(points))
        grid = _load_grid(job.get("grid"))
        outputs = job["outputs"]
        seconds = np.zeros(_positive(job, "repeat"))
        self._scene.cycles.samples = _positive(job, "samples")
        values = []
        for start in range(0, len(outputs), MAX_AOVS):
            targets = [output["target"] for output in outputs[start : start + MAX_AOVS]]
            with ProbeMaterial(scene["graph"], targets, self._warn, grid is not None) as material:
                inputs = attributes | material.coordinates(points, scene["volume"], grid)
                values += self._evaluate(material, inputs, len(points), scene["volume"], seconds)
        for output, value in zip(outputs, values, strict=True):
            with replaced_file(output["file"]) as temporary, open(temporary, "wb") as stream:
                np.save(stream, value)
        return {
            "outputs": [{"components": 1 if value.ndim == 1 else 3} for value in values],
            "render_seconds": seconds.tolist(),
        }

    def _evaluate(self, material, inputs, count, volume, seconds):
        """Render `inputs` {attribute name: f32 [count, 3]} and add the times to `seconds` [repeats].

        Returns f32 [count] or [count, 3] for each AOV of the material. `volume` describes the shaded object.
        """
        _declare_aovs(self._scene.view_layers[0], material.components)
        values = [np.empty(count if size == 1 else (count, size), np.float32) for size in material.components]
        for start in range(0, count, LARGEST_SIDE**2):
            chunk = slice(start, min(start + LARGEST_SIDE**2, count))
            grid = self._show_grid(chunk.stop - chunk.start, material, volume)
            grid.fill({name: data[chunk] for name, data in inputs.items()})
            for repeat in range(len(seconds)):
                begin = time.perf_counter()
                bpy.ops.render.render()
                seconds[repeat] += time.perf_counter() - begin
            for value, image in zip(values, self._read_aovs(material.components), strict=True):
                value[chunk] = image[: chunk.stop - chunk.start]
        return values

    def _show_grid(self, count, material, volume):
        """Make the grid for `count` points the only thing in view."""
        side = min(max(math.ceil(math.sqrt(count)), SMALLEST_SIDE), LARGEST_SIDE)
        if side not in self._grids:
            self._grids[side] = _Grid(side, self._scene, self._anchor)
        for grid in self._grids.values():
            grid.item.hide_render = grid.side != side
        self._grids[side].set_material(material.material)
        if material.sees_object:
            self._grids[side].stand_for(volume, material.material)
        else:
            self._grids[side].stand_still()
        self._scene.render.resolution_x = self._scene.render.resolution_y = side
        self._camera.data.ortho_scale = side
        middle = side / 2
        self._camera.location = (middle + PIXEL_SHIFT[0], -1.0, middle + PIXEL_SHIFT[1])
        return self._grids[side]

    def _read_aovs(self, components):
        """The AOVs of the last render, in the order of the faces: f32 [faces] or [faces, 3]."""
        with tempfile.TemporaryDirectory() as folder:
            path = str(Path(folder) / "aovs.exr")
            bpy.data.images["Render Result"].save_render(path, scene=self._scene)
            return _read_exr(path, self._scene.view_layers[0].name, components)


class _Grid:
    """A square of side x side unit faces in the XZ plane, face 0 at the origin, X first.

    `anchor` is an object at the origin.
    """

    def __init__(self, side, scene, anchor):
        self.side = side
        mesh = bpy.data.meshes.new(f"grid {side}")
        corners = np.arange((side + 1) ** 2, dtype=np.int32).reshape(side + 1, side + 1)
        quads = np.stack([corners[:-1, :-1], corners[:-1, 1:], corners[1:, 1:], corners[1:, :-1]], axis=-1)
        places = np.zeros((side + 1, side + 1, 3), np.float32)
        places[..., 0] = np.arange(side + 1)
        places[..., 2] = np.arange(side + 1)[:, None]
        self._places = places.reshape(-1, 3)
        mesh.vertices.add((side + 1) ** 2)
        mesh.vertices.foreach_set("co", self._places.ravel())
        mesh.loops.add(4 * side**2)
        mesh.loops.foreach_set("vertex_index", quads.ravel())
        mesh.polygons.add(side**2)
        mesh.polygons.foreach_set("loop_start", np.arange(0, 4 * side**2, 4, dtype=np.int32))
        mesh.update(calc_edges=True)
        self.item = bpy.data.objects.new(mesh.name, mesh)
        # The inverse matrix towards a parent is kept bit for bit, an object's own matrix is not.
        self.item.parent = anchor
        self._rows = np.eye(4)
        scene.collection.objects.link(self.item)

    def set_material(self, material):
        self.item.data.materials.clear()
        self.item.data.materials.append(material)

    def stand_for(self, volume, material):
        """Take the name, the matrix and all else that Object Info shows of a volume; the picture stays."""
        self._place(matrix_array(volume["matrix_world"]), f"{volume.place}.matrix_world")
        name = volume["object"]
        self.item.rename(name, mode="ALWAYS")
        if self.item.name != name:
            raise InputError(
                f"{volume.place}.object",
                repr(name),
                f"a name that Blender keeps ({self.item.name!r})",
                "rename it",
            )
        set_object_info(self.item, material, volume)

    def stand_still(self):
        """Take the place at the origin again."""
        self._place(np.eye(4), "the origin")

    def _place(self, rows, where):
        """Give the object the matrix `rows` f64 [4, 4] and keep the corners where they are in the world."""
        if np.array_equal(rows, self._rows):
            return
        corners = self._places
        if not np.array_equal(rows, np.eye(4)):
            inverse = np.linalg.inv(rows)
            corners = (self._places @ inverse[:3, :3].T + inverse[:3, 3]).astype(np.float32)
            single = rows.astype(np.float32)
            error = np.abs(corners @ single[:3, :3].T + single[:3, 3] - self._places).max()
            if not error <= LARGEST_MISPLACEMENT:
                raise InputError(
                    where,
                    f"a matrix that misplaces the probe's grid by {error:.3g} of its faces",
                    f"at most {LARGEST_MISPLACEMENT}: f32 places near the origin",
                    "probe a copy of the scene with the object near the origin and of a size like 1",
                )
        self.item.matrix_parent_inverse = Matrix(rows)
        self.item.data.vertices.foreach_set("co", corners.ravel())
        self._rows = rows

    def fill(self, inputs):
        """Replace the face attributes by `inputs` {name: f32 [n, 3]}; the last point fills the rest."""
        attributes = self.item.data.attributes
        for name in [
            item.name for item in attributes if item.domain == "FACE" and item.data_type == "FLOAT_VECTOR"
        ]:
            if name not in inputs:
                attributes.remove(attributes[name])
        for name in inputs:
            if name not in attributes:
                attributes.new(name, "FLOAT_VECTOR", "FACE")
        for name, values in inputs.items():
            padding = np.broadcast_to(values[-1], (self.side**2 - len(values), 3))
            attributes[name].data.foreach_set("vector", np.concatenate([values, padding]).ravel())
        self.item.data.update()


def _add_camera(scene):
    camera = bpy.data.cameras.new("probe")
    camera.type = "ORTHO"
    camera.clip_start, camera.clip_end = 0.1, 10.0
    item = bpy.data.objects.new("probe", camera)
    item.matrix_basis = Matrix(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1)))
    scene.collection.objects.link(item)
    scene.camera = item
    return item


def _declare_aovs(view_layer, components):
    while view_layer.aovs:
        view_layer.aovs.remove(view_layer.aovs[0])
    for index, size in enumerate(components):
        aov = view_layer.aovs.add()
        aov.name = aov_name(index)
        aov.type = "VALUE" if size == 1 else "COLOR"


def _read_exr(path, layer, components):
    file = oiio.ImageInput.open(path)
    parts = {}
    part = 0
    while file.seek_subimage(part, 0):
        parts.update({name: (part, index) for index, name in enumerate(file.spec().channelnames)})
        part += 1
    images = []
    for index, size in enumerate(components):
        channels = [parts[f"{layer}.{aov_name(index)}.{name}"] for name in ("X" if size == 1 else "RGB")]
        part, first = channels[0][0], min(channel for _, channel in channels)
        last = max(channel for _, channel in channels)
        pixels = file.read_image(part, 0, first, last + 1, "float")
        columns = [channel - first for _, channel in channels]
        # The file's first row is the top of the picture, the grid's first row the bottom.
        values = np.asarray(pixels)[::-1, :, columns].reshape(-1, size)
        images.append(values[:, 0] if size == 1 else values)
    file.close()
    return images


def _positive(job, key):
    value = job.get(key, 1)
    if not isinstance(value, int) or value < 1:
        raise InputError(f"job.{key}", repr(value), "a whole number from 1", "correct the request")
    return value


def _load_attributes(files, count):
    for name in files:
        if name.startswith(RESERVED_PREFIX):
            raise InputError(
                f"job.attributes[{name}]",
                "a reserved name",
                f"a name without {RESERVED_PREFIX!r} in front",
                "rename it",
            )
    attributes = {name: _load_vectors(path, f"job.attributes[{name}]") for name, path in files.items()}
    for name, values in attributes.items():
        if len(values) != count:
            raise InputError(
                f"job.attributes[{name}]", f"{len(values)} rows", f"{count}, one for each point", "correct it"
            )
    return attributes


def _load_grid(entry):
    """The grid of a Volume object, values f32 [x, y, z] and rows f32 [3, 4] to an index; None without one."""
    if entry is None:
        return None
    return np.load(entry["values"], allow_pickle=False), np.asarray(entry["to_index"], np.float32)


def _load_vectors(path, place):
    """Load an .npy file that must hold f32 [n, 3], n > 0."""
    try:
        values = np.load(path, allow_pickle=False)
    except (OSError, ValueError) as error:
        raise InputError(place, f"{path}: {error}", "an .npy file", "check the path and the writer") from None
    if values.dtype != np.float32 or values.ndim != 2 or values.shape[1] != 3 or len(values) == 0:
        raise InputError(
            place,
            f"{path}: {values.dtype} {list(values.shape)}",
            "float32 [n, 3], n > 0",
            "convert the array",
        )
    return values
