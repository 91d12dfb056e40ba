"""Colour ramps and curves: settings of nodes that are no plain values, as JSON objects and back.

Color ramp: {"interpolation", "hue_interpolation", "color_mode", "elements": [{"position", "color": [r, g, b,
a]}, ...]}, the elements in stored order. Curve mapping: {"extend", "use_clip", "clip": [min x, min y, max x,
max y], "curves": [[[x, y, handle type], ...], ...]}, points in rising order of x.
"""

import bpy
import numpy as np

from protocol import InputError
from rna import set_value
from scene_io import shortest, shortest_list

RAMP_SETTINGS = ("interpolation", "hue_interpolation", "color_mode")
MAPPING_SETTINGS = ("extend", "use_clip")
CLIP_FIELDS = ("clip_min_x", "clip_min_y", "clip_max_x", "clip_max_y")
# Blender keeps a minimum below the maximum that is set at the time: the widest rectangle comes first.
WIDEST_CLIP = (-100.0, -100.0, 100.0, 100.0)
# What curve mappings hold for other uses than shader nodes, with the values that change nothing there.
NEUTRAL_LEVELS = {"tone": "STANDARD", "black_level": [0.0, 0.0, 0.0], "white_level": [1.0, 1.0, 1.0]}
LARGEST_RAMP = 32
SMALLEST_CURVE = 2


def is_node_data(value):
    """Whether the value of a pointer property is something that this module reads."""
    return isinstance(value, (bpy.types.ColorRamp, bpy.types.CurveMapping))


def reason_against(value):
    """What (found, expected, remedy) a ramp or mapping cannot be written for, or None."""
    if isinstance(value, bpy.types.ColorRamp):
        return None
    levels = {
        "tone": value.tone,
        "black_level": list(value.black_level),
        "white_level": list(value.white_level),
    }
    if levels != NEUTRAL_LEVELS:
        return (f"curves with {levels}", f"{NEUTRAL_LEVELS}", "reset the levels of the curves")
    x0, y0, x1, y1 = (getattr(value, field) for field in CLIP_FIELDS)
    for curve in value.curves:
        for point in curve.points:
            x, y = point.location
            # Blender moves such a point into the rectangle as soon as it evaluates the curves.
            if value.use_clip and point.select and not (x0 <= x <= x1 and y0 <= y <= y1):
                return (
                    f"a selected curve point at {(x, y)}, outside of the clip rectangle {(x0, y0, x1, y1)}",
                    "points that Blender leaves where they are",
                    "update the curves, or deselect the point",
                )
    return None


def read_node_data(value, place):
    """Return a color ramp or a curve mapping as a JSON object."""
    if isinstance(value, bpy.types.ColorRamp):
        return _read_ramp(value, place)
    return _read_mapping(value, place)


def _read_ramp(ramp, place):
    settings = {name: getattr(ramp, name) for name in RAMP_SETTINGS}
    elements = [
        {
            "position": shortest(element.position, place),
            "color": shortest_list(element.color, place),
        }
        for element in ramp.elements
    ]
    return settings | {"elements": elements}


def _read_mapping(mapping, place):
    settings = {name: getattr(mapping, name) for name in MAPPING_SETTINGS}
    clip = shortest_list((getattr(mapping, field) for field in CLIP_FIELDS), place)
    return settings | {"clip": clip, "curves": [_read_points(curve, place) for curve in mapping.curves]}


def _read_points(curve, place):
    points = [[*shortest_list(point.location, place), point.handle_type] for point in curve.points]
    # Blender sorts them whenever it evaluates the curve.
    return sorted(points, key=lambda point: point[0])


BUILT_PROPERTIES = ("color_ramp", "mapping")


