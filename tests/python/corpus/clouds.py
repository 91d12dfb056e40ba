"""Clouds, fog, haze and smoke."""

import math

import bpy
import numpy as np

import volume_grid
from corpus.parts import (
    add_object,
    camera,
    group,
    homogeneous,
    interface,
    light,
    material,
    outline,
    stage,
    sun,
    world,
)
from corpus.registry import file


@file("fair-weather-cumulus", "Noise through a Color Ramp, faded out by the distance from the middle")
def cumulus(folder):
    owner, graph = material("Cumulus")
    place = graph.coordinates("Object")
    puffs = graph.noise(place, inputs={"Scale": 1.6, "Detail": 4.0, "Roughness": 0.6})
    edge = graph.map_range(graph.vector_math("LENGTH", place), 0.4, 1.0, 0.35, -0.2)
    density = graph.ramp(graph.math("ADD", puffs, edge), (0.5, 0.0), (0.72, 1.0))
    graph.finish(graph.principled(Density=graph.math("MULTIPLY", density, 4.0), Anisotropy=0.3))
    outline("cube", owner, scale=(1.5, 1.2, 0.8))
    stage((0.2, 0.35, 0.6))


@file("layered-voronoi-cloud", "five stages in a group: Voronoi and Noise, subtracted and remapped")
def layered_cloud(folder):
    tree, inner = group("Cloud")
    for name, value in (("Scale", 1.0), ("Density", 1.0), ("Coverage", 0.4)):
        interface(tree, "INPUT", name, default=value)
    interface(tree, "OUTPUT", "Density")
    given = inner.add("NodeGroupInput")
    place = inner.coordinates("Object")
    place = inner.vector_math("SCALE", place, inner.out(given, "Scale"))
    bend = inner.noise(place, "Color", {"Scale": 2.0, "Detail": 1.0})
    place = inner.add(
        "ShaderNodeMix",
        {"Factor_Float": 0.15, "A_Color": place, "B_Color": bend},
        data_type="RGBA",
        blend_type="LINEAR_LIGHT",
    )
    place = inner.out(place, "Result_Color")
    cells = inner.voronoi(place, inputs={"Scale": 1.5, "Smoothness": 0.6, "Detail": 1.0}, feature="SMOOTH_F1")
    body = inner.math("SUBTRACT", 1.0, cells)
    detail = inner.noise(place, inputs={"Scale": 6.0, "Detail": 3.0, "Roughness": 0.55})
    body = inner.math("SUBTRACT", body, inner.math("MULTIPLY", detail, 0.4))
    low = inner.math("MULTIPLY", inner.out(given, "Coverage"), 0.8)
    body = inner.map_range(body, low, 0.8, 0.0, 1.0, interpolation_type="SMOOTHSTEP")
    height = inner.map_range(inner.axis(place, "Z"), -1.0, -0.6)
    body = inner.math("MULTIPLY", inner.math("MULTIPLY", body, height), inner.out(given, "Density"))
    inner.add("NodeGroupOutput", {"Density": body})
    owner, graph = material("Layered Cloud")
    instance = graph.add("ShaderNodeGroup", node_tree=tree)
    graph.feed(instance, "Density", 6.0)
    graph.finish(graph.add("ShaderNodeVolumeScatter", {"Density": instance, "Anisotropy": 0.4}))
    outline("cube", owner)
    stage((0.1, 0.2, 0.4), location=(3, -6, 2), lens=45.0)


@file("fog-box", "a room of fog: Generated Z thins it out with height")
def fog_box(folder):
    owner, graph = material("Fog")
    height = graph.map_range(graph.axis(graph.coordinates("Generated"), "Z"), 0.0, 1.0, 0.4, 0.0)
    graph.finish(graph.principled(Density=height))
    outline("cube", owner, scale=(4, 4, 1.5), location=(0, 0, 1.5))
    stage((0.3, 0.3, 0.35), location=(0, -11, 2), target=(0, 0, 1))


@file("ground-mist", "a flat box, stretched noise with Map Range and Math, Power")
def ground_mist(folder):
    owner, graph = material("Mist")
    place = graph.coordinates("Object")
    stretched = graph.add("ShaderNodeMapping", {"Vector": place, "Scale": (1.0, 1.0, 4.0)})
    patches = graph.noise(stretched.outputs[0], inputs={"Scale": 1.2, "Detail": 2.0})
    patches = graph.map_range(patches, 0.35, 0.75, 0.0, 0.8, interpolation_type="SMOOTHERSTEP")
    fall = graph.math("POWER", graph.map_range(graph.axis(place, "Z"), -1.0, 1.0, 1.0, 0.0), 2.5)
    graph.finish(graph.principled(Density=graph.math("MULTIPLY", patches, fall), Color=(0.8, 0.85, 0.9)))
    outline("cube", owner, scale=(5, 5, 0.4))
    stage((0.15, 0.15, 0.2), location=(0, -9, 1.5), lens=30.0)


