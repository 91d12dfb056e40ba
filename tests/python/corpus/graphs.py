"""What node trees of real files hold: all textures and colour nodes, groups, muted things, old nodes."""

import bpy

from corpus.parts import add_object, group, interface, material, outline, stage
from corpus.registry import file

RAMPS = ("LINEAR", "EASE", "CONSTANT", "CARDINAL", "B_SPLINE")


def _blended(graph, values, weight):
    """The sum of outputs, each times `weight`."""
    total = None
    for value in values:
        scaled = graph.math("MULTIPLY", value, weight)
        total = scaled if total is None else graph.math("ADD", total, scaled)
    return total


@file("tiles", "Checker, Brick and Magic as densities")
def tiles(folder):
    owner, graph = material("Tiles")
    place = graph.coordinates("Object")
    checks = graph.add("ShaderNodeTexChecker", {"Vector": place, "Scale": 3.0})
    bricks = graph.add("ShaderNodeTexBrick", {"Vector": place, "Scale": 2.0, "Mortar Size": 0.05})
    magic = graph.add("ShaderNodeTexMagic", {"Vector": place, "Scale": 2.0}, turbulence_depth=3)
    colour = graph.out(magic, "Color")
    density = _blended(graph, [graph.out(checks, "Fac"), graph.out(bricks, "Fac")], 1.0)
    graph.finish(graph.principled(Density=density, Color=colour))
    outline("cube", owner)
    stage()


@file("musgrave-noises", "the noise types that were the Musgrave Texture: fBM to ridged multifractal")
def musgrave(folder):
    owner, graph = material("Musgrave")
    place = graph.coordinates("Object")
    types = ("FBM", "MULTIFRACTAL", "HETERO_TERRAIN", "RIDGED_MULTIFRACTAL", "HYBRID_MULTIFRACTAL")
    values = [
        graph.noise(
            place,
            inputs={"Scale": 1.0, "Detail": 1.5, "Lacunarity": 2.1}
            | ({} if kind in ("FBM", "MULTIFRACTAL") else {"Offset": 0.3})
            | ({"Gain": 1.2} if kind in ("RIDGED_MULTIFRACTAL", "HYBRID_MULTIFRACTAL") else {}),
            noise_type=kind,
            normalize=kind == "FBM",
        )
        for kind in types
    ]
    graph.finish(graph.principled(Density=graph.math("MAXIMUM", _blended(graph, values, 0.4), 0.0)))
    outline("cube", owner)
    stage()


@file("gabor-stripes", "Gabor Texture, brushed stripes in three dimensions")
def gabor(folder):
    owner, graph = material("Gabor")
    stripes = graph.add(
        "ShaderNodeTexGabor",
        {
            "Vector": graph.coordinates("Object"),
            "Scale": 1.5,
            "Frequency": 1.5,
            "Orientation 3D": (0.5, 1, 0.2),
        },
        gabor_type="3D",
    )
    graph.finish(graph.principled(Density=graph.map_range(graph.out(stripes, "Value"), 0.4, 0.7, 0.0, 2.0)))
    outline("cube", owner)
    stage()


@file("voronoi-metrics", "Voronoi with every metric, F2, distance to edge and sphere radius")
def voronoi(folder):
    owner, graph = material("Cells")
    place = graph.coordinates("Object")
    values = [
        graph.voronoi(place, inputs={"Scale": 1.5}, distance="MANHATTAN"),
        graph.voronoi(place, inputs={"Scale": 1.2}, distance="CHEBYCHEV", feature="F2"),
        graph.voronoi(place, inputs={"Scale": 1.1, "Exponent": 1.5}, distance="MINKOWSKI"),
        graph.voronoi(place, inputs={"Scale": 2.0}, feature="DISTANCE_TO_EDGE"),
        graph.voronoi(place, output="Radius", inputs={"Scale": 1.3}, feature="N_SPHERE_RADIUS"),
    ]
    graph.finish(graph.principled(Density=_blended(graph, values, 0.4)))
    outline("cube", owner)
    stage()


