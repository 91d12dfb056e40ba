"""The figure of `cloudparity measure attribution`: a waterfall and maps per case."""

import numpy as np
import pytest

import display_picture
from protocol import InputError, located

pytest.importorskip("matplotlib")

import attribution_plot


def request(folder, count):
    random = np.random.default_rng(2)

    def picture(name, values):
        path = str(folder / f"{name}.exr")
        display_picture.write_exr(path, values.astype(np.float32), ["R", "G", "B"])
        return path

    def uncertain(value):
        return {"value": value, "standard_error": 0.01}

    truth = random.uniform(0.2, 1.0, (18, 32, 3))
    stages = [("field", 0.5, 0.2), ("orders of scattering", -0.2, -0.1)]
    cases = [
        {
            "scene": f"scene {index}",
            "density": "an engine of 5 $",
            "relmse": uncertain(0.31),
            "remainder": uncertain(0.01),
            "shares": [
                {"name": name, "relmse": uncertain(share), "map": picture(name, np.full_like(truth, level))}
                for name, share, level in stages
            ],
            "compared": [picture("engine", truth + 0.1), picture("truth", truth)],
        }
        for index in range(count)
    ]
    files = {kind: str(folder / f"t.{kind}") for kind in ("svg", "png", "pdf")}
    return located({"title": "test", "cases": cases, **files}, "request")


def test_waterfalls_end_at_the_remainder_and_maps_have_one_scale(tmp_path):
    found = attribution_plot.draw(request(tmp_path, 2), None)
    assert (tmp_path / "t.pdf").read_bytes().startswith(b"%PDF") and set(found) == {"svg", "png", "pdf"}
    figure = attribution_plot._figure(request(tmp_path, 2))
    assert len(figure.subfigs) == 2
    waterfall, maps = figure.subfigs[0].subfigs
    bars = [(bar.get_x(), bar.get_width()) for bar in waterfall.axes[0].patches]
    # The error, what each stage takes from it or adds, what is left.
    assert np.allclose(bars, [(0, 0.31), (-0.19, 0.5), (0.01, -0.2), (0, 0.01)])
    pictures = [axis.images[0] for axis in maps.axes if axis.images]
    assert [image.get_array().ndim for image in pictures[:5]] == [3, 3, 2, 2, 2]
    scales = {image.get_clim() for image in pictures[2:5]}
    assert len(scales) == 1 and np.allclose(scales.pop(), (-0.1, 0.1), atol=1e-6)


def test_no_cases_are_refused(tmp_path):
    with pytest.raises(InputError, match="cases"):
        attribution_plot.draw(request(tmp_path, 0), None)
