"""Builds a scene in an empty Blender file: the inverse of scene_reader."""

import hashlib
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from graph_builder import SharedGroups, build_material, build_world
from protocol import InputError
from rna import set_fields, set_value
from scene_reader import (
    CAMERA_FIELDS,
    CLIP_FIELDS,
    DISPLAY_FIELDS,
    FILM_FIELDS,
    FIXED_LIGHT_SETTINGS,
    INTEGRATOR_FIELDS,
    LIGHT_FIELDS,
    LIGHT_TYPE_FIELDS,
    LIGHT_TYPES,
    NAME_PROPERTY,
    OBJECT_INFO_DEFAULTS,
    PANORAMA_FIELDS,
    PROJECTIONS,
)

ANCHOR_NAME = "World Origin"
BOX_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


def build_scene(scene, warn, folder=None):
    """Fill the open, empty file with `scene`; return the bpy objects of the volumes.

    File names in the scene are relative to `folder`.
    `warn(place, message)` is told of whatever Blender cannot reproduce exactly.
    """
    target = bpy.context.scene
    target.render.engine = "CYCLES"
    target[NAME_PROPERTY] = scene["name"]
    objects = _Objects(target)
    _build_camera(target, objects, scene["camera"])
    _apply_film(target, scene["film"])
    set_fields(target.cycles, INTEGRATOR_FIELDS, scene["integrator"])
    set_fields(target.view_settings, DISPLAY_FIELDS, scene["display"])
    for light in scene["lights"]:
        _build_light(objects, light)
    # Blender knows groups by name: those of the world and of the materials are the same.
    graphs = [scene["graph"], *scene.get("other_graphs", [])]
    around = scene["world"].get("graph")
    groups = SharedGroups(graphs if around is None else [*graphs, around])
    if around is None:
        target.world = _build_world(scene["world"], folder)
    else:
        target.world = build_world(around, objects.for_pointer, warn, groups)
    materials = {
        graph["material"]: build_material(graph, objects.for_pointer, warn, groups) for graph in graphs
    }
    volumes = [scene["volume"], *scene.get("other_volumes", [])]
    return [_build_volume(objects, entry, materials, folder) for entry in volumes]


class _Objects:
    """Creates objects at exact world matrices."""

    def __init__(self, scene):
        self._scene = scene
        self._anchor = bpy.data.objects.new(ANCHOR_NAME, None)
        scene.collection.objects.link(self._anchor)
        self._matrices = {}

    def new(self, name, data, rows):
        """Link a new object called `name` with the world matrix `rows`.

        Blender splits an object's own matrix into location, rotation and scale, which rounds it and loses
        shear. The inverse matrix towards a parent is kept as it is, so the object hangs on an anchor at the
        origin.
        """
        item = bpy.data.objects.new(name, data)
        if item.name != name:
            raise InputError(
                f'object "{name}"', "this name twice", "one object of each name", "rename one of them"
            )
        self._scene.collection.objects.link(item)
        item.parent = self._anchor
        item.matrix_parent_inverse = Matrix(rows)
        self._matrices[name] = rows
        return item

    def for_pointer(self, pointer):
        """The object that a Texture Coordinate node refers to: one of the scene's, or a new empty."""
        name, rows = pointer["name"], pointer["matrix_world"]
        if name not in self._matrices:
            return self.new(name, None, rows)
        if self._matrices[name] != rows:
            raise InputError(
                f'object "{name}"',
                "two different matrix_world",
                "one object of each name",
                "rename one of them",
            )
        return bpy.data.objects[name]


def _build_camera(target, objects, entry):
    camera = bpy.data.cameras.new(entry["name"])
    camera.type = _blender_name(PROJECTIONS, entry, "projection")
    if camera.type == "PANO":
        camera.panorama_type = "EQUIRECTANGULAR"
        set_fields(camera, PANORAMA_FIELDS, entry["panorama"])
    set_fields(camera, CAMERA_FIELDS | CLIP_FIELDS, entry)
    camera.shift_x, camera.shift_y = entry["shift"]
    target.camera = objects.new(entry["name"], camera, entry["matrix_world"])


def _blender_name(table, entry, key):
    for blender_name, name in table.items():
        if name == entry[key]:
            return blender_name
    raise InputError(
        f"{entry.place}.{key}", repr(entry[key]), f"one of {list(table.values())}", "mend the value"
    )


def _apply_film(target, film):
    render = target.render
    for axis, size, aspect in zip("xy", film["resolution"], film["pixel_aspect"], strict=True):
        set_value(render, f"resolution_{axis}", size, f"{film.place}.resolution")
        set_value(render, f"pixel_aspect_{axis}", aspect, f"{film.place}.pixel_aspect")
    set_value(
        render, "resolution_percentage", film["resolution_percentage"], f"{film.place}.resolution_percentage"
    )
    set_fields(target.cycles, FILM_FIELDS, film)
    render.film_transparent = film["transparent"]


def _build_light(objects, entry):
    light = bpy.data.lights.new(entry["name"], _blender_name(LIGHT_TYPES, entry, "type"))
    set_fields(light, LIGHT_FIELDS | LIGHT_TYPE_FIELDS[light.type], entry)
    if light.type == "AREA":
        light.size, light.size_y = entry["size"]
    for setting, value in FIXED_LIGHT_SETTINGS.items():
        if hasattr(light, setting):
            setattr(light, setting, value)
    objects.new(entry["name"], light, entry["matrix_world"])


