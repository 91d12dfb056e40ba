"""Reads the world: a constant, a picture, a node graph, or a picture that Cycles makes of its nodes.

A world whose nodes the caller evaluates is read as a graph. Any other one is rendered by Cycles itself,
alone, into an equirectangular picture of scene-linear f32: one ray through the centre of each pixel, which
has no noise. What comes out the same in every direction is a constant. Else the picture is made larger until
interpolating it differs little from the world's own values in directions between its pixels.
"""

import hashlib
import math
from pathlib import Path

import bpy
import numpy as np

from graph_reader import (
    LAYOUT_NODES,
    Inexpressible,
    Reach,
    live_links,
    missing_reason,
    read_world_graph,
    require_identity,
)
from protocol import InputError
from scene_io import shortest, shortest_list

# Widths of the baked picture, in pixels; its height is half of that.
WIDTHS = (512, 1024, 2048, 4096)
# Mean difference between the interpolated picture and the world, relative to the world's mean, at which a
# picture is fine enough: below what 8 bits of a display show.
CLOSE_ENOUGH = 1e-3
# Directions of the comparison: as pixels of a picture whose centres do not fall on those of a baked one.
COMPARED = (509, 251)
# Pixels along a side of the picture in which a sun's disc is measured, and its width in discs.
DISC_PIXELS = 256
DISC_WIDTH = 1.5
LOCATING_WIDTH = 2048
SKIES_WITH_DISC = ("SINGLE_SCATTERING", "MULTIPLE_SCATTERING")
# Nodes whose value depends on the ray or on the camera, with what they do in a world.
REFUSED_NODES = {
    "ShaderNodeLightPath": "shows the camera another world than the one that lights the volume",
    "ShaderNodeCameraData": "depends on the camera",
    "ShaderNodeScript": "runs a program that the file brings along",
    "ShaderNodeTexIES": "holds a lamp's file",
}
REFUSED_COORDINATES = ("Window", "Camera")
PICTURE_NODES = ("ShaderNodeTexEnvironment", "ShaderNodeTexImage")
# Nodes that the reader of graphs resolves.
STRUCTURE_NODES = {
    *LAYOUT_NODES,
    "NodeGroupOutput",
    "NodeReroute",
    "ShaderNodeGroup",
    "ShaderNodeOutputWorld",
}
# What stands in for a missing picture.
MAGENTA = "Blender and Cycles show magenta (1, 0, 1) in its place"
GENERATED = "Blender and Cycles show a picture that Blender generates in its place"


class World:
    """What was read: the entry, lights that stand for parts of it, and files that belong beside the scene."""

    def __init__(self, entry, lights=(), files=None):
        self.entry = entry
        self.lights = list(lights)
        self.files = files or {}


def read_world(world, messages, folder=None, nodes=None, only_check=False):
    """Read a world. `folder` is where a baked picture is written; without one, such a world is rejected.
    `nodes` {node type: None or the outputs} are what the caller evaluates in a world; without it nothing.
    `only_check` looks for faults and returns None where the world would have to be rendered."""
    if world is None:
        return World({"color": [0.0, 0.0, 0.0], "strength": 1.0})
    place = f'world "{world.name}"'
    if world.is_missing:
        # 5.0.1 renders its stand-in's colour, 5.3.0 black: what the stand-in has.
        found, _, remedy = missing_reason(world)
        messages.warning(place, f"found {found}: Blender renders its own stand-in; {remedy}")
    tree = world.node_tree
    if tree is None:
        return World({"color": shortest_list(world.color, place), "strength": 1.0})
    output = tree.get_output_node("CYCLES")
    links = live_links(tree)
    if output is not None and (output.name, "Volume") in links:
        raise InputError(
            f"{place}, Volume",
            f'node "{links[output.name, "Volume"].from_node.name}"',
            "no link: a medium without an end is none of a scene file",
            "remove the link, and put a large cube with the same volume around the scene instead",
        )
    if output is None or (output.name, "Surface") not in links:
        return World({"color": [0.0, 0.0, 0.0], "strength": 1.0})
    _require_seen_alike(world, place)
    plain = _plain_background(links[output.name, "Surface"].from_node, links, place, messages)
    if plain is not None:
        return plain
    reach = Reach(output.inputs["Surface"])
    _require_bakeable(reach, place)
    _report_pictures(reach, place, messages)
    # What is the same in every direction is found to be a constant below.
    if nodes is not None and any(_may_vary(node) for node in reach.nodes.values()):
        reason = _reason_to_bake(reach, nodes)
        if reason is None:
            try:
                graph = read_world_graph(world, messages.warning)
                return World({"color": [1.0] * 3, "strength": 1.0, "graph": graph})
            except InputError as problem:
                reason = str(problem)
        messages.warning(place, f"is not evaluated as nodes but as a picture of them: {reason}")
    if only_check:
        return None
    if folder is None:
        raise InputError(
            place, "nodes that have to be rendered", "a folder for the picture", "give the request `folder`"
        )
    return _bake(world, reach, place, messages, Path(folder))


