"""A scene as Mitsuba's: what the translation says, and what it refuses. Mitsuba itself is not needed."""

import json
import math

import numpy as np
import pytest

from blend_support import ROOT
from mitsuba_scene import extinction, mitsuba_scene
from protocol import InputError, located
from scene_io import matrix_array

SCENE = ROOT / "parity" / "scenes" / "linear-ramp.scene.json"
# A turned, stretched and moved object.
TURNED = [[0.0, -2.0, 0.0, 0.2], [1.0, 0.0, 0.0, -0.1], [0.0, 0.0, 0.5, 0.15], [0.0, 0.0, 0.0, 1.0]]


def ramp(*changes):
    """The committed ramp with (path of keys, value) changed; "NODE.SOCKET" is an input of a node."""
    scene = json.loads(SCENE.read_text(encoding="utf-8"))
    nodes = {node["name"]: node for node in scene["graph"]["nodes"]}
    for path, value in changes:
        place = scene
        if isinstance(path, str):
            name, socket = path.split(".")
            path, place = ("inputs", socket), nodes[name]
        for key in path[:-1]:
            place = place[key]
        place[path[-1]] = value
    return located(scene, "scene")


def interpolated(grid, points):
    """Values of a grid volume at world points: trilinear between the centres of cells, clamped."""
    values, to_world = grid["grid"][..., 0].astype(np.float64), grid["to_world"]
    unit = (points - to_world[:3, 3]) @ np.linalg.inv(to_world[:3, :3]).T
    place = unit * values.shape[::-1] - 0.5
    low = np.floor(place).astype(int)
    total = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        cell = low + corner
        weight = np.prod(1 - np.abs(place - cell), axis=1)
        x, y, z = np.clip(cell, 0, np.array(values.shape[::-1]) - 1).T
        total += weight * values[z, y, x]
    return total


@pytest.mark.parametrize(
    ("changes", "slope"),
    [
        ([], [1.0, 1, 0, 0]),
        ([(("volume", "bounds", "min"), [-0.5, -1.0, 0.0])], [1.0, 1, 0, 0]),
        ([(("volume", "matrix_world"), TURNED)], [1.0, 1, 0, 0]),
        (
            [("Map Range.Value", {"node": "Separate XYZ", "socket": "Z"}), ("Map Range.To Min", 4.0)],
            [3.0, 0, 0, -1],
        ),
        ([("Principled Volume.Density", 0.75)], [0.75, 0, 0, 0]),
        # An absorption colour of 1 leaves only scattering, and colours above 1 scatter more than the density.
        (
            [
                ("Principled Volume.Color", [1.5, 1.5, 1.5, 1.0]),
                ("Principled Volume.Absorption Color", [1.0, 1.0, 1.0, 1.0]),
            ],
            [1.5, 1.5, 0, 0],
        ),
    ],
)
def test_the_grid_is_the_ramp_everywhere_in_the_box(changes, slope):
    scene = ramp(*changes)
    np.testing.assert_allclose(extinction(scene), slope, rtol=1e-15)
    bounds, to_world = scene["volume"]["bounds"], matrix_array(scene["volume"]["matrix_world"])
    points = np.random.default_rng(5).uniform(bounds["min"], bounds["max"], (200, 3))
    world = points @ to_world[:3, :3].T + to_world[:3, 3]
    found = interpolated(mitsuba_scene(scene)["cube"]["interior"]["sigma_t"], world)
    # Corners are f32, which holds these exactly; the rest is f64.
    np.testing.assert_allclose(found, slope[0] + points @ slope[1:], atol=1e-12)


def test_the_cube_of_mitsuba_fills_the_box():
    low, high = [-0.5, -1.0, 0.0], [1.0, 2.0, 3.0]
    changes = [(("volume", "bounds", "min"), low), (("volume", "bounds", "max"), high)]
    scene = ramp(*changes, (("volume", "matrix_world"), TURNED), ("Principled Volume.Density", 1.0))
    scene["camera"]["clip_start"] = 0.001
    to_world = mitsuba_scene(scene)["cube"]["to_world"]
    expected = matrix_array(TURNED)
    for sign, corner in ((-1, low), (1, high)):
        np.testing.assert_allclose(
            to_world @ [sign, sign, sign, 1], expected @ [*corner, 1], rtol=0, atol=1e-12
        )


@pytest.mark.parametrize(
    ("fit", "size", "axis", "sensor"),
    [
        ("AUTO", (64, 36), "x", 36.0),
        ("AUTO", (36, 64), "y", 36.0),
        ("HORIZONTAL", (36, 64), "x", 36.0),
        ("VERTICAL", (64, 36), "y", 24.0),
    ],
)
def test_the_camera_is_turned_and_keeps_its_angle(fit, size, axis, sensor):
    scene = ramp((("camera", "sensor_fit"), fit))
    matrix = scene["camera"]["matrix_world"]
    scene["camera"]["matrix_world"] = [[3 * value for value in row[:3]] + row[3:] for row in matrix[:3]] + [
        matrix[3]
    ]
    camera = mitsuba_scene(scene, size)["sensor"]
    assert camera["fov_axis"] == axis
    assert math.tan(math.radians(camera["fov"]) / 2) == pytest.approx(sensor / 150, rel=1e-12)
    left, up, forward, origin = camera["to_world"][:3].T
    # Cycles: +X to the right, +Y up, looking along -Z; the camera's scale of 3 does not count. f32 matrix.
    right, above, back, place = matrix_array(matrix)[:3].T
    for found, expected in ((left, -right), (up, above), (forward, -back), (origin, place)):
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-7)
    assert (camera["film"]["width"], camera["film"]["height"]) == size


