"""Probing node values: golden values, bit-exactness, coordinates, inner outputs, refusals.

The golden values are those of Cycles' SSE4.2 kernel in Blender 5.0.1, nine digits, which identify an f32.
"""

import numpy as np
import pytest

from blend_support import Recorder, cloud_scene, link, matrix, node, requires_bpy, run_script, scene
from protocol import InputError, located

bpy = pytest.importorskip("bpy")

import point_probe  # noqa: E402
import probe_graph  # noqa: E402

pytestmark = requires_bpy

SSE42 = {"CYCLES_CPU_NO_AVX2": "1"}
POINTS = np.array([[0.3, 0.7, -0.4], [-2.6, 5.15, 1.05]], np.float32)
W = np.repeat(np.array([[0.9], [-3.35]], np.float32), 3, axis=1)
MINKOWSKI = {"distance": "MINKOWSKI", "normalize": True}
GOLDEN = {
    "Noise 3D": (
        node("N", "ShaderNodeTexNoise", {}, noise_dimensions="3D"),
        {
            "Fac": [0.464928567, 0.476706624],
            "Color": [[0.464928567, 0.416475058, 0.416167587], [0.476706624, 0.56085211, 0.640708089]],
        },
    ),
    "Voronoi 4D F1": (
        node("N", "ShaderNodeTexVoronoi", {"W": link("W", "Fac")}, voronoi_dimensions="4D"),
        {
            "Distance": [0.628801346, 0.761226833],
            "Color": [[0.852006257, 0.0374675728, 0.217809886], [0.720079005, 0.831457376, 0.950386703]],
            "Position": [[0.370401233, 0.60749352, -0.356438011], [-2.65598416, 5.16629171, 1.1900773]],
            "W": [0.879894912, -3.33745623],
        },
    ),
    "Voronoi 4D F1 Minkowski 1.5": (
        node(
            "N",
            "ShaderNodeTexVoronoi",
            {"W": link("W", "Fac"), "Detail": 2.4, "Exponent": 1.5, "Randomness": 0.8},
            voronoi_dimensions="4D",
            **MINKOWSKI,
        ),
        {"Distance": [0.268126935, 0.333096445], "W": [0.894403577, -3.36043167]},
    ),
    "Wave": (node("N", "ShaderNodeTexWave"), {"Fac": [0.422880232, 0.865004778]}),
    "White Noise 3D": (
        node("N", "ShaderNodeTexWhiteNoise", {}, noise_dimensions="3D"),
        {"Value": [0.878745914, 0.970394731]},
    ),
}


def target(name, socket, groups=(), side="output"):
    return {"groups": list(groups), "node": name, side: socket}


def job(folder, document, targets, points=POINTS, attributes=None):
    """A probe job whose arrays lie in `folder`."""
    folder.mkdir(exist_ok=True)
    files = {}
    for name, values in {"points": points, **(attributes or {})}.items():
        files[name] = str(folder / f"{name}.npy")
        np.save(files[name], values)
    return {
        "scene": document,
        "points": files.pop("points"),
        "attributes": files,
        "outputs": [
            {"target": item, "file": str(folder / f"out{index}.npy")} for index, item in enumerate(targets)
        ],
    }


def results(request):
    return [np.load(output["file"]) for output in request["outputs"]]


@pytest.fixture
def probe():
    """Runs one job in this process, with any kernel."""

    def run(*arguments, **options):
        request = job(*arguments, **options)
        point_probe.PointProbe(0, Recorder().warning).run(located(request, "job"))
        return results(request)

    return run


def test_golden_values_of_the_sse42_kernel(tmp_path):
    sources = [
        node("P", "ShaderNodeTexCoord"),
        node("W", "ShaderNodeAttribute", attribute_name="w", attribute_type="GEOMETRY"),
    ]
    jobs = []
    for name, (texture, outputs) in GOLDEN.items():
        texture = texture | {"inputs": {"Vector": link("P", "Object"), **texture["inputs"]}}
        targets = [target("N", socket) for socket in outputs]
        jobs.append(job(tmp_path / name, scene([*sources, texture]), targets, attributes={"w": W}))
    events, status = run_script("probe.py", {"jobs": jobs, "kernel": "sse42", "threads": 0}, SSE42)
    assert status == 0, events[-1]
    assert len([event for event in events if event["event"] == "progress"]) == len(jobs)
    for request, (_, outputs), answer in zip(
        jobs, GOLDEN.values(), events[-1]["result"]["jobs"], strict=True
    ):
        assert len(answer["render_seconds"]) == 1
        for values, expected, description in zip(
            results(request), outputs.values(), answer["outputs"], strict=True
        ):
            expected = np.array(expected, np.float32)
            assert description["components"] == (1 if expected.ndim == 1 else 3)
            np.testing.assert_array_equal(values, expected)


