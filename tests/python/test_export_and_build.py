"""Reading a .blend file into a scene and building it back: nothing may be lost, nothing changed silently."""

import hashlib
import json

import numpy as np
import OpenImageIO as oiio
import pytest

from blend_support import (
    CLOUD_BLEND,
    CLOUD_SCENE,
    Recorder,
    absorbing_nodes,
    cloud_scene,
    link,
    node,
    requires_bpy,
    scene,
)
from protocol import InputError, located
from scene_io import format_scene

bpy = pytest.importorskip("bpy")

from build_scene import handle as build  # noqa: E402
from export_scene import handle as export  # noqa: E402
from volume_reader import is_box  # noqa: E402

pytestmark = requires_bpy


def exported(path, object_name=None):
    """The scene of a .blend file, with the warnings."""
    messages = Recorder()
    request = located({"blend": str(path), "object": object_name}, "request")
    return export(request, messages)["scene"], messages.warnings


def built(document, path):
    """Build a scene into a .blend file; return its path."""
    document = located(json.loads(json.dumps(document)), "scene")
    build(located({"blend": str(path)}, "request") | {"scene": document}, Recorder())
    return path


def saved(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path


@pytest.fixture
def cube(tmp_path):
    """The small scene built in Blender and left open: (path to save to, node tree of the material)."""
    built(scene(absorbing_nodes(1.0)), tmp_path / "cube.blend")
    return tmp_path / "changed.blend", bpy.data.materials["Material"].node_tree


def assert_round_trip(document, folder):
    again, _ = exported(built(document, folder / "again.blend"))
    assert format_scene(again) == format_scene(document)


def test_cloud_survives_building_and_exporting(tmp_path):
    again, warnings = exported(built(cloud_scene(), tmp_path / "cloud.blend"))
    assert format_scene(again) == CLOUD_SCENE.read_text(encoding="utf-8")
    assert not warnings


@pytest.mark.skipif(not CLOUD_BLEND.exists(), reason="the published .blend file is not here")
def test_published_file_gives_the_committed_scene():
    document, warnings = exported(CLOUD_BLEND)
    assert format_scene(document) == CLOUD_SCENE.read_text(encoding="utf-8")
    # It is set to EEVEE.
    assert [place for place, _ in warnings] == ["render settings, engine"]


def test_cloud_group_has_its_sockets_and_panels():
    group = cloud_scene()["graph"]["groups"][0]
    assert [len(group["inputs"]), len(group["outputs"])] == [13, 1]
    assert [socket["panel"] for socket in group["inputs"]].count("Large Noise") == 3


def test_planted_difference_of_one_constant_is_seen(tmp_path):
    built(cloud_scene(), tmp_path / "cloud.blend")
    socket = bpy.data.node_groups["Procedural Clouds Shader"].nodes["Math.006"].inputs[1]
    socket.default_value = float(np.nextafter(np.float32(socket.default_value), np.float32(0)))
    again, _ = exported(saved(tmp_path / "planted.blend"))
    before = CLOUD_SCENE.read_text(encoding="utf-8").splitlines()
    after = format_scene(again).splitlines()
    different = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert len(different) == 1
    assert "-0.25" in different[0][0]


def test_everything_that_the_format_knows_survives(tmp_path):
    built(scene(absorbing_nodes(1.0)), tmp_path / "start.blend")
    _add_lights()
    _add_nested_groups(bpy.data.materials["Material"].node_tree)
    _deform_volume()
    bpy.context.scene["cloudparity_name"] = "everything"
    camera = bpy.context.scene.camera.data
    camera.type, camera.panorama_type, camera.longitude_min = "PANO", "EQUIRECTANGULAR", -1.0
    document, warnings = exported(saved(tmp_path / "everything.blend"))
    assert not warnings
    assert [light["type"] for light in document["lights"]] == ["area", "point", "spot", "sun"]
    assert document["volume"]["shape"]["type"] == "mesh"
    assert [group["name"] for group in document["graph"]["groups"]] == ["Inner", "Outer"]
    assert_round_trip(document, tmp_path)


def _add_lights():
    for kind in ("SUN", "POINT", "SPOT", "AREA"):
        light = bpy.data.lights.new(kind.lower(), kind)
        light.color, light.energy, light.exposure = (0.1, 0.2, 0.3), 3.7, 0.5
        item = bpy.data.objects.new(kind.lower(), light)
        item.location, item.rotation_euler, item.scale = (1, 2, 3), (0.1, 0.7, -2), (1, 2, 0.3)
        bpy.context.scene.collection.objects.link(item)


def _add_nested_groups(tree):
    """Two levels of groups with panels, gaps in the numbers, mutes, reroutes and frames."""
    inner = bpy.data.node_groups.new("Inner", "ShaderNodeTree")
    panel = inner.interface.new_panel("Panel")
    inner.interface.new_socket(name="Out", in_out="OUTPUT", socket_type="NodeSocketColor")
    inner.interface.new_socket(name="Vec", in_out="INPUT", socket_type="NodeSocketVector", parent=panel)
    count = inner.interface.new_socket(name="Count", in_out="INPUT", socket_type="NodeSocketInt")
    count.max_value, count.default_value = 9, 3
    inner.interface.new_socket(name="Switch", in_out="INPUT", socket_type="NodeSocketBool")
    entry, leave = inner.nodes.new("NodeGroupInput"), inner.nodes.new("NodeGroupOutput")
    noise = inner.nodes.new("ShaderNodeTexNoise")
    noise.mute, noise.label, noise.location = True, "muted", (33.3, -7.1)
    noise.parent = inner.nodes.new("NodeFrame")
    noise.parent.location = (100.1, 50.7)
    reroute = inner.nodes.new("NodeReroute")
    inner.links.new(noise.inputs["Vector"], entry.outputs["Vec"])
    inner.links.new(reroute.inputs[0], noise.outputs["Color"])
    inner.links.new(leave.inputs["Out"], reroute.outputs[0])
    add = inner.nodes.new("ShaderNodeMath")
    inner.links.new(add.inputs[0], entry.outputs["Count"]).is_muted = True

    outer = bpy.data.node_groups.new("Outer", "ShaderNodeTree")
    outer.interface.new_socket(name="Value", in_out="OUTPUT", socket_type="NodeSocketFloat")
    call, leave = outer.nodes.new("ShaderNodeGroup"), outer.nodes.new("NodeGroupOutput")
    call.node_tree = inner
    coordinates = outer.nodes.new("ShaderNodeTexCoord")
    coordinates.object = bpy.data.objects["area"]
    outer.links.new(call.inputs["Vec"], coordinates.outputs["Object"])
    mix = outer.nodes.new("ShaderNodeMix")
    mix.data_type = "RGBA"
    outer.links.new(next(item for item in mix.inputs if item.identifier == "A_Color"), call.outputs["Out"])
    outer.links.new(leave.inputs["Value"], mix.outputs["Result"])
    value = outer.nodes.new("ShaderNodeValue")
    value.outputs[0].default_value = 0.123
    outer.links.new(mix.inputs["Factor"], value.outputs[0])

    call = tree.nodes.new("ShaderNodeGroup")
    call.node_tree = outer
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], call.outputs["Value"])


