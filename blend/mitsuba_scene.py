"""A scene file as a scene of Mitsuba 3, for an opinion of a renderer that shares no code with the other two.

Needs no Mitsuba: the result is plain data, in which 4x4 arrays stand for transforms and 4D arrays for grids.
It holds only what both sides express exactly; everything else is refused by the place where it stands.

Where the conventions differ:
  camera     ours looks along its -Z with +X to the right, Mitsuba's along +Z with +X to the left: turned by
             half a turn about Y.
  bounces    n volume bounces are n + 1 scattering events; Mitsuba counts edges of the path: depth n + 2.
  grid       values are at the centres of cells. The grid has 2x2x2 cells whose centres are the corners of the
             cube, so its box is twice as large as the cube, which alone bounds the medium.
  colours    Principled's colour is the albedo only while the absorption colour is black. Extinction has to be
             grey, because then one density suffices and free paths are sampled for all channels at once.
  sun        the strength is the irradiance on a plane that faces the sun, on both sides.
"""

import math

import numpy as np

from protocol import InputError
from scene_io import check_format, matrix_array

HALF_TURN = np.diag([-1.0, 1.0, -1.0, 1.0])


def mitsuba_scene(scene, resolution=None):
    """Return the scene (Located JSON) as a dictionary for `mitsuba.load_dict`, arrays not yet converted.

    `resolution` (width, height) stands in for the scene's.
    """
    check_format(scene)
    _require(not scene.get("other_volumes"), "scene.other_volumes", "several volumes", "one")
    width, height = resolution or film_resolution(scene["film"])
    corners = _corners(scene["volume"])
    return {
        "type": "scene",
        "integrator": {
            "type": "volpath",
            "max_depth": volume_bounces(scene) + 2,
            "rr_depth": volume_bounces(scene) + 3,  # never: roulette would only add noise to so few bounces
        },
        "sensor": _camera(scene["camera"], corners, width, height) | {"film": _film(scene, width, height)},
        "cube": _cube(scene["volume"]) | {"interior": _medium(scene)},
        "world": _world(scene["world"]),
    } | {f"sun {number}": _sun(light) for number, light in enumerate(scene["lights"])}


def volume_bounces(scene):
    """Scattering events beyond the first: the smaller of the two limits counts."""
    return min(scene["integrator"]["volume_bounces"], scene["integrator"]["max_bounces"])


