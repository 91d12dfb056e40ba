"""Reads the volumes of a scene: every object that a render shows with a volume material, instances included.

What an object is, is asked of Blender while it renders: a depsgraph for rendering has modifiers at their
render levels, instances of collections, geometry nodes and particles, and nothing that is hidden in renders.
"""

import hashlib
from collections import Counter
from pathlib import Path

import bpy
import numpy as np

import volume_grid
from graph_reader import Reach, missing_reason, unique_name, volume_output
from preparation import candidates, listed
from protocol import InputError
from scene_io import matrix_rows, shortest, shortest_list

# Of volumes. Left out of the file where they are just that.
OBJECT_INFO_DEFAULTS = {"color": [1.0, 1.0, 1.0, 1.0], "pass_index": 0, "material_pass_index": 0}
# Blender turns them into meshes, which the depsgraph lists as instances of themselves.
BECOME_MESHES = ("CURVE", "FONT", "SURFACE", "META")
# What an image without them looks like is known without saying.
NOT_SEEN = ("CAMERA", "LIGHT", "EMPTY", "ARMATURE", "LATTICE", "SPEAKER", "LIGHT_PROBE")
# Rays that meet a volume. Diffuse, glossy and transmitted rays begin at surfaces, of which there are none.
RAY_VISIBILITY = {
    "visible_camera": "camera",
    "visible_volume_scatter": "volume scatter",
    "visible_shadow": "shadow",
}
# A volume's density, in a scene file and in Blender's own materials.
DENSITY = "density"
CANDIDATES_SHOWN = 8
# Bytes; Blender keeps 255.
NAME_LIMIT = 200
# Numbers of all outlines together: a scene file of half a gigabyte.
MOST_NUMBERS = 1 << 25


class Volume:
    """A volume before it is written: its entry but for the graph, its material, its object, and whether its
    mesh has smooth and flat faces."""

    def __init__(self, entry, material, item, is_instance, mixed_shading):
        self.entry = entry
        self.material = material
        self.object = item
        self.is_instance = is_instance
        self.mixed_shading = mixed_shading