def _build_world(entry, folder):
    world = bpy.data.worlds.new("World")
    nodes = world.node_tree.nodes
    nodes.clear()
    background = nodes.new("ShaderNodeBackground")
    background.inputs["Color"].default_value = [*entry["color"], 1.0]
    background.inputs["Strength"].default_value = entry["strength"]
    world.node_tree.links.new(
        nodes.new("ShaderNodeOutputWorld").inputs["Surface"], background.outputs["Background"]
    )
    if "image" in entry:
        texture = nodes.new("ShaderNodeTexEnvironment")
        texture.image = _load_world_image(entry["image"], folder)
        world.node_tree.links.new(background.inputs["Color"], texture.outputs["Color"])
    return world


def _load_world_image(entry, folder):
    """The picture around the scene, as linear Rec. 709."""
    path = _checked_file(entry, folder, "an EXR file")
    try:
        image = bpy.data.images.load(str(path))
    except RuntimeError as error:
        raise InputError(
            str(path), str(error), "an EXR file", "put the picture beside the scene file"
        ) from None
    image.colorspace_settings.name = "Linear Rec.709"
    return image


def _checked_file(entry, folder, expected):
    """The path of the file that `entry` names with its SHA-256."""
    if folder is None:
        raise InputError(
            f"{entry.place}.file", "no folder that it is relative to", "a request with `folder`", "add it"
        )
    path = Path(folder) / entry["file"]
    try:
        content = path.read_bytes()
    except OSError as error:
        raise InputError(str(path), str(error), expected, "put the file beside the scene file") from None
    if hashlib.sha256(content).hexdigest() != entry["sha256"]:
        raise InputError(str(path), "another file", f"SHA-256 {entry['sha256']}", "restore the file")
    return path


def _build_volume(objects, entry, materials, folder):
    data = _grid(entry, folder) if entry["shape"]["type"] == "grid" else _mesh(entry)
    item = objects.new(entry["object"], data, entry["matrix_world"])
    if entry["material"] not in materials:
        raise InputError(
            f"{entry.place}.material", repr(entry["material"]), f"one of {list(materials)}", "mend the name"
        )
    material = materials[entry["material"]]
    if material.users and material.cycles.volume_step_rate != np.float32(entry["volume_step_rate"]):
        raise InputError(
            f"{entry.place}.volume_step_rate",
            f"{entry['volume_step_rate']} beside {material.cycles.volume_step_rate}",
            "one number for each material",
            "mend the value: it belongs to the material",
        )
    material.cycles.volume_step_rate = entry["volume_step_rate"]
    data.materials.append(material)
    set_object_info(item, material, entry)
    return item


def set_object_info(item, material, entry):
    """Give an object and its material what the Object Info node shows of them, as `entry` (a volume) says."""
    values = OBJECT_INFO_DEFAULTS | {key: entry[key] for key in OBJECT_INFO_DEFAULTS if key in entry}
    set_value(item, "color", values["color"], f"{entry.place}.color")
    set_value(item, "pass_index", values["pass_index"], f"{entry.place}.pass_index")
    where = f"{entry.place}.material_pass_index"
    if material.users > 1 and material.pass_index != values["material_pass_index"]:
        raise InputError(
            where,
            f"{values['material_pass_index']} beside {material.pass_index}",
            "one number for each material",
            "mend the value: it belongs to the material",
        )
    set_value(material, "pass_index", values["material_pass_index"], where)


def _mesh(entry):
    mesh = bpy.data.meshes.new(entry["object"])
    mesh.from_pydata(*_mesh_data(entry))
    mesh.use_auto_texspace = False
    mesh.texspace_location = entry["texture_space"]["location"]
    mesh.texspace_size = entry["texture_space"]["size"]
    return mesh


def _grid(entry, folder):
    """A Volume object's data. Its outline encloses the voxels above `clipping`: all that are not 0, here."""
    volume = bpy.data.volumes.new(entry["object"])
    volume.filepath = str(_checked_file(entry["shape"], folder, "an OpenVDB file"))
    volume.render.clipping = 0.0
    return volume


def _mesh_data(entry):
    """Vertices, edges and faces of the volume's mesh. Blender would crash on faces without vertices."""
    shape = entry["shape"]
    if shape["type"] == "box":
        return _box_corners(entry["bounds"]), [], BOX_FACES
    vertices, triangles = shape["vertices"], shape["triangles"]
    indices = np.asarray(triangles)
    if indices.ndim != 2 or indices.shape[1] != 3 or indices.min() < 0 or indices.max() >= len(vertices):
        raise InputError(
            f"{shape.place}.triangles",
            f"an array of shape {list(indices.shape)}",
            f"triples of indices below {len(vertices)}",
            "mend the mesh",
        )
    return vertices, [], triangles


def _box_corners(bounds):
    """The corners of a box [8][3]; bit k of a corner's index chooses min (0) or max (1) of axis k."""
    limits = np.array([bounds["min"], bounds["max"]], np.float32)
    return [[float(limits[index >> axis & 1, axis]) for axis in range(3)] for index in range(8)]
