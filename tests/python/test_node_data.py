"""Color ramps and curves between Blender and the scene format: nothing lost, nothing changed silently."""

import json

import pytest

from blend_support import Recorder, absorbing_nodes, link, node, principled_nodes, requires_bpy, scene
from protocol import InputError, located
from scene_io import format_scene

bpy = pytest.importorskip("bpy")

from build_scene import handle as build  # noqa: E402
from export_scene import handle as export  # noqa: E402

pytestmark = requires_bpy

RAMP = {
    "interpolation": "B_SPLINE",
    "hue_interpolation": "CCW",
    "color_mode": "HSL",
    "elements": [
        {"position": 0.1, "color": [0.2, 0.3, 0.4, 0.5]},
        {"position": 0.7, "color": [1.5, 0.0, 0.25, 1.0]},
        {"position": 0.7, "color": [0.0, 1.0, 0.0, 0.0]},
    ],
}
MAPPING = {
    "extend": "HORIZONTAL",
    "use_clip": True,
    "clip": [0.25, -3.0, 2.5, 0.7],
    "curves": [[[-0.7, 0.1, "AUTO"], [0.3, 2.7, "AUTO_CLAMPED"], [3.3, -1.1, "VECTOR"]]],
}


def reached(entry, output):
    """A scene whose density comes from the node `entry`."""
    return scene([*absorbing_nodes(link(entry["name"], output)), entry])


def exported(path):
    messages = Recorder()
    document = export(located({"blend": str(path), "object": None}, "request"), messages)["scene"]
    return document, messages.warnings


def built(document, path):
    document = located(json.loads(json.dumps(document)), "scene")
    build(located({"blend": str(path)}, "request") | {"scene": document}, Recorder())
    return path


