"""The figure of `cloudparity study`: panels, fronts, and errors that noise drove below 0."""

import numpy as np
import pytest

import display_picture
from protocol import InputError, located

pytest.importorskip("matplotlib")
pytest.importorskip("flip_evaluator")

import picture_grid
import study_plot


def run(number, light, milliseconds, error):
    return {
        "id": str(number),
        "combination": {
            "light": light,
            "steps": 8,
            "light_steps": 2,
            "cache": {"cells": 0},
            "sub_pixels": 1,
            "jitter": "none",
        },
        "picture": f"{number}.exr",
        "seconds": {"median": milliseconds / 1e3},
        "errors": {"relmse": {"value": error, "standard_error": abs(error) / 4}},
    }


def group(name):
    runs = [
        run(0, "single", 1, 0.5),
        run(1, "octaves", 2, 0.1),
        run(2, "single", 4, 0.2),
        run(3, "octaves", 8, -0.001),
    ]
    return {
        "scene": name,
        "density": "graph",
        "runs": runs,
        "front": ["0", "1", "3"],
        "truth": ["truth.exr"],
    }


def request(folder, groups):
    random = np.random.default_rng(4)
    picture = random.uniform(0.2, 1.0, (20, 40, 3)).astype(np.float32)
    for name in ("truth", "0", "1", "2", "3"):
        values = picture.copy()
        # What is wrong is in one corner.
        values[:6, 28:] *= 1.0 if name == "truth" else 0.3
        display_picture.write_exr(str(folder / f"{name}.exr"), values, ["R", "G", "B"])
    figures = {
        name: {kind: str(folder / f"{name}.{kind}") for kind in ("svg", "png", "pdf")}
        for name in ("time", "convergence", "pictures")
    }
    document = {
        "title": "test",
        "clock": "processor time",
        "groups": groups,
        "folder": str(folder),
        "figures": figures,
    }
    return located(document, "request")


def test_every_group_has_a_panel_with_its_front(tmp_path):
    import matplotlib.image

    groups = [group("one"), group("two"), group("three")]
    study_plot.draw(request(tmp_path, groups), None)
    for name in ("time", "convergence", "pictures"):
        picture = matplotlib.image.imread(tmp_path / f"{name}.png")
        assert 0.002 < np.mean(picture[..., :3] < 0.5) < 0.7, "nothing or only ink"
        assert "<svg" in (tmp_path / f"{name}.svg").read_text()
        pdf = (tmp_path / f"{name}.pdf").read_bytes()
        assert pdf.startswith(b"%PDF") and b"/FontFile2" in pdf and b"/Type3" not in pdf
        assert "<text" in (tmp_path / f"{name}.svg").read_text()
    figure = study_plot._figure("test", groups, "processor time")
    panels = [axis for axis in figure.axes if axis.get_title()]
    assert [panel.get_title() for panel in panels] == ["graph, one", "graph, two", "graph, three"]
    front = [line for line in panels[0].lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 1]
    # The last of the Pareto front is below 0: half of the smallest error above it stands for it.
    assert np.allclose(front[0].get_xdata(), [1, 2, 8]) and np.allclose(
        front[0].get_ydata(), [0.5, 0.1, 0.05]
    )


def test_pictures_of_the_front_and_the_window_where_they_err_are_shown(tmp_path):
    groups = [group("one")]
    request(tmp_path, groups)
    figure = study_plot._pictures("test", groups, str(tmp_path))
    shown = [axis for axis in figure.axes if axis.images]
    assert len(shown) == 14, "a truth, three pictures and three maps, whole and in part"
    frame = shown[0].patches[0]
    window = picture_grid.worst_window(np.pad(np.ones((6, 12)), ((0, 14), (28, 0))))
    assert window == (slice(0, 6), slice(28, 40))
    # FLIP's filters spread what is wrong by a few pixels.
    assert abs(frame.get_x() - 27.5) <= 2 and abs(frame.get_y() + 0.5) <= 2


def test_lines_of_convergence_are_the_runs_of_a_light_model_by_steps():
    runs = [run(0, "single", 1, 0.5), run(1, "single", 1, 0.1)]
    runs[1]["combination"]["steps"] = 32
    figure = study_plot._convergence("test", [{**group("one"), "runs": runs}])
    lines = [line for line in figure.axes[0].lines if len(line.get_xdata()) == 2]
    assert lines and all(list(line.get_xdata()) == [8, 32] for line in lines)
    assert list(lines[0].get_ydata()) == [0.5, 0.1]


def test_a_study_without_runs_is_an_error(tmp_path):
    with pytest.raises(InputError) as error:
        study_plot.draw(request(tmp_path, []), None)
    assert "groups" in error.value.place
