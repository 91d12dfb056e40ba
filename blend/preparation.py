"""Makes the open file ready to be read, before anything of it is evaluated.

Takes out what Blender's module breaks down at, shows what the caller wants to see although it is hidden, and
adds what a picture needs and the file lacks: a camera, a cube for a material that no object shows. Nothing is
saved.
"""

import math

import bmesh
import bpy
import numpy as np
from mathutils import Euler

from graph_reader import missing_reason, unique_name, volume_output
from protocol import InputError

# How Blender's own new scene looks at its cube: from the front right above.
VIEW_ROTATION = (math.radians(63.5593), 0.0, math.radians(46.6919))
# Share of the frame that the volumes fill in the direction in which they fill most.
FILLED = 0.8
CUBE_EDGE = 2.0
SHOWN = 5
NAMES_SHOWN = 3


class TakenOut:
    """What was taken out of a file because Blender's module breaks down where it is evaluated.

    `domains` {object: "gas" or "liquid"} are fluid domains, which have lost their modifier: the module aborts
    where it frees their solver. What a render would show of them is in the caches of their simulations.
    `freestyle` names the scenes that would have been drawn with lines, at which the module crashes.
    """

    def __init__(self):
        self.domains = {}
        self.freestyle = []
        for scene in bpy.data.scenes:
            if scene.render.use_freestyle:
                self.freestyle.append(scene.name)
                scene.render.use_freestyle = False
            for layer in scene.view_layers:
                layer.use_freestyle = False
        for item in bpy.data.objects:
            for modifier in list(item.modifiers):
                if modifier.type == "FLUID":
                    if modifier.fluid_type == "DOMAIN":
                        self.domains[item] = modifier.domain_settings.domain_type.lower()
                    item.modifiers.remove(modifier)


class StandIns:
    """What a file is read with in place of what it lacks, or what cannot be evaluated.

    `domains` are its fluid domains by object; `empty_material` is theirs, a volume of density 0, which is
    what Blender shows of a domain without a cache. `default_material` is what Cycles gives a Volume object
    without a material: a Principled Volume as a new node has it (measured in 5.0.1 and 5.3.0: the same
    picture).
    """

    def __init__(self, domains):
        self.domains = domains
        self.default_material = _volume_material("Default Volume", 1.0)
        self.empty_material = _volume_material("Empty Domain", 0.0)
        self.materials = (self.default_material, self.empty_material)


def _volume_material(name, density):
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    closure = tree.nodes.new("ShaderNodeVolumePrincipled")
    closure.inputs["Density"].default_value = density
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(closure.outputs["Volume"], output.inputs["Volume"])
    return material


def show_hidden(scene, messages):
    """Show in renders every object of the scene with a volume that is hidden, or in a hidden collection."""
    shown = []
    for item in scene.objects:
        is_volume = item.type == "VOLUME" or any(
            volume_output(slot.material) is not None for slot in item.material_slots
        )
        if not is_volume or not why_not_rendered(item, scene):
            continue
        item.hide_render = False
        # Whatever its other collections are, the scene's own is rendered.
        if item.name not in scene.collection.objects:
            scene.collection.objects.link(item)
        shown.append(unique_name(item))
    if shown:
        messages.warning(
            f"hidden objects: {listed(shown, SHOWN)}", "shown (--include-hidden): Blender hides them"
        )


def listed(names, count=NAMES_SHOWN):
    """The first names, at most `count`, and how many more there are."""
    shown = ", ".join(f'"{name}"' for name in names[:count])
    return shown + (f" and {len(names) - count} more" if len(names) > count else "")


def add_material_cube(scene, name):
    """Add a cube of 2 m at the origin with the material `name`; the object."""
    material = next((item for item in bpy.data.materials if unique_name(item) == name), None)
    if volume_output(material) is None:
        known = [unique_name(item) for item in bpy.data.materials if volume_output(item) is not None]
        raise InputError(
            f'material "{name}"',
            "no such material" if material is None else "a material without a volume",
            f"one of {', '.join(known)}" if known else "a material with a linked Volume; the file has none",
            "name a material with a volume (--material)",
        )
    mesh = bpy.data.meshes.new(name)
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=CUBE_EDGE)
    shape.to_mesh(mesh)
    shape.free()
    mesh.materials.append(material)
    cube = bpy.data.objects.new(f"Cube of {name}", mesh)
    scene.collection.objects.link(cube)
    return cube


