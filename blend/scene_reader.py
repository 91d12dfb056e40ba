"""Reads the open .blend file into a scene: camera, film, lights, world, volumes and graphs."""

from pathlib import Path

import bpy
import numpy as np

from animation_reader import moving_modifiers, warn_of_animation
from graph_reader import live_links, read_graph, unique_name, volume_output
from light_nodes import colors_of_trees
from light_reader import (
    FIXED_LIGHT_SETTINGS,
    LIGHT_FIELDS,
    LIGHT_TYPE_FIELDS,
    LIGHT_TYPES,
    read_lights,
)
from overlaps import warn_of_overlaps
from preparation import (
    StandIns,
    add_material_cube,
    choose_camera,
    framing,
    listed,
    show_hidden,
)
from protocol import Faults, InputError
from scene_io import FORMAT, matrix_array, matrix_rows, read_fields, shortest, shortest_list
from volume_reader import OBJECT_INFO_DEFAULTS, VolumeReader, warn_of_outline
from world_reader import read_world

# What scene_builder uses of this module and of those behind it.
__all__ = [
    "CAMERA_FIELDS",
    "CLIP_FIELDS",
    "DISPLAY_FIELDS",
    "FILM_FIELDS",
    "FIXED_LIGHT_SETTINGS",
    "INTEGRATOR_FIELDS",
    "LIGHT_FIELDS",
    "LIGHT_TYPES",
    "LIGHT_TYPE_FIELDS",
    "NAME_PROPERTY",
    "OBJECT_INFO_DEFAULTS",
    "PANORAMA_FIELDS",
    "PROJECTIONS",
    "Wish",
    "read_scene",
]

NAME_PROPERTY = "cloudparity_name"
PROJECTIONS = {"PERSP": "perspective", "ORTHO": "orthographic", "PANO": "equirectangular"}
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
# Render settings that a scene file does not have, with what that does to the picture.
LEFT_OUT_SETTINGS = {
    "use_motion_blur": "motion blur is left out: the picture is of one instant",
    "use_multiview": "stereoscopy is left out: the picture is that of one camera",
}


class ReadScene:
    """A scene (a JSON object) and the files that belong beside it: {name: path}."""

    def __init__(self, scene, files):
        self.scene = scene
        self.files = files


class Wish:
    """What of a file its user wants to see.

    `objects` are names of volume objects, None for all that render; `frame` the frame to read it at, None for
    the file's current one; `camera` the name of a camera, None for the active one; `material` the name of a
    material to show on a cube, in place of all objects; `include_hidden` shows volumes that are hidden.
    """

    def __init__(self, objects=None, frame=None, camera=None, material=None, include_hidden=False):
        self.objects = objects
        self.frame = frame
        self.camera = camera
        self.material = material
        self.include_hidden = include_hidden


def read_scene(path, wish, messages, taken_out, folder=None, refused=None, world_nodes=None):
    """Return the open file, loaded from `path`, as a ReadScene of what the Wish asks for.

    `taken_out` is what opening it has left out (blender_file.open_blend).
    What has to be made beside the scene file is written to `folder`; without one what needs it is rejected.
    `refused` is as in `read_graph`, and `world_nodes` is `nodes` of `read_world`. Raises one InputError with
    all faults of the file.
    """
    scene = bpy.context.scene
    faults = Faults()
    for name in taken_out.freestyle:
        messages.warning(f'scene "{name}", Freestyle', "left out: no lines are drawn")
    messages.activity(
        f"evaluating the scene at frame {scene.frame_current if wish.frame is None else wish.frame}"
    )
    _go_to_frame(scene, wish.frame)
    if wish.include_hidden:
        show_hidden(scene, messages)
    objects = wish.objects
    if wish.material is not None:
        objects = [unique_name(add_material_cube(scene, wish.material))]
    stand_ins = StandIns(taken_out.domains)
    camera, is_ours = choose_camera(scene, wish.camera, wish.material is not None, messages)
    # Blender renders with one alone, and a marker may have bound another.
    scene.camera = camera
    _warn_of_settings(scene, camera, messages)
    tree_colors = colors_of_trees(scene, folder)
    messages.activity(f"evaluating {len(scene.objects)} objects for a render")
    entry, files = _while_rendering(
        scene,
        lambda depsgraph: _read_parts(
            depsgraph,
            path,
            VolumeReader(depsgraph, objects, messages, faults, folder, stand_ins),
            (camera, is_ours),
            messages,
            refused,
            faults,
            tree_colors,
        ),
    )
    messages.activity("reading the world")
    world = None
    with faults.noted():
        own = bpy.context.view_layer.world_override or scene.world
        world = read_world(own, messages, folder, world_nodes, only_check=bool(faults.found))
    faults.require_none()
    taken = {light["name"] for light in entry["lights"]}
    for light in world.lights:
        own, number = light["name"], 2
        while light["name"] in taken:
            light["name"], number = f"{own} {number}", number + 1
        taken.add(light["name"])
        entry["lights"].append(light)
    entry["world"] = world.entry
    _warn_of_darkness(entry, messages)
    _warn_of_clamps(scene, entry, messages)
    return ReadScene(entry, files | world.files)


