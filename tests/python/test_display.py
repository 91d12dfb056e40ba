"""Display pictures against Blender's own PNG of the same render: at most 1/255 apart anywhere."""

import numpy as np
import pytest

from blend_support import Recorder, requires_bpy
from protocol import located

bpy = pytest.importorskip("bpy")
oiio = pytest.importorskip("OpenImageIO")
pytest.importorskip("PyOpenColorIO")

from blender_file import open_empty  # noqa: E402
from compare_images import display  # noqa: E402
from cycles_settings import apply_exr, apply_settings  # noqa: E402

pytestmark = requires_bpy

SIZE = 64
BRIGHTEST = 16.0  # radiance at the far corner of the plane, from dark over every hue to far beyond white


def ramp_material():
    """Emission by the place on the plane, ever more transparent to the right."""
    material = bpy.data.materials.new("Ramp")
    tree = material.node_tree
    tree.nodes.clear()

    def new(kind, **properties):
        item = tree.nodes.new(kind)
        for name, value in properties.items():
            setattr(item, name, value)
        return item

    place = new("ShaderNodeTexCoord")
    split = new("ShaderNodeSeparateXYZ")
    hue = new("ShaderNodeCombineColor", mode="HSV")
    hue.inputs["Green"].default_value = 0.8
    power = new("ShaderNodeMath", operation="POWER")
    power.inputs[0].default_value = 1000.0
    strength = new("ShaderNodeMath", operation="MULTIPLY")
    strength.inputs[1].default_value = BRIGHTEST / 1000
    emission, clear = new("ShaderNodeEmission"), new("ShaderNodeBsdfTransparent")
    mix, output = new("ShaderNodeMixShader"), new("ShaderNodeOutputMaterial")
    hue.inputs["Blue"].default_value = 1.0
    for source, target in (
        (place.outputs["Generated"], split.inputs[0]),
        (split.outputs["X"], hue.inputs["Red"]),
        (split.outputs["Y"], power.inputs[1]),
        (power.outputs[0], strength.inputs[0]),
        (hue.outputs[0], emission.inputs["Color"]),
        (strength.outputs[0], emission.inputs["Strength"]),
        (split.outputs["X"], mix.inputs[0]),
        (emission.outputs[0], mix.inputs[1]),
        (clear.outputs[0], mix.inputs[2]),
        (mix.outputs[0], output.inputs["Surface"]),
    ):
        tree.links.new(source, target)
    return material


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """The EXR of a plane with every hue, 4 decades of radiance and every alpha; its render stays open."""
    open_empty()
    target = bpy.context.scene
    apply_settings(target, 4, 1, 0)
    target.render.film_transparent = True
    target.render.resolution_x = target.render.resolution_y = SIZE
    target.render.resolution_percentage = 100
    bpy.ops.mesh.primitive_plane_add(size=1.8)
    bpy.context.object.data.materials.append(ramp_material())
    camera = bpy.data.cameras.new("Camera")
    camera.type, camera.ortho_scale = "ORTHO", 2.0
    target.camera = bpy.data.objects.new("Camera", camera)
    target.camera.location = (0, 0, 3)
    target.collection.objects.link(target.camera)
    bpy.ops.render.render()
    apply_exr(target.render.image_settings, False, "ZIP")
    path = tmp_path_factory.mktemp("display") / "ramp.exr"
    bpy.data.images["Render Result"].save_render(str(path), scene=target)
    pixels = oiio.ImageBuf(str(path)).get_pixels(oiio.FLOAT)
    assert pixels[..., :3].max() > 8 and 0 < (pixels[..., 3] == 0).mean() < 0.5
    assert np.unique(pixels[..., 3]).size > 30
    return path


def blenders(path, channels, view, look, exposure, gamma):
    """Blender's own 8-bit PNG of the render, uint8 [h, w, c]."""
    target = bpy.context.scene
    settings = target.render.image_settings
    settings.media_type, settings.file_format = "IMAGE", "PNG"
    settings.color_mode, settings.color_depth = channels.upper(), "8"
    target.view_settings.view_transform, target.view_settings.look = view, look
    target.view_settings.exposure, target.view_settings.gamma = exposure, gamma
    bpy.data.images["Render Result"].save_render(str(path), scene=target)
    return bytes_of(path)


def bytes_of(path):
    """The stored bytes of a PNG: straight alpha, as the file has it."""
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    file = oiio.ImageInput.open(str(path), config)
    pixels = np.asarray(file.read_image(0, 0, 0, file.spec().nchannels, oiio.UINT8))
    pixels = pixels.reshape(file.spec().height, file.spec().width, -1)
    file.close()
    return pixels


@pytest.mark.parametrize("channels", ["rgb", "rgba"])
@pytest.mark.parametrize(
    ("view", "look", "exposure", "gamma"),
    [
        ("AgX", "None", 0.0, 1.0),
        ("Standard", "None", 0.0, 1.0),
        ("AgX", "AgX - Punchy", 1.0, 1.0),
        ("Standard", "None", -1.0, 2.2),
        ("Filmic", "None", 0.0, 1.0),
    ],
)
def test_our_png_is_blenders(tmp_path, rendered, channels, view, look, exposure, gamma):
    chosen = {"view": view, "look": look, "exposure": exposure, "gamma": gamma}
    expected = blenders(tmp_path / "blender.png", channels, **chosen).astype(int)
    item = {"exr": str(rendered), "png": str(tmp_path / "ours.png"), "channels": channels} | chosen
    result = display(located({"images": [item]}, "request"), Recorder())["images"][0]
    assert result["view_used"] == f"{view}, look {look}"
    found = bytes_of(tmp_path / "ours.png").astype(int)
    assert found.shape == expected.shape == (SIZE, SIZE, len(channels))
    # 1 of 255: both round, and the processors add in another order. Without alpha a pixel has no colour.
    apart = np.abs(found - expected)
    if channels == "rgba":
        apart = apart[expected[..., 3] > 0]
    assert apart.max() <= 1, f"{(apart > 1).sum()} values, at most {apart.max()}"
    assert (apart > 0).mean() < 0.01