def _smoke_grid(folder):
    """A plume of 20 x 20 x 32 voxels of 0.1 m, as a fluid simulation would store it."""
    x, y, z = np.meshgrid(
        np.linspace(-1, 1, 20), np.linspace(-1, 1, 20), np.linspace(0, 1, 32), indexing="ij"
    )
    sway = 0.3 * np.sin(5.0 * z)
    away = np.sqrt((x - sway) ** 2 + (y - 0.2 * z) ** 2) / (0.25 + 0.5 * z)
    density = np.clip(1.5 * (1.0 - away), 0.0, 1.0) * (1.0 - z) * (0.8 + 0.2 * np.cos(9.0 * x + 7.0 * z))
    path = folder / "smoke.vdb"
    rows = np.diag([0.1, 0.1, 0.1, 1.0])
    rows[:3, 3] = (-0.95, -0.95, -1.5)
    volume_grid.write(path, density.astype(np.float32), rows)
    data = bpy.data.volumes.new("Smoke")
    data.filepath = f"//{path.name}"
    data.render.clipping = 0.0
    return data


@file(
    "smoke-grid",
    "a Volume object with an OpenVDB grid, its density by an Attribute node",
)
def smoke_grid(folder):
    owner, graph = material("Smoke")
    density = graph.add("ShaderNodeAttribute", attribute_name="density")
    scaled = graph.math("MULTIPLY", graph.out(density, "Fac"), 3.0)
    graph.finish(
        graph.add("ShaderNodeVolumeScatter", {"Color": (0.6, 0.6, 0.6), "Density": scaled, "Anisotropy": 0.2})
    )
    add_object("Smoke", _smoke_grid(folder), owner)
    stage(location=(0, -7, 0.5))


@file(
    "smoke-principled",
    "the same grid with Principled Volume as Blender sets it up: its Density Attribute",
)
def smoke_principled(folder):
    owner, graph = material("Smoke")
    graph.finish(graph.principled(Density=3.0, Color=(0.5, 0.5, 0.5)))
    add_object("Smoke", _smoke_grid(folder), owner)
    stage(location=(0, -7, 0.5))


@file("ocean-haze", "a flat box of 2 km with a density of 0.001 per metre, the sun low behind it")
def ocean_haze(folder):
    outline(
        "cube", homogeneous("Haze", 0.001, Color=(0.75, 0.85, 1.0), Anisotropy=0.5), scale=(1000, 1000, 25)
    )
    camera((0, -1500, 60), (0, 0, 10), lens=28.0, clip_end=10000.0)
    sun(2.0, elevation=8.0, azimuth=80.0, angle=math.radians(0.5), color=(1.0, 0.7, 0.4))
    world((0.2, 0.35, 0.6))


@file("storm-cloud", "dense and dark, forward scattering, a flash of a point light inside", samples=1024)
def storm_cloud(folder):
    owner, graph = material("Storm")
    shape = graph.noise(graph.coordinates("Object"), inputs={"Scale": 1.1, "Detail": 3.0, "Lacunarity": 2.3})
    density = graph.map_range(shape, 0.45, 0.6, 0.0, 12.0)
    graph.finish(graph.principled(Density=density, Anisotropy=0.7, Color=(0.7, 0.7, 0.75)))
    outline("cube", owner, scale=(1.5, 1.5, 0.7))
    light("POINT", 300.0, location=(0.3, 0.2, 0.1), shadow_soft_size=0.1, color=(0.7, 0.8, 1.0))
    stage((0.02, 0.03, 0.05))


