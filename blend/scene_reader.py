"""Reads the open .blend file into a scene: camera, film, lights, world, volumes and graphs."""

import hashlib
import math
from pathlib import Path

import bpy
import numpy as np

from graph_reader import Inexpressible, live_links, read_graph, require_identity, volume_output
from protocol import InputError
from scene_io import FORMAT, matrix_rows, shortest, shortest_list

NAME_PROPERTY = "cloudparity_name"
PROJECTIONS = {"PERSP": "perspective", "ORTHO": "orthographic", "PANO": "equirectangular"}
LIGHT_TYPES = {"SUN": "sun", "POINT": "point", "SPOT": "spot", "AREA": "area"}
# Scene key to Blender attribute, in the order of the file.
CAMERA_FIELDS = {
    "focal_length": "lens",
    "sensor_fit": "sensor_fit",
    "sensor_width": "sensor_width",
    "sensor_height": "sensor_height",
    "ortho_scale": "ortho_scale",
}
CLIP_FIELDS = {"clip_start": "clip_start", "clip_end": "clip_end"}
PANORAMA_FIELDS = {name: name for name in ("longitude_min", "longitude_max", "latitude_min", "latitude_max")}
FILM_FIELDS = {
    "pixel_filter": "pixel_filter_type",
    "filter_width": "filter_width",
    "exposure": "film_exposure",
}
INTEGRATOR_FIELDS = {"volume_bounces": "volume_bounces", "max_bounces": "max_bounces"}
DISPLAY_FIELDS = {name: name for name in ("view_transform", "look", "exposure", "gamma")}
LIGHT_FIELDS = {"color": "color", "strength": "energy", "exposure": "exposure"}
LIGHT_TYPE_FIELDS = {
    "SUN": {"angle": "angle"},
    "POINT": {"radius": "shadow_soft_size", "soft_falloff": "use_soft_falloff"},
    "SPOT": {"radius": "shadow_soft_size", "spot_size": "spot_size", "blend": "spot_blend"},
    "AREA": {"shape": "shape"},
}
# Of volumes. Left out of the file where they are just that.
OBJECT_INFO_DEFAULTS = {"color": [1.0, 1.0, 1.0, 1.0], "pass_index": 0, "material_pass_index": 0}
# Settings of a light that the scene format has no words for, with the only value that can be exported.
FIXED_LIGHT_SETTINGS = {
    "use_temperature": False,
    "normalize": True,
    "use_shadow": True,
    "spread": float(np.float32(math.pi)),
    "use_square": False,
}


def read_scene(path, object_names, messages):
    """Return the open file, loaded from `path`, as a scene (a JSON object).

    `object_names` names the volume objects; None takes every mesh object with a volume material.
    """
    scene = bpy.context.scene
    visible = _objects_visible_in_render(bpy.context.view_layer.layer_collection)
    volume_objects = _choose_volumes(visible, object_names)
    materials = {item.name: _volume_materials(item)[0] for item in volume_objects}
    _warn_of_losses(scene, visible, volume_objects, list(dict.fromkeys(materials.values())), messages)
    first, *others = [_read_volume(item, materials[item.name]) for item in volume_objects]
    graphs = {
        material.name: read_graph(material, messages.warning)
        for material in dict.fromkeys(materials.values())
    }
    entry = {
        "format": FORMAT,
        "name": scene.get(NAME_PROPERTY, Path(path).stem),
        "camera": _read_camera(scene),
        "film": _read_film(scene),
        "integrator": _read_fields(scene.cycles, INTEGRATOR_FIELDS, "Cycles settings"),
        "display": _read_fields(scene.view_settings, DISPLAY_FIELDS, "color management"),
        "lights": [
            _read_light(item) for item in sorted(visible, key=lambda item: item.name) if item.type == "LIGHT"
        ],
        "world": _read_world(scene.world),
        "volume": first,
        "graph": graphs.pop(first["material"]),
    }
    if others:
        entry["other_volumes"] = others
    if graphs:
        entry["other_graphs"] = list(graphs.values())
    return entry


def _objects_visible_in_render(layer_collection):
    """The objects of a layer collection and those below it that a render shows, without duplicates."""
    if layer_collection.exclude or layer_collection.collection.hide_render:
        return []
    found = [item for item in layer_collection.collection.objects if not item.hide_render]
    for child in layer_collection.children:
        found += [item for item in _objects_visible_in_render(child) if item not in found]
    return found


