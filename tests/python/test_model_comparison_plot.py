"""The figure of `cloudparity compare-models`: both panels, with what each density is."""

import numpy as np
import pytest

from protocol import InputError, located

pytest.importorskip("matplotlib")

import model_comparison_plot


def side(title, beyond):
    shares = [(1 - beyond) / 60] * 60
    statistics = {
        "filled": 0.25,
        "histogram": [*shares, beyond],
        "spectrum": [1.0 / (wave * wave) for wave in range(1, 33)],
    }
    return {"title": title, "statistics": statistics}


def request(folder, sides):
    return located({"sides": sides, "svg": str(folder / "m.svg"), "png": str(folder / "m.png")}, "request")


def test_the_figure_shows_both_densities(tmp_path):
    import matplotlib.image

    sides = [side("graph", 0.0), side("model", 0.1)]
    model_comparison_plot.draw(request(tmp_path, sides), None)
    picture = matplotlib.image.imread(tmp_path / "m.png")
    assert picture.shape[0] > 400 and picture.shape[1] > 1200
    assert 0.01 < np.mean(picture[..., :3] < 0.5) < 0.5, "nothing or only ink"
    assert "<svg" in (tmp_path / "m.svg").read_text()
    figure = model_comparison_plot._figure(sides)
    histogram, spectrum = figure.axes
    assert histogram.get_legend_handles_labels()[1] == [
        "graph: 25.0 % of the places",
        "model: 25.0 % of the places, 10 % of these beyond 6",
    ]
    # Shares of 1/60 in bins of 1/10: a probability density over the six means.
    assert np.allclose(histogram.patches[0].get_data().values, 1 / 6)
    assert spectrum.lines[1].get_ydata()[1] == 0.25


def test_a_density_without_statistics_is_an_error_that_names_the_key(tmp_path):
    sides = [side("graph", 0.0), {"title": "model"}]
    with pytest.raises(InputError) as error:
        model_comparison_plot.draw(request(tmp_path, sides), None)
    assert "statistics" in error.value.place
