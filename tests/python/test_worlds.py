"""Worlds: nodes that are evaluated as they are, and pictures that are missing from their place."""

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from blend_support import Recorder, built_program, requires_bpy
from protocol import located

bpy = pytest.importorskip("bpy")

import bmesh  # noqa: E402

import world_reader  # noqa: E402
from build_scene import handle as build  # noqa: E402
from export_scene import handle as export  # noqa: E402

pytestmark = requires_bpy

# What these tests let the caller evaluate; the program's own list is longer.
EVALUATED = {
    "ShaderNodeBackground": None,
    "ShaderNodeTexGradient": None,
    "ShaderNodeMapping": None,
    "ShaderNodeTexCoord": ["Generated", "Normal"],
}
# One ray through the centre of each pixel, without noise.
EXACT = {"samples": 1, "seed": 0, "pixel_filter_type": "BLACKMAN_HARRIS", "filter_width": 0.01}
# A picture is judged as 24 x 16 pixels of 4 x 4 sub-pixels, which stand for replicas.
SUB_PIXELS = 4
SIZE = (24 * SUB_PIXELS, 16 * SUB_PIXELS)
SAMPLES = 64


@pytest.fixture
def tree():
    """The node tree of the world around a cube of fog, both of which the camera sees."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.world = bpy.data.worlds.new("World")
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location, camera.rotation_euler = (0, -7, 0), (math.pi / 2, 0, 0)
    camera.data.lens = 30
    scene.collection.objects.link(camera)
    scene.camera = camera
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    mesh = bpy.data.meshes.new("Fog")
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=2)
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(_fog())
    scene.collection.objects.link(bpy.data.objects.new("Fog", mesh))
    return scene.world.node_tree


def _fog():
    material = bpy.data.materials.new("Fog")
    tree = material.node_tree
    tree.nodes.clear()
    closure = tree.nodes.new("ShaderNodeVolumeScatter")
    closure.inputs["Color"].default_value = (0.9, 0.8, 0.7, 1)
    closure.inputs["Density"].default_value = 0.7
    closure.inputs["Anisotropy"].default_value = 0.3
    tree.links.new(tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"], closure.outputs[0])
    return material


def new(tree, kind, inputs=None, **settings):
    """A node of a tree. `inputs` {name or number: value, or the output socket that is linked to it}."""
    node = tree.nodes.new(f"ShaderNode{kind}")
    for name, value in settings.items():
        setattr(node, name, value)
    for name, value in (inputs or {}).items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(node.inputs[name], value)
        else:
            node.inputs[name].default_value = value
    return node


def show(tree, color, strength=1.0):
    """Link an output to the colour of the world's Background."""
    background = tree.nodes["Background"]
    tree.links.new(background.inputs["Color"], color)
    background.inputs["Strength"].default_value = strength


def ramp(tree, value, *stops):
    """A Color Ramp's colour; `stops` are (position, grey)."""
    node = new(tree, "ValToRGB", {0: value})
    elements = node.color_ramp.elements
    while len(elements) < len(stops):
        elements.new(0.5)
    for element, (position, grey) in zip(elements, stops, strict=True):
        element.position, element.color = position, (grey, grey * 0.9, grey * 0.7, 1)
    return node.outputs[0]


# The worlds of the comparison with Cycles.


def stars_by_voronoi(tree):
    """Bright points on black, much smaller than a pixel of any picture of them."""
    direction = new(tree, "TexCoord").outputs["Generated"]
    cells = new(tree, "TexVoronoi", {"Vector": direction, "Scale": 60.0})
    show(tree, ramp(tree, cells.outputs["Distance"], (0.0, 1.0), (0.1, 0.0)), 40.0)


def stars_by_noise(tree):
    """A texture without a link reads Generated."""
    noise = new(tree, "TexNoise", {"Scale": 90.0, "Detail": 2.0})
    show(tree, ramp(tree, noise.outputs[0], (0.68, 0.0), (0.75, 1.0)), 10.0)


def gradient_sky(tree):
    up = new(tree, "Mapping", {0: new(tree, "TexCoord").outputs["Normal"]})
    up.inputs["Rotation"].default_value = (0.0, math.pi / 2, 0.2)
    show(tree, ramp(tree, new(tree, "TexGradient", {0: up.outputs[0]}).outputs[0], (0.0, 0.1), (1.0, 1.5)))