def test_every_f32_comes_back_bit_for_bit_except_negative_zero(probe, tmp_path):
    special = [1e30, -1e30, np.inf, -np.inf, np.nan, 0.0, -0.0, 1e-45, -1e-40, 3.4028235e38, 0.1, 16777217]
    random = np.random.default_rng(1).integers(0, 2**32, (3000, 3), np.uint32).view(np.float32)
    points = np.concatenate([np.repeat(np.array(special, np.float32)[:, None], 3, axis=1), random])
    nodes = [
        node("P", "ShaderNodeTexCoord"),
        node("A", "ShaderNodeAttribute", attribute_name="a", attribute_type="GEOMETRY"),
        node("S", "ShaderNodeSeparateXYZ", {"Vector": link("P", "Object")}),
    ]
    targets = [target("P", "Object"), target("A", "Vector"), target("S", "Y")]
    values = probe(tmp_path, scene(nodes), targets, points=points, attributes={"a": points[::-1]})
    for found, given in zip(values, (points, points[::-1], points[:, 1]), strict=True):
        expected = np.ascontiguousarray(given).view(np.uint32).copy()
        expected[given == 0] = 0
        expected[np.isnan(given)] |= 0x00400000  # a signalling NaN becomes a quiet one
        np.testing.assert_array_equal(found.view(np.uint32), expected)


def test_coordinates(probe, tmp_path):
    document = scene(
        [
            node("P", "ShaderNodeTexCoord"),
            node(
                "Q",
                "ShaderNodeTexCoord",
                object={"name": "Other", "matrix_world": matrix((1.0, 0.0, -2.0), (2.0, 4.0, 0.5))},
            ),
            node("G", "ShaderNodeNewGeometry"),
            node("V", "ShaderNodeTexVoronoi", voronoi_dimensions="3D"),
            node("E", "ShaderNodeTexVoronoi", {"Vector": link("P", "Generated")}, voronoi_dimensions="3D"),
        ]
    )
    document["volume"]["matrix_world"] = matrix((0.5, 0.25, 0.0), (2.0, 1.0, 1.0))
    document["volume"]["texture_space"] = {"location": [0.5, 0.0, 1.0], "size": [2.0, 0.0, 4.0]}
    targets = [target("P", "Generated"), target("Q", "Object"), target("G", "Position")]
    targets += [target("V", "Distance"), target("E", "Distance")]
    generated, other, world, implicit, explicit = probe(tmp_path, document, targets)
    placed = POINTS * np.float32([2, 1, 1]) + np.float32([0.5, 0.25, 0])
    np.testing.assert_allclose(world, placed, rtol=1e-7)
    np.testing.assert_allclose(other, (placed - [1, 0, -2]) / [2, 4, 0.5], rtol=1e-6)
    np.testing.assert_allclose(generated[:, 0], (POINTS[:, 0] + 1.5) / 4, rtol=1e-6)
    np.testing.assert_array_equal(generated[:, 1], 0.5)
    np.testing.assert_array_equal(implicit, explicit)


# Sheared, turned and moved.
OBJECT_MATRIX = [[0.9, -1.1, 0.3, 2.5], [0.7, 1.3, -0.2, -1.25], [0.1, 0.4, 1.9, 3.3], [0.0, 0.0, 0.0, 1.0]]


def transform(kind, source, goal):
    name = f"{kind} {source}"
    return node(
        name,
        "ShaderNodeVectorTransform",
        {"Vector": link("P", "Object")},
        vector_type=kind,
        convert_from=source,
        convert_to=goal,
    )


