"""Rendering a reference: settings, a closed form, replicas, provenance, pixels that the rewriting keeps."""

import numpy as np
import pytest

from blend_support import Recorder, absorbing_nodes, matrix, principled_nodes, requires_bpy, run_script, scene
from protocol import InputError, located
from scene_io import scene_hash

bpy = pytest.importorskip("bpy")
oiio = pytest.importorskip("OpenImageIO")

from blender_file import open_empty  # noqa: E402
from compare_images import combine  # noqa: E402
from reference_render import apply_request, copy_with_attributes  # noqa: E402
from scene_builder import build_scene  # noqa: E402

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
    assert bpy.app.version_string in spec.getattribute("cloudparity:renderer")
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


SUN = {
    "name": "Sun",
    "type": "sun",
    "matrix_world": matrix(),
    "color": [1.0, 1.0, 1.0],
    "strength": 2.0,
    "exposure": 0.0,
    "angle": 0.0,
}

# Every property that a comparison needs, by the object that has it: a wrong value, and what must stand there
# after the request: 16 samples, seed 5003, volume_bounces 4, ray marching with step rate 0.05, 1 thread.
SETTINGS = {
    "scene.render": {
        "engine": ("BLENDER_EEVEE", "CYCLES"),
        "film_transparent": (True, False),
        "resolution_x": (7, 8),
        "resolution_y": (7, 4),
        "resolution_percentage": (50, 100),
        "use_motion_blur": (True, False),
        "use_border": (True, False),
        "use_simplify": (True, False),
        "use_compositing": (True, False),
        "use_sequencer": (True, False),
        "dither_intensity": (1.0, 0.0),
        "threads_mode": ("AUTO", "FIXED"),
        "threads": (2, 1),
    },
    "scene.cycles": {
        "device": ("GPU", "CPU"),
        "samples": (4096, 16),
        "seed": (0, 5003),
        "use_animated_seed": (True, False),
        "sampling_pattern": ("AUTOMATIC", "TABULATED_SOBOL"),
        "use_adaptive_sampling": (True, False),
        "use_denoising": (True, False),
        "time_limit": (1.0, 0.0),
        "use_sample_subset": (True, False),
        "sample_clamp_direct": (1.0, 0.0),
        "sample_clamp_indirect": (10.0, 0.0),
        "light_sampling_threshold": (0.01, 0.0),
        "volume_bounces": (0, 4),
        "max_bounces": (2, 4),
        "min_light_bounces": (3, 0),
        "min_transparent_bounces": (3, 0),
        "transparent_max_bounces": (8, 1024),
        "volume_biased": (False, True),
        "volume_step_rate": (1.0, 0.05),
        "volume_max_steps": (1024, 65536),
        "use_guiding": (True, False),
        "use_fast_gi": (True, False),
    },
    "scene.render.image_settings": {
        "media_type": ("IMAGE", "IMAGE"),
        "file_format": ("PNG", "OPEN_EXR"),
        "color_depth": ("8", "32"),
        "color_mode": ("RGB", "RGBA"),
        "exr_codec": ("DWAA", "ZIP"),
    },
    "scene.camera.data.dof": {"use_dof": (True, False)},
    "scene.world.cycles": {"sampling_method": ("AUTOMATIC", "NONE")},
    "material.cycles": {"volume_sampling": ("DISTANCE", "MULTIPLE_IMPORTANCE")},
}
# What the scene alone decides, as built from a file that says so.
BUILT = {
    "scene.render": {"pixel_aspect_x": 1.0, "pixel_aspect_y": 1.0},
    "scene.cycles": {"pixel_filter_type": "BOX", "film_exposure": 1.0},
    "scene.camera.data": {"clip_start": 0.1, "clip_end": 100.0},
    "material.cycles": {"volume_step_rate": 1.0},
    "sun": {
        "energy": 2.0,
        "exposure": 0.0,
        "angle": 0.0,
        "use_temperature": False,
        "normalize": True,
    },
    "colours": {"working_space": "Linear Rec.709"},
}


def places():
    """The objects that SETTINGS and BUILT name."""
    target = bpy.context.scene
    return {
        "scene.render": target.render,
        "scene.cycles": target.cycles,
        "scene.render.image_settings": target.render.image_settings,
        "scene.camera.data": target.camera.data,
        "scene.camera.data.dof": target.camera.data.dof,
        "scene.world.cycles": target.world.cycles,
        "material.cycles": bpy.data.materials["Material"].cycles,
        "sun": bpy.data.lights["Sun"],
        "colours": bpy.data.colorspace,
    }