def gradient_by_separate(tree):
    parts = new(tree, "SeparateXYZ", {0: new(tree, "NewGeometry").outputs["Incoming"]})
    height = new(tree, "MapRange", {0: parts.outputs["Z"], 1: -1.0, 2: 1.0})
    show(tree, ramp(tree, height.outputs[0], (0.2, 1.0), (0.5, 0.4), (0.8, 0.05)))


def rotated_checker(tree):
    coordinates = new(tree, "Mapping", {0: new(tree, "TexCoord").outputs["Object"]}, vector_type="TEXTURE")
    coordinates.inputs["Rotation"].default_value = (0.3, 0.5, 0.7)
    coordinates.inputs["Location"].default_value = (0.01, 0.02, 0.03)
    checker = new(tree, "TexChecker", {"Vector": coordinates.outputs[0], "Scale": 3.0})
    checker.inputs["Color1"].default_value = (0.9, 0.6, 0.2, 1)
    checker.inputs["Color2"].default_value = (0.05, 0.1, 0.3, 1)
    show(tree, checker.outputs[0], 2.0)


def magic_of_another_hue(tree):
    magic = new(tree, "TexMagic", {"Scale": 2.0, "Distortion": 1.5}, turbulence_depth=3)
    show(
        tree,
        new(tree, "HueSaturation", {"Hue": 0.7, "Saturation": 0.6, "Color": magic.outputs[0]}).outputs[0],
    )


def two_backgrounds(tree):
    """A Mix of two, by a factor that goes beyond 0 and 1, and a third that is added."""
    noise = new(tree, "TexNoise", {"Scale": 4.0})
    factor = new(tree, "MapRange", {0: noise.outputs[0], 1: 0.4, 2: 0.6, 3: -0.2, 4: 1.2}, clamp=False)
    other = new(tree, "Background", {0: (0.1, 0.3, 0.9, 1), 1: 2.0})
    wave = new(tree, "TexWave", {"Scale": 1.5})
    third = new(tree, "Background", {0: (0.2, 0.1, 0.0, 1), 1: wave.outputs["Fac"]})
    mix = new(tree, "MixShader", {0: factor.outputs[0], 1: tree.nodes["Background"].outputs[0]})
    tree.links.new(mix.inputs[2], other.outputs[0])
    add = new(tree, "AddShader", {0: mix.outputs[0], 1: third.outputs[0]})
    tree.links.new(tree.nodes["World Output"].inputs["Surface"], add.outputs[0])


def groups(tree):
    """A group with a closure of its own inside, and a value that goes in."""
    inside = bpy.data.node_groups.new("Glow", "ShaderNodeTree")
    inside.interface.new_socket("Scale", in_out="INPUT", socket_type="NodeSocketFloat")
    inside.interface.new_socket("Shader", in_out="OUTPUT", socket_type="NodeSocketShader")
    begin, end = inside.nodes.new("NodeGroupInput"), inside.nodes.new("NodeGroupOutput")
    noise = new(inside, "TexNoise", {"Scale": begin.outputs[0]})
    background = new(inside, "Background", {0: noise.outputs["Color"], 1: 1.5})
    inside.links.new(end.inputs[0], background.outputs[0])
    group = tree.nodes.new("ShaderNodeGroup")
    group.node_tree = inside
    group.inputs[0].default_value = 3.0
    tree.links.new(tree.nodes["World Output"].inputs["Surface"], group.outputs[0])


def muted_nodes(tree):
    """A muted node hands on what it reads, a muted closure its first one; a muted link carries nothing."""
    parts = new(tree, "SeparateXYZ", {0: new(tree, "TexCoord").outputs["Reflection"]})
    half = new(tree, "Math", {0: parts.outputs["X"], 1: 0.7}, operation="MULTIPLY_ADD", mute=True)
    bright = new(tree, "Math", {0: half.outputs[0], 1: 1.1}, operation="ADD")
    show(tree, bright.outputs[0])
    other = new(tree, "Background", {0: (1, 0, 0, 1), 1: 9.0})
    mix = new(tree, "MixShader", {1: tree.nodes["Background"].outputs[0], 2: other.outputs[0]}, mute=True)
    tree.links.new(tree.nodes["World Output"].inputs["Surface"], mix.outputs[0])
    ignored = new(tree, "Value")
    ignored.outputs[0].default_value = 50.0
    tree.links.new(tree.nodes["Background"].inputs["Strength"], ignored.outputs[0]).is_muted = True


