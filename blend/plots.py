"""What all figures share: matplotlib with the same fonts and lines, colours, and files written whole.

Colours are those of Okabe and Ito, which differ for every kind of sight; figures use markers and dashes
besides, so that they survive print in grey.
"""

import itertools

import protocol
from scene_io import replaced_file

BLACK = "#000000"
BLUE = "#0072B2"
GREEN = "#009E73"
ORANGE = "#D55E00"
PURPLE = "#CC79A7"
WIDTH = 3.33  # inches: a column of a paper of two columns
TEXT_WIDTH = 7.0  # inches: both columns
SMALLEST = 6  # points: the smallest letters that are read in print
RESOLUTION = 300  # dots per inch of what is drawn as pixels, which print asks for
# Keys of requests that hold names which the user chose.
NAMES = ("title", "scene", "density", "light", "view")


def literally(draw):
    """`draw(request, messages)` with the user's names as plain text: a dollar begins no formula."""
    return lambda request, messages: draw(_literal(request), messages)


def _literal(value):
    if isinstance(value, dict):
        for key, item in value.items():
            is_name = key in NAMES and isinstance(item, str)
            value[key] = _plain(item) if is_name else _literal(item)
    elif isinstance(value, list):
        for item in value:
            _literal(item)
    return value


def _plain(name):
    """A name as matplotlib shows it unchanged; controls, which no SVG may hold, are spaces."""
    return "".join(letter if letter.isprintable() else " " for letter in name).replace("$", r"\$")


def pyplot():
    """matplotlib.pyplot without a display, set up for figures of this program."""
    try:
        import matplotlib
    except ImportError as error:
        raise protocol.InputError(
            "Python package matplotlib", str(error), "the plots' library", "run `make setup`"
        ) from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as found

    found.rcParams.update(
        {
            "font.size": 8,
            "font.family": "DejaVu Sans",
            "axes.linewidth": 0.6,
            "lines.linewidth": 1.0,
            "lines.markersize": 4,
            "svg.hashsalt": "cloudparity",
            # Text that can be searched, copied and edited; publishers refuse fonts of Type 3.
            "svg.fonttype": "none",
            "pdf.fonttype": 42,
        }
    )
    return found


def label_points(axis, labels, lines=()):
    """Write `labels` (text, x, y) beside their points, each where it covers no point, line, label or frame.

    Of eight places around a point, near and far, the first free one is taken; a label without is left out.
    One that is not right beside its point has a line to it, so that no other point is taken for it.

    Points are those of the axis' markers; `lines` are polylines of data places. The figure must be laid out.
    """
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

    figure = axis.figure
    renderer = figure.canvas.get_renderer()
    inside = axis.get_window_extent(renderer)
    scale = figure.dpi / 72
    taken = [
        Bbox.from_bounds(x - 2.5 * scale, y - 2.5 * scale, 5 * scale, 5 * scale) for x, y in _markers(axis)
    ]
    taken += [Bbox.from_extents(x, y, x, y) for line in lines for x, y in _along(axis, line, 2 * scale)]
    written = []
    for text, x, y in labels:
        note = axis.annotate(
            text,
            (x, y),
            xytext=(0, 0),
            textcoords="offset points",
            fontsize=SMALLEST,
            zorder=5,
            arrowprops={"arrowstyle": "-", "linewidth": 0.4, "color": "0.5", "shrinkA": 0, "shrinkB": 2},
        )
        note.arrow_patch.set_visible(False)
        for distance, (side, up) in itertools.chain(
            *(itertools.product(DISTANCES, places) for places in (PLACES[:3], PLACES[3:]))
        ):
            note.set(ha=SIDES[side], va=HEIGHTS[up])
            note.xyann = (distance * side, distance * up)
            # Of the text alone, without its line.
            note.update_positions(renderer)
            box = Text.get_window_extent(note, renderer).padded(0.5 * scale)
            fits = inside.x0 <= box.x0 and box.x1 <= inside.x1
            fits = fits and inside.y0 <= box.y0 and box.y1 <= inside.y1
            if fits and not any(box.overlaps(other) for other in taken):
                note.arrow_patch.set_visible(distance > DISTANCES[0])
                taken.append(box)
                written.append(note)
                break
        else:
            note.remove()
    return written


DISTANCES = (4, 8, 13, 19)  # points
# Around a point: left and below first, where a Pareto front has nothing; up is positive.
PLACES = ((-1, 0), (-1, -1), (-1, 1), (0, -1), (1, 0), (1, 1), (1, -1), (0, 1))
SIDES = {-1: "right", 0: "center", 1: "left"}
HEIGHTS = {-1: "top", 0: "center", 1: "bottom"}


def _markers(axis):
    """The places of all markers of an axis, in pixels."""
    for line in axis.lines:
        if line.get_marker() not in ("None", "", " ", None):
            yield from axis.transData.transform(line.get_xydata())


def _along(axis, line, step):
    """Places along a polyline of data places, so many pixels apart."""
    import numpy as np

    pixels = axis.transData.transform(line) if len(line) else []
    for (x0, y0), (x1, y1) in itertools.pairwise(pixels):
        count = max(2, int(np.hypot(x1 - x0, y1 - y0) / step))
        yield from zip(np.linspace(x0, x1, count), np.linspace(y0, y1, count), strict=True)


def plain_ticks(axis):
    """Plain numbers along a logarithmic axis, at 1, 2 and 5 times powers of ten where these alone are few."""
    from matplotlib import ticker

    low, high = axis.get_view_interval()
    if high < 1000 * low:
        axis.set_major_locator(ticker.LogLocator(subs=(1, 2, 5)))
    # Long numbers would run into each other.
    long = high >= 2e5 or low <= 5e-6
    axis.set_major_formatter(ticker.LogFormatterMathtext() if long else ticker.FormatStrFormatter("%g"))
    axis.set_minor_formatter(ticker.NullFormatter())


def save(figure, request, kinds=("svg", "png")):
    """Write the figure to the file that the request names for each kind; return the names."""
    for kind in kinds:
        _save(figure, request[kind], kind, RESOLUTION, request.get("made_by"))
    return {kind: request[kind] for kind in kinds}


def _save(figure, path, kind, resolution, made_by=None):
    # Without the date equal figures are equal files.
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[kind]
    if made_by:
        metadata[{"svg": "Description", "pdf": "Subject", "png": "Description"}[kind]] = made_by
    with replaced_file(path, make_folder=True) as temporary:
        figure.savefig(temporary, format=kind, dpi=resolution or "figure", metadata=metadata)