def test_every_setting_that_parity_needs_is_set_whatever_it_was():
    open_empty()
    document = scene(absorbing_nodes(1.0))
    document["lights"] = located([SUN], "scene.lights")
    build_scene(document, Recorder().warning)
    for place, properties in SETTINGS.items():
        for name, (wrong, _) in properties.items():
            try:
                setattr(places()[place], name, wrong)
            except TypeError:
                assert name == "exr_codec", "only a codec of another file format cannot be set"
    changes = {"volume_bounces": 4, "volume_biased": True, "step_rate": 0.05, "threads": 1}
    changes["film_transparent"] = False
    asked = request("unused.exr", resolution=[8, 4], **changes)
    apply_request(bpy.context.scene, located(asked, "request"), 5003)
    found = {
        (place, name): getattr(places()[place], name)
        for place, properties in (*SETTINGS.items(), *BUILT.items())
        for name in properties
    }
    expected = {
        (place, name): value
        for place, properties in SETTINGS.items()
        for name, (_, value) in properties.items()
    } | {(place, name): value for place, properties in BUILT.items() for name, value in properties.items()}
    assert found == {
        key: pytest.approx(value, rel=1e-6) if isinstance(value, float) else value
        for key, value in expected.items()
    }


def test_the_world_is_sampled_as_a_light_where_the_request_says_so():
    open_empty()
    build_scene(scene(absorbing_nodes(1.0)), Recorder().warning)
    asked = located(request("unused.exr", world_sampling="AUTOMATIC"), "request")
    settings = apply_request(bpy.context.scene, asked, 1)
    assert bpy.context.scene.world.cycles.sampling_method == settings["world_sampling"] == "AUTOMATIC"
    with pytest.raises(InputError, match="world_sampling"):
        apply_request(bpy.context.scene, located(asked | {"world_sampling": "MANUAL"}, "request"), 1)


def scattering_nodes():
    """A graph that scatters, so that pictures have noise."""
    return principled_nodes({"Color": [0.9, 0.8, 0.7, 1.0], "Density": 1.0, "Anisotropy": 0.3})


def test_replicas_of_one_process_have_the_bits_of_processes_of_their_own(tmp_path):
    document = scene(scattering_nodes())
    changes = {"scene": document, "resolution": [8, 8], "volume_bounces": 2}
    seeds = (5000, 5001, 5002)
    replicas = [{"seed": seed, "exr": str(tmp_path / f"{seed}.exr")} for seed in seeds]
    events, status = run_script("reference.py", request(None, **changes) | {"replicas": replicas})
    assert status == 0, events[-1]
    results = events[-1]["result"]["replicas"]
    assert [result["settings"]["seed"] for result in results] == list(seeds)
    images = [pixels(replica["exr"])[1] for replica in replicas]
    # The last one alone: nothing of the renders before it may have stayed.
    alone = tmp_path / "alone.exr"
    events, status = run_script("reference.py", request(alone, **changes) | {"seed": seeds[-1]})
    assert status == 0, events[-1]
    np.testing.assert_array_equal(images[-1].view(np.uint32), pixels(alone)[1].view(np.uint32))
    assert np.abs(images[0] - images[1]).max() > 1e-4, "other seeds give other noise"

    mean, variance = str(tmp_path / "mean.exr"), str(tmp_path / "variance.exr")
    asked = {"images": [replica["exr"] for replica in replicas], "mean": mean, "variance": variance}
    assert combine(located(asked, "request"), Recorder())["replicas"] == 3
    spec, found = pixels(mean)
    # Written as f32, so half a unit in the last place (6e-8) besides the f64 sums.
    np.testing.assert_allclose(found, np.mean(images, axis=0, dtype=np.float64), rtol=1e-6)
    np.testing.assert_allclose(pixels(variance)[1], np.var(np.float64(images), axis=0, ddof=1), rtol=1e-6)
    assert spec.getattribute("cloudparity:seeds") == "[5000, 5001, 5002]"
    assert spec.getattribute("cloudparity:samples") == 16 and spec.getattribute("cloudparity:seed") is None
    with pytest.raises(InputError, match="no replica but the mean over the replicas"):
        combine(located(asked | {"images": [mean, replicas[0]["exr"]]}, "request"), Recorder())
    with pytest.raises(InputError, match="the seed 5000"):
        combine(located(asked | {"images": [replicas[0]["exr"]] * 2}, "request"), Recorder())