def _volume_materials(item):
    """The different materials of an object whose active output has a volume."""
    if item.type != "MESH":
        return []
    materials = []
    for slot in item.material_slots:
        if slot.material not in materials and volume_output(slot.material) is not None:
            materials.append(slot.material)
    return materials


def _choose_volumes(visible, object_names):
    """The objects of these names, or all that hold a volume, sorted by name."""
    if object_names is not None:
        for name in object_names:
            if not any(item.name == name for item in visible):
                names = ", ".join(f'"{item.name}"' for item in visible) or "no object at all"
                raise InputError(
                    f'object "{name}"', "no such object visible in render", names, "name one of these objects"
                )
        candidates = [item for item in visible if item.name in object_names]
    else:
        candidates = [item for item in visible if _volume_materials(item)]
    if not candidates:
        raise InputError(
            f'scene "{bpy.context.scene.name}"',
            "0 mesh objects with a volume material",
            "at least one that is visible in render and whose active material output has a linked Volume",
            "link a volume shader to the Volume of the Material Output",
        )
    for item in candidates:
        count = len(_volume_materials(item))
        if count != 1:
            raise InputError(
                f'object "{item.name}" ({item.type})',
                f"{count} materials with a linked Volume",
                "a mesh with exactly one",
                "give the object one material with a volume shader",
            )
    return sorted(candidates, key=lambda item: item.name)


def _warn_of_losses(scene, visible, volume_objects, materials, messages):
    for item in visible:
        if item not in volume_objects and item.type not in ("CAMERA", "LIGHT", "EMPTY"):
            messages.warning(
                f'object "{item.name}" ({item.type})', "left out: a scene has volumes and nothing else"
            )
    for material in materials:
        _warn_of_other_outputs(material, messages)
    if scene.camera is not None and scene.camera.data.dof.use_dof:
        messages.warning(f'camera "{scene.camera.name}"', "depth of field is left out")
    for setting in ("use_motion_blur", "use_border"):
        if getattr(scene.render, setting):
            messages.warning(
                f"render settings, {setting}", "left out: the whole frame is rendered at one instant"
            )
    if scene.view_settings.use_curve_mapping:
        messages.warning("color management", "the display curves are left out")


def _warn_of_other_outputs(material, messages):
    output = volume_output(material)
    for name in ("Surface", "Displacement"):
        if (output.name, name) in live_links(material.node_tree):
            messages.warning(f'material "{material.name}", {name}', "left out: only the volume is exported")


def _world_matrix(item):
    evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return matrix_rows(evaluated.matrix_world, f'object "{item.name}", matrix_world')


def _read_camera(scene):
    item = scene.camera
    if item is None or item.type != "CAMERA":
        raise InputError(
            f'scene "{scene.name}"',
            "no camera",
            "an active camera object",
            "add a camera and make it the active one",
        )
    camera = item.data
    place = f'camera "{item.name}"'
    if camera.type not in PROJECTIONS or (
        camera.type == "PANO" and camera.panorama_type != "EQUIRECTANGULAR"
    ):
        raise InputError(
            place,
            f"projection {camera.type}, panorama {camera.panorama_type}",
            "perspective, orthographic or equirectangular",
            "change the lens type",
        )
    entry = {
        "name": item.name,
        "projection": PROJECTIONS[camera.type],
        "matrix_world": _world_matrix(item),
        **_read_fields(camera, CAMERA_FIELDS, place),
        "shift": shortest_list((camera.shift_x, camera.shift_y), place),
        **_read_fields(camera, CLIP_FIELDS, place),
    }
    if camera.type == "PANO":
        entry["panorama"] = _read_fields(camera, PANORAMA_FIELDS, place)
    return entry


def _read_fields(owner, fields, place):
    """The attributes of `fields` {key: attribute} under their keys, numbers as shortest decimals."""
    values = {}
    for key, attribute in fields.items():
        value = getattr(owner, attribute)
        if isinstance(value, float):
            value = shortest(value, f"{place}, {attribute}")
        elif not isinstance(value, (str, int)):
            value = shortest_list(value, f"{place}, {attribute}")
        values[key] = value
    return values


