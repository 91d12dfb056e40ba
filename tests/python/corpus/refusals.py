"""Files that are refused, for reasons that the documentation lists."""

import bpy

from corpus.parts import camera, homogeneous, material, outline, stage, sun, world
from corpus.registry import file

NODES = "docs/nodes.md"


def _cube_of(node_type, output, name, **properties):
    owner, graph = material(name)
    node = graph.add(node_type, **properties)
    graph.finish(graph.principled(Density=graph.out(node, output)))
    outline("cube", owner)
    stage()


@file("layer-weight", "Layer Weight as density", refused="Layer Weight", documented=NODES)
def layer_weight(folder):
    _cube_of("ShaderNodeLayerWeight", "Facing", "Edge")


@file(
    "light-path-trick", "a density for camera rays only: Light Path", refused="Light Path", documented=NODES
)
def light_path(folder):
    _cube_of("ShaderNodeLightPath", "Is Camera Ray", "Trick")


@file(
    "uv-coordinates",
    "a texture in UV coordinates, which a volume does not have",
    refused="UV",
    documented=NODES,
)
def uv(folder):
    owner, graph = material("UV")
    graph.finish(graph.principled(Density=graph.noise(graph.coordinates("UV"))))
    outline("cube", owner)
    stage()


@file("camera-distance", "Camera Data: fog that is denser far away", refused="Camera Data", documented=NODES)
def camera_data(folder):
    _cube_of("ShaderNodeCameraData", "View Distance", "Far")


@file("image-sheet", "an Image Texture as the density of a sheet", refused="Image Texture", documented=NODES)
def image(folder):
    picture = bpy.data.images.new("sheet", 4, 4)
    picture.pixels[:] = [0.5] * 64
    picture.pack()
    _cube_of("ShaderNodeTexImage", "Color", "Sheet", image=picture)


@file("colour-attribute", "an Attribute node that names a colour attribute of the mesh",
      refused="Attribute", documented=NODES)  # fmt: skip
def attribute(folder):
    _cube_of("ShaderNodeAttribute", "Fac", "Painted", attribute_name="Col")


@file("fog-of-the-world", "the volume of the world, which has no end", refused="world",
      documented="docs/scene-format.md")  # fmt: skip
def world_volume(folder):
    outline("cube", homogeneous("Cloud", 1.0))
    camera()
    sun()
    graph, _ = world()
    fog = graph.add("ShaderNodeVolumeScatter", {"Density": 0.02})
    output = next(node for node in graph.tree.nodes if node.bl_idname == "ShaderNodeOutputWorld")
    graph.feed(output, "Volume", fog)
