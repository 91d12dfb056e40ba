"""Renders small scenes whose picture has a closed form, and answers with the mean of every replica.

Request: {"scene": SCENE, "samples": N, "resolution": [width, height], "biased": BOOL, "step_rate": R,
          "replicas": [{"seed": S, "offset": O, "length": L or null}], "folder": DIR, "blend": FILE or null}
`length` null renders samples 0 to N - 1 with a seed; otherwise samples O to O + L - 1 of N alone
(`use_sample_subset`). `biased` is ray marching, with `step_rate` times its step; null is the release's own
way. `blend` keeps the scene.
SCENE is one of
  {"stage": "shadow", "medium": MEDIUM, "half": [x, y, z], "width": W}: a white diffuse floor under a sun of
      radiance 1 in the picture, and a box of an absorbing medium between them that the camera does not see
      through: a pixel is the transmittance of a shadow ray;
  {"stage": "furnace", "medium": MEDIUM, "half": [x, y, z], "world": "constant" or "varying"}: a scattering
      medium in a world that is 1 everywhere; the second kind is 1, too, and Cycles does not see that it is;
  {"stage": "phase", "medium": MEDIUM, "half": [x, y, z], "cosine": 0 or 1, "sampled": BOOL}: a thin ball of
      a scattering medium, one bounce, in a world of 1 + cosine * (the cosine with the camera's direction),
      black where the camera looks, that light sampling knows or not.
  {"stage": "scene", "scene": a scene of the project, "folder": DIR or null, "film_transparent",
      "volume_bounces", "world_sampling": as reference.py has them}: what references are made of.
MEDIUM is {"density": DENSITY, "lobes": [{"phase": NAME, "weight": W, ...}]}; without lobes it absorbs.
DENSITY is {"kind": "constant", "value"}; {"kind": "two_valued", "value", "share"}, independent at every
point; {"kind": "uniform", "value"}, independent and uniform in 0 to value; {"kind": "sheet", "thickness",
"optical_depth", "middle"}; or {"kind": "checkerboard", "value", "voxels", "maximum": BOOL}, a grid, with a
Math Maximum of 0 before the density or without.
Answer: {"blender", "replicas": [{"mean", "negative", "least", "seconds"}], "pixels"}; `negative` counts
pixels.
"""

import protocol

# Of the world that Cycles takes for varying: no ray comes from so far below.
UNSEEN = -2.0

# Cosine with the camera's direction beyond which light counts as not scattered: 1 of 200,000 directions.
UNSCATTERED = 0.99999


def handle(request, messages):
    """Build the scene, keep it where it is asked for, and render the replicas."""
    import bpy

    from blender_file import open_empty, save_blend
    from cycles_settings import apply_settings

    open_empty()
    scene = bpy.context.scene
    described = request["scene"]
    stage = described["stage"]
    if stage not in STAGES and stage != "scene":
        raise protocol.InputError(
            f"{described.place}.stage",
            f'"{stage}"',
            f"scene or one of {', '.join(STAGES)}",
            "name one of them",
        )
    if stage == "scene":
        _project_scene(request, messages)
    else:
        apply_settings(scene, request["samples"], 0, 0)
        _common(scene, request)
        STAGES[stage](scene, described, request["folder"])
    if request["blend"]:
        save_blend(request["blend"])
    replicas = []
    for index, replica in enumerate(request["replicas"]):
        messages.progress(index / len(request["replicas"]), "Cycles")
        replicas.append(_render(scene, replica, request["folder"]))
    width, height = request["resolution"]
    return {"blender": bpy.app.version_string, "replicas": replicas, "pixels": width * height}


def _project_scene(request, messages):
    """A scene of the project under the settings of its references."""
    import bpy

    from reference_render import apply_request
    from scene_builder import build_scene
    from scene_io import check_format

    described = request["scene"]
    check_format(described["scene"])
    build_scene(described["scene"], messages.warning, described["folder"])
    settings = {
        "scene": described["scene"],
        "samples": request["samples"],
        "threads": 0,
        "multilayer": False,
        "resolution": request["resolution"],
        "volume_biased": bool(request["biased"]),
        "step_rate": request["step_rate"],
    }
    for key in ("film_transparent", "volume_bounces", "world_sampling"):
        settings[key] = described[key]
    apply_request(bpy.context.scene, settings, 0)


