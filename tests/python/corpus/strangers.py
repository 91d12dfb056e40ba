"""What strangers' files hold besides clouds: things that are missing, hidden, broken or in Cycles' way.

Each is of a kind that public files showed, with contents of its own.
"""

import bpy

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

BLEND_FILES = "docs/blend-files.md"


def absorbing(name, density):
    """A material that absorbs alone: Cycles' picture of it has no noise but the world's and the lights'."""
    owner, graph = material(name)
    graph.finish(graph.add("ShaderNodeVolumeAbsorption", {"Color": (0, 0, 0), "Density": density}))
    return owner


def scattering(name="Haze", density=0.4, **inputs):
    """A material that scatters alone."""
    owner, graph = material(name)
    graph.finish(graph.add("ShaderNodeVolumeScatter", {"Density": density, **inputs}))
    return owner


# Cameras


@file("two-clouds-without-a-camera", "a small and a large cloud far apart, and no camera")
def two_clouds(folder):
    outline("icosphere", homogeneous("Small", 1.0), "Small", location=(3, 1, 0), subdivisions=1)
    outline("cube", homogeneous("Large", 0.2), "Large", location=(-6, 4, 2), scale=(3, 2, 1))
    sun()
    world()


@file("a-tall-frame-without-a-camera", "a column of fog in a frame of 1080 x 1920 pixels, and no camera")
def tall(folder):
    outline("cube", homogeneous("Column", 0.3), scale=(0.3, 0.3, 2.0))
    render = bpy.context.scene.render
    render.resolution_x, render.resolution_y = 1080, 1920
    sun()
    world()


@file("cameras-of-which-none-is-active", "three cameras, none of them the scene's")
def inactive(folder):
    outline("cube", homogeneous("Fog", 0.4))
    for number in range(3):
        camera(location=(number - 1, -5, 2)).name = f"View {number}"
    bpy.context.scene.camera = None
    sun()
    world()


# Volumes that are not shown


@file(
    "library-of-materials",
    "two materials on nothing, one of which is asked for",
    arguments=("--material", "Second"),
)
def library_of_materials(folder):
    for name, density in (("First", 1.0), ("Second", 0.3)):
        homogeneous(name, density, Color=(0.8, 0.6, 0.4, 1.0)).use_fake_user = True
    sun()
    world((0.2, 0.2, 0.3))


@file(
    "a-hidden-cloud",
    "the one cloud is hidden in renders",
    refused="hidden in renders",
    documented=BLEND_FILES,
)
def hidden(folder):
    outline("cube", homogeneous("Fog", 0.4)).hide_render = True
    stage()


@file("a-hidden-cloud-that-is-asked-for", "the same, shown", arguments=("--include-hidden",))
def hidden_shown(folder):
    hidden(folder)


@file("a-curve-without-faces", "a curve without depth has the volume material of the cube beside it")
def curve(folder):
    data = bpy.data.curves.new("Wire", "CURVE")
    data.dimensions = "3D"
    data.splines.new("POLY").points.add(3)
    owner = homogeneous("Fog", 0.4)
    add_object("Wire", data, owner, location=(0, 0, 2))
    outline("cube", owner)
    stage()


# What Blender's module breaks down at


def _domain(kind, owner, **where):
    item = outline("cube", owner, f"{kind.title()} domain", **where)
    fluid = item.modifiers.new("Fluid", "FLUID")
    fluid.fluid_type = "DOMAIN"
    fluid.domain_settings.domain_type = kind
    fluid.domain_settings.resolution_max = 16
    return item


@file("smoke-domain-beside-a-cloud", "a gas domain without a cache, and a cloud", apart=True)
def smoke_beside(folder):
    _domain("GAS", scattering("Smoke", 2.0), location=(1.5, 0, 0))
    outline("icosphere", scattering(), subdivisions=2, location=(-1, 0, 0))
    stage()