def _read_film(scene):
    render = scene.render
    return {
        "resolution": [render.resolution_x, render.resolution_y],
        "resolution_percentage": render.resolution_percentage,
        "pixel_aspect": shortest_list((render.pixel_aspect_x, render.pixel_aspect_y), "pixel aspect"),
        **_read_fields(scene.cycles, FILM_FIELDS, "Cycles film settings"),
        "transparent": render.film_transparent,
    }


def _read_light(item):
    light = item.data
    place = f'light "{item.name}"'
    _require_plain_light(item, place)
    entry = {
        "name": item.name,
        "type": LIGHT_TYPES[light.type],
        "matrix_world": _world_matrix(item),
        **_read_fields(light, LIGHT_FIELDS, place),
        **_read_fields(light, LIGHT_TYPE_FIELDS[light.type], place),
    }
    if light.type == "AREA":
        # Blender keeps a second size that a square or a disk does not use.
        height = light.size if light.shape in ("SQUARE", "DISK") else light.size_y
        entry["size"] = shortest_list((light.size, height), place)
    return entry


def _require_plain_light(item, place):
    light = item.data
    fixed = dict(FIXED_LIGHT_SETTINGS)
    if light.type == "SPOT":
        fixed["use_soft_falloff"] = True
    for setting, expected in fixed.items():
        found = getattr(light, setting, expected)
        if found != expected:
            raise InputError(
                f"{place}, {setting}", str(found), str(expected), "reset this setting of the light"
            )
    if not item.visible_volume_scatter:
        raise InputError(place, "not visible to volume scatter", "visible", "enable the ray visibility")
    if light.use_nodes and light.node_tree is not None and not _is_plain_emission(light.node_tree):
        raise InputError(
            f"{place}, node tree",
            "nodes that change the light",
            "no nodes, or one Emission with white colour and strength 1",
            "turn the nodes of the light off",
        )


def _is_plain_emission(tree):
    links = live_links(tree)
    sources = [link.from_node for link in links.values()]
    if len(sources) != 1 or sources[0].bl_idname != "ShaderNodeEmission":
        return False
    emission = sources[0]
    return (
        tuple(emission.inputs["Color"].default_value)[:3] == (1.0, 1.0, 1.0)
        and emission.inputs["Strength"].default_value == 1.0
    )


def _read_world(world):
    if world is None:
        return {"color": [0.0, 0.0, 0.0], "strength": 1.0}
    place = f'world "{world.name}"'
    if world.node_tree is None:
        return {"color": shortest_list(world.color, place), "strength": 1.0}
    output = world.node_tree.get_output_node("CYCLES")
    links = live_links(world.node_tree)
    if output is not None and (output.name, "Volume") in links:
        raise InputError(
            f"{place}, Volume",
            f'node "{links[output.name, "Volume"].from_node.name}"',
            "no link",
            "remove the link",
        )
    surface = links.get((output.name, "Surface")) if output is not None else None
    if surface is None:
        return {"color": [0.0, 0.0, 0.0], "strength": 1.0}
    background = surface.from_node
    if background.bl_idname != "ShaderNodeBackground":
        raise _world_refusal(place, background)
    if (background.name, "Strength") in links:
        raise _world_refusal(place, links[background.name, "Strength"].from_node)
    entry = {
        "color": shortest_list(background.inputs["Color"].default_value[:3], place),
        "strength": shortest(background.inputs["Strength"].default_value, place),
    }
    link = links.get((background.name, "Color"))
    if link is not None:
        if link.from_node.bl_idname != "ShaderNodeTexEnvironment":
            raise _world_refusal(place, link.from_node)
        entry["color"] = [1.0, 1.0, 1.0]
        entry["image"] = _read_environment(link.from_node, links, place)
    return entry


def environment_path(world):
    """The file of the picture around the scene, or None; for scenes that read_scene accepted."""
    nodes = world.node_tree.nodes if world is not None and world.node_tree is not None else []
    used = [
        link.from_node
        for link in (live_links(world.node_tree).values() if nodes else [])
        if link.from_node.bl_idname == "ShaderNodeTexEnvironment"
    ]
    return bpy.path.abspath(used[0].image.filepath) if used else None


