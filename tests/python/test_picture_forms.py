"""One picture in the forms that people have: the same pixels, or a reason with what would compare them.

Every file is made here by OpenImageIO, or byte by byte where it writes no such file; the pairs of the faults'
folder are read where it is there.
"""

import itertools
import json
import os
import pathlib
import struct

import numpy as np
import OpenImageIO as oiio
import pytest

import picture_file
from test_compare_images import HEIGHT, WIDTH, diff, picture, run, save

FAULTS = pathlib.Path(__file__).resolve().parents[3] / "shared" / "faults" / "exr"
EXACT = {"max_error": 0.0, "alpha_max_error": 0.0}
COLOURS = {"max_error": 0.0}
VIEW = {"view": "AgX", "look": "None", "exposure": 1, "gamma": 1, "background": None}
HALF = 2.0**-11  # half's relative rounding error


def write(path, parts, **attributes):
    """Write parts [(name or None, pixels, channels, storage)] to one file."""
    specs = []
    for name, pixels, channels, storage in parts:
        spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], storage)
        spec.channelnames = channels
        if name is not None:
            spec.attribute("oiio:subimagename", name)
        for key, value in attributes.items():
            if hasattr(spec, key):
                setattr(spec, key, value)
            else:
                spec.attribute(key, value)
        specs.append(spec)
    output = oiio.ImageOutput.create(str(path))
    opened = output.open(str(path), tuple(specs)) if len(specs) > 1 else output.open(str(path), specs[0])
    assert opened, output.geterror()
    for index, (_, pixels, _, _) in enumerate(parts):
        if index:
            assert output.open(str(path), specs[index], "AppendSubimage"), output.geterror()
        written = output.write_image(np.ascontiguousarray(pixels))
        assert written, output.geterror()
    output.close()
    return str(path)


def names(prefix, channels="RGBA"):
    """Channel names of a layer."""
    return tuple(f"{prefix}.{channel}" for channel in channels)


def agrees(ours, reference, limits=EXACT, **more):
    """Both orders agree; returns the result of the first."""
    back = diff([reference], [ours], tolerances=limits, **more)
    result = diff([ours], [reference], tolerances=limits, **more)
    assert result["verdict"] == back["verdict"] == "agrees", (result["reasons"], back["reasons"])
    return result


def reason(ours, reference, **more):
    """Why a pair cannot be compared."""
    result = diff([ours], [reference], **more)
    assert result["verdict"] == "could_not_tell" and result["colour"] is None
    return result["reasons"][0]


@pytest.fixture
def plain(tmp_path):
    """The picture as a plain file."""
    return save(tmp_path / "plain.exr", picture())


@pytest.mark.skipif(not FAULTS.is_dir(), reason=f"no folder {FAULTS}")
def test_every_pair_of_the_faults_is_compared():
    paths = sorted(FAULTS.glob("*.exr"))
    assert len(paths) == 7
    for ours, reference in itertools.product(paths, paths):
        result = diff([str(ours)], [str(reference)], tolerances=COLOURS)
        same = ours.name.startswith("blender") == reference.name.startswith("blender")
        assert result["verdict"] == ("agrees" if same else "differs"), (ours, reference, result["reasons"])


def test_a_named_layer_of_several_in_one_part(tmp_path, plain):
    pixels = np.concatenate([picture() * 2, picture(), picture()[..., :1]], -1)
    channels = names("ViewLayer.Combined") + names("ViewLayer.DiffDir") + ("ViewLayer.Depth.Z",)
    layers = write(tmp_path / "layers.exr", [(None, pixels, channels, "float")])
    result = diff([layers], [plain], tolerances=EXACT, ours_part="DiffDir")
    assert result["verdict"] == "agrees"
    assert result["images"]["ours"]["picture"] == "ViewLayer.DiffDir"
    assert any("1 of 3 in the file" in note for note in result["notes"])
    assert diff([plain], [layers], tolerances=EXACT, reference_part="DiffDir")["verdict"] == "agrees"
    assert diff([layers], [plain], tolerances=EXACT)["verdict"] == "differs"
    assert "'ViewLayer.Depth'" in reason(layers, plain, ours_part="Mist")


