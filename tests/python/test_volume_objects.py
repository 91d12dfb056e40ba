"""What the program relies on when Cycles renders an OpenVDB grid (docs/volume-objects.md)."""

import math

import numpy as np
import pytest

from blend_support import requires_bpy

bpy = pytest.importorskip("bpy")

import volume_grid  # noqa: E402

pytestmark = requires_bpy

SPACING = 0.25
VOXELS = 8
PIXELS = 8
SAMPLES = 1024


def depth(folder, values, scale=(1.0, 1.0, 1.0), factor=1.0, x=0.8, material=None):
    """Optical depth along z through a cubic grid at the world place x, and its standard error."""
    path = folder / "grid.vdb"
    rows = np.diag([SPACING, SPACING, SPACING, 1.0])
    volume_grid.write(path, values.astype(np.float32), rows)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    volume = bpy.data.volumes.new("Volume")
    volume.filepath = str(path)
    volume.render.clipping = 0.0
    item = bpy.data.objects.new("Volume", volume)
    item.scale = scale
    scene.collection.objects.link(item)
    volume.materials.append((material or _absorption)(factor))
    camera = bpy.data.cameras.new("Camera")
    camera.type = "ORTHO"
    camera.ortho_scale = 0.02
    camera.clip_end = 1000.0
    scene.camera = bpy.data.objects.new("Camera", camera)
    scene.camera.location = (x * scale[0], 0.8 * scale[1], 100.0)
    scene.collection.objects.link(scene.camera)
    render = scene.render
    render.engine = "CYCLES"
    render.resolution_x = render.resolution_y = PIXELS
    render.film_transparent = True
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    render.image_settings.color_mode = "RGBA"
    render.filepath = str(folder / "picture.exr")
    scene.cycles.samples = SAMPLES
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.use_denoising = False
    bpy.ops.render.render(write_still=True)
    picture = bpy.data.images.load(render.filepath)
    alpha = np.array(picture.pixels[:]).reshape(-1, 4)[:, 3]
    through = 1.0 - alpha
    error = through.std(ddof=1) / math.sqrt(alpha.size)
    return -math.log(through.mean()), error / through.mean()


def _absorption(factor):
    material = bpy.data.materials.new("Material")
    material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    attribute = tree.nodes.new("ShaderNodeAttribute")
    attribute.attribute_name = "density"
    product = tree.nodes.new("ShaderNodeMath")
    product.operation = "MULTIPLY"
    product.inputs[1].default_value = factor
    absorption = tree.nodes.new("ShaderNodeVolumeAbsorption")
    absorption.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
    tree.links.new(product.inputs[0], attribute.outputs["Fac"])
    tree.links.new(absorption.inputs["Density"], product.outputs["Value"])
    tree.links.new(output.inputs["Volume"], absorption.outputs["Volume"])
    return material


def _principled(attribute):
    """A function that makes a black Principled Volume whose Density Attribute is `attribute`."""

    def make(density):
        material = bpy.data.materials.new("Material")
        tree = material.node_tree
        tree.nodes.clear()
        closure = tree.nodes.new("ShaderNodeVolumePrincipled")
        closure.inputs["Color"].default_value = (0.0, 0.0, 0.0, 1.0)
        closure.inputs["Density"].default_value = density
        closure.inputs["Density Attribute"].default_value = attribute
        output = tree.nodes.new("ShaderNodeOutputMaterial")
        tree.links.new(output.inputs["Volume"], closure.outputs["Volume"])
        # Without any light Cycles counts what scatters, even black, as nearly transparent.
        bpy.context.scene.world = bpy.data.worlds.new("World")
        return material

    return make


def block():
    """Values of 1: along z, 8 voxels of 0.25 make a depth of 2."""
    return np.ones((VOXELS,) * 3)


def assert_depth(found, expected):
    """Within four standard errors, which have to be small enough to tell a voxel's fade (0.125) from none."""
    value, error = found
    assert error < 0.02
    assert abs(value - expected) < 4.0 * error, (value, expected, error)


@pytest.mark.parametrize(
    ("scale", "length"),
    [((1.0, 1.0, 1.0), 2.0), ((2.0, 1.0, 1.0), 2.0), ((1.0, 1.0, 3.0), 6.0), ((2.0, 2.0, 2.0), 4.0)],
)
def test_a_block_fades_over_one_voxel_and_scales_with_the_diagonal(tmp_path, scale, length):
    divisor = math.sqrt(sum(part * part for part in scale) / 3.0)
    assert_depth(depth(tmp_path, block(), scale), length / divisor)


@pytest.mark.parametrize("value", [1e-9, 1e6])
def test_values_beyond_half_precision_come_through(tmp_path, value):
    assert_depth(depth(tmp_path, value * block(), factor=1.0 / value), 2.0)


def test_values_stand_at_their_indices(tmp_path):
    values = np.zeros((VOXELS,) * 3)
    values[4] = 1.0
    # The voxel 4 stands at x = 1; half a voxel on, its value is halved.
    assert_depth(depth(tmp_path, values, x=1.0), 2.0 * (1.0 - 0.005 / SPACING))
    assert_depth(depth(tmp_path, values, x=1.125), 1.0)


def test_principled_volume_multiplies_by_the_grid(tmp_path):
    assert_depth(depth(tmp_path, 0.5 * block(), factor=1.5, material=_principled("density")), 1.5)


@pytest.mark.parametrize("attribute", ["", "flame"])
def test_principled_volume_without_its_grid_shows_nothing(tmp_path, attribute):
    assert depth(tmp_path, block(), material=_principled(attribute))[0] == 0.0
