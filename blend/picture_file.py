"""What the channels, parts and values of a picture file mean: the only reader of users' pictures.

`read` finds the picture in a file: OpenEXR with any parts, layers, windows and float or half channels; TIFF,
Radiance and others in floats; PNG, TIFF and JPEG in integers, whose meaning the caller has to state.
`docs/parity.md` has the rules for users. Needs no Blender.
"""

import dataclasses
import os
import re

import numpy as np
import OpenImageIO as oiio

TRANSMITTANCE = "transmittance"  # the layer that says what each colour lets through, beside alpha
COMBINED = "Combined"  # the pass of Blender's that holds the picture

# What integers of a file mean: the choices of --integers.
LINEAR, SRGB, DISPLAY = INTEGERS = ("linear", "srgb", "display")

# Pixels of a display window at most: 3 GiB of RGB in f32. A damaged header may announce any number.
MOST_PIXELS = 1 << 28

# Rec.709 primaries and white, as x and y of red, green, blue, white: OpenEXR's where none are
# given.
REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.329)
SAME_PRIMARIES = 2e-3  # chromaticities are written with three or four decimals


class Unreadable(Exception):
    """A picture cannot be read or compared; the text says why and what to do."""


@dataclasses.dataclass
class Picture:
    """One picture of a file.

    pixels: float32 [h, w, c] over the display window, rows from the top, 0 where the file has no
    pixels, alpha associated; names: channels without their layer, as R, G, B, A;
    origin: x, y of the display window; space: colour space that the file declares, or None;
    meaning: "radiance" or one of INTEGERS; name: part and layer in the file;
    notes: what a reader should know, one sentence each.
    """

    pixels: np.ndarray
    names: list
    origin: tuple
    space: str | None
    meaning: str
    name: str
    notes: list


@dataclasses.dataclass
class _Layer:
    """Channels of one part with one prefix: name as users type it, {channel: index in the part}."""

    subimage: int
    part: str
    prefix: str
    channels: dict
    name: str = ""

    @property
    def has_colour(self):
        return all(name in self.channels for name in "RGB")

    @property
    def has_luminance(self):
        return "Y" in self.channels and not self.has_colour and "X" not in self.channels

    @property
    def is_picture(self):
        return self.has_colour or self.has_luminance

    @property
    def is_combined(self):
        return self.name.rsplit(".", 1)[-1] == COMBINED

    def chosen(self):
        """The channels that are the picture; all of them where they are no colours."""
        wanted = "RGBA" if self.has_colour else "YA" if self.has_luminance else self.channels
        return [name for name in wanted if name in self.channels]


def read(path, part=None, integers=None, option="--part"):
    """The picture of a file.

    `part` names one of several, by part, layer or the end of its name ("Combined"). `integers` says what the
    values of an integer file are: "linear" scene-linear from 0 to 1, "srgb" decoded by the sRGB curve (IEC
    61966-2-1), "display" kept as display values; None accepts none. `option` names a part in messages. Raises
    Unreadable with the reason.
    """
    name = os.path.basename(path)
    file = _open(path, name)
    try:
        layers = _layers(file, name)
        layer = _chosen(layers, name, part, option)
        spec = file.spec(layer.subimage, 0)
        channels = layer.chosen()
        meaning = _meaning(spec, layer, channels, file.format_name(), integers, name)
        _check_spec(spec, layer, name)
        indices = [layer.channels[channel] for channel in channels]
        pixels = file.read_image(layer.subimage, 0, min(indices), max(indices) + 1, oiio.FLOAT)
        problem = file.geterror()
    finally:
        file.close()
    if pixels is None or problem:
        why = problem or "no pixels"
        raise Unreadable(f"{name} is damaged or not supported: {first_line(why)}. {_remedy(why)}")
    pixels = np.asarray(pixels, np.float32).reshape(spec.height, spec.width, -1)
    pixels = pixels[..., [index - min(indices) for index in indices]]
    notes = _layer_notes(layers, layer, channels)
    if meaning != "radiance":
        pixels = _decoded(pixels, channels, spec, meaning)
        notes.append(_words(spec, meaning))
    pixels = _in_display_window(pixels, spec, name, notes)
    return Picture(
        pixels=pixels,
        names=channels,
        origin=(spec.full_x, spec.full_y),
        space=spec.get_string_attribute("colorInteropID") or None if meaning == "radiance" else None,
        meaning=meaning,
        name=layer.name,
        notes=notes,
    )


def first_line(text):
    """The first line of a library's message, without the folders of a path in it."""
    return re.sub(r"(?<!\w)(?:/[^/\s\"']+)*/(?=[^/\s\"']+)", "", text.strip().splitlines()[0]).rstrip(".?! ")