def test_two_combined_ask_for_a_name_of_the_right_side(tmp_path, plain):
    parts = [("A.Combined", picture(), names("A.Combined"), "float")]
    parts.append(("B.Combined", picture() * 2, names("B.Combined"), "float"))
    path = write(tmp_path / "two.exr", parts)
    assert "--reference-part NAME" in reason(plain, path) and "'B.Combined'" in reason(plain, path)
    assert "--ours-part NAME" in reason(path, plain)
    assert diff([path], [plain], tolerances=EXACT, ours_part="A")["verdict"] == "agrees"
    assert diff([path], [plain], tolerances=EXACT, part="B.Combined")["verdict"] == "could_not_tell"


def test_unprefixed_channels_of_named_parts(tmp_path, plain):
    depth = picture()[..., :1]
    path = write(
        tmp_path / "parts.exr",
        [("depth", depth, ("Z",), "float"), ("rgba", picture(), ("R", "G", "B", "A"), "float")],
    )
    agrees(path, plain)


def test_a_data_window_larger_than_and_beside_the_display_window(tmp_path, plain):
    wide = np.full((HEIGHT + 6, WIDTH + 8, 4), 9.0, np.float32)
    wide[3:-3, 4:-4] = picture()
    window = {"x": -4, "y": -3, "full_x": 0, "full_y": 0, "full_width": WIDTH, "full_height": HEIGHT}
    path = write(tmp_path / "overscan.exr", [(None, wide, tuple("RGBA"), "float")], **window)
    result = agrees(path, plain)
    assert any("outside the display window" in note for note in result["notes"])
    # The lit disc has columns 8 to 32 of 40; a window of the right half lacks the left.
    half = {"x": 20, "y": 0, "full_x": 0, "full_y": 0, "full_width": WIDTH, "full_height": HEIGHT}
    path = write(tmp_path / "half.exr", [(None, picture()[:, 20:], tuple("RGBA"), "float")], **half)
    expected = picture()
    expected[:, :20] = 0
    assert np.array_equal(picture_file.read(path).pixels, expected)


def test_display_windows_of_another_origin_and_size(tmp_path, plain):
    moved = {"x": 100, "y": 50, "full_x": 100, "full_y": 50, "full_width": WIDTH, "full_height": HEIGHT}
    path = write(tmp_path / "moved.exr", [(None, picture(), tuple("RGBA"), "float")], **moved)
    result = agrees(path, plain)
    assert any("(100, 50)" in note for note in result["notes"])
    small = save(tmp_path / "small.exr", picture()[:20])
    assert "40 x 20" in reason(small, plain)


def test_half_floats_differ_by_their_rounding_alone(tmp_path, plain):
    path = write(tmp_path / "half.exr", [(None, picture(), tuple("RGBA"), "half")])
    result = agrees(path, plain, {"max_error": HALF, "alpha_max_error": HALF})
    assert result["colour"]["max_error"] > 0


def test_luminance_alone_is_compared_with_the_luminance_of_colours(tmp_path, plain):
    weights = np.array(picture_weights(), np.float64)
    grey = (picture()[..., :3].astype(np.float64) @ weights).astype(np.float32)[..., None]
    path = write(tmp_path / "grey.exr", [(None, grey, ("Y",), "float")])
    result = agrees(path, plain, COLOURS)
    assert result["images"]["channels"] == ["Y"]
    assert any("luminance alone" in note for note in result["notes"])
    agrees(path, path, COLOURS)
    pixels = picture()
    pixels[3, 20, 1] += 0.5
    other = save(tmp_path / "other.exr", pixels)
    found = diff([other], [path], tolerances=COLOURS)
    assert found["verdict"] == "differs"
    assert found["colour"]["max_error"] == pytest.approx(0.5 * weights[1], rel=1e-5)


def picture_weights():
    """Rec.709's luminance of linear red, green and blue."""
    return (0.2126, 0.7152, 0.0722)


def test_luminance_with_chroma_is_rejected_with_its_words(tmp_path, plain):
    pixels = np.concatenate([picture()[..., :1]] * 3, -1)
    path = write(tmp_path / "chroma.exr", [(None, pixels, ("Y", "RY", "BY"), "float")])
    assert "luminance and chroma (Y, RY, BY)" in reason(path, plain).lower().replace(
        "(y, ry, by)", "(Y, RY, BY)"
    )


def test_unsigned_integers_of_an_exr_are_rejected(tmp_path, plain):
    ids = np.arange(WIDTH * HEIGHT * 3, dtype=np.uint32).reshape(HEIGHT, WIDTH, 3)
    path = write(tmp_path / "ids.exr", [(None, ids, tuple("RGB"), oiio.UINT)])
    assert "uint" in reason(path, plain) and "name another part" in reason(path, plain)