@file("animated-w", "4D noise whose W is keyframed, saved in the middle of the animation")
def animated(folder):
    owner, graph = material("Flow")
    node = graph.add(
        "ShaderNodeTexNoise",
        {"Vector": graph.coordinates("Object"), "W": 0.0, "Scale": 1.5, "Detail": 1.0},
        noise_dimensions="4D",
    )
    socket = graph.socket(node.inputs, "W")
    for frame, value in ((1, 0.0), (50, 2.0)):
        socket.default_value = value
        socket.keyframe_insert("default_value", frame=frame)
    graph.finish(graph.principled(Density=graph.map_range(graph.out(node, "Fac"), 0.4, 0.7, 0.0, 3.0)))
    outline("cube", owner)
    stage()
    bpy.context.scene.frame_set(20)


@file("driven-w", "4D noise whose W is driven by the frame, `frame / 24`")
def driven(folder):
    owner, graph = material("Flow")
    node = graph.add(
        "ShaderNodeTexNoise",
        {"Vector": graph.coordinates("Object"), "Scale": 1.5, "Detail": 1.0},
        noise_dimensions="4D",
    )
    graph.socket(node.inputs, "W").driver_add("default_value").driver.expression = "frame / 24"
    graph.finish(graph.principled(Density=graph.map_range(graph.out(node, "Fac"), 0.4, 0.7, 0.0, 3.0)))
    outline("cube", owner)
    stage()
    bpy.context.scene.frame_set(30)


@file("coordinates-of-an-empty", "Texture Coordinate of another object: an empty that moves the cloud")
def other_object(folder):
    empty = add_object(
        "Handle", None, location=(0.4, 0.1, 0.2), rotation=(0.2, 0.5, 0.1), scale=(1.5, 1, 0.7)
    )
    owner, graph = material("Ball")
    away = graph.vector_math("LENGTH", graph.coordinates("Object", object=empty))
    graph.finish(graph.principled(Density=graph.map_range(away, 0.2, 0.9, 4.0, 0.0)))
    outline("cube", owner)
    stage()


@file("unlinked-coordinates", "textures without a link at Vector, on a sphere that is off its origin")
def unlinked(folder):
    owner, graph = material("Default")
    noise = graph.noise(inputs={"Scale": 3.0, "Detail": 1.0})
    cells = graph.voronoi(inputs={"Scale": 2.5})
    waves = graph.out(graph.add("ShaderNodeTexWave", {"Scale": 1.0}), "Fac")
    fall = graph.out(graph.add("ShaderNodeTexGradient", gradient_type="QUADRATIC"), "Fac")
    graph.finish(graph.principled(Density=_blended(graph, [noise, cells, waves, fall], 1.0)))
    item = outline("icosphere", owner, subdivisions=3)
    for vertex in item.data.vertices:
        vertex.co.x = 1.5 * vertex.co.x + 0.5
    item.location.x = -0.5
    stage()


@file("muted-and-framed", "muted nodes and links, reroutes in a row, frames, a collapsed node")
def muted(folder):
    owner, graph = material("Untidy")
    frame = graph.add("NodeFrame", label="Shape", name="Shape")
    place = graph.coordinates("Object")
    mapping = graph.add("ShaderNodeMapping", {"Vector": place, "Scale": (3.0, 3.0, 3.0)}, mute=True)
    first = graph.add("NodeReroute", {0: mapping.outputs[0]})
    second = graph.add("NodeReroute", {0: first.outputs[0]})
    noise = graph.add("ShaderNodeTexNoise", {"Vector": second.outputs[0], "Scale": 2.0})
    noise.parent, noise.hide = frame, True
    steps = graph.add("ShaderNodeMath", {0: noise.outputs[0], 1: 0.25}, operation="SNAP", mute=True)
    density = graph.add("ShaderNodeMath", {0: steps.outputs[0], 1: 1.5}, operation="MULTIPLY")
    tint = graph.add(
        "ShaderNodeMix", {"A_Color": (1, 0, 0), "B_Color": (0, 1, 0)}, data_type="RGBA", mute=True
    )
    volume = graph.principled(Density=density, Color=graph.out(tint, "Result_Color"))
    graph.feed(volume, "Anisotropy", noise.outputs[0]).is_muted = True
    orphan = graph.add("NodeReroute")
    graph.feed(volume, "Emission Strength", orphan.outputs[0])
    graph.finish(volume)
    outline("cube", owner)
    stage()


