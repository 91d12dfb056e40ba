"""The image comparator finds planted differences, and only those. Runs without bpy.

Every picture is synthetic: a smooth lit disc on an empty film, 40 x 24 pixels, so that the edge blocks of the
8 x 8 blocks are partial in x (40 = 5 blocks) and whole in y, or partial with block size 7.
"""

import json
import math
import pathlib
import subprocess
import sys

import numpy as np
import OpenImageIO as oiio
import pytest

import false_colour
import image_metrics
import picture_file

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / "blend" / "compare_images.py"
TOLERANCES = {"channel_mean_relative": 0.01, "block_relmse": 0.01}
WIDTH, HEIGHT = 40, 24


def picture():
    """RGBA float32 [24, 40, 4]: premultiplied disc, channel means all different, empty corners."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    disc = np.clip(1.2 - np.hypot(x - 20, y - 12) / 10, 0, 1)
    return np.stack([disc * 0.5, disc * 0.6, disc * 0.7, disc], axis=-1).astype(np.float32)


def save(path, pixels, channels=("R", "G", "B", "A"), storage="float", space=None):
    """Write one EXR and return its path as text."""
    spec = oiio.ImageSpec(pixels.shape[1], pixels.shape[0], pixels.shape[2], storage)
    spec.channelnames = channels
    if space:
        spec.attribute("colorInteropID", space)
    output = oiio.ImageOutput.create(str(path))
    assert output.open(str(path), spec), output.geterror()
    assert output.write_image(np.ascontiguousarray(pixels)), output.geterror()
    output.close()
    return str(path)


def run(request):
    """Run the script; returns (exit status, its last event)."""
    done = subprocess.run(
        [sys.executable, str(SCRIPT)], input=json.dumps(request), capture_output=True, text=True
    )
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert events[0]["event"] == "hello", done.stderr
    return done.returncode, events[-1]


def diff(ours, reference, **more):
    """The result of one comparison; `more` overrides parts of the request."""
    request = {
        "op": "diff",
        "ours": ours,
        "reference": reference,
        "tolerances": TOLERANCES,
        "out": None,
    } | more
    status, event = run(request)
    assert status == 0, event
    return event["result"]


@pytest.fixture
def reference(tmp_path):
    """A reference EXR."""
    return save(tmp_path / "reference.exr", picture())


def test_equal_images_agree(tmp_path, reference):
    result = diff([save(tmp_path / "ours.exr", picture())], [reference])
    assert result["verdict"] == "agrees"
    assert result["colour"]["max_error"] == 0 and result["colour"]["failing_pixels"] == 0
    assert result["colour"]["psnr"] is None and result["relmse"]["block"] == 0
    assert result["flip"]["mean"] == pytest.approx(0, abs=1e-6)


def test_one_changed_pixel_is_found_at_its_place(tmp_path, reference):
    pixels = picture()
    pixels[7, 23, 1] += 0.25
    limits = TOLERANCES | {"max_error": 0.2, "failing_share": 0.0}
    result = diff([save(tmp_path / "ours.exr", pixels)], [reference], tolerances=limits)
    colour = result["colour"]
    assert (colour["max_at"]["x"], colour["max_at"]["y"], colour["max_at"]["channel"]) == (23, 7, "G")
    assert colour["max_error"] == pytest.approx(0.25, abs=1e-6)
    assert colour["failing_pixels"] == 1
    assert colour["rms_error"] == pytest.approx(0.25 / math.sqrt(WIDTH * HEIGHT * 3), rel=1e-5)
    assert result["alpha"]["max_error"] == 0
    assert result["verdict"] == "differs"
    failed = {check["name"] for check in result["checks"] if check["outcome"] == "differs"}
    assert failed == {"max_error", "failing_share"}


def test_two_percent_in_one_channel_differs(tmp_path, reference):
    pixels = picture()
    pixels[..., 2] *= 1.02
    result = diff([save(tmp_path / "ours.exr", pixels)], [reference])
    assert result["verdict"] == "differs"
    assert "Channel B" in result["reasons"][0] and "+2 %" in result["reasons"][0]
    rows = {row["channel"]: row["relative_difference"] for row in result["channels"]}
    assert rows["B"] == pytest.approx(0.02, rel=1e-3) and rows["R"] == 0 and rows["A"] == 0


def test_transmittance_beside_alpha_is_no_channel_of_the_picture(tmp_path, reference):
    through = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    names = ("R", "G", "B", "A", "transmittance.R", "transmittance.G", "transmittance.B")
    ours = save(tmp_path / "ours.exr", np.concatenate([picture(), through], axis=-1), channels=names)
    found = picture_file.read(ours)
    assert found.names == ["R", "G", "B", "A"] and np.array_equal(found.pixels, picture())
    assert diff([ours], [reference])["verdict"] == "agrees"


def test_relmse_follows_its_written_formula(tmp_path, reference):
    pixels = picture()
    pixels[3:20, 9:30, :3] *= 1.3
    found = diff([save(tmp_path / "ours.exr", pixels)], [reference], block=7)["relmse"]
    a, b = pixels[..., :3].astype(np.float64), picture()[..., :3].astype(np.float64)
    epsilon = 0.01 * b.mean()
    assert found["epsilon"] == pytest.approx(epsilon, rel=1e-12)
    assert found["pixel"] == pytest.approx(np.mean((a - b) ** 2 / (b**2 + epsilon**2)), rel=1e-9)
    total = 0.0
    for y in range(0, HEIGHT, 7):
        for x in range(0, WIDTH, 7):
            cell_a, cell_b = (image[y : y + 7, x : x + 7].reshape(-1, 3) for image in (a, b))
            mean_a, mean_b = cell_a.mean(axis=0), cell_b.mean(axis=0)
            total += len(cell_a) * np.mean((mean_a - mean_b) ** 2 / (mean_b**2 + epsilon**2))
    assert found["block"] == pytest.approx(total / (WIDTH * HEIGHT), rel=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("side", ["ours", "reference"])
def test_values_that_are_not_finite_fail_before_any_figure(tmp_path, value, side):
    broken = picture()
    broken[5, 6, 0] = value
    paths = {
        name: [save(tmp_path / f"{name}.exr", broken if name == side else picture())]
        for name in ("ours", "reference")
    }
    result = diff(**paths)
    assert result["verdict"] == "differs"
    assert result["finite"][side]["nan" if np.isnan(value) else "infinite"] == 1
    assert result["colour"] is None and result["relmse"] is None and side in result["reasons"][0]


def test_negative_values_are_counted(tmp_path, reference):
    pixels = picture()
    pixels[0, 0, 0] = -1e-6
    result = diff([save(tmp_path / "ours.exr", pixels)], [reference])
    assert result["verdict"] == "agrees" and result["finite"]["ours"]["negative"] == 1
    assert any("1 negative" in note for note in result["notes"])


def test_images_that_do_not_match_cannot_be_told(tmp_path, reference):
    (tmp_path / "text.exr").write_text("no picture")
    pixels = picture()
    cases = {
        "40 x 23": save(tmp_path / "size.exr", pixels[:-1]),
        "with channels U, V": save(tmp_path / "channels.exr", pixels[..., :2], ("U", "V")),
        "no such file": str(tmp_path / "missing.exr"),
        "text.exr": str(tmp_path / "text.exr"),
    }
    for text, path in cases.items():
        result = diff([path], [reference])
        assert result["verdict"] == "could_not_tell", text
        assert text in result["reasons"][0] and result["colour"] is None
        assert str(tmp_path) not in result["reasons"][0], "a reason names files, not folders"


def test_colour_spaces_that_differ_cannot_be_told(tmp_path):
    ours = save(tmp_path / "ours.exr", picture(), space="lin_ap1_scene")
    reference = save(tmp_path / "reference.exr", picture(), space="lin_rec709_scene")
    assert diff([ours], [reference])["verdict"] == "could_not_tell"


def test_no_tolerance_means_no_verdict(reference):
    assert diff([reference], [reference], tolerances={})["verdict"] == "could_not_tell"


def replicas(folder, name, count, noise, seed, scale=1.0):
    """Noisy copies of the picture times `scale`."""
    random = np.random.default_rng(seed)
    clean = picture() * scale
    return [
        save(folder / f"{name}{i}.exr", (clean + random.normal(0, noise, clean.shape)).astype(np.float32))
        for i in range(count)
    ]


def test_replicas_give_the_standard_error_of_the_mean(tmp_path):
    noise = 0.02
    ours, theirs = replicas(tmp_path, "o", 4, noise, 1), replicas(tmp_path, "r", 16, noise, 2)
    result = diff(ours, theirs)
    # The means agree; the block error is noise, and the verdict says that instead of blaming either side.
    assert [check["outcome"] for check in result["checks"]] == ["agrees", "could_not_tell"]
    assert result["verdict"] == "could_not_tell" and "Without that noise" in result["reasons"][0]
    expected = noise / math.sqrt(WIDTH * HEIGHT * 16)
    for row in result["channels"]:
        assert row["reference_standard_error"] == pytest.approx(expected, rel=0.7)
        assert row["ours_standard_error"] is not None
    relmse = result["relmse"]
    assert relmse["block"] == pytest.approx(relmse["noise_block"], rel=0.5)
    assert abs(relmse["debiased_block"]) < 0.3 * relmse["block"]


def test_noise_over_half_the_limit_cannot_be_told(tmp_path):
    limits = {"channel_mean_relative": 0.01}
    noisy = replicas(tmp_path, "r", 3, 2.0, 3)
    result = diff([save(tmp_path / "ours.exr", picture())], noisy, tolerances=limits)
    assert result["verdict"] == "could_not_tell" and "noise is too large" in result["reasons"][0]
    quiet = replicas(tmp_path, "q", 3, 1e-4, 4)
    result = diff([save(tmp_path / "brighter.exr", picture() * 1.02)], quiet, tolerances=limits)
    assert result["verdict"] == "differs"


@pytest.mark.parametrize(
    ("change", "place"),
    [
        ({"op": "nonsense"}, "request.op"),
        ({"ours": []}, "request.ours"),
        ({"tolerances": {"psnr": 1}}, "request.tolerances.psnr"),
        ({"block": 0}, "request.block"),
    ],
)
def test_requests_that_make_no_sense_are_refused_with_their_place(reference, change, place):
    request = {"op": "diff", "ours": [reference], "reference": [reference], "tolerances": {}} | change
    status, event = run(request)
    assert status == 1 and event["event"] == "error" and event["place"] == place
    assert event["remedy"]


def test_outputs_are_complete_and_name_their_ranges(tmp_path, reference):
    pixels = picture()
    pixels[..., :3] *= 1.01
    view = {"view": "Standard", "look": "None", "exposure": 0, "gamma": 1, "background": [0.1, 0.2, 0.3]}
    out = tmp_path / "run"
    result = diff([save(tmp_path / "ours.exr", pixels)], [reference], out=str(out), display=view)
    assert json.loads((out / "diff.json").read_text()) == result
    names = {path.name for path in out.iterdir()}
    assert {"ours.png", "ours-alpha.png", "reference.png", "difference.png", "flip.png"} <= names
    assert not [name for name in names if name.startswith(".")]
    assert result["map"]["range"] in (0.01, 0.02)
    legend = (out / "difference_legend.svg").read_text()
    assert f"{100 * result['map']['range']:.4g} %" in legend
    # An empty corner shows the background through sRGB's curve, whichever of the two paths made the picture.
    corner = oiio.ImageBuf(str(out / "reference.png")).get_pixels(oiio.UINT8)[0, 0]
    expected = [round(255 * (1.055 * v ** (1 / 2.4) - 0.055)) for v in view["background"]]
    assert np.abs(corner.astype(int) - expected).max() <= 1
    transparent = oiio.ImageBuf(str(out / "reference-alpha.png")).get_pixels(oiio.UINT8)
    assert transparent.shape[2] == 4 and transparent[0, 0, 3] == 0 and transparent[12, 20, 3] == 255


def test_field_slices_tell_equal_from_different(tmp_path):
    reference = np.linspace(0, 4, 12 * 10, dtype=np.float32).reshape(10, 12)
    ours = reference.copy()
    ours[3, 4] += np.float32(0.4)
    ours[9, 0] = np.nan
    np.save(tmp_path / "a.npy", ours)
    np.save(tmp_path / "b.npy", reference)
    item = {"title": "t", "ours": str(tmp_path / "a.npy"), "reference": str(tmp_path / "b.npy")}
    status, event = run({"op": "field_slices", "slices": [item | {"png_prefix": str(tmp_path / "s")}]})
    assert status == 0, event
    found = event["result"]["slices"][0]
    assert found["equal_share"] == pytest.approx(118 / 120)
    assert found["max_error"] == pytest.approx(0.1, rel=1e-5) and found["one_sided_nonfinite"] == 1
    pixels = oiio.ImageBuf(str(tmp_path / found["error_png"])).get_pixels(oiio.UINT8)
    assert tuple(pixels[0, 0]) == false_colour.EQUAL and tuple(pixels[9, 0]) == false_colour.NOT_FINITE
    assert tuple(pixels[3, 4]) not in (false_colour.EQUAL, false_colour.NOT_FINITE)


def test_colour_maps_are_even_in_lightness():
    luminance = {}
    for name, table in (("sequential", false_colour.SEQUENTIAL), ("diverging", false_colour.DIVERGING)):
        encoded = table / 255
        linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
        luminance[name] = np.cbrt(image_metrics.luminance(linear[None])[0])
    assert (np.diff(luminance["sequential"]) > -0.004).all()
    assert np.ptp(luminance["sequential"]) > 0.7
    half = luminance["diverging"]
    assert np.abs(half - half[::-1]).max() < 0.06 and half.argmax() in range(126, 130)


def test_flip_of_pairs_is_that_of_each_diff(tmp_path, reference):
    brighter = save(tmp_path / "brighter.exr", picture() * np.float32(1.5))
    pairs = [{"ours": [ours], "reference": [reference, reference]} for ours in (reference, brighter)]
    status, event = run({"op": "flip", "pairs": pairs})
    assert status == 0, event
    equal, found = event["result"]["means"]
    expected = diff([brighter], [reference])["flip"]["mean"]
    assert equal == 0 and found == expected and found > 0.01
    small = save(tmp_path / "small.exr", picture()[:4])
    status, event = run({"op": "flip", "pairs": [{"ours": [small], "reference": [reference]}]})
    assert status != 0 and "pairs[0]" in json.dumps(event)