def _open(path, name):
    if not os.path.isfile(path):
        raise Unreadable(f"{name} cannot be read: {_absent(path)}. Name a picture file.")
    # Alpha of a PNG is not associated; decoding comes before the product.
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(path, hints)
    if file is None:
        why = oiio.geterror() or "no image in it"
        raise Unreadable(f"{name} cannot be read: {first_line(why)}. {_remedy(why)}")
    return file


def _absent(path):
    if os.path.isdir(path):
        return "it is a folder"
    return "it is a pipe, a socket or a device" if os.path.exists(path) else "no such file"


def _remedy(why):
    if "subsampl" in why.lower():
        return (
            "Luminance and chroma (Y, RY, BY) are not supported: save it as R, G, B in the program that "
            "wrote it."
        )
    return "Render or export it again."


def _layers(file, name):
    """Every layer of every part, in file order, with names that are unique where the file's are."""
    layers = []
    index = 0
    while file.seek_subimage(index, 0):
        spec = file.spec()
        part = spec.get_string_attribute("oiio:subimagename")
        found = {}
        for position, channel in enumerate(spec.channelnames):
            prefix, _, last = channel.rpartition(".")
            last = last.upper() if len(last) == 1 else last
            found.setdefault(prefix, _Layer(index, part, prefix, {})).channels.setdefault(last, position)
        layers += found.values()
        index += 1
    file.geterror()  # of the part behind the last
    layers = [layer for layer in layers if layer.prefix != TRANSMITTANCE]
    if not layers:
        raise Unreadable(f"{name} has no channels. Render or export it again.")
    for layer in layers:
        layer.name = layer.prefix or layer.part
    names = [layer.name for layer in layers]
    for layer in layers:
        # The same layer in several parts (views of a stereo picture), or parts without a name.
        if names.count(layer.name) > 1:
            layer.name = "/".join(text for text in (layer.part or str(layer.subimage), layer.prefix) if text)
    return layers


def _chosen(layers, name, part, option):
    """The layer that `part` names, or the one that is the picture without being named."""
    if part is None:
        found = _default(layers)
        if found is None:
            raise Unreadable(
                f"{name} has several pictures, {_listed(layers)}, and no part was chosen. "
                f"Name one: {option} NAME."
            )
        return found
    for matches in (
        [layer for layer in layers if layer.name == part],
        [layer for layer in layers if layer.part == part],
        [layer for layer in layers if layer.name.endswith(f".{part}")],
        [layer for layer in layers if layer.name.startswith(f"{part}.")],
    ):
        if matches:
            found = _default(matches)
            if found is None:
                raise Unreadable(
                    f"{name} has several parts that {part!r} may mean, {_listed(matches)}. "
                    f"Name one in full: {option} NAME."
                )
            return found
    raise Unreadable(
        f"{name} has {_listed(layers)}, and part {part!r} is not among them. Name one of them: {option} NAME."
    )


def _default(layers):
    """What is meant without a name: the only layer; else the only one without a layer's name that has colours
    (OpenEXR's base layer); else the only Combined; else the only one with colours."""
    pictures = [layer for layer in layers if layer.is_picture]
    base = [layer for layer in pictures if not layer.prefix]
    combined = [layer for layer in pictures if layer.is_combined]
    return next((found[0] for found in (layers, base, combined, pictures) if len(found) == 1), None)


def _listed(layers):
    return ", ".join(repr(layer.name) for layer in layers)


def _meaning(spec, layer, channels, format_name, integers, name):
    """What values are: "radiance" for floats, what the caller states for integers."""
    formats = {str(spec.channelformat(layer.channels[channel])) for channel in channels}
    if formats <= {"float", "half", "double"}:
        return "radiance"
    listed = " and ".join(sorted(formats))
    if format_name == "openexr":
        raise Unreadable(
            f"{name} stores {listed} values in {layer.name or 'its channels'}; a float or half EXR holds "
            "scene-linear values. Integers of an EXR are ids of objects: name another part."
        )
    if integers is None:
        raise Unreadable(
            f"{name} stores {listed} values, which do not say what they are. Say it: --integers srgb decodes "
            "them by the sRGB curve, --integers linear takes them as scene-linear from 0 to 1, --integers "
            "display compares them with the display values of another such file."
        )
    if integers not in INTEGERS:
        raise Unreadable(f"--integers is {integers!r}; it is one of {', '.join(INTEGERS)}.")
    return integers