@file("nested-groups", "groups three deep, with inputs passed on and overridden, one group used twice")
def nested(folder):
    innermost, inner = group("Puff")
    interface(innermost, "INPUT", "Vector", "NodeSocketVector")
    interface(innermost, "INPUT", "Size", default=2.0)
    interface(innermost, "OUTPUT", "Value")
    given = inner.add("NodeGroupInput")
    noise = inner.noise(inner.out(given, "Vector"), inputs={"Scale": inner.out(given, "Size"), "Detail": 1.0})
    inner.add("NodeGroupOutput", {"Value": noise})

    middle, graph = group("Two Puffs")
    interface(middle, "INPUT", "Size", default=1.0)
    interface(middle, "OUTPUT", "Value")
    given = graph.add("NodeGroupInput")
    place = graph.coordinates("Object")
    small = graph.add("ShaderNodeGroup", node_tree=innermost)
    graph.feed(small, "Vector", place)
    graph.feed(small, "Size", graph.math("MULTIPLY", graph.out(given, "Size"), 3.0))
    large = graph.add("ShaderNodeGroup", node_tree=innermost)
    graph.feed(large, "Vector", place)
    graph.add("NodeGroupOutput", {"Value": graph.math("MULTIPLY", small.outputs[0], large.outputs[0])})

    outermost, graph = group("Cloud Shader")
    interface(outermost, "INPUT", "Size", default=0.5)
    interface(outermost, "INPUT", "Tint", "NodeSocketColor", (1.0, 1.0, 1.0, 1.0))
    interface(outermost, "OUTPUT", "Volume", "NodeSocketShader")
    given = graph.add("NodeGroupInput")
    again = graph.add("NodeGroupInput")
    puffs = graph.add("ShaderNodeGroup", node_tree=middle)
    graph.feed(puffs, "Size", graph.out(given, "Size"))
    density = graph.map_range(puffs.outputs[0], 0.2, 0.35, 0.0, 3.0)
    volume = graph.principled(Density=density, Color=graph.out(again, "Tint"))
    graph.add("NodeGroupOutput", {"Volume": volume})

    owner, graph = material("Grouped")
    cloud = graph.add("ShaderNodeGroup", node_tree=outermost)
    graph.feed(cloud, "Size", 0.8)
    graph.feed(cloud, "Tint", (0.9, 0.7, 0.5, 1.0))
    graph.finish(cloud)
    outline("cube", owner)
    stage()


@file("leftovers", "unused nodes of refused kinds, an inactive output, a surface shader beside the volume")
def leftovers(folder):
    owner, graph = material("Leftovers")
    density = graph.noise(graph.coordinates("Object"), inputs={"Scale": 2.0, "Detail": 1.0})
    volume = graph.principled(Density=density)
    picture = graph.add("ShaderNodeTexImage")
    graph.add("ShaderNodeBump", {"Height": picture})
    graph.add("ShaderNodeLightPath")
    graph.add("ShaderNodeMath", {0: graph.add("ShaderNodeLayerWeight").outputs[0]})
    idle = graph.add("ShaderNodeOutputMaterial", {"Volume": graph.add("ShaderNodeEmission")})
    graph.finish(volume).is_active_output = True
    idle.is_active_output = False
    outline("cube", owner)
    stage()


