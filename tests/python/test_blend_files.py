"""What people's .blend files hold: it is read as Cycles shows it, said, or refused by name."""

import hashlib
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from blend_support import Recorder, requires_bpy, run_apart, run_script
from protocol import InputError, located

bpy = pytest.importorskip("bpy")

import bmesh  # noqa: E402
from mathutils import Matrix, Vector  # noqa: E402

import volume_grid  # noqa: E402
from build_scene import handle as build  # noqa: E402
from export_scene import handle as export  # noqa: E402

pytestmark = requires_bpy

# Cycles without noise: absorption by constants has none, and one ray goes through the centre of each pixel.
EXACT = {"samples": 1, "pixel_filter_type": "BLACKMAN_HARRIS", "filter_width": 0.01}


@pytest.fixture
def empty():
    """An empty file with a white world and an orthographic camera that looks along +Y through the origin."""
    return new_scene()


def new_scene():
    """What `empty` is."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    _world(scene)
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 0.01
    item = linked(bpy.data.objects.new("Camera", camera))
    item.location, item.rotation_euler = (0.1, -10, 0.2), (math.pi / 2, 0, 0)
    scene.camera = item
    scene.render.resolution_x = scene.render.resolution_y = 4
    return scene


def _world(scene):
    scene.world = bpy.data.worlds.new("World")
    background = scene.world.node_tree.nodes["Background"]
    background.inputs["Color"].default_value = (1, 1, 1, 1)


def linked(item):
    bpy.context.scene.collection.objects.link(item)
    return item


def cube_mesh(name, materials=(), size=2.0):
    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=size)
    shape.to_mesh(mesh)
    shape.free()
    for material in materials:
        mesh.materials.append(material)
    return mesh


def cube(name, *materials, size=2.0, location=(0, 0, 0)):
    item = linked(bpy.data.objects.new(name, cube_mesh(name, materials, size)))
    item.location = location
    return item


def fog(name, density=0.5, kind="ShaderNodeVolumeAbsorption", color=(0, 0, 0, 1)):
    """A material with a volume alone."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    closure = tree.nodes.new(kind)
    closure.inputs["Color"].default_value = color
    closure.inputs["Density"].default_value = density
    tree.links.new(tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"], closure.outputs[0])
    return material


def surface(name, kind="ShaderNodeBsdfTransparent"):
    """A material with a surface alone."""
    material = bpy.data.materials.new(name)
    tree = material.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(kind)
    tree.links.new(tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"], shader.outputs[0])
    return material


def exported(folder, **request):
    """Save the open file, export it; the scene, the warnings as text, and the files beside it."""
    path = folder / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return exported_file(path, folder, **request)


def exported_file(path, folder, **request):
    messages = Recorder()
    beside = folder / "beside"
    beside.mkdir(exist_ok=True)
    whole = {"blend": str(path), "object": None, "folder": str(beside)} | request
    result = export(located(whole, "request"), messages)
    return result["scene"], [f"{place}: {message}" for place, message in messages.warnings], result["files"]


def refusal(folder, **request):
    """The text of the InputError that exporting the open file ends with."""
    with pytest.raises(InputError) as caught:
        exported(folder, **request)
    return str(caught.value)


def volumes(document):
    return [document["volume"], *document.get("other_volumes", [])]


def names(document):
    return [volume["object"] for volume in volumes(document)]


def picture(folder, **settings):
    """The open scene by Cycles, f32 [row, column, 3]."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.use_adaptive_sampling = scene.cycles.use_denoising = False
    scene.cycles.sample_clamp_indirect = 0.0
    for name, value in (EXACT | settings).items():
        setattr(scene.cycles, name, value)
    render = scene.render
    render.image_settings.file_format, render.image_settings.color_depth = "OPEN_EXR", "32"
    render.filepath = str(folder / "picture.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(render.filepath)
    image.colorspace_settings.name = "Linear Rec.709"
    values = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], -1)
    bpy.data.images.remove(image)
    return values[..., :3]


def depth(folder):
    """Optical depth along +Y, of what only absorbs before a white world."""
    return -math.log(max(float(picture(folder).mean()), 1e-30))


def built(document, folder):
    """Make the open file that of a scene."""
    request = {"blend": str(folder / "built.blend"), "scene": document, "folder": str(folder / "beside")}
    build(located(request, "request"), Recorder())


# Objects


def test_instances_of_collections_are_volumes_with_names_of_their_own(empty, tmp_path):
    collection = bpy.data.collections.new("Clouds")
    inner = bpy.data.objects.new("Inner", cube_mesh("Inner", [fog("Fog")]))
    collection.objects.link(inner)
    lamp = bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN"))
    collection.objects.link(lamp)
    for number in range(2):
        carrier = linked(bpy.data.objects.new(f"Carrier {number}", None))
        carrier.instance_type, carrier.instance_collection = "COLLECTION", collection
        carrier.location = (3 * number, 0, 0)
    document, warnings, _ = exported(tmp_path)
    assert not warnings
    assert names(document) == ["Carrier 0/Inner/0", "Carrier 1/Inner/0"]
    assert [volume["matrix_world"][0][3] for volume in volumes(document)] == [0.0, 3.0]
    assert [light["name"] for light in document["lights"]] == ["Carrier 0/Lamp", "Carrier 1/Lamp"]
    # The order of what stands before it does not matter.
    document, _, _ = exported(tmp_path, object="Carrier 1")
    assert names(document) == ["Carrier 1/Inner/0"]
    assert "Carrier 0/Inner/0" in refusal(tmp_path, object="Nobody")
    cube("Hill", surface("Ground"))
    text = refusal(tmp_path, object=["Carrier 1", "Hill"])
    assert 'object "Hill"' in text and "0 materials" in text
    built(document, tmp_path)
    assert bpy.data.objects["Carrier 1/Inner/0"].matrix_world.translation.x == 3.0


def test_more_mesh_than_a_file_can_hold_is_refused(empty, tmp_path, monkeypatch):
    import volume_reader

    item = cube("Cloud field", fog("Fog"))
    item.data.vertices[0].co.x -= 0.5
    monkeypatch.setattr(volume_reader, "MOST_NUMBERS", 59)
    # 8 vertices and 12 triangles.
    assert "more than 59 numbers" in refusal(tmp_path)
    monkeypatch.setattr(volume_reader, "MOST_NUMBERS", 60)
    assert names(exported(tmp_path)[0]) == ["Cloud field"]


def _instancing_nodes(material):
    """A node group that puts a cube on every point."""
    group = bpy.data.node_groups.new("Scatter", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket(name="Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    kinds = (
        "NodeGroupInput",
        "GeometryNodeMeshCube",
        "GeometryNodeSetMaterial",
        "GeometryNodeInstanceOnPoints",
    )
    entry, shape, painted, spread = (group.nodes.new(kind) for kind in kinds)
    painted.inputs["Material"].default_value = material
    group.links.new(painted.inputs["Geometry"], shape.outputs["Mesh"])
    group.links.new(spread.inputs["Points"], entry.outputs[0])
    group.links.new(spread.inputs["Instance"], painted.outputs[0])
    group.links.new(group.nodes.new("NodeGroupOutput").inputs[0], spread.outputs[0])
    return group


def test_geometry_nodes_make_volumes(empty, tmp_path):
    item = cube("Cloud field")
    item.modifiers.new("scatter", "NODES").node_group = _instancing_nodes(fog("Fog"))
    document, warnings, _ = exported(tmp_path)
    assert not warnings
    assert names(document) == [f"Cloud field/Cloud field/{number}.0" for number in range(8)]
    assert document["volume"]["shape"] == {"type": "box"}
    assert document["volume"]["bounds"]["max"] == [0.5, 0.5, 0.5]
    assert document["volume"]["texture_space"]["size"] == [0.5, 0.5, 0.5]


def test_modifiers_count_as_in_a_render(empty, tmp_path):
    item = cube("Cube", fog("Fog"))
    modifier = item.modifiers.new("round", "SUBSURF")
    modifier.levels, modifier.render_levels = 0, 1
    other = cube("Hidden while editing", fog("Other"))
    other.hide_viewport = True
    document, _, _ = exported(tmp_path)
    assert names(document) == ["Cube", "Hidden while editing"]
    assert len(document["volume"]["shape"]["vertices"]) == 26


def test_curves_texts_and_metaballs_are_meshes(empty, tmp_path):
    material = fog("Fog")
    text = bpy.data.curves.new("Text", "FONT")
    text.extrude = 0.2
    ring = bpy.data.curves.new("Ring", "CURVE")
    ring.dimensions, ring.bevel_depth = "3D", 0.2
    spline = ring.splines.new("NURBS")
    spline.points.add(3)
    for point, place in zip(spline.points, [(0, 0), (1, 0), (1, 1), (0, 1)], strict=True):
        point.co = (*place, 0, 1)
    spline.use_cyclic_u = True
    ball = bpy.data.metaballs.new("Ball")
    ball.elements.new()
    for data in (text, ring, ball):
        data.materials.append(material)
        linked(bpy.data.objects.new(data.name, data))
    document, warnings, _ = exported(tmp_path)
    assert names(document) == ["Ball", "Ring", "Text"]
    assert all(volume["shape"]["type"] == "mesh" for volume in volumes(document))
    assert not any("not closed" in warning for warning in warnings if "Text" not in warning)


def test_an_instancer_that_is_not_shown_is_no_volume(empty, tmp_path):
    material = fog("Fog")
    item = cube("Instancer", material)
    child = cube("Child", material, size=0.5)
    child.parent = item
    item.instance_type = "VERTS"
    item.show_instancer_for_render = False
    document, _, _ = exported(tmp_path)
    assert names(document) == [f"Instancer/Child/{number}" for number in range(8)]
    item = bpy.data.objects["Instancer"]
    item.show_instancer_for_render = True
    document, _, _ = exported(tmp_path)
    assert "Instancer" in names(document) and len(names(document)) == 9


def _paint(item, index_of):
    for polygon in item.data.polygons:
        polygon.material_index = index_of(polygon.normal)


def test_the_material_of_the_faces_counts_and_not_the_slots(empty, tmp_path):
    item = cube("Cube", surface("Unused"), fog("Fog"), fog("Unused fog"))
    _paint(item, lambda normal: 1)
    document, _, _ = exported(tmp_path)
    assert document["volume"]["material"] == "Fog"
    # An index beyond the slots is that of the last one.
    item = bpy.data.objects["Cube"]
    _paint(item, lambda normal: 7)
    document, _, _ = exported(tmp_path)
    assert document["volume"]["material"] == "Unused fog"


def test_several_volume_materials_on_a_mesh_are_refused_for_what_cycles_does(empty, tmp_path):
    item = cube("Cube", fog("Thick", 0.5), fog("Thin", 0.1))
    # The medium is that of the face through which a ray enters, here of the one towards the camera.
    _paint(item, lambda normal: 1 if normal.y < -0.5 else 0)
    assert depth(tmp_path) == pytest.approx(0.2, rel=1e-5)
    _paint(item, lambda normal: 0 if normal.y < -0.5 else 1)
    assert depth(tmp_path) == pytest.approx(1.0, rel=1e-5)
    text = refusal(tmp_path)
    assert all(part in text for part in ('"Thick" and "Thin"', "through which a ray enters", "By Material"))


def test_faces_without_a_volume_are_refused_for_what_cycles_does(empty, tmp_path):
    item = cube("Cube", fog("Fog", 0.5), surface("Glass"))
    # A face without a volume begins none.
    _paint(item, lambda normal: 1 if normal.y < -0.5 else 0)
    assert depth(tmp_path) == pytest.approx(0.0, abs=1e-6)
    text = refusal(tmp_path)
    assert '"Glass", which has no volume' in text


@pytest.mark.parametrize("setting", ["visible_camera", "visible_shadow", "visible_volume_scatter"])
def test_a_volume_that_some_rays_do_not_see_is_refused(empty, tmp_path, setting):
    item = cube("Cube", fog("Fog"))
    setattr(item, setting, False)
    text = refusal(tmp_path)
    assert "ray visibility" in text and "hidden from rays of" in text


def test_a_volume_that_no_ray_sees_is_left_out(empty, tmp_path):
    cube("Seen", fog("Fog"))
    item = cube("Unseen", fog("Other"))
    item.visible_camera = item.visible_shadow = item.visible_volume_scatter = False
    document, warnings, _ = exported(tmp_path)
    assert names(document) == ["Seen"]
    assert warnings == ['volumes that no ray sees: "Unseen": left out: the picture stays the same']


def test_what_only_surfaces_see_does_not_matter(empty, tmp_path):
    item = cube("Cube", fog("Fog"))
    before = depth(tmp_path)
    item.visible_diffuse = item.visible_glossy = item.visible_transmission = False
    # In Cycles a volume is no holdout.
    item.is_holdout = True
    assert depth(tmp_path) == before
    document, warnings, _ = exported(tmp_path)
    assert names(document) == ["Cube"] and not warnings


def test_hidden_and_excluded_objects_are_left_out_in_silence(empty, tmp_path):
    cube("Seen", fog("Fog"))
    cube("Hidden", fog("Other")).hide_render = True
    for name, hide in (("Excluded", "exclude"), ("Hidden collection", "hide_render")):
        collection = bpy.data.collections.new(name)
        bpy.context.scene.collection.children.link(collection)
        collection.objects.link(
            bpy.data.objects.new(f"In {name}", cube_mesh(name, [bpy.data.materials["Fog"]]))
        )
        if hide == "exclude":
            bpy.context.view_layer.layer_collection.children[name].exclude = True
        else:
            collection.hide_render = True
    document, warnings, _ = exported(tmp_path)
    assert names(document) == ["Seen"] and not warnings


def test_what_is_left_out_is_said_once_for_each_class(empty, tmp_path):
    cube("Cloud", fog("Fog"))
    for number in range(6):
        cube(f"Hill {number}", surface("Ground", "ShaderNodeBsdfDiffuse"))
    cube("Candle", surface("Flame", "ShaderNodeEmission"))
    _, warnings, _ = exported(tmp_path)
    assert len(warnings) == 2
    assert warnings[0].startswith('surfaces: "Hill 0", "Hill 1", "Hill 2" and 3 more: left out')
    assert all(word in warnings[0] for word in ("shadow", "hide", "reflect"))
    assert (
        warnings[1].startswith('surfaces that shine: "Candle": left out')
        and "light is missing" in warnings[1]
    )


def test_a_mesh_with_holes_is_said(empty, tmp_path):
    item = cube("Open", fog("Fog"))
    shape = bmesh.new()
    shape.from_mesh(item.data)
    shape.faces.ensure_lookup_table()
    bmesh.ops.delete(shape, geom=[shape.faces[0]], context="FACES_ONLY")
    shape.to_mesh(item.data)
    shape.free()
    document, warnings, _ = exported(tmp_path)
    assert document["volume"]["shape"]["type"] == "mesh"
    assert len(warnings) == 1 and "4 edges where it is not closed" in warnings[0] and "Open" in warnings[0]


def test_a_mesh_that_is_inside_out_is_said(empty, tmp_path):
    cube("Inward", fog("Fog")).data.flip_normals()
    assert depth(tmp_path) == pytest.approx(0.0, abs=1e-6)
    _, warnings, _ = exported(tmp_path)
    assert len(warnings) == 1 and "its faces look inward" in warnings[0]


def test_smooth_and_flat_faces_on_one_mesh_are_said(empty, tmp_path):
    mesh = cube("Mixed", fog("Fog", kind="ShaderNodeVolumeScatter", color=(1, 1, 1, 1))).data
    side = [face.normal.x > 0.5 for face in mesh.polygons]
    assert sum(side) == 1
    bpy.context.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)
    sun = linked(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    sun.rotation_euler = (0, math.pi / 2, 0)
    light = []
    for smooth in ([True] * 6, [False] * 6, side):
        # Reading a file opens it anew.
        bpy.data.meshes["Mixed"].polygons.foreach_set("use_smooth", smooth)
        light.append(picture(tmp_path, samples=16).mean())
        _, warnings, _ = exported(tmp_path)
    assert light[0] == pytest.approx(light[1], rel=1e-6) and light[1] > 0.01
    # Cycles: camera rays enter through a flat face, and shadow rays meet no flat face that ends the medium.
    assert light[2] < 1e-4 * light[1]
    assert len(warnings) == 1 and "shaded smooth and others flat" in warnings[0] and "Mixed" in warnings[0]


def test_random_of_an_instance_is_refused(empty, tmp_path):
    material = fog("Fog")
    tree = material.node_tree
    info = tree.nodes.new("ShaderNodeObjectInfo")
    tree.links.new(tree.nodes["Volume Absorption"].inputs["Density"], info.outputs["Random"])
    collection = bpy.data.collections.new("Clouds")
    collection.objects.link(bpy.data.objects.new("Inner", cube_mesh("Inner", [material])))
    carrier = linked(bpy.data.objects.new("Carrier", None))
    carrier.instance_type, carrier.instance_collection = "COLLECTION", collection
    assert "Make Instances Real" in refusal(tmp_path)


def _smoke(folder, names_of_grids=("density",), **modifiers):
    """A Volume object with a file of these grids."""
    path = folder / "smoke.vdb"
    openvdb = volume_grid.library()
    grids = []
    for name in names_of_grids:
        grid = openvdb.FloatGrid()
        grid.name = name
        grid.copyFromArray(np.linspace(0.1, 1, 6 * 5 * 4, dtype=np.float32).reshape(6, 5, 4))
        grid.transform = openvdb.createLinearTransform(0.25)
        grids.append(grid)
    openvdb.write(str(path), grids)
    data = bpy.data.volumes.new("Smoke")
    data.filepath = str(path)
    return linked(bpy.data.objects.new("Smoke", data)), path


def test_a_volume_object_brings_its_grid(empty, tmp_path):
    item, path = _smoke(tmp_path, ("density", "flame"))
    item.data.materials.append(fog("Smoke", 2.0, "ShaderNodeVolumePrincipled"))
    item.location = (1, 2, 3)
    document, warnings, files = exported(tmp_path)
    assert document["volume"]["shape"] == {
        "type": "grid",
        "file": "smoke.vdb",
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
    }
    assert document["volume"]["bounds"] == {"min": [-0.25] * 3, "max": [1.5, 1.25, 1.0]}
    assert files == {"smoke.vdb": str(path)}
    assert len(warnings) == 1 and "flame" in warnings[0]


def test_grids_that_modifiers_make_are_written(empty, tmp_path):
    source = cube("Source")
    source.hide_render = True
    data = bpy.data.volumes.new("Cloud")
    item = linked(bpy.data.objects.new("Cloud", data))
    modifier = item.modifiers.new("fill", "MESH_TO_VOLUME")
    modifier.object, modifier.density = source, 3.0
    data.materials.append(fog("Fog", 1.0, "ShaderNodeVolumePrincipled"))
    document, _, files = exported(tmp_path)
    assert document["volume"]["shape"]["type"] == "grid"
    (name, path), *_ = files.items()
    assert volume_grid.read(path)["values"].max() == pytest.approx(3.0, rel=1e-3)
    assert document["volume"]["shape"]["file"] == name


def test_grids_that_nodes_make_are_written(empty, tmp_path):
    group = bpy.data.node_groups.new("Volume", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        group.interface.new_socket(name="Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    filled, painted = (group.nodes.new(f"GeometryNode{kind}") for kind in ("VolumeCube", "SetMaterial"))
    filled.inputs["Density"].default_value = 2.0
    for axis in "XYZ":
        filled.inputs[f"Resolution {axis}"].default_value = 8
    painted.inputs["Material"].default_value = fog("Fog", 1.0, "ShaderNodeVolumePrincipled")
    group.links.new(painted.inputs["Geometry"], filled.outputs["Volume"])
    group.links.new(group.nodes.new("NodeGroupOutput").inputs[0], painted.outputs["Geometry"])
    cube("Box").modifiers.new("fill", "NODES").node_group = group
    document, _, files = exported(tmp_path)
    assert names(document) == ["Box"] and document["volume"]["shape"]["type"] == "grid"
    assert volume_grid.read(next(iter(files.values())))["values"].max() == 2.0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda item: setattr(item.data.render, "space", "WORLD"), "set Space to Object"),
        (lambda item: setattr(item.data, "filepath", "//gone.vdb"), "correct the path"),
    ],
)
def test_what_a_scene_cannot_say_of_grids_is_refused(empty, tmp_path, change, expected):
    item, _ = _smoke(tmp_path)
    item.data.materials.append(fog("Smoke", 2.0, "ShaderNodeVolumePrincipled"))
    change(item)
    assert expected in refusal(tmp_path)


def test_other_grids_of_principled_volume_are_refused(empty, tmp_path):
    item, _ = _smoke(tmp_path, ("density", "temperature"))
    material = fog("Fire", 2.0, "ShaderNodeVolumePrincipled")
    item.data.materials.append(material)
    material.node_tree.nodes["Principled Volume"].inputs["Blackbody Intensity"].default_value = 1.0
    assert "Temperature Attribute" in refusal(tmp_path)


def test_a_file_without_density_is_refused(empty, tmp_path):
    item, _ = _smoke(tmp_path, ("soot",))
    item.data.materials.append(fog("Smoke", 2.0, "ShaderNodeVolumePrincipled"))
    text = refusal(tmp_path)
    assert "soot" in text and "density" in text


# Cameras, film, scenes


def test_the_active_of_two_cameras_is_taken_and_the_other_said(empty, tmp_path):
    cube("Cube", fog("Fog"))
    linked(bpy.data.objects.new("Other camera", bpy.data.cameras.new("Other camera")))
    document, warnings, _ = exported(tmp_path)
    assert document["camera"]["name"] == "Camera"
    assert len(warnings) == 1 and "Other camera" in warnings[0]


def test_a_camera_is_chosen_or_made_where_none_is_active(empty, tmp_path):
    cube("Cube", fog("Fog"))
    empty.camera = None
    document, warnings, _ = exported(tmp_path)
    assert document["camera"]["name"] == "Camera" and "no active one" in warnings[0]
    # The open file is the one that was read, with the camera that was chosen.
    bpy.context.scene.camera = None
    linked(bpy.data.objects.new("Another", bpy.data.cameras.new("Another")))
    document, warnings, _ = exported(tmp_path)
    assert document["camera"]["name"] == "Another" and '"Camera" (--camera)' in warnings[0]
    document, warnings, _ = exported(tmp_path, camera="Camera")
    assert document["camera"]["name"] == "Camera" and not warnings
    assert "one of Another, Camera" in refusal(tmp_path, camera="Nobody")
    for name in ("Camera", "Another"):
        bpy.data.objects.remove(bpy.data.objects[name])
    assert "the scene has none" in refusal(tmp_path, camera="Nobody")


@pytest.mark.parametrize("size", [(64, 36), (36, 64)])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_a_camera_of_ours_frames_all_volumes(empty, tmp_path, size, scale):
    bpy.data.objects.remove(bpy.data.objects["Camera"])
    for name, location in (("Near", (1, -3, 0.5)), ("Far", (-4, 2, 3))):
        cube(name, fog(name), location=np.array(location) * scale).scale = (scale,) * 3
    empty.render.resolution_x, empty.render.resolution_y = size
    document, warnings, _ = exported(tmp_path)
    assert "one of ours frames all volumes" in warnings[0]
    camera = document["camera"]
    corners = []
    for volume in volumes(document):
        matrix = np.array(volume["matrix_world"])
        for bit in range(8):
            corner = [volume["bounds"]["max" if bit >> axis & 1 else "min"][axis] for axis in range(3)]
            corners.append(matrix[:3, :3] @ corner + matrix[:3, 3])
    matrix = np.array(camera["matrix_world"])
    seen = (np.array(corners) - matrix[:3, 3]) @ matrix[:3, :3]
    # The frame is as wide as the sensor at the focal length, along its longer side.
    across = np.abs(seen[:, :2] / -seen[:, 2:]) * camera["focal_length"] / (camera["sensor_width"] / 2)
    across = across.max(axis=0) * max(size) / np.array(size)
    assert np.isclose(across.max(), 0.8, rtol=1e-4) and (across <= 0.8001).all()
    assert camera["clip_start"] < -seen[:, 2].max() and -seen[:, 2].min() < camera["clip_end"]
    assert matrix[0][3] > 0 and matrix[1][3] < 0 and matrix[2][3] > 0


def test_a_marker_chooses_the_camera(empty, tmp_path):
    cube("Cube", fog("Fog"))
    other = linked(bpy.data.objects.new("Later", bpy.data.cameras.new("Later")))
    for frame, camera in ((1, bpy.data.objects["Camera"]), (20, other)):
        empty.timeline_markers.new(camera.name, frame=frame).camera = camera
    document, _, _ = exported(tmp_path, frame=5)
    assert document["camera"]["name"] == "Camera"
    document, _, _ = exported(tmp_path, frame=30)
    assert document["camera"]["name"] == "Later"


@pytest.mark.parametrize(
    "settings",
    [
        {"type": "PERSP", "lens": 60.0},
        {"type": "PERSP", "size": (70, 121), "shift_x": 0.05, "shift_y": -0.03},
        {
            "type": "PERSP",
            "sensor_fit": "VERTICAL",
            "sensor_height": 20.0,
            "shift_y": 0.1,
            "aspect": (1.5, 1.0),
        },
        {"type": "ORTHO", "ortho_scale": 4.0, "percentage": 53},
        {"type": "PERSP", "sensor_fit": "HORIZONTAL", "size": (70, 121), "aspect": (1.0, 1.7)},
    ],
)
def test_a_cropped_region_is_the_frame(empty, tmp_path, settings):
    settings = dict(settings)
    cube("Cube", fog("Fog")).rotation_euler = (0.3, 0.4, 0.5)
    render = empty.render
    render.resolution_x, render.resolution_y = settings.pop("size", (120, 70))
    render.pixel_aspect_x, render.pixel_aspect_y = settings.pop("aspect", (1.0, 1.0))
    render.resolution_percentage = settings.pop("percentage", 100)
    for name, value in settings.items():
        setattr(empty.camera.data, name, value)
    render.use_border = render.use_crop_to_border = True
    render.border_min_x, render.border_max_x = 0.21, 0.743
    render.border_min_y, render.border_max_y = 0.13, 0.61
    expected = picture(tmp_path)
    document, warnings, _ = exported(tmp_path)
    assert not warnings
    built(document, tmp_path)
    found = picture(tmp_path)
    assert found.shape == expected.shape
    # Ends of the chord move with the rounding of the camera's f32 numbers, 2^-22 of some ten metres, and the
    # picture by no more than ten times as much where a ray grazes an edge.
    assert np.abs(found - expected).max() < 1e-4
    assert expected.std() > 0.1


def test_a_region_that_is_not_the_frame_is_said(empty, tmp_path):
    cube("Cube", fog("Fog"))
    empty.render.use_border = True
    document, warnings, _ = exported(tmp_path)
    assert document["film"]["resolution"] == [4, 4]
    assert len(warnings) == 1 and "Crop to Render Region" in warnings[0]


def test_what_the_picture_will_lack_is_said(empty, tmp_path):
    cube("Cube", fog("Fog"))
    empty.render.use_motion_blur = empty.render.use_multiview = True
    empty.camera.data.dof.use_dof = True
    empty.render.engine = "BLENDER_EEVEE"
    bpy.data.scenes.new("Other scene")
    empty.view_layers.new("Other layer")
    empty.compositing_node_group = bpy.data.node_groups.new("Glow", "CompositorNodeTree")
    _, warnings, _ = exported(tmp_path)
    text = "\n".join(warnings)
    words = ("motion blur", "stereoscopy", "in focus", "Cycles makes of", "Other scene", "Other layer")
    for word in (*words, "compositor"):
        assert word in text
    assert len(warnings) == 7


# Time


def _animate(material):
    noise = material.node_tree.nodes.new("ShaderNodeTexNoise")
    noise.noise_dimensions = "4D"
    noise.name = "Cloud noise"
    material.node_tree.links.new(
        material.node_tree.nodes["Volume Absorption"].inputs["Density"], noise.outputs[0]
    )
    return noise.inputs["W"]


def _w(document):
    nodes = {node["name"]: node for node in document["graph"]["nodes"]}
    return nodes["Cloud noise"]["inputs"]["W"]


def test_keyframes_are_read_at_the_frame_and_said(empty, tmp_path):
    material = fog("Fog")
    item = cube("Cube", material)
    socket = _animate(material)
    for frame, value in ((1, 0.0), (101, 10.0)):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
        item.location.x = value
        item.keyframe_insert("location", index=0, frame=frame)
    empty.frame_set(1)
    document, warnings, _ = exported(tmp_path)
    assert _w(document) == 0.0
    text = "\n".join(warnings)
    assert "inputs[1].default_value" in text and "location[0]" in text and "at frame 1 " in text
    assert len(warnings) == 2
    document, warnings, _ = exported(tmp_path, frame=101)
    assert _w(document) == 10.0
    assert document["volume"]["matrix_world"][0][3] == 10.0
    assert all("at frame 101 " in warning for warning in warnings)


def test_a_curve_that_stays_where_it_is_is_not_said(empty, tmp_path):
    item = cube("Cube", fog("Fog"))
    for frame in (1, 20):
        item.keyframe_insert("location", frame=frame)
    _, warnings, _ = exported(tmp_path)
    assert not warnings


def test_an_animated_parent_camera_light_and_world_are_said(empty, tmp_path):
    item = cube("Cube", fog("Fog"))
    parent = linked(bpy.data.objects.new("Carrier", None))
    item.parent = parent
    lamp = linked(bpy.data.objects.new("Lamp", bpy.data.lights.new("Lamp", "SUN")))
    strength = empty.world.node_tree.nodes["Background"].inputs["Strength"]
    for frame in (1, 50):
        parent.location.z = lamp.data.energy = empty.camera.data.lens = strength.default_value = 1.0 + frame
        for owner, path in ((parent, "location"), (lamp.data, "energy"), (strength, "default_value")):
            owner.keyframe_insert(path, frame=frame)
        empty.camera.data.keyframe_insert("lens", frame=frame)
    document, warnings, _ = exported(tmp_path, frame=50)
    places = sorted(warning.split(": animated")[0] for warning in warnings)
    assert places == [
        'camera "Camera", data',
        'light "Lamp", data',
        'object "Carrier", parent',
        'world "World"',
    ]
    assert document["world"]["strength"] == 51.0 and document["lights"][0]["strength"] == 51.0


@pytest.mark.parametrize("frame", [0, 251])
def test_a_frame_outside_is_refused_with_the_range(empty, tmp_path, frame):
    cube("Cube", fog("Fog"))
    text = refusal(tmp_path, frame=frame)
    assert f"found {frame}" in text and "1 to 250" in text


def test_simple_drivers_are_computed_and_others_said(empty, tmp_path):
    material = fog("Fog")
    item = cube("Cube", material)
    driver = _animate(material).driver_add("default_value").driver
    driver.expression = "frame/24"
    # What Blender does not compute for a file that may run no Python.
    item.driver_add("location", 0).driver.expression = "noise.random() + 3"
    item.hide_viewport = True
    document, warnings, _ = exported(tmp_path, frame=48)
    assert _w(document) == 2.0
    text = "\n".join(warnings)
    assert "driver frame/24" in text and "at frame 48 " in text
    assert "'noise.random() + 3' was not computed" in text and "location[0]" in text
    assert len(warnings) == 2


# Libraries


def _library(folder):
    """A file with a collection, and one that uses it; the path of the library."""
    path = folder / "library.blend"
    material = fog("Fog")
    collection = bpy.data.collections.new("Clouds")
    collection.objects.link(bpy.data.objects.new("Inner", cube_mesh("Inner", [material])))
    bpy.data.libraries.write(str(path), {collection, material}, fake_user=True)
    return path


def _linked(path, kind, name):
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        setattr(wanted, kind, [name])
    return next(item for item in getattr(bpy.data, kind) if item.name == name and item.library is not None)


@pytest.fixture
def library(empty, tmp_path):
    """Path of a library; the open file is an empty one."""
    path = _library(tmp_path)
    for collection in (bpy.data.collections, bpy.data.materials, bpy.data.meshes):
        for item in list(collection):
            collection.remove(item)
    return path


def test_linked_and_overridden_data_is_read(library, tmp_path):
    carrier = linked(bpy.data.objects.new("Carrier", None))
    carrier.instance_type, carrier.instance_collection = (
        "COLLECTION",
        _linked(library, "collections", "Clouds"),
    )
    override = _linked(library, "objects", "Inner").override_create()
    override.location = (0, 0, 5)
    linked(override)
    # A material of the file's own with the name of the linked one.
    cube("Own", fog("Fog", 2.0))
    document, _, _ = exported(tmp_path)
    assert names(document) == ["Carrier/Inner (library.blend)/0", "Inner", "Own"]
    assert [volume["material"] for volume in volumes(document)] == ["Fog (library.blend)"] * 2 + ["Fog"]
    assert document["other_volumes"][0]["matrix_world"][2][3] == 5.0


@pytest.mark.parametrize("kind", ["collection", "material", "object"])
@pytest.mark.parametrize("is_all", [False, True])
def test_a_library_that_is_gone_is_reported_with_its_path(library, tmp_path, kind, is_all):
    if kind == "collection":
        carrier = linked(bpy.data.objects.new("Carrier", None))
        carrier.instance_type = "COLLECTION"
        carrier.instance_collection = _linked(library, "collections", "Clouds")
    elif kind == "material":
        cube("Own", _linked(library, "materials", "Fog"))
    else:
        linked(_linked(library, "objects", "Inner"))
    if not is_all:
        cube("Other", fog("Own fog"))
    library.rename(tmp_path / "moved.blend")
    if is_all:
        # Nothing is left to show.
        text = refusal(tmp_path)
        assert "no volume that renders" in text and "correct the path" in text
        return
    document, warnings, _ = exported(tmp_path)
    assert names(document) == ["Other"]
    text = next(warning for warning in warnings if "library.blend" in warning)
    assert "put the library back" in text and text.startswith(kind)


def test_the_outputs_of_a_group_whose_library_is_gone_are_0(empty, tmp_path):
    group = bpy.data.node_groups.new("Density", "ShaderNodeTree")
    group.interface.new_socket("Value", in_out="OUTPUT", socket_type="NodeSocketFloat").default_value = 0.25
    value, output = group.nodes.new("ShaderNodeValue"), group.nodes.new("NodeGroupOutput")
    value.outputs[0].default_value = 0.5
    group.links.new(value.outputs[0], output.inputs[0])
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {group})
    bpy.data.node_groups.remove(group)
    material = fog("Fog")
    tree = material.node_tree
    call = tree.nodes.new("ShaderNodeGroup")
    call.node_tree = _linked(tmp_path / "library.blend", "node_groups", "Density")
    closure = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumeAbsorption")
    tree.links.new(call.outputs[0], closure.inputs["Density"])
    cube("Cube", material)
    assert picture(tmp_path).mean() < 0.9
    (tmp_path / "library.blend").rename(tmp_path / "moved.blend")
    document, warnings, _ = exported(tmp_path)
    assert "its outputs are 0" in warnings[0] and "put the library back" in warnings[0]
    assert [group["nodes"] for group in document["graph"]["groups"]] == [[]]
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    assert np.allclose(picture(tmp_path), 1.0, atol=1e-6)


def test_a_library_that_is_gone_and_not_needed_does_not_matter(library, tmp_path):
    _linked(library, "materials", "Fog").use_fake_user = True
    cube("Own", fog("Own fog"))
    library.rename(tmp_path / "moved.blend")
    document, _, _ = exported(tmp_path)
    assert names(document) == ["Own"]


# Lights


def _lamp(kind, **settings):
    data = bpy.data.lights.new("Lamp", kind)
    data.energy = 3.0
    item = linked(bpy.data.objects.new("Lamp", data))
    item.location, item.rotation_euler = (0.1, -20, 0.2), (math.pi / 2, 0, 0)
    for name, value in settings.items():
        setattr(data, name, value)
    return item


def _white_wall():
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata([(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)], [], [(0, 1, 2, 3)])
    mesh.materials.append(surface("White", "ShaderNodeBsdfDiffuse"))
    linked(bpy.data.objects.new("Wall", mesh))


@pytest.mark.parametrize(
    ("kind", "settings", "scale"),
    [
        ("SUN", {"angle": 0.3}, 1.0),
        ("POINT", {"shadow_soft_size": 0.5}, 1.0),
        ("SPOT", {"shadow_soft_size": 0.5}, 1.0),
        ("AREA", {"shape": "RECTANGLE", "size": 0.4, "size_y": 0.7}, 3.0),
        ("AREA", {"shape": "ELLIPSE", "size": 0.4, "size_y": 0.7}, 1.0),
        ("AREA", {"shape": "DISK", "size": 0.4}, 1.0),
    ],
)
def test_a_light_that_is_not_normalised_is_the_same_one_with_another_strength(
    empty, tmp_path, kind, settings, scale
):
    empty.world = None
    _white_wall()
    lamp = _lamp(kind, normalize=False, use_temperature=True, temperature=3200.0, color=(0.5, 0.25, 1.0))
    lamp.scale = (scale, 2.0, 1.0)
    for name, value in settings.items():
        setattr(lamp.data, name, value)
    lamp.data.use_nodes = True
    emission = lamp.data.node_tree.nodes["Emission"]
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (
        (0.2, 0.4, 0.6, 1),
        3.0,
    )
    expected = picture(tmp_path, samples=64).mean(axis=(0, 1))
    cube("Cube", fog("Fog"))
    document, _, _ = exported(tmp_path)
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    bpy.data.objects.remove(bpy.data.objects["Lamp"])
    light = document["lights"][0]
    again = _lamp(kind, color=light["color"], energy=light["strength"], **settings)
    again.scale = (scale, 2.0, 1.0)
    found = picture(tmp_path, samples=64).mean(axis=(0, 1))
    # The same samples of the same light: what is left is the rounding of f32.
    assert found == pytest.approx(expected, rel=1e-5)
    assert expected.min() > 0.0


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda lamp: setattr(lamp.data, "use_shadow", False), "Cast Shadow"),
        (lambda lamp: setattr(lamp.data.cycles, "max_bounces", 0), "Max Bounces"),
        (
            lambda lamp: setattr(lamp.light_linking, "receiver_collection", bpy.data.collections.new("Some")),
            "light linking",
        ),
    ],
)
def test_light_settings_of_another_transport_are_refused(empty, tmp_path, change, expected):
    cube("Cube", fog("Fog"))
    empty.cycles.volume_bounces = 2
    change(_lamp("POINT"))
    assert expected in refusal(tmp_path)


def test_lights_that_light_no_volume_are_left_out(empty, tmp_path):
    cube("Cube", fog("Fog", 0.2, "ShaderNodeVolumeScatter", (1, 1, 1, 1)))
    empty.world = None
    lamp = _lamp("POINT")
    lamp.visible_volume_scatter = False
    assert picture(tmp_path, samples=16).max() == 0.0
    document, warnings, _ = exported(tmp_path)
    assert not document["lights"] and "lights no volume" in warnings[0]
    assert "the picture will be black" in warnings[1]
    bpy.data.objects["Lamp"].hide_render = True
    document, warnings, _ = exported(tmp_path)
    assert not document["lights"] and len(warnings) == 1 and "black" in warnings[0]


# The world


def _background():
    tree = bpy.context.scene.world.node_tree
    return tree, tree.nodes["Background"]


def _read_picture(path):
    image = bpy.data.images.load(path)
    image.colorspace_settings.name = "Linear Rec.709"
    values = np.array(image.pixels[:], np.float32).reshape(image.size[1], image.size[0], -1)
    return values[..., :3]


def test_constant_nodes_fold(empty, tmp_path):
    cube("Cube", fog("Fog"))
    tree, background = _background()
    color = tree.nodes.new("ShaderNodeRGB")
    color.outputs[0].default_value = (0.1, 0.2, 0.3, 1)
    value = tree.nodes.new("ShaderNodeValue")
    value.outputs[0].default_value = 2.0
    tree.links.new(background.inputs["Color"], color.outputs[0])
    tree.links.new(background.inputs["Strength"], value.outputs[0])
    add = tree.nodes.new("ShaderNodeAddShader")
    other = tree.nodes.new("ShaderNodeBackground")
    other.inputs["Color"].default_value = (0.25, 0.5, 0.75, 1)
    tree.links.new(add.inputs[0], background.outputs[0])
    tree.links.new(add.inputs[1], other.outputs[0])
    output = tree.nodes["World Output"]
    tree.links.new(output.inputs["Surface"], add.outputs[0])
    document, warnings, files = exported(tmp_path)
    assert document["world"]["color"] == pytest.approx([0.45, 0.9, 1.35], rel=1e-6)
    assert not warnings and not files


@pytest.mark.parametrize("is_packed", [False, True])
def test_a_picture_of_another_format_keeps_its_pixels(empty, tmp_path, is_packed):
    cube("Cube", fog("Fog"))
    values = np.random.default_rng(1).random((16, 32, 4)).astype(np.float32)
    made = bpy.data.images.new("made", 32, 16, float_buffer=True)
    made.colorspace_settings.name = "Linear Rec.709"
    made.pixels.foreach_set(values.ravel())
    made.filepath_raw, made.file_format = str(tmp_path / "sky.hdr"), "HDR"
    made.save()
    expected = _read_picture(made.filepath_raw)
    image = bpy.data.images.load(made.filepath_raw)
    if is_packed:
        image.pack()
    tree, background = _background()
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    tree.links.new(background.inputs["Color"], texture.outputs[0])
    document, warnings, files = exported(tmp_path)
    (name, path), *_ = files.items()
    assert document["world"] == {
        "color": [1.0, 1.0, 1.0],
        "strength": 1.0,
        "image": {"file": name, "sha256": hashlib.sha256(Path(path).read_bytes()).hexdigest()},
    }
    found = _read_picture(path)
    # A ray meets a pixel up to a two-hundredth beside its centre, where neighbours differ by up to 1.
    assert found.shape == expected.shape and np.abs(found - expected).max() < 0.02
    assert np.abs(found - expected).mean() < 1e-4
    assert "32 x 16 pixels" in warnings[0]


def test_a_procedural_world_is_a_picture_that_is_always_the_same(empty, tmp_path):
    cube("Cube", fog("Fog"))
    tree, background = _background()
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    tree.links.new(background.inputs["Color"], gradient.outputs[0])
    first, warnings, files = exported(tmp_path)
    second, _, _ = exported(tmp_path)
    assert first["world"] == second["world"]
    assert "rendered by Cycles" in warnings[0] and "Gradient Texture" in warnings[0]
    # The gradient is x of the direction where that is positive.
    found = _read_picture(next(iter(files.values())))
    rows, columns = found.shape[:2]
    longitude = (0.5 - (np.arange(columns) + 0.5) / columns) * 2 * math.pi
    latitude = ((np.arange(rows) + 0.5) / rows - 0.5) * math.pi
    expected = np.maximum(np.cos(latitude)[:, None] * np.cos(longitude), 0.0)
    # A two-hundredth of a pixel of 2 pi / 512.
    assert np.abs(found - expected[..., None]).max() < 1e-4


def test_a_sky_is_a_picture_and_its_sun_a_light(empty, tmp_path):
    cube("Cube", fog("Fog"))
    tree, background = _background()
    sky = tree.nodes.new("ShaderNodeTexSky")
    # The model that costs least to prepare; what is tested is the same for both.
    sky.sky_type = "SINGLE_SCATTERING"
    sky.sun_elevation, sky.sun_rotation, sky.sun_size = 0.7, 0.4, 0.03
    tree.links.new(background.inputs["Color"], sky.outputs[0])
    document, warnings, _ = exported(tmp_path)
    light = document["lights"][0]
    assert light["type"] == "sun" and light["angle"] == pytest.approx(0.03)
    towards = [row[2] for row in light["matrix_world"][:3]]
    assert towards[2] == pytest.approx(math.sin(0.7), abs=1e-4)
    assert any("sun disc" in warning for warning in warnings)
    # Both lights a white wall as the sky with its disc does, from the front: it faces -Y.
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"))
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    _white_wall()
    wall = bpy.data.objects["Wall"]
    wall.rotation_euler = (-math.pi / 2, 0, 0)
    camera = bpy.context.scene.camera
    camera.location, camera.rotation_euler = (0.1, 0.2, 5), (0, 0, 0)
    expected = picture(tmp_path, samples=4096).mean(axis=(0, 1))
    beside = tmp_path / "beside"
    tree, background = _background()
    image = bpy.data.images.load(str(beside / document["world"]["image"]["file"]))
    image.colorspace_settings.name = "Linear Rec.709"
    texture = tree.nodes.new("ShaderNodeTexEnvironment")
    texture.image = image
    tree.links.new(background.inputs["Color"], texture.outputs[0])
    sun = linked(bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN")))
    sun.data.color, sun.data.energy, sun.data.angle = light["color"], light["strength"], light["angle"]
    sun.matrix_world = Matrix(light["matrix_world"])
    found = picture(tmp_path, samples=4096).mean(axis=(0, 1))
    # The picture's resolution and the noise of both renders; without the sun it would be a fraction.
    assert found == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize(
    ("kind", "output", "expected"),
    [
        ("ShaderNodeLightPath", "Is Camera Ray", "another world than the one that lights"),
        ("ShaderNodeTexCoord", "Window", "coordinates (Window) of the camera"),
    ],
)
def test_worlds_of_another_transport_are_refused(empty, tmp_path, kind, output, expected):
    cube("Cube", fog("Fog"))
    tree, background = _background()
    tree.links.new(background.inputs["Strength"], tree.nodes.new(kind).outputs[output])
    assert expected in refusal(tmp_path)


def test_a_world_volume_and_hidden_worlds_are_refused(empty, tmp_path):
    cube("Cube", fog("Fog"))
    empty.world.cycles_visibility.camera = False
    assert "the camera cannot see it" in refusal(tmp_path)
    world = bpy.data.worlds["World"]
    world.cycles_visibility.camera = True
    tree = world.node_tree
    scatter = tree.nodes.new("ShaderNodeVolumeScatter")
    tree.links.new(tree.nodes["World Output"].inputs["Volume"], scatter.outputs[0])
    assert "put a large cube" in refusal(tmp_path)


# Graphs


def test_a_refused_node_says_why_and_what_to_do(empty, tmp_path):
    material = fog("Fog")
    cube("Cube", material)
    tree = material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("picture", 4, 4)
    tree.links.new(tree.nodes["Volume Absorption"].inputs["Density"], texture.outputs["Color"])
    reasons = {"ShaderNodeTexImage": ["reads a picture", "Bake it into a grid."]}
    text = refusal(tmp_path, refused=reasons)
    assert (
        "Image Texture (ShaderNodeTexImage), which reads a picture" in text and "Bake it into a grid." in text
    )


# Safety of opening


def test_opening_and_exporting_runs_nothing_of_the_file(empty, tmp_path):
    traces = tmp_path / "traces"
    traces.mkdir()
    text = bpy.data.texts.new("start.py")
    text.write(
        f"import bpy, pathlib\ndef trace(*_):\n pathlib.Path({str(traces)!r}, 'handler').touch()\n"
        f"pathlib.Path({str(traces)!r}, 'script').touch()\n"
        "bpy.app.handlers.load_post.append(trace)\nbpy.app.handlers.frame_change_post.append(trace)\n"
        "bpy.app.handlers.render_init.append(trace)\nbpy.app.handlers.depsgraph_update_post.append(trace)\n"
    )
    text.use_module = True
    material = fog("Fog")
    item = cube("Cube", material)
    code = f"__import__('pathlib').Path({str(traces)!r}, 'driver').touch() or 3.0"
    item.driver_add("location", 0).driver.expression = code
    tree = material.node_tree
    shader = bpy.data.texts.new("shader.osl")
    shader.write(f'shader trace(output float Value = 0) {{ fprintf("{traces}/osl", "x"); Value = 1; }}')
    script = tree.nodes.new("ShaderNodeScript")
    script.script = shader
    path = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    # Blender may have computed the driver while the file was made.
    for file in traces.iterdir():
        file.unlink()
    document, warnings, _ = exported_file(path, tmp_path, frame=7)
    assert not list(traces.iterdir())
    assert names(document) == ["Cube"]
    assert any("was not computed" in warning for warning in warnings)
    assert any("Script" in warning and "does not reach the volume" in warning for warning in warnings)


def test_the_file_of_the_safety_test_would_run(empty, tmp_path):
    """With scripts allowed, Blender runs what that test forbids: it can fail."""
    trace = tmp_path / "driver"
    item = cube("Cube", fog("Fog"))
    item.driver_add(
        "location", 0
    ).driver.expression = f"__import__('pathlib').Path({str(trace)!r}).touch() or 3.0"
    text = bpy.data.texts.new("start.py")
    text.write(f"__import__('pathlib').Path({str(tmp_path / 'script')!r}).touch()")
    text.use_module = True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"), copy=True)
    trace.unlink(missing_ok=True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "file.blend"), use_scripts=True)
    bpy.context.evaluated_depsgraph_get()
    assert trace.exists() and (tmp_path / "script").exists()
    bpy.ops.wm.read_factory_settings(use_empty=True)


# Old files

OLD_FILES = Path(__file__).parents[1] / "data" / "old-blends"


@pytest.mark.parametrize("version", ["4.2", "4.5"])
def test_a_file_of_an_old_version_is_the_scene_of_one_made_anew(tmp_path, version):
    code = (OLD_FILES / "make.py").read_text(encoding="utf-8")
    maker = {"__name__": "maker"}
    exec(compile(code, "make.py", "exec"), maker)
    maker["make"]()
    maker["save"](str(tmp_path / "new.blend"))
    expected, said, _ = exported_file(tmp_path / "new.blend", tmp_path, frame=51)
    found, warnings, _ = exported_file(OLD_FILES / f"blender-{version}.blend", tmp_path, frame=51)
    assert bpy.data.version[:2] == tuple(int(part) for part in version.split("."))
    names_of_files = {expected.pop("name"), found.pop("name")}
    assert names_of_files == {"new", f"blender-{version}"}
    assert found == expected
    assert warnings == said and len(said) == 1 and "at frame 51" in said[0]
    noise = next(node for node in found["graph"]["groups"][0]["nodes"] if node["name"] == "Noise Texture")
    assert 0.0 < noise["inputs"]["W"] < 5.0


# What is exported renders as the file does


def _show_all(scene):
    """Look at everything from the side, at 60 x 40 pixels."""
    scene.camera.data.ortho_scale = 9.0
    scene.camera.location = (1.5, -20.0, 0.5)
    scene.render.resolution_x, scene.render.resolution_y = 60, 40


def test_instances_and_other_geometry_render_alike_once_built(empty, tmp_path):
    _show_all(empty)
    material = fog("Fog", 0.3)
    field = cube("Field")
    field.modifiers.new("scatter", "NODES").node_group = _instancing_nodes(fog("Thick", 0.8))
    field.rotation_euler = (0.2, 0.4, 0.1)
    collection = bpy.data.collections.new("Clouds")
    inner = bpy.data.objects.new("Inner", cube_mesh("Inner", [material]))
    inner.modifiers.new("round", "SUBSURF").render_levels = 2
    collection.objects.link(inner)
    for number in range(3):
        carrier = linked(bpy.data.objects.new("Carrier", None))
        carrier.instance_type, carrier.instance_collection = "COLLECTION", collection
        carrier.location, carrier.scale = (2.0 * number, 0, 1), (1, 0.5, 1 + 0.5 * number)
    text = bpy.data.curves.new("Text", "FONT")
    text.extrude = 0.5
    text.materials.append(material)
    item = linked(bpy.data.objects.new("Text", text))
    item.location, item.rotation_euler = (3, -3, -2), (math.pi / 2, 0, 0)
    expected = picture(tmp_path)
    document, _, _ = exported(tmp_path)
    assert len(volumes(document)) == 12
    built(document, tmp_path)
    found = picture(tmp_path)
    assert expected.std() > 0.1
    different = np.abs(found - expected).max(axis=2) > 1e-4
    # A ray through an edge may fall on its other side: of the text, whose outline has many.
    assert different.mean() < 0.005


def test_smoke_renders_alike_once_built(empty, tmp_path):
    _show_all(empty)
    item, _ = _smoke(tmp_path)
    item.scale, item.location = (2, 3, 1.5), (0, 0, -1)
    item.data.render.clipping = 0.0
    item.data.materials.append(fog("Smoke", 2.0, "ShaderNodeVolumePrincipled", (0.8, 0.6, 0.4, 1)))
    _lamp("SUN", energy=5.0).rotation_euler = (0.5, 0.3, 0)
    expected = picture(tmp_path, samples=16)
    document, _, files = exported(tmp_path)
    for name, path in files.items():
        shutil.copy(path, tmp_path / "beside" / name)
    built(document, tmp_path)
    found = picture(tmp_path, samples=16)
    # The same random numbers in the same scene, whose volume and camera keep their places up to rounding:
    # what differs by more than that are single paths that a rounding sent elsewhere.
    assert expected.std() > 0.1
    assert (np.abs(found - expected).max(axis=2) > 1e-3).mean() < 0.02
    assert found.mean() == pytest.approx(expected.mean(), rel=1e-3)


# What Blender's module breaks down at, and what a file lacks


def domain(name, kind="GAS", material=None):
    """A cube that is a fluid domain."""
    item = cube(name, *([material] if material else []))
    modifier = item.modifiers.new("Fluid", "FLUID")
    modifier.fluid_type = "DOMAIN"
    modifier.domain_settings.domain_type = kind
    return item


def _saved_apart(path, code):
    """Save what `code` makes of a new scene, in a process of its own."""
    save = f"bpy.ops.wm.save_as_mainfile(filepath={str(path)!r}, copy=True)"
    run_apart(f"from test_blend_files import *\nnew_scene()\n{code}\n{save}")


def _run(path, folder, **request):
    """Export a file in a process of its own: (events by kind, exit status)."""
    whole = {"blend": str(path), "object": None, "folder": str(folder)} | request
    events, status = run_script("export_scene.py", whole)
    return {kind: [item for item in events if item["event"] == kind] for kind in ("warning", "done")}, status


@pytest.mark.parametrize("kind", ["GAS", "LIQUID"])
@pytest.mark.parametrize("others", [True, False])
def test_a_fluid_domain_is_read_around(tmp_path, kind, others):
    path = tmp_path / "file.blend"
    other = 'cube("Cube", fog("Fog"), location=(5, 0, 0))' if others else ""
    _saved_apart(path, f'domain("Domain", {kind!r}, fog("Smoke"))\n{other}')
    events, status = _run(path, tmp_path)
    assert status == 0
    document = events["done"][0]["result"]["scene"]
    warning = next(item for item in events["warning"] if "fluid domains" in item["place"])
    assert "cache of the simulation" in warning["message"] and "Domain" in warning["place"]
    if others:
        assert names(document) == ["Cube"]
    else:
        # As Blender shows it without a cache: nothing.
        assert names(document) == ["Domain"]
        (closure,) = [node for node in document["graph"]["nodes"] if "Principled" in node["type"]]
        assert closure["inputs"]["Density"] == 0.0


def test_a_domain_that_is_no_volume_harms_nothing(tmp_path):
    path = tmp_path / "file.blend"
    _saved_apart(
        path,
        'domain("Hidden", "GAS", fog("Smoke")).hide_render = True\n'
        'domain("Surface", "LIQUID", surface("Water"))\n'
        'cube("Cube", fog("Fog"), location=(5, 0, 0))',
    )
    events, status = _run(path, tmp_path)
    assert status == 0 and names(events["done"][0]["result"]["scene"]) == ["Cube"]


def test_freestyle_is_off_while_reading(empty, tmp_path):
    cube("Cube", fog("Fog"))
    empty.render.use_freestyle = True
    empty.view_layers[0].use_freestyle = True
    path = tmp_path / "file.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    events, status = _run(path, tmp_path)
    assert status == 0 and "Freestyle" in events["warning"][0]["place"]


def test_what_a_file_without_volumes_could_show_is_listed(empty, tmp_path):
    hidden, excluded, without = (cube(name, fog(f"{name} fog")) for name in ("Hidden", "Excluded", "Bare"))
    hidden.hide_render = True
    collection = bpy.data.collections.new("Away")
    empty.collection.children.link(collection)
    empty.collection.objects.unlink(excluded)
    collection.objects.link(excluded)
    bpy.context.view_layer.layer_collection.children["Away"].exclude = True
    without.data.clear_geometry()
    fog("Unused").use_fake_user = True
    text = refusal(tmp_path)
    for part in (
        '"Hidden fog" on "Hidden", hidden in renders',
        '"Excluded fog" on "Excluded", in a collection that is hidden in renders or excluded',
        '"Bare fog" on "Bare", which has no faces',
        'material "Unused" on no object',
        "--material NAME",
    ):
        assert part in text, text
    document, warnings, _ = exported(tmp_path, include_hidden=True)
    assert names(document) == ["Excluded", "Hidden"]
    assert any("--include-hidden" in warning for warning in warnings)


def test_a_material_is_shown_on_a_cube(empty, tmp_path):
    fog("Unused", 0.25).use_fake_user = True
    surface("Wood").use_fake_user = True
    cube("Cube", fog("Fog"), location=(9, 9, 9))
    document, warnings, _ = exported(tmp_path, material="Unused")
    assert names(document) == ["Cube of Unused"] and document["graph"]["material"] == "Unused"
    assert document["volume"]["shape"] == {"type": "box"}
    assert document["volume"]["bounds"] == {"min": [-1.0] * 3, "max": [1.0] * 3}
    assert any("frames the material's cube" in warning for warning in warnings)
    assert document["camera"]["matrix_world"][0][3] > 2.0
    document, _, _ = exported(tmp_path, material="Unused", camera="Camera")
    assert document["camera"]["matrix_world"][1][3] == -10.0
    assert "a material without a volume" in refusal(tmp_path, material="Wood")
    assert "one of Fog, Unused" in refusal(tmp_path, material="Nothing")


def test_a_volume_object_without_a_material_has_that_of_cycles(empty, tmp_path):
    _, path = _smoke(tmp_path)
    plain = picture(tmp_path, samples=64)
    document, _, _ = exported(tmp_path)
    assert document["graph"]["material"] == "Default Volume"
    (closure,) = [node for node in document["graph"]["nodes"] if "Principled" in node["type"]]
    assert closure["inputs"]["Density"] == 1.0
    assert "Density Attribute" not in closure["inputs"]
    shutil.copy(path, tmp_path / "beside")
    # Made again from the scene file, Cycles shows the same picture to the bit.
    build(
        located(
            {"scene": document, "blend": str(tmp_path / "made.blend"), "folder": str(tmp_path / "beside")},
            "request",
        ),
        Recorder(),
    )
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "made.blend"))
    assert np.allclose(picture(tmp_path, samples=64), plain, atol=1e-6)
    assert plain.max() < 1.0


def test_a_link_that_blender_draws_in_red_carries_nothing(empty, tmp_path):
    material = fog("Fog", 0.25)
    tree = material.node_tree
    closure = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeVolumeAbsorption")
    tree.links.new(tree.nodes.new("ShaderNodeEmission").outputs[0], closure.inputs["Density"])
    cube("Cube", material)
    assert math.isclose(depth(tmp_path), 0.5, rel_tol=1e-5)
    document, _, _ = exported(tmp_path)
    (entry,) = [node for node in document["graph"]["nodes"] if node["type"] == "ShaderNodeVolumeAbsorption"]
    assert entry["inputs"]["Density"] == 0.25


def test_all_faults_of_a_file_are_reported_at_once(empty, tmp_path):
    for name in ("First", "Second"):
        cube(name, fog(f"{name} fog")).visible_shadow = False
    image = bpy.data.materials["First fog"].node_tree
    empty.world.cycles_visibility.camera = False
    lamp = _lamp("POINT")
    linking = bpy.data.collections.new("Linked")
    lamp.light_linking.receiver_collection = linking
    assert image is not None
    with pytest.raises(InputError) as caught:
        exported(tmp_path)
    faults = [caught.value, *caught.value.others]
    places = [fault.place for fault in faults]
    assert len(places) == 4, places
    for part in ('"First"', '"Second"', "light linking", "world"):
        assert any(part in place for place in places), places


def test_faces_that_coincide_are_reported(empty, tmp_path):
    cube("Cube", fog("Fog"))
    cube("Stacked", fog("Other"), location=(0, 0, 2))
    cube("Apart", fog("Third"), location=(0, 0, 4.001))
    _, warnings, _ = exported(tmp_path)
    (warning,) = [warning for warning in warnings if "coincide" in warning]
    assert warning.startswith('objects "Cube" and "Stacked":')


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_coinciding_faces_of_turned_meshes_are_found(empty, tmp_path, turned):
    items = [cube(name, fog(name)) for name in ("A", "B", "C")]
    for number, item in enumerate(items):
        item.rotation_euler = (turned, 0.3 * turned, 0.0)
        # B has A's place at half the size: no face of it is one of A's. C touches A along an edge alone.
        item.scale = ((1.0, 0.5, 1.0)[number],) * 3
        rotation = item.rotation_euler.to_matrix()
        item.location = rotation @ Vector(((0, 0, 0), (0, 0, 0), (2, 2, 0))[number])
    _, warnings, _ = exported(tmp_path)
    assert not [warning for warning in warnings if "coincide" in warning]
    items = [bpy.data.objects[name] for name in ("A", "B", "C")]
    items[1].location = items[1].rotation_euler.to_matrix() @ Vector((1.5, 0, 0.25))
    _, warnings, _ = exported(tmp_path)
    (warning,) = [warning for warning in warnings if "coincide" in warning]
    assert '"A" and "B"' in warning


@pytest.mark.parametrize(("count", "reported"), [(31, False), (32, True)])
def test_more_volumes_at_a_place_than_cycles_keeps_are_reported(empty, tmp_path, count, reported):
    material = fog("Fog", 0.01)
    for number in range(count):
        cube(f"Cube {number}", material).scale = (1 + 0.01 * number,) * 3
    # Beside them, not at their place.
    for number in range(3):
        cube(f"Aside {number}", material, location=(5 + 3 * number, 0, 0))
    _, warnings, _ = exported(tmp_path)
    assert any("Cycles keeps 31" in warning for warning in warnings) == reported


@pytest.mark.parametrize("light", ["surface", "world", "lamp", "volume"])
def test_a_picture_that_will_be_black_is_announced(empty, tmp_path, light):
    empty.world.node_tree.nodes["Background"].inputs["Strength"].default_value = float(light == "world")
    kind = "ShaderNodeEmission" if light == "volume" else "ShaderNodeVolumeAbsorption"
    material = fog("Fog") if light != "volume" else bpy.data.materials.new("Glow")
    if light == "volume":
        tree = material.node_tree
        tree.nodes.clear()
        tree.links.new(
            tree.nodes.new("ShaderNodeOutputMaterial").inputs["Volume"], tree.nodes.new(kind).outputs[0]
        )
    cube("Cube", material)
    if light == "surface":
        cube("Lamp", surface("Lamp", "ShaderNodeEmission"), location=(0, 5, 0))
    if light == "lamp":
        _lamp("SUN")
    _, warnings, _ = exported(tmp_path)
    assert any("the picture will be black" in warning for warning in warnings) == (light == "surface")


# Lights of nodes, and clamps


def _tree_of(lamp):
    data = lamp.data
    data.use_nodes = True
    return data.node_tree, data.node_tree.nodes["Emission"]


def _node(tree, kind, values=None, **properties):
    node = tree.nodes.new(kind)
    for name, value in properties.items():
        setattr(node, name, value)
    for name, value in (values or {}).items():
        node.inputs[name].default_value = value
    return node


def _computed_strength(tree, emission):
    value = _node(tree, "ShaderNodeValue")
    value.outputs[0].default_value = 0.7
    product = _node(tree, "ShaderNodeMath", {1: 1.5}, operation="MULTIPLY")
    tree.links.new(product.inputs[0], value.outputs[0])
    tree.links.new(emission.inputs["Strength"], product.outputs[0])
    gamma = _node(tree, "ShaderNodeGamma", {"Color": (0.4, 0.6, 0.9, 1.0), "Gamma": 1.8})
    tree.links.new(emission.inputs["Color"], gamma.outputs[0])
    return np.array([0.4, 0.6, 0.9]) ** 1.8 * 0.7 * 1.5


def _sum_of_emissions(tree, emission):
    other = _node(tree, "ShaderNodeEmission", {"Color": (0.0, 0.5, 1.0, 1.0), "Strength": 2.0})
    emission.inputs["Color"].default_value, emission.inputs["Strength"].default_value = (1, 0, 0, 1), 0.5
    both = _node(tree, "ShaderNodeAddShader")
    tree.links.new(both.inputs[0], emission.outputs[0])
    tree.links.new(both.inputs[1], other.outputs[0])
    output = next(node for node in tree.nodes if node.bl_idname == "ShaderNodeOutputLight")
    tree.links.new(output.inputs["Surface"], both.outputs[0])
    return np.array([0.5, 1.0, 2.0])


def _quadratic_falloff(tree, emission):
    falloff = _node(tree, "ShaderNodeLightFalloff", {"Strength": 3.0})
    tree.links.new(emission.inputs["Strength"], falloff.outputs["Quadratic"])
    return np.array([3.0, 3.0, 3.0])


@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT", "AREA"])
@pytest.mark.parametrize("make", [_computed_strength, _sum_of_emissions, _quadratic_falloff])
def test_a_light_whose_nodes_give_one_colour_has_it(empty, tmp_path, kind, make):
    cube("Cube", fog("Fog"))
    lamp = _lamp(kind)
    lamp.data.color = (0.5, 1.0, 0.25)
    wanted = make(*_tree_of(lamp)) * (0.5, 1.0, 0.25)
    document, _, _ = exported(tmp_path)
    # Cycles' own rounding: a few operations in f32.
    assert np.allclose(document["lights"][0]["color"], wanted, rtol=2e-6)
    assert document["lights"][0]["strength"] == 3.0


def test_the_light_of_nodes_is_that_of_the_colour(empty, tmp_path):
    _white_wall()
    empty.world = None
    lamp = _lamp("POINT", shadow_soft_size=0.0)
    tree, emission = _tree_of(lamp)
    body = _node(tree, "ShaderNodeBlackbody", {"Temperature": 3200.0})
    tree.links.new(emission.inputs["Color"], body.outputs[0])
    of_nodes = picture(tmp_path)
    cube("Cube", fog("Fog"), location=(50, 50, 50))
    document, _, _ = exported(tmp_path)
    lamp = bpy.data.objects["Lamp"]
    lamp.data.use_nodes = False
    lamp.data.color = document["lights"][0]["color"]
    assert of_nodes.max() > 0 and np.allclose(picture(tmp_path), of_nodes, rtol=1e-5)


@pytest.mark.parametrize(
    ("kind", "output", "target"),
    [
        ("ShaderNodeTexCoord", "Normal", "Color"),
        ("ShaderNodeTexNoise", "Color", "Color"),
        ("ShaderNodeLightPath", "Ray Length", "Strength"),
        ("ShaderNodeLightFalloff", "Linear", "Strength"),
        ("ShaderNodeTexIES", "Fac", "Strength"),
    ],
)
def test_a_light_whose_nodes_give_more_than_a_colour_is_rejected(empty, tmp_path, kind, output, target):
    cube("Cube", fog("Fog"))
    tree, emission = _tree_of(_lamp("POINT"))
    tree.links.new(emission.inputs[target], _node(tree, kind).outputs[output])
    text = refusal(tmp_path)
    assert kind in text and '"Lamp"' in text


@pytest.mark.parametrize(
    ("power", "distance", "clamp", "reported"),
    [
        (1000, 0.5, 10, True),
        (1000, 1.0, 10, False),
        (1000, 0.5, 0, False),
        (10, 0.5, 10, False),
        (10, 0, 10, True),
    ],
)
def test_a_clamp_that_the_light_reaches_is_reported(empty, tmp_path, power, distance, clamp, reported):
    # 1000 W reach a radiance of 10 within sqrt(1000 / 10) / (4 pi) = 0.80 m.
    cube("Cube", fog("Fog"))
    lamp = _lamp("POINT")
    lamp.data.energy = power
    lamp.location = (0, 0, 1 + distance)
    empty.cycles.sample_clamp_indirect = clamp
    _, warnings, _ = exported(tmp_path)
    assert any("Clamp Indirect 10" in warning for warning in warnings) == reported
