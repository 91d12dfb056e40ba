"""Fire, glow, light shafts, nebulae, ink."""

import math

from corpus.parts import add_object, camera, homogeneous, light, material, outline, stage, sun, world
from corpus.registry import file


@file("nebula", "emission, coloured absorption and scattering, added")
def nebula(folder):
    owner, graph = material("Nebula")
    place = graph.coordinates("Object")
    gas = graph.noise(place, inputs={"Scale": 1.4, "Detail": 3.0, "Distortion": 0.5})
    colour = graph.ramp(gas, (0.35, (0.02, 0.0, 0.1)), (0.5, (0.6, 0.05, 0.3)), (0.65, (0.1, 0.6, 0.9)))
    thick = graph.map_range(gas, 0.4, 0.7, 0.0, 1.5)
    shine = graph.add("ShaderNodeEmission", {"Color": colour, "Strength": graph.math("MULTIPLY", thick, 0.5)})
    soak = graph.add("ShaderNodeVolumeAbsorption", {"Color": (0.8, 0.4, 0.3), "Density": thick})
    dust = graph.add("ShaderNodeVolumeScatter", {"Color": (0.5, 0.6, 1.0), "Density": thick})
    both = graph.add("ShaderNodeAddShader", {0: shine, 1: soak})
    graph.finish(graph.add("ShaderNodeAddShader", {0: both, 1: dust}))
    outline("cube", owner, scale=(1.4, 1.4, 1.0))
    camera()
    light("POINT", 100.0, location=(0, 0, 0), shadow_soft_size=0.25, color=(1.0, 0.9, 0.8))
    world((0.0, 0.0, 0.0))


@file("god-rays", "a cone of light: a spot light in a homogeneous haze", samples=256)
def god_rays(folder):
    outline("cube", homogeneous("Haze", 0.08), scale=(3, 3, 3))
    camera((0, -10, 1))
    light("SPOT", 1500.0, location=(1.5, 0, 4.5), target=(0, 0, -2), spot_size=math.radians(30),
          spot_blend=0.3, shadow_soft_size=0.05)  # fmt: skip
    world((0.02, 0.02, 0.03))


@file("candle-glow", "a small light in thin smoke, with a flame of blackbody emission", samples=256)
def candle(folder):
    owner, graph = material("Flame")
    place = graph.coordinates("Object")
    away = graph.vector_math("LENGTH", graph.vector_math("MULTIPLY", place, (2.0, 2.0, 1.0)))
    core = graph.map_range(away, 0.0, 0.5, 1.0, 0.0)
    warm = graph.add("ShaderNodeBlackbody", {"Temperature": graph.map_range(core, 0.0, 1.0, 1200.0, 2100.0)})
    flame = graph.add("ShaderNodeEmission", {"Color": warm, "Strength": graph.math("MULTIPLY", core, 2.0)})
    smoke = graph.add("ShaderNodeVolumeScatter", {"Density": 0.15})
    graph.finish(graph.add("ShaderNodeAddShader", {0: flame, 1: smoke}))
    outline("cube", owner)
    camera()
    light("POINT", 30.0, location=(0, 0, 0.2), shadow_soft_size=0.02, color=(1.0, 0.5, 0.2))
    world((0.01, 0.01, 0.02))


@file(
    "fire", "Principled Volume with blackbody emission of a temperature that falls with height", samples=512
)
def fire(folder):
    owner, graph = material("Fire")
    place = graph.coordinates("Object")
    tongue = graph.noise(
        graph.add("ShaderNodeMapping", {"Vector": place, "Scale": (2.0, 2.0, 0.8)}).outputs[0],
        inputs={"Scale": 1.5, "Detail": 2.0},
    )
    heat = graph.math("MULTIPLY", graph.map_range(graph.axis(place, "Z"), -1.0, 1.0, 1.0, 0.0), tongue)
    hot = graph.map_range(heat, 0.1, 0.6, 500.0, 2200.0)
    thick = graph.map_range(heat, 0.1, 0.4, 0.0, 2.0)
    graph.finish(
        graph.principled(
            Density=thick,
            Color=(0.1, 0.1, 0.1),
            Blackbody_Intensity=1.0,
            Blackbody_Tint=(1.0, 0.9, 0.8),
            Temperature=hot,
        )
    )
    outline("cube", owner, scale=(0.8, 0.8, 1.5))
    camera()
    world((0.0, 0.0, 0.0))


@file("ink-in-water", "a cylinder of water: Mix Shader of clear and inked water by noise")
def ink(folder):
    owner, graph = material("Water")
    swirl = graph.noise(graph.coordinates("Object"), inputs={"Scale": 1.2, "Detail": 2.0, "Distortion": 2.0})
    clear = graph.add("ShaderNodeVolumeAbsorption", {"Color": (0.8, 0.95, 1.0), "Density": 0.2})
    inked = graph.principled(Density=4.0, Color=(0.05, 0.1, 0.5), Absorption_Color=(0.1, 0.2, 0.6))
    share = graph.map_range(swirl, 0.5, 0.6)
    graph.finish(graph.add("ShaderNodeMixShader", {"Fac": share, 1: clear, 2: inked}))
    outline("cylinder", owner, vertices=24)
    stage((0.6, 0.6, 0.6))