class VolumeReader:
    """Collects the volumes of a depsgraph for rendering and what has to be reported of everything else.

    `faults` gets what cannot be read. `stand_ins` are what the file is read with in place of what it lacks.
    """

    def __init__(self, depsgraph, object_names, messages, faults, folder, stand_ins):
        self._depsgraph = depsgraph
        self._names = object_names
        self._messages = messages
        self._faults = faults
        self._folder = folder
        self._stand_ins = stand_ins
        # Why an object that renders shows no volume, by object.
        self._notes = {}
        # Volumes of density 0.
        self._empty = []
        self._taken = set()
        self._shapes = {}
        self._numbers = 0
        # Class of what is left out: names, in order.
        self._left_out = {}
        # Every name that --object may give.
        self._known = {}
        self.volumes = []
        # Files that belong beside the scene file: {name: path}.
        self.files = {}

    def read(self):
        """Read all; what cannot be read is a fault, and so is a scene without a volume."""
        before = len(self._faults.found)
        for instance in self._depsgraph.object_instances:
            with self._faults.noted():
                self._read_instance(instance)
        if not self.volumes:
            self.volumes = self._empty
        with self._faults.noted():
            self._check_names()
        if not self.volumes and len(self._faults.found) == before and not self._has_world_volume():
            self._faults.note(self._nothing_found())
        self._report_what_is_left_out()
        self.volumes.sort(key=lambda volume: volume.entry["object"])
        return self.volumes

    def _has_world_volume(self):
        """Whether the world has a volume: its reader speaks of it."""
        world = self._depsgraph.view_layer_eval.world_override or self._depsgraph.scene_eval.world
        output = (
            None if world is None or world.node_tree is None else world.node_tree.get_output_node("CYCLES")
        )
        return output is not None and output.inputs["Volume"].is_linked

    def _nothing_found(self):
        """The error where no volume renders, with what could be one."""
        known = candidates(self._depsgraph.scene, self._stand_ins, self._notes)
        found = "no volume that renders"
        if known:
            found += f"; the file has {'; '.join(known[:CANDIDATES_SHOWN])}"
            if len(known) > CANDIDATES_SHOWN:
                found += f"; and {len(known) - CANDIDATES_SHOWN} more"
        else:
            found += ", and no material whose Volume is linked"
        remedy = (
            "show a material on a cube (--material NAME) or what is hidden (--include-hidden); or link a "
            "volume shader to the Volume of a Material Output in Blender"
        )
        if any("missing" in note for note in self._notes.values()):
            remedy = f"correct the path of what is missing; or {remedy}"
        return InputError(
            f'scene "{bpy.context.scene.name}"',
            found,
            "a mesh with a volume material or a Volume object with a file, visible in renders",
            remedy,
        )

    def _read_instance(self, instance):
        item = instance.object
        if item.type in NOT_SEEN:
            collection = item.instance_collection if item.instance_type == "COLLECTION" else None
            for missing, what in (
                (item.original, "object"),
                (collection and collection.original, "collection"),
            ):
                if missing is not None and missing.is_missing:
                    self._report_missing(missing, what, "Blender renders nothing in its place")
            return
        # An instancer may itself not be shown.
        if item.type in BECOME_MESHES or not instance.show_self:
            return
        # A modifier of geometry nodes shows its instances as instances of its own object.
        is_itself = instance.is_instance and _is_part_of(instance)
        is_instance = instance.is_instance and not is_itself
        name = self._name(instance, is_instance)
        place = f'object "{name}"'
        known = self._known.setdefault(name, {name})
        known.add(item.original.name)
        if is_instance:
            known.add(instance.parent.original.name)
        materials = _materials(item, self._depsgraph.view_layer_eval)
        for material in materials:
            if material is not None and material.original.is_missing:
                self._report_missing(
                    material.original, "material", "its faces have a surface of one colour, and no volume"
                )
        if item.original in self._stand_ins.domains:
            if any(volume_output(material) is not None for material in materials):
                self._empty_domain(instance, item, name, is_instance, place)
            return
        self._messages.activity(f'reading object "{name}"')
        if item.type == "VOLUME":
            found = next((entry for entry in materials if volume_output(entry) is not None), None)
            if all(material is None for material in materials):
                found = self._stand_ins.default_material
            shape = None
        else:
            found, shape = self._mesh_volume(instance, item, materials, place)
        if found is None:
            self._note_left_out(item, materials, name)
            return
        if self._names is not None and not self._known[name] & set(self._names):
            self._left_out.setdefault("volumes that were not asked for", []).append(name)
            return
        visibility = self._visibility(instance, is_instance, place)
        if visibility == 0:
            self._left_out.setdefault("volumes that no ray sees", []).append(name)
            return
        if item.type == "VOLUME":
            outline = self._grid_outline(item, found, place)
            if outline is None:
                return
        else:
            outline = _mesh_outline(item, shape, place)
            self._count(outline["shape"], place)
        self.volumes.append(self._volume(instance, item, found, name, is_instance, outline, shape, place))

    def _volume(self, instance, item, material, name, is_instance, outline, shape, place):
        """The Volume of an instance with its outline; `shape` is what `_triangles` gave, None for a grid."""
        entry = {
            "object": self._own(name),
            "matrix_world": matrix_rows(instance.matrix_world, f"{place}, matrix_world"),
            **outline,
            "material": unique_name(material.original),
            "volume_step_rate": shortest(material.cycles.volume_step_rate, place),
            **_read_object_info(item, material, place),
        }
        return Volume(entry, material, item.original, is_instance, shape is not None and shape[-1])

    def _empty_domain(self, instance, item, name, is_instance, place):
        """A fluid domain, as Blender renders it without the cache of its simulation: a volume of density 0.
        It is a volume of the scene where there is no other, and else left out."""
        shape = _triangles(item, place)
        kind = self._stand_ins.domains[item.original]
        self._left_out.setdefault(f"fluid domains ({kind})", []).append(name)
        if len(shape[1]):
            outline = _mesh_outline(item, shape, place)
            self._empty.append(
                self._volume(
                    instance, item, self._stand_ins.empty_material, name, is_instance, outline, shape, place
                )
            )

    def _report_missing(self, item, what, effect):
        """Report a linked data-block that is gone, once."""
        if item not in self._notes:
            self._notes[item] = "missing in its library"
            found, _, remedy = missing_reason(item)
            self._messages.warning(f'{what} "{item.name}"', f"found {found}: {effect}; {remedy}")

    def _count(self, shape, place):
        """Refuse what would make a scene file that nobody can handle."""
        self._numbers += 3 * (len(shape.get("vertices", ())) + len(shape.get("triangles", ())))
        if self._numbers > MOST_NUMBERS:
            raise InputError(
                f"{place}, the volume number {len(self.volumes) + 1}",
                f"more than {MOST_NUMBERS} numbers in the meshes of all volumes",
                "at most as many: a scene file holds the mesh of each instance",
                "take simpler meshes (a Decimate modifier, cubes), or name volumes that matter (--object)",
            )

    def _name(self, instance, is_instance):
        """A name of its own for an object or instance, which does not depend on the others' order."""
        name = unique_name(instance.object.original)
        if is_instance:
            numbers = [str(number) for number in instance.persistent_id if number != 2**31 - 1]
            name = f"{unique_name(instance.parent.original)}/{name}/{'.'.join(reversed(numbers))}"
        if len(name.encode()) > NAME_LIMIT:
            name = f"{name[: NAME_LIMIT // 8]} {hashlib.sha256(name.encode()).hexdigest()[:16]}"
        return name

    def _own(self, name):
        """The name, or with a number where an object and what its nodes made are both volumes."""
        own, number = name, 2
        while name in self._taken:
            name, number = f"{own} {number}", number + 1
        self._taken.add(name)
        return name

    def _mesh_volume(self, instance, item, materials, place):
        """The volume material of a mesh, with vertices and triangles; None where it has none."""
        if not any(volume_output(material) is not None for material in materials):
            return None, None
        key = item.data.as_pointer() if item.data is not None else 0
        key = (item.original.as_pointer(), key)
        if key not in self._shapes:
            self._shapes[key] = _triangles(item, place)
        shape = self._shapes[key]
        _, triangles, indices, _, _ = shape
        used = [materials[index] for index in np.unique(np.minimum(indices, len(materials) - 1))]
        volumes = {material.original for material in used if volume_output(material) is not None}
        if len(triangles) == 0 and len(materials) == 1:
            if instance.object.original.instance_type != "NONE" or _has_instances(item):
                return None, None
            self._notes[item.original] = "which has no faces"
            self._left_out.setdefault("volumes without faces", []).append(item.name)
            return None, None
        if not volumes:
            return None, None
        without = [material for material in used if volume_output(material) is None]
        if len(volumes) > 1 or without:
            names = " and ".join(f'"{material.name}"' for material in sorted(volumes, key=lambda m: m.name))
            found = f"faces of the volume materials {names}"
            if without:
                names_without = ", ".join(
                    f'"{material.name}"' if material is not None else "no material" for material in without
                )
                found = f"faces of {names} and faces of {names_without}, which has no volume"
            raise InputError(
                f"{place} ({item.type})",
                found,
                "one volume material on all faces: Cycles fills the mesh with that of the face through "
                "which a ray enters, and faces without a volume begin and end none",
                "give all faces one material, or make objects of the parts (in Blender: P, By Material)",
            )
        return next(material for material in used if volume_output(material) is not None), shape

    def _visibility(self, instance, is_instance, place):
        """How many kinds of rays see a volume: all or none."""
        carriers = [instance.object] + ([instance.parent] if is_instance else [])
        seen = {setting: all(getattr(carrier, setting) for carrier in carriers) for setting in RAY_VISIBILITY}
        layer = self._depsgraph.view_layer
        if any(carrier.original.indirect_only_get(view_layer=layer) for carrier in carriers):
            seen["visible_camera"] = False
        if any(carrier.is_shadow_catcher for carrier in carriers):
            raise InputError(
                f"{place}, is_shadow_catcher",
                "on",
                "off: what catches shadows is no part of the picture",
                "switch Shadow Catcher off (Object properties, Visibility)",
            )
        if any(seen.values()) and not all(seen.values()):
            hidden = [word for setting, word in RAY_VISIBILITY.items() if not seen[setting]]
            raise InputError(
                f"{place}, ray visibility",
                f"hidden from rays of {', '.join(hidden)}",
                "a volume that all rays meet, or none: light transport knows one medium",
                "switch the ray visibility on (Object properties, Visibility; Indirect Only of a "
                "collection hides from the camera), or hide the object in renders",
            )
        return sum(seen.values())

    def _grid_outline(self, item, material, place):
        """Shape, bounds and texture space of a Volume object with an OpenVDB file; None where its file is
        gone, which is reported, or where it has faults."""
        data = item.data
        render = data.render
        data.grids.load()
        if data.grids.error_message:
            path = data.grids.frame_filepath or data.filepath
            self._notes[item.original] = f"whose file {path} is missing or damaged"
            self._messages.warning(
                f"{place}, {path}",
                f"{data.grids.error_message.strip()}: left out, as in Blender; correct "
                "the path (Object data, OpenVDB File), or for a sequence give a frame that it has (--frame)",
            )
            return None
        before = len(self._faults.found)
        with self._faults.noted():
            _require_object_space(render, place)
        if material.cycles.volume_interpolation != "LINEAR":
            self._messages.warning(
                f'{place}, material "{material.name}", volume_interpolation',
                f"{material.cycles.volume_interpolation} is read as LINEAR: finer detail is less smooth",
            )
        names = [grid.name for grid in data.grids]
        if DENSITY not in names:
            self._faults.note(
                InputError(
                    f"{place}, grids",
                    ", ".join(names) or "none",
                    f'a grid "{DENSITY}", which the material reads by an Attribute node (output Fac)',
                    f"write the file with a grid of the name {DENSITY}",
                )
            )
        for fault in _unknown_grids(material, names):
            self._faults.note(fault)
        if len(self._faults.found) > before:
            return None
        others = [name for name in names if name != DENSITY]
        if others:
            self._messages.warning(
                f"{place}, grids", f"left out: {', '.join(others)}; a scene file has one grid, {DENSITY}"
            )
        source = self._grid_file(item, place)
        found = volume_grid.read(source, DENSITY)
        first, size = found["first"], found["values"].shape
        rows = np.asarray(found["to_object"])
        corners = [
            rows[:3, :3] @ [first[axis] + (size[axis] if bit >> axis & 1 else -1) for axis in range(3)]
            + rows[:3, 3]
            for bit in range(8)
        ]
        low, high = np.min(corners, axis=0), np.max(corners, axis=0)
        clipped = np.count_nonzero((found["values"] > 0.0) & (found["values"] <= render.clipping))
        if clipped:
            self._messages.warning(
                f"{place}, clipping",
                f"{clipped} of {found['values'].size} voxels lie above 0 and at most at "
                f"{render.clipping:g}: Blender ends the medium at them, a scene file keeps their values",
            )
        content = Path(source).read_bytes()
        digest = hashlib.sha256(content).hexdigest()
        stem = "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in Path(source).stem)
        target = f"{stem}.vdb"
        if target in self.files and Path(self.files[target]).read_bytes() != content:
            target = f"{stem}-{digest[:12]}.vdb"
        self.files[target] = str(source)
        bounds = {"min": shortest_list(low, place), "max": shortest_list(high, place)}
        return {
            "shape": {"type": "grid", "file": target, "sha256": digest},
            "bounds": bounds,
            "texture_space": {
                "location": shortest_list((low + high) / 2, place),
                "size": shortest_list((high - low) / 2, place),
            },
        }

    def _grid_file(self, item, place):
        """The file of a Volume object as it is shown: the user's own, or one that is written of what
        modifiers made."""
        data = item.data
        original = item.original.data
        # Nodes make grids of meshes, too.
        is_file = isinstance(original, bpy.types.Volume) and original.packed_file is None
        if is_file and not any(modifier.show_render for modifier in item.modifiers):
            path = Path(bpy.path.abspath(data.grids.frame_filepath, library=original.library))
            if path.is_file():
                return path
        if self._folder is None:
            raise InputError(
                place, "grids that no file has", "a folder to write them to", "give the request `folder`"
            )
        path = Path(self._folder) / f"{hashlib.sha256(item.name.encode()).hexdigest()[:12]}.vdb"
        if not data.grids.save(filepath=str(path)):
            raise InputError(
                place, "grids that cannot be written", "an OpenVDB file", "export them from Blender"
            )
        return path

    def _note_left_out(self, item, materials, name):
        kind = "surfaces"
        if item.type not in ("MESH", "VOLUME"):
            kind = f"objects of type {item.type}"
        elif item.type == "VOLUME":
            kind = "Volume objects without a volume material"
        elif any(_emits(material) for material in materials):
            kind = "surfaces that shine"
        if item.type == "MESH" and item.data is not None and len(item.data.polygons) == 0:
            return
        self._left_out.setdefault(kind, []).append(name)

    def _check_names(self):
        found = {volume.entry["object"] for volume in self.volumes}
        for name in self._names or ():
            named = {own for own, known in self._known.items() if name in known}
            named |= {other for other in found if other.rsplit(" ", 1)[0] in named}
            if not named:
                names = ", ".join(f'"{item}"' for item in sorted(self._known)) or "no object at all"
                raise InputError(
                    f'object "{name}"', "no such object visible in render", names, "name one of these objects"
                )
            if not named & found:
                raise InputError(
                    f'object "{name}"',
                    "0 materials with a linked Volume, or no ray that sees it",
                    "an object with exactly one, which rays see",
                    "give the object one material with a volume shader",
                )

    def _report_what_is_left_out(self):
        for kind, names in self._left_out.items():
            self._messages.warning(f"{kind}: {listed(names)}", f"left out: {_effect(kind)}")