@file(
    "smoke-domain-alone", "a gas domain without a cache and nothing else: the world alone is seen", apart=True
)
def smoke_alone(folder):
    _domain("GAS", scattering("Smoke", 2.0))
    stage((0.4, 0.3, 0.2))


@file(
    "water-domain",
    "a liquid domain of water with a surface, which is hidden, and a cloud in Freestyle lines",
    apart=True,
)
def water(folder):
    _domain("LIQUID", None, location=(0, 3, 0)).hide_render = True
    outline("cube", scattering())
    bpy.context.scene.render.use_freestyle = True
    stage()


# What is missing


@file("lost-grid", "a Volume object whose file is gone, and a cube of fog")
def lost_grid(folder):
    data = bpy.data.volumes.new("Lost")
    data.filepath = "//lost/smoke_####.vdb"
    add_object("Lost", data, scattering("Smoke"))
    outline("cube", scattering("Fog", 0.3))
    stage()


@file("lost-sky", "a world of a picture that is gone, half dimmed by a Mix with grey")
def lost_sky(folder):
    outline("cube", scattering())
    camera()
    graph, background = world()
    picture = graph.add("ShaderNodeTexEnvironment")
    picture.image = bpy.data.images.new("sky", 4, 4)
    picture.image.source = "FILE"
    picture.image.filepath = "//lost/kloofendal_4k.exr"
    mix = graph.add("ShaderNodeMixRGB", {"Fac": 0.5, "Color1": picture.outputs[0], "Color2": (0.1, 0.1, 0.1)})
    graph.feed(background, "Color", mix.outputs[0])


def _library(folder, make):
    """Write what `make` gives to a library that goes away once it is linked; the linked data-blocks."""
    items = make()
    path = folder / "parts.blend"
    bpy.data.libraries.write(str(path), set(items))
    kinds = {
        bpy.types.Object: "objects",
        bpy.types.Material: "materials",
        bpy.types.ShaderNodeTree: "node_groups",
    }
    named = [(kinds[type(item)], item.name) for item in items]
    for item in items:
        bpy.data.batch_remove([item])
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        for kind, name in named:
            setattr(wanted, kind, [*getattr(wanted, kind), name])
    found = [getattr(bpy.data, kind)[name] for kind, name in named]
    path.unlink()
    return found


@file("lost-library-object", "an object of a library that is gone, beside a cloud of the file's own")
def lost_object(folder):
    def make():
        mesh = bpy.data.meshes.new("Far")
        return [bpy.data.objects.new("Far cloud", mesh)]

    (item,) = _library(folder, make)
    bpy.context.scene.collection.objects.link(item)
    outline("cube", scattering())
    stage()


@file("lost-library-group", "half of the density comes from a node group of a library that is gone")
def lost_group(folder):
    def make():
        tree, graph = group("Half")
        interface(tree, "OUTPUT", "Value")
        graph.add("NodeGroupOutput", {0: graph.add("ShaderNodeValue").outputs[0]})
        return [tree]

    (tree,) = _library(folder, make)
    owner, graph = material("Fog")
    call = graph.add("ShaderNodeGroup", node_tree=tree)
    density = graph.math("ADD", call.outputs[0], 0.35)
    graph.finish(graph.add("ShaderNodeVolumeScatter", {"Density": density}))
    outline("cube", owner)
    stage()


# Lights


def _lit(name, about, kind, energy, refused=None, location=(1.5, -2.0, 2.5), **properties):
    @file(name, about, samples=256, refused=refused, documented=BLEND_FILES)
    def lit(folder):
        outline("cube", scattering("Haze", 0.6))
        camera()
        world((0, 0, 0))
        light(kind, energy, location=location, target=(0, 0, 0), **properties)


_lit(
    "sun-without-shadow",
    "a sun that casts no shadow",
    "SUN",
    3.0,
    refused="use_shadow",
    use_shadow=False,
    angle=0.1,
)
_lit("spot-without-shadow", "a spot that casts no shadow, in the haze", "SPOT", 300.0, refused="use_shadow",
     location=(0.5, -0.5, 0.8), use_shadow=False, shadow_soft_size=0.1, spot_size=1.0)  # fmt: skip