@file("cirrus", "Wave and Noise with a stretched Mapping, a thin sheet seen from below")
def cirrus(folder):
    owner, graph = material("Cirrus")
    mapping = graph.add(
        "ShaderNodeMapping",
        {
            "Vector": graph.coordinates("Object"),
            "Location": (0.3, 0.1, 0.0),
            "Rotation": (0.0, 0.0, 0.6),
            "Scale": (0.4, 2.0, 1.0),
        },
    ).outputs[0]
    waves = graph.add(
        "ShaderNodeTexWave",
        {"Vector": mapping, "Scale": 1.3, "Distortion": 6.0, "Detail": 2.0, "Detail Scale": 1.5},
    )
    streaks = graph.noise(mapping, inputs={"Scale": 3.0, "Detail": 3.0, "Distortion": 0.7})
    density = graph.math("MULTIPLY", graph.out(waves, "Fac"), graph.map_range(streaks, 0.4, 0.7))
    graph.finish(graph.principled(Density=graph.math("MULTIPLY", density, 2.0), Anisotropy=0.6))
    outline("cube", owner, scale=(4, 4, 0.2), location=(0, 0, 3))
    camera((0, -4, 0), (0, 1, 3), lens=24.0)
    sun(4.0, elevation=55.0, azimuth=60.0)
    world((0.15, 0.3, 0.7))


@file("planet-atmosphere", "a sphere whose density falls off with height, blue scattering, over nothing")
def planet(folder):
    owner, graph = material("Atmosphere")
    radius = graph.vector_math("LENGTH", graph.coordinates("Object"))
    height = graph.math("SUBTRACT", radius, 0.8)
    density = graph.math("POWER", math.e, graph.math("MULTIPLY", height, -14.0))
    inside = graph.math("GREATER_THAN", radius, 0.8)
    density = graph.math("MULTIPLY", graph.math("MULTIPLY", density, inside), 2.0)
    graph.finish(
        graph.add(
            "ShaderNodeVolumeScatter",
            {"Color": (0.18, 0.42, 1.0), "Density": density},
            phase="RAYLEIGH",
        )
    )
    outline("icosphere", owner, subdivisions=4)
    stage((0.0, 0.0, 0.0), location=(0, -4, 0.5))


@file("cotton-balls", "metaballs, a low homogeneous density with a white world")
def cotton(folder):
    data = bpy.data.metaballs.new("Cotton")
    data.resolution = data.render_resolution = 0.25
    for place, radius in (((0, 0, 0), 1.3), ((1.0, 0.3, 0.2), 1.0), ((-0.9, -0.2, 0.3), 1.1)):
        element = data.elements.new()
        element.co, element.radius = place, radius
    add_object("Cotton", data, homogeneous("Cotton", 2.0))
    stage((1.0, 1.0, 1.0), 0.5)


@file("smoke-ring", "a torus, a thin density with soft noise in Generated coordinates")
def smoke_ring(folder):
    owner, graph = material("Ring")
    wisps = graph.noise(graph.coordinates("Generated"), inputs={"Scale": 4.0, "Detail": 2.0})
    graph.finish(graph.principled(Density=graph.map_range(wisps, 0.3, 0.7, 0.0, 5.0)))
    outline("torus", owner, rotation=(0.9, 0.2, 0.0), major_segments=24, minor_segments=10)
    stage()


@file("suzanne-cloud", "a monkey of cloud, Voronoi in object coordinates")
def suzanne(folder):
    owner, graph = material("Monkey")
    cells = graph.voronoi(graph.coordinates("Object"), inputs={"Scale": 3.0})
    graph.finish(graph.principled(Density=graph.map_range(cells, 0.1, 0.6, 8.0, 1.0)))
    outline("monkey", owner, rotation=(0.2, 0.0, 0.5))
    stage(location=(0, -4, 0.5))


def word():
    """A text object of fog."""
    data = bpy.data.curves.new("Word", "FONT")
    data.body, data.extrude, data.resolution_u = "FOG", 0.2, 2
    data.align_x = data.align_y = "CENTER"
    return add_object("Word", data, homogeneous("Fog", 3.0), rotation=(math.pi / 2, 0, 0), scale=(2, 2, 2))


@file(
    "volumetric-text",
    "a word of fog: a text object, extruded, whose caps are flat and whose sides are smooth",
    differs="shaded smooth and others flat",
    documented="docs/mesh-outlines.md",
)
def text(folder):
    word()
    stage()


@file("text-of-flat-faces", "the same word as a mesh, shaded flat")
def flat_text(folder):
    item = word()
    evaluated = item.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = bpy.data.meshes.new_from_object(evaluated)
    mesh.polygons.foreach_set("use_smooth", [False] * len(mesh.polygons))
    # The mesh brings its material along.
    add_object("Letters", mesh, rotation=item.rotation_euler, scale=item.scale)
    bpy.data.objects.remove(item)
    stage()
