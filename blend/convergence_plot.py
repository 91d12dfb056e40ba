"""Log-log plots of what `cloudparity convergence` measured: error against steps, bias against cache size.

Request: `convergence` (the document), `svg` and `png` (files to write). Above: over the steps, root relMSE
and relative RMS, and the magnitude of the relative mean error, with the fitted orders as lines over the
points that they were fitted to, and triangles of slope 1 and 2. Below, where caches were measured: relative
RMS (relMSE is ruled by the dark pixels around a medium, into which coarse caches leak) and the magnitude of
the relative mean error over the cells, every format and filter; formats stand a little apart, because they
often agree.
"""

import math

import plots
import protocol

COLOURS = {
    "energy-conserving": plots.BLUE,
    "plain": plots.ORANGE,
    "f32": plots.BLACK,
    "f16": plots.GREEN,
    "unorm8": plots.PURPLE,
}
MARKERS = {"energy-conserving": "o", "plain": "s", "f32": "o", "f16": "s", "unorm8": "^"}
WORDS = {
    "root_relmse": "√relMSE",
    "relative_rms": "relative RMS",
    "relative_mean_error": "|relative mean error|",
}
HEIGHT = 3.1
INTEGRATIONS = ("energy-conserving", "plain")
# Factors on the cells at which a format is drawn.
APART = {"f32": 0.95, "f16": 1.0, "unorm8": 1.05}


def draw(request, messages):
    """Draw the figure and write it as SVG and PNG; return the names of the files."""
    return plots.save(_figure(request["convergence"]), request)


def _figure(document):
    pyplot = plots.pyplot()
    rows = 2 if document["caches"] else 1
    figure, axes = pyplot.subplots(
        rows, 2, figsize=(plots.TEXT_WIDTH, HEIGHT * rows), squeeze=False, layout="constrained"
    )
    width, height = document["resolution"]
    figure.suptitle(
        f"{document['scene']}, {width} x {height} pixels; reference: {document['reference_steps']} steps, "
        "energy-conserving",
        fontsize=8,
    )
    _steps_panel(axes[0][0], document, ("root_relmse", "relative_rms"))
    _steps_panel(axes[0][1], document, ("relative_mean_error",))
    if rows == 2:
        _cache_panel(axes[1][0], document, "relative_rms")
        _cache_panel(axes[1][1], document, "relative_mean_error")
    return figure


def _steps_panel(axis, document, figures):
    for integration in INTEGRATIONS:
        points = [point for point in document["points"] if point["integration"] == integration]
        steps = [point["steps"] for point in points]
        colour = COLOURS[integration]
        for figure, face, dash in zip(figures, (colour, "white"), ("-", "--"), strict=False):
            order = _order(document, integration, figure)
            label = f"{integration}, {WORDS[figure]}" + (f": order {order['order']:.2f}" if order else "")
            if order and not order["asymptotic"]:
                label += " (no power law)"
            axis.plot(
                steps,
                [_drawn(point[figure]) for point in points],
                MARKERS[integration],
                color=colour,
                markerfacecolor=face,
                linestyle="none",
                label=label,
            )
            if order:
                ends = [order["fitted_steps"][0], order["fitted_steps"][-1]]
                errors = [order["factor"] * end ** -order["order"] for end in ends]
                axis.plot(ends, errors, dash, color=colour)
    drawn = _logarithmic(axis)
    axis.set_xlabel(f"view steps per {document['mean_side']:.3g} m (mean side of the medium)")
    axis.set_ylabel(" or ".join(WORDS[figure] for figure in figures) + " (no unit)")
    _whole_numbers(axis, sorted({point["steps"] for point in document["points"]}))
    if drawn:
        _triangles(axis)
    axis.grid(True, which="major", linewidth=0.3, color="0.8")
    axis.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False)


def _logarithmic(axis):
    """Logarithmic axes; False, with a word in the panel, where no error is above 0."""
    axis.set_xscale("log", base=2)
    drawn = any(not math.isnan(value) for line in axis.lines for value in line.get_ydata())
    if drawn:
        axis.set_yscale("log")
    else:
        axis.set_yticks([])
        axis.text(0.5, 0.5, "every error is 0", transform=axis.transAxes, ha="center", fontsize=8)
    return drawn


def _drawn(error):
    """The magnitude; none of an error of 0, which logarithms do not show."""
    return abs(error) or math.nan


def _order(document, integration, figure):
    for order in document["orders"]:
        if order["integration"] == integration and order["figure"] == figure:
            return order
    return None


def _triangles(axis):
    """Slopes 1 and 2 as triangles one doubling wide, below the points."""
    left, right = (math.log2(end) for end in axis.get_xlim())
    low, high = (math.log10(end) for end in axis.get_ylim())
    # Room for the higher one.
    low -= max(0.3 * (high - low), 0.9)
    axis.set_ylim(10**low, 10**high)
    for order, start in ((1, 0.05), (2, 0.5)):
        begin = left + start * (right - left)
        bottom = low + 0.06 * (high - low)
        top = bottom + order * math.log10(2)
        xs = [2**begin, 2 ** (begin + 1), 2**begin, 2**begin]
        axis.plot(xs, [10**top, 10**bottom, 10**bottom, 10**top], color="0.4", linewidth=0.7)
        axis.text(2 ** (begin + 1.1), 10**bottom, f"slope -{order}", fontsize=6, color="0.3")


def _cache_panel(axis, document, figure):
    for name, apart in APART.items():
        for filter_name, face, dash in (("nearest", "white", "--"), ("trilinear", COLOURS[name], "-")):
            wanted = {"format": name, "filter": filter_name}
            points = [
                (point["cache"]["settings"]["cells"], point[figure])
                for point in document["caches"]
                if wanted.items() <= point["cache"]["settings"].items()
            ]
            axis.plot(
                [apart * cells for cells, _ in points],
                [_drawn(error) for _, error in points],
                dash,
                marker=MARKERS[name],
                color=COLOURS[name],
                markerfacecolor=face,
                label=f"{name}, {filter_name}",
            )
    _logarithmic(axis)
    axis.set_xlabel("density cache: cells along the longest side")
    axis.set_ylabel(f"{WORDS[figure]} (no unit)")
    _whole_numbers(axis, sorted({point["cache"]["settings"]["cells"] for point in document["caches"]}))
    axis.grid(True, which="major", linewidth=0.3, color="0.8")
    axis.set_title(f"against no cache, both with {document['cache_steps']} steps", fontsize=7)
    axis.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False, ncols=3)


def _whole_numbers(axis, values):
    """Ticks at these numbers along x, and enough of them along y."""
    from matplotlib import ticker

    axis.set_xticks(values, [str(value) for value in values])
    axis.xaxis.set_minor_locator(ticker.NullLocator())
    low, high = axis.get_ylim()
    # Powers of ten alone would leave less than two labels.
    if axis.get_yscale() == "log" and high < 100 * low:
        plots.plain_ticks(axis.yaxis)


if __name__ == "__main__":
    protocol.serve("convergence_plot.py", plots.literally(draw), needs_bpy=False)