def test_lights_medium_and_bounces():
    sun = ("lights", 0)
    scene = ramp(
        ((*sun, "exposure"), 1.0),
        ((*sun, "color"), [1.0, 0.5, 0.25]),
        ((*sun, "matrix_world"), TURNED),
        (("world", "strength"), 2.0),
        (("integrator", "volume_bounces"), 20),
    )
    found = mitsuba_scene(scene)
    assert found["integrator"]["max_depth"] == 14, "the smaller limit, 12, allows 13 scattering events"
    assert found["sun 0"]["direction"] == [0.0, 0.0, -1.0]
    assert found["sun 0"]["irradiance"]["value"] == [12.0, 6.0, 3.0]
    assert found["world"]["radiance"]["value"] == [0.04, 0.08, 0.16]
    medium = found["cube"]["interior"]
    np.testing.assert_allclose(medium["albedo"]["value"]["value"], [0.95, 0.9, 0.8], rtol=1e-7)
    assert medium["phase"] == {"type": "hg", "g": pytest.approx(0.3, rel=1e-7)}


LINK = {"node": "Separate XYZ", "socket": "X"}


@pytest.mark.parametrize(
    ("path", "value", "place"),
    [
        (("camera", "projection"), "orthographic", "scene.camera.projection"),
        (("camera", "shift"), [0.1, 0.0], "scene.camera.shift"),
        (("camera", "clip_start"), 7.0, "scene.camera.clip_start"),
        (("camera", "clip_end"), 7.0, "scene.camera.clip_start"),
        (("film", "pixel_filter"), "GAUSSIAN", "scene.film.pixel_filter"),
        (("film", "pixel_aspect"), [1.0, 2.0], "scene.film.pixel_aspect"),
        (("film", "exposure"), 2.0, "scene.film.exposure"),
        (("film", "transparent"), True, "scene.film.transparent"),
        (("lights", 0, "type"), "point", "scene.lights Sun.type"),
        (("lights", 0, "angle"), 0.009, "scene.lights Sun.angle"),
        (("world", "image"), {"file": "a.exr", "sha256": "0"}, "scene.world.image"),
        (("world", "graph"), {"material": "World", "nodes": []}, "scene.world.graph"),
        (("other_volumes",), [{}], "scene.other_volumes"),
        (("volume", "shape"), {"type": "mesh"}, "scene.volume.shape.type"),
        (("volume", "matrix_world", 0, 0), -1.0, "scene.volume.matrix_world"),
        (("graph", "nodes", 1, "properties", "from_instancer"), True, "Separate XYZ.Vector"),
        (("graph", "nodes", 2, "type"), "ShaderNodeTexNoise", "scene.graph Separate XYZ"),
        (("graph", "nodes", 3, "muted"), True, "scene.graph Map Range"),
        (("graph", "nodes", 3, "properties", "clamp"), True, "Map Range.clamp"),
        (("graph", "nodes", 3, "properties", "interpolation_type"), "SMOOTHSTEP", "interpolation_type"),
        (("graph", "nodes", 4, "type"), "ShaderNodeVolumeScatter", "scene.graph Principled Volume"),
        ("Separate XYZ.Vector", [0.0, 0.0, 0.0], "Separate XYZ.Vector"),
        ("Separate XYZ.Vector", {"node": "Texture Coordinate", "socket": "Generated"}, "Separate XYZ.Vector"),
        ("Map Range.To Max", LINK, "Map Range.To Max"),
        ("Map Range.From Max", -1.0, "Map Range.From Max"),
        ("Map Range.To Min", -0.1, "Principled Volume.Density"),
        ("Principled Volume.Anisotropy", LINK, "Principled Volume.Anisotropy"),
        ("Principled Volume.Emission Strength", 0.1, "Principled Volume.Emission Strength"),
        ("Principled Volume.Blackbody Intensity", 0.1, "Principled Volume.Blackbody Intensity"),
        ("Principled Volume.Color", LINK, "Principled Volume.Color"),
        ("Principled Volume.Absorption Color", [0.1, 0.1, 0.1, 1.0], "Principled Volume.Color"),
    ],
)
def test_what_cannot_be_expressed_is_refused_by_name(path, value, place):
    mitsuba_scene(ramp())
    with pytest.raises(InputError) as refusal:
        mitsuba_scene(ramp((path, value)))
    assert place in refusal.value.place