def test_integers_beside_float_colours_do_not_matter(tmp_path, plain):
    parts = [("picture", picture(), tuple("RGBA"), "float")]
    parts.append(("ids", np.ones((HEIGHT, WIDTH, 1), np.uint32), ("id",), oiio.UINT))
    agrees(write(tmp_path / "ids.exr", parts), plain)


@pytest.mark.parametrize("mipmapped", [False, True])
def test_tiles_and_levels(tmp_path, plain, mipmapped):
    path = str(tmp_path / "tiled.exr")
    source = oiio.ImageBuf(plain)
    if mipmapped:
        options = oiio.ImageSpec()
        options.attribute("maketx:opaque_detect", 0)
        options.attribute("maketx:resize", 0)
        options.tile_width = options.tile_height = 16
        assert oiio.ImageBufAlgo.make_texture(oiio.MakeTxTexture, source, path, options), oiio.geterror()
    else:
        source.set_write_tiles(16, 16)
        assert source.write(path), source.geterror()
    file = oiio.ImageInput.open(path)
    assert file.spec().tile_width == 16 and file.seek_subimage(0, 1) == mipmapped
    file.close()
    agrees(path, plain)


def test_a_deep_picture_is_rejected(tmp_path, plain):
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 5, "float")
    spec.channelnames = ("R", "G", "B", "A", "Z")
    spec.deep = True
    deep = oiio.DeepData()
    deep.init(WIDTH * HEIGHT, 5, oiio.TypeFloat, spec.channelnames)
    for pixel in range(WIDTH * HEIGHT):
        deep.set_samples(pixel, 1)
    output = oiio.ImageOutput.create("deep.exr")
    path = str(tmp_path / "deep.exr")
    assert output.open(path, spec) and output.write_deep_image(deep), output.geterror()
    output.close()
    assert "deep" in reason(path, plain) and "Flatten" in reason(path, plain)


def test_primaries_of_another_space_are_rejected(tmp_path, plain):
    aces = oiio.ImageSpec(WIDTH, HEIGHT, 4, "float")
    primaries = (0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767)
    aces.attribute("chromaticities", oiio.TypeDesc("float[8]"), primaries)
    path = str(tmp_path / "acescg.exr")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, aces) and output.write_image(picture())
    output.close()
    assert "0.713" in reason(path, plain) and "Rec.709" in reason(path, plain)


def test_a_float_tiff_holds_radiance(tmp_path, plain):
    path = write(tmp_path / "float.tif", [(None, picture(), tuple("RGBA"), "float")])
    agrees(path, plain)


def curve(values):
    """The sRGB curve of linear values, IEC 61966-2-1."""
    return np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1 / 2.4) - 0.055)


@pytest.mark.parametrize(("ending", "storage", "steps"), [("png", "uint8", 255), ("png", "uint16", 65535)])
def test_integers_are_compared_as_stated_and_never_silently(tmp_path, plain, ending, storage, steps):
    pixels = picture().astype(np.float64)
    alpha = pixels[..., 3:]
    straight = pixels[..., :3] / np.where(alpha > 0, alpha, 1)
    shown = np.concatenate([curve(straight), alpha], -1)
    stored = np.floor(shown * steps + 0.5).astype(storage)
    path = str(tmp_path / f"shown.{ending}")
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 4, storage)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec) and output.write_image(stored)
    output.close()
    text = reason(path, plain)
    assert all(f"--integers {choice}" in text for choice in ("srgb", "linear", "display"))
    # Half a step of the curve, whose slope is at most 2.4 / 1.055 in linear values, and half one of
    # alpha.
    limit = 0.5 / steps * (2.4 / 1.055 + 1)
    limits = {"max_error": limit, "alpha_max_error": 0.5 / steps * 1.001}
    result = agrees(path, plain, limits, integers="srgb")
    assert any("sRGB curve" in note for note in result["notes"])
    # Its values as they are, are no radiance.
    found = diff([path], [plain], tolerances=limits, integers="linear")
    assert found["verdict"] == "differs" and found["colour"]["max_error"] > 10 * limit
    assert "display values" in reason(path, plain, integers="display")
    result = agrees(path, path, EXACT, integers="display", out=str(tmp_path / "run"), display=VIEW)
    assert result["flip"]["mean"] is None and any(
        "not of radiance" in n or "no figure" in n for n in result["notes"]
    )
    shown_again = oiio.ImageBuf(result_file(tmp_path, "ours.png")).get_pixels(oiio.FLOAT)
    if storage == "uint8":
        opaque = stored[..., 3] == 255
        assert np.abs(shown_again[opaque][:, :3] * 255 - stored[opaque][:, :3]).max() <= 1


