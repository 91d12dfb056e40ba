"""Rendering a reference: a closed form, the provenance in the file, and pixels that the rewriting keeps."""

import numpy as np
import pytest

from blend_support import absorbing_nodes, requires_bpy, run_script, scene
from scene_io import scene_hash

pytest.importorskip("bpy")
oiio = pytest.importorskip("OpenImageIO")

from reference_render import copy_with_attributes  # noqa: E402

pytestmark = requires_bpy


def request(path, **changes):
    return {
        "scene": scene(absorbing_nodes(1.0)),
        "exr": str(path),
        "resolution": None,
        "samples": 16,
        "seed": 101,
        "film_transparent": None,
        "volume_bounces": None,
        "volume_biased": False,
        "step_rate": 0.1,
        "threads": 0,
        "multilayer": False,
        "metadata": {"purpose": "test"},
    } | changes


def pixels(path, part=0):
    file = oiio.ImageInput.open(str(path))
    assert file.seek_subimage(part, 0)
    return file.spec(), np.array(file.read_image(part, 0, 0, file.spec().nchannels, "float"))


def test_absorbing_cube_follows_beer_lambert(tmp_path):
    path = tmp_path / "cube.exr"
    asked = request(path)
    events, status = run_script("reference.py", asked)
    assert status == 0, events[-1]
    result = events[-1]["result"]
    assert result["settings"]["pixel_filter"] == "BOX"
    assert result["settings"]["resolution"] == [32, 32]
    spec, image = pixels(path)
    # World (1, 0.5, 0.25) through 2 units of sigma_t = 1. The estimator is exact for a homogeneous medium;
    # the tolerance is 4 roundings of f32.
    np.testing.assert_allclose(image[..., :3], np.full((32, 32, 3), [1, 0.5, 0.25]) * np.exp(-2), rtol=5e-7)
    assert np.all(image[..., 3] == 1)
    assert spec.getattribute("cloudparity:scene_sha256") == scene_hash(asked["scene"])
    assert spec.getattribute("cloudparity:seed") == 101
    assert spec.getattribute("cloudparity:samples") == 16
    assert spec.getattribute("cloudparity:kernel") == "default"
    assert spec.getattribute("cloudparity:purpose") == "test"
    assert "5.0.1" in spec.getattribute("cloudparity:renderer")
    assert [item.name for item in tmp_path.iterdir()] == ["cube.exr"]


def test_layers_resolution_and_transparent_film(tmp_path):
    path = tmp_path / "cube.exr"
    changes = {"multilayer": True, "resolution": [8, 4], "film_transparent": True, "volume_bounces": 3}
    events, status = run_script("reference.py", request(path, **changes), {"CYCLES_CPU_NO_AVX2": "1"})
    assert status == 0, events[-1]
    settings = events[-1]["result"]["settings"]
    assert (settings["volume_bounces"], settings["kernel"]) == (3, "sse42")
    names = []
    while True:
        try:
            spec, image = pixels(path, len(names))
        except AssertionError:
            break
        assert spec.getattribute("cloudparity:seed") == 101
        assert image.shape[:2] == (4, 8)
        names.append(spec.channelnames[0])
    assert names[0] == "ViewLayer.Combined.R"
    assert {"ViewLayer.Volume Direct.R", "ViewLayer.Environment.R"} <= set(names)
    np.testing.assert_allclose(pixels(path)[1][..., 3], 1 - np.exp(-2), rtol=1e-6)


def test_rewriting_keeps_every_bit(tmp_path):
    image = np.random.default_rng(3).integers(0, 2**32, (16, 16, 4), np.uint32).view(np.float32)
    source, target = str(tmp_path / "a.exr"), str(tmp_path / "b.exr")
    spec = oiio.ImageSpec(16, 16, 4, "float")
    output = oiio.ImageOutput.create(source)
    assert output.open(source, spec)
    output.write_image(image)
    output.close()
    copy_with_attributes(source, target, {"x:flag": True, "x:list": [1, 2], "x:number": 0.5})
    spec, copy = pixels(target)
    np.testing.assert_array_equal(copy.view(np.uint32), pixels(source)[1].view(np.uint32))
    assert spec.getattribute("x:flag") == "true"
    assert spec.getattribute("x:list") == "[1, 2]"
    assert spec.getattribute("compression") == "zip"
