"""The three.js page of a bundle in a real Chromium, with WebGL 2 and with WebGPU: its picture is the
adapter's, a camera of three.js sees what the scene's sees, numbers change the picture."""

import json
import shutil
import subprocess

import numpy as np
import pytest

from blend_support import ROOT, built_program
from page_support import HAS_CHROMIUM, ULP, launched, listening, served

pytestmark = [
    pytest.mark.skipif(not HAS_CHROMIUM, reason="no Chromium is installed"),
    pytest.mark.skipif(shutil.which("npm") is None, reason="npm, which fetches three.js, is not installed"),
]

RENDERERS = ("webgl", "webgpu")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("three")
    scene = ROOT / "parity/scenes/procedural-clouds.scene.json"
    options = ["--to", "three", "--model", "perlin-fbm", "--resolution", "64x36", "-o", str(root)]
    publish = [str(built_program()), "publish", str(scene), *options]
    subprocess.run(publish, check=True, capture_output=True, cwd=ROOT)
    fetched = subprocess.run(
        ["npm", "install", "--prefix", str(root), "--no-audit", "--no-fund"], capture_output=True, check=False
    )
    if fetched.returncode != 0:
        pytest.skip("three.js cannot be fetched")
    return root


@pytest.fixture(scope="module")
def address(folder):
    with served(folder) as root:
        yield root


@pytest.fixture(scope="module")
def browser():
    with launched() as opened:
        yield opened


@pytest.fixture(params=RENDERERS)
def page(request, browser, address):
    with listening(
        browser, f"{address}/?renderer={request.param}", "window.host?.ready", (1100, 800)
    ) as opened:
        assert opened.locator("#status.failed").count() == 0, opened.locator("#status").inner_text()
        yield opened


def read(page):
    """The linear picture, [h, w, 4]."""
    return np.array(page.evaluate("async () => Array.from(await host.read())")).reshape(36, 64, 4)


def drawn(page):
    page.evaluate("async () => { await host.draw(); }")
    return read(page)


def test_both_renderers_draw_what_the_adapter_draws(page, folder):
    """The bound is that of test_page.py: twice what our adapter is off from double precision, and the
    arithmetic."""
    import OpenImageIO as oiio

    found = read(page)
    ours = np.asarray(oiio.ImageBuf(str(folder / "bundle.exr")).get_pixels())
    certificate = json.loads((folder / "certificate.json").read_text())
    bound = 2 * certificate["largest_difference"] + 200 * ULP * certificate["brightest_value"]
    difference = np.abs(found[..., :3] - ours[..., :3]).max()
    print(f"largest difference {difference:.2e}, bound {bound:.2e}")
    assert found[..., :3].max() > 0.1, "nothing is seen"
    assert difference <= bound
    page.evaluate(
        "() => host.cloud.set('march', 'extinction',"
        " host.cloud.get('march', 'extinction').map((one) => one * 1.01))"
    )
    assert np.abs(drawn(page)[..., :3] - ours[..., :3]).max() > bound
    # Browsers say where they wait for a pixel that is read; nothing else is said.
    assert [line for line in page.said if "ReadPixels" not in line] == []


def test_the_canvas_shows_it_upright_in_srgb(page, tmp_path):
    """The canvas is enlarged by the page, so that its edges are filtered: the middles of the picture's pixels
    are compared, and the scene is its own mirror less than half as well as itself."""
    import OpenImageIO as oiio

    linear = read(page)[..., :3].clip(0, 1)
    wanted = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    path = tmp_path / "canvas.png"
    path.write_bytes(page.locator("#picture").screenshot())
    shown = np.asarray(oiio.ImageBuf(str(path)).get_pixels())[..., :3]
    rows = ((np.arange(36) + 0.5) / 36 * shown.shape[0]).astype(int)
    columns = ((np.arange(64) + 0.5) / 64 * shown.shape[1]).astype(int)
    found = shown[np.ix_(rows, columns)]
    off = np.abs(found - wanted).mean()
    assert off < 0.5 * np.abs(found - wanted[::-1]).mean()
    # The middle of a pixel that is drawn larger is its colour, but for the 8 bits of a canvas and the half
    # pixel that the sides are off by.
    assert off < 0.5 * np.abs(found - linear).mean()


def test_a_camera_of_three_sees_what_the_scenes_sees(page):
    """The uniforms that a camera of three.js gives are those of the manifest, which come from a camera's
    matrix in f32: its 16 numbers are off by half a unit each, and so is what they are multiplied with."""
    page.evaluate("() => host.setCamera()")
    fields = page.evaluate(
        "() => host.cloud.manifest.blocks.find((block) => block.name === 'view').elements[0]"
        ".map((field) => [field.name, field.values, host.cloud.get('view', field.name)])"
    )
    assert len(fields) >= 10
    largest = max(np.abs(values).max() for name, values, _ in fields if name.startswith("start"))
    for name, wanted, found in fields:
        size = largest if name.startswith("start") else max(np.abs(wanted).max(), 1)
        assert np.abs(np.subtract(wanted, found)).max() <= 32 * ULP * size, (name, wanted, found)


def test_the_mouse_goes_around_and_back(page):
    home = read(page)
    box = page.locator("#picture").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 120, y + 10, steps=3)
    page.mouse.up()
    page.wait_for_timeout(300)
    assert not np.array_equal(drawn(page), home)
    page.evaluate("() => host.home()")
    assert np.array_equal(drawn(page), home)