def choose_camera(scene, name, wants_own, messages):
    """The camera object to look through, and whether it is one of ours, whose place `framing` finds.

    `name` is the user's choice. `wants_own` asks for one of ours although the file may have some.
    """
    cameras = sorted((item for item in scene.objects if item.type == "CAMERA"), key=unique_name)
    known = [unique_name(item) for item in cameras]
    if name is not None:
        if name not in known:
            raise InputError(
                f'camera "{name}"',
                "no such camera in the scene",
                f"one of {', '.join(known)}" if known else "a camera; the scene has none",
                "name one of them (--camera), or leave the option out",
            )
        return cameras[known.index(name)], False
    active = scene.camera
    if wants_own or not cameras:
        why = "frames the material's cube" if wants_own else "the scene has no camera that renders"
        if active is not None and active.is_missing:
            found, _, _ = missing_reason(active)
            why = f"the scene's camera is {found}"
        messages.warning(
            "camera",
            f"{why}: one of ours frames all volumes from the front right above, as Blender's new scene has "
            "its camera",
        )
        return _own_camera(scene), True
    if active in cameras:
        others = [other for other in known if other != unique_name(active)]
        if others:
            messages.warning(
                f'camera "{active.name}"',
                f"is the active one and taken; not taken: {listed(others, SHOWN)} (--camera)",
            )
        return active, False
    others = f"; not taken: {listed(known[1:], SHOWN)} (--camera)" if len(known) > 1 else ""
    messages.warning(f'camera "{known[0]}"', f"taken, since the scene has no active one{others}")
    return cameras[0], False


def _own_camera(scene):
    camera = bpy.data.cameras.new("Camera")
    item = bpy.data.objects.new("Camera", camera)
    scene.collection.objects.link(item)
    return item


def framing(corners, camera, aspect):
    """Where a perspective camera of ours stands, and its clip distances.

    `corners` are points in the world, f64 [n, 3], all of which are to be seen; `aspect` is the frame's width
    over its height. Returns (matrix [4][4], clip start, clip end).
    """
    axes = np.array(Euler(VIEW_ROTATION).to_matrix())
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    offsets = (corners - middle) @ axes
    # AUTO fits the sensor's width to the longer side.
    half = camera.sensor_width / 2.0 / camera.lens * FILLED
    slopes = np.array([half, half / aspect] if aspect >= 1.0 else [half * aspect, half])
    # A point z towards the camera, x beside the axis is seen from a distance d where x <= slope (d - z).
    distance = (offsets[:, 2:] + np.abs(offsets[:, :2]) / slopes).max()
    radius = np.linalg.norm(offsets, axis=1).max()
    distance = max(distance, np.finfo(np.float32).tiny)
    matrix = np.eye(4)
    matrix[:3, :3] = axes
    matrix[:3, 3] = middle + axes[:, 2] * distance
    nearest = max(distance - radius, distance * 1e-3)
    return matrix, min(0.1, nearest / 2.0), max(1000.0, 2.0 * (distance + radius))


def why_not_rendered(item, scene):
    """Why an object does not render in a scene: a clause, empty where nothing speaks against it."""
    if item.is_missing:
        return f"missing in its library {item.library.filepath}"
    if item.name not in scene.objects:
        return "in no scene" if not item.users_scene else "in another scene"
    if item.hide_render:
        return "hidden in renders"
    layer = bpy.context.view_layer.layer_collection
    if not any(
        collection == scene.collection or _is_rendered(layer, collection)
        for collection in item.users_collection
    ):
        return "in a collection that is hidden in renders or excluded"
    return ""


def _is_rendered(layer, collection):
    """Whether a collection renders below a layer collection, by what is hidden or excluded on the way."""
    if layer.exclude or layer.collection.hide_render:
        return False
    return layer.collection == collection or any(_is_rendered(child, collection) for child in layer.children)


def candidates(scene, stand_ins, notes):
    """What of a file without a volume that renders could be one, as clauses.

    `notes` {object: clause} say why a visible object shows no volume.
    """
    found = []
    for material in bpy.data.materials:
        if volume_output(material) is None or material in stand_ins.materials:
            continue
        carriers = [
            item
            for item in bpy.data.objects
            if any(slot.material == material for slot in item.material_slots)
        ]
        where = [f'on "{unique_name(item)}", {_state(item, scene, stand_ins, notes)}' for item in carriers]
        state = "; ".join(where[:SHOWN]) or "on no object"
        found.append(f'material "{unique_name(material)}" {state}')
    for item in bpy.data.objects:
        if item.type == "VOLUME" and not item.material_slots:
            found.append(f'Volume object "{unique_name(item)}", {_state(item, scene, stand_ins, notes)}')
        elif item.is_missing:
            found.append(f'object "{item.name}", {why_not_rendered(item, scene)}')
    return found


def _state(item, scene, stand_ins, notes):
    if item in stand_ins.domains:
        return f"a {stand_ins.domains[item]} domain, whose cache is not read"
    hidden = why_not_rendered(item, scene)
    return hidden or notes.get(item, "which renders no face with it")