def _require_seen_alike(world, place):
    """Refuse a world that some rays do not see. Only those of cameras and volumes are looked at."""
    seen = world.cycles_visibility
    for name, what in (("camera", "the camera"), ("scatter", "rays from volumes")):
        if not getattr(seen, name):
            raise InputError(
                f"{place}, ray visibility",
                f"{what} cannot see it",
                "one world for all rays",
                "switch the ray visibility on (World properties); a transparent film hides the world from "
                "the camera",
            )


def _plain_background(background, links, place, messages):
    """The world of one Background with a colour of its own or a picture as it is; None for any other."""
    if background.bl_idname != "ShaderNodeBackground" or background.mute:
        return None
    if (background.name, "Strength") in links:
        return None
    strength = shortest(background.inputs["Strength"].default_value, place)
    link = links.get((background.name, "Color"))
    if link is None:
        color = shortest_list(background.inputs["Color"].default_value[:3], place)
        return World({"color": color, "strength": strength})
    node = link.from_node
    if node.bl_idname in PICTURE_NODES and not node.mute and link.from_socket.identifier == "Color":
        missing = _missing_picture(node)
        # Blender generates a picture in place of a data-block that is missing from its library.
        if missing is not None and not (node.image and node.image.is_missing):
            _report_picture(node, missing, place, messages)
            return World({"color": [1.0, 0.0, 1.0], "strength": strength})
    if node.bl_idname != "ShaderNodeTexEnvironment" or node.mute:
        return None
    path = _picture_as_it_is(node, links)
    if path is None:
        return None
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    entry = {
        "color": [1.0, 1.0, 1.0],
        "strength": strength,
        "image": {"file": path.name, "sha256": digest},
    }
    return World(entry, files={path.name: str(path)})


def _picture_as_it_is(node, links):
    """The file of an Environment Texture that a scene file can name: a linear float EXR with the default
    mapping. None for any other."""
    image = node.image
    if (node.name, "Vector") in links or image is None:
        return None
    try:
        require_identity(node.texture_mapping)
    except Inexpressible:
        return None
    is_plain = (
        (node.projection, node.interpolation, image.source) == ("EQUIRECTANGULAR", "Linear", "FILE")
        and image.is_float
        and image.colorspace_settings.name in ("Linear Rec.709", "Non-Color")
        and image.packed_file is None
        and image.file_format == "OPEN_EXR"
    )
    path = Path(bpy.path.abspath(image.filepath, library=image.library))
    return path if is_plain and path.is_file() else None


def _require_bakeable(reach, place):
    for (tree, name), node in reach.nodes.items():
        where = f'{place}, node "{node.name}" ({node.bl_idname})'
        reason = REFUSED_NODES.get(node.bl_idname)
        if node.bl_idname == "ShaderNodeTexCoord":
            used = [which for which in REFUSED_COORDINATES if (tree, name, which) in reach.outputs]
            reason = f"gives coordinates ({', '.join(used)}) of the camera" if used else None
        if reason is not None:
            raise InputError(
                where,
                f"a node that {reason}",
                "a world that depends on the direction alone",
                "take the node out; of a Mix Shader that it drives, link the side that lights the volume",
            )


def _may_vary(node):
    """Whether a node may give different values in different directions, whatever it reads."""
    return "Tex" in node.bl_idname or node.bl_idname == "ShaderNodeNewGeometry"