def _deform_volume():
    """A rotated and sheared object whose mesh is a box no more, with a modifier."""
    item = bpy.data.objects["Cube"]
    item.parent = None
    item.rotation_euler, item.scale = (0.3, 0.2, 0.1), (1, 2, 3)
    carrier = bpy.data.objects.new("carrier", None)
    carrier.rotation_euler, carrier.scale = (1, 0, 0.4), (2, 1, 1)
    bpy.context.scene.collection.objects.link(carrier)
    item.parent = carrier
    item.data.vertices[0].co.x -= 0.3
    item.modifiers.new("bevel", "BEVEL")


def test_box_is_recognised_and_inside_out_box_is_not():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 2) for z in (0, 3)], np.float32)
    outward = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
    outward += [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    outward = np.array(outward)
    assert is_box(corners, outward)
    assert not is_box(corners, outward[:, ::-1])
    assert not is_box(corners, outward[:-1])
    assert not is_box(corners + np.eye(8, 3, dtype=np.float32), outward)


def test_all_volumes_are_exported_and_one_can_be_chosen(cube, tmp_path):
    path, _ = cube
    first = bpy.data.objects["Cube"]
    group = bpy.data.node_groups.new("Shared", "ShaderNodeTree")
    group.interface.new_socket(name="Volume", in_out="OUTPUT", socket_type="NodeSocketShader")
    scatter, leave = group.nodes.new("ShaderNodeVolumeScatter"), group.nodes.new("NodeGroupOutput")
    scatter.phase = "MIE"
    group.links.new(leave.inputs[0], scatter.outputs[0])
    # The second object shares the first one's material; the third has its own, with a closure in a group.
    for number, name in enumerate(("Second", "Third")):
        item = bpy.data.objects.new(name, first.data.copy())
        item.location = (0.5 + number / 8, 0.25 + number / 4, 0.125 + number / 8)
        bpy.context.scene.collection.objects.link(item)
    for name, item in (("Other", "Third"), ("Unused", None)):
        material = bpy.data.materials.new(name)
        tree = material.node_tree
        tree.nodes.clear()
        call, output = tree.nodes.new("ShaderNodeGroup"), tree.nodes.new("ShaderNodeOutputMaterial")
        call.node_tree = group
        mix, emission = tree.nodes.new("ShaderNodeMixShader"), tree.nodes.new("ShaderNodeEmission")
        tree.links.new(mix.inputs[1], call.outputs[0])
        tree.links.new(mix.inputs[2], emission.outputs[0])
        tree.links.new(output.inputs["Volume"], mix.outputs[0])
        if item is not None:
            bpy.data.objects[item].data.materials[0] = material
    bpy.data.objects["Second"].data.materials[0] = first.data.materials[0]
    call = first.data.materials[0].node_tree.nodes.new("ShaderNodeGroup")
    call.node_tree = group
    saved(path)
    document, warnings = exported(path)
    assert not warnings
    assert document["volume"]["object"] == "Cube"
    assert [item["object"] for item in document["other_volumes"]] == ["Second", "Third"]
    assert [item["material"] for item in document["other_graphs"]] == ["Other"]
    assert [item["name"] for item in document["graph"]["groups"]] == ["Shared"]
    assert_round_trip(document, tmp_path)

    document, warnings = exported(path, "Third")
    assert document["volume"]["object"] == "Third"
    assert document["graph"]["material"] == "Other"
    assert "other_volumes" not in document
    assert "Cube" in warnings[0][0]
    document, _ = exported(path, ["Third", "Second"])
    assert [document["volume"]["object"], document["other_volumes"][0]["object"]] == ["Second", "Third"]
    with pytest.raises(InputError, match="no such object"):
        exported(path, "Fourth")


def test_a_group_that_two_materials_describe_differently_is_refused(tmp_path):
    document = cloud_scene()
    other = json.loads(json.dumps(document["graph"])) | {"material": "Other"}
    other["groups"][0]["inputs"][0]["name"] = "Another label"
    with pytest.raises(InputError, match="another group"):
        built(dict(document) | {"other_graphs": [other]}, tmp_path / "two.blend")


def test_hidden_volume_is_none(cube):
    path, _ = cube
    bpy.data.objects["Cube"].hide_render = True
    with pytest.raises(InputError, match='"Material" on "Cube", hidden in renders'):
        exported(saved(path))


def test_image_that_reaches_the_volume_is_refused_and_another_is_left_out(cube):
    path, tree = cube
    image = tree.nodes.new("ShaderNodeTexImage")
    image.image = bpy.data.images.new("picture", 4, 4)
    image.image.pack()
    follower = tree.nodes.new("ShaderNodeMath")
    tree.links.new(follower.inputs[0], image.outputs["Alpha"])
    document, warnings = exported(saved(path))
    assert {item["name"] for item in document["graph"]["nodes"]} == {"Material Output", "Principled Volume"}
    assert len(warnings) == 2
    # Exporting opened the saved file, so the tree is another one now.
    tree = bpy.data.materials["Material"].node_tree
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], tree.nodes["Math"].outputs[0])
    with pytest.raises(InputError) as refusal:
        exported(saved(path))
    assert "Image Texture" in refusal.value.place
    assert "picture" not in refusal.value.found
    assert "image" in refusal.value.found.lower()


