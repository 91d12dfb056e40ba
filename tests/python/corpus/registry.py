"""The list of the corpus: every file has a name, a sentence, and a function that makes it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import bpy

from blend_support import run_apart


@dataclass(frozen=True)
class File:
    """One .blend of the corpus."""

    name: str
    about: str
    # Adds everything to the open, empty file; the argument is the folder of the .blend, for files beside it.
    make: Callable[[Path], None]
    # Part of the error with which the file has to be refused, and the document that lists the reason.
    refused: str | None = None
    documented: str | None = None
    # Part of the warning that says why Cycles' picture is another one.
    differs: str | None = None
    # Objects that are left out, with a warning. Cycles renders the file without them, too.
    left_out: tuple[str, ...] = ()
    # Whether Cycles samples the world as a light: needed where a picture has small bright parts.
    sample_world: bool = False
    # Samples per sub-pixel of both sides' pictures. 64 is the least for which Cycles' systematic error is
    # known (docs/parity.md); pictures that a small light makes noisy need more.
    samples: int = 64
    # Further arguments of `export`.
    arguments: tuple[str, ...] = ()
    # Whether a process of its own makes it: Blender's module aborts some time after it made a fluid domain.
    apart: bool = False


FILES: dict[str, File] = {}


def file(name, about, **properties):
    """Register the decorated function as the maker of a file."""

    def register(make):
        if name in FILES:
            raise ValueError(f"{name} stands twice in the corpus")
        FILES[name] = File(name, about, make, **properties)
        return make

    return register


def write(entry, folder, is_apart=False):
    """Make a file of the corpus in `folder` and return its path. `is_apart`: the process is its own."""
    folder = Path(folder)
    if entry.apart and not is_apart:
        call = f"corpus.write(corpus.FILES[{entry.name!r}], {str(folder)!r}, is_apart=True)"
        run_apart(f"import corpus\n{call}")
        return folder / f"{entry.name}.blend"
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = (1920, 1280)
    entry.make(folder)
    path = folder / f"{entry.name}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, check_existing=False)
    return path