def _reason_to_bake(reach, known):
    """Why the nodes that are reached are no graph for the caller, which evaluates the `known` ones; None
    where they are."""
    for (tree, name), node in reach.nodes.items():
        if node.bl_idname in STRUCTURE_NODES:
            continue
        label = f'node "{node.name}" ({node.bl_idname})'
        if node.bl_idname not in known:
            return f"{label} is none of those that are"
        if node.mute:
            continue
        outputs = known[node.bl_idname]
        read = {output for owner, other, output in reach.outputs if (owner, other) == (tree, name)}
        others = sorted(read - set(read if outputs is None else outputs))
        if others:
            return f"{label} is read at its output {', '.join(others)}"
        if node.bl_idname == "ShaderNodeTexCoord" and node.object is not None and node.object.is_missing:
            return f"the object of {label} is missing"
    return None


def _report_pictures(reach, place, messages):
    """Warn of every picture that is missing and reached. Cycles renders the world as it is."""
    for node in reach.nodes.values():
        if node.bl_idname in PICTURE_NODES and not node.mute:
            missing = _missing_picture(node)
            if missing is not None:
                _report_picture(node, missing, place, messages)


def _report_picture(node, missing, place, messages):
    shown = GENERATED if node.image and node.image.is_missing else MAGENTA
    messages.warning(
        f'{place}, node "{node.name}" ({node.bl_idname})',
        f"its picture is missing: {missing}; {shown}, and so does this scene: choose the picture again or "
        "put it back, and export again",
    )


def _missing_picture(node):
    """What is wrong with the picture of a texture node where it cannot be shown; else None."""
    image = node.image
    if image is None:
        return "none is chosen"
    if image.is_missing:
        return f"the library {image.library.filepath} does not hold it"
    if image.source == "GENERATED":
        return None
    if image.packed_file is None and not image.packed_files:
        for path in _picture_paths(node):
            if not path.is_file():
                return f"there is no file {path}"
    if image.source in ("FILE", "TILED") and 0 in image.size:
        where = "packed into the file" if image.packed_files else str(_picture_paths(node)[0])
        return f"what is {where} cannot be read as a picture"
    return None


def _picture_paths(node):
    """The files that the picture of a texture node is read from, at the frame that is read."""
    image = node.image
    if image.source == "TILED":
        names = [image.filepath.replace("<UDIM>", str(tile.number)) for tile in image.tiles]
    else:
        # Only the evaluated node knows its frame.
        tree = node.id_data.evaluated_get(bpy.context.evaluated_depsgraph_get())
        names = [image.filepath_from_user(image_user=tree.nodes[node.name].image_user)]
    return [Path(bpy.path.abspath(name, library=image.library)) for name in names]


