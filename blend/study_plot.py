"""Error against time of a study: one log-log panel per scene and density, with the front and its labels.

Request: `title`, `groups` (scene, density, runs as in results.json, front as ids, curves of unbiased
renderers), `svg`, `png` and `pdf` (files to write). A point is a run; colour and marker tell light models
apart. The line is the front: what no other run beats in time and error. Bars are standard errors from the
truth's noise. Errors that noise drove below 0 stand on the lower edge as triangles. A curve counts its
preparation, which every render pays; the dotted one beside it leaves it out.
"""

import math

import plots
import protocol

COLOURS = (plots.BLUE, plots.ORANGE, plots.GREEN, plots.PURPLE, plots.BLACK, "#56B4E9", "#E69F00")
MARKERS = "os^Dv<>"
COLUMNS = 2
LABELS = 6  # of a front: more would cover each other
CURVES = {
    "path": ("path tracing", "#882255", "P"),
    "cycles": ("Cycles", "#332288", "X"),
}  # label, colour, marker


def draw(request, messages):
    """Draw the figure and write it as SVG, PNG and PDF; return the names of the files."""
    return plots.save(_figure(request["title"], request["groups"]), request, ("svg", "png", "pdf"))


def _figure(title, groups):
    pyplot = plots.pyplot()
    if not groups:
        raise protocol.InputError("groups", "no runs", "a study with at least one run", "run the study")
    columns = min(COLUMNS, len(groups))
    rows = math.ceil(len(groups) / columns)
    figure, axes = pyplot.subplots(
        rows,
        columns,
        figsize=(1.1 * plots.WIDTH * columns, 2.9 * rows + 0.6),
        squeeze=False,
        layout="constrained",
    )
    lights = list(dict.fromkeys(run["combination"]["light"] for group in groups for run in group["runs"]))
    for index, group in enumerate(groups):
        _panel(axes[index // columns][index % columns], group, lights)
    for empty in axes.flat[len(groups) :]:
        empty.set_axis_off()
    handles = [
        pyplot.Line2D(
            [], [], color=_colour(lights, name), marker=_marker(lights, name), linestyle="none", label=name
        )
        for name in lights
    ]
    handles.append(pyplot.Line2D([], [], color="0.3", label="nothing is faster and closer"))
    drawn = {point["renderer"] for group in groups for point in group.get("curves", ())}
    for label, colour, marker in (CURVES[name] for name in CURVES if name in drawn):
        handles.append(pyplot.Line2D([], [], color=colour, marker=marker, markersize=4, label=label))
    if drawn:
        handles.append(pyplot.Line2D([], [], color="0.4", linestyle=":", label="without its preparation"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize=7)
    figure.suptitle(title, fontsize=9)
    return figure


def _panel(axis, group, lights):
    runs = group["runs"]
    positive = [error for run in runs if (error := run["errors"]["relmse"]["value"]) > 0]
    floor = 0.5 * min(positive, default=1e-6)
    axis.set_xscale("log")
    axis.set_yscale("log")
    for run in runs:
        light = run["combination"]["light"]
        time, found = run["seconds"]["median"] * 1e3, run["errors"]["relmse"]
        error = found["value"]
        if error <= 0:
            axis.plot(time, floor, marker="v", color=_colour(lights, light), markersize=4)
            continue
        low = min(found["standard_error"], 0.9 * error)
        axis.errorbar(
            time,
            error,
            yerr=[[low], [found["standard_error"]]],
            marker=_marker(lights, light),
            color=_colour(lights, light),
            markersize=3,
            elinewidth=0.5,
            linestyle="none",
            alpha=0.8,
        )
    _curves(axis, group.get("curves", ()), floor)
    front = [run for run in runs if run["id"] in group["front"]]
    front.sort(key=lambda run: run["seconds"]["median"])
    places = [(run["seconds"]["median"] * 1e3, max(run["errors"]["relmse"]["value"], floor)) for run in front]
    axis.plot([x for x, _ in places], [y for _, y in places], "-", color="0.3", linewidth=0.9, zorder=1)
    every = max(1, math.ceil(len(front) / LABELS))
    for run, (x, y) in list(zip(front, places, strict=True))[::every]:
        axis.annotate(
            _label(run["combination"]),
            (x, y),
            xytext=(-3, -8),
            textcoords="offset points",
            fontsize=5,
            ha="right",
        )
    # Room for labels on the left.
    left, right = axis.get_xlim()
    axis.set_xlim(left / (right / left) ** 0.25, right)
    plots.plain_ticks(axis.xaxis)
    plots.plain_ticks(axis.yaxis)
    axis.set_title(f"{group['density']} in {group['scene']}", fontsize=8)
    axis.set_xlabel("processor time of a picture, ms")
    axis.set_ylabel("relMSE against path tracing")
    axis.grid(True, which="major", linewidth=0.3, color="0.85")


def _curves(axis, points, floor):
    for name, (_, colour, marker) in CURVES.items():
        here = sorted(
            (point for point in points if point["renderer"] == name), key=lambda one: one["samples"]
        )
        errors = [max(point["errors"]["relmse"]["value"], floor) for point in here]
        times = [1e3 * point["seconds"] for point in here]
        whole = [1e3 * (point["seconds"] + point["prepare_seconds"]) for point in here]
        axis.plot(whole, errors, "-", color=colour, marker=marker, markersize=4, linewidth=0.9)
        axis.plot(times, errors, ":", color=colour, linewidth=0.9)
        for point, x, y in zip(here, whole, errors, strict=True):
            text = str(point["samples"])
            axis.annotate(text, (x, y), xytext=(4, 3), textcoords="offset points", fontsize=5)


def _label(combination):
    text = f"{combination['light']} {combination['steps']}/{combination['light_steps']}"
    if combination["cache"]["cells"]:
        text += f" c{combination['cache']['cells']}"
    if combination["sub_pixels"] > 1:
        text += f" x{combination['sub_pixels'] ** 2}"
    return text


def _colour(lights, name):
    return COLOURS[lights.index(name) % len(COLOURS)]


def _marker(lights, name):
    return MARKERS[lights.index(name) % len(MARKERS)]


if __name__ == "__main__":
    protocol.serve("study_plot.py", draw, needs_bpy=False)
