"""What releases of Blender before 5.0 lack or do otherwise, so that every script runs in them.

`prepare` is called once, before a script touches Blender. In 5.0 and later it does nothing. The scripts that
render stay as they are: cached references are named by their texts.
"""

import bpy


class _Instead:
    """An object of Blender with some attributes replaced: what RNA defines cannot be set on its classes.

    `original` and the replacements are functions that give the objects: Blender's own end with the open file.
    """

    def __init__(self, original, **replaced):
        self._original = original
        self._replaced = replaced

    def __getattr__(self, name):
        return self._replaced[name]() if name in self._replaced else getattr(self._original(), name)

    def __getitem__(self, key):
        return self._original()[key]

    def __iter__(self):
        return iter(self._original())

    def __len__(self):
        return len(self._original())


def _with_nodes(collection):
    """A collection whose new members have node trees, as all have from 5.0 on."""

    def new(name):
        made = collection().new(name)
        made.use_nodes = True
        return made

    return _Instead(collection, new=lambda: new)


def prepare():
    """Give the API of this release what scripts use that it does not have."""
    if bpy.app.version >= (5, 0, 0):
        return
    # A kind of medium is chosen with the format here.
    bpy.types.ImageFormatSettings.media_type = property(lambda settings: "", lambda settings, value: None)
    materials, worlds = (
        _with_nodes(lambda: bpy.data.materials),
        _with_nodes(lambda: bpy.data.worlds),
    )
    data = _Instead(lambda: bpy.data, materials=lambda: materials, worlds=lambda: worlds)
    if "exposure" not in bpy.types.Light.bl_rna.properties:
        bpy.types.Light.exposure = property(lambda light: 0.0, _set_exposure)
    if "rename" not in bpy.types.ID.bl_rna.functions:
        bpy.types.ID.rename = _rename
    import graph_builder
    import scene_builder

    graph_builder.bpy = scene_builder.bpy = _Instead(lambda: bpy, data=lambda: data)


def _rename(data_block, name, mode="NEVER"):
    """Takes the name, whoever has it: Blender gives another one to that data block, or to this one."""
    data_block.name = name


def _set_exposure(light, value):
    if value != 0.0:
        raise ValueError(
            f"an exposure of {value}, where lights of Blender {bpy.app.version_string} have none"
        )
