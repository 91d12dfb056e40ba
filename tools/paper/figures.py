"""Figures drawn from records by the program's own scripts, and compared pixel by pixel."""

import numpy as np
import OpenImageIO as oiio

from protocol import InputError

# Largest difference of a channel, of 255. Fonts and rasteriser are those of one pinned version of matplotlib,
# so that a figure is the same to the pixel where the processor's rounding is; covered areas round by one
# step, and colours blend two of them.
TOLERANCE = 2
REASON = (
    "one step of 255 for each of two areas that cover a pixel, whose share another processor rounds otherwise"
)
COLUMN = "largest difference of a channel, of 255"

DRAWERS = {}


def drawer(name):
    """Registers a function that draws: (document, file without extension) to the PNG's path."""

    def register(function):
        DRAWERS[name] = function
        return function

    return register


class Quiet:
    """Scripts report progress to their caller; here nobody listens."""

    def __getattr__(self, _name):
        return lambda *_arguments, **_named: None


@drawer("convergence")
def convergence(document, stem):
    """The figure of `cloudparity convergence`."""
    import convergence_plot
    import plots

    request = {"convergence": document, "svg": f"{stem}.svg", "png": f"{stem}.png"}
    plots.literally(convergence_plot.draw)(request, Quiet())
    plots.pyplot().close("all")
    return request["png"]


def pixels(path):
    """The 8-bit channels of a picture."""
    picture = oiio.ImageBuf(str(path))
    if picture.has_error:
        raise InputError(
            str(path), picture.geterror(), "a picture that can be read", "restore it from version control"
        )
    found = picture.get_pixels(oiio.UINT8)
    if found is None or not found.size:
        raise InputError(
            str(path), "no pixels", "a picture that can be read", "restore it from version control"
        )
    return found.astype(np.int16)


def compare(ours, theirs, limit=TOLERANCE):
    """The largest difference of a channel, pixels beyond the limit, the first of them; None: sizes differ."""
    first, second = pixels(ours), pixels(theirs)
    if first.shape != second.shape:
        return None
    apart = np.abs(first - second).max(axis=2)
    places = np.argwhere(apart > limit)
    where = tuple(int(at) for at in places[0][::-1]) if len(places) else None
    return int(apart.max()), len(places), where
