"""The figure of `cloudparity tune`: a row per held-out view, and the search."""

import numpy as np
import pytest

import display_picture
from protocol import InputError, located

pytest.importorskip("matplotlib")
pytest.importorskip("flip_evaluator")

import tuning_plot


def request(folder, count):
    random = np.random.default_rng(2)
    views = []
    for index in range(count):
        files = []
        for name, scale in (("truth", 1.0), ("before", 0.6), ("after", 0.95)):
            files.append(str(folder / f"{name}-{index}.exr"))
            values = scale * random.uniform(0.2, 1.0, (18, 32, 3)).astype(np.float32)
            display_picture.write_exr(files[-1], values, ["R", "G", "B"])
        views.append({"view": f"view {index}", "truth": files[:1], "before": files[1], "after": files[2]})
    document = {
        "title": "test",
        "before": "octaves",
        "views": views,
        "history": [[0.5, 0.7], [0.6, 0.65], [0.2, 0.3]],
        "objective": "flip",
        **{kind: str(folder / f"t.{kind}") for kind in ("svg", "png", "pdf")},
    }
    return located(document, "request")


def test_views_and_search_are_drawn(tmp_path):
    found = tuning_plot.draw(request(tmp_path, 2), None)
    assert (tmp_path / "t.pdf").read_bytes().startswith(b"%PDF") and set(found) == {"svg", "png", "pdf"}
    figure = tuning_plot._figure(request(tmp_path, 2))
    shown = [axis for part in figure.subfigs for axis in part.axes if axis.images]
    assert len(shown) == 10
    lines = figure.subfigs[1].axes[0].lines
    # The least so far never rises.
    assert np.allclose(lines[0].get_ydata(), [0.5, 0.5, 0.2])


def test_no_views_are_refused(tmp_path):
    with pytest.raises(InputError, match="views"):
        tuning_plot.draw(request(tmp_path, 0), None)