def _common(scene, request):
    """What all stages share: no bounce is cut off unless a stage does it, and no filter mixes pixels."""
    render, cycles = scene.render, scene.cycles
    render.resolution_x, render.resolution_y = request["resolution"]
    render.resolution_percentage = 100
    render.film_transparent = False
    # Releases before the null collision integrator have only ray marching.
    if hasattr(cycles, "volume_biased"):
        cycles.volume_biased = bool(request["biased"])
    elif request["biased"] is False:
        raise protocol.InputError(
            f"{request.place}.biased",
            "false",
            "true: this release has ray marching alone",
            "ask a release with null collision (5.0 and later)",
        )
    cycles.volume_step_rate = request["step_rate"]
    cycles.volume_max_steps = 65536
    cycles.max_bounces = cycles.volume_bounces = 1024
    cycles.diffuse_bounces = cycles.transmission_bounces = cycles.glossy_bounces = 0
    cycles.pixel_filter_type = "BOX"
    cycles.caustics_reflective = cycles.caustics_refractive = False


def _render(scene, replica, folder):
    """One picture, as numbers of its colour channels."""
    import tempfile
    import time
    from pathlib import Path

    import bpy
    import numpy as np
    import OpenImageIO as oiio

    from cycles_settings import apply_exr

    cycles = scene.cycles
    cycles.seed = replica["seed"]
    cycles.use_sample_subset = replica["length"] is not None
    if cycles.use_sample_subset:
        cycles.sample_offset, cycles.sample_subset_length = replica["offset"], replica["length"]
    apply_exr(scene.render.image_settings, False, codec="NONE")
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        path = Path(temporary) / "picture.exr"
        scene.render.filepath = str(path)
        begin = time.perf_counter()
        bpy.ops.render.render(write_still=True)
        seconds = time.perf_counter() - begin
        pixels = np.asarray(oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT), dtype=float)[..., :3]
    if not np.isfinite(pixels).all():
        raise protocol.InputError(
            "Cycles' picture",
            "NaN or infinite values",
            "numbers",
            "keep the scene with `blend` and look at it",
        )
    return {
        "mean": float(pixels.mean()),
        "negative": int((pixels < 0).any(axis=-1).sum()),
        "least": float(pixels.min()),
        "seconds": seconds,
    }


# --- stages


def _shadow(scene, described, folder):
    """A floor that the camera sees from the side below the medium, and a sun straight above."""
    import math

    import bpy
    from mathutils import Vector

    half = described["half"]
    floor = _plane("floor", 4.0)
    material = bpy.data.materials.new("floor")
    tree = _tree(material)
    diffuse = tree.nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(diffuse.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    floor.data.materials.append(material)
    # Its lower face stands at 1: far above the camera's rays.
    _medium_box(described["medium"], half, (0, 0, 1.0 + half[2]), folder)
    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy, sun.angle = math.pi, 0.0
    scene.collection.objects.link(bpy.data.objects.new("sun", sun))
    _world(scene, None)
    # A sine of 1/4: a square of the film covers a rectangle of the floor, four times as long as wide.
    away = 1.5
    height = away / math.sqrt(15.0)
    _camera(scene, (0, -away, height), Vector((0, away, -height)), described["width"])


def _furnace(scene, described, folder):
    """A scattering box in a world of 1."""
    from mathutils import Vector

    _medium_box(described["medium"], described["half"], (0, 0, 0), folder)
    _world(scene, described["world"])
    _camera(scene, (0, -10, 0), Vector((0, 1, 0)), min(described["half"]))


def _phase(scene, described, folder):
    """A thin ball, one bounce, and a world that only rays meet."""
    from mathutils import Vector

    _medium_box(described["medium"], described["half"], (0, 0, 0), folder, ball=True)
    scene.cycles.max_bounces = scene.cycles.volume_bounces = 1
    _world(scene, "cosine", described["cosine"], described["sampled"])
    # Rays through the middle, where the ball is symmetric.
    _camera(scene, (0, -10, 0), Vector((0, 1, 0)), 0.01 * described["half"][0])


STAGES = {"shadow": _shadow, "furnace": _furnace, "phase": _phase}


def _tree(owner):
    """An empty node tree."""
    owner.use_nodes = True
    owner.node_tree.nodes.clear()
    return owner.node_tree


def _plane(name, side):
    import bpy

    mesh = bpy.data.meshes.new(name)
    half = side / 2
    mesh.from_pydata(
        [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)]
    )
    return _linked(bpy.data.objects.new(name, mesh))


