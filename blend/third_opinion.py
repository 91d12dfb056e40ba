"""Renders a scene with Mitsuba 3: a third opinion beside Cycles and ours. docs/third-opinion.md says how.

  python blend/third_opinion.py SCENE -o MITSUBA.exr --samples 512 --replicas 16

Options are those of `cloudparity render --integrator cycles`, and so are the files: with several replicas,
OUTPUT is their mean and each is OUTPUT.seed-N.exr. Exit status 0, or 1 with the reason on stderr.
mitsuba_scene.py says what is expressed and what is refused.

A command of its own, not a script for the program: Mitsuba has an environment of its own.
"""

import argparse
import hashlib
import json
import math
import sys
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from mitsuba_scene import extinction, film_resolution, mitsuba_scene, volume_bounces
from protocol import InputError, located
from scene_io import matrix_array, replaced_file

VARIANT = "scalar_rgb"
BLOCK = 32  # the edge of Mitsuba's blocks in pixels; few pixels on many threads make smaller ones
# Relative: f32 transforms and weights round a few times, 6e-8 each; half a cell off would be tenths.
EXTINCTION_TOLERANCE = 1e-5
EXTINCTION_POINTS = 256


def main(arguments):
    """Parse, render, write."""
    options = _options(arguments)
    if not options.output.parent.is_dir():  # before the render, not after it
        raise InputError(str(options.output), "no such folder", "an existing one", "create the folder")
    mitsuba = _load_mitsuba()
    scene = _read_scene(options.scene)
    resolution = options.resolution or film_resolution(scene["film"])
    description = mitsuba_scene(scene, resolution)
    _check_extinction(mitsuba, scene, description)
    loaded = mitsuba.load_dict(_converted(mitsuba, description))
    provenance = _provenance(mitsuba, scene, options, resolution)
    pictures = []
    for seed in range(options.seed, options.seed + options.replicas):
        render_seed = _render_seed(seed, resolution)
        begin = time.perf_counter()
        image = np.array(mitsuba.render(loaded, spp=options.samples, seed=render_seed), np.float32)
        seconds = time.perf_counter() - begin
        if not np.isfinite(image).all():
            raise InputError(f"seed {seed}", "NaN or infinity", "finite pixels", "report this to Mitsuba")
        made = {"seed": seed, "mitsuba_seed": render_seed, "render_seconds": seconds}
        _write(_replica_path(options, seed), image, provenance | made)
        pictures.append(image)
        print(f"Mitsuba, {len(pictures)} of {options.replicas}: {seconds:.1f} s", file=sys.stderr)
    if len(pictures) > 1:
        mean = np.mean(pictures, axis=0, dtype=np.float64).astype(np.float32)
        _write(options.output, mean, provenance | {"seed": options.seed, "replicas": len(pictures)})


def _replica_path(options, seed):
    output = options.output
    return output if options.replicas == 1 else output.with_suffix(f".seed-{seed}{output.suffix}")


def _options(arguments):
    parser = argparse.ArgumentParser(description="Render a scene with Mitsuba 3.")
    parser.add_argument("scene", type=Path, help="the scene file")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the EXR to write")
    parser.add_argument("--resolution", type=_resolution, metavar="WxH", help="instead of the scene's")
    parser.add_argument("--samples", type=_positive, default=256, help="per pixel")
    parser.add_argument("--replicas", type=_positive, default=1, help="seeds that count on from --seed")
    parser.add_argument("--seed", type=int, default=9000, help="other seeds give independent pictures")
    return parser.parse_args(arguments)


def _resolution(text):
    width, height = text.split("x")
    return _positive(width), _positive(height)


def _positive(text):
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text}: expected 1 or more")
    return value


def _load_mitsuba():
    try:
        import mitsuba
    except ImportError as error:
        raise InputError(
            "python interpreter",
            f"mitsuba cannot be imported ({error})",
            "Mitsuba 3",
            "install requirements-third-opinion.txt into an environment of its own",
        ) from None
    mitsuba.set_variant(VARIANT)
    return mitsuba


