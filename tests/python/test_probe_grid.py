"""The Cycles side of a probe: grids of Volume objects, and group outputs of files older than Blender 4.0."""

import numpy as np
import pytest

from blend_support import Recorder, link, node, requires_bpy, scene
from test_probe import job, results, target
from test_volume_objects import SPACING, depth

bpy = pytest.importorskip("bpy")

import point_probe  # noqa: E402
from probe_graph import grid_values  # noqa: E402

pytestmark = requires_bpy

TO_INDEX = [[4.0, 0.0, 0.0, 0.0], [0.0, 4.0, 0.0, 0.0], [0.0, 0.0, 4.0, 0.0]]


def test_values_stand_at_indices_and_fade_beyond_the_last():
    values = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    at = np.array([[0, 0, 0], [1, 2, 3], [0.5, 0, 0], [1, 2, 3.5], [1, 2, 4], [-9, 0, 0], [np.nan, 0, 0]])
    found = grid_values((at / 4).astype(np.float32), values, TO_INDEX)
    np.testing.assert_array_equal(found, np.array([0, 23, 6, 11.5, 0, 0, np.nan], np.float32))


def test_interpolated_values_have_the_depth_of_the_real_volume_object(tmp_path):
    """Cycles' picture of the grid itself, along one ray, and the integral of the interpolated values."""
    values = np.random.default_rng(5).uniform(0.2, 1.0, (8, 8, 8)).astype(np.float32)
    found, error = depth(tmp_path, values, scale=(1.0, 1.0, 1.0))
    z = np.linspace(-SPACING, 8 * SPACING, 4001)
    points = np.column_stack([np.full_like(z, 0.8), np.full_like(z, 0.8), z]).astype(np.float32)
    found_values = grid_values(points, values, TO_INDEX).astype(float)
    expected = (found_values[:-1] + found_values[1:]).sum() / 2 * (z[1] - z[0])
    assert expected > 1.0
    # Four standard errors of the picture; the integral's own error is below 1e-4.
    assert abs(found - expected) < 4 * error + 1e-4


def probed(folder, document, targets, points, grid=None):
    request = job(folder, document, targets, points=points)
    if grid is not None:
        np.save(folder / "grid.npy", grid)
        request["grid"] = {"values": str(folder / "grid.npy"), "to_index": TO_INDEX}
    warnings = Recorder()
    point_probe.PointProbe(0, warnings.warning).run(request)
    return results(request)


def test_density_of_principled_volume_holds_the_grid(tmp_path):
    points = np.random.default_rng(2).uniform(-0.3, 1.3, (500, 3)).astype(np.float32)
    grid = np.random.default_rng(3).uniform(0.0, 2.0, (4, 4, 4)).astype(np.float32)
    nodes = [
        node("P", "ShaderNodeTexCoord"),
        node("S", "ShaderNodeSeparateXYZ", {"Vector": link("P", "Object")}),
        node("A", "ShaderNodeAttribute", attribute_name="density", attribute_type="GEOMETRY"),
        node("M", "ShaderNodeMath", {"Value": link("A", "Fac"), "Value_001": 3.0}, operation="MULTIPLY"),
        node(
            "V",
            "ShaderNodeVolumePrincipled",
            {"Density": link("S", "X"), "Density Attribute": "density"},
        ),
        node("N", "ShaderNodeVolumePrincipled", {"Density": link("S", "X"), "Density Attribute": "other"}),
    ]
    targets = [
        target("V", "Density", side="input"),
        target("M", "Value"),
        target("N", "Density", side="input"),
    ]
    product, tripled, plain = probed(tmp_path / "job", scene(nodes), targets, points, grid)
    at = grid_values(points, grid, TO_INDEX)
    np.testing.assert_array_equal(product, np.maximum(points[:, 0], 0) * at)
    np.testing.assert_array_equal(tripled, at * np.float32(3))
    np.testing.assert_array_equal(plain, points[:, 0])
    assert np.count_nonzero(product) > 100


def test_group_outputs_are_found_by_the_identifiers_of_old_files(tmp_path):
    """Files of Blender 2.9 to 3.6 call a group's output Output_1; a group that is built gets Socket_0."""
    group = {
        "name": "G",
        "inputs": [],
        "outputs": [
            {"identifier": name, "name": label, "panel": None, "type": "float", "default": 0.0}
            for name, label in (("Output_1", "Low"), ("Output_7", "High"))
        ],
        "nodes": [
            node("Group Output", "NodeGroupOutput", {"Output_1": 2.0, "Output_7": link("Value", "Value")}),
            {**node("Value", "ShaderNodeValue"), "outputs": {"Value": 5.0}},
        ],
    }
    call = {"name": "C", "type": "ShaderNodeGroup", "location": [0.0, 0.0], "group": "G", "inputs": {}}
    points = np.zeros((3, 3), np.float32)
    targets = [target("C", "Output_1"), target("C", "Output_7")]
    low, high = probed(tmp_path / "job", scene([call], [group]), targets, points)
    np.testing.assert_array_equal(low, np.full(3, 2, np.float32))
    np.testing.assert_array_equal(high, np.full(3, 5, np.float32))
