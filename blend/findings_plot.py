"""Figures of findings about Cycles, one for each finding, as SVG, PNG and PDF in a folder.

Request: {"findings": [as in findings.json], "folder": DIR, "plain_names": BOOL, "formats": [svg, png, pdf:
all if left out]}; names have the release unless they are plain. The finding `order` has the means of single
samples of two seeds, and the spread of replicas by seed and by subset; every other one has its figures
against what was claimed of them.
"""

from pathlib import Path

import numpy as np

import plots
import protocol

# Findings whose figures are shown over the truth.
RELATIVE = ("expectation", "marching", "grids", "lobes", "majorants")
FORMATS = ("svg", "png", "pdf")


def draw(request, messages):
    """Draw them and return the names of the files."""
    names = []
    for finding in request["findings"]:
        figure = (_order if finding["name"] == "order" else _claims)(finding)
        release = "" if request.get("plain_names") else f"-{finding['blender'].split()[0]}"
        stem = Path(request["folder"]) / f"{finding['name']}{release}"
        if figure is None:
            continue
        files = {kind: f"{stem}.{kind}" for kind in request.get("formats", FORMATS)}
        names += plots.save(figure, files, tuple(files)).values()
    return names


def _means(measured):
    return np.array([replica["mean"] for replica in measured["replicas"]])


def _order(finding):
    """Single samples of two seeds, one over the other, and what the two ways of making replicas show."""
    first, second, by_seed, by_subset = map(_means, finding["measured"])
    truth = np.exp(-4.0)
    figure, (left, right) = plots.pyplot().subplots(
        1, 2, figsize=(plots.TEXT_WIDTH, 2.4), layout="constrained", width_ratios=(2, 1)
    )
    offsets = np.arange(len(first))
    left.plot(offsets, first, "o", color=plots.BLUE, markersize=3.5, fillstyle="none", label="seed 1")
    left.plot(offsets, second, "x", color=plots.ORANGE, markersize=3, label="seed 2")
    left.axhline(truth, color=plots.BLACK, linewidth=0.7, linestyle="--", label="truth")
    left.set_xlabel("number of the sample")
    left.set_ylabel("mean of the picture of that sample")
    left.legend(fontsize=plots.SMALLEST, loc="upper right")
    jitter = np.linspace(-0.2, 0.2, len(by_seed))
    right.plot(jitter, by_seed, "o", color=plots.BLUE, markersize=3)
    right.plot(1 + np.linspace(-0.2, 0.2, len(by_subset)), by_subset, "s", color=plots.GREEN, markersize=3)
    right.axhline(truth, color=plots.BLACK, linewidth=0.7, linestyle="--")
    right.set_xticks((0, 1), ("by seed", "by subset"))
    right.set_xlim(-0.5, 1.5)
    right.set_ylabel("mean of 256 samples")
    return figure


def _claims(finding):
    """Figures that have an expected value, over it, with the truth beside; others are in the table alone."""
    rows = [row for row in finding["rows"] if _expected(row) is not None]
    if finding["name"] == "learning":
        # One scale: what is lost; that nothing is lost by one sample is in the table.
        rows = [row for row in rows if "equals" not in row["claim"]]
    relative = finding["name"] in RELATIVE
    if not rows:
        # What is only reported is in the table.
        return None
    height = 0.24 * len(rows) + 0.75
    figure, axis = plots.pyplot().subplots(figsize=(plots.TEXT_WIDTH, height), layout="constrained")
    for place, row in enumerate(rows):
        scale = 1.0 / row["truth"] if relative else 1.0
        value, error = scale * row["value"]["value"], scale * row["value"]["standard_error"]
        axis.errorbar(
            value, -place, xerr=2 * error, fmt="o", color=plots.BLUE, markersize=3.5, capsize=2, linewidth=0.8
        )
        if "equals" in row["claim"]:
            axis.plot(
                scale * row["claim"]["equals"],
                -place,
                "|",
                color=plots.ORANGE,
                markersize=11,
                markeredgewidth=1.4,
            )
        if row["truth"] is not None:
            axis.plot(scale * row["truth"], -place, "D", color=plots.BLACK, markersize=3, fillstyle="none")
    axis.plot([], [], "o", color=plots.BLUE, markersize=3.5, label="Cycles, two standard errors")
    axis.plot(
        [], [], "|", color=plots.ORANGE, markersize=11, markeredgewidth=1.4, linestyle="", label="closed form"
    )
    axis.plot([], [], "D", color=plots.BLACK, markersize=3, fillstyle="none", linestyle="", label="truth")
    axis.set_yticks(
        [-place for place in range(len(rows))], [row["name"] for row in rows], fontsize=plots.SMALLEST
    )
    axis.set_ylim(-len(rows) + 0.5, 0.5)
    if relative:
        axis.set_xlabel("over what light transport says")
    elif finding["name"] == "learning":
        axis.set_xlabel("samples")
        axis.set_xlim(left=-0.005)
    else:
        axis.set_xlabel("mean cosine")
    axis.legend(
        fontsize=plots.SMALLEST, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, frameon=False
    )
    return figure


def _expected(row):
    """The number of a claim; none where nothing is claimed."""
    claim = row["claim"]
    return None if claim == "reported" else next(iter(claim.values()))


if __name__ == "__main__":
    protocol.serve("findings_plot.py", plots.literally(draw), needs_bpy=False)