def build_node_data(node, name, entry, place):
    """Give `node` the color ramp or the curves (property `name`) that a JSON object describes."""
    if not is_node_data(getattr(node, name, None)):
        raise InputError(
            place,
            f"{name} of a {node.bl_idname}",
            "a node with a color ramp or curves",
            "remove the property",
        )
    if name == "color_ramp":
        _build_ramp(node.color_ramp, _with_keys(entry, {*RAMP_SETTINGS, "elements"}, place), place)
    else:
        _build_mapping(node.mapping, _with_keys(entry, {*MAPPING_SETTINGS, "clip", "curves"}, place), place)


def _with_keys(entry, keys, place):
    if not isinstance(entry, dict) or set(entry) != keys:
        raise InputError(place, repr(entry), f"an object with {', '.join(sorted(keys))}", "mend the object")
    return entry


def _with_length(entry, lengths, what, place):
    if not isinstance(entry, list) or len(entry) not in lengths:
        raise InputError(place, repr(entry), what, "mend the list")
    return entry


def _build_ramp(ramp, entry, place):
    for name in RAMP_SETTINGS:
        set_value(ramp, name, entry[name], f"{place}.{name}")
    wanted = _with_length(
        entry["elements"],
        range(1, LARGEST_RAMP + 1),
        f"a list of 1 to {LARGEST_RAMP} elements",
        f"{place}.elements",
    )
    while len(ramp.elements) > len(wanted):
        ramp.elements.remove(ramp.elements[-1])
    while len(ramp.elements) < len(wanted):
        ramp.elements.new(1.0)
    # A new element is sorted in; positions that are set later stay in the order of the list.
    for index, (element, values) in enumerate(zip(ramp.elements, wanted, strict=True)):
        where = f"{place}.elements[{index}]"
        _with_keys(values, {"position", "color"}, where)
        for name in ("position", "color"):
            set_value(element, name, values[name], f"{where}.{name}")


def _build_mapping(mapping, entry, place):
    for name in MAPPING_SETTINGS:
        set_value(mapping, name, entry[name], f"{place}.{name}")
    clip = _with_length(entry["clip"], [len(CLIP_FIELDS)], "a list of four numbers", f"{place}.clip")
    for field, value in zip(CLIP_FIELDS, WIDEST_CLIP, strict=True):
        setattr(mapping, field, value)
    for field, value in zip(CLIP_FIELDS, clip, strict=True):
        set_value(mapping, field, value, f"{place}.clip ({field})")
    count = len(mapping.curves)
    curves = _with_length(entry["curves"], [count], f"a list of {count} curves", f"{place}.curves")
    for index, (curve, points) in enumerate(zip(mapping.curves, curves, strict=True)):
        _build_points(curve, points, f"{place}.curves[{index}]")
    mapping.update()
    for index, (curve, points) in enumerate(zip(mapping.curves, curves, strict=True)):
        kept = [[*point.location, point.handle_type] for point in curve.points]
        if [_single(point) for point in kept] != [_single(point) for point in points]:
            raise InputError(
                f"{place}.curves[{index}]",
                repr(points),
                "points that Blender keeps, in rising order of their x",
                f"use what Blender would keep: {kept}",
            )


def _build_points(curve, wanted, place):
    if not isinstance(wanted, list) or len(wanted) < SMALLEST_CURVE:
        raise InputError(place, repr(wanted), f"a list of {SMALLEST_CURVE} points or more", "mend the list")
    while len(curve.points) > len(wanted):
        curve.points.remove(curve.points[-1])
    while len(curve.points) < len(wanted):
        curve.points.new(1.0, 1.0)
    for index, (point, values) in enumerate(zip(curve.points, wanted, strict=True)):
        where = f"{place}[{index}]"
        *location, handle_type = _with_length(values, [3], "[x, y, handle type]", where)
        set_value(point, "location", location, where)
        set_value(point, "handle_type", handle_type, where)
        # A selected point outside of the clip rectangle would be moved into it.
        point.select = False


def _single(point):
    *location, handle_type = point
    return [*(np.float32(value) for value in location), handle_type]