@file("stained-glass", "two coloured area lights, a rectangle and a disk, through a haze", samples=256)
def stained_glass(folder):
    outline("cube", homogeneous("Dust", 0.15, Anisotropy=0.2), scale=(2, 2, 2))
    camera((0, -8, 0.5))
    light("AREA", 120.0, "Red", location=(-3.5, 0.5, 1), target=(0, 0, 0), shape="RECTANGLE",
          size=1.5, size_y=0.5, color=(1.0, 0.1, 0.05))  # fmt: skip
    light("AREA", 100.0, "Blue", location=(2.8, 0, 2.9), target=(0, 0, -0.5), shape="DISK", size=1.0,
          color=(0.1, 0.3, 1.0))  # fmt: skip
    world((0.03, 0.03, 0.03))


@file("dust-motes", "White Noise in snapped cells, a few of them bright")
def dust(folder):
    owner, graph = material("Motes")
    cells = graph.vector_math("SNAP", graph.coordinates("Object"), (0.25, 0.25, 0.25))
    chance = graph.out(graph.add("ShaderNodeTexWhiteNoise", {"Vector": cells}), "Value")
    motes = graph.math("MULTIPLY", graph.math("GREATER_THAN", chance, 0.8), 3.0)
    graph.finish(graph.principled(Density=graph.math("ADD", motes, 0.05)))
    outline("cube", owner)
    stage((0.1, 0.1, 0.1))


@file(
    "light-beam-cone",
    "a mesh cone with emission that fades along its length: a faked spot light",
    samples=256,
)
def beam(folder):
    owner, graph = material("Beam")
    fade = graph.map_range(graph.axis(graph.coordinates("Generated"), "Z"), 0.0, 1.0, 0.0, 0.6)
    graph.finish(graph.add("ShaderNodeEmission", {"Color": (1.0, 0.9, 0.6), "Strength": fade}))
    outline("cone", owner, vertices=32, radius1=1.0, depth=3.0)
    camera()
    world((0.0, 0.0, 0.02))


@file("laser-show", "thin rotated boxes that glow and scatter, in a box of haze", samples=256)
def lasers(folder):
    outline("cube", homogeneous("Haze", 0.2), name="Haze", scale=(2, 1, 1))
    colours = ((1.0, 0.0, 0.05), (0.0, 1.0, 0.15), (0.1, 0.2, 1.0))
    for index, colour in enumerate(colours):
        beam = homogeneous(f"Laser {index}", 2.0, Emission_Strength=2.0, Emission_Color=colour)
        outline(
            "cube",
            beam,
            name=beam.name,
            scale=(0.12, 0.12, 1.5),
            rotation=(0.2 * index, 0.4 + 0.5 * index, 0.3),
        )
    camera()
    world((0.02, 0.02, 0.02))


@file("sunset-phases", "Mie droplets, Fournier-Forand plankton and Draine dust side by side")
def phases(folder):
    for index, settings in enumerate(
        (
            {"phase": "MIE", "inputs": {"Diameter": 12.0}},
            {"phase": "FOURNIER_FORAND", "inputs": {"IOR": 1.15, "Backscatter": 0.03}},
            {"phase": "DRAINE", "inputs": {"Anisotropy": 0.4, "Alpha": 0.6}},
        )
    ):
        owner, graph = material(settings["phase"].title())
        scatter = graph.add(
            "ShaderNodeVolumeScatter",
            {"Density": 1.0, "Color": (0.9, 0.8, 0.7)} | settings["inputs"],
            phase=settings["phase"],
        )
        graph.finish(scatter)
        outline("cube", owner, name=owner.name, location=(1.5 * index - 1.5, 0, 0), scale=(0.6, 0.6, 0.6))
    camera((0, -7, 1))
    sun(3.0, elevation=12.0, azimuth=75.0, color=(1.0, 0.6, 0.3))
    world((0.1, 0.1, 0.25))


@file("coefficients", "Volume Coefficients: milk by measured numbers")
def coefficients(folder):
    owner, graph = material("Milk")
    graph.finish(
        graph.add(
            "ShaderNodeVolumeCoefficients",
            {
                "Absorption Coefficients": (0.0015, 0.0046, 0.0199),
                "Scatter Coefficients": (2.55, 3.21, 3.77),
                "Anisotropy": 0.5,
            },
        )
    )
    outline("cylinder", owner, vertices=32)
    stage((0.4, 0.4, 0.4))


@file("glow-with-lamp-object", "a haze with a lamp mesh and a floor, which are surfaces and are left out",
      left_out=("Floor", "Lamp"))  # fmt: skip
def surfaces(folder):
    outline("cube", homogeneous("Haze", 0.3), scale=(2, 2, 1))
    outline("plane", None, name="Floor", scale=(10, 10, 1), location=(0, 0, -1.5))
    outline("icosphere", None, name="Lamp", scale=(0.2, 0.2, 0.2), location=(0, 0, 2))
    add_object("Note", None, location=(1, 1, 1))
    stage()