def _require_object_space(render, place):
    if render.space != "OBJECT":
        raise InputError(
            f"{place}, render space",
            render.space,
            "OBJECT: the unit in which a scene file gives the density",
            "set Space to Object (Object data, Render) and scale the density in the material",
        )


def _unknown_grids(material, names):
    """An InputError for each attribute of a Principled Volume that reads another grid than the density."""
    for node in Reach(volume_output(material).inputs["Volume"]).nodes.values():
        if node.bl_idname != "ShaderNodeVolumePrincipled" or node.mute:
            continue
        heat = node.inputs["Blackbody Intensity"]
        glows = heat.is_linked or heat.default_value > 0.0
        found = {
            "Density Attribute": node.inputs["Density Attribute"].default_value != DENSITY,
            "Color Attribute": node.inputs["Color Attribute"].default_value in names,
            "Temperature Attribute": glows and node.inputs["Temperature Attribute"].default_value in names,
        }
        for name, is_refused in found.items():
            if is_refused:
                yield InputError(
                    f'material "{material.name}", node "{node.name}", {name}',
                    f'"{node.inputs[name].default_value}"',
                    f'the one grid of a scene file, "{DENSITY}" of Density Attribute',
                    "clear the attribute, or set Blackbody Intensity to 0; for the density, name that grid",
                )