def _bake(world, reach, place, messages, folder):
    skies = [
        node
        for node in reach.nodes.values()
        if node.bl_idname == "ShaderNodeTexSky" and node.sky_type in SKIES_WITH_DISC and node.sun_disc
    ]
    with _Panorama(world, folder) as panorama:
        lights = [_sun_of(sky, panorama, place, messages) for sky in skies]
        lights = [light for light in lights if light is not None]
        # Every sky is without its disc from here on.
        between = panorama.render(*COMPARED)
        widths = _widths(reach)
        for width in widths:
            picture = panorama.render(width, width // 2)
            if (picture == picture[0, 0]).all() and (between == picture[0, 0]).all():
                color = shortest_list(picture[0, 0], place)
                return World({"color": color, "strength": 1.0}, lights)
            mean, largest = _difference(picture, between)
            if mean <= CLOSE_ENOUGH:
                break
    if not np.isfinite(picture).all():
        raise InputError(place, "values that are NaN or infinite", "numbers", "find the node that makes them")
    content = _exr(picture, folder)
    digest = hashlib.sha256(content).hexdigest()
    name = f"world-{digest[:16]}.exr"
    (folder / name).write_bytes(content)
    kinds = sorted({node.bl_label for node in reach.nodes.values() if "Tex" in node.bl_idname})
    messages.warning(
        place,
        f"rendered by Cycles into the picture {name} of {picture.shape[1]} x {picture.shape[0]} "
        f"pixels{' (' + ', '.join(kinds) + ')' if kinds else ''}: between pixels it differs from the world "
        f"by {mean:.2g} of its mean radiance on average, and by {largest:.2g} of it at most, in "
        f"{COMPARED[0] * COMPARED[1]} directions",
    )
    image = {"file": name, "sha256": digest}
    entry = {"color": [1.0, 1.0, 1.0], "strength": 1.0, "image": image}
    return World(entry, lights, {name: str(folder / name)})


def _widths(reach):
    """The widths to try: a picture of a file keeps its own pixels where it is looked up as it is."""
    textures = [node for node in reach.nodes.values() if node.bl_idname == "ShaderNodeTexEnvironment"]
    if len(textures) == 1 and textures[0].image is not None:
        width, height = textures[0].image.size
        if 0 < width == 2 * height <= WIDTHS[-1]:
            return (width, *(other for other in WIDTHS if other > width))
    return WIDTHS


def _difference(picture, between):
    """Mean and largest difference between a picture, interpolated, and another's pixels, by solid angle and
    in units of the other's mean."""
    height, width = between.shape[:2]
    rows, columns = picture.shape[:2]
    x = (np.arange(width) + 0.5) / width * columns - 0.5
    y = (np.arange(height) + 0.5) / height * rows - 0.5
    left, low = np.floor(x).astype(int), np.floor(y).astype(int)
    across, up = (x - left)[None, :, None], (y - low)[:, None, None]
    left, right = left % columns, (left + 1) % columns
    low, high = low % rows, (low + 1) % rows
    bottom = picture[low][:, left] * (1 - across) + picture[low][:, right] * across
    top = picture[high][:, left] * (1 - across) + picture[high][:, right] * across
    difference = np.abs(bottom * (1 - up) + top * up - between)
    weights = np.cos(((np.arange(height) + 0.5) / height - 0.5) * math.pi)[:, None, None]
    weights = np.broadcast_to(weights, between.shape)
    scale = np.average(np.abs(between), weights=weights)
    if scale == 0.0:
        return 0.0, 0.0
    return np.average(difference, weights=weights) / scale, difference.max() / scale


def _exr(picture, folder):
    """The bytes of an EXR file of f32 that depend on its pixels alone."""
    import OpenImageIO as oiio

    path = folder / "world.exr"
    rows, columns = picture.shape[:2]
    spec = oiio.ImageSpec(columns, rows, 3, "float")
    spec.attribute("compression", "zip")
    # OpenImageIO would write the time of day.
    spec.attribute("DateTime", "0000:00:00 00:00:00")
    output = oiio.ImageOutput.create(str(path))
    if output is None or not output.open(str(path), spec):
        raise InputError(str(path), oiio.geterror(), "a picture that can be written", "look at the folder")
    # OpenImageIO begins at the top.
    output.write_image(np.ascontiguousarray(picture[::-1]))
    output.close()
    content = path.read_bytes()
    path.unlink()
    return content


def _sun_of(sky, panorama, place, messages):
    """Take the sun's disc out of a sky; the light that stands for it, None where the disc shows nothing."""
    rows, columns = LOCATING_WIDTH // 2, LOCATING_WIDTH
    with_disc = panorama.render(columns, rows)
    sky.sun_disc = False
    disc = with_disc - panorama.render(columns, rows)
    weights = np.abs(disc).sum(axis=2) * np.cos(((np.arange(rows) + 0.5) / rows - 0.5) * math.pi)[:, None]
    where = f'{place}, node "{sky.name}"'
    if not weights.any():
        messages.warning(where, "its sun disc shows nothing and is left out")
        return None
    direction = np.array(
        [(weights[..., None] * _directions(columns, rows)).sum(axis=(0, 1))[axis] for axis in range(3)]
    )
    direction /= np.linalg.norm(direction)
    half = DISC_WIDTH * sky.sun_size / 2.0
    found = -panorama.render_around(direction, half)
    sky.sun_disc = True
    found += panorama.render_around(direction, half)
    sky.sun_disc = False
    side = 2.0 * half / DISC_PIXELS
    latitudes = ((np.arange(DISC_PIXELS) + 0.5) / DISC_PIXELS * 2.0 - 1.0) * half
    irradiance = (found * np.cos(latitudes)[:, None, None]).sum(axis=(0, 1)) * side * side
    strength = float(irradiance.max())
    if strength <= 0.0:
        messages.warning(where, "its sun disc shows nothing and is left out")
        return None
    messages.warning(
        where,
        f"its sun disc of {math.degrees(sky.sun_size):.3g} degrees is a sun light of the same irradiance, "
        f"{strength:.4g} W/m^2, evenly bright: the camera does not see it, and it has no darker edge",
    )
    up = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
    right = np.cross(up, direction)
    right /= np.linalg.norm(right)
    axes = [right, np.cross(direction, right), direction]
    matrix = [[*shortest_list([axis[row] for axis in axes], where), 0.0] for row in range(3)]
    return {
        "name": f"Sun of {sky.name}",
        "type": "sun",
        "matrix_world": [[value + 0.0 for value in row] for row in matrix] + [[0.0, 0.0, 0.0, 1.0]],
        "color": shortest_list(irradiance / strength, where),
        "strength": shortest(strength, where),
        "exposure": 0.0,
        "angle": shortest(sky.sun_size, where),
    }


def _directions(columns, rows):
    """Unit vectors to the pixels of a panorama, from the bottom."""
    longitude = (0.5 - (np.arange(columns) + 0.5) / columns) * 2.0 * math.pi
    latitude = ((np.arange(rows) + 0.5) / rows - 0.5) * math.pi
    level = np.cos(latitude)[:, None]
    return np.stack(
        [
            level * np.cos(longitude),
            level * np.sin(longitude),
            np.broadcast_to(np.sin(latitude)[:, None], (rows, columns)),
        ],
        axis=2,
    )


class _Panorama:
    """A scene of nothing but a world and a panoramic camera, which goes again."""

    def __init__(self, world, folder):
        self._world = world
        self._path = folder / "panorama.exr"

    def __enter__(self):
        frame = bpy.context.scene.frame_current
        scene = bpy.data.scenes.new("cloudparity world")
        camera = bpy.data.cameras.new("cloudparity world")
        item = bpy.data.objects.new("cloudparity world", camera)
        scene.collection.objects.link(item)
        scene.camera = item
        scene.world = self._world
        scene.frame_set(frame)
        camera.type = "PANO"
        camera.panorama_type = "EQUIRECTANGULAR"
        render, cycles = scene.render, scene.cycles
        render.engine = "CYCLES"
        render.resolution_percentage = 100
        render.image_settings.file_format = "OPEN_EXR"
        render.image_settings.color_mode = "RGB"
        render.image_settings.color_depth = "32"
        render.image_settings.exr_codec = "ZIP"
        render.use_compositing = render.use_sequencer = False
        render.filepath = str(self._path)
        cycles.device = "CPU"
        cycles.shading_system = False
        cycles.samples, cycles.seed = 1, 0
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        # One ray through the centre of each pixel, up to a two-hundredth of it.
        cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 0.01
        self._scene, self._camera = scene, item
        return self

    def __exit__(self, *_):
        camera = self._camera.data
        bpy.data.scenes.remove(self._scene)
        bpy.data.objects.remove(self._camera)
        bpy.data.cameras.remove(camera)
        self._path.unlink(missing_ok=True)

    def render(self, columns, rows):
        """The whole world, f32 [row from the bottom, column, 3], as a scene file's picture lies."""
        camera = self._camera.data
        camera.longitude_min, camera.longitude_max = -math.pi, math.pi
        camera.latitude_min, camera.latitude_max = -math.pi / 2, math.pi / 2
        # Looks along +X, up is +Z.
        self._look([1.0, 0.0, 0.0], [0.0, 0.0, 1.0])
        return self._picture(columns, rows)

    def render_around(self, direction, half):
        """A square of twice `half` an angle around a direction."""
        camera = self._camera.data
        camera.longitude_min, camera.longitude_max = -half, half
        camera.latitude_min, camera.latitude_max = -half, half
        self._look(direction, [0.0, 0.0, 1.0] if abs(direction[2]) < 0.99 else [1.0, 0.0, 0.0])
        return self._picture(DISC_PIXELS, DISC_PIXELS)

    def _look(self, direction, up):
        from mathutils import Matrix

        back = -np.asarray(direction, float)
        right = np.cross(up, back)
        right /= np.linalg.norm(right)
        rows = np.eye(4)
        rows[:3, :3] = np.stack([right, np.cross(back, right), back], axis=1)
        self._camera.matrix_world = Matrix(rows.tolist())

    def _picture(self, columns, rows):
        render = self._scene.render
        render.resolution_x, render.resolution_y = columns, rows
        bpy.ops.render.render(write_still=True, scene=self._scene.name)
        image = bpy.data.images.load(str(self._path))
        image.colorspace_settings.name = "Linear Rec.709"
        values = np.empty(rows * columns * image.channels, np.float32)
        image.pixels.foreach_get(values)
        channels = image.channels
        bpy.data.images.remove(image)
        return values.reshape(rows, columns, channels)[..., :3]
