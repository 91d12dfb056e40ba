"""The figure of `cloudparity study`: panels, fronts, and errors that noise drove below 0."""

import numpy as np
import pytest

from protocol import InputError, located

pytest.importorskip("matplotlib")

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
        },
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
    return {"scene": name, "density": "graph", "runs": runs, "front": ["0", "1", "3"]}


def request(folder, groups):
    files = {kind: str(folder / f"s.{kind}") for kind in ("svg", "png", "pdf")}
    return located({"title": "test", "groups": groups, **files}, "request")


def test_every_group_has_a_panel_with_its_front(tmp_path):
    import matplotlib.image

    groups = [group("one"), group("two"), group("three")]
    study_plot.draw(request(tmp_path, groups), None)
    picture = matplotlib.image.imread(tmp_path / "s.png")
    assert 0.005 < np.mean(picture[..., :3] < 0.5) < 0.5, "nothing or only ink"
    assert "<svg" in (tmp_path / "s.svg").read_text()
    assert (tmp_path / "s.pdf").read_bytes().startswith(b"%PDF")
    figure = study_plot._figure("test", groups)
    panels = [axis for axis in figure.axes if axis.get_title()]
    assert [panel.get_title() for panel in panels] == ["graph in one", "graph in two", "graph in three"]
    front = [line for line in panels[0].lines if line.get_linestyle() == "-" and len(line.get_xdata()) > 1]
    # The last of the front is below 0: half of the smallest error above it stands for it.
    assert np.allclose(front[0].get_xdata(), [1, 2, 8]) and np.allclose(
        front[0].get_ydata(), [0.5, 0.1, 0.05]
    )


def test_a_study_without_runs_is_an_error(tmp_path):
    with pytest.raises(InputError) as error:
        study_plot.draw(request(tmp_path, []), None)
    assert "groups" in error.value.place