def _effect(kind):
    """What it does to the picture that a kind of object is left out."""
    if kind == "volumes that were not asked for":
        return "they are not in the picture and cast no shadow"
    if kind in ("volumes that no ray sees", "volumes without faces"):
        return "the picture stays the same"
    if kind.startswith("fluid domains"):
        return (
            "what they show is in the cache of the simulation, which is not read, so they are empty here; "
            "bake a gas with the cache format OpenVDB and show a file of the cache by a Volume object (Add, "
            "Volume, Import OpenVDB)"
        )
    effect = "a scene has volumes and nothing else; they cast no shadow, hide nothing and reflect no light"
    return effect + (", and their light is missing" if kind == "surfaces that shine" else "")


def _is_part_of(instance):
    """Whether an instance is what its own object evaluates to: a curve or a text as a mesh."""
    if instance.parent is None or instance.object.original != instance.parent.original:
        return False
    numbers = [number for number in instance.persistent_id if number != 2**31 - 1]
    return len(numbers) == 1


def _has_instances(item):
    return any(modifier.type in ("NODES", "PARTICLE_SYSTEM") for modifier in item.modifiers)


def _materials(item, view_layer):
    """The material of each slot as a render uses it; None where a slot is empty."""
    if view_layer.material_override is not None:
        return [view_layer.material_override]
    return [slot.material for slot in item.material_slots]


