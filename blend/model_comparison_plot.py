"""Figures of density fields: histogram and power spectrum, as `cloudparity compare-models` measured them.

Request: `sides` (title and statistics of each), `svg`, `png` and `pdf` (files to write). Left: the density of
those places that hold something, over their mean; the legend says how many these are. Right: power of the
density over its mean, per wave number.
"""

import itertools

import plots
import protocol

# Bins run from 0 to this many means; one more holds what lies beyond.
HISTOGRAM_END = 6.0
STYLES = (
    (plots.BLUE, "-", "o"),
    (plots.ORANGE, "--", "s"),
    (plots.GREEN, "-.", "^"),
    (plots.PURPLE, ":", "d"),
    (plots.BLACK, "-", "x"),
)


def draw(request, messages):
    """Draw the figure and write it as SVG and PNG; return the names of the files."""
    return plots.save(
        _figure(request["sides"]), request, [kind for kind in ("svg", "png", "pdf") if kind in request]
    )


def _figure(sides):
    pyplot = plots.pyplot()
    figure, axes = pyplot.subplots(1, 2, figsize=(plots.TEXT_WIDTH, 2.9), layout="constrained")
    histogram, spectrum = axes
    for side, (colour, dash, marker) in zip(sides, itertools.cycle(STYLES), strict=False):
        found = side["statistics"]
        *shares, beyond = found["histogram"]
        width = HISTOGRAM_END / len(shares)
        label = f"{side['title']}: {100 * found['filled']:.1f} % of the places"
        if beyond > 0:
            label += f", {100 * beyond:.2g} % of these beyond {HISTOGRAM_END:g}"
        histogram.stairs(
            [share / width for share in shares],
            [width * index for index in range(len(shares) + 1)],
            color=colour,
            linestyle=dash,
            linewidth=1.0,
            label=label,
        )
        waves = range(1, len(found["spectrum"]) + 1)
        spectrum.plot(
            waves, found["spectrum"], dash, color=colour, marker=marker, markersize=2, label=side["title"]
        )
    histogram.set_yscale("log")
    histogram.set_xlim(0, HISTOGRAM_END)
    histogram.set_xlabel("density over its mean where it is above 0")
    histogram.set_ylabel("probability density")
    spectrum.set_xscale("log")
    spectrum.set_yscale("log")
    spectrum.set_xlabel("waves per side of the box")
    spectrum.set_ylabel("power per mode")
    for axis in (histogram, spectrum):
        axis.grid(True, which="major", linewidth=0.3, color="0.8")
        axis.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False)
    return figure


if __name__ == "__main__":
    protocol.serve("model_comparison_plot.py", plots.literally(draw), needs_bpy=False)
