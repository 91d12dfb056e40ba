"""What all figures share: matplotlib with the same fonts and lines, colours, and files written whole.

Colours are those of Okabe and Ito, which differ for every kind of sight; figures use markers and dashes
besides, so that they survive print in grey.
"""

import os
import pathlib
import tempfile

import protocol

BLACK = "#000000"
BLUE = "#0072B2"
GREEN = "#009E73"
ORANGE = "#D55E00"
PURPLE = "#CC79A7"
WIDTH = 3.5  # inches of one panel: a column of a paper
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
        _save(figure, request[kind], kind, 200 if kind == "png" else None)
    return {kind: request[kind] for kind in kinds}


def _save(figure, path, kind, resolution):
    folder = os.path.dirname(os.path.abspath(path))
    temporary = None
    try:
        os.makedirs(folder, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".cloudparity-", suffix=f".{kind}", dir=folder)
        os.close(handle)
        # Without the date equal figures are equal files.
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
        figure.savefig(temporary, format=kind, dpi=resolution or "figure", metadata=metadata)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            pathlib.Path(temporary).unlink(missing_ok=True)
        raise protocol.InputError(
            path, error.strerror or str(error), "a writable file", "check the folder and the space"
        ) from None
