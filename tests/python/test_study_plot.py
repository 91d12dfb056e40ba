"""The figure of `cloudparity study`: panels, fronts, and errors that noise drove below 0."""

import itertools

import numpy as np
import pytest

import display_picture
from protocol import InputError, located

pytest.importorskip("matplotlib")
pytest.importorskip("flip_evaluator")

import picture_grid
import plots
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
    assert len(shown) == 11, "a truth and three pictures, whole and in part, and three maps"
    # The colour bar is that of the maps, and panels fill the text: 525 pixels are 300 dots per inch.
    assert shown[-1].images[0].get_clim() == (0, study_plot.LARGEST_FLIP)
    bar = next(axis for axis in figure.axes for child in axis.child_axes if child.get_xlabel() == "HDR-FLIP")
    assert bar.child_axes[0].get_xlim() == (0, study_plot.LARGEST_FLIP)
    figure.canvas.draw()
    widths = [axis.get_window_extent().width / figure.dpi for axis in shown]
    assert figure.get_figwidth() == plots.TEXT_WIDTH and min(widths) > 0.9 * plots.TEXT_WIDTH / 4
    frame = shown[0].patches[0]
    window = picture_grid.worst_window(np.pad(np.ones((6, 12)), ((0, 14), (28, 0))))
    assert window == (slice(0, 6), slice(28, 40))
    # FLIP's filters spread what is wrong by a few pixels.
    assert abs(frame.get_x() - 27.5) <= 2 and abs(frame.get_y() + 0.5) <= 2


def crowded():
    """A group whose front is so crowded that labels at fixed places would cover each other."""
    runs = [run(number, "octaves", 10 * 1.03**number, 0.5 * 0.9**number) for number in range(14)]
    curves = [
        {
            "renderer": "path",
            "samples": 4**power,
            "errors": {"relmse": {"value": 0.4 / 4**power, "standard_error": 0.001}},
            "seconds": 0.02 * 4**power,
            "prepare_seconds": 0.001,
        }
        for power in range(3)
    ]
    front = [str(number) for number in range(14)]
    return {**group("one"), "runs": runs, "front": front, "curves": curves}


@pytest.mark.parametrize("number", [1, 2])
def test_labels_cover_neither_each_other_nor_points_nor_lines_nor_the_frame(number):
    from matplotlib.text import Text

    figure = study_plot._figure(
        "A title that is longer than a column of a paper", [crowded()] * number, "time"
    )
    assert figure.get_figwidth() == (plots.WIDTH if number == 1 else plots.TEXT_WIDTH)
    renderer = figure.canvas.get_renderer()
    boxes = {figure._suptitle: figure._suptitle.get_window_extent(renderer)}
    for axis in (axis for axis in figure.axes if axis.get_title()):
        frame = axis.get_window_extent(renderer)
        notes = {note: Text.get_window_extent(note, renderer) for note in axis.texts}
        assert len(notes) > 6, "most have a place"
        texts = [note.get_text() for note in notes]
        assert texts.count("octaves 8/2") >= 2 and {"1", "4", "16"} <= set(texts)
        points = [place for line in axis.lines for place in axis.transData.transform(line.get_xydata())]
        front = axis.transData.transform([(10 * 1.03**n, 0.5 * 0.9**n) for n in np.linspace(0, 13, 400)])
        for box in notes.values():
            assert frame.x0 <= box.x0 and box.x1 <= frame.x1 and frame.y0 <= box.y0 and box.y1 <= frame.y1
            assert not any(box.contains(*place) for place in [*points, *front])
        boxes |= notes
        outside = [axis.title, axis.xaxis.label, axis.yaxis.label]
        boxes |= {text: text.get_window_extent(renderer) for text in outside}
        for side, at in ((axis.xaxis, 0), (axis.yaxis, 1)):
            low, high = side.get_view_interval()
            labels = [label for label in side.get_ticklabels() if low <= label.get_position()[at] <= high]
            ticks = [label.get_window_extent(renderer) for label in labels if label.get_text()]
            assert len(ticks) >= 2, "an axis without numbers"
            assert not any(one.overlaps(other) for one, other in itertools.combinations(ticks, 2))
    found = list(boxes.values())
    assert not any(one.overlaps(other) for one, other in itertools.combinations(found, 2))
    width, height = figure.canvas.get_width_height()
    assert all(box.x0 >= 0 and box.y0 >= 0 and box.x1 <= width and box.y1 <= height for box in found)


def test_figures_name_what_made_them(tmp_path):
    import matplotlib.image

    asked = {**request(tmp_path, [group("one")]), "made_by": "cloudparity 1+ab, rustc 1; matplotlib 3"}
    study_plot.draw(located(asked, "request"), None)
    assert b"rustc 1; matplotlib 3" in (tmp_path / "time.pdf").read_bytes()
    assert "rustc 1; matplotlib 3" in (tmp_path / "time.svg").read_text()
    assert b"rustc 1; matplotlib 3" in (tmp_path / "time.png").read_bytes()
    picture = matplotlib.image.imread(tmp_path / "time.png")
    assert picture.shape[1] == round(plots.WIDTH * plots.RESOLUTION)


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
