"""Display pictures (8-bit PNG) from scene-linear values, as Blender shows them.

With the bpy package installed, its own OpenColorIO configuration is used (bpy itself is not imported). The
order is Blender's: times 2^exposure, look, display and view transform, power 1/gamma, clamp, times 255,
round; no dither. Pictures with alpha are divided by alpha before the transform, as in Blender's RGBA files.
Without the package the only view is the sRGB transfer curve on the values as they are.
"""

import importlib.util
import pathlib

import numpy as np
import OpenImageIO as oiio

import protocol
from scene_io import replaced_file

SCENE_SPACE = "Linear Rec.709"
DISPLAY = "sRGB"
FALLBACK_VIEW = "sRGB transfer curve (no bpy package, so not Blender's view)"


def blender_config():
    """Path of the OpenColorIO configuration inside the bpy package, or None without the package."""
    found = importlib.util.find_spec("bpy")
    if found is None:
        return None
    for folder in found.submodule_search_locations or []:
        configs = sorted(pathlib.Path(folder).glob("*/datafiles/colormanagement/config.ocio"))
        if configs:
            return configs[-1]
    return None


class Display:
    """One view: `apply` turns scene-linear RGB into display values 0..1; `used` says which view it was."""

    def __init__(self, view, look, exposure, gamma):
        self.exposure = exposure
        self.gamma = gamma
        self._processor = None
        config_path = blender_config()
        if config_path is None:
            self.used = FALLBACK_VIEW
            return
        self._processor = _processor(config_path, view, look, exposure, gamma)
        self.used = f"{view}, look {look}"

    def apply(self, rgb):
        """Scene-linear float [h, w, 3] to display values 0..1, float32 [h, w, 3]."""
        values = np.ascontiguousarray(rgb, np.float32).copy()
        if self._processor is not None:
            self._processor.applyRGB(values)
            return np.clip(values, 0, 1)
        values = np.maximum(values * 2.0**self.exposure, 0)
        values = np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)
        return np.clip(values ** (1 / self.gamma), 0, 1)


def _processor(config_path, view, look, exposure, gamma):
    import PyOpenColorIO as ocio

    config = ocio.Config.CreateFromFile(str(config_path))
    views, looks = list(config.getViews(DISPLAY)), ["None", *(item.getName() for item in config.getLooks())]
    for what, found, known in (("view", view, views), ("look", look, looks)):
        if found not in known:
            raise protocol.InputError(
                f"request: {what}", repr(found), f"one of {', '.join(known)}", "choose one of these names"
            )
    scale = 2.0**exposure
    chain = ocio.GroupTransform([ocio.MatrixTransform.Scale([scale, scale, scale, 1.0])])
    if look != "None":
        chain.appendTransform(ocio.LookTransform(src=SCENE_SPACE, dst=SCENE_SPACE, looks=look))
    chain.appendTransform(
        ocio.DisplayViewTransform(src=SCENE_SPACE, display=DISPLAY, view=view, looksBypass=True)
    )
    if gamma != 1.0:
        chain.appendTransform(ocio.ExponentTransform([1 / gamma, 1 / gamma, 1 / gamma, 1.0]))
    return config.getProcessor(chain).getDefaultCPUProcessor()


def straight_rgba(display, rgb, alpha):
    """Display picture with transparency: uint8 [h, w, 4], colour not multiplied by alpha."""
    safe = np.where(alpha > 0, alpha, 1.0)[..., None]
    return to_uint8(np.concatenate([display.apply(rgb / safe), np.clip(alpha, 0, 1)[..., None]], axis=-1))


def over(display, rgb, alpha, background):
    """Display picture over a constant scene-linear background, RGB + (1 - A) background: uint8 [h, w, 3].

    Exact for grey extinction only, because the film keeps one alpha for three colours.
    """
    return to_uint8(display.apply(rgb + (1 - alpha)[..., None] * np.asarray(background, np.float64)))


def to_uint8(values):
    """Values 0..1 as bytes, rounded half up."""
    return np.floor(255 * np.clip(values, 0, 1) + 0.5).astype(np.uint8)


def write_png(path, pixels):
    """Write uint8 [h, w, 3 or 4] (straight alpha) as PNG, through a temporary file and a rename."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "uint8")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    spec.attribute("oiio:ColorSpace", "sRGB")

    def save(temporary):
        output = oiio.ImageOutput.create(temporary)
        written = output.open(temporary, spec) and output.write_image(np.ascontiguousarray(pixels))
        if not (output.close() and written):
            raise OSError(output.geterror() or "OpenImageIO wrote nothing")

    with replaced_file(path, make_folder=True) as temporary:
        save(str(temporary))


def write_exr(path, pixels, names, attributes=None):
    """Write float [h, w, c] as a float EXR of channels `names`, through a temporary file and a rename.

    `attributes`: {name: number or text} of the header.
    """
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, "float")
    spec.channelnames = names
    spec.attribute("compression", "zip")
    for name, value in (attributes or {}).items():
        spec.attribute(name, value)

    def save(temporary):
        output = oiio.ImageOutput.create(temporary)
        written = output.open(temporary, spec) and output.write_image(
            np.ascontiguousarray(pixels, np.float32)
        )
        if not (output.close() and written):
            raise OSError(output.geterror() or "OpenImageIO wrote nothing")

    with replaced_file(path, make_folder=True) as temporary:
        save(str(temporary))


def write_text(path, text):
    """Write a text file through a temporary file and a rename."""
    with replaced_file(path, make_folder=True) as temporary:
        temporary.write_text(text, "utf-8")
