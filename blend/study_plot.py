"""Figures of a study: error against time, convergence by steps, and pictures beside the truth.

Request: `title`, `clock` (what seconds are), `groups` (scene, density, runs as in results.json, front as
ids, curves of unbiased renderers, truth: files of its replicas), `folder` (that pictures are relative to),
and `figures`: for each of `time`, `convergence` and `pictures` the files `svg`, `png` and `pdf`.

`time`: a log-log panel per group. A point is a run; colour and marker tell light models apart. The line is
the Pareto front: what no other run beats in time and error. Bars are standard errors from the truth's noise.
Errors that noise drove below 0 stand on the lower edge as triangles. A curve counts its preparation, which
every render pays; the dotted one beside it leaves it out, where the samples have a time of their own.

`convergence`: error by steps of the view ray, a line per light model, at the most light steps (solid) and
the fewest (dotted), other settings at their first value: where a line is level, steps are not what is wrong.

`pictures`: per group the truth and three runs of the Pareto front (fastest, least time x relMSE, closest),
below them the window where the closest one errs most, and their HDR-FLIP maps. Panels fill the width of the
text: with 525 pixels across or more they are printed at 300 dots per inch.
"""

import math
import textwrap

import optimiser
import picture_grid
import plots
import protocol

COLOURS = (plots.BLUE, plots.ORANGE, plots.GREEN, plots.PURPLE, plots.BLACK, "#56B4E9", "#E69F00")
MARKERS = "os^Dv<>"
COLUMNS = 2
SHOWN = 3  # runs of a group whose pictures are shown
LARGEST_FLIP = 0.8  # of the maps' scale: the fastest runs are far off
CURVES = {
    "path": ("path tracing", "#882255", "P"),
    "cycles": ("Cycles", "#332288", "X"),
}  # label, colour, marker


def draw(request, messages):
    """Draw the figures and write each as SVG, PNG and PDF; return the names of the files."""
    groups = request["groups"]
    if not groups:
        raise protocol.InputError("groups", "no runs", "a study with at least one run", "run the study")
    makers = {
        "time": lambda: _figure(request["title"], groups, request["clock"]),
        "convergence": lambda: _convergence(request["title"], groups),
        "pictures": lambda: _pictures(request["title"], groups, request["folder"]),
    }
    kinds = ("svg", "png", "pdf")
    made_by = {"made_by": request.get("made_by")}
    return {
        name: plots.save(makers[name](), {**files, **made_by}, kinds)
        for name, files in request["figures"].items()
    }


def _figure(title, groups, clock):
    figure, axes, lights = _panels(groups)
    pyplot = plots.pyplot()
    # Of the axis, on the left for labels.
    room = 0.35 if len(groups) > 1 else 0.4
    labelled = [_panel(axis, group, lights, clock, room) for axis, group in zip(axes, groups, strict=True)]
    handles = _light_handles(lights)
    handles.append(pyplot.Line2D([], [], color="0.3", label="nothing is faster and closer"))
    drawn = {point["renderer"] for group in groups for point in group.get("curves", ())}
    for label, colour, marker in (CURVES[name] for name in CURVES if name in drawn):
        handles.append(pyplot.Line2D([], [], color=colour, marker=marker, markersize=4, label=label))
    if drawn:
        handles.append(pyplot.Line2D([], [], color="0.4", linestyle=":", label="without its preparation"))
    _legend(figure, handles, groups)
    _title(figure, title, groups)
    # Where labels are free is known when all else has its place, at the resolution of the file.
    figure.set_dpi(plots.RESOLUTION)
    figure.canvas.draw()
    figure.set_layout_engine("none")
    for axis, (labels, lines) in zip(axes, labelled, strict=True):
        plots.label_points(axis, labels, lines)
    return figure


def _title(figure, title, groups):
    """A heading that breaks its lines where a figure of one column is too narrow."""
    letters = 90 if len(groups) > 1 else 44
    figure.suptitle("\n".join(textwrap.wrap(title, letters)), fontsize=8)


def _legend(figure, handles, groups):
    # As wide as the panels above it.
    columns = 5 if len(groups) > 1 else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=7)