def _read_parts(depsgraph, path, reader, camera, messages, refused, faults, tree_colors):
    """All of a scene but its world, and the files of its volumes; (None, {}) where it has faults."""
    scene = depsgraph.scene
    volumes = reader.read()
    materials = {volume.material.original: volume.material for volume in volumes}
    for material in materials.values():
        _warn_of_other_outputs(material, messages)
    graphs = {}
    for original, material in materials.items():
        messages.activity(f'reading the nodes of material "{material.name}"')
        with faults.noted():
            graphs[unique_name(original)] = read_graph(material, messages.warning, depsgraph, refused)
    outlined = set()
    for volume in volumes:
        # Instances have the mesh of the first one.
        if volume.object not in outlined:
            warn_of_outline(volume, messages)
        outlined.add(volume.object)
        with faults.noted():
            _require_known_number(volume, graphs.get(volume.entry["material"]))
    warn_of_overlaps([volume.entry for volume in volumes], messages)
    camera, is_ours = camera
    camera_entry, film = None, _read_film(scene)
    with faults.noted():
        camera_entry = _read_camera(scene, camera.evaluated_get(depsgraph))
        if is_ours and volumes:
            _frame(camera_entry, camera.data, film, [volume.entry for volume in volumes])
        _crop(scene, camera_entry, film, messages)
    lights = read_lights(depsgraph, scene, messages, faults, tree_colors)
    if faults.found:
        return None, {}
    first, *others = [volume.entry for volume in volumes]
    entry = {
        "format": FORMAT,
        "name": scene.get(NAME_PROPERTY, Path(path).stem),
        "camera": camera_entry,
        "film": film,
        "integrator": read_fields(scene.cycles, INTEGRATOR_FIELDS, "Cycles settings"),
        "display": read_fields(scene.view_settings, DISPLAY_FIELDS, "color management"),
        "lights": lights,
        "world": None,
        "volume": first,
        "graph": graphs.pop(first["material"]),
    }
    if others:
        entry["other_volumes"] = others
    if graphs:
        entry["other_graphs"] = list(graphs.values())
    warn_of_animation(
        _animated_parts(depsgraph, camera, volumes, materials, messages), scene.frame_current, messages
    )
    return entry, reader.files


def _frame(entry, camera, film, volumes):
    """Put a camera of ours where it sees the outlines of all volumes."""
    width, height = (
        side * aspect for side, aspect in zip(film["resolution"], film["pixel_aspect"], strict=True)
    )
    corners = np.concatenate([_corners(volume) for volume in volumes])
    matrix, start, end = framing(corners, camera, width / height)
    place = f'camera "{entry["name"]}"'
    entry["matrix_world"] = matrix_rows(matrix, place)
    entry["clip_start"], entry["clip_end"] = shortest(start, place), shortest(end, place)