def object_and_emission(tree):
    """Coordinates of another object, and Emission in place of a Background."""
    pointer = bpy.data.objects.new("Pointer", None)
    bpy.context.scene.collection.objects.link(pointer)
    # Cycles inverts the matrix in f32, and we do in f64: of these numbers both inverses are exact.
    pointer.location, pointer.scale = (0.25, 0.125, 0.5), (0.5, 1.0, 2.0)
    seen = new(tree, "TexCoord", object=pointer).outputs["Object"]
    noise = new(tree, "TexNoise", {"Vector": seen, "Scale": 2.0})
    emission = new(tree, "Emission", {0: noise.outputs["Color"], 1: 2.0})
    tree.links.new(tree.nodes["World Output"].inputs["Surface"], emission.outputs[0])


def normals_as_colour(tree):
    """A value at Surface, without a closure: what emits is also negative."""
    seen = new(tree, "NewGeometry").outputs["True Normal"]
    shifted = new(tree, "VectorMath", {0: seen, 1: (0.5, 0.9, 1.0)}, operation="ADD")
    tree.links.new(tree.nodes["World Output"].inputs["Surface"], shifted.outputs[0])


WORLDS = [
    stars_by_voronoi,
    stars_by_noise,
    gradient_sky,
    gradient_by_separate,
    rotated_checker,
    magic_of_another_hue,
    two_backgrounds,
    groups,
    muted_nodes,
    object_and_emission,
    normals_as_colour,
]
named = pytest.mark.parametrize("world", WORLDS, ids=lambda world: world.__name__)


def exported(folder, **request):
    """Save the open file and export it; the scene, the warnings as text, and the files beside it."""
    path = folder / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    messages = Recorder()
    beside = folder / "beside"
    beside.mkdir(exist_ok=True)
    whole = {"blend": str(path), "object": None, "folder": str(beside), "world_nodes": EVALUATED} | request
    result = export(located(whole, "request"), messages)
    return result["scene"], [f"{place}: {message}" for place, message in messages.warnings], result["files"]


def program(*arguments, status=0):
    """Run the program; what it prints."""
    finished = subprocess.run(
        [str(built_program()), *map(str, arguments)], capture_output=True, text=True, stdin=subprocess.DEVNULL
    )
    assert finished.returncode == status, finished.stdout + finished.stderr
    return finished.stdout, finished.stderr


def by_cycles(folder, **settings):
    """The open scene by Cycles, f32 [row from the bottom, column, 3], and its file."""
    scene = bpy.context.scene
    cycles, render = scene.cycles, scene.render
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_indirect = cycles.sample_clamp_direct = 0.0
    # The film is written as it is.
    for name, value in ({"max_bounces": 12, "volume_bounces": 0} | EXACT | settings).items():
        setattr(cycles, name, value)
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.filepath = str(folder / "cycles.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    image.colorspace_settings.name = "Linear Rec.709"
    values = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], -1)
    bpy.data.images.remove(image)
    return values[..., :3], Path(render.filepath)


# Renders the world of a file twice, by the same rays: what it sends, and the direction that it is asked for.
# The bits are those of Cycles' SSE4.2 kernel, which a process chooses once.
SAME_RAYS = """
import sys
import bpy, numpy as np
blend, folder = sys.argv[1:]
bpy.ops.wm.open_mainfile(filepath=blend)
scene = bpy.context.scene
bpy.data.objects.remove(bpy.data.objects["Fog"])
cycles, render = scene.cycles, scene.render
cycles.samples, cycles.seed, cycles.use_adaptive_sampling, cycles.use_denoising = 1, 0, False, False
render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
tree = scene.world.node_tree
for name in ("values", "directions"):
    if name == "directions":
        background = tree.nodes.new("ShaderNodeBackground")
        seen = tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"]
        tree.links.new(background.inputs["Color"], seen)
        tree.links.new(tree.get_output_node("CYCLES").inputs["Surface"], background.outputs[0])
    render.filepath = f"{folder}/{name}.exr"
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    image.colorspace_settings.name = "Linear Rec.709"
    pixels = np.empty(image.size[0] * image.size[1] * image.channels, np.float32)
    image.pixels.foreach_get(pixels)
    np.save(f"{folder}/{name}.npy", pixels.reshape(-1, image.channels)[:, :3])
"""


