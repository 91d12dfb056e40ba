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

`pictures`: per group the truth, three runs of the Pareto front (fastest, least time x relMSE, closest), their
HDR-FLIP maps, and below them the window where the closest one errs most.
"""

import math

import optimiser
import picture_grid
import plots
import protocol

COLOURS = (plots.BLUE, plots.ORANGE, plots.GREEN, plots.PURPLE, plots.BLACK, "#56B4E9", "#E69F00")
MARKERS = "os^Dv<>"
COLUMNS = 2
SHOWN = 3  # runs of a group whose pictures are shown
LARGEST_FLIP = 0.8  # of the maps' scale: the fastest runs are far off
LABELS = 6  # of a Pareto front: more would cover each other
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
    return {name: plots.save(makers[name](), files, kinds) for name, files in request["figures"].items()}


def _figure(title, groups, clock):
    figure, axes, lights = _panels(groups)
    pyplot = plots.pyplot()
    for axis, group in zip(axes, groups, strict=True):
        _panel(axis, group, lights, clock)
    handles = _light_handles(lights)
    handles.append(pyplot.Line2D([], [], color="0.3", label="nothing is faster and closer"))
    drawn = {point["renderer"] for group in groups for point in group.get("curves", ())}
    for label, colour, marker in (CURVES[name] for name in CURVES if name in drawn):
        handles.append(pyplot.Line2D([], [], color=colour, marker=marker, markersize=4, label=label))
    if drawn:
        handles.append(pyplot.Line2D([], [], color="0.4", linestyle=":", label="without its preparation"))
    _legend(figure, handles, groups)
    figure.suptitle(title, fontsize=9)
    return figure


def _legend(figure, handles, groups):
    # As wide as the panels above it.
    columns = 4 if len(groups) > 1 else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=7)


def _panels(groups):
    """A figure with a panel for each group, the panels, and the light models in their order."""
    pyplot = plots.pyplot()
    columns = min(COLUMNS, len(groups))
    rows = math.ceil(len(groups) / columns)
    figure, axes = pyplot.subplots(
        rows,
        columns,
        figsize=(1.1 * plots.WIDTH * columns, 2.9 * rows + 0.6),
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
    figure.suptitle(f"{title}: convergence", fontsize=9)
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
    aspect = shown[0][1].shape[0] / shown[0][1].shape[1]
    height = 2 * (2 * plots.WIDTH / grid.columns * aspect + 0.22)
    figure = pyplot.figure(figsize=(2.2 * plots.WIDTH, height * len(shown) + 0.7), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.01, w_pad=0.01, hspace=0, wspace=0)
    axes = figure.subplots(2 * len(shown), grid.columns, squeeze=False)
    for number, (group, truth, runs) in enumerate(shown):
        pictures = [optimiser.read_mean([f"{folder}/{run['picture']}"]) for run in runs]
        whole, part = axes[2 * number], axes[2 * number + 1]
        grid.fill(whole, truth, pictures, part)
        whole[0].set_xlabel(_name(group), fontsize=5, labelpad=1)
        for axis, run in zip(whole[1:], runs, strict=False):
            milliseconds = 1e3 * run["seconds"]["median"]
            axis.set_xlabel(f"{_label(run['combination'])}, {milliseconds:.3g} ms", fontsize=5, labelpad=1)
    names = ("fastest", "least time x relMSE", "closest")
    titles = ("path tracing", *names, *(f"FLIP, {name}" for name in names))
    for axis, text in zip(axes[0], titles, strict=True):
        axis.set_title(text, fontsize=6)
    figure.colorbar(grid.image, ax=axes, shrink=0.3, aspect=40, pad=0.01).ax.tick_params(labelsize=6)
    figure.suptitle(f"{title}: pictures of the Pareto front", fontsize=9)
    return figure


def _shown(group):
    """The fastest, the cheapest per unit of error, and the closest run of a group's front."""
    front = [run for run in group["runs"] if run["id"] in group["front"]]
    return [
        min(front, key=lambda run: run["seconds"]["median"]),
        min(front, key=lambda run: run["seconds"]["median"] * max(run["errors"]["relmse"]["value"], 0.0)),
        min(front, key=lambda run: run["errors"]["relmse"]["value"]),
    ]


def _panel(axis, group, lights, clock):
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
    axis.set_title(_name(group), fontsize=8)
    axis.set_xlabel(f"{clock}, ms a picture")
    axis.set_ylabel("relMSE against path tracing")
    axis.grid(True, which="major", linewidth=0.3, color="0.85")


def _curves(axis, points, floor):
    for name, (_, colour, marker) in CURVES.items():
        here = sorted(
            (point for point in points if point["renderer"] == name), key=lambda one: one["samples"]
        )
        errors = [max(point["errors"]["relmse"]["value"], floor) for point in here]
        whole = [1e3 * ((point["seconds"] or 0.0) + point["prepare_seconds"]) for point in here]
        axis.plot(whole, errors, "-", color=colour, marker=marker, markersize=4, linewidth=0.9)
        if all(point["seconds"] for point in here):
            axis.plot([1e3 * point["seconds"] for point in here], errors, ":", color=colour, linewidth=0.9)
        for point, x, y in zip(here, whole, errors, strict=True):
            text = str(point["samples"])
            axis.annotate(text, (x, y), xytext=(4, 3), textcoords="offset points", fontsize=5)


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