def _warn_of_clamps(scene, entry, messages):
    """Report a clamp of Cycles that this scene's light reaches.

    A white medium that scatters alike in all directions sends, at a distance d of a point light of power P,
    the radiance P / (4 pi d)^2 to a ray. Samples beyond the clamp are cut off to it.
    """
    clamps = {
        name: getattr(scene.cycles, setting)
        for name, setting in (("Direct", "sample_clamp_direct"), ("Indirect", "sample_clamp_indirect"))
    }
    clamps = {name: value for name, value in clamps.items() if value > 0.0}
    if not clamps:
        return
    least = min(clamps.values())
    bright = []
    for light in entry["lights"]:
        power = light["strength"] * 2.0 ** light["exposure"] * max(light["color"])
        if light["type"] == "sun":
            if power / (4.0 * np.pi) > least:
                bright.append(light["name"])
            continue
        # An area light sends four times as much along its normal as a point light of its power.
        reach = np.sqrt(max(power, 0.0) * (4.0 if light["type"] == "area" else 1.0) / least) / (4.0 * np.pi)
        place = np.array([row[3] for row in light["matrix_world"][:3]])
        if any(_distance(place, volume) < reach for volume in _volumes(entry)):
            bright.append(light["name"])
    if bright:
        settings = " and ".join(f"Clamp {name} {value:g}" for name, value in clamps.items())
        messages.warning(
            f"Cycles settings, {settings}",
            f"left out: Blender cuts off what is brighter, which {listed(bright)} makes in the volume, so "
            "its own picture is darker (of a lamp of 1000 W in a cloud, 0.68 of ours at the default of 10). "
            "For the same picture set both clamps to 0 in Blender",
        )


def _volumes(entry):
    return [entry["volume"], *entry.get("other_volumes", [])]


def _corners(volume):
    """The corners of a volume's bounds in the world, f64 [8, 3]."""
    limits = np.array([volume["bounds"]["min"], volume["bounds"]["max"]])
    matrix = matrix_array(volume["matrix_world"])
    corners = np.array([[limits[bit >> axis & 1, axis] for axis in range(3)] for bit in range(8)])
    return corners @ matrix[:3, :3].T + matrix[:3, 3]


def _distance(place, volume):
    """Distance of a point from the box around a volume's corners; 0 inside."""
    corners = _corners(volume)
    return np.linalg.norm(
        np.maximum(0.0, np.maximum(corners.min(axis=0) - place, place - corners.max(axis=0)))
    )


# Closures with the inputs that make them glow, where these are linked or above 0.
GLOWING = {
    "ShaderNodeEmission": ("Strength",),
    "ShaderNodeVolumePrincipled": ("Emission Strength", "Blackbody Intensity"),
    "ShaderNodeVolumeCoefficients": ("Emission Coefficients",),
}


def _warn_of_darkness(entry, messages):
    """Report a scene in which nothing shines: what lit it in Blender was left out, or never there."""
    world = entry["world"]
    is_lit = any(light["strength"] != 0.0 and any(light["color"]) for light in entry["lights"])
    is_lit |= world["strength"] != 0.0 and ("image" in world or "graph" in world or any(world["color"]))
    for graph in (entry["graph"], *entry.get("other_graphs", [])):
        for nodes in (graph["nodes"], *(group["nodes"] for group in graph["groups"])):
            for node in nodes:
                values = [node["inputs"].get(name, 0.0) for name in GLOWING.get(node["type"], ())]
                is_lit |= any(
                    isinstance(value, dict) or np.any(np.asarray(value, float) > 0.0) for value in values
                )
    if not is_lit:
        messages.warning(
            f'scene "{entry["name"]}"',
            "the picture will be black: no light, world or volume of it shines. Light of surfaces is not in "
            "a scene file; add a light or give the world a colour",
        )


def _animated_parts(depsgraph, camera, volumes, materials, messages):
    """What of a scene may move, as the depsgraph evaluated it, with labels."""
    world = depsgraph.view_layer_eval.world_override or depsgraph.scene_eval.world
    items = [
        (f'scene "{depsgraph.scene.name}"', depsgraph.scene_eval),
        (f'camera "{camera.name}"', camera.evaluated_get(depsgraph)),
    ]
    if world is not None:
        items.append((f'world "{world.name}"', world))
    objects = list(dict.fromkeys(volume.object for volume in volumes))
    carriers = []
    for instance in depsgraph.object_instances:
        item = instance.object.original
        if item.type == "LIGHT":
            items.append((f'light "{item.name}"', item.evaluated_get(depsgraph)))
        if instance.is_instance and (item in objects or item.type == "LIGHT"):
            carriers.append(instance.parent.original)
    items += [
        (f'object "{item.name}"', item.evaluated_get(depsgraph))
        for item in dict.fromkeys([*objects, *carriers])
    ]
    for item in objects:
        moving = moving_modifiers(item)
        if moving:
            messages.warning(
                f'object "{item.name}", modifiers',
                f"{', '.join(moving)} may change with time; the mesh is what it is at frame "
                f"{depsgraph.scene.frame_current} (--frame)",
            )
    items += [(f'material "{material.name}"', material) for material in materials.values()]
    return items