@named
def test_every_direction_has_the_bits_of_cycles(tree, tmp_path, world):
    world(tree)
    scene, blend = tmp_path / "world.scene.json", tmp_path / "world.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    program("export", blend, "-o", scene)
    assert "graph" in json.loads(scene.read_text())["world"]
    command = [sys.executable, "-c", SAME_RAYS, blend, tmp_path]
    subprocess.run(command, check=True, capture_output=True, env=os.environ | {"CYCLES_CPU_NO_AVX2": "1"})
    directions, values = (np.load(tmp_path / f"{name}.npy") for name in ("directions", "values"))
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max() < 1e-6 and np.ptp(values) > 0.01
    found = tmp_path / "found.npy"
    program("eval", scene, "--target", "world", "--points", tmp_path / "directions.npy", "-o", found)
    np.testing.assert_array_equal(np.load(found), values)


@named
def test_the_scene_builds_the_world_that_it_was_read_from(tree, tmp_path, world):
    world(tree)
    blend, scene = tmp_path / "world.blend", tmp_path / "world.scene.json"
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    program("export", blend, "-o", scene)
    again, second = tmp_path / "again.blend", tmp_path / "again.scene.json"
    program("export", scene, "-o", again)
    program("export", again, "-o", second)
    assert json.loads(second.read_text())["world"] == json.loads(scene.read_text())["world"]


@pytest.mark.parametrize("world", [gradient_sky, two_backgrounds], ids=lambda world: world.__name__)
def test_fog_is_lit_by_the_nodes_as_in_cycles(tree, tmp_path, world):
    world(tree)
    verdict, _ = compare(tmp_path)
    assert verdict["verdict"] == "agrees", verdict


def compare(folder):
    """The open file's picture by path tracing against Cycles': what `diff` prints, and its status."""
    blend, scene, ours = (folder / name for name in ("world.blend", "world.scene.json", "ours.exr"))
    bpy.context.scene.cycles.pixel_filter_type = "BOX"
    bpy.context.scene.cycles.volume_bounces = 2
    bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
    program("export", blend, "-o", scene)
    program("render", scene, "--integrator", "path", "--samples", SAMPLES, "--seed", 100, "-o", ours)
    settings = {"samples": SAMPLES, "seed": 5000, "pixel_filter_type": "BOX", "volume_bounces": 2}
    # Cycles' own null collisions, as in every reference.
    bpy.context.scene.cycles.volume_biased = False
    _, reference = by_cycles(folder, **settings)
    command = ["diff", "--ours", ours, "--reference", reference, "--pixels-as-replicas", SUB_PIXELS, "--json"]
    finished = subprocess.run([str(built_program()), *map(str, command)], capture_output=True, text=True)
    assert finished.stdout.startswith("{"), finished.stdout + finished.stderr
    return json.loads(finished.stdout), finished.returncode


# What is read as what


def test_a_world_of_nodes_is_a_graph(tree, tmp_path):
    gradient_like = new(tree, "TexGradient", {0: new(tree, "TexCoord").outputs["Normal"]})
    show(tree, gradient_like.outputs[0], 2.0)
    # A node that reaches nothing needs no evaluation.
    new(tree, "TexSky")
    document, warnings, files = exported(tmp_path)
    world = document["world"]
    assert (world["color"], world["strength"]) == ([1.0, 1.0, 1.0], 1.0)
    assert world["graph"]["material"] == "World" and not files
    assert {node["type"] for node in world["graph"]["nodes"]} >= {
        "ShaderNodeTexGradient",
        "ShaderNodeOutputWorld",
    }
    assert not any("picture" in warning for warning in warnings)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    again = tmp_path / "again.blend"
    build(located({"scene": document, "blend": str(again), "folder": None}, "request"), Recorder())
    messages = Recorder()
    request = {"blend": str(again), "object": None, "folder": str(tmp_path), "world_nodes": EVALUATED}
    assert export(located(request, "request"), messages)["scene"]["world"] == world


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda tree: new(tree, "TexWave").outputs[0], 'node "Wave Texture" (ShaderNodeTexWave) is none'),
        (lambda tree: new(tree, "TexCoord").outputs["Reflection"], "is read at its output Reflection"),
    ],
)
def test_what_the_caller_does_not_evaluate_is_a_picture_with_its_reason(tree, tmp_path, change, reason):
    show(tree, change(tree))
    document, warnings, files = exported(tmp_path)
    assert list(files) == [document["world"]["image"]["file"]]
    assert reason in warnings[0] and "rendered by Cycles" in warnings[1]


def test_a_world_of_constants_is_a_constant(tree, tmp_path):
    color = new(tree, "RGB")
    color.outputs[0].default_value = (0.25, 0.5, 1, 1)
    show(tree, color.outputs[0], 2.0)
    document, warnings, _ = exported(tmp_path, world_nodes=EVALUATED | {"ShaderNodeRGB": None})
    assert document["world"] == {"color": [0.5, 1.0, 2.0], "strength": 1.0} and not warnings