def film_resolution(film):
    """Width and height in pixels; the percentage truncates."""
    return [size * film["resolution_percentage"] // 100 for size in film["resolution"]]


def extinction(scene):
    """Extinction over the object's coordinates as (a, bx, by, bz): a + bx x + by y + bz z."""
    graph = scene["graph"]
    inputs, place = _principled(graph)["inputs"], "scene.graph Principled Volume"
    density = _affine({node["name"]: node for node in graph["nodes"]}, inputs["Density"], f"{place}.Density")
    return density * _per_density(inputs, place)[0]


def _require(condition, place, found, expected):
    if not condition:
        raise InputError(place, str(found), expected, "leave this scene to the other renderers, or change it")


def _camera(camera, corners, width, height):
    place = "scene.camera"
    _require(
        camera["projection"] == "perspective", f"{place}.projection", camera["projection"], "perspective"
    )
    _require(not any(camera["shift"]), f"{place}.shift", camera["shift"], "no shift")
    fit = camera["sensor_fit"]
    is_horizontal = width > height if fit == "AUTO" else fit == "HORIZONTAL"
    sensor = camera["sensor_height"] if fit == "VERTICAL" else camera["sensor_width"]
    to_world = matrix_array(camera["matrix_world"])
    to_world[:3, :3] /= np.linalg.norm(to_world[:3, :3], axis=0)  # the camera's scale does not count
    depths = (to_world[:3, 3] - corners) @ to_world[:3, 2]
    _require(
        camera["clip_start"] < depths.min() and depths.max() < camera["clip_end"],
        f"{place}.clip_start",
        f"a volume between depths {depths.min():g} and {depths.max():g}",
        "a volume between the clip planes: rays have to start in vacuum",
    )
    return {
        "type": "perspective",
        "fov": math.degrees(2 * math.atan(sensor / (2 * camera["focal_length"]))),
        "fov_axis": "x" if is_horizontal else "y",
        "near_clip": camera["clip_start"],
        "far_clip": camera["clip_end"],
        "to_world": to_world @ HALF_TURN,
    }


def _film(scene, width, height):
    film, place = scene["film"], "scene.film"
    _require(film["pixel_filter"] == "BOX", f"{place}.pixel_filter", film["pixel_filter"], "BOX")
    aspect = film["pixel_aspect"]
    _require(aspect[0] == aspect[1], f"{place}.pixel_aspect", aspect, "square pixels")
    _require(film["exposure"] == 1, f"{place}.exposure", film["exposure"], "exposure 1")
    _require(not film["transparent"], f"{place}.transparent", "a transparent film", "an opaque one")
    return {
        "type": "hdrfilm",
        "width": int(width),
        "height": int(height),
        "pixel_format": "rgb",
        "component_format": "float32",
        "rfilter": {"type": "box"},
    }


def _sun(light):
    place = f"scene.lights {light['name']}"
    _require(light["type"] == "sun", f"{place}.type", light["type"], "a sun")
    _require(light["angle"] == 0, f"{place}.angle", light["angle"], "angle 0, a single direction")
    back = matrix_array(light["matrix_world"])[:3, 2]
    strength = light["strength"] * 2 ** light["exposure"]
    return {
        "type": "directional",
        "direction": [float(value) for value in -back / np.linalg.norm(back)],
        "irradiance": _rgb([strength * channel for channel in light["color"]]),
    }


def _world(world):
    _require("image" not in world, "scene.world.image", "a picture", "a constant world")
    _require("graph" not in world, "scene.world.graph", "nodes", "a constant world")
    return {
        "type": "constant",
        "radiance": _rgb([world["strength"] * channel for channel in world["color"]]),
    }


def _rgb(values):
    return {"type": "rgb", "value": [float(value) for value in values]}


def _box(volume):
    """Object to world, centre and half size of the box in object space."""
    _require(volume["shape"]["type"] == "box", "scene.volume.shape.type", volume["shape"]["type"], "box")
    low, high = (np.asarray(volume["bounds"][key], np.float64) for key in ("min", "max"))
    to_world = matrix_array(volume["matrix_world"])
    _require(
        np.linalg.det(to_world[:3, :3]) > 0, "scene.volume.matrix_world", "a mirrored object", "no mirror"
    )
    return to_world, (low + high) / 2, (high - low) / 2


def _corners(volume):
    """The corners of the box in world space, [8, 3]."""
    to_world, centre, half = _box(volume)
    signs = np.stack(np.meshgrid(*[[-1, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    return (centre + signs * half) @ to_world[:3, :3].T + to_world[:3, 3]


def _cube(volume):
    """Mitsuba's cube reaches from -1 to 1; its boundary neither scatters nor refracts."""
    to_world, centre, half = _box(volume)
    return {"type": "cube", "bsdf": {"type": "null"}, "to_world": to_world @ _placed(centre, half)}


def _placed(origin, scale):
    """The matrix of x -> origin + scale x."""
    matrix = np.diag([*scale, 1.0])
    matrix[:3, 3] = origin
    return matrix


def _medium(scene):
    inputs, place = _principled(scene["graph"])["inputs"], "scene.graph Principled Volume"
    _, albedo = _per_density(inputs, place)
    anisotropy = _number(inputs["Anisotropy"], f"{place}.Anisotropy")
    to_world, centre, half = _box(scene["volume"])
    values = _corner_values(extinction(scene), centre, half)
    _require(
        values.min() >= 0,
        f"{place}.Density",
        f"extinction {values.min():g} in a corner",
        "none below 0, where the density would have a kink",
    )
    return {
        "type": "heterogeneous",
        "sigma_t": {
            "type": "gridvolume",
            "grid": np.float32(values)[..., None],
            "filter_type": "trilinear",
            "wrap_mode": "clamp",
            "raw": True,
            # A grid fills [0, 1]^3; its 2 centres per axis, 1/4 and 3/4, go to the faces of the box.
            "to_world": to_world @ _placed(centre - 2 * half, 4 * half),
        },
        "albedo": {"type": "constvolume", "value": _rgb(albedo)},
        "phase": {"type": "hg", "g": anisotropy},
    }


def _corner_values(affine, centre, half):
    """The affine function at the corners of the box, as a grid indexed [z, y, x]."""
    low, high = centre - half, centre + half
    z, y, x = np.meshgrid(*([low[axis], high[axis]] for axis in (2, 1, 0)), indexing="ij")
    return affine[0] + affine[1] * x + affine[2] * y + affine[3] * z


def _per_density(inputs, place):
    """Extinction per density (grey) and albedo (RGB) of a Principled Volume."""
    for name in ("Emission Strength", "Blackbody Intensity"):
        _require(_number(inputs[name], f"{place}.{name}") == 0, f"{place}.{name}", inputs[name], "none")
    color, absorption = (_color(inputs[name], f"{place}.{name}") for name in ("Color", "Absorption Color"))
    _require(min(color.min(), absorption.min()) >= 0, f"{place}.Color", "a negative colour", "none below 0")
    total = color + np.maximum(1 - color, 0) * np.maximum(1 - np.sqrt(absorption), 0)
    # Exact arithmetic would give equal channels; f32 colours give them to a rounding of f64.
    is_grey = np.ptp(total) <= 1e-12 * total.max() and total.max() > 0
    _require(is_grey, f"{place}.Color", f"extinction {total} per density", "extinction above 0, grey")
    return float(total[0]), [float(value) for value in color / total]


def _principled(graph):
    """The node that the output's Volume socket is linked to."""
    outputs = [node for node in graph["nodes"] if node["type"] == "ShaderNodeOutputMaterial"]
    _require(len(outputs) == 1, "scene.graph", f"{len(outputs)} material outputs", "one")
    link = outputs[0]["inputs"].get("Volume")
    _require(isinstance(link, dict) and "node" in link, "scene.graph Volume", "no link", "a closure")
    node = next(node for node in graph["nodes"] if node["name"] == link["node"])
    is_principled = node["type"] == "ShaderNodeVolumePrincipled" and not node.get("muted")
    _require(is_principled, f"scene.graph {node['name']}", node["type"], "a Principled Volume")
    return node


def _number(value, place):
    _require(isinstance(value, (int, float)), place, "a link", "a number")
    return float(np.float32(value))


def _color(value, place):
    _require(isinstance(value, list), place, "a link", "a colour")
    return np.asarray(value[:3], np.float32).astype(np.float64)


def _affine(nodes, value, place):
    """The value of an input as an affine function of the object's coordinates, (a, bx, by, bz).

    Only nodes that give such functions are known: a trilinear grid holds no others exactly.
    """
    if isinstance(value, (int, float)):
        return np.array([np.float32(value), 0, 0, 0], np.float64)
    _require("node" in value, place, value, "a number or a link to a node")
    node = nodes[value["node"]]
    place, kind, properties = f"scene.graph {node['name']}", node["type"], node["properties"]
    _require(not node.get("muted"), place, "a muted node", "none")
    if kind == "ShaderNodeSeparateXYZ":
        _object_coordinates(nodes, node["inputs"]["Vector"], f"{place}.Vector")
        return np.eye(4)["XYZ".index(value["socket"]) + 1]
    _require(kind == "ShaderNodeMapRange", place, kind, "Map Range, or Separate XYZ of Object coordinates")
    for name, expected in (("data_type", "FLOAT"), ("interpolation_type", "LINEAR"), ("clamp", False)):
        _require(properties[name] == expected, f"{place}.{name}", properties[name], str(expected))
    from_min, from_max, to_min, to_max = (
        _number(node["inputs"][name], f"{place}.{name}")
        for name in ("From Min", "From Max", "To Min", "To Max")
    )
    _require(from_min != from_max, f"{place}.From Max", from_max, "another value than From Min")
    slope = (to_max - to_min) / (from_max - from_min)
    constant = np.array([to_min - slope * from_min, 0, 0, 0])
    return slope * _affine(nodes, node["inputs"]["Value"], f"{place}.Value") + constant


def _object_coordinates(nodes, value, place):
    """Refuse what is not the output Object of a Texture Coordinate node, of the volume's own object."""
    node = nodes[value["node"]] if isinstance(value, dict) and "node" in value else {"type": "no link"}
    _require(node["type"] == "ShaderNodeTexCoord", place, node["type"], "Texture Coordinate")
    is_own = not node["properties"]["from_instancer"] and node["properties"]["object"] is None
    _require(value["socket"] == "Object" and is_own, place, value["socket"], "Object, of the own object")
    _require(not node.get("muted"), place, "a muted node", "none")
