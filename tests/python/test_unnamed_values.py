"""Values of a .blend file that this release has no name for: they harm only where they reach the volume."""

import ctypes

import pytest

from blend_support import Recorder, requires_bpy
from protocol import InputError

bpy = pytest.importorskip("bpy")

from graph_reader import read_graph  # noqa: E402

pytestmark = requires_bpy

# A number that no operation of Vector Math has in any release so far.
UNKNOWN = 99
# Bytes of a node that are searched for where the operation stands.
SEARCHED = 512


def store(node, name, number, choices):
    """Store a number in an enumeration of a node past RNA, as a file of a newer release would."""
    memory = (ctypes.c_int16 * (SEARCHED // 2)).from_address(node.as_pointer())
    found = []
    for choice in choices:
        setattr(node, name, choice)
        found.append(list(memory))
    numbers = [node.bl_rna.properties[name].enum_items[choice].value for choice in choices]
    places = [
        index
        for index in range(len(memory))
        if all(values[index] == wanted for values, wanted in zip(found, numbers, strict=True))
    ]
    assert len(places) == 1, "the place of the value in memory is found"
    memory[places[0]] = number
    assert getattr(node, name) == ""


@pytest.fixture
def material():
    """A material of Principled Volume with a Vector Math of an unknown operation that nothing reads yet."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    material = bpy.data.materials.new("Fog")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    closure = tree.nodes.new("ShaderNodeVolumePrincipled")
    tree.links.new(output.inputs["Volume"], closure.outputs[0])
    strange = tree.nodes.new("ShaderNodeVectorMath")
    store(strange, "operation", UNKNOWN, ["DOT_PRODUCT", "SNAP", "WRAP"])
    return material


def names(graph):
    return {node["name"] for node in graph["nodes"]}


def test_a_value_without_a_name_harms_nothing_where_nothing_reads_it(material):
    messages = Recorder()
    graph = read_graph(material, messages.warning)
    assert names(graph) == {"Material Output", "Principled Volume"}
    assert [place for place, _ in messages.warnings] == [
        'material "Fog", tree "Shader Nodetree", node "Vector Math" (ShaderNodeVectorMath)'
    ]


def test_a_value_without_a_name_that_reaches_the_volume_is_named(material):
    tree = material.node_tree
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], tree.nodes["Vector Math"].outputs[0])
    with pytest.raises(InputError) as caught:
        read_graph(material, Recorder().warning)
    assert 'node "Vector Math"' in caught.value.place
    assert 'property "operation" (Operation)' in caught.value.found
    assert "which Blender" in caught.value.found
    assert "DOT_PRODUCT" in caught.value.expected


def test_a_muted_node_passes_on_whatever_it_stores(material):
    tree = material.node_tree
    strange = tree.nodes["Vector Math"]
    strange.mute = True
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], strange.outputs[0])
    graph = read_graph(material, Recorder().warning)
    assert "operation" not in next(
        (node["properties"] for node in graph["nodes"] if node["name"] == "Vector Math"), {}
    )