def _linked(thing):
    import bpy

    bpy.context.scene.collection.objects.link(thing)
    return thing


def _camera(scene, place, direction, width):
    import bpy

    camera = bpy.data.cameras.new("camera")
    camera.type, camera.ortho_scale = "ORTHO", width
    thing = _linked(bpy.data.objects.new("camera", camera))
    thing.location = place
    thing.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()
    scene.camera = thing


def _world(scene, kind, cosine=0, sampled=True):
    """Black, 1, 1 that looks varying, or 1 + cosine * y."""
    import bpy

    world = bpy.data.worlds.new("world")
    scene.world = world
    tree = _tree(world)
    background = tree.nodes.new("ShaderNodeBackground")
    tree.links.new(background.outputs[0], tree.nodes.new("ShaderNodeOutputWorld").inputs["Surface"])
    value = 0.0 if kind is None else 1.0
    background.inputs["Color"].default_value = (value, value, value, 1)
    if kind in (None, "constant"):
        return
    place = tree.nodes.new("ShaderNodeTexCoord").outputs["Generated"]
    split = tree.nodes.new("ShaderNodeSeparateXYZ")
    tree.links.new(place, split.inputs[0])
    world.cycles.sampling_method = "AUTOMATIC" if sampled else "NONE"
    if kind == "cosine":
        weighted = _math(tree, "MULTIPLY_ADD", split.outputs["Y"], float(cosine), 1.0)
        # What was not scattered comes from where it is dark.
        lit = _math(tree, "LESS_THAN", split.outputs["Y"], UNSCATTERED)
        tree.links.new(_math(tree, "MULTIPLY", weighted, lit), background.inputs["Color"])
        return
    above = _math(tree, "GREATER_THAN", split.outputs["Z"], UNSEEN)
    tree.links.new(above, background.inputs["Color"])


def _math(tree, operation, *operands):
    """A Math node of sockets and numbers."""
    node = tree.nodes.new("ShaderNodeMath")
    node.operation = operation
    for socket, operand in zip(node.inputs, operands, strict=False):
        if isinstance(operand, float):
            socket.default_value = operand
        else:
            tree.links.new(operand, socket)
    return node.outputs[0]


# --- media


def _medium_box(medium, half, centre, folder, ball=False):
    """A box or a ball with a medium; a volume object where the density is a grid."""
    import bmesh
    import bpy

    density = medium["density"]
    if density["kind"] == "checkerboard":
        thing = _grid(density, half, folder)
    else:
        mesh = bpy.data.meshes.new("medium")
        shape = bmesh.new()
        if ball:
            bmesh.ops.create_icosphere(shape, subdivisions=6, radius=1.0)
        else:
            bmesh.ops.create_cube(shape, size=2.0)
        bmesh.ops.scale(shape, vec=half, verts=shape.verts)
        shape.to_mesh(mesh)
        shape.free()
        thing = _linked(bpy.data.objects.new("medium", mesh))
    thing.location = centre
    material = bpy.data.materials.new("medium")
    tree = _tree(material)
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    material.cycles.volume_sampling = "MULTIPLE_IMPORTANCE"
    tree.links.new(_shader(tree, medium), output.inputs["Volume"])
    thing.data.materials.append(material)