@file("old-nodes", "MixRGB in several modes, a Math node that clamps, textures with a mapping of their own")
def old_nodes(folder):
    owner, graph = material("Old")
    noise = graph.add("ShaderNodeTexNoise", {"Vector": graph.coordinates("Object"), "Scale": 1.0})
    mapping = noise.texture_mapping
    mapping.scale, mapping.translation, mapping.rotation = (1.5, 1.0, 2.0), (0.2, 0.0, 0.1), (0.0, 0.3, 0.0)
    mapping.mapping_x, mapping.mapping_y = "Y", "X"
    colour = graph.out(noise, "Color")
    for kind, second in (
        ("OVERLAY", (0.8, 0.4, 0.2)),
        ("DODGE", (0.1, 0.1, 0.1)),
        ("SATURATION", (0.9, 0.2, 0.2)),
    ):
        colour = graph.add(
            "ShaderNodeMixRGB",
            {"Fac": 0.7, "Color1": colour, "Color2": second},
            blend_type=kind,
            use_clamp=kind == "DODGE",
        ).outputs[0]
    density = graph.math("SUBTRACT", graph.out(noise, "Fac"), 0.35, use_clamp=True)
    graph.finish(graph.principled(Density=graph.math("MULTIPLY", density, 6.0), Color=colour))
    outline("cube", owner)
    stage()


@file("curves", "Float Curve, RGB Curves and Vector Curves, bent by hand")
def curves(folder):
    owner, graph = material("Curves")
    bend = graph.add("ShaderNodeVectorCurve", {"Vector": graph.coordinates("Object")})
    bend.mapping.curves[0].points.new(0.2, -0.3)
    noise = graph.noise(bend.outputs[0], "Color", {"Scale": 2.0, "Detail": 1.0})
    colours = graph.add("ShaderNodeRGBCurve", {"Color": noise})
    colours.mapping.curves[0].points.new(0.4, 0.7)
    colours.mapping.curves[3].points.new(0.6, 0.4).handle_type = "VECTOR"
    shape = graph.add("ShaderNodeFloatCurve", {"Value": graph.axis(noise, "X")})
    shape.mapping.extend = "HORIZONTAL"
    shape.mapping.curves[0].points.new(0.5, 0.1)
    for node in (bend, colours, shape):
        node.mapping.update()
    density = graph.math("MULTIPLY", shape.outputs[0], 4.0)
    graph.finish(graph.principled(Density=density, Color=colours.outputs[0]))
    outline("cube", owner)
    stage()


@file("ramps", "Color Ramps with every interpolation, and in HSV and HSL")
def ramps(folder):
    owner, graph = material("Ramps")
    place = graph.coordinates("Generated")
    noise = graph.noise(place, inputs={"Scale": 3.0, "Detail": 1.0})
    stops = ((0.3, 0.0), (0.45, 0.8), (0.6, 0.2), (0.8, 1.0))
    values = [graph.ramp(noise, *stops, interpolation=kind) for kind in RAMPS]
    ends = ((0.2, (0.9, 0.2, 0.1)), (0.8, (0.1, 0.3, 0.9)))
    near = graph.ramp(noise, *ends, color_mode="HSV", hue_interpolation="NEAR")
    far = graph.ramp(noise, *ends, color_mode="HSL", hue_interpolation="CW")
    colour = graph.add(
        "ShaderNodeMix", {"Factor_Float": 0.5, "A_Color": near, "B_Color": far}, data_type="RGBA"
    )
    density = _blended(graph, values, 0.6)
    graph.finish(graph.principled(Density=density, Color=graph.out(colour, "Result_Color")))
    outline("cube", owner)
    stage()