def test_texture_mapping_survives_where_it_changes_anything(cube, tmp_path):
    path, tree = cube
    changed, plain = tree.nodes.new("ShaderNodeTexNoise"), tree.nodes.new("ShaderNodeTexVoronoi")
    mapping = changed.texture_mapping
    mapping.vector_type, mapping.mapping_y, mapping.scale, mapping.rotation = (
        "TEXTURE",
        "NONE",
        (1, 2, 3),
        (0, 0.7, 0),
    )
    plain.texture_mapping.vector_type = "NORMAL"
    plain.texture_mapping.use_max = True
    tree.links.new(changed.inputs["Roughness"], plain.outputs[0])
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], changed.outputs[0])
    document, _ = exported(saved(path))
    properties = {item["type"]: item.get("properties") for item in document["graph"]["nodes"]}
    assert properties["ShaderNodeTexNoise"]["texture_mapping"] == {
        "vector_type": "TEXTURE",
        "translation": [0.0, 0.0, 0.0],
        "rotation": [0.0, 0.7, 0.0],
        "scale": [1.0, 2.0, 3.0],
        "mapping_x": "X",
        "mapping_y": "NONE",
        "mapping_z": "Z",
    }
    assert "texture_mapping" not in properties["ShaderNodeTexVoronoi"]
    assert_round_trip(document, tmp_path)