def _require_known_number(volume, graph):
    """Refuse an instance whose material reads Object Info's Random, which Cycles takes from the instancer."""
    if not volume.is_instance or graph is None:
        return
    trees = [graph["nodes"], *(group["nodes"] for group in graph["groups"])]
    for nodes in trees:
        informed = {node["name"] for node in nodes if node["type"] == "ShaderNodeObjectInfo"}
        for node in nodes:
            for value in node["inputs"].values():
                if isinstance(value, dict) and value.get("socket") == "Random" and value["node"] in informed:
                    raise InputError(
                        f'object "{volume.entry["object"]}", node "{value["node"]}"',
                        "Random of Object Info on an instance, whose number is its instancer's",
                        "an object, whose number follows from its name",
                        "make the instances real (in Blender: Object, Apply, Make Instances Real), or give "
                        "the number by a Value node",
                    )


def _while_rendering(scene, read):
    """`read(depsgraph)` with the depsgraph that a render of the scene has; its result.

    Blender gives such a depsgraph to render engines alone, so the reader is one.
    """
    found = {}

    class Reader(bpy.types.RenderEngine):
        """Reads the scene in place of rendering it."""

        bl_idname = "CLOUDPARITY_READER"
        bl_label = "cloudparity"

        def render(self, depsgraph):
            """Called by Blender."""
            try:
                found["result"] = read(depsgraph)
            except Exception as error:
                # Blender would print it and go on.
                found["error"] = error

    render = scene.render
    before = render.engine, render.use_compositing, render.use_sequencer
    bpy.utils.register_class(Reader)
    try:
        render.engine = Reader.bl_idname
        render.use_compositing = render.use_sequencer = False
        bpy.ops.render.render(layer=bpy.context.view_layer.name, scene=scene.name)
    except RuntimeError as error:
        found.setdefault("error", error)
    finally:
        render.engine, render.use_compositing, render.use_sequencer = before
        bpy.utils.unregister_class(Reader)
    if "error" in found:
        raise found["error"]
    if "result" not in found:
        raise InputError(
            f'scene "{scene.name}"',
            "a scene that Blender does not begin to render",
            "one that renders",
            "look at its render settings in Blender",
        )
    return found["result"]


def _go_to_frame(scene, frame):
    if frame is not None and not scene.frame_start <= frame <= scene.frame_end:
        raise InputError(
            f'scene "{scene.name}", frame',
            str(frame),
            f"a frame of the scene, {scene.frame_start} to {scene.frame_end}",
            "give one of these, or widen the frame range of the scene in Blender",
        )
    # Without a frame, too: markers choose the camera, and drivers are computed.
    scene.frame_set(scene.frame_current if frame is None else frame)


def _warn_of_settings(scene, camera, messages):
    if camera.data.dof.use_dof:
        messages.warning(f'camera "{camera.name}"', "depth of field is left out: everything is in focus")
    for setting, effect in LEFT_OUT_SETTINGS.items():
        if getattr(scene.render, setting):
            messages.warning(f"render settings, {setting}", effect)
    if scene.view_settings.use_curve_mapping:
        messages.warning("color management", "the display curves are left out")
    if scene.render.engine != "CYCLES":
        messages.warning(
            "render settings, engine",
            f"{scene.render.engine}: the scene is what Cycles makes of the file, which may look different",
        )
    if len(bpy.data.scenes) > 1:
        others = [other.name for other in bpy.data.scenes if other != scene]
        messages.warning(f'scene "{scene.name}"', f"is the active one and taken; not taken: {listed(others)}")
    layer = bpy.context.view_layer
    others = [other.name for other in scene.view_layers if other.use and other.name != layer.name]
    if others:
        messages.warning(
            f'view layer "{layer.name}"', f"is the active one and taken; not taken: {listed(others)}"
        )
    if scene.render.use_compositing and scene.compositing_node_group is not None:
        messages.warning(
            "render settings, use_compositing", "left out: what the compositor does to the picture is missing"
        )
    if scene.render.use_sequencer and scene.sequence_editor is not None and scene.sequence_editor.strips:
        messages.warning(
            "render settings, use_sequencer", "left out: the picture is the scene's, not the sequencer's"
        )
    if scene.cycles.use_fast_gi:
        messages.warning("Cycles settings, use_fast_gi", "left out: light is transported, not approximated")