def _read_environment(node, links, place):
    """The entry of an Environment Texture: a linear float EXR with the default mapping, nothing else."""
    place = f'{place}, node "{node.name}"'
    if (node.name, "Vector") in links:
        raise InputError(
            f"{place}, Vector", "a link", "no link", "remove the link: other mappings are unknown"
        )
    try:
        require_identity(node.texture_mapping)
    except Inexpressible as problem:
        raise InputError(f"{place}, texture_mapping", *problem.reason) from None
    image = node.image
    fixed = [
        ("projection", node.projection, ("EQUIRECTANGULAR",)),
        ("interpolation", node.interpolation, ("Linear",)),
    ]
    if image is not None:
        fixed += [
            ("image source", image.source, ("FILE",)),
            ("image is float", image.is_float, (True,)),
            ("color space", image.colorspace_settings.name, ("Linear Rec.709", "Non-Color")),
            ("packed", image.packed_file is not None, (False,)),
            ("file format", image.file_format, ("OPEN_EXR",)),
        ]
    for setting, found, expected in fixed:
        if found not in expected:
            raise InputError(
                f"{place}, {setting}", repr(found), " or ".join(map(repr, expected)), "change this setting"
            )
    path = Path(bpy.path.abspath(image.filepath)) if image is not None else None
    if path is None or not path.is_file():
        raise InputError(place, f"the file {path}", "an EXR file that exists", "choose the picture again")
    return {"file": path.name, "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}


def _world_refusal(place, node):
    return InputError(
        place,
        f'node "{node.name}" ({node.bl_idname})',
        "one Background node, its Color unlinked or from an Environment Texture",
        "replace the sky by a constant colour, or bake it in another tool",
    )


def _read_volume(item, material):
    place = f'object "{item.name}"'
    evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    mesh.calc_loop_triangles()
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    triangles = np.empty((len(mesh.loop_triangles), 3), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    evaluated.to_mesh_clear()
    if len(triangles) == 0:
        raise InputError(place, "a mesh without faces", "a closed mesh", "give the object a closed mesh")
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if is_box(vertices, triangles):
        shape = {"type": "box"}
    else:
        shape = {
            "type": "mesh",
            "vertices": [shortest_list(vertex, f"{place}, vertex") for vertex in vertices],
            "triangles": triangles.tolist(),
        }
    return {
        "object": item.name,
        "matrix_world": _world_matrix(item),
        "shape": shape,
        "bounds": {"min": shortest_list(low, place), "max": shortest_list(high, place)},
        # Of the mesh before modifiers: Generated does not follow them.
        "texture_space": {
            "location": shortest_list(item.data.texspace_location, place),
            "size": shortest_list(item.data.texspace_size, place),
        },
        "material": material.name,
        "volume_step_rate": shortest(material.cycles.volume_step_rate, place),
        **_read_object_info(evaluated, material, place),
    }


def _read_object_info(item, material, place):
    """What the Object Info node shows of the object and its material, where it is not Blender's default."""
    found = {
        "color": shortest_list(item.color, f"{place}, color"),
        "pass_index": item.pass_index,
        "material_pass_index": material.pass_index,
    }
    return {key: value for key, value in found.items() if value != OBJECT_INFO_DEFAULTS[key]}


def is_box(vertices, triangles):
    """Whether a mesh is exactly its bounding box: 8 corners, 12 triangles, closed, facing outward.

    `vertices` f32 [n, 3] in object space, `triangles` int [m, 3].
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    at_low, at_high = vertices == low, vertices == high
    if len(vertices) != 8 or len(triangles) != 12 or np.any(low == high) or not np.all(at_low | at_high):
        return False
    if len({tuple(corner) for corner in at_high.tolist()}) != 8:
        return False
    edges = {
        (a, b)
        for corners in triangles.tolist()
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    }
    if len(edges) != 36 or any((b, a) not in edges for a, b in edges):
        return False
    corners = vertices[triangles].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    center = (low.astype(np.float64) + high) / 2
    outward = np.einsum("ij,ij->i", normals, corners.mean(axis=1) - center) > 0
    on_one_side = at_low[triangles].all(axis=1) | at_high[triangles].all(axis=1)
    return bool(np.all(outward) and np.all(on_one_side.any(axis=1)))
