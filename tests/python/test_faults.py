"""Small files with what real files hold, made beside the project (../shared/faults): what becomes of each."""

import math
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from blend_support import ROOT, built_program, requires_bpy

pytestmark = requires_bpy

FAULTS = ROOT.parent / "shared" / "faults"


@dataclass
class Wanted:
    """What becomes of a file: part of a warning, or of the one error; Cycles' mean of the picture."""

    warning: str | None = None
    error: str | None = None
    # Means of red, green and blue by Cycles 5.0.1 of the file as it is, 64 x 36 pixels, 256 samples.
    means: tuple[float, ...] | None = None


FILES = {
    "no-camera": Wanted("one of ours frames all volumes"),
    "picture-of-the-world-missing": Wanted("not-here/sky.hdr", means=(0.948, 0.004, 0.948)),
    "one-grid-missing": Wanted("not-here/smoke.vdb", means=(0.0523,) * 3),
    "light-with-blackbody": Wanted(means=(0.05522, 0.05173, 0.04942)),
    "lamp-in-a-cloud-clamped": Wanted("Clamp Indirect 10"),
    "cubes-face-to-face": Wanted("their faces coincide"),
    "forty-nested-cubes": Wanted("Cycles keeps 31"),
    "two-closures-added": Wanted(means=(0.05676,) * 3),
    "emission-without-bound": Wanted(means=(0.07559,) * 3),
    "smoke-domain": Wanted("cache of the simulation"),
    "cloud-over-a-floor": Wanted("surfaces"),
    "light-through-a-window": Wanted("surfaces"),
    # Each has an issue of its own; until then it is rejected in one message.
    "light-without-shadow": Wanted(error="use_shadow"),
    "area-light-with-spread": Wanted(error="spread"),
    "world-volume": Wanted(error='world "World", Volume'),
    "camera-ray-trick": Wanted(error="Light Path"),
    "planet-with-a-cloud-map": Wanted(error="Image Texture"),
    "constant-on-a-grid": Wanted(error="Density Attribute"),
    "fire": Wanted(error="Temperature Attribute"),
}

# Interpreters by release: that of the tests, and Blender 5.3's where its environment was made.
RELEASES = {"5.0.1": Path(sys.executable)}
CACHE = Path(os.environ.get("CLOUDPARITY_CACHE", Path.home() / ".cache" / "cloudparity")) / "blender"
if (CACHE / "5.3.0" / "complete").exists():
    RELEASES["5.3.0"] = CACHE / "5.3.0" / "bin" / "python"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Where the files are, as Blender 5.0.1 writes them."""
    if not FAULTS.is_dir():
        pytest.skip("../shared/faults is not there")
    folder = tmp_path_factory.mktemp("faults")
    command = [sys.executable, FAULTS / "make_blends.py", folder]
    subprocess.run(command, check=True, capture_output=True, cwd=folder)
    return folder


def program(release, *arguments):
    """Run the program with the interpreter of a release."""
    environment = os.environ | {"CLOUDPARITY_PYTHON": str(RELEASES[release])}
    return subprocess.run(
        [str(built_program()), *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
        stdin=subprocess.DEVNULL,
    )


@pytest.mark.parametrize("release", RELEASES)
@pytest.mark.parametrize("name", FILES)
def test_a_file_is_read_or_rejected_in_one_message(folder, tmp_path, name, release):
    wanted = FILES[name]
    scene = tmp_path / f"{name}.scene.json"
    run = program(release, "export", folder / f"{name}.blend", "-o", scene)
    if wanted.error is not None:
        assert run.returncode == 2 and wanted.error in run.stderr, run.stderr
        assert run.stderr.count("error:") == 1 and "broke" not in run.stderr
        return
    assert run.returncode == 0, run.stderr
    assert wanted.warning is None or wanted.warning in run.stderr, run.stderr


@pytest.mark.parametrize("name", [name for name, wanted in FILES.items() if wanted.means is not None])
def test_the_picture_of_a_file_has_the_mean_of_cycles(folder, tmp_path, name):
    import OpenImageIO as oiio

    scene, picture = tmp_path / f"{name}.scene.json", tmp_path / f"{name}.exr"
    run = program("5.0.1", "export", folder / f"{name}.blend", "-o", scene)
    assert run.returncode == 0, run.stderr
    arguments = ["render", scene, "--integrator", "path", "--samples", 256, "--seed", 7, "-o", picture]
    run = program("5.0.1", *arguments)
    assert run.returncode == 0, run.stderr
    statistics = oiio.ImageBufAlgo.computePixelStats(oiio.ImageBuf(str(picture)))
    for ours, theirs in zip(statistics.avg[:3], FILES[name].means, strict=True):
        # Four standard errors: 0.2 % of either side. The means have three digits or more.
        assert ours == pytest.approx(theirs, rel=4 * math.hypot(0.002, 0.002), abs=5e-4)


def test_files_of_grids_are_read(folder, tmp_path):
    # What their values are is another matter: the rules of grids by release.
    for name in ("grid-bg", "grid-levelset", "grid-neg", "grid-negval", "grid-sparse"):
        run = program("5.0.1", "export", folder / f"{name}.blend", "-o", tmp_path / f"{name}.scene.json")
        assert run.returncode == 0, run.stderr


@pytest.mark.parametrize("name", ["magic", "round", "scene-time"])
def test_a_file_of_a_newer_release_is_read_by_it(tmp_path, name):
    path = FAULTS / "saved-by-5.3" / f"{name}.blend"
    if "5.3.0" not in RELEASES or not path.exists():
        pytest.skip("no environment of Blender 5.3.0, or no file")
    scene = tmp_path / f"{name}.scene.json"
    run = subprocess.run(
        [str(built_program()), "export", str(path), "-o", str(scene)], capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    assert '"blender": "5.3"' in scene.read_text(encoding="utf-8")
