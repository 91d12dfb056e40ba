"""Finds what of a scene changes with time, or was not computed, so that no moment is baked in silence."""

import bpy

# Members of a data-block's animation that are shown of one kind.
SHOWN = 4


def warn_of_animation(items, frame, messages):
    """Warn of every data-block of `items` [(label, evaluated ID)] that keyframes or drivers move.

    `frame` is the one that the scene is read at. The drivers of what a depsgraph evaluated know whether they
    were computed.
    """
    seen = set()
    for label, item in _with_parts(items):
        if item is None or item.as_pointer() in seen:
            continue
        seen.add(item.as_pointer())
        data = getattr(item, "animation_data", None)
        if data is None:
            continue
        stopped = [driver for driver in data.drivers if not driver.mute and not _is_computed(driver)]
        for driver in stopped:
            messages.warning(
                f"{label}, {_path(driver)}",
                f"the driver {_expression(driver)!r} was not computed, because Python in files never runs "
                "here; the stored value stands: compute it in Blender and replace the driver by its value "
                "(Delete Driver)",
            )
        moving = [_path(curve) for curve in _curves(data) if _moves(curve)]
        moving += [
            f"{_path(driver)} (driver {_expression(driver)})"
            for driver in data.drivers
            if not driver.mute and driver not in stopped
        ]
        if moving:
            shown = ", ".join(moving[:SHOWN])
            more = f" and {len(moving) - SHOWN} more" if len(moving) > SHOWN else ""
            messages.warning(
                label, f"animated: {shown}{more}; the scene is what they are at frame {frame} (--frame)"
            )


def _with_parts(items):
    """Every data-block with those that decide what it is: parents, targets of constraints, node groups."""
    pending, seen = list(items), set()
    while pending:
        label, item = pending.pop(0)
        if item is None or item.as_pointer() in seen:
            continue
        seen.add(item.as_pointer())
        yield label, item
        if isinstance(item, bpy.types.Object):
            pending.append((f"{label}, data", item.data))
            if item.parent is not None:
                pending.append((f'object "{item.parent.name}", parent', item.parent))
            for constraint in item.constraints:
                target = getattr(constraint, "target", None)
                if target is not None and not constraint.mute:
                    pending.append((f'object "{target.name}", target of a constraint', target))
            for modifier in item.modifiers:
                if modifier.type == "NODES" and modifier.show_render:
                    pending.append((f'{label}, modifier "{modifier.name}"', modifier.node_group))
        if isinstance(item, bpy.types.Mesh) and item.shape_keys is not None:
            pending.append((f"{label}, shape keys", item.shape_keys))
        tree = getattr(item, "node_tree", None)
        if tree is not None:
            pending.append((label, tree))
        if isinstance(item, bpy.types.NodeTree):
            pending += [
                (f'group "{node.node_tree.name}"', node.node_tree)
                for node in item.nodes
                if getattr(node, "node_tree", None) is not None
            ]


def moving_modifiers(item):
    """Names of the modifiers of an object that change with time by themselves."""
    names = []
    for modifier in item.modifiers:
        if not modifier.show_render:
            continue
        moves = modifier.type in (
            "BUILD",
            "CLOTH",
            "DYNAMIC_PAINT",
            "EXPLODE",
            "FLUID",
            "MESH_CACHE",
            "MESH_SEQUENCE_CACHE",
            "OCEAN",
            "PARTICLE_SYSTEM",
            "SOFT_BODY",
            "WAVE",
        )
        if modifier.type == "NODES" and modifier.node_group is not None:
            moves = _reads_time(modifier.node_group, set())
        if moves:
            names.append(modifier.name)
    return names


def _reads_time(tree, seen):
    if tree.as_pointer() in seen:
        return False
    seen.add(tree.as_pointer())
    for node in tree.nodes:
        if node.bl_idname in ("GeometryNodeInputSceneTime", "GeometryNodeSimulationInput"):
            return True
        inner = getattr(node, "node_tree", None)
        if inner is not None and _reads_time(inner, seen):
            return True
    return False


def _curves(data):
    """The F-curves that act on the owner of some animation data: its action's and those of its NLA strips."""
    found = _action_curves(data.action, data.action_slot) if data.action is not None else []
    for track in data.nla_tracks:
        if track.mute:
            continue
        for strip in track.strips:
            if strip.action is not None and not strip.mute:
                found += _action_curves(strip.action, strip.action_slot)
    return found


def _action_curves(action, slot):
    curves = []
    for layer in action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(slot) if slot is not None else None
            if bag is not None:
                curves += list(bag.fcurves)
    return curves


def _moves(curve):
    if curve.mute:
        return False
    if any(not modifier.mute for modifier in curve.modifiers):
        return True
    values = [point.co[1] for point in curve.keyframe_points]
    values += [
        handle[1] for point in curve.keyframe_points for handle in (point.handle_left, point.handle_right)
    ]
    return len(curve.keyframe_points) > 1 and max(values) > min(values)


def _is_computed(curve):
    """Whether Blender computed a driver. Where files may run no Python, it computes simple expressions
    itself, others as long as they name nothing but harmless functions, and marks the rest."""
    return curve.is_valid and curve.driver.is_valid


def _expression(curve):
    driver = curve.driver
    return driver.expression if driver.type == "SCRIPTED" else driver.type.lower()


def _path(curve):
    values = bpy.types.Object.bl_rna.properties.get(curve.data_path)
    is_array = values is not None and getattr(values, "is_array", False)
    return f"{curve.data_path}[{curve.array_index}]" if is_array or curve.array_index else curve.data_path