@file("vector-play", "Vector Math, Vector Rotate, and Mapping of all four types in a row")
def vectors(folder):
    owner, graph = material("Vectors")
    place = graph.coordinates("Object")
    for kind in ("POINT", "TEXTURE", "VECTOR", "NORMAL"):
        given = {"Vector": place, "Rotation": (0.3, 0.2, 0.1), "Scale": (1.2, 0.8, 1.5)}
        if kind in ("POINT", "TEXTURE"):
            given["Location"] = (0.2, -0.1, 0.3)
        place = graph.add("ShaderNodeMapping", given, vector_type=kind).outputs[0]
        if kind == "VECTOR":
            first = place
    turned = graph.add(
        "ShaderNodeVectorRotate",
        {"Vector": first, "Axis": (1, 1, 0), "Angle": 0.7},
        rotation_type="AXIS_ANGLE",
    ).outputs[0]
    reflected = graph.vector_math("REFLECT", turned, place)
    wrapped = graph.vector_math("FRACTION", graph.vector_math("SCALE", reflected, 1.7))
    crossed = graph.vector_math("CROSS_PRODUCT", wrapped, (0.3, 0.5, 0.9))
    density = graph.vector_math("DISTANCE", crossed, turned)
    graph.finish(graph.principled(Density=density))
    outline("cube", owner)
    stage()


@file(
    "colour-chain", "Hue/Saturation, Brightness/Contrast, Gamma, Invert, Separate and Combine in HSV and HSL"
)
def colours(folder):
    owner, graph = material("Colours")
    colour = graph.noise(graph.coordinates("Object"), "Color", {"Scale": 2.0, "Detail": 1.0})
    colour = graph.add("ShaderNodeHueSaturation", {"Hue": 0.7, "Saturation": 1.5, "Color": colour})
    colour = graph.add("ShaderNodeBrightContrast", {"Color": colour, "Contrast": 0.3})
    colour = graph.add("ShaderNodeGamma", {"Color": colour, "Gamma": 1.3})
    colour = graph.add("ShaderNodeInvert", {"Color": colour, "Fac": 0.6})
    parts = graph.add("ShaderNodeSeparateColor", {"Color": colour}, mode="HSV")
    whole = graph.add(
        "ShaderNodeCombineColor",
        {"Red": parts.outputs[0], "Green": 0.4, "Blue": parts.outputs[2]},
        mode="HSL",
    )
    grey = graph.add("ShaderNodeRGBToBW", {"Color": whole})
    graph.finish(graph.principled(Density=graph.math("MULTIPLY", grey.outputs[0], 4.0), Color=whole))
    outline("cube", owner)
    stage()


@file("random-per-object", "Object Info: one material, three objects that differ by Random, Color and index")
def object_info(folder):
    owner, graph = material("Each")
    info = graph.add("ShaderNodeObjectInfo")
    density = graph.math("ADD", graph.out(info, "Random"), graph.out(info, "Object Index"))
    graph.finish(graph.principled(Density=density, Color=graph.out(info, "Color")))
    for index in range(3):
        item = outline("cube", owner, f"Puff {index}", location=(1.3 * index - 1.3, 0, 0), scale=(0.5,) * 3)
        item.color = (0.9 - 0.3 * index, 0.5, 0.3 + 0.3 * index, 1.0)
        item.pass_index = index
    stage()


@file("no-density", "a density of 0 with emission, beside a cloud of negative density, which counts as 0")
def negative(folder):
    owner, graph = material("Glow")
    graph.finish(graph.principled(Density=0.0, Emission_Strength=0.2, Emission_Color=(0.2, 1.0, 0.5)))
    outline("cube", owner, "Glow", location=(-0.7, 0, 0), scale=(0.5,) * 3)
    owner, graph = material("Negative")
    noise = graph.noise(graph.coordinates("Object"), inputs={"Scale": 1.5})
    density = graph.math("MULTIPLY", graph.math("SUBTRACT", noise, 0.5), 12.0)
    graph.finish(graph.add("ShaderNodeVolumeScatter", {"Density": density}))
    outline("cube", owner, "Negative", location=(0.7, 0, 0), scale=(0.6,) * 3)
    stage()


@file("value-as-closure", "a colour linked straight to Volume, which Blender lets shine")
def value_as_closure(folder):
    owner, graph = material("Shine")
    graph.finish(graph.noise(graph.coordinates("Object"), "Color", {"Scale": 2.0, "Detail": 1.0}))
    outline("cube", owner)
    stage()
