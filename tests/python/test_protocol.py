"""The scripts as their callers see them: events, exit status, errors that say what to do."""

import json
import os
import subprocess
import sys

import pytest

import plots
from blend_support import ROOT, requires_bpy, run_script

NEED_BPY = ["export_scene.py", "build_scene.py", "probe.py", "reference.py"]
SCRIPTS = [*NEED_BPY, "compare_images.py"]


def last_error(events):
    assert events[-1]["event"] == "error"
    assert all(events[-1][key] for key in ("place", "found", "expected", "remedy"))
    return events[-1]


@pytest.mark.parametrize("script", SCRIPTS)
def test_request_that_is_no_json(script):
    events, status = run_script(script, "{")
    assert status == 1
    assert "line 1" in last_error(events)["place"]


@pytest.mark.parametrize("script", NEED_BPY)
def test_missing_bpy_names_the_remedy(script, tmp_path):
    (tmp_path / "bpy.py").write_text("raise ImportError('not here')")
    events, status = run_script(script, {"kernel": "default"}, {"PYTHONPATH": str(tmp_path)})
    assert status == 1
    assert "bpy==5.0.1" in last_error(events)["remedy"]


def test_comparison_does_not_import_bpy(tmp_path):
    (tmp_path / "bpy.py").write_text("raise ImportError('not here')")
    request = {"op": "difference_map", "ours": [], "reference": []}
    events, status = run_script("compare_images.py", request, {"PYTHONPATH": str(tmp_path)})
    assert status == 1
    assert events[0]["event"] == "hello" and events[0]["blender"] is None
    assert last_error(events)["place"] == "request.ours"


@pytest.mark.parametrize(
    ("kernel", "value"), [("sse42", None), ("sse42", "0"), ("default", "1"), ("avx512", None)]
)
def test_probe_refuses_an_environment_for_another_kernel(kernel, value):
    environment = {} if value is None else {"CYCLES_CPU_NO_AVX2": value}
    events, status = run_script("probe.py", {"jobs": [], "kernel": kernel}, environment)
    assert status == 1
    assert kernel in json.dumps(last_error(events))
    assert not any(event["event"] == "hello" for event in events)


@requires_bpy
def test_missing_file_and_wrong_file(tmp_path):
    events, status = run_script("export_scene.py", {"blend": str(tmp_path / "none.blend")})
    assert status == 1
    assert events[0]["event"] == "hello"
    assert last_error(events)["found"] == "no such file"
    wrong = tmp_path / "wrong.blend"
    wrong.write_text("not a blend file")
    events, _ = run_script("export_scene.py", {"blend": str(wrong)})
    assert "cannot open" in last_error(events)["found"]


@requires_bpy
def test_messages_go_to_the_descriptor_that_is_given():
    reading, writing = os.pipe()
    finished = subprocess.run(
        [sys.executable, ROOT / "blend" / "export_scene.py", str(writing)],
        input="{}",
        capture_output=True,
        text=True,
        pass_fds=[writing],
    )
    os.close(writing)
    with os.fdopen(reading) as stream:
        events = [json.loads(line) for line in stream]
    assert finished.stdout == ""
    assert last_error(events)["place"] == "request.blend"


def test_an_unexpected_exception_is_an_error_of_the_file_without_a_traceback(tmp_path):
    # A library that fails at a file in a way that no script foresees.
    (tmp_path / "OpenImageIO.py").write_text("def ImageSpec():\n    1 / 0\n")
    picture = tmp_path / "a.exr"
    picture.write_text("no picture")
    request = {"op": "display", "images": [{"exr": str(picture), "png": str(tmp_path / "a.png")}]}
    events, status = run_script("compare_images.py", request, {"PYTHONPATH": str(tmp_path)})
    assert status == 1
    error = last_error(events)
    assert error["place"] == str(picture) and "ZeroDivisionError" in error["found"]
    assert "Traceback" not in json.dumps(events)


def test_names_of_figures_are_no_formulas():
    names = {"title": "$\\frac$ of\x1b\n$5", "groups": [{"scene": "a$", "picture": "$.exr"}], "svg": "$.svg"}
    asked = []
    plots.literally(lambda request, messages: asked.append(request))(names, None)
    assert asked == [
        {"title": r"\$\frac\$ of  \$5", "groups": [{"scene": r"a\$", "picture": "$.exr"}], "svg": "$.svg"}
    ]