def test_what_object_info_shows_survives(cube, tmp_path):
    path, _ = cube
    document, _ = exported(saved(path))
    assert not {"color", "pass_index", "material_pass_index"} & set(document["volume"])
    bpy.ops.wm.open_mainfile(filepath=str(path))
    item = bpy.data.objects["Cube"]
    item.color, item.pass_index = (0.25, 0.5, 2.0, 0.125), 7
    item.active_material.pass_index = 11
    document, _ = exported(saved(path))
    assert document["volume"]["color"] == [0.25, 0.5, 2.0, 0.125]
    assert [document["volume"][key] for key in ("pass_index", "material_pass_index")] == [7, 11]
    assert_round_trip(document, tmp_path)


def test_a_material_has_one_pass_index(tmp_path):
    document = scene(absorbing_nodes(1.0))
    other = json.loads(json.dumps(document["volume"])) | {"object": "Other", "material_pass_index": 3}
    document["other_volumes"] = [other]
    with pytest.raises(InputError) as refusal:
        built(document, tmp_path / "two.blend")
    assert refusal.value.place == "scene.other_volumes[0].material_pass_index"


def test_a_hidden_stored_vector_survives(cube, tmp_path):
    path, tree = cube
    turn = tree.nodes.new("ShaderNodeVectorRotate")
    turn.inputs["Vector"].default_value = (0.25, 0.5, 0.75)
    tree.links.new(tree.nodes["Principled Volume"].inputs["Color"], turn.outputs[0])
    document, _ = exported(saved(path))
    inputs = {item["name"]: item["inputs"] for item in document["graph"]["nodes"]}
    assert inputs["Vector Rotate"]["Vector"] == [0.25, 0.5, 0.75]
    assert_round_trip(document, tmp_path)


def test_a_link_that_nothing_feeds_leaves_the_stored_value(cube, tmp_path):
    path, tree = cube
    density = tree.nodes["Principled Volume"].inputs["Density"]
    density.default_value = 0.75
    muted = tree.nodes.new("ShaderNodeMath")
    muted.mute = True
    reroute = tree.nodes.new("NodeReroute")
    tree.links.new(reroute.inputs[0], muted.outputs[0])
    tree.links.new(density, reroute.outputs[0])
    document, _ = exported(saved(path))
    inputs = {item["name"]: item["inputs"] for item in document["graph"]["nodes"]}
    assert inputs["Principled Volume"]["Density"] == 0.75
    assert_round_trip(document, tmp_path)


