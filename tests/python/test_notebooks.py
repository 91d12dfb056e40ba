"""The notebooks, executed on a small study, and the reader by which they see it."""

import base64
import csv
import io
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest

from blend_support import IS_BPY_REQUIRED, ROOT, built_program

pytest.importorskip("OpenImageIO")
nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
image = pytest.importorskip("matplotlib.image")

import study_reader  # noqa: E402
from presentation import Table, ulp_distance, uncertain  # noqa: E402
from study_reader import ReadError, read_models, read_study  # noqa: E402

NOTEBOOKS = ROOT / "notebooks"
SCENE = ROOT / "parity" / "scenes" / "clouds-in-daylight.scene.json"
HAS_BPY = IS_BPY_REQUIRED or find_spec("bpy") is not None
# Seconds for a cell, and for a kernel to start. Either takes a few; on a busy machine it may be minutes. This
# only ends what hangs.
TIMEOUT = 1800

# Small, and yet with everything that a study can hold: two densities, light models that differ, fronts with
# several runs, combinations that are left out. Each run costs a second of preparation at any resolution.
STUDY = f"""
format = "cloudparity-study/1"
title = "A small study"
resolution = [24, 14]
[truth]
samples = 2
replicas = 6
voxels = 24
[timing]
repeats = 1
[axes]
scenes = [{{ file = {json.dumps(str(SCENE))}, name = "daylight", set = ["Density=10"], volume_bounces = 4 }}]
densities = ["graph", "perlin-fbm"]
lights = ["single", "octaves"]
steps = [4, 8]
light_steps = [2]
caches = [{{ cells = 0 }}, {{ cells = 8, format = "unorm8" }}]
"""


def run(*arguments):
    """Run the program; return what it prints."""
    environment = os.environ | {"CLOUDPARITY_PYTHON": sys.executable}
    command = [built_program(), *arguments]
    finished = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True)
    assert finished.returncode == 0, finished.stderr
    return finished.stdout