def _shader(tree, medium):
    """Absorption, or a sum of scattering lobes."""
    lobes = medium.get("lobes") or []
    if not lobes:
        node = tree.nodes.new("ShaderNodeVolumeAbsorption")
        node.inputs["Color"].default_value = (0, 0, 0, 1)
        _density(tree, medium["density"], node.inputs["Density"], 1.0)
        return node.outputs[0]
    total = None
    for lobe in lobes:
        node = tree.nodes.new("ShaderNodeVolumeScatter")
        # Releases before 4.3 have this phase function alone, and no choice.
        if hasattr(node, "phase"):
            node.phase = lobe["phase"]
        elif lobe["phase"] != "HENYEY_GREENSTEIN":
            raise protocol.InputError(
                f"{lobe.place}.phase",
                f'"{lobe["phase"]}"',
                "HENYEY_GREENSTEIN: this release has no other",
                "ask release 4.3 or later",
            )
        node.inputs["Color"].default_value = (1, 1, 1, 1)
        for key, socket in (("anisotropy", "Anisotropy"), ("alpha", "Alpha")):
            if key in lobe:
                node.inputs[socket].default_value = lobe[key]
        _density(tree, medium["density"], node.inputs["Density"], lobe["weight"])
        if total is None:
            total = node.outputs[0]
        else:
            both = tree.nodes.new("ShaderNodeAddShader")
            tree.links.new(total, both.inputs[0])
            tree.links.new(node.outputs[0], both.inputs[1])
            total = both.outputs[0]
    return total


def _density(tree, density, socket, weight):
    """The density of a medium, times a weight."""
    kind = density["kind"]
    if kind == "constant":
        socket.default_value = density["value"] * weight
        return
    if kind == "checkerboard":
        node = tree.nodes.new("ShaderNodeAttribute")
        node.attribute_name = "density"
        found = node.outputs["Fac"]
        if density["maximum"]:
            found = _math(tree, "MAXIMUM", found, 0.0)
    elif kind == "sheet":
        # Its middle lies off the borders of boxes that halve the object.
        place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
        split = tree.nodes.new("ShaderNodeSeparateXYZ")
        tree.links.new(place, split.inputs[0])
        thickness = density["thickness"]
        away = _math(tree, "ABSOLUTE", _math(tree, "SUBTRACT", split.outputs["Z"], density["middle"]))
        inside = _math(tree, "LESS_THAN", away, thickness / 2)
        found = _math(tree, "MULTIPLY", inside, density["optical_depth"] / thickness)
    else:
        place = tree.nodes.new("ShaderNodeTexCoord").outputs["Object"]
        noise = tree.nodes.new("ShaderNodeTexWhiteNoise")
        noise.noise_dimensions = "3D"
        tree.links.new(place, noise.inputs["Vector"])
        found = noise.outputs["Value"]
        if kind == "two_valued":
            found = _math(tree, "LESS_THAN", found, density["share"])
        found = _math(tree, "MULTIPLY", found, density["value"])
    if weight != 1.0:
        found = _math(tree, "MULTIPLY", found, weight)
    tree.links.new(found, socket)


def _grid(density, half, folder):
    """A volume object of a checkerboard of voxels that fill the box."""
    from pathlib import Path

    import bpy
    import numpy as np

    import volume_grid

    voxels = density["voxels"]
    place = np.indices((voxels,) * 3).sum(axis=0)
    values = np.where(place % 2 == 0, density["value"], 0.0).astype(np.float32)
    to_object = np.eye(4)
    for axis, side in enumerate(half):
        to_object[axis, axis] = 2 * side / voxels
        to_object[axis, 3] = -side + side / voxels
    path = Path(folder) / f"checkerboard-{voxels}-{density['value']:g}.vdb"
    volume_grid.write(path, values, to_object)
    data = bpy.data.volumes.new("medium")
    data.filepath = str(path)
    return _linked(bpy.data.objects.new("medium", data))


if __name__ == "__main__":
    protocol.serve("cycles_findings.py", handle)
