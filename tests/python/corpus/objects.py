"""Shapes, transformations and several volumes."""

import math

import bpy

from corpus.parts import (
    add_object,
    camera,
    homogeneous,
    light,
    material,
    modifier,
    outline,
    shear,
    stage,
    sun,
    world,
)
from corpus.registry import file


def _noisy(name="Cloud", scale=1.5, density=3.0, output="Object", **inputs):
    owner, graph = material(name)
    shape = graph.noise(graph.coordinates(output), inputs={"Scale": scale, "Detail": 1.0})
    graph.finish(graph.principled(Density=graph.map_range(shape, 0.4, 0.6, 0.0, density), **inputs))
    return owner


@file("overlapping-clouds", "three objects that overlap: cubes and a sphere of other anisotropy and colour")
def overlapping(folder):
    outline("cube", _noisy("White"), "White", location=(-0.5, 0, 0))
    outline("cube", homogeneous("Forward", 0.8, Anisotropy=0.8), "Forward", location=(0.4, 0.3, 0.2),
            rotation=(0.1, 0.2, 0.6))  # fmt: skip
    owner, graph = material("Red")
    graph.finish(graph.add("ShaderNodeVolumeScatter", {"Color": (0.9, 0.2, 0.1), "Anisotropy": -0.4}))
    outline("icosphere", owner, "Red", location=(0.2, -0.3, 0.3), subdivisions=2)
    stage()


@file("parented-and-sheared", "a cube that hangs on a sheared, scaled parent")
def sheared(folder):
    item = outline("cube", _noisy(), rotation=(0.3, 0.1, 0.4), scale=(1.2, 0.7, 0.9))
    shear(item, ((1, 0.4, 0, 0), (0, 1, 0.2, 0), (0.1, 0, 0.8, 0.1), (0, 0, 0, 1)))
    stage()


@file("modifiers", "subdivided, displaced, repeated by an array and cut by a Boolean")
def modifiers(folder):
    item = outline("cube", _noisy(output="Generated", scale=4.0))
    item.scale = (0.5, 0.5, 0.5)
    modifier(item, "SUBSURF", levels=2, render_levels=2)
    texture = bpy.data.textures.new("Bumps", "CLOUDS")
    texture.noise_scale = 0.8
    modifier(item, "DISPLACE", texture=texture, strength=0.3)
    modifier(item, "ARRAY", count=2, relative_offset_displace=(1.4, 0, 0))
    cutter = outline("icosphere", None, name="Cutter", location=(0, -0.4, 0.3), scale=(0.3,) * 3)
    cutter.hide_render = True
    modifier(item, "BOOLEAN", object=cutter, operation="DIFFERENCE")
    item.location.x = -0.5
    stage(location=(0, -4, 1))


@file(
    "render-levels",
    "a modifier that is set finer for the render than for the viewport",
)
def render_levels(folder):
    item = outline("cube", homogeneous("Fog", 1.0))
    modifier(item, "SUBSURF", levels=0, render_levels=2)
    stage()


@file("mirrored", "an object with a negative scale, by which its noise and its outline are mirrored")
def mirrored(folder):
    outline("monkey", _noisy(scale=2.0), scale=(-1.2, 1.0, 1.0), rotation=(0.0, 0.0, 0.4))
    stage(location=(0, -4, 0.3))


@file("applied-rotation", "a cube whose rotation by right angles was applied, with rounded corners of 1e-7")
def applied(folder):
    item = outline("cube", _noisy(output="Generated", scale=3.0), rotation=(math.pi / 2, 0, math.pi / 2))
    item.scale = (1.1, 0.7, 0.9)
    bpy.ops.object.select_all(action="DESELECT")
    item.select_set(True)
    bpy.context.view_layer.objects.active = item
    bpy.ops.object.transform_apply(location=False, rotation=True, scale=True)
    stage()


@file("thimble", "two centimetres of smoke with a density of hundreds per metre")
def thimble(folder):
    owner, graph = material("Tiny")
    shape = graph.noise(graph.coordinates("Object"), inputs={"Scale": 2.0, "Detail": 1.0})
    graph.finish(graph.principled(Density=graph.map_range(shape, 0.4, 0.6, 0.0, 300.0)))
    outline("cube", owner, scale=(0.01, 0.01, 0.01))
    camera((0, -0.06, 0.01), clip_start=0.001)
    sun()
    world()


