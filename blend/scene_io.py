"""Numbers, text and files of the scene format. Needs no Blender.

Every float of a scene is an f32. It is written as the shortest decimal that reads back as the same f32, so
that two files are equal as text exactly when their values are equal.
"""

import hashlib
import json
import math
import os
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from protocol import InputError

FORMAT = "cloudparity-scene/1"
LINE_WIDTH = 120


def shortest(value, place):
    """Return the float whose text is the shortest decimal of the f32 `value`. It must be finite."""
    single = np.float32(value)
    if not math.isfinite(single):
        raise InputError(place, str(single), "a finite number", "set a finite value in Blender")
    return float(str(single))


def shortest_list(values, place):
    """`shortest` for each number of a sequence, as a list."""
    return [shortest(value, place) for value in values]


def read_fields(owner, fields, place):
    """The attributes of `fields` {key: attribute} under their keys, numbers as shortest decimals."""
    values = {}
    for key, attribute in fields.items():
        value = getattr(owner, attribute)
        if isinstance(value, float):
            value = shortest(value, f"{place}, {attribute}")
        elif not isinstance(value, (str, int)):
            value = shortest_list(value, f"{place}, {attribute}")
        values[key] = value
    return values


def matrix_rows(matrix, place):
    """Return a 4x4 matrix as four rows of four numbers. Negative zero is written as zero: products of
    matrices do not keep its sign."""
    return [[shortest(value, place) + 0.0 for value in row] for row in matrix]


def matrix_array(rows):
    """Return the rows of a scene matrix as f64 array [4, 4] holding the exact f32 values."""
    return np.asarray(rows, dtype=np.float32).astype(np.float64)


def format_scene(scene):
    """Return the scene as JSON text for readers: a container stands on one line if it holds only scalars or
    fits in LINE_WIDTH characters, else each member has a line. Ends with a newline."""
    return _format(scene, "") + "\n"


def canonical_json(scene):
    """Return the scene as JSON with sorted keys and no spaces: equal text means equal scene."""
    return json.dumps(scene, sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def scene_hash(scene):
    """Return the SHA-256 of the canonical JSON (UTF-8) as hexadecimal digits."""
    return hashlib.sha256(canonical_json(scene).encode("utf-8")).hexdigest()


def check_format(scene):
    """Refuse a document that is not a scene of this format, or whose graph is still in another file."""
    if scene["format"] != FORMAT:
        raise InputError(
            "scene.format", repr(scene["format"]), repr(FORMAT), "convert the scene or use a matching release"
        )
    if "file" in scene["graph"]:
        raise InputError(
            "scene.graph",
            f"a reference to the file {scene['graph']['file']!r}",
            "the graph itself",
            "insert the content of that file: only the caller knows the folder that the name is relative to",
        )


@contextmanager
def replaced_file(path):
    """Yield a path in the folder of `path`, with its ending, to write to; on success rename it to `path`."""
    target = Path(path)
    if not target.parent.is_dir():
        raise InputError(str(target), f"no folder {target.parent}", "an existing folder", "create the folder")
    temporary = target.with_name(f".{target.stem}.{os.getpid()}{target.suffix}")
    try:
        yield temporary
        os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def _format(value, indent):
    compact = json.dumps(value, ensure_ascii=False)
    members = _members(value)
    if (
        not members
        or len(indent) + len(compact) <= LINE_WIDTH
        or not any(_members(member) for _, member in members)
    ):
        return compact
    inner = indent + " "
    lines = [inner + prefix + _format(member, inner) for prefix, member in members]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return opening + "\n" + ",\n".join(lines) + "\n" + indent + closing


def _members(value):
    """The members of a container with the text before each; nothing for a scalar."""
    if isinstance(value, dict):
        return [(json.dumps(key, ensure_ascii=False) + ": ", member) for key, member in value.items()]
    if isinstance(value, list):
        return [("", member) for member in value]
    return []