def _emits(material):
    """Whether a material's surface holds an emission that is not 0 by its stored values."""
    if material is None or material.node_tree is None:
        return False
    for node in material.node_tree.nodes:
        if node.bl_idname == "ShaderNodeEmission" and node.outputs[0].is_linked:
            strength = node.inputs["Strength"]
        elif node.bl_idname == "ShaderNodeBsdfPrincipled":
            strength = node.inputs["Emission Strength"]
        else:
            continue
        if strength.is_linked or strength.default_value > 0.0:
            return True
    return False


def _triangles(item, place):
    """Vertices f32 [n, 3], triangles int32 [m, 3], the material index of each triangle, the texture space,
    and whether some faces are shaded smooth and others flat, of an evaluated object."""
    mesh = item.to_mesh()
    mesh.calc_loop_triangles()
    vertices = np.empty((len(mesh.vertices), 3), np.float32)
    mesh.vertices.foreach_get("co", vertices.ravel())
    count = len(mesh.loop_triangles)
    triangles = np.empty((count, 3), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles.ravel())
    indices = np.empty(count, np.int32)
    mesh.loop_triangles.foreach_get("material_index", indices)
    # Of the mesh before modifiers: Generated does not follow them.
    own = item.original.data
    is_own = isinstance(own, bpy.types.Mesh) and item.data is not None and item.data.name == own.name
    source = own if is_own else mesh
    space = [shortest_list(source.texspace_location, place), shortest_list(source.texspace_size, place)]
    smooth = np.empty(len(mesh.polygons), bool)
    mesh.polygons.foreach_get("use_smooth", smooth)
    item.to_mesh_clear()
    return vertices, triangles, indices, space, len(np.unique(smooth)) > 1


