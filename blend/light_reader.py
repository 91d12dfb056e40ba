"""Reads the lights of a scene.

Measured with Cycles 5.0.1, by the light on a white surface: a temperature multiplies the colour by Blender's
`temperature_color`; without `normalize` the strength counts per size, and the light is that of one with
`normalize` and the strength times pi sin^2(angle / 2) of a sun, 4 pi radius^2 of a point or spot light, and
the area of an area light in world space; an Emission node multiplies by its colour and strength. A light
that is not visible to volume scatter does not light a volume.
"""

import math

import numpy as np

from graph_reader import unique_name
from light_nodes import plain_emission
from protocol import InputError
from scene_io import matrix_rows, read_fields, shortest, shortest_list

LIGHT_TYPES = {"SUN": "sun", "POINT": "point", "SPOT": "spot", "AREA": "area"}
# Scene key to Blender attribute, in the order of the file.
LIGHT_FIELDS = {"color": "color", "strength": "energy", "exposure": "exposure"}
LIGHT_TYPE_FIELDS = {
    "SUN": {"angle": "angle"},
    "POINT": {"radius": "shadow_soft_size", "soft_falloff": "use_soft_falloff"},
    "SPOT": {"radius": "shadow_soft_size", "spot_size": "spot_size", "blend": "spot_blend"},
    "AREA": {"shape": "shape"},
}
# Settings of a light that the scene format has no words for, with the value of a light that it describes.
FIXED_LIGHT_SETTINGS = {
    "use_temperature": False,
    "normalize": True,
    "use_shadow": True,
    "spread": float(np.float32(math.pi)),
    "use_square": False,
}
# What a setting that is refused does, and what to do instead.
REFUSED_SETTINGS = {
    "use_shadow": ("a light that nothing dims", "switch Cast Shadow on"),
    "spread": ("a beam narrower than a half space", "set Spread to 180 degrees, or use a spot light"),
    "use_square": ("a spot of a square shape", "switch Square off"),
    "use_soft_falloff": ("a spot whose source is a sphere", "switch Soft Falloff on"),
}


def read_lights(depsgraph, scene, messages, faults, tree_colors):
    """The lights of a depsgraph for rendering, sorted by name. `faults` gets those that cannot be read;
    `tree_colors` is what light_nodes.colors_of_trees found."""
    lights, taken = [], set()
    for instance in depsgraph.object_instances:
        item = instance.object
        if item.type != "LIGHT":
            continue
        name = unique_name(item.original)
        if instance.is_instance:
            name = f"{unique_name(instance.parent.original)}/{name}"
        own, number = name, 2
        while name in taken:
            name, number = f"{own} {number}", number + 1
        taken.add(name)
        entry = None
        with faults.noted():
            entry = _read_light(item, name, instance.matrix_world.copy(), scene, messages, tree_colors)
        if entry is not None:
            lights.append(entry)
    return sorted(lights, key=lambda light: light["name"])


def _read_light(item, name, matrix, scene, messages, tree_colors):
    light = item.data
    place = f'light "{name}"'
    if not item.visible_volume_scatter:
        messages.warning(place, "left out: it is not visible to volume scatter, so it lights no volume")
        return None
    if light.type == "AREA" and light.cycles.is_portal:
        messages.warning(place, "left out: a portal is no light and only guides samples of the world")
        return None
    _require_transport(item, place, scene)
    if item.visible_camera and _has_extent(light):
        messages.warning(f"{place}, ray visibility", "the lamp itself is not seen: camera is read as off")
    factor = _color_factor(light, tree_colors.get(light.original))
    strength = _strength_factor(light, matrix, place)
    rows = matrix_rows(matrix, f'object "{name}", matrix_world')
    fields = read_fields(light, LIGHT_FIELDS, place)
    if factor is not None:
        fields["color"] = shortest_list(np.multiply(fields["color"], factor), place)
    if strength != 1.0:
        fields["strength"] = shortest(np.float64(fields["strength"]) * strength, place)
    entry = {
        "name": name,
        "type": LIGHT_TYPES[light.type],
        "matrix_world": rows,
        **fields,
        **read_fields(light, LIGHT_TYPE_FIELDS[light.type], place),
    }
    if light.type == "AREA":
        # Blender keeps a second size that a square or a disk does not use.
        height = light.size if light.shape in ("SQUARE", "DISK") else light.size_y
        entry["size"] = shortest_list((light.size, height), place)
    return entry


def _has_extent(light):
    return light.type == "AREA" or (light.type != "SUN" and light.shadow_soft_size > 0.0)


def _require_transport(item, place, scene):
    """Refuse what another light transport than a scene's would be needed for."""
    light = item.data
    fixed = {name: FIXED_LIGHT_SETTINGS[name] for name in ("use_shadow", "spread", "use_square")}
    if light.type == "SPOT":
        fixed["use_soft_falloff"] = True
    for setting, expected in fixed.items():
        found = getattr(light, setting, expected)
        if found != expected:
            what, remedy = REFUSED_SETTINGS[setting]
            raise InputError(f"{place}, {setting}", f"{found}: {what}", str(expected), remedy)
    # A scattering event that a light reaches is a bounce less than the path has.
    if light.cycles.max_bounces < min(scene.cycles.volume_bounces, scene.cycles.max_bounces):
        raise InputError(
            f"{place}, max_bounces",
            f"{light.cycles.max_bounces}: a light of the first bounces alone",
            f"at least {scene.cycles.volume_bounces}, the volume bounces of the scene",
            "raise Max Bounces of the light, or lower the volume bounces",
        )
    linking = item.light_linking
    for kind in ("receiver_collection", "blocker_collection"):
        collection = getattr(linking, kind)
        if collection is not None:
            raise InputError(
                f"{place}, light linking",
                f'the collection "{collection.name}"',
                "a light that reaches everything",
                "remove the light linking (Object properties, Shading)",
            )


def _color_factor(light, tree_color):
    """What the colour is multiplied with; None where it stays as it is. `tree_color` is what
    light_nodes.colors_of_trees found, None where the tree is a plain Emission."""
    factor = None
    if light.use_temperature:
        factor = np.array(light.temperature_color, np.float64)
    color = None
    if isinstance(tree_color, InputError):
        raise tree_color
    if tree_color is not None:
        color = tree_color
    elif light.use_nodes and light.node_tree is not None:
        emission = plain_emission(light)
        color = np.array(emission.inputs["Color"].default_value[:3], np.float64)
        color *= emission.inputs["Strength"].default_value
    if color is not None and not np.array_equal(color, np.ones(3)):
        factor = color if factor is None else factor * color
    return factor


def _strength_factor(light, matrix, place):
    """The strength of the same light with `normalize`, per strength."""
    if light.normalize:
        return 1.0
    if light.type == "SUN":
        size = math.pi * math.sin(light.angle / 2.0) ** 2
    elif light.type == "AREA":
        height = light.size if light.shape in ("SQUARE", "DISK") else light.size_y
        axes = np.array([matrix.col[axis][:3] for axis in range(2)])
        size = light.size * height * np.linalg.norm(np.cross(axes[0], axes[1]))
        size *= math.pi / 4.0 if light.shape in ("DISK", "ELLIPSE") else 1.0
    else:
        size = 4.0 * math.pi * light.shadow_soft_size**2
    if size == 0.0:
        raise InputError(
            f"{place}, normalize",
            "off, with a size of 0",
            "on, or a size",
            "switch Normalize on, or give the light a size",
        )
    return float(size)
