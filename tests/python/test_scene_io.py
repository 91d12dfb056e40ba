"""Numbers, text and files of the scene format; no Blender needed."""

import json

import numpy as np
import pytest

import scene_io
from protocol import InputError, located


@pytest.mark.parametrize("value", [0.8, 1e-45, 3.4028235e38, -0.1, 16777216.0, 1 / 3, 1e-7])
def test_shortest_reads_back_as_the_same_f32(value):
    text = json.dumps(scene_io.shortest(value, "here"))
    assert np.float32(json.loads(text)) == np.float32(value)
    assert len(text) <= len(repr(float(np.float32(value))))


def test_not_finite_is_refused_with_its_place():
    with pytest.raises(InputError) as refusal:
        scene_io.shortest(float("nan"), 'node "Math"')
    assert refusal.value.place == 'node "Math"'


def test_format_keeps_the_document_and_its_order():
    document = {"b": {"d": [[1.0, 2.0], [3.0, 4.0]], "c": "x" * 120}, "a": []}
    text = scene_io.format_scene(document)
    assert json.loads(text) == document
    assert text == scene_io.format_scene(json.loads(text))
    assert list(json.loads(text)) == ["b", "a"]
    assert "[[1.0, 2.0], [3.0, 4.0]]" in text


def test_hash_depends_on_values_and_not_on_order():
    assert scene_io.scene_hash({"a": 1, "b": 2.5}) == scene_io.scene_hash({"b": 2.5, "a": 1})
    assert scene_io.scene_hash({"a": 1.0}) != scene_io.scene_hash(
        {"a": float(np.nextafter(np.float32(1), 2))}
    )


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    target = tmp_path / "scene.json"
    target.write_text("old")
    with pytest.raises(InputError, match="disk full"), scene_io.replaced_file(target) as temporary:
        temporary.write_text("half")
        raise OSError("disk full")
    assert target.read_text() == "old"
    assert list(tmp_path.iterdir()) == [target]


def test_missing_key_is_reported_with_its_place():
    document = located({"lights": [{"name": "Sun"}]}, "scene")
    with pytest.raises(InputError) as refusal:
        document["lights"][0]["color"]
    assert refusal.value.place == "scene.lights[0].color"


def test_graph_in_another_file_is_refused():
    document = located({"format": scene_io.FORMAT, "graph": {"file": "cloud.graph.json"}}, "scene")
    with pytest.raises(InputError, match=r"cloud\.graph\.json"):
        scene_io.check_format(document)