def saved(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


def properties(document, name):
    return next(item["properties"] for item in document["graph"]["nodes"] if item["name"] == name)


def assert_round_trip(document, folder):
    again, warnings = exported(built(document, folder / "again.blend"))
    assert not warnings
    assert format_scene(again) == format_scene(document)


@pytest.fixture
def ramp(tmp_path):
    """A new Color Ramp that colours the small scene, left open: (its ramp, path to save to)."""
    entry = node("Ramp", "ShaderNodeValToRGB")
    built(scene([*principled_nodes({"Color": link("Ramp", "Color")}), entry]), tmp_path / "ramp.blend")
    tree = bpy.data.materials["Material"].node_tree
    return tree.nodes["Ramp"].color_ramp, tmp_path / "changed.blend"


@pytest.fixture
def curves(tmp_path):
    """The same with new RGB Curves."""
    entry = node("Curves", "ShaderNodeRGBCurve")
    built(scene([*principled_nodes({"Color": link("Curves", "Color")}), entry]), tmp_path / "curves.blend")
    tree = bpy.data.materials["Material"].node_tree
    return tree.nodes["Curves"].mapping, tmp_path / "changed.blend"


def test_a_ramp_survives(ramp, tmp_path):
    data, path = ramp
    data.interpolation, data.color_mode, data.hue_interpolation = "EASE", "HSV", "FAR"
    data.elements.new(0.3).color = (0.1, 0.2, 0.3, 0.4)
    data.elements.new(0.3).color = (0.9, 3.0, 0.0, 1.0)
    document, warnings = exported(saved(path))
    assert not warnings
    found = properties(document, "Ramp")["color_ramp"]
    assert [item["position"] for item in found["elements"]] == [0.0, 0.3, 0.3, 1.0]
    assert found["color_mode"] == "HSV"
    assert_round_trip(document, tmp_path)


def test_a_ramp_of_one_element_and_stored_disorder_survive(ramp, tmp_path):
    data, path = ramp
    data.elements[0].position = 0.9
    data.elements[1].position = 0.2
    document, _ = exported(saved(path))
    assert [item["position"] for item in properties(document, "Ramp")["color_ramp"]["elements"]] == [0.9, 0.2]
    assert_round_trip(document, tmp_path)
    del properties(document, "Ramp")["color_ramp"]["elements"][1]
    assert_round_trip(document, tmp_path)


def test_curves_survive(curves, tmp_path):
    mapping, path = curves
    mapping.extend, mapping.use_clip = "HORIZONTAL", False
    mapping.clip_min_x, mapping.clip_max_y = -0.5, 1.7
    points = mapping.curves[3].points
    points.new(0.3, 2.5).handle_type = "VECTOR"
    points.new(-1.5, 0.1).handle_type = "AUTO_CLAMPED"
    mapping.update()
    document, warnings = exported(saved(path))
    assert not warnings
    found = properties(document, "Curves")["mapping"]
    assert found["clip"] == [-0.5, 0.0, 1.0, 1.7]
    assert [len(points) for points in found["curves"]] == [2, 2, 2, 4]
    assert found["curves"][3][0] == [-1.5, 0.1, "AUTO_CLAMPED"]
    assert_round_trip(document, tmp_path)


@pytest.mark.parametrize("kind", ["ShaderNodeFloatCurve", "ShaderNodeRGBCurve", "ShaderNodeVectorCurve"])
def test_default_curves_survive(kind, tmp_path):
    output = {"ShaderNodeFloatCurve": "Value", "ShaderNodeRGBCurve": "Color"}.get(kind, "Vector")
    document, _ = exported(built(reached(node("Curves", kind), output), tmp_path / "default.blend"))
    assert properties(document, "Curves")["mapping"]["extend"] == "EXTRAPOLATED"
    assert_round_trip(document, tmp_path)


def test_what_blender_evaluates_is_what_was_given(tmp_path):
    built(reached(node("Curve", "ShaderNodeFloatCurve", mapping=MAPPING), "Value"), tmp_path / "a.blend")
    mapping = bpy.data.materials["Material"].node_tree.nodes["Curve"].mapping
    curve = mapping.curves[0]
    assert [tuple(point.location) for point in curve.points] == [
        pytest.approx(point[:2]) for point in MAPPING["curves"][0]
    ]
    # Horizontal beyond the ends, through the points, rising before the largest one.
    assert mapping.evaluate(curve, -9.0) == pytest.approx(0.1)
    assert mapping.evaluate(curve, 9.0) == pytest.approx(-1.1)
    assert mapping.evaluate(curve, 0.3) == pytest.approx(2.7, abs=0.01)


def test_points_in_disorder_are_written_in_order(curves, tmp_path):
    mapping, path = curves
    points = mapping.curves[0].points
    points[0].location, points[1].location = (0.9, 0.2), (0.1, 0.6)
    document, _ = exported(saved(path))
    found = properties(document, "Curves")["mapping"]["curves"][0]
    assert found == [[0.1, 0.6, "AUTO"], [0.9, 0.2, "AUTO"]]
    assert_round_trip(document, tmp_path)


def test_a_selected_point_that_blender_would_move_is_refused(curves):
    mapping, path = curves
    point = mapping.curves[1].points[1]
    point.location = (1.5, 0.5)
    point.select = True
    with pytest.raises(InputError, match="selected curve point"):
        exported(saved(path))
    mapping = bpy.data.materials["Material"].node_tree.nodes["Curves"].mapping
    mapping.use_clip = False
    document, _ = exported(saved(path))
    assert properties(document, "Curves")["mapping"]["curves"][1][1] == [1.5, 0.5, "AUTO"]


def test_levels_of_curves_are_refused(curves):
    mapping, path = curves
    mapping.white_level = (1.0, 2.0, 1.0)
    with pytest.raises(InputError, match="white_level"):
        exported(saved(path))


def changed(value, path, new):
    """A copy of JSON `value` where the member at `path` is `new`."""
    copy = json.loads(json.dumps(value))
    *parents, last = path
    inside = copy
    for key in parents:
        inside = inside[key]
    inside[last] = new
    return copy


@pytest.mark.parametrize(
    ("path", "wrong", "place"),
    [
        (["interpolation"], "CUBIC", ".interpolation"),
        (["elements"], [], ".elements"),
        (["elements"], [RAMP["elements"][0]] * 33, ".elements"),
        (["elements", 1, "position"], 1.5, ".elements[1].position"),
        (["elements", 2, "color"], [1.0, 1.0, 1.0], ".elements[2].color"),
        (["elements", 0, "color", 1], -0.5, ".elements[0].color"),
        (["elements", 0, "alpha"], 1.0, ".elements[0]"),
        (["steps"], 3, ""),
    ],
)
def test_a_ramp_that_blender_would_change_is_refused(path, wrong, place, tmp_path):
    entry = node("N", "ShaderNodeValToRGB", color_ramp=changed(RAMP, path, wrong))
    with pytest.raises(InputError) as refusal:
        built(reached(entry, "Color"), tmp_path / "wrong.blend")
    assert refusal.value.place == f"graph.nodes[N].properties.color_ramp{place}"


@pytest.mark.parametrize(
    ("path", "wrong", "place"),
    [
        (["extend"], "REPEAT", ".extend"),
        (["clip"], [0.0, 0.0, 1.0], ".clip"),
        (["clip", 2], 0.1, ".clip (clip_max_x)"),
        (["curves"], MAPPING["curves"] * 2, ".curves"),
        (["curves", 0], MAPPING["curves"][0][:1], ".curves[0]"),
        (["curves", 0], MAPPING["curves"][0][::-1], ".curves[0]"),
        (["curves", 0, 1], [0.5, 0.5], ".curves[0][1]"),
        (["curves", 0, 1, 2], "FREE", ".curves[0][1]"),
    ],
)
def test_curves_that_blender_would_change_are_refused(path, wrong, place, tmp_path):
    entry = node("N", "ShaderNodeFloatCurve", mapping=changed(MAPPING, path, wrong))
    with pytest.raises(InputError) as refusal:
        built(reached(entry, "Value"), tmp_path / "wrong.blend")
    assert refusal.value.place == f"graph.nodes[N].properties.mapping{place}"


def test_a_ramp_on_a_node_without_one_is_refused(tmp_path):
    with pytest.raises(InputError, match="color_ramp of a ShaderNodeMath"):
        built(reached(node("N", "ShaderNodeMath", color_ramp=RAMP), "Value"), tmp_path / "wrong.blend")