def _mesh_outline(item, shape, place):
    """Shape, bounds and texture space of a mesh."""
    vertices, triangles, _, (location, size), _ = shape
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    if is_box(vertices, triangles):
        entry = {"type": "box"}
    else:
        entry = {
            "type": "mesh",
            "vertices": [shortest_list(vertex, f"{place}, vertex") for vertex in vertices],
            "triangles": triangles.tolist(),
        }
    return {
        "shape": entry,
        "bounds": {"min": shortest_list(low, place), "max": shortest_list(high, place)},
        "texture_space": {"location": location, "size": size},
    }


def _read_object_info(item, material, place):
    """What the Object Info node shows of the object and its material, where it is not Blender's default."""
    found = {
        "color": shortest_list(item.color, f"{place}, color"),
        "pass_index": item.pass_index,
        "material_pass_index": material.pass_index,
    }
    return {key: value for key, value in found.items() if value != OBJECT_INFO_DEFAULTS[key]}


def warn_of_outline(volume, messages):
    """Say where a mesh is not closed, inside out or shaded in two ways, and what becomes of it."""
    entry = volume.entry
    place = f'object "{entry["object"]}", mesh'
    if volume.mixed_shading:
        messages.warning(
            place,
            "some faces are shaded smooth and others flat: in Cycles a shadow ray leaves the medium only "
            "through a face of the kind through which the ray before it entered, so that light is lost and "
            "the picture darker; here every face ends the medium. For the same picture in Blender shade all "
            "faces alike (texts: Object, Convert, Mesh; then Shade Flat; docs/mesh-outlines.md)",
        )
    if entry["shape"]["type"] != "mesh":
        return
    vertices = np.asarray(entry["shape"]["vertices"], np.float64)
    triangles = np.asarray(entry["shape"]["triangles"])
    # Vertices at the same place count as one: parts may touch there.
    _, together = np.unique(vertices, axis=0, return_inverse=True)
    welded = together.reshape(-1)[triangles]
    edges = Counter()
    for first, second in ((0, 1), (1, 2), (2, 0)):
        edges.update(zip(welded[:, first].tolist(), welded[:, second].tolist(), strict=True))
    open_edges = sum(max(count - edges.get((b, a), 0), 0) for (a, b), count in edges.items() if a != b)
    if open_edges:
        messages.warning(
            place,
            f"{open_edges} edges where it is not closed: Cycles begins the medium where a ray meets a front "
            "and ends it where it meets a back, so a ray through a hole misses one of them, and there is "
            "nothing, or a medium up to the next face; close the mesh (docs/mesh-outlines.md)",
        )
        return
    corners = vertices[triangles]
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    if volume < 0.0:
        messages.warning(
            place,
            "its faces look inward: Cycles shows no medium inside of it; recalculate its normals (in "
            "Blender: Edit Mode, Shift N)",
        )


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