def test_a_link_through_a_muted_node_that_is_fed_stays(cube, tmp_path):
    path, tree = cube
    muted, value = tree.nodes.new("ShaderNodeMath"), tree.nodes.new("ShaderNodeValue")
    muted.mute = True
    tree.links.new(muted.inputs[0], value.outputs[0])
    tree.links.new(tree.nodes["Principled Volume"].inputs["Density"], muted.outputs[0])
    document, _ = exported(saved(path))
    inputs = {item["name"]: item["inputs"] for item in document["graph"]["nodes"]}
    assert inputs["Principled Volume"]["Density"] == link("Math", "Value")
    assert_round_trip(document, tmp_path)


def test_no_world_is_black(cube):
    path, _ = cube
    bpy.context.scene.world = None
    document, _ = exported(saved(path))
    assert document["world"] == {"color": [0.0, 0.0, 0.0], "strength": 1.0}


def test_an_environment_image_survives(tmp_path):
    picture = tmp_path / "sky.exr"
    output = oiio.ImageOutput.create(str(picture))
    output.open(str(picture), oiio.ImageSpec(8, 4, 3, "float"))
    output.write_image(np.linspace(0, 2, 8 * 4 * 3, dtype=np.float32).reshape(4, 8, 3))
    output.close()
    document = scene(absorbing_nodes(1.0))
    digest = hashlib.sha256(picture.read_bytes()).hexdigest()
    document["world"] = located(
        {"color": [1.0, 1.0, 1.0], "strength": 0.5, "image": {"file": "sky.exr", "sha256": digest}}, "world"
    )
    request = {"blend": str(tmp_path / "a.blend"), "folder": str(tmp_path), "scene": document}
    build(located(request, "request"), Recorder())
    result = export(located({"blend": request["blend"], "object": None}, "request"), Recorder())
    assert result["scene"]["world"] == document["world"]
    assert result["files"] == {"sky.exr": str(picture)}

    with pytest.raises(InputError, match="folder"):
        build(located(request | {"folder": None}, "request"), Recorder())
    document["world"]["image"]["sha256"] = "0" * 64
    with pytest.raises(InputError, match="another file"):
        build(located(request, "request"), Recorder())


@pytest.mark.parametrize(
    ("wrong", "place"),
    [
        (node("N", "ShaderNodeNoSuch"), "graph.nodes[N]"),
        (node("N", "ShaderNodeMath", {"Value_002": 1.0}), "graph.nodes[N].inputs[Value_002]"),
        (node("N", "ShaderNodeMath", {"Value": link("M", "Value")}), "graph.nodes[N].inputs[Value]"),
        (node("N", "ShaderNodeTexMagic", turbulence_depth=50), "graph.nodes[N].properties.turbulence_depth"),
        (node("N", "ShaderNodeMath", operation="ADDD"), "graph.nodes[N].properties.operation"),
        (node("Principled Volume", "ShaderNodeMath"), "graph.nodes[Principled Volume]"),
    ],
)
def test_graph_that_blender_would_change_is_refused(wrong, place, tmp_path):
    with pytest.raises(InputError) as refusal:
        built(scene([*absorbing_nodes(1.0), wrong]), tmp_path / "wrong.blend")
    assert refusal.value.place == place
    assert not list(tmp_path.iterdir())


def test_group_identifiers_that_blender_cannot_reproduce_are_reported(tmp_path):
    document = cloud_scene()
    group = document["graph"]["groups"][0]
    text = json.dumps(group).replace('"Socket_16"', '"Input_16"')
    document["graph"]["groups"][0] = json.loads(text)
    caller = next(item for item in document["graph"]["nodes"] if item["name"] == "Group.001")
    caller["inputs"]["Input_16"] = caller["inputs"].pop("Socket_16")
    messages = Recorder()
    request = located(
        {"scene": json.loads(json.dumps(document)), "blend": str(tmp_path / "old.blend")}, "request"
    )
    build(request, messages)
    assert [place for place, _ in messages.warnings] == [
        "graph.groups[Procedural Clouds Shader].inputs[Input_16]"
    ]
    tree = bpy.data.node_groups["Procedural Clouds Shader"]
    assert tree.nodes["Math.006"].inputs[0].is_linked
