"""Tests of the figure of growth: every ladder has its panel, and what no logarithm has is left out."""

import matplotlib.pyplot as pyplot
import numpy as np
import pytest

import growth_plot
import protocol


def _row(value, paths, memory=1 << 30):
    return {"value": value, "median": {"preparation": 0.0, "paths": paths, "memory": memory}}


def _request(folder, ladders):
    files = {extension: str(folder / f"growth.{extension}") for extension in ("svg", "png", "pdf")}
    return {"title": "Growth", "ladders": ladders, **files}


def test_every_ladder_has_a_panel_with_its_rungs(tmp_path):
    rows = [_row(0, 1.0), _row(1, 2.0), _row(4, 8.0, None)]
    ladders = [{"name": f"ladder {number}", "rows": rows} for number in range(4)]
    figure = growth_plot._figure(_request(tmp_path, ladders))
    panels = [axis for axis in figure.axes if axis.axison]
    assert [axis.get_xlabel() for axis in panels] == [f"ladder {number}" for number in range(4)]
    for axis in panels:
        lines = {line.get_label(): line for line in axis.get_lines()}
        # A value of 0 has no logarithm; a time of 0 is at the lower end.
        assert list(lines["paths, s"].get_xdata()) == [1, 4]
        assert list(lines["paths, s"].get_ydata()) == [2.0, 8.0]
        assert (lines["preparation, s"].get_ydata() > 0).all()
        assert np.isnan(lines["memory, GiB"].get_ydata()[1])
    pyplot.close(figure)
    growth_plot.draw(_request(tmp_path, ladders), None)
    assert all(
        (tmp_path / f"growth.{extension}").stat().st_size > 1000 for extension in ("svg", "png", "pdf")
    )


def test_no_ladder_is_said(tmp_path):
    with pytest.raises(protocol.InputError, match="ladders"):
        growth_plot._figure(_request(tmp_path, []))