def result_file(tmp_path, name):
    """A file of the folder `run`."""
    return str(tmp_path / "run" / name)


def test_alpha_is_judged_only_where_both_have_it(tmp_path, plain):
    rgb = save(tmp_path / "rgb.exr", picture()[..., :3], ("R", "G", "B"))
    result = agrees(rgb, plain, COLOURS)
    assert result["alpha"] is None and any("no alpha" in note for note in result["notes"])
    asked = diff([rgb], [plain], tolerances=EXACT)
    assert asked["verdict"] == "could_not_tell" and "Alpha is not in both" in asked["reasons"][0]


def test_a_hole_in_the_file_is_no_hole_of_nan(tmp_path, plain):
    broken = picture()
    broken[0, 0, 0] = np.nan
    window = {"x": 0, "y": 0, "full_x": 1, "full_y": 0, "full_width": WIDTH - 1, "full_height": HEIGHT}
    path = write(tmp_path / "nan.exr", [(None, broken, tuple("RGBA"), "float")], **window)
    cut = save(tmp_path / "cut.exr", picture()[:, 1:])
    agrees(path, cut)
    broken[0, 1, 0] = np.nan
    path = write(tmp_path / "nan2.exr", [(None, broken, tuple("RGBA"), "float")], **window)
    assert diff([path], [cut])["verdict"] == "differs"


def test_a_display_window_that_no_memory_holds(tmp_path, plain):
    content = bytearray(pathlib.Path(plain).read_bytes())
    at = content.index(b"displayWindow\0box2i\0") + len(b"displayWindow\0box2i\0") + 4
    content[at : at + 16] = struct.pack("<4i", 0, 0, 2**29, 2**29)
    path = tmp_path / "huge.exr"
    path.write_bytes(bytes(content))
    assert "huge.exr" in reason(str(path), plain)


def test_pipes_are_no_pictures(tmp_path, plain):
    path = str(tmp_path / "pipe.exr")
    os.mkfifo(path)
    assert "a pipe" in reason(path, plain)


def test_blenders_files_of_every_kind(tmp_path):
    bpy = pytest.importorskip("bpy")
    from cycles_settings import apply_exr

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    source = bpy.data.images.new("source", WIDTH, HEIGHT, alpha=True, float_buffer=True)
    source.colorspace_settings.name = "Linear Rec.709"
    source.pixels.foreach_set(np.ascontiguousarray(picture()[::-1]).ravel())
    settings = scene.render.image_settings
    apply_exr(settings, False, codec="ZIP")
    paths = {}
    for mode, depth in (("RGBA", "32"), ("RGB", "32"), ("RGBA", "16")):
        settings.color_mode, settings.color_depth = mode, depth
        paths[mode, depth] = str(tmp_path / f"{mode}{depth}.exr")
        source.save_render(paths[mode, depth], scene=scene)
    found = {key: picture_file.read(path) for key, path in paths.items()}
    whole = found["RGBA", "32"]
    assert whole.names == list("RGBA") and np.array_equal(whole.pixels, picture())
    assert found["RGB", "32"].names == list("RGB")
    agrees(paths["RGB", "32"], paths["RGBA", "32"], COLOURS)
    agrees(paths["RGBA", "16"], paths["RGBA", "32"], {"max_error": HALF})


def test_what_takes_radiance_alone_takes_no_integers(tmp_path):
    path = str(tmp_path / "shown.tif")
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "uint16")
    output = oiio.ImageOutput.create(path)
    assert output.open(path, spec) and output.write_image(picture()[..., :3])
    output.close()
    shown = VIEW | {"exr": path, "png": str(tmp_path / "a.png")}
    for request in (
        {"op": "display", "images": [shown]},
        {"op": "plain", "images": [{"exr": path, "plain": str(tmp_path / "a.exr")}]},
    ):
        status, event = run(request)
        assert status == 1 and "integers, which are no radiance" in event["found"]
        assert event["place"] == path and "--integers" not in json.dumps(event)
    assert os.listdir(tmp_path) == ["shown.tif"]