# Pictures that are missing


def gone(folder):
    """A file that was there when the scene was made."""
    made = bpy.data.images.new("made", 8, 8)
    made.filepath_raw, made.file_format = str(folder / "sky.png"), "PNG"
    made.save()
    image = bpy.data.images.load(made.filepath_raw)
    Path(made.filepath_raw).unlink()
    image.reload()
    return image, "there is no file"


def unreadable(folder):
    (folder / "sky.exr").write_bytes(b"no picture" * 40)
    return bpy.data.images.load(str(folder / "sky.exr")), "cannot be read as a picture"


def packed_unreadable(folder):
    image, reason = unreadable(folder)
    image.pack()
    (folder / "sky.exr").unlink()
    return image, reason


def sequence(folder):
    image, _ = gone(folder)
    image.source = "SEQUENCE"
    image.filepath = str(folder / "frame_0001.png")
    return image, "frame_0007.png"


def movie(folder):
    image, reason = gone(folder)
    image.source = "MOVIE"
    image.filepath = str(folder / "sky.mp4")
    return image, reason


def tiles(folder):
    image, reason = gone(folder)
    image.source = "TILED"
    image.filepath = str(folder / "sky.<UDIM>.png")
    return image, reason


def of_a_library(folder):
    library = folder / "library.blend"
    made = bpy.data.images.new("sky of a library", 4, 4)
    bpy.data.libraries.write(str(library), {made})
    bpy.data.images.remove(made)
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.images = ["sky of a library"]
    (image,) = wanted.images
    library.unlink()
    return image, "library.blend"


def nothing(_):
    return None, "none is chosen"


@pytest.mark.parametrize("kind", ["TexEnvironment", "TexImage"])
@pytest.mark.parametrize("missing", [gone, unreadable, packed_unreadable, sequence, movie, tiles, nothing])
def test_a_missing_picture_is_magenta_as_in_cycles(tree, tmp_path, missing, kind):
    if (missing, kind) == (tiles, "TexEnvironment"):
        pytest.skip("Blender has no tiles around a scene")
    bpy.context.scene.frame_set(7)
    image, reason = missing(tmp_path)
    node = new(tree, kind, image=image)
    if missing is sequence:
        node.image_user.frame_duration, node.image_user.frame_start = 100, 1
        node.image_user.use_auto_refresh = True
    show(tree, node.outputs[0], 1.5)
    document, warnings, _ = exported(tmp_path)
    assert document["world"] == {"color": [1.0, 0.0, 1.0], "strength": 1.5}
    (warning,) = [warning for warning in warnings if "magenta" in warning]
    assert reason in warning and f"(ShaderNode{kind})" in warning and 'world "World"' in warning
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.data.objects.remove(bpy.data.objects["Fog"])
    values, _ = by_cycles(tmp_path)
    # The lookup blends equal pixels with weights that are rounded.
    np.testing.assert_allclose(values, np.broadcast_to([1.5, 0.0, 1.5], values.shape), rtol=1e-6)


def test_a_picture_that_its_library_lacks_is_what_blender_generates(tree, tmp_path, monkeypatch):
    # Any resolution shows that it is rendered.
    monkeypatch.setattr(world_reader, "WIDTHS", (64,))
    image, reason = of_a_library(tmp_path)
    show(tree, new(tree, "TexEnvironment", image=image).outputs[0], 1.5)
    document, warnings, files = exported(tmp_path)
    assert any(reason in warning and "generates in its place" in warning for warning in warnings)
    assert list(files) == [document["world"]["image"]["file"]]


def test_a_missing_picture_among_nodes_is_what_cycles_makes_of_it(tree, tmp_path):
    image, _ = gone(tmp_path)
    picture = new(tree, "TexEnvironment", image=image)
    show(tree, new(tree, "Gamma", {0: picture.outputs[0], 1: 2.0}).outputs[0])
    # One that reaches nothing is not reported.
    new(tree, "TexEnvironment", image=image, name="Beside")
    document, warnings, files = exported(tmp_path)
    assert sum("magenta" in warning for warning in warnings) == 1
    world = document["world"]
    if files:
        image = bpy.data.images.load(next(iter(files.values())))
        values = np.array(image.pixels[:]).reshape(-1, image.channels)[:, :3]
    else:
        values = np.array([world["color"]]) * world["strength"]
    np.testing.assert_allclose(values, np.broadcast_to([1.0, 0.0, 1.0], values.shape), rtol=1e-5)