_lit("softbox", "a rectangle of light whose spread is 40 degrees", "AREA", 200.0, refused="spread",
     shape="RECTANGLE", size=1.5, size_y=0.5, spread=0.7)  # fmt: skip
_lit(
    "dish",
    "a disk of light whose spread is 120 degrees",
    "AREA",
    200.0,
    refused="spread",
    shape="DISK",
    size=1.0,
    spread=2.1,
)
_lit(
    "square-spot",
    "a spot with a square cone",
    "SPOT",
    600.0,
    refused="use_square",
    use_square=True,
    spot_size=0.8,
    spot_blend=0.3,
)
_lit("hard-spot", "a spot whose source is a sphere with a hard edge", "SPOT", 600.0,
     refused="use_soft_falloff", use_soft_falloff=False, shadow_soft_size=0.4, spot_size=0.9)  # fmt: skip


def _lit_by_nodes(name, about, make, **properties):
    @file(name, about, samples=256, **properties)
    def lit(folder):
        outline("cube", scattering("Haze", 0.6))
        camera()
        world((0, 0, 0))
        lamp = light("POINT", 150.0, location=(1.2, -1.5, 1.8), shadow_soft_size=0.2).data
        lamp.use_nodes = True
        from corpus.parts import Graph

        graph = Graph(lamp.node_tree)
        make(graph, lamp.node_tree.nodes["Emission"])


def _candle(graph, emission):
    graph.feed(emission, "Color", graph.add("ShaderNodeBlackbody", {"Temperature": 1900.0}).outputs[0])


def _sum(graph, emission):
    value = graph.add("ShaderNodeValue")
    value.outputs[0].default_value = 0.7
    graph.feed(emission, "Strength", graph.math("MULTIPLY", value.outputs[0], 1.5))
    graph.feed(
        emission, "Color", graph.add("ShaderNodeGamma", {"Color": (0.4, 0.6, 0.9), "Gamma": 1.8}).outputs[0]
    )


def _gel(graph, emission):
    graph.feed(emission, "Color", graph.add("ShaderNodeTexCoord").outputs["Normal"])


_lit_by_nodes("candle-by-nodes", "a lamp whose colour is a Blackbody node", _candle)
_lit_by_nodes("lamp-of-computed-strength", "a lamp of a Value, a Math and a Gamma node", _sum)
_lit_by_nodes("gel-before-a-lamp", "a lamp whose colour depends on the direction", _gel,
              refused="ShaderNodeTexCoord", documented=BLEND_FILES)  # fmt: skip


@file("linked-light", "a lamp that is linked to one of two clouds, a shadow catcher, and a hidden shadow",
      refused="3 faults", documented=BLEND_FILES)  # fmt: skip
def linked_light(folder):
    chosen = bpy.data.collections.new("Chosen")
    outline("cube", scattering("Left"), "Left", location=(-1.5, 0, 0)).is_shadow_catcher = True
    outline("cube", scattering("Right"), "Right", location=(1.5, 0, 0)).visible_shadow = False
    stage()
    lamp = light("POINT", 50.0, location=(0, -2, 2))
    lamp.light_linking.receiver_collection = chosen


@file("lamp-posts", "a room lit by a surface that shines alone, which is left out: a black picture",
      left_out=("Tube",))  # fmt: skip
def tube(folder):
    outline("cube", scattering())
    owner, graph = material("Tube")
    graph.add("ShaderNodeOutputMaterial", {"Surface": graph.add("ShaderNodeEmission", {"Strength": 20.0})})
    outline("cylinder", owner, "Tube", location=(2, 0, 0), scale=(0.1, 0.1, 1))
    camera()
    world((0, 0, 0))


# Where Cycles is in the way


