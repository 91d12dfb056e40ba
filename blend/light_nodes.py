"""The colour that the node tree of a light gives it, where it is one colour: measured, not computed again.

Cycles itself evaluates the tree: a copy of the light, as a sun of irradiance pi, lights a white surface
from above, whose radiance is then what the tree emits, to the rounding of f32. What depends on the
direction, the place or the ray is no colour; such nodes are found by what the tree reaches.
"""

from pathlib import Path

import bpy
import numpy as np

from graph_reader import Reach, live_links
from protocol import InputError

# Nodes whose outputs depend on their inputs and settings alone.
FIXED_NODES = {
    "NodeGroupInput",
    "NodeGroupOutput",
    "NodeReroute",
    "ShaderNodeAddShader",
    "ShaderNodeBlackbody",
    "ShaderNodeBrightContrast",
    "ShaderNodeClamp",
    "ShaderNodeCombineColor",
    "ShaderNodeCombineHSV",
    "ShaderNodeCombineRGB",
    "ShaderNodeCombineXYZ",
    "ShaderNodeEmission",
    "ShaderNodeFloatCurve",
    "ShaderNodeGamma",
    "ShaderNodeGroup",
    "ShaderNodeHueSaturation",
    "ShaderNodeInvert",
    "ShaderNodeMapRange",
    "ShaderNodeMapping",
    "ShaderNodeMath",
    "ShaderNodeMix",
    "ShaderNodeMixRGB",
    "ShaderNodeMixShader",
    "ShaderNodeNormal",
    "ShaderNodeOutputLight",
    "ShaderNodeRGB",
    "ShaderNodeRGBCurve",
    "ShaderNodeRGBToBW",
    "ShaderNodeSeparateColor",
    "ShaderNodeSeparateHSV",
    "ShaderNodeSeparateRGB",
    "ShaderNodeSeparateXYZ",
    "ShaderNodeValToRGB",
    "ShaderNodeValue",
    "ShaderNodeVectorCurve",
    "ShaderNodeVectorMath",
    "ShaderNodeVectorRotate",
    "ShaderNodeWavelength",
}
FALLOFF = "ShaderNodeLightFalloff"


def colors_of_trees(scene, folder):
    """{light data: colour, f64 [3]} of the scene's lights whose trees have to be evaluated, or an InputError
    in the place of a colour. `folder` is where Cycles writes its picture."""
    lights = {item.data for item in bpy.data.objects if item.type == "LIGHT" and _needs_evaluation(item.data)}
    found = {}
    for light in sorted(lights, key=lambda light: light.name):
        try:
            _require_one_color(light)
            if folder is None:
                raise InputError(
                    f'light "{light.name}", node tree',
                    "nodes that have to be evaluated",
                    "a folder for a picture of their light",
                    "give the request `folder`",
                )
            found[light] = _measured(light, scene, Path(folder))
        except InputError as error:
            found[light] = error
    return found


def _needs_evaluation(light):
    return light.use_nodes and light.node_tree is not None and plain_emission(light) is None


def plain_emission(light):
    """The Emission node of a light whose tree is just that, with the values that it stores; None for any
    other tree."""
    output = light.node_tree.get_output_node("CYCLES")
    links = live_links(light.node_tree)
    link = links.get((output.name, "Surface")) if output is not None else None
    node = link.from_node if link is not None else None
    if node is None or node.bl_idname != "ShaderNodeEmission" or node.mute:
        return None
    return node if not any((node.name, name) in links for name in ("Color", "Strength")) else None


def _require_one_color(light):
    place = f'light "{light.name}"'
    output = light.node_tree.get_output_node("CYCLES")
    if output is None or (output.name, "Surface") not in live_links(light.node_tree):
        raise InputError(
            f"{place}, node tree",
            "an output that nothing feeds",
            "nodes that give one colour",
            "link an Emission to the Light Output, or switch the nodes off; to leave the light out, hide it "
            "in renders",
        )
    reach = Reach(output.inputs["Surface"])
    for (tree, name), node in reach.nodes.items():
        if node.mute or node.bl_idname in FIXED_NODES or _is_quadratic(reach, tree, name, node):
            continue
        raise InputError(
            f'{place}, node "{node.name}" ({node.bl_idname})',
            "a light whose colour depends on more than its nodes' own values",
            "nodes that give one colour: values, colours, Blackbody, mathematics, mixes, Light Falloff with "
            "Quadratic and no Smooth",
            "give the light its colour and strength by its settings, or take this node out; to leave the "
            "light out, hide it in renders",
        )


def _is_quadratic(reach, tree, name, node):
    """Whether a node is a Light Falloff that changes nothing but the strength: Quadratic is the law that a
    light has without it."""
    if node.bl_idname != FALLOFF:
        return False
    smooth = node.inputs["Smooth"]
    others = [output for where, node_name, output in reach.outputs if (where, node_name) == (tree, name)]
    return set(others) <= {"Quadratic"} and not smooth.is_linked and smooth.default_value == 0.0


def _measured(light, frame_of, folder):
    """What the tree of a light emits, f64 [3]."""
    path = folder / "light.exr"
    copy = light.copy()
    copy.type = "SUN"
    # Fetched again, it has a sun's settings.
    copy = bpy.data.lights[copy.name]
    copy.color, copy.energy, copy.angle = (1.0, 1.0, 1.0), np.pi, 0.0
    copy.use_temperature = False
    for setting, value in (("exposure", 0.0), ("normalize", True)):
        if hasattr(copy, setting):
            setattr(copy, setting, value)
    copy.cycles.max_bounces = 1024
    scene = bpy.data.scenes.new("cloudparity light")
    mesh = bpy.data.meshes.new("cloudparity light")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("cloudparity light")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    white = tree.nodes.new("ShaderNodeBsdfDiffuse")
    white.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    tree.links.new(tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"], white.outputs[0])
    mesh.materials.append(material)
    camera = bpy.data.cameras.new("cloudparity light")
    camera.type, camera.ortho_scale = "ORTHO", 0.1
    # Both look down; the camera beside the diagonal of the square.
    for data, location in ((mesh, (0, 0, 0)), (camera, (0.3, 0.2, 1)), (copy, (0, 0, 2))):
        item = bpy.data.objects.new("cloudparity light", data)
        item.location = location
        scene.collection.objects.link(item)
        if data == camera:
            scene.camera = item
    _settings(scene, path)
    scene.frame_set(frame_of.frame_current)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.name = "Linear Rec.709" if bpy.app.version >= (4, 0, 0) else "Linear"
    pixel = np.array(image.pixels[:3], np.float64)
    bpy.data.images.remove(image)
    path.unlink(missing_ok=True)
    bpy.data.batch_remove([scene, mesh, material, camera, copy])
    if not np.isfinite(pixel).all():
        raise InputError(
            f'light "{light.name}", node tree',
            f"the colour {pixel.tolist()}",
            "numbers",
            "find the node that makes NaN or infinity",
        )
    return pixel


def _settings(scene, path):
    """One sample in the middle of a pixel, without clamps."""
    render, cycles = scene.render, scene.cycles
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = 1
    render.resolution_percentage = 100
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGB"
    render.image_settings.color_depth = "32"
    render.use_compositing = render.use_sequencer = False
    render.filepath = str(path)
    cycles.device = "CPU"
    cycles.samples, cycles.seed = 1, 0
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.light_sampling_threshold = 0.0
    cycles.pixel_filter_type, cycles.filter_width = "BLACKMAN_HARRIS", 0.01
