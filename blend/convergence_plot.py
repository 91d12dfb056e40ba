"""Log-log plots of what `cloudparity convergence` measured: error against steps, bias against cache size.

Request: `convergence` (the document), `svg` and `png` (files to write). Left: root relMSE and magnitude of
the relative mean error over steps, with the fitted orders as lines over the points that they were fitted to,
and triangles of slope 1 and 2. Right, where caches were measured: root relMSE over the cells, every format
and filter. Colours are those of Okabe and Ito, which differ for every kind of sight; markers and dashes
differ too, so that the figure survives print in grey.
"""

import os
import pathlib
import tempfile

import protocol

COLOURS = {
    "energy-conserving": "#0072B2",
    "plain": "#D55E00",
    "f32": "#000000",
    "f16": "#009E73",
    "unorm8": "#CC79A7",
}
MARKERS = {"energy-conserving": "o", "plain": "s", "f32": "o", "f16": "x", "unorm8": "^"}
WIDTH = 3.5  # inches of one panel: a column of a paper
HEIGHT = 3.3
INTEGRATIONS = ("energy-conserving", "plain")


def draw(request, messages):
    """Draw the figure and write it as SVG and PNG; return the names of the files."""
    figure = _figure(request["convergence"])
    for name, resolution in (("svg", None), ("png", 200)):
        _save(figure, request[name], name, resolution)
    return {"svg": request["svg"], "png": request["png"]}


def _figure(document):
    try:
        import matplotlib
    except ImportError as error:
        raise protocol.InputError(
            "Python package matplotlib", str(error), "the plots' library", "run `make setup`"
        ) from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as pyplot

    pyplot.rcParams.update(
        {
            "font.size": 8,
            "font.family": "DejaVu Sans",
            "axes.linewidth": 0.6,
            "lines.linewidth": 1.0,
            "lines.markersize": 4,
            "svg.hashsalt": "cloudparity",
        }
    )
    panels = 2 if document["caches"] else 1
    figure, axes = pyplot.subplots(
        1, panels, figsize=(WIDTH * panels, HEIGHT), squeeze=False, layout="constrained"
    )
    width, height = document["resolution"]
    figure.suptitle(f"{document['scene']}, {width} x {height} pixels", fontsize=8)
    _steps_panel(axes[0][0], document)
    if panels == 2:
        _cache_panel(axes[0][1], document)
    return figure


def _steps_panel(axis, document):
    for integration in INTEGRATIONS:
        points = [point for point in document["points"] if point["integration"] == integration]
        steps = [point["steps"] for point in points]
        for figure, face, dash, words in (
            ("root_relmse", None, "-", "√relMSE"),
            ("relative_mean_error", "white", "--", "|relative mean error|"),
        ):
            errors = [abs(point[figure]) or float("nan") for point in points]
            colour = COLOURS[integration]
            order = _order(document, integration, figure)
            label = f"{integration}, {words}" + (f": order {order['order']:.2f}" if order else "")
            if order and not order["asymptotic"]:
                label += " (no power law)"
            axis.plot(
                steps,
                errors,
                MARKERS[integration],
                color=colour,
                markerfacecolor=face or colour,
                linestyle="none",
                label=label,
            )
            if order:
                ends = [order["fitted_steps"][0], order["fitted_steps"][-1]]
                axis.plot(
                    ends, [order["factor"] * end ** -order["order"] for end in ends], dash, color=colour
                )
    axis.set_xscale("log", base=2)
    axis.set_yscale("log")
    axis.set_xlabel(f"view steps per {document['mean_side']:.3g} m (mean side of the medium)")
    axis.set_ylabel("error relative to the reference (no unit)")
    _whole_numbers(axis, sorted({point["steps"] for point in document["points"]}))
    _triangles(axis)
    axis.grid(True, which="major", linewidth=0.3, color="0.8")
    axis.set_title(f"reference: {document['reference_steps']} steps, energy-conserving", fontsize=7)
    axis.legend(fontsize=5.5, loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False)


def _order(document, integration, figure):
    for order in document["orders"]:
        if order["integration"] == integration and order["figure"] == figure:
            return order
    return None


def _triangles(axis):
    """Slopes 1 and 2 as triangles in the lower left corner, in units of the axes' own scales."""
    import math

    left, right = (math.log2(end) for end in axis.get_xlim())
    low, high = (math.log10(end) for end in axis.get_ylim())
    # Room below the points.
    low -= 0.35 * (high - low)
    axis.set_ylim(10**low, 10**high)
    for order, start in ((1, 0.05), (2, 0.25)):
        begin = left + start * (right - left)
        end = begin + 1.0
        bottom = low + 0.06 * (high - low)
        top = bottom + order * math.log10(2)
        xs = [2**begin, 2**end, 2**begin, 2**begin]
        ys = [10**top, 10**bottom, 10**bottom, 10**top]
        axis.plot(xs, ys, color="0.4", linewidth=0.7)
        axis.text(2**end * 1.05, 10 ** ((top + bottom) / 2), f"slope -{order}", fontsize=5.5, color="0.3")


def _cache_panel(axis, document):
    formats = ("f32", "f16", "unorm8")
    for name in formats:
        for filter_name, face, dash in (("nearest", "white", "--"), ("trilinear", None, "-")):
            points = [
                point
                for point in document["caches"]
                if point["cache"]["settings"]["format"] == name
                and point["cache"]["settings"]["filter"] == filter_name
            ]
            axis.plot(
                [point["cache"]["settings"]["cells"] for point in points],
                [point["root_relmse"] or float("nan") for point in points],
                dash,
                marker=MARKERS[name],
                color=COLOURS[name],
                markerfacecolor=face or COLOURS[name],
                label=f"{name}, {filter_name}",
            )
    axis.set_xscale("log", base=2)
    axis.set_yscale("log")
    axis.set_xlabel("density cache: cells along the longest side")
    axis.set_ylabel("√relMSE against no cache (no unit)")
    _whole_numbers(axis, sorted({point["cache"]["settings"]["cells"] for point in document["caches"]}))
    axis.grid(True, which="major", linewidth=0.3, color="0.8")
    axis.set_title(f"both sides: {document['cache_steps']} steps, energy-conserving", fontsize=7)
    axis.legend(fontsize=5.5, loc="upper center", bbox_to_anchor=(0.5, -0.2), frameon=False, ncols=3)


def _whole_numbers(axis, values):
    axis.set_xticks(values, [str(value) for value in values])
    axis.minorticks_off()


def _save(figure, path, kind, resolution):
    folder = os.path.dirname(os.path.abspath(path))
    temporary = None
    try:
        os.makedirs(folder, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".cloudparity-", suffix=f".{kind}", dir=folder)
        os.close(handle)
        # Without the date equal figures are equal files.
        metadata = {"Date": None} if kind == "svg" else None
        figure.savefig(temporary, format=kind, dpi=resolution or "figure", metadata=metadata)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        if temporary:
            pathlib.Path(temporary).unlink(missing_ok=True)
        raise protocol.InputError(
            path, error.strerror or str(error), "a writable file", "check the folder and the space"
        ) from None


if __name__ == "__main__":
    protocol.serve("convergence_plot.py", draw, needs_bpy=False)
