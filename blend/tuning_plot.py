"""Before and after a tuning: held-out views by path tracing, by the published light model, and tuned.

Request: `title`, `before` (name of the published light model), `views` (view, truth: replicas, before, after:
EXRs), `history` (least and median error of each generation), `objective`, `svg`, `png` and `pdf`. A row is a
view: the truth, both pictures through one display transform, and both HDR-FLIP maps on one scale. Below is
the search.
"""

import numpy as np

import optimiser
import picture_grid
import plots
import protocol

LARGEST_FLIP = 0.4  # of the maps' scale


def draw(request, messages):
    """Draw the figure and write it as SVG, PNG and PDF; return the names of the files."""
    return plots.save(_figure(request), request, ("svg", "png", "pdf"))


def _figure(request):
    pyplot = plots.pyplot()
    views = request["views"]
    if not views:
        raise protocol.InputError("views", "no views", "at least one held-out view", "run the tuning")
    first = optimiser.read_mean(views[0]["truth"])
    height = plots.TEXT_WIDTH / 5 * first.shape[0] / first.shape[1] + 0.25
    figure = pyplot.figure(figsize=(plots.TEXT_WIDTH, height * len(views) + 2.4), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[height * len(views) + 0.3, 2.0])
    grid = picture_grid.Grid(2, LARGEST_FLIP)
    axes = top.subplots(len(views), grid.columns, squeeze=False)
    for row, view in zip(axes, views, strict=True):
        pictures = [optimiser.read_mean([view[name]]) for name in ("before", "after")]
        grid.fill(row, optimiser.read_mean(view["truth"]), pictures)
        row[0].set_xlabel(view["view"], fontsize=6, labelpad=1)
    titles = ("path tracing", f"{request['before']}, exposed", "tuned", "HDR-FLIP before", "HDR-FLIP after")
    for axis, title in zip(axes[0], titles, strict=True):
        axis.set_title(title, fontsize=7)
    top.colorbar(grid.image, ax=axes[:, 3:], shrink=0.5, aspect=30, pad=0.01).ax.tick_params(labelsize=6)
    _search(bottom.subplots(), request)
    figure.suptitle(request["title"], fontsize=9)
    return figure


def _search(axis, request):
    history = np.array(request["history"], float)
    generations = np.arange(1, len(history) + 1)
    name = {"flip": "HDR-FLIP", "relmse": "relMSE"}[request["objective"]]
    axis.plot(generations, np.minimum.accumulate(history[:, 0]), "-", color=plots.BLUE, label="least so far")
    axis.plot(generations, history[:, 1], ".", color=plots.ORANGE, label="median of a generation")
    axis.set_xlabel("generation")
    axis.set_ylabel(f"mean {name}, training views")
    axis.grid(True, linewidth=0.3, color="0.85")
    axis.legend(frameon=False, fontsize=7)


if __name__ == "__main__":
    protocol.serve("tuning_plot.py", plots.literally(draw), needs_bpy=False)