@file("weather-front", "ten kilometres of cloud, three thousand metres up")
def front(folder):
    owner, graph = material("Front")
    shape = graph.noise(graph.coordinates("Object"), inputs={"Scale": 2.0, "Detail": 2.0})
    graph.finish(graph.principled(Density=graph.map_range(shape, 0.45, 0.6, 0.0, 0.004), Anisotropy=0.5))
    outline("cube", owner, scale=(5000, 5000, 500), location=(0, 0, 3000))
    camera((0, -15000, 2), (0, 0, 3000), lens=24.0, clip_end=100000.0)
    sun(4.0)
    world((0.2, 0.4, 0.8))


@file("needle-forward", "an anisotropy of 0.99 towards the sun, one of -0.9 beside it")
def needle(folder):
    for name, place, value in (("Forward", -0.7, 0.99), ("Backward", 0.7, -0.9)):
        outline(
            "cube", homogeneous(name, 0.7, Anisotropy=value), name, location=(place, 0, 0), scale=(0.5,) * 3
        )
    camera()
    sun(1.0, elevation=15.0, azimuth=80.0, angle=math.radians(20))
    world((0.02, 0.02, 0.02))


@file("two-slots", "a cube with a surface material and a volume material in two slots")
def two_slots(folder):
    item = outline("cube", homogeneous("Fog", 1.0))
    paint, graph = material("Paint")
    graph.add("ShaderNodeOutputMaterial", {"Surface": graph.add("ShaderNodeBsdfTransparent")})
    item.data.materials.append(paint)
    stage()


@file("shared-by-object-slot", "linked duplicates with one mesh, whose slots belong to the objects")
def object_slots(folder):
    first = outline("cube", homogeneous("Blue", 1.0, Color=(0.2, 0.4, 0.9)), "First", location=(-0.8, 0, 0),
                    scale=(0.6,) * 3)  # fmt: skip
    second = add_object("Second", first.data, location=(0.8, 0, 0), scale=(0.6,) * 3)
    second.material_slots[0].link = "OBJECT"
    second.material_slots[0].material = homogeneous("Red", 1.0, Color=(0.9, 0.3, 0.2))
    stage()


@file(
    "collection-instances",
    "one cloud in a collection, shown three times by instances",
)
def instances(folder):
    item = outline("cube", _noisy(), "Cloud", scale=(0.5, 0.5, 0.4))
    collection = bpy.data.collections.new("Clouds")
    collection.objects.link(item)
    bpy.context.scene.collection.objects.unlink(item)
    for index in range(3):
        empty = add_object(f"Copy {index}", None, location=(1.3 * index - 1.3, 0, 0.2 * index))
        empty.instance_type = "COLLECTION"
        empty.instance_collection = collection
    stage()


@file("hidden-things", "clouds that are hidden in renders or excluded, lights that are switched off")
def hidden(folder):
    outline("cube", homogeneous("Fog", 0.6))
    outline("cube", homogeneous("Hidden", 5.0), "Hidden", location=(0.5, 0, 0)).hide_render = True
    item = outline("cube", homogeneous("Excluded", 5.0), "Excluded", location=(-0.5, 0, 0))
    collection = bpy.data.collections.new("Archive")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(item)
    bpy.context.scene.collection.objects.unlink(item)
    bpy.context.view_layer.layer_collection.children["Archive"].exclude = True
    light("POINT", 5000.0, "Off", location=(0, -1, 2)).hide_render = True
    stage()


@file("nested-shells", "a dense core in a thin shell, a hollow sphere by Solidify")
def shells(folder):
    shell = outline("icosphere", homogeneous("Shell", 0.6), "Shell", subdivisions=3)
    modifier(shell, "SOLIDIFY", thickness=0.2)
    outline(
        "icosphere", homogeneous("Core", 5.0, Color=(1.0, 0.6, 0.3)), "Core", subdivisions=2, scale=(0.4,) * 3
    )
    stage()