def test_the_grid_stands_for_the_object(probe, tmp_path):
    nodes = [node("P", "ShaderNodeTexCoord"), node("I", "ShaderNodeObjectInfo")]
    nodes += [transform("POINT", "OBJECT", "WORLD"), transform("VECTOR", "OBJECT", "WORLD")]
    nodes += [transform("POINT", "WORLD", "OBJECT"), transform("NORMAL", "WORLD", "OBJECT")]
    document = scene(nodes)
    document["volume"] |= {"object": "v", "matrix_world": OBJECT_MATRIX, "color": [0.25, 0.5, 2.0, 0.125]}
    document["volume"] |= {"pass_index": 7, "material_pass_index": 11}
    outputs = ("Location", "Color", "Alpha", "Object Index", "Material Index", "Random")
    targets = [target("I", name) for name in outputs] + [target(item["name"], "Vector") for item in nodes[2:]]
    points = np.random.default_rng(4).normal(0, 3, (300, 3)).astype(np.float32)
    location, color, alpha, index, material, random, *moved = probe(
        tmp_path, document, targets, points=points
    )
    for values, expected in (
        (location, np.float32([2.5, -1.25, 3.3])),
        (color, [0.25, 0.5, 2.0]),
        (alpha, 0.125),
        (index, 7),
        (material, 11),
        (random, np.float32(0.761823)),
    ):
        assert np.all(values == expected)
    to_world, linear, to_object, normal = moved
    matrix_ = np.array(OBJECT_MATRIX, np.float32)
    close = {"rtol": 1e-5, "atol": 1e-5}
    np.testing.assert_allclose(linear, points @ matrix_[:3, :3].T, **close)
    np.testing.assert_allclose(to_world, points @ matrix_[:3, :3].T + matrix_[:3, 3], **close)
    inverse = np.linalg.inv(matrix_.astype(np.float64))
    np.testing.assert_allclose(to_object, points @ inverse[:3, :3].T + inverse[:3, 3], **close)
    along = points.astype(np.float64) @ matrix_[:3, :3]
    np.testing.assert_allclose(normal, along / np.linalg.norm(along, axis=1)[:, None], atol=1e-6)


def test_an_object_that_the_grid_cannot_stand_for_is_refused(probe, tmp_path):
    document = scene([node("I", "ShaderNodeObjectInfo"), node("P", "ShaderNodeTexCoord")])
    document["volume"]["matrix_world"] = matrix((1e9, 0.0, 0.0))
    with pytest.raises(InputError) as refusal:
        probe(tmp_path, document, [target("I", "Random")])
    assert refusal.value.place == "job.scene.volume.matrix_world"
    # What does not look at the object is not bothered.
    document["graph"]["nodes"] = document["graph"]["nodes"][1:]
    (values,) = probe(tmp_path, document, [target("P", "Object")])
    np.testing.assert_array_equal(values, POINTS)


def test_a_texture_applies_its_own_mapping_unless_blender_folds_it(probe, tmp_path):
    mapping = {"vector_type": "POINT", "translation": [0.25, 0.0, 0.0]}
    document = scene(
        [
            node("P", "ShaderNodeTexCoord"),
            node("C", "ShaderNodeCombineXYZ", {"X": 0.5}),
            node("V", "ShaderNodeTexGradient", {"Vector": link("P", "Object")}, texture_mapping=mapping),
            node("F", "ShaderNodeTexGradient", {"Vector": link("C", "Vector")}, texture_mapping=mapping),
        ]
    )
    varying, folded = probe(tmp_path, document, [target("V", "Fac"), target("F", "Fac")])
    np.testing.assert_array_equal(varying, np.float32([0.3, 0]) + np.float32([0.25, 0]))
    np.testing.assert_array_equal(folded, [0.5, 0.5])


def test_a_constant_coordinate_of_a_texture_that_varies_counts_as_unlinked(probe, tmp_path, monkeypatch):
    """With the grid's own Generated coordinates, which the probe replaces only where nothing is linked."""
    monkeypatch.setattr(probe_graph, "_link_implicit_generated", lambda tree: None)
    constants = {"early": [0.5, 0.25, 2.0], "late": [0.25, 0.75, 0.5]}
    nodes = [
        node("A", "ShaderNodeAttribute", attribute_name="w", attribute_type="GEOMETRY"),
        node("S", "ShaderNodeSeparateXYZ", {"Vector": link("A", "Vector")}),
        node("early", "ShaderNodeCombineXYZ", dict(zip("XYZ", constants["early"], strict=True))),
        node(
            "late",
            "ShaderNodeCombineColor",
            dict(zip(("Red", "Green", "Blue"), constants["late"], strict=True)),
        ),
    ]
    vectors = {
        "unlinked": {},
        "early": {"Vector": link("early", "Vector")},
        "late": {"Vector": link("late", "Color")},
        "varies": {"Vector": link("A", "Vector")},
    }
    for kind, dimensions in (("Noise", "noise_dimensions"), ("Voronoi", "voronoi_dimensions")):
        nodes += [
            node(
                f"{kind} {name}",
                f"ShaderNodeTex{kind}",
                {"W": link("S", "X"), **vector},
                **{dimensions: "4D"},
            )
            for name, vector in vectors.items()
        ]
    targets = [target(f"Noise {name}", "Fac") for name in vectors]
    targets += [target(f"Voronoi {name}", "Distance") for name in vectors]
    values = probe(tmp_path, scene(nodes), targets, attributes={"w": W})
    for unlinked, early, late, varies in (values[:4], values[4:]):
        np.testing.assert_array_equal(early, unlinked)
        np.testing.assert_array_equal(late, unlinked)
        assert np.all(varies != unlinked)


