"""Which stage of an engine makes its error: a waterfall of relMSE and a map per stage for each case.

Request: `title`, `cases` (scene, density: the engine's name, relmse and remainder with standard errors,
shares: name, relmse, map; compared: the engine's picture and the truth), `svg`, `png` and `pdf`. Maps hold
signed differences in scene-linear radiance; those of a case have one scale, said beside it, of the largest
that one pixel in a hundred exceeds in the whole difference.
"""

import textwrap

import matplotlib.colors
import numpy as np

import display_picture
import false_colour
import optimiser
import plots
import protocol

COLUMNS = 6  # of pictures


def draw(request, messages):
    """Draw the figure and write it as SVG, PNG and PDF; return the names of the files."""
    return plots.save(_figure(request), request, ("svg", "png", "pdf"))


def _figure(request):
    pyplot = plots.pyplot()
    cases = request["cases"]
    if not cases:
        raise protocol.InputError("cases", "no cases", "at least one", "run the attribution")
    first = optimiser.read_mean([cases[0]["compared"][1]])
    height = plots.TEXT_WIDTH / (COLUMNS + 1) * first.shape[0] / first.shape[1] + 0.3
    lines = [-(-(3 + len(case["shares"])) // COLUMNS) for case in cases]
    heights = [
        0.2 * (len(case["shares"]) + 2) + 0.75 + height * line
        for case, line in zip(cases, lines, strict=True)
    ]
    figure = pyplot.figure(figsize=(plots.TEXT_WIDTH, sum(heights) + 0.3), layout="constrained")
    parts = np.atleast_1d(figure.subfigures(len(cases), 1, height_ratios=heights))
    for part, case, line in zip(parts, cases, lines, strict=True):
        part.suptitle(f"{case['scene']}: {case['density']}", fontsize=8, x=0.01, ha="left")
        bars = 0.2 * (len(case["shares"]) + 2) + 0.65
        top, bottom = part.subfigures(2, 1, height_ratios=[bars, height * line])
        _waterfall(top.subplots(), case)
        _maps(bottom, bottom.subplots(line, COLUMNS, squeeze=False).ravel(), case)
    figure.suptitle(request["title"], fontsize=9)
    return figure


def _waterfall(axis, case):
    """From the engine's error to what is left: a bar per stage, those that make it worse to the right."""
    names, level = ["engine as it is"], case["relmse"]["value"]
    _bar(axis, 0, 0.0, case["relmse"], plots.BLACK)
    for share in case["shares"]:
        row = len(names)
        value = share["relmse"]["value"]
        axis.plot([level, level], [row - 1, row + 0.36], "-", color="0.6", linewidth=0.5)
        after = level - value
        _bar(axis, row, after, share["relmse"], plots.BLUE if value >= 0 else plots.ORANGE)
        whole = sum(abs(other["relmse"]["value"]) for other in case["shares"])
        if whole > 0:
            axis.annotate(
                f"{100 * value / whole:z.1f} %".replace("-", "\u2212"),
                (max(level, after + share["relmse"]["standard_error"]), row),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                fontsize=plots.SMALLEST,
            )
        level = after
        names.append(share["name"])
    _bar(axis, len(names), 0.0, case["remainder"], plots.BLACK)
    axis.plot([level, level], [len(names) - 1, len(names) + 0.36], "-", color="0.6", linewidth=0.5)
    names.append("all exact")
    axis.set_yticks(range(len(names)), names, fontsize=7)
    axis.invert_yaxis()
    axis.margins(x=0.08)
    axis.axvline(0, color="0.3", linewidth=0.6)
    axis.set_xlabel("relMSE; whiskers: one standard error", fontsize=7)
    axis.tick_params(axis="x", labelsize=7)
    axis.grid(True, axis="x", linewidth=0.3, color="0.85")
    axis.set_axisbelow(True)


def _bar(axis, row, start, figure, colour):
    value = figure["value"]
    axis.barh(row, value, left=start, height=0.72, color=colour)
    end = start if colour != plots.BLACK else value
    axis.errorbar(end, row, xerr=figure["standard_error"], color="0.45", linewidth=0.8, capsize=2)


def _maps(figure, axes, case):
    ours, truth = (optimiser.read_mean([path]) for path in case["compared"])
    whole = (ours - truth).mean(axis=2)
    largest = max(float(np.quantile(np.abs(whole), 0.99)), 1e-12)
    display = display_picture.Display("AgX", "None", 0.0, 1.0)
    shown = [display.apply(picture) for picture in (ours, truth)]
    for axis, picture, title in zip(axes, shown, ("engine", "path tracing"), strict=False):
        axis.imshow(picture, interpolation="nearest")
        axis.set_title(title, fontsize=plots.SMALLEST, pad=2)
    signed = [("difference", whole)]
    signed += [(share["name"], optimiser.read_mean([share["map"]]).mean(axis=2)) for share in case["shares"]]
    colours = matplotlib.colors.ListedColormap(false_colour.DIVERGING / 255.0)
    for axis, (title, values) in zip(axes[2:], signed, strict=False):
        image = axis.imshow(values, cmap=colours, vmin=-largest, vmax=largest, interpolation="nearest")
        axis.set_title(textwrap.fill(title, 14), fontsize=plots.SMALLEST, pad=2)
    for axis in axes:
        axis.set_axis_off()
    bar = figure.colorbar(image, ax=list(axes), shrink=0.8, aspect=25, pad=0.01)
    bar.ax.tick_params(labelsize=plots.SMALLEST)


if __name__ == "__main__":
    protocol.serve("attribution_plot.py", plots.literally(draw), needs_bpy=False)