@file("bricks", "three cubes that touch, without a gap: Cycles never leaves the first",
      differs="their faces coincide", documented=BLEND_FILES)  # fmt: skip
def bricks(folder):
    for number in range(3):
        outline("cube", absorbing(f"Brick {number}", 0.2 + 0.1 * number), f"Brick {number}",
                location=(0, 2 * number, 0))  # fmt: skip
    stage((1, 1, 1))


@file("onion", "thirty-six shells of one centre: Cycles keeps 31 volumes at a place",
      differs="Cycles keeps 31", documented=BLEND_FILES)  # fmt: skip
def onion(folder):
    for number in range(36):
        outline("cube", absorbing(f"Shell {number}", 0.05), f"Shell {number}", scale=(1 - 0.02 * number,) * 3)
    stage((1, 1, 1))


# Graphs


@file("closure-in-a-number", "a closure is linked to the density, which Blender draws in red")
def red_link(folder):
    owner, graph = material("Fog")
    closure = graph.add("ShaderNodeVolumeScatter", {"Density": 0.45})
    graph.feed(closure, "Density", graph.add("ShaderNodeEmission").outputs[0])
    graph.finish(closure)
    outline("cube", owner)
    stage()


@file("bare-grid", "an OpenVDB file dragged into the scene: a Volume object without a material")
def bare_grid(folder):
    import numpy as np

    import volume_grid

    path = folder / "bare-grid.vdb"
    openvdb = volume_grid.library()
    grid = openvdb.FloatGrid()
    grid.name = "density"
    x = np.linspace(-1, 1, 16, dtype=np.float32)
    ball = x[:, None, None] ** 2 + x[None, :, None] ** 2 + x[None, None, :] ** 2
    grid.copyFromArray(np.where(ball < 1, 1.2 - ball, 0).astype(np.float32))
    grid.transform = openvdb.createLinearTransform(0.125)
    openvdb.write(str(path), [grid])
    data = bpy.data.volumes.new("Ball")
    data.filepath = "//bare-grid.vdb"
    add_object("Ball", data, location=(-1, -1, -1))
    stage()


@file("smoke-and-soot", "scattering and absorption of two noises, added: two closures", samples=128)
def two_closures(folder):
    owner, graph = material("Smoke")
    at = graph.coordinates()
    thick, thin = (graph.noise(at, inputs={"Scale": scale, "Detail": 1.0}) for scale in (2.0, 4.0))
    scatter = graph.add("ShaderNodeVolumeScatter", {"Density": thick, "Anisotropy": 0.3})
    soot = graph.add("ShaderNodeVolumeAbsorption", {"Density": thin, "Color": (0.2, 0.2, 0.2)})
    graph.finish(graph.add("ShaderNodeAddShader", {0: scatter, 1: soot}))
    outline("cube", owner)
    stage()


@file("spark", "thin haze that glows without a bound around a point: 0.02 over the distance", samples=256)
def spark(folder):
    owner, graph = material("Spark")
    distance = graph.vector_math("LENGTH", graph.coordinates())
    glow = graph.math("DIVIDE", 0.02, distance)
    graph.finish(graph.principled(Density=0.1, Emission_Strength=glow))
    outline("cube", owner)
    stage()


@file("galaxy", "a disk that glows by Dodge of two gradients", samples=256)
def galaxy(folder):
    owner, graph = material("Galaxy")
    at = graph.coordinates()
    sphere = graph.out(graph.add("ShaderNodeTexGradient", {"Vector": at}, gradient_type="SPHERICAL"), "Color")
    noise = graph.noise(at, inputs={"Scale": 3.0, "Detail": 1.0}, output="Color")
    mix = graph.add("ShaderNodeMixRGB", {"Fac": 0.6, "Color1": sphere, "Color2": noise}, blend_type="DODGE")
    graph.finish(graph.principled(Density=0.3, Emission_Color=mix.outputs[0], Emission_Strength=0.5))
    outline("cube", owner, scale=(1.5, 1.5, 0.3))
    stage()
