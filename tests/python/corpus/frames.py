"""Cameras, films, lights and worlds."""

import math

import bpy
import numpy as np

from corpus.parts import Graph, add_object, camera, homogeneous, light, material, outline, stage, sun, world
from corpus.registry import file


def _cloud(scale=(1.0, 1.0, 1.0), density=2.0, **inputs):
    owner, graph = material("Cloud")
    shape = graph.noise(graph.coordinates("Object"), inputs={"Scale": 1.5, "Detail": 1.0})
    graph.finish(graph.principled(Density=graph.map_range(shape, 0.4, 0.6, 0.0, density), **inputs))
    return outline("cube", owner, scale=scale)


@file("inside-the-cloud", "the camera stands in the cloud, with a wide lens")
def inside(folder):
    _cloud((4, 4, 2), 0.6)
    stage((0.3, 0.4, 0.6), location=(0.5, -1, 0.3), lens=18.0)


@file("orthographic", "an orthographic camera with a shift")
def orthographic(folder):
    _cloud()
    stage(location=(4, -6, 3), type="ORTHO", ortho_scale=4.0, shift_x=0.1, shift_y=-0.05)


@file("shifted-lens", "a perspective camera with shift, sensor fit vertical and pixels that are not square")
def shifted(folder):
    _cloud()
    stage(location=(2, -6, 0.5), lens=35.0, shift_x=-0.15, shift_y=0.1, sensor_fit="VERTICAL")
    bpy.context.scene.render.pixel_aspect_x = 1.5


@file("panorama", "an equirectangular camera between clouds")
def panorama(folder):
    _cloud((3, 3, 1), 0.8)
    stage((0.2, 0.3, 0.5), location=(0, 0, -1.5), target=(0, 5, -1.5), type="PANO",
          panorama_type="EQUIRECTANGULAR")  # fmt: skip


@file("white-furnace", "a white world and white scattering: the cloud vanishes")
def furnace(folder):
    outline("cube", homogeneous("White", 1.5, Color=(1.0, 1.0, 1.0)))
    camera()
    world((1.0, 1.0, 1.0))
    bpy.context.scene.cycles.volume_bounces = 32
    bpy.context.scene.cycles.max_bounces = 32


@file(
    "sun-in-the-dark", "single scattering in front of a black world, Blender's default of no volume bounces"
)
def dark(folder):
    _cloud()
    stage((0.0, 0.0, 0.0))


@file("several-bounces", "eight volume bounces in a dense white cloud, twelve in all")
def bounces(folder):
    _cloud(density=8.0, Color=(1.0, 1.0, 1.0))
    stage()
    bpy.context.scene.cycles.volume_bounces = 8


@file("hdri", "an environment picture in EXR lights the cloud", sample_world=True)
def hdri(folder):
    height, width = 16, 32
    up, right = np.meshgrid(np.linspace(0, 1, height), np.linspace(0, 1, width), indexing="ij")
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., 0] = 0.3 + 0.4 * up
    pixels[..., 1] = 0.35 + 0.3 * up + 0.1 * np.sin(2 * math.pi * right)
    pixels[..., 2] = 0.4 + 0.5 * up
    pixels[11:13, 20:22, :3] = (30.0, 24.0, 15.0)
    picture = bpy.data.images.new("sky", width, height, float_buffer=True)
    picture.pixels[:] = pixels.ravel()
    picture.filepath_raw, picture.file_format = str(folder / "sky.exr"), "OPEN_EXR"
    picture.save()
    bpy.data.images.remove(picture)
    picture = bpy.data.images.load(str(folder / "sky.exr"))
    picture.colorspace_settings.name = "Linear Rec.709"
    picture.filepath = "//sky.exr"
    _cloud()
    camera()
    graph, background = world()
    graph.feed(background, "Color", graph.out(graph.add("ShaderNodeTexEnvironment", image=picture), "Color"))


@file("transparent-film", "film transparent: the world lights the cloud and is not seen", samples=256)
def transparent(folder):
    _cloud()
    stage((0.5, 0.6, 0.9))
    bpy.context.scene.render.film_transparent = True


