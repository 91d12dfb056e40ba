"""Time and memory of path tracing against what grows, a panel per quantity, both axes logarithmic.

Request: `title`, `ladders` (name, rows: value, median with preparation, paths, memory), `svg`, `png` and
`pdf`. A value of 0 has no place on a logarithmic axis and is left out. Grey lines rise by the first power.
"""

import numpy as np

import plots
import protocol

COLUMNS = 3


def draw(request, messages):
    """Draw the figure and write it as SVG, PNG and PDF; return the names of the files."""
    return plots.save(_figure(request), request, ("svg", "png", "pdf"))


def _figure(request):
    pyplot = plots.pyplot()
    ladders = request["ladders"]
    if not ladders:
        raise protocol.InputError("ladders", "no ladders", "at least one", "measure one")
    lines = -(-len(ladders) // COLUMNS)
    figure, axes = pyplot.subplots(
        lines, COLUMNS, figsize=(plots.TEXT_WIDTH, 2.1 * lines + 0.5), layout="constrained", squeeze=False
    )
    for axis in axes.ravel()[len(ladders) :]:
        axis.set_axis_off()
    for axis, ladder in zip(axes.ravel(), ladders, strict=False):
        _panel(axis, ladder)
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=len(names), frameon=False, fontsize=7)
    figure.suptitle(request["title"], fontsize=9)
    return figure


def _panel(axis, ladder):
    rows = [row for row in ladder["rows"] if row["value"] > 0]
    values = np.array([row["value"] for row in rows], float)
    memory = [row["median"]["memory"] or np.nan for row in rows]
    figures = (
        ("preparation, s", [row["median"]["preparation"] for row in rows], "s", plots.ORANGE),
        ("paths, s", [row["median"]["paths"] for row in rows], "o", plots.BLUE),
        ("memory, GiB", np.array(memory, float) / 2**30, "^", plots.GREEN),
    )
    for name, ordinates, marker, color in figures:
        # What takes no time at all has no place here either.
        ordinates = np.maximum(np.array(ordinates, float), 1e-4)
        axis.loglog(values, ordinates, marker=marker, color=color, markersize=3, linewidth=1, label=name)
    low, high = axis.get_ylim()
    for start in 10.0 ** np.arange(np.floor(np.log10(low)) - 6, np.log10(high) + 1):
        axis.loglog(values, start * values / values[0], color="0.88", linewidth=0.5, zorder=0)
    axis.set_ylim(low, high)
    # The rungs themselves, where there is room for their numbers.
    shown, least = [], 0.14 * np.log(values[-1] / values[0])
    for value in values:
        if not shown or np.log(value / shown[-1]) >= least:
            shown.append(value)
    axis.set_xticks(shown, [f"{value:g}" for value in shown])
    axis.set_xticks([], minor=True)
    axis.set_xlabel(ladder["name"], fontsize=7)
    axis.tick_params(which="both", labelsize=6)


if __name__ == "__main__":
    protocol.serve("growth_plot.py", plots.literally(draw), needs_bpy=False)
