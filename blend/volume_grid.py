"""Writes and reads OpenVDB grids of one density, with the library that Blender carries.

Request: {"write": FILE, "values": NPY, "to_object": 4 x 4 rows, "name": NAME, "half": BOOL} writes the
float32 array [x, y, z] with voxel (0, 0, 0) at index (0, 0, 0). {"read": FILE, "name": NAME, "values": NPY,
"most": VOXELS or null} stores the active part of a grid as such an array and answers {"first": [i, j, k],
"to_object": rows, "background": number, "names": [all grids]}.

`to_object` takes an index to the object's frame; the value of a voxel stands at its index, not half a voxel
on. Blocks of one value are written voxel by voxel: OpenVDB stores a constant block as a tile, and Cycles 5.0
cuts the last voxel's fade off at the low sides of tiles.
"""

import importlib
import math
import sys
from pathlib import Path

import numpy as np

import protocol
from scene_io import replaced_file

# Voxels per side of a leaf of the tree.
LEAF = 8


def library():
    """The module openvdb, which lies in a folder of Blender's own."""
    import bpy

    folder = Path(bpy.utils.resource_path("LOCAL")) / "python/lib"
    for packages in folder.glob("python3.*/site-packages"):
        if str(packages) not in sys.path:
            sys.path.append(str(packages))
    try:
        return importlib.import_module("openvdb")
    except ModuleNotFoundError:
        raise protocol.InputError(
            "request: a grid of voxels",
            f"Blender {bpy.app.version_string} without the Python module openvdb",
            "a release that has it, as 4.4 and later",
            "take another release for scenes with grids",
        ) from None


def write(path, values, to_object, name="density", half=False):
    """Write one grid."""
    openvdb = library()
    if values.ndim != 3 or values.dtype != np.float32 or not values.size:
        raise protocol.InputError(
            str(path),
            f"an array of {values.dtype} and shape {values.shape}",
            "float32 values in three dimensions",
            "give one value per voxel",
        )
    if not np.isfinite(values).all():
        raise protocol.InputError(
            str(path), "values that are NaN or infinite", "numbers", "find out where they come from"
        )
    grid = openvdb.FloatGrid()
    grid.name = name
    grid.copyFromArray(values)
    _split_tiles(grid, values)
    # OpenVDB multiplies from the left.
    rows = np.asarray(to_object, dtype=float).T
    grid.transform = openvdb.createLinearTransform(rows.tolist())
    grid.saveFloatAsHalf = half
    with replaced_file(path) as temporary:
        openvdb.write(str(temporary), [grid])


def _split_tiles(grid, values):
    """Make voxels of the constant blocks that the grid stores as tiles."""
    accessor = grid.getAccessor()
    for corner in np.ndindex(*[-(-size // LEAF) for size in values.shape]):
        first = tuple(LEAF * index for index in corner)
        block = values[tuple(slice(start, start + LEAF) for start in first)]
        if block.shape == (LEAF,) * 3 and block[0, 0, 0] != 0.0 and (block == block[0, 0, 0]).all():
            value = float(block[0, 0, 0])
            # Another value makes a leaf of the tile; the right one again does not undo it.
            accessor.setValueOn(first, 2.0 * value)
            accessor.setValueOn(first, value)


def _words(cause):
    """An exception on one line."""
    return f"{type(cause).__name__}: {' '.join(str(cause).split())}"


def read(path, name="density", most=None):
    """The active part of a grid of at most so many voxels as an array, and where it lies."""
    openvdb = library()
    if not Path(path).is_file():
        found = "a folder" if Path(path).is_dir() else "no such file"
        raise protocol.InputError(str(path), found, "an OpenVDB file", "correct the name")
    try:
        names = [entry.name for entry in openvdb.readAllGridMetadata(str(path))]
    except MemoryError:
        raise  # The caller says what the limit is.
    except Exception as cause:
        found = f"no OpenVDB file, or a damaged one ({_words(cause)})"
        raise protocol.InputError(str(path), found, "an OpenVDB file", "write it again") from cause
    if name not in names:
        raise protocol.InputError(
            str(path), f"the grids {', '.join(names)}", f'a grid "{name}"', "name one of these"
        )
    try:
        grid = openvdb.read(str(path), name)
    except MemoryError:
        raise
    except Exception as cause:
        found = f"values that cannot be read ({_words(cause)})"
        raise protocol.InputError(
            f"{path}: grid {name}", found, "an OpenVDB file that is whole", "write it again"
        ) from cause
    if grid.valueTypeName != "float":
        raise protocol.InputError(
            f"{path}: grid {name}", f"values of type {grid.valueTypeName}", "float", "convert the grid"
        )
    first, last = grid.evalActiveVoxelBoundingBox()
    size = [end - begin + 1 for begin, end in zip(first, last, strict=True)]
    if min(size) < 1:
        raise protocol.InputError(f"{path}: grid {name}", "no active voxel", "at least one", "fill the grid")
    if most is not None and math.prod(size) > most:
        raise protocol.InputError(
            f"{path}: grid {name}",
            f"{' x '.join(map(str, size))} active voxels",
            f"at most {most} in all",
            "write it again where it is damaged; otherwise make a smaller grid",
        )
    values = np.zeros(size, np.float32)
    grid.copyToArray(values, ijk=first)
    corners = [grid.transform.indexToWorld(index) for index in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1))]
    origin = np.array(corners[0])
    to_object = np.eye(4)
    to_object[:3, 3] = origin
    for axis in range(3):
        to_object[:3, axis] = np.array(corners[axis + 1]) - origin
    numbers = [("a frame", to_object), ("values", values), ("a background", grid.background)]
    for what, found in numbers:
        if not np.isfinite(found).all():
            raise protocol.InputError(
                f"{path}: grid {name}", f"{what} with NaN or infinity", "numbers", "write it again"
            )
    if abs(np.linalg.det(to_object[:3, :3])) == 0.0:
        raise protocol.InputError(
            f"{path}: grid {name}", "a frame without a volume", "one with three directions", "write it again"
        )
    return {
        "values": values,
        "first": [int(index) for index in first],
        "to_object": to_object.tolist(),
        "background": float(grid.background),
        "names": names,
    }


def _handle(request, messages):
    if "write" in request:
        values = np.load(request["values"])
        write(request["write"], values, request["to_object"], request["name"], request["half"])
        return {"voxels": int(values.size)}
    found = read(request["read"], request["name"], request.get("most"))
    np.save(request["values"], found.pop("values"))
    return found


if __name__ == "__main__":
    protocol.serve(
        "volume_grid.py", _handle, reads=lambda request: [request["read"]] if "read" in request else []
    )
