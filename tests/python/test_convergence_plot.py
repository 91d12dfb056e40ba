"""The figure of `cloudparity convergence`: both files, with the orders and every series that was measured."""

import copy

import numpy as np
import pytest

from protocol import InputError, located

pytest.importorskip("matplotlib")

import convergence_plot


def document():
    """What the program writes, with two points of fit per integration and two sizes of caches."""
    points, orders = [], []
    for integration, order in (("energy-conserving", 2), ("plain", 1)):
        for steps in (4, 8, 16):
            error = steps**-order
            points.append(
                {
                    "integration": integration,
                    "steps": steps,
                    "root_relmse": error,
                    "relative_rms": error / 3,
                    "relative_mean_error": -error / 2,
                }
            )
        orders.append(
            {
                "integration": integration,
                "figure": "root_relmse",
                "order": float(order),
                "factor": 1.0,
                "fitted_steps": [4, 8],
                "asymptotic": integration == "plain",
            }
        )
    caches = [
        {
            "cache": {"settings": {"cells": cells, "format": name, "filter": filter_name}},
            "relative_rms": 0.0 if name == "f32" else 1 / cells,
            "relative_mean_error": -1 / cells,
        }
        for cells in (8, 16)
        for name in ("f32", "f16", "unorm8")
        for filter_name in ("nearest", "trilinear")
    ]
    return {
        "scene": "test",
        "resolution": [4, 3],
        "mean_side": 2.0,
        "reference_steps": 64,
        "cache_steps": 16,
        "points": points,
        "orders": orders,
        "caches": caches,
    }


def request(folder, value):
    return located(
        {"convergence": value, "svg": str(folder / "a" / "c.svg"), "png": str(folder / "a" / "c.png")},
        "request",
    )


def test_the_figure_is_written_twice_and_names_the_orders(tmp_path):
    import matplotlib.image

    convergence_plot.draw(request(tmp_path, document()), None)
    picture = matplotlib.image.imread(tmp_path / "a" / "c.png")
    assert picture.shape[0] > 500 and picture.shape[1] > 1200
    assert 0.01 < np.mean(picture[..., :3] < 0.5) < 0.5, "nothing or only ink"
    assert "<svg" in (tmp_path / "a" / "c.svg").read_text()
    figure = convergence_plot._figure(located(document(), "document"))
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert [label for label in labels if "order" in label] == [
        "energy-conserving, √relMSE: order 2.00 (no power law)",
        "plain, √relMSE: order 1.00",
    ]
    assert [len(axis.get_legend_handles_labels()[1]) for axis in figure.axes] == [4, 2, 6, 6]


def test_without_caches_there_is_one_row_and_equal_figures_are_equal_files(tmp_path):
    value = document()
    value["caches"] = []
    assert len(convergence_plot._figure(located(value, "document")).axes) == 2
    files = []
    for name in ("one", "two"):
        convergence_plot.draw(request(tmp_path / name, copy.deepcopy(value)), None)
        files.append((tmp_path / name / "a" / "c.svg").read_bytes())
    assert files[0] == files[1]


def test_errors_of_zero_are_said_in_words(tmp_path):
    value = document()
    value["orders"] = []
    for point in value["points"] + value["caches"]:
        point.update(root_relmse=0.0, relative_rms=0.0, relative_mean_error=0.0)
    convergence_plot.draw(request(tmp_path, value), None)
    figure = convergence_plot._figure(located(value, "document"))
    assert all("every error is 0" in [text.get_text() for text in axis.texts] for axis in figure.axes)


def test_a_document_without_points_is_an_error_that_names_the_key(tmp_path):
    value = document()
    del value["points"]
    with pytest.raises(InputError) as error:
        convergence_plot.draw(request(tmp_path, value), None)
    assert "points" in error.value.place