def _read_scene(path):
    try:
        return located(json.loads(path.read_text(encoding="utf-8")), "scene")
    except (OSError, ValueError) as error:
        raise InputError(str(path), str(error), "a scene file", "check the path") from None


def _converted(mitsuba, value):
    """The description with its arrays as Mitsuba's types."""
    if isinstance(value, dict):
        return {key: _converted(mitsuba, item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        is_grid = value.ndim == 4
        return mitsuba.VolumeGrid(value) if is_grid else mitsuba.ScalarTransform4f(value)
    return value


def _check_extinction(mitsuba, scene, description):
    """Compare Mitsuba's own interpolation with the extinction of the graph, at points inside the box.

    It guards against a version that places cells otherwise; a ramp that is off by half a cell still looks
    like a ramp.
    """
    grid = description["cube"]["interior"]["sigma_t"]
    volume = mitsuba.load_dict(_converted(mitsuba, grid))
    bounds = scene["volume"]["bounds"]
    points = np.random.default_rng(1).uniform(bounds["min"], bounds["max"], (EXTINCTION_POINTS, 3))
    affine = extinction(scene)
    to_world = matrix_array(scene["volume"]["matrix_world"])
    for point in points:
        place = mitsuba.Interaction3f()
        place.p = to_world[:3, :3] @ point + to_world[:3, 3]
        found, expected = float(volume.eval_1(place)), affine[0] + point @ affine[1:]
        if abs(found - expected) > EXTINCTION_TOLERANCE * float(grid["grid"].max()):
            raise InputError(
                f"extinction at {point}",
                f"{found:.7g} in Mitsuba's grid",
                f"{expected:.7g}",
                f"use the version in the requirements; this is {mitsuba.__version__}",
            )


def _render_seed(seed, resolution):
    """Mitsuba's seed for a replica, so that no two replicas share random numbers.

    Mitsuba 3.9.1 gives pixel i of seed s the stream s * pixels + i, where i counts the pixels of whole
    blocks: with blocks that reach over the edge of the film there are more of them than pixels, and
    neighbouring seeds render some pixels with each other's streams. Seeds that are far enough apart do not.
    """
    width, height = resolution
    pixels = width * height
    streams = math.ceil(width / BLOCK) * math.ceil(height / BLOCK) * BLOCK**2
    chosen = seed * math.ceil(streams / pixels)
    if seed < 0 or chosen * pixels + streams > 2**32:
        raise InputError("--seed", str(seed), "a seed whose streams fit 32 bits", "take a smaller one")
    return chosen


def _provenance(mitsuba, scene, options, resolution):
    return {
        "scene": scene["name"],
        "scene_file_sha256": hashlib.sha256(options.scene.read_bytes()).hexdigest(),
        "renderer": f"Mitsuba {mitsuba.__version__} {VARIANT} volpath",
        "resolution": json.dumps([int(size) for size in resolution]),
        "samples": options.samples,
        "volume_bounces": volume_bounces(scene),
        "pixel_filter": "BOX",
        "film_transparent": "false",
    }


def _write(path, image, attributes):
    """Write RGB with alpha 1, which is what an opaque film has, in 32-bit floats."""
    height, width, _ = image.shape
    spec = oiio.ImageSpec(width, height, 4, "float")
    spec.channelnames = ("R", "G", "B", "A")
    spec.attribute("compression", "zip")
    spec.attribute("colorInteropID", "lin_rec709_scene")
    for name, value in attributes.items():
        spec.attribute(f"cloudparity:{name}", value)
    pixels = np.concatenate([image, np.ones((height, width, 1), np.float32)], axis=-1)
    with replaced_file(path) as temporary:
        output = oiio.ImageOutput.create(str(temporary))
        if not (output.open(str(temporary), spec) and output.write_image(pixels) and output.close()):
            raise InputError(str(path), output.geterror(), "a file that can be written", "check the disk")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
