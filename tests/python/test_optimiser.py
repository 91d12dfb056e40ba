"""The conversation of `cloudparity tune`: searches find a minimum and can be repeated; errors are FLIP."""

import json
import subprocess
import sys

import numpy as np
import pytest

import display_picture
from blend_support import ROOT
from protocol import InputError, located

pytest.importorskip("cma")
pytest.importorskip("flip_evaluator")

import optimiser


def ask(session, **request):
    return session.answer(located(request, "request"), None)


def search(seed, target, generations):
    """The least distance to `target` that a search finds, and all candidates."""
    session = optimiser.Session()
    start = {"initial": [0.5] * len(target), "deviation": 0.3, "seed": seed, "population": 8}
    assert ask(session, op="start", **start)["library"].startswith("pycma")
    best, seen = np.inf, []
    for _ in range(generations):
        candidates = ask(session, op="ask")["candidates"]
        assert all(0 <= value <= 1 for candidate in candidates for value in candidate)
        errors = [float(np.sum((np.array(candidate) - target) ** 2)) for candidate in candidates]
        best = min(best, *errors)
        seen += candidates
        ask(session, op="tell", candidates=candidates, objectives=errors)
    return best, seen


def test_a_search_finds_a_minimum_and_can_be_repeated():
    target = np.array([0.9, 0.2])
    best, seen = search(3, target, 25)
    assert best < 1e-6
    assert search(3, target, 5)[1] == seen[:40]
    assert search(4, target, 5)[1] != seen[:40]


def test_a_single_parameter_is_searched_for_as_several_are():
    best, seen = search(3, np.array([0.9]), 40)
    assert best < 1e-6 and all(len(candidate) == 1 for candidate in seen)
    # At an end of the range, where the library looks at the deviation of each dimension.
    assert search(5, np.array([0.0]), 40)[0] < 1e-3


def pictures(folder):
    """A truth in two replicas, and a picture of it at half the light, over nothing and with its own light."""
    random = np.random.default_rng(1)
    truth = random.uniform(0.2, 1.0, (24, 32, 3)).astype(np.float32)
    names = {}
    for name, values in {
        "a": truth * 1.001,
        "b": truth * 0.999,
        "dark": 0 * truth,
        "lit": 0.5 * truth,
        "same": truth,
    }.items():
        names[name] = str(folder / f"{name}.exr")
        display_picture.write_exr(names[name], values, ["R", "G", "B"])
    return names


def test_errors_and_exposures_are_those_of_the_pictures(tmp_path):
    names = pictures(tmp_path)
    session = optimiser.Session()
    ask(session, op="truths", views=[[names["a"], names["b"]]])
    same, half = ask(session, op="flip", pictures=[[0, names["same"]], [0, names["lit"]]])["means"]
    assert same < 1e-3 < 0.05 < half
    found = ask(session, op="expose", pictures=[[0, names["dark"], names["lit"]]])
    assert abs(found["exposure"] - 2.0) < 0.03 and found["flip"] < 0.02
    noise = ask(session, op="noise", pairs=[[[names["a"]], [names["b"]]]])["means"]
    assert 0 < noise[0] < 0.01


def test_what_is_wrong_is_named(tmp_path):
    session = optimiser.Session()
    with pytest.raises(InputError, match="start"):
        ask(session, op="begin")
    with pytest.raises(InputError, match=r"none\.exr"):
        ask(session, op="truths", views=[[str(tmp_path / "none.exr")]])


def test_a_conversation_answers_line_by_line_and_ends_at_an_error():
    requests = [
        {"op": "start", "initial": [0.5, 0.5], "deviation": 0.3, "seed": 1, "population": 4},
        {"op": "ask"},
        {"op": "begin"},
        {"op": "ask"},
    ]
    finished = subprocess.run(
        [sys.executable, ROOT / "blend" / "optimiser.py"],
        input="\n".join(map(json.dumps, requests)) + "\n",
        capture_output=True,
        text=True,
    )
    events = [json.loads(line)["event"] for line in finished.stdout.splitlines()]
    assert events == ["hello", "done", "done", "error"] and finished.returncode == 1
