"""Opening, checking and saving .blend files."""

from pathlib import Path

import bpy
from bpy.app.handlers import persistent

from preparation import TakenOut
from protocol import InputError
from scene_io import replaced_file

WORKING_SPACE = "Linear Rec.709"


def open_blend(path):
    """Open the .blend file `path`; what was taken out of it before Blender evaluated it, a TakenOut.

    Scripts in the file never run.
    """
    if not Path(path).is_file():
        found = "a folder" if Path(path).is_dir() else "no such file"
        raise InputError(str(path), found, "a .blend file", "check the path")
    taken_out = []

    @persistent
    def take_out(*_):
        taken_out.append(TakenOut())

    # The file is evaluated as a part of opening it, after these handlers.
    bpy.app.handlers.load_post.append(take_out)
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise InputError(
            str(path),
            f"a file that Blender {bpy.app.version_string} cannot open ({str(error).strip()})",
            "a .blend file that is whole, of this release or an older one",
            f"save it again with Blender {bpy.app.version[0]}.{bpy.app.version[1]}",
        ) from None
    finally:
        bpy.app.handlers.load_post.remove(take_out)
    require_working_space()
    return taken_out[-1]


def open_empty():
    """Replace the open file by an empty one: a scene without objects and world, factory settings."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    require_working_space()


def require_working_space():
    """Refuse a working colour space in which Cycles has other luminance weights than the evaluators.

    Before Blender 5.0 a file had none of its own: the factory's is the one.
    """
    if bpy.app.version < (5, 0, 0):
        return
    found = bpy.data.colorspace.working_space
    if found != WORKING_SPACE:
        raise InputError(
            "working colour space of the file",
            found,
            WORKING_SPACE,
            "in Blender: Render properties, Color Management, set the working space and convert the colours",
        )


def save_blend(path):
    """Save the open file as a compressed .blend at `path`; the file appears only when it is complete."""
    with replaced_file(path) as temporary:
        try:
            bpy.ops.wm.save_as_mainfile(
                filepath=str(temporary.absolute()), compress=True, copy=True, check_existing=False
            )
        except RuntimeError as error:
            found = " ".join(str(error).split()).replace(str(temporary.absolute()), "the file")
            raise InputError(
                str(path), found, "a writable file", "check the path, its permissions and the free space"
            ) from None