@file("film-settings", "an exposure of 2.5 and a wide Gaussian filter")
def film(folder):
    _cloud()
    stage()
    cycles = bpy.context.scene.cycles
    cycles.film_exposure, cycles.pixel_filter_type, cycles.filter_width = 2.5, "GAUSSIAN", 2.5


@file("box-filter", "the box filter, and a percentage of the resolution")
def box_filter(folder):
    _cloud()
    stage()
    bpy.context.scene.cycles.pixel_filter_type = "BOX"
    bpy.context.scene.render.resolution_percentage = 50


@file("two-suns", "a warm and a cold sun, one of them wide, as on another planet")
def suns(folder):
    _cloud()
    camera()
    sun(3.0, 25.0, 20.0, name="Warm", color=(1.0, 0.6, 0.3), angle=math.radians(15))
    sun(1.5, 60.0, 200.0, name="Cold", color=(0.4, 0.6, 1.0), exposure=1.0)
    world((0.0, 0.0, 0.0))


@file("three-point-lighting", "key, fill and rim: a spot, a large area light and a point light", samples=256)
def three_points(folder):
    _cloud()
    camera()
    light("SPOT", 400.0, "Key", location=(-3, -3, 3), target=(0, 0, 0), spot_size=0.9, spot_blend=1.0)
    light("AREA", 100.0, "Fill", location=(4, -2, 0), target=(0, 0, 0), shape="SQUARE", size=2.0)
    light("POINT", 200.0, "Rim", location=(0.5, 3, 1.5), shadow_soft_size=0.5, color=(0.6, 0.7, 1.0))
    world((0.0, 0.0, 0.0))


@file("warm-lamp", "a light by its temperature", samples=256)
def warm_lamp(folder):
    outline("cube", homogeneous("Haze", 0.3))
    camera()
    light("POINT", 300.0, "Bulb", location=(2, -1, 2), use_temperature=True, temperature=2700.0)
    world((0.0, 0.0, 0.0))


@file(
    "lamp-with-nodes",
    "a light whose node tree holds a Blackbody",
)
def lamp_with_nodes(folder):
    outline("cube", homogeneous("Haze", 0.3))
    camera()
    lamp = light("POINT", 200.0, "Nodes", location=(-2, -1, 2)).data
    lamp.use_nodes = True
    tree = lamp.node_tree
    tree.nodes.clear()
    graph = Graph(tree)
    warm = graph.add("ShaderNodeBlackbody", {"Temperature": 4000.0})
    shine = graph.add("ShaderNodeEmission", {"Color": warm, "Strength": 2.0})
    graph.add("ShaderNodeOutputLight", {"Surface": shine})
    world((0.0, 0.0, 0.0))


@file(
    "sky-texture",
    "a Sky Texture lights the cloud, as the first tutorial of clouds has it",
)
def sky(folder):
    _cloud()
    camera()
    graph, background = world(strength=0.1)
    texture = graph.add("ShaderNodeTexSky")
    texture.sun_disc = False
    graph.feed(background, "Color", graph.out(texture, "Color"))


@file("gradient-world", "a world of a Gradient Texture through a Color Ramp")
def gradient_world(folder):
    _cloud()
    camera()
    graph, background = world()
    turned = graph.add(
        "ShaderNodeMapping", {"Vector": graph.coordinates("Generated"), "Rotation": (0.0, math.pi / 2, 0.0)}
    ).outputs[0]
    fall = graph.out(graph.add("ShaderNodeTexGradient", {"Vector": turned}), "Fac")
    graph.feed(background, "Color", graph.ramp(fall, (0.0, (0.9, 0.5, 0.2)), (1.0, (0.1, 0.2, 0.6))))


@file("camera-on-a-path", "a keyframed camera and a cloud that an empty carries along")
def moving(folder):
    item = _cloud((0.8, 0.8, 0.8))
    carrier = add_object("Carrier", None)
    item.parent = carrier
    stage()
    for frame, place in ((1, -1.0), (40, 1.0)):
        carrier.location.x = place
        carrier.keyframe_insert("location", frame=frame)
        bpy.context.scene.camera.location.z = 1.0 + place
        bpy.context.scene.camera.keyframe_insert("location", frame=frame)
    bpy.context.scene.frame_set(10)