@pytest.fixture(scope="session")
def study_folder(tmp_path_factory):
    """The small study."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "small.study.toml").write_text(STUDY, encoding="utf-8")
    run("study", folder / "small.study.toml", "-o", folder / "results")
    return folder / "results"


@pytest.fixture(scope="session")
def models_folder(tmp_path_factory):
    """A small comparison of density models."""
    folder = tmp_path_factory.mktemp("models")
    size = ["--resolution", "24x14", "--places", "16", "--samples", "4", "--sub-pixels", "1"]
    cost = ["--timed-points", "4096", "--volume-bounces", "8", "--parameter", "texture_size=32"]
    run("compare-models", SCENE, "-o", folder, *size, *cost)
    return folder


@pytest.fixture
def study(study_folder, monkeypatch):
    """The small study, read."""
    monkeypatch.setenv("CLOUDPARITY_PROGRAM", str(built_program()))
    return read_study(study_folder)


@pytest.fixture
def execute(monkeypatch, tmp_path):
    """Executes a notebook under settings of the environment, in memory; returns its figures and tables."""
    monkeypatch.setenv("CLOUDPARITY_PROGRAM", str(built_program()))
    # No start-up files of whoever runs the tests.
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    monkeypatch.setenv("JUPYTER_CONFIG_DIR", str(tmp_path / "jupyter"))

    def run_notebook(name, folder=NOTEBOOKS, **settings):
        for key, value in settings.items():
            monkeypatch.setenv(key, str(value))
        notebook = nbformat.read(folder / name, as_version=4)
        place = {"metadata": {"path": str(folder)}}
        limits = {"timeout": TIMEOUT, "startup_timeout": TIMEOUT}
        nbclient.NotebookClient(notebook, kernel_name="python3", resources=place, **limits).execute()
        outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
        assert not [output for output in outputs if output.output_type == "error"]
        warnings = [output.text for output in outputs if output.get("name") == "stderr"]
        assert not warnings, warnings
        data = [output.get("data", {}) for output in outputs]
        figures = [base64.b64decode(part["image/png"]) for part in data if "image/png" in part]
        for figure in figures:
            pixels = image.imread(io.BytesIO(figure))[..., :3]
            assert min(pixels.shape[:2]) > 100
            assert 0.005 < np.mean(pixels < 0.9) < 0.95, "nothing or only ink"
        tables = [part["text/html"] for part in data if "<table" in part.get("text/html", "")]
        # A heading and at least one row.
        assert all(table.count("<tr>") >= 2 for table in tables)
        text = "\n".join(part["text/markdown"] for part in data if "text/markdown" in part)
        return figures, tables, text

    return run_notebook


def test_field_parity_is_shown_with_and_without_blender(execute, tmp_path):
    (tmp_path / "slices").mkdir()
    field = np.linspace(0, 1, 48, dtype=np.float32).reshape(6, 8)
    np.save(tmp_path / "slices" / "x=0-cycles.npy", field)
    np.save(tmp_path / "slices" / "x=0-gpu.npy", field + np.float32(1e-6))
    if HAS_BPY:
        scene = ROOT / "parity" / "scenes" / "procedural-clouds.scene.json"
        run("probe", scene, "--points", "500", "-o", tmp_path / "probe.json")
        run("modes", "--node", "Clamp", "--without-gpu", "-o", tmp_path / "modes.json")
    figures, tables, text = execute("field-parity.ipynb", CLOUDPARITY_POINTS=4000, CLOUDPARITY_RUN=tmp_path)
    # Texture values, the box, a slice, Cycles' slices; another where there is an adapter.
    assert len(figures) >= 4 and len(tables) == (4 if HAS_BPY else 2)
    assert "270 of 270" in text, "the CPU has Cycles' bits"
    assert "all 270 values of the CPU have Cycles' bits" in text
    if HAS_BPY:
        assert "Live Cycles at 500 points: the CPU's largest error is 0." in text
    else:
        assert text.count("run `make demo`") == 2, "what is missing is said"


def test_light_models_are_chosen_by_error_against_time(execute, study_folder):
    figures, tables, text = execute("light-model-choice.ipynb", CLOUDPARITY_STUDY=study_folder)
    # Error against time, against steps, by budget, the pictures of the scene, every model.
    assert len(figures) == 5 and len(tables) == 3
    assert "perlin-fbm has no density caches" in tables[1], "why combinations were left out"
    assert "**graph, daylight**" in text and "**perlin-fbm, daylight**" in text


def test_voronoi_and_perlin_fbm_are_compared(execute, study_folder, models_folder):
    settings = {"CLOUDPARITY_STUDY": study_folder, "CLOUDPARITY_MODELS": models_folder}
    figures, tables, text = execute("voronoi-and-perlin-fbm.ipynb", **settings)
    # Fields, pictures, mean radiance, equal settings, fronts.
    assert len(figures) == 5 and len(tables) == 5
    assert "rank correlation" in text and "same mean optical depth" in text


def test_a_copy_of_a_notebook_works_anywhere_with_a_clone(execute, study_folder, tmp_path):
    shutil.copy(NOTEBOOKS / "light-model-choice.ipynb", tmp_path)
    clone = {"CLOUDPARITY_STUDY": study_folder, "CLOUDPARITY_REPOSITORY": ROOT}
    figures, tables, _ = execute("light-model-choice.ipynb", tmp_path, **clone)
    assert len(figures) == 5 and len(tables) == 3
    with pytest.raises(nbclient.exceptions.CellExecutionError) as error:
        execute("light-model-choice.ipynb", tmp_path, CLOUDPARITY_REPOSITORY="")
    assert "set CLOUDPARITY_REPOSITORY to the folder of one" in str(error.value)


def test_uncertain_figures_are_written_as_the_program_does():
    cases = json.loads((ROOT / "parity" / "uncertain-figures.json").read_text(encoding="utf-8"))
    assert len(cases) > 20
    for what, value, error, text in cases:
        value, error = (np.nan if number is None else number for number in (value, error))
        assert uncertain(study_reader.Uncertain(value, error)) == text, what


def test_a_notebook_without_its_study_says_what_to_run(execute, tmp_path):
    with pytest.raises(nbclient.exceptions.CellExecutionError) as error:
        execute("light-model-choice.ipynb", CLOUDPARITY_STUDY=tmp_path / "nowhere")
    assert "cannot go on" in str(error.value) and "make demo" in str(error.value)


def test_committed_notebooks_hold_no_outputs():
    paths = sorted(NOTEBOOKS.glob("*.ipynb"))
    assert len(paths) == 3
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        nbformat.validate(notebook)
        assert set(notebook.metadata) == {"kernelspec", "language_info"}
        for number, cell in enumerate(notebook.cells, 1):
            assert cell.id == f"{path.stem}-{number:02}" and not cell.metadata
            if cell.cell_type == "code":
                assert not cell.outputs and cell.execution_count is None, f"{path.name}: clear the outputs"


def test_the_reader_gives_the_values_of_the_table(study):
    with open(study.folder / "results.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    records = study.records()
    assert len(rows) == len(records) == 12
    for row, record in zip(rows, records, strict=True):
        del row["on_front"]
        assert set(row) == set(record)
        for name, text in row.items():
            value = record[name]
            if isinstance(value, bool):
                assert text == str(value).lower(), name
            else:
                assert text == "" if value is None else type(value)(text) == value, name


def test_runs_are_told_apart_by_defects_god_rays_and_parameters_of_light(study):
    plain = study.runs[0]
    kept = replace(plain, light="octaves octaves=3", defects="PF-4,PF-6", god_rays=True)
    assert (plain.defects, plain.god_rays) == ("none", False)
    assert plain.quality() != kept.quality()
    assert kept.label() == plain.label().replace(plain.light, kept.light) + ", defects PF-4,PF-6, god rays"
    alone = replace(plain, light="single")
    assert replace(study, runs=(kept, alone)).lights() == ["single", "octaves octaves=3"]
    deep = replace(plain, light="octaves-deep")
    # The longest entry that a name begins with is its own; `octaves` is no part of `octaves-deep`.
    entries = study.axes | {"lights": ["octaves octaves=3", "octaves-deep", "octaves"]}
    lights = replace(study, axes=entries, runs=(replace(plain, light="octaves"), deep, kept)).lights()
    assert lights == entries["lights"]


def test_pictures_and_truths_give_the_bias_that_the_study_states(study):
    for one in study.runs:
        picture = study.picture(one)
        truth, error = study.truth(one)
        assert picture.shape == truth.shape == error.shape == (14, 24, 3)
        # Sums of 1008 numbers in two orders, in f64: 1e-12 is generous.
        found = picture.astype(np.float64).mean() / truth.mean() - 1
        assert found == pytest.approx(one.bias.value, abs=1e-12)
        assert np.all(error >= 0) and np.any(error > 0)


def test_fronts_are_those_that_nothing_beats(study):
    on_fronts = set()
    for group, runs in study.groups().items():
        on_fronts |= {one.id for one in study.front(*group)}
        for metric in study.metrics():
            best = {
                one.id
                for one in runs
                if not any(
                    other.seconds <= one.seconds
                    and other.error(metric) <= one.error(metric)
                    and (other.seconds, other.error(metric)) != (one.seconds, one.error(metric))
                    for other in runs
                )
            }
            assert {one.id for one in study.front(*group, metric=metric)} == best
    assert on_fronts == study.front_of_table()
    last = study.front("daylight", "graph")[-1]
    assert study.recommend("daylight", "graph", max_ms=1e6) == last
    assert study.recommend("daylight", "graph", max_relmse=last.relmse.value) == last


def test_a_budget_that_nothing_keeps_to_is_refused_in_the_programs_words(study):
    with pytest.raises(ReadError) as error:
        study.recommend("daylight", "graph", max_ms=1e-6)
    assert "fastest run" in error.value.expected and "the time that is allowed" in error.value.place


def test_what_was_left_out_has_a_reason(study):
    assert len(study.skipped) == 4
    assert {one.settings["density"] for one in study.skipped} == {"perlin-fbm"}
    assert all("density cache" in one.reason for one in study.skipped)


def test_verified_errors_are_read(study_folder, tmp_path):
    (tmp_path / "results.json").write_bytes((study_folder / "results.json").read_bytes())
    study = read_study(tmp_path)
    assert study.verified() is None
    entry = {
        "id": study.runs[0].id,
        "combination": {"scene": "daylight", "density": "graph"},
        "first": {"value": 0.5, "standard_error": 0.1},
        "second": {"value": 0.7, "standard_error": 0.1},
        "t": 1.41,
        "agrees": True,
    }
    (tmp_path / "verified.json").write_text(json.dumps([entry]), encoding="utf-8")
    (found,) = study.verified()
    assert (found.density, found.second.value, found.agrees) == ("graph", 0.7, True)
    (tmp_path / "verified.json").write_text('[{"id": "1"}]', encoding="utf-8")
    with pytest.raises(ReadError) as error:
        study.verified()
    assert "no 'combination'" in error.value.found


def refused(read, folder):
    with pytest.raises(ReadError) as error:
        read(folder)
    assert error.value.remedy and error.value.expected
    return error.value


def test_a_folder_without_results_is_refused(tmp_path):
    for read, file in ((read_study, "results.json"), (read_models, "models.json")):
        error = refused(read, tmp_path / "nowhere")
        assert file in error.place and error.found == "no such file" and "make demo" in error.remedy


def test_another_format_is_refused(tmp_path):
    results = tmp_path / "results.json"
    results.write_text('{"format": "cloudparity-study-results/2"}', encoding="utf-8")
    error = refused(read_study, tmp_path)
    assert error.found == "cloudparity-study-results/2" and error.expected == study_reader.STUDY_FORMAT
    for text in ("{}", "[]", '"text"'):
        results.write_text(text, encoding="utf-8")
        assert refused(read_study, tmp_path).found == "no format"


def test_broken_files_are_named_with_the_place(tmp_path):
    (tmp_path / "results.json").write_text('{"format":\n "cloudparity', encoding="utf-8")
    error = refused(read_study, tmp_path)
    assert "results.json, line 2, column 2" in error.place and "cloudparity study" in error.remedy
    (tmp_path / "results.json").write_bytes(b'{"format": "\xff"}')
    assert "byte 12" in refused(read_study, tmp_path).found
    (tmp_path / "results.json").write_text(
        json.dumps({"format": study_reader.STUDY_FORMAT}), encoding="utf-8"
    )
    assert refused(read_study, tmp_path).found == "no 'study'"
    (tmp_path / "models.json").write_text('{"scene": "cloud"}', encoding="utf-8")
    assert refused(read_models, tmp_path).found == "no 'settings'"


def test_pictures_that_cannot_be_read_are_named(tmp_path):
    (tmp_path / "broken.exr").write_bytes(b"no picture")
    error = refused(study_reader.read_picture, tmp_path / "broken.exr")
    assert "broken.exr" in error.place and error.found


def test_a_program_that_is_not_there_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("CLOUDPARITY_PROGRAM", str(tmp_path / "none"))
    with pytest.raises(ReadError) as error:
        study_reader.run_program("doctor")
    assert "make build" in error.value.remedy


def test_distances_count_the_numbers_between():
    one = np.float32(1)
    above = np.nextafter(one, np.float32(2))
    smallest = np.float32(1e-45)
    assert list(ulp_distance([one, one, 0.0, smallest], [one, above, -0.0, -smallest])) == [0, 1, 0, 2]


def test_tables_escape_what_they_hold():
    table = Table(["a<b"], [["<script>"], [-1.5]])
    assert "<script>" not in table._repr_html_() and "a&lt;b" in table._repr_html_()
    assert repr(table).splitlines() == ["a<b", "<script>", "-1.5"]