def _warn_of_other_outputs(material, messages):
    output = volume_output(material)
    effects = {
        "Surface": "left out: only the volume is exported; what the surface hides or reflects is missing",
        "Displacement": "left out: only the volume is exported, in the mesh as it is without",
    }
    for name, effect in effects.items():
        if (output.name, name) in live_links(material.node_tree):
            messages.warning(f'material "{material.name}", {name}', effect)


def _read_camera(scene, item):
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
        "name": unique_name(item.original),
        "projection": PROJECTIONS[camera.type],
        "matrix_world": matrix_rows(item.matrix_world, f'object "{item.name}", matrix_world'),
        **read_fields(camera, CAMERA_FIELDS, place),
        "shift": shortest_list((camera.shift_x, camera.shift_y), place),
        **read_fields(camera, CLIP_FIELDS, place),
    }
    if camera.type == "PANO":
        entry["panorama"] = read_fields(camera, PANORAMA_FIELDS, place)
    return entry


def _read_film(scene):
    render = scene.render
    return {
        "resolution": [render.resolution_x, render.resolution_y],
        "resolution_percentage": render.resolution_percentage,
        "pixel_aspect": shortest_list((render.pixel_aspect_x, render.pixel_aspect_y), "pixel aspect"),
        **read_fields(scene.cycles, FILM_FIELDS, "Cycles film settings"),
        "transparent": render.film_transparent,
    }


def _crop(scene, camera, film, messages):
    """Turn the frame into the render region, where the file renders just that."""
    render = scene.render
    if not render.use_border:
        return
    place = "render settings, use_border"
    if not render.use_crop_to_border:
        messages.warning(
            place, "left out: the whole frame is rendered; Crop to Render Region makes the region the frame"
        )
        return
    if camera["projection"] == "equirectangular":
        messages.warning(place, "left out: the whole panorama is rendered")
        return
    size = [int(side * film["resolution_percentage"] / 100) for side in film["resolution"]]
    low, high = (
        [int(part * side) for part, side in zip(corner, size, strict=True)]
        for corner in (
            (render.border_min_x, render.border_min_y),
            (render.border_max_x, render.border_max_y),
        )
    )
    region = [max(end - begin, 1) for begin, end in zip(low, high, strict=True)]
    # Pixels count in widths of a pixel.
    tall = film["pixel_aspect"][1] / film["pixel_aspect"][0]
    is_wide = size[0] >= size[1] * tall
    fit = camera["sensor_fit"]
    if fit == "AUTO":
        fit, sensor = ("HORIZONTAL" if is_wide else "VERTICAL"), camera["sensor_width"]
    else:
        sensor = camera["sensor_width" if fit == "HORIZONTAL" else "sensor_height"]
    fitted = size[0] if fit == "HORIZONTAL" else size[1] * tall
    # Of the region's middle, from the frame's.
    moved = [begin + part / 2 - side / 2 for begin, part, side in zip(low, region, size, strict=True)]
    shift = [
        (camera["shift"][0] * fitted + moved[0]) / region[0],
        (camera["shift"][1] * fitted + moved[1] * tall) / region[0],
    ]
    camera["sensor_fit"] = "HORIZONTAL"
    camera["sensor_width"] = shortest(sensor * region[0] / fitted, place)
    camera["ortho_scale"] = shortest(camera["ortho_scale"] * region[0] / fitted, place)
    camera["shift"] = shortest_list(shift, place)
    film["resolution"], film["resolution_percentage"] = region, 100