def test_a_reroute_of_a_direction_keeps_its_links(probe, tmp_path):
    direction = node("N", "ShaderNodeNormal") | {"outputs": {"Normal": [0.0, 0.6, 0.8]}}
    reroute = node("R", "NodeReroute", {"Input": link("N", "Normal")}) | {"socket_type": "vector"}
    # What reads the reroute stands before it.
    reader = node("M", "ShaderNodeVectorMath", {"Vector": link("R", "Output")}, operation="ADD")
    (values,) = probe(tmp_path, scene([reader, reroute, direction]), [target("M", "Vector")])
    np.testing.assert_allclose(values, np.float32([[0.0, 0.6, 0.8]] * len(POINTS)), rtol=1e-6)


def test_inner_outputs_and_inputs_of_the_cloud(probe, tmp_path):
    points = np.random.default_rng(2).uniform(-1, 1, (500, 3)).astype(np.float32)
    inside = ["Group.001"]
    math = [
        item["name"]
        for item in cloud_scene()["graph"]["groups"][0]["nodes"]
        if item["type"] == "ShaderNodeMath"
    ]
    targets = [target("Principled Volume", "Density", side="input"), target("Group.001", "Socket_0")]
    targets += [target("Group Output", "Socket_0", inside, "input"), target("Math.016", "Value", inside)]
    targets += [target("Math.005", "Value", inside), target("Math.001", "Value", inside)]
    targets += [
        target("Noise Texture", "Scale", inside, "input"),
        target("Noise Texture", "W", inside, "input"),
    ]
    targets += [target("Principled Volume", "Color", side="input")]
    # Enough to need a second render.
    targets += [target(name, "Value", inside) for name in math] * 2
    density, outside, output, last, left, right, scale, time, color, *_ = probe(
        tmp_path, cloud_scene(), targets, points=points
    )
    assert len(targets) > point_probe.MAX_AOVS
    assert (density > 0).any()
    for same in (outside, output, last, left * right):
        np.testing.assert_array_equal(same, density)
    assert np.all(scale == 2)
    assert np.all(time == 0)
    np.testing.assert_array_equal(color, np.ones((500, 3)))


def test_more_points_than_one_grid_holds(probe, tmp_path, monkeypatch):
    monkeypatch.setattr(point_probe, "LARGEST_SIDE", 8)
    points = np.arange(3 * 150, dtype=np.float32).reshape(-1, 3)
    (values,) = probe(
        tmp_path, scene([node("P", "ShaderNodeTexCoord")]), [target("P", "Object")], points=points
    )
    np.testing.assert_array_equal(values, points)


@pytest.mark.parametrize(
    ("wrong", "asked", "message"),
    [
        (
            node("T", "ShaderNodeVectorTransform", convert_to="CAMERA"),
            target("T", "Vector"),
            "depends on the camera",
        ),
        (node("G", "ShaderNodeNewGeometry"), target("G", "Normal"), "depends on the shaded object"),
        (node("C", "ShaderNodeTexCoord"), target("C", "UV"), "depends on the shaded object"),
        (node("C", "ShaderNodeMath"), target("D", "Value"), 'node "D"'),
        (node("C", "ShaderNodeMath"), target("C", "Result"), "choose a socket"),
        (node("C", "ShaderNodeMath"), target("C", "Value", ["C"]), "a group that is not muted"),
        (node("C", "ShaderNodeEmission"), target("C", "Emission"), "choose a socket"),
    ],
)
def test_refusals(probe, tmp_path, wrong, asked, message):
    with pytest.raises(InputError, match=message):
        probe(tmp_path, scene([wrong]), [asked])
    assert not list(tmp_path.glob("out*"))
    assert not bpy.data.materials


@pytest.mark.parametrize("points", [POINTS.astype(np.float64), POINTS[:0], POINTS[:, :2]])
def test_points_of_another_kind_are_refused(probe, tmp_path, points):
    with pytest.raises(InputError) as refusal:
        probe(tmp_path, scene([node("P", "ShaderNodeTexCoord")]), [target("P", "Object")], points=points)
    assert refusal.value.place == "job.points"
    assert "float32 [n, 3]" in refusal.value.expected