def _panels(groups):
    """A figure with a panel for each group, the panels, and the light models in their order."""
    pyplot = plots.pyplot()
    columns = min(COLUMNS, len(groups))
    rows = math.ceil(len(groups) / columns)
    figure, axes = pyplot.subplots(
        rows,
        columns,
        figsize=(plots.TEXT_WIDTH if columns > 1 else plots.WIDTH, 2.6 * rows + 0.6),
        squeeze=False,
        layout="constrained",
    )
    for empty in axes.flat[len(groups) :]:
        empty.set_axis_off()
    lights = list(dict.fromkeys(run["combination"]["light"] for group in groups for run in group["runs"]))
    return figure, list(axes.flat[: len(groups)]), lights


def _light_handles(lights):
    pyplot = plots.pyplot()
    return [
        pyplot.Line2D(
            [], [], color=_colour(lights, name), marker=_marker(lights, name), linestyle="none", label=name
        )
        for name in lights
    ]


def _convergence(title, groups):
    pyplot = plots.pyplot()
    figure, axes, lights = _panels(groups)
    for axis, group in zip(axes, groups, strict=True):
        axis.set_xscale("log")
        axis.set_yscale("log")
        first = group["runs"][0]["combination"]
        alike = {name: first[name] for name in ("cache", "sub_pixels", "jitter")}
        runs = [run for run in group["runs"] if alike.items() <= run["combination"].items()]
        numbers = {run["combination"]["light_steps"] for run in runs}
        for light in lights:
            for light_steps, style in {min(numbers): ":", max(numbers): "-"}.items():
                here = [
                    (run["combination"]["steps"], run["errors"]["relmse"])
                    for run in runs
                    if run["combination"]["light"] == light
                    and run["combination"]["light_steps"] == light_steps
                ]
                here = sorted((pair for pair in here if pair[1]["value"] > 0), key=lambda pair: pair[0])
                axis.errorbar(
                    [steps for steps, _ in here],
                    [error["value"] for _, error in here],
                    yerr=[min(error["standard_error"], 0.9 * error["value"]) for _, error in here],
                    linestyle=style,
                    color=_colour(lights, light),
                    marker=_marker(lights, light),
                    markersize=3,
                    elinewidth=0.5,
                )
        steps = sorted({run["combination"]["steps"] for run in runs})
        axis.set_xticks(steps, [str(number) for number in steps])
        axis.minorticks_off()
        plots.plain_ticks(axis.yaxis)
        axis.set_title(_name(group), fontsize=8)
        axis.set_xlabel("steps of a view ray")
        axis.set_ylabel("relMSE against path tracing")
        axis.grid(True, which="major", linewidth=0.3, color="0.85")
    handles = _light_handles(lights)
    handles.append(pyplot.Line2D([], [], color="0.3", linestyle="-", label="most light steps"))
    handles.append(pyplot.Line2D([], [], color="0.3", linestyle=":", label="fewest light steps"))
    _legend(figure, handles, groups)
    _title(figure, f"{title}: convergence", groups)
    return figure


def _pictures(title, groups, folder):
    pyplot = plots.pyplot()
    grid = picture_grid.Grid(SHOWN, LARGEST_FLIP)
    shown = [
        (
            group,
            optimiser.read_mean([f"{folder}/{name}" for name in group["truth"]]),
            _shown(group),
        )
        for group in groups
    ]
    # A row each for the pictures, their windows and their maps: panels as large as the text allows.
    columns = 1 + SHOWN
    aspect = shown[0][1].shape[0] / shown[0][1].shape[1]
    panel = plots.TEXT_WIDTH / columns * aspect
    height = (3 * panel + 0.55) * len(shown) + 0.35
    figure = pyplot.figure(figsize=(plots.TEXT_WIDTH, height), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.01, w_pad=0.01, hspace=0, wspace=0)
    axes = figure.subplots(3 * len(shown), columns, squeeze=False)
    names = ("fastest", "least time x relMSE", "closest")
    for number, (group, truth, runs) in enumerate(shown):
        pictures = [optimiser.read_mean([f"{folder}/{run['picture']}"]) for run in runs]
        whole, windows, maps = (axes[3 * number + row] for row in range(3))
        grid.fill([*whole, *maps[1:]], truth, pictures, windows)
        lines, width = truth.shape[:2]
        whole[0].set_title(f"{_name(group)}: path tracing", fontsize=plots.SMALLEST)
        whole[0].set_xlabel(f"{width} x {lines} pixels", fontsize=plots.SMALLEST, labelpad=1)
        for axis, name, run in zip(whole[1:], names, runs, strict=True):
            milliseconds = 1e3 * run["seconds"]["median"]
            axis.set_title(name, fontsize=plots.SMALLEST)
            text = f"{_label(run['combination'])}, {milliseconds:.3g} ms"
            axis.set_xlabel(text, fontsize=plots.SMALLEST, labelpad=1)
        # Under the truth, which has no map.
        maps[0].set_axis_off()
        bar = figure.colorbar(
            grid.image, cax=maps[0].inset_axes((0.08, 0.55, 0.84, 0.12)), orientation="horizontal"
        )
        bar.set_label("HDR-FLIP", fontsize=plots.SMALLEST)
        bar.ax.tick_params(labelsize=plots.SMALLEST)
    figure.suptitle("\n".join(textwrap.wrap(f"{title}: pictures of the Pareto front", 90)), fontsize=8)
    return figure