def _check_spec(spec, layer, name):
    if spec.deep:
        raise Unreadable(
            f"{name} is a deep picture, which has several samples a pixel. Flatten it in a compositor."
        )
    if spec.depth > 1:
        raise Unreadable(f"{name} is a volume of {spec.depth} slices. Name a picture.")
    if {"RY", "BY"} & set(layer.channels):
        raise Unreadable(
            f"{name} holds luminance and chroma (Y, RY, BY), which are not supported. Save it as R, G, B."
        )
    if spec.get_int_attribute("Orientation", 1) != 1:
        raise Unreadable(f"{name} is to be shown turned (Orientation). Save it upright.")
    primaries = spec.getattribute("chromaticities")
    if primaries is not None and len(primaries) == len(REC_709):
        off = max(abs(float(a) - b) for a, b in zip(primaries, REC_709, strict=True))
        # Blender writes a name beside them.
        if not off <= SAME_PRIMARIES and not spec.get_string_attribute("colorInteropID"):
            listed = ", ".join(f"{float(value):.4g}" for value in primaries)
            raise Unreadable(
                f"{name} declares other primaries than Rec.709 (chromaticities {listed}). Save it in linear "
                "Rec.709."
            )
    if spec.full_width * spec.full_height > MOST_PIXELS or min(spec.full_width, spec.full_height) < 1:
        raise Unreadable(
            f"{name} has a display window of {spec.full_width} x {spec.full_height} pixels, more than "
            f"{MOST_PIXELS} or none. Render or export it again."
        )


def _layer_notes(layers, layer, channels):
    notes = []
    if len(layers) > 1:
        others = len(layers) - 1
        notes.append(f"{layer.name or 'layer without a name'!r} is read, 1 of {others + 1} in the file.")
    if layer.is_picture:
        extra = [name for name in layer.channels if name not in channels]
        if extra:
            notes.append(f"channels {', '.join(extra)} beside the colours are left out.")
    return notes


def _decoded(pixels, channels, spec, meaning):
    """Integers as values from 0 to 1, colours decoded where asked for, times alpha where it was not."""
    colours = [index for index, channel in enumerate(channels) if channel != "A"]
    is_straight = "A" in channels and bool(spec.get_int_attribute("oiio:UnassociatedAlpha"))
    alpha = pixels[..., [channels.index("A")]] if "A" in channels else np.float32(1)
    result = pixels.copy()
    values = pixels[..., colours]
    if meaning == SRGB:
        if "A" in channels and not is_straight:
            values = values / np.where(alpha > 0, alpha, 1)
            is_straight = True
        values = np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)
    result[..., colours] = values * alpha if is_straight else values
    return result.astype(np.float32)


def _words(spec, meaning):
    bits = spec.get_int_attribute("oiio:BitsPerSample") or 8 * spec.format.basesize()
    what = f"{bits}-bit integers"
    return {
        LINEAR: f"{what} are taken as scene-linear values from 0 to 1, as stated.",
        SRGB: f"{what} are decoded by the sRGB curve, as stated: light of a display from 0 to 1, which "
        "is radiance only where the view was Standard without look, exposure and gamma, and nothing was "
        "clipped.",
        DISPLAY: f"{what} are compared as display values, as stated: no figure is of radiance, relMSE and "
        "means included.",
    }[meaning]


def _in_display_window(pixels, spec, name, notes):
    """The pixels of the display window: 0 where there are none, as OpenEXR has it."""
    data = (spec.x, spec.y, spec.width, spec.height)
    shown = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    if data == shown:
        return pixels
    result = np.zeros((shown[3], shown[2], pixels.shape[-1]), np.float32)
    left, top = max(data[0], shown[0]), max(data[1], shown[1])
    right = min(data[0] + data[2], shown[0] + shown[2])
    bottom = min(data[1] + data[3], shown[1] + shown[3])
    covered = max(right - left, 0) * max(bottom - top, 0)
    if covered:
        result[top - shown[1] : bottom - shown[1], left - shown[0] : right - shown[0]] = pixels[
            top - data[1] : bottom - data[1], left - data[0] : right - data[0]
        ]
    missing, outside = shown[2] * shown[3] - covered, data[2] * data[3] - covered
    if missing:
        notes.append(f"{missing} pixels of the display window are not in the file and count as 0.")
    if outside:
        notes.append(f"{outside} pixels outside the display window are left out.")
    return result


def colours(picture):
    """(pixels, names) of a picture as R, G, B and, where it has one, A; a luminance as three equal
    colours. Raises Unreadable where it has no colours."""
    names = picture.names
    colour = "RGB" if all(name in names for name in "RGB") else "YYY"
    if not all(name in names for name in colour) or "X" in names:
        raise Unreadable(f"{picture.name or 'the file'} has channels {', '.join(names)}, no colours")
    alpha = "A" if "A" in names else ""
    return picture.pixels[..., [names.index(name) for name in colour + alpha]], list("RGB" + alpha)
