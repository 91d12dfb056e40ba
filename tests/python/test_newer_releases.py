"""What releases of Blender after 5.0 have that 5.0 does not, read into a scene. Runs in those releases."""

import numpy as np
import pytest

from blend_support import absorbing_nodes, requires_bpy, scene
from protocol import located

bpy = pytest.importorskip("bpy")

from blender_file import open_empty  # noqa: E402
from graph_reader import read_graph  # noqa: E402
from scene_builder import build_scene  # noqa: E402

pytestmark = requires_bpy
since_5_1 = pytest.mark.skipif(bpy.app.version < (5, 1, 0), reason="Blender 5.1 has it first")
since_5_2 = pytest.mark.skipif(bpy.app.version < (5, 2, 0), reason="Blender 5.2 has it first")


@pytest.fixture
def tree():
    """The node tree of the material of a small scene, open in Blender."""
    open_empty()
    build_scene(located(scene(absorbing_nodes(1.0)), "scene"), lambda place, message: None)
    return bpy.data.materials["Material"].node_tree


def graph():
    """The graph of that material, by name of node."""
    found = read_graph(bpy.data.materials["Material"], lambda place, message: None)
    return {entry["name"]: entry for entry in found["nodes"]}


@since_5_2
@pytest.mark.parametrize(
    ("frame", "subframe", "fps", "base", "seconds"),
    [
        # Measured: Scene Time by Cycles 5.2.3 and 5.3.0.
        (30, 0.0, 24, 1.0, 1.25),
        (7, 0.5, 30, 1.001, 0.25025),
        (1001, 0.0, 30, 1.001, 33.400036),
        (777, 0.3, 60, 1.001, 12.967956),
    ],
)
def test_scene_time_is_the_time_of_the_frame(tree, frame, subframe, fps, base, seconds):
    time = tree.nodes.new("GeometryNodeInputSceneTime")
    density = tree.nodes["Principled Volume"].inputs["Density"]
    tree.links.new(density, time.outputs["Seconds"])
    render = bpy.context.scene.render
    render.fps, render.fps_base = fps, base
    bpy.context.scene.frame_set(frame, subframe=subframe)
    nodes = graph()
    link = nodes["Principled Volume"]["inputs"]["Density"]
    assert link["socket"] == "Value"
    assert nodes[link["node"]]["type"] == "ShaderNodeValue"
    assert nodes[link["node"]]["outputs"] == {"Value": pytest.approx(seconds, rel=1e-7)}
    assert "Scene Time" not in nodes
    assert nodes["Scene Time Frame"]["outputs"]["Value"] == pytest.approx(frame + subframe, rel=1e-6)


@since_5_2
def test_the_place_of_scene_time_has_a_name_of_its_own(tree):
    tree.nodes.new("ShaderNodeMath").name = "Scene Time Seconds"
    tree.nodes.new("GeometryNodeInputSceneTime")
    assert {"Scene Time Seconds", "Scene Time Seconds'", "Scene Time Frame"} <= set(graph())


@since_5_1
def test_round_is_an_operation(tree):
    node = tree.nodes.new("ShaderNodeVectorMath")
    node.operation = "ROUND"
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], node.outputs[0])
    entry = graph()["Vector Math"]
    assert entry["properties"] == {"operation": "ROUND"}
    assert list(entry["inputs"]) == ["Vector"]


def test_sockets_of_a_group_are_those_of_its_mode(tree):
    group = bpy.data.node_groups.new("Shared", "ShaderNodeTree")
    group.interface.new_socket(name="Volume", in_out="OUTPUT", socket_type="NodeSocketShader")
    scatter, leave = group.nodes.new("ShaderNodeVolumeScatter"), group.nodes.new("NodeGroupOutput")
    scatter.phase = "MIE"
    group.links.new(leave.inputs[0], scatter.outputs[0])
    call = tree.nodes.new("ShaderNodeGroup")
    call.node_tree = group
    tree.links.new(tree.nodes["Material Output"].inputs["Volume"], call.outputs[0])
    depsgraph = bpy.context.evaluated_depsgraph_get()
    material = bpy.data.materials["Material"].evaluated_get(depsgraph)
    found = read_graph(material, lambda place, message: None, depsgraph)
    inside = {entry["name"]: entry for entry in found["groups"][0]["nodes"]}["Volume Scatter"]
    assert set(inside["inputs"]) == {"Color", "Density", "Diameter"}
    assert np.isclose(inside["inputs"]["Diameter"], 20.0)