def _shown(group):
    """The fastest, the cheapest per unit of error, and the closest run of a group's front."""
    front = [run for run in group["runs"] if run["id"] in group["front"]]
    return [
        min(front, key=lambda run: run["seconds"]["median"]),
        min(front, key=lambda run: run["seconds"]["median"] * max(run["errors"]["relmse"]["value"], 0.0)),
        min(front, key=lambda run: run["errors"]["relmse"]["value"]),
    ]


def _panel(axis, group, lights, clock, room):
    runs = group["runs"]
    measured = (*runs, *group.get("curves", ()))
    positive = [error for one in measured if (error := one["errors"]["relmse"]["value"]) > 0]
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
    samples, drawn = _curves(axis, group.get("curves", ()), floor)
    front = [run for run in runs if run["id"] in group["front"]]
    front.sort(key=lambda run: run["seconds"]["median"])
    places = [(run["seconds"]["median"] * 1e3, max(run["errors"]["relmse"]["value"], floor)) for run in front]
    axis.plot([x for x, _ in places], [y for _, y in places], "-", color="0.3", linewidth=0.9, zorder=1)
    # The ends of the front first: what is left out, where there is no room, lies between.
    order = [0, len(front) - 1, *range(1, len(front) - 1)] if len(front) > 1 else range(len(front))
    labels = [(_label(front[index]["combination"]), *places[index]) for index in order]
    # Room for labels on the left.
    left, right = axis.get_xlim()
    axis.set_xlim(left / (right / left) ** room, right)
    plots.plain_ticks(axis.xaxis)
    plots.plain_ticks(axis.yaxis)
    axis.set_title(_name(group), fontsize=8)
    axis.set_xlabel(f"{clock}, ms a picture")
    axis.set_ylabel("relMSE against path tracing")
    axis.grid(True, which="major", linewidth=0.3, color="0.85")
    return samples + labels, [places, *drawn]


def _curves(axis, points, floor):
    """Draw the curves; return the labels of their points, and their lines."""
    labels, lines = [], []
    for name, (_, colour, marker) in CURVES.items():
        here = sorted(
            (point for point in points if point["renderer"] == name), key=lambda one: one["samples"]
        )
        errors = [max(point["errors"]["relmse"]["value"], floor) for point in here]
        whole = [1e3 * ((point["seconds"] or 0.0) + point["prepare_seconds"]) for point in here]
        axis.plot(whole, errors, "-", color=colour, marker=marker, markersize=4, linewidth=0.9)
        if all(point["seconds"] for point in here):
            axis.plot([1e3 * point["seconds"] for point in here], errors, ":", color=colour, linewidth=0.9)
        lines.append(list(zip(whole, errors, strict=True)))
        labels += [(str(point["samples"]), x, y) for point, x, y in zip(here, whole, errors, strict=True)]
    return labels, lines


def _name(group):
    return f"{group['density']}, {group['scene']}"


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
    protocol.serve("study_plot.py", plots.literally(draw), needs_bpy=False)
