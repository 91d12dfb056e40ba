"""Numbers, text and files of the scene format. Needs no Blender.

Every float of a scene is an f32. It is written as the shortest decimal that reads back as the same f32, so
that two files are equal as text exactly when their values are equal.
"""

import errno
import hashlib
import itertools
import json
import math
import os
import shutil
import stat
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from protocol import InputError

FORMAT = "cloudparity-scene/1"
LINE_WIDTH = 120
MOST_LINKS = 40  # that are followed to an output, as Linux has it
_NUMBERS = itertools.count()  # of temporary files


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


def destination(path):
    """Where an output goes: (path, whether it is a stream). Links are followed; a device or a pipe stays what
    it is and is written to. The same rule for Rust is base::destination.

    Raises InputError for a folder, a socket, a disk and a loop of links.
    """
    place = Path(path)
    for _ in range(MOST_LINKS):
        try:
            mode = os.lstat(place).st_mode
        except FileNotFoundError:
            return place, False
        except OSError as error:
            raise _unwritable(path, error) from None
        if not stat.S_ISLNK(mode):
            return place, _is_stream(path, mode)
        folder = os.path.realpath(place.parent)
        if folder.startswith("/proc/") and folder.endswith("/fd"):
            # What a process has open: its text is no path.
            mode = os.stat(place).st_mode
            return place, stat.S_ISREG(mode) or _is_stream(path, mode)
        place = place.parent / os.readlink(place)
    raise _no_output(path, "links that lead in a circle")


def _is_stream(path, mode):
    """Whether what is there is written to instead of replaced."""
    if stat.S_ISREG(mode):
        return False
    if stat.S_ISCHR(mode) or stat.S_ISFIFO(mode):
        return True
    kinds = ((stat.S_ISDIR, "a folder"), (stat.S_ISSOCK, "a socket"), (stat.S_ISBLK, "a disk"))
    raise _no_output(path, next((name for is_it, name in kinds if is_it(mode)), "no file"))


def _no_output(path, found):
    expected = "a writable file, a pipe that is read, or a device such as /dev/null"
    return InputError(str(path), found, expected, "name a file to write")


def _unwritable(path, error):
    remedy = "check the path, its permissions and the free space"
    return InputError(str(path), error.strerror or str(error), "a writable file", remedy)


@contextmanager
def replaced_file(path, make_folder=False):
    """Yield a path with the ending of `path` to write to; on success its content goes to `path`.

    A file is replaced by a rename in its folder, which `make_folder` makes: on failure it stays as it is, and
    nothing else is left. A device or a pipe is written to.
    """
    target, is_stream = destination(path)
    if is_stream:
        with tempfile.TemporaryDirectory(prefix="cloudparity-") as folder:
            whole = Path(folder) / f"output{Path(path).suffix}"
            try:
                yield whole
                _copy(whole, target)
            except OSError as error:
                if error.errno == errno.ENXIO:
                    raise _no_output(path, "a pipe that nobody reads") from None
                raise _unwritable(path, error) from None
        return
    temporary = target.with_name(f".cloudparity-{os.getpid()}-{next(_NUMBERS)}{target.suffix}")
    try:
        if make_folder:
            os.makedirs(temporary.parent, exist_ok=True)
        elif not target.parent.is_dir():
            raise InputError(
                str(path), f"no folder {target.parent}", "an existing folder", "create the folder"
            )
        # The system says why a file cannot be made, which libraries keep to themselves. It does not
        # stay: Blender would keep it as an earlier version.
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        temporary.unlink()
        yield temporary
        _finish(temporary, target)
        os.replace(temporary, target)
    except OSError as error:
        raise _unwritable(path, error) from None
    finally:
        # Blender writes beside the name that it is given.
        for left in (temporary, temporary.with_name(f"{temporary.name}@")):
            with suppress(OSError):
                left.unlink(missing_ok=True)


def _finish(temporary, target):
    """Have the disk take the bytes, and give the permissions of the file that is replaced.

    Libraries may lose the error of a full disk (OpenVDB and OpenImageIO's PNG do): one without a free block
    after writing counts as full.
    """
    with open(temporary, "rb+") as stream:
        os.fsync(stream.fileno())
        disk = os.fstatvfs(stream.fileno())
        free = disk.f_bfree if os.geteuid() == 0 else disk.f_bavail
        if disk.f_blocks and not free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    try:
        mode = stat.S_IMODE(os.stat(target).st_mode) & 0o777
    except FileNotFoundError:
        mode = 0o644
    os.chmod(temporary, mode)


def _copy(whole, stream):
    """Write a file into a device or a pipe. Opening does not wait for a pipe's reader; writing does."""
    descriptor = os.open(stream, os.O_WRONLY | os.O_APPEND | os.O_NONBLOCK | os.O_NOCTTY)
    os.set_blocking(descriptor, True)
    with open(descriptor, "wb", buffering=0) as target, open(whole, "rb") as source:
        shutil.copyfileobj(source, target)


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
