"""The statistical verdict on synthetic replicas whose truth is known. Runs without bpy.

Pictures are 24 x 16 pixels, R, G, B and A: a gradient from 0.2 to 1 with noise of 5 % of each pixel, as
renderers have it (brighter pixels are noisier). Every random generator has a seed, so each test always sees
the same pictures; its bounds say how often a correct program would miss them.
"""

import json

import numpy as np
import OpenImageIO as oiio
import pytest
from scipy import stats

import image_metrics
import replica_statistics
from test_compare_images import diff, save

HEIGHT, WIDTH, REPLICAS = 16, 24, 16
CORNERS = (slice(0, 8), slice(0, 8)), (slice(8, 16), slice(16, 24))
NAMES = ["R", "G", "B", "A"]
NOISE = 0.05
SETTINGS = {
    "significance": 0.01,
    "systematic_allowance": 0.0,
    "allowance_rule": "none",
    "debiased_relmse": 1e-3,
    "is_paired": False,
}


def truth(height=HEIGHT, width=WIDTH):
    """Noise-free picture, float64 [h, w, 4]."""
    y, x = np.mgrid[0:height, 0:width]
    ramp = 0.2 + 0.8 * (x / width + y / height) / 2
    return np.stack([ramp, 0.8 * ramp, 0.5 * ramp, 0.5 + 0.4 * ramp], axis=-1)


def normal(random, picture, count=REPLICAS, noise=NOISE):
    """Replicas with normal noise, relative to the picture and the same draws for no two values."""
    return picture * (1 + random.normal(0, noise, (count, *picture.shape)))


def judge(ours, reference, **settings):
    """(checks by name, statistics, notes)."""
    found, checks, notes, _ = replica_statistics.judge(
        ours, reference, NAMES, [0, 1, 2], [3], SETTINGS | settings
    )
    json.dumps(found, allow_nan=False)
    return {check["name"]: check for check in checks}, found, notes


def differing(checks):
    """Names of the checks that differ."""
    return {name for name, check in checks.items() if check["outcome"] == "differs"}


# --- the tests themselves ---------------------------------------------------


def test_unpaired_is_welch_and_paired_is_students_paired_test():
    random = np.random.default_rng(1)
    a, b = random.normal(1.0, 0.3, (9, 50)), random.normal(1.1, 0.6, (14, 50))
    found = replica_statistics.Comparison(a, b, False)
    expected = stats.ttest_ind(a, b, equal_var=False)
    # The floor changes a variance of 0.1 by (2e-5)^2 = 4e-10, t by 2e-9 of itself.
    np.testing.assert_allclose(found.t, expected.statistic, rtol=1e-8)
    np.testing.assert_allclose(found.p(0.0), expected.pvalue, rtol=1e-6)
    np.testing.assert_allclose(found.degrees, expected.df, rtol=1e-8)
    pairs = replica_statistics.Comparison(a, b[:9], True)
    expected = stats.ttest_rel(a, b[:9])
    np.testing.assert_allclose(pairs.t, expected.statistic, rtol=1e-8)
    np.testing.assert_allclose(pairs.p(0.0), expected.pvalue, rtol=1e-6)


def test_the_debiased_relmse_is_the_mean_over_all_pairs_of_replicas():
    random = np.random.default_rng(2)
    picture = truth(4, 5)
    ours, reference = normal(random, picture, 4, 0.5), normal(random, picture, 5, 0.5)
    for is_paired in (False, True):
        stacks = [ours, reference[:4] if is_paired else reference]
        a, b = (stack[..., :3] for stack in stacks)
        mean = b.mean(axis=0)
        weight = 1 / (mean**2 + (0.01 * mean.mean()) ** 2)
        products = [
            (a[i] - b[j]) * (a[k] - b[m])
            for i in range(len(a))
            for k in range(len(a))
            for j in range(len(b))
            for m in range(len(b))
            if i != k and j != m and (not is_paired or (i == j and k == m))
        ]
        expected = (np.mean(products, axis=0) * weight).mean()
        found = judge(*stacks, is_paired=is_paired)[1]["relmse"]
        assert found["debiased"] == pytest.approx(expected, rel=1e-9)


def test_the_jackknife_equals_leaving_replicas_out_one_by_one():
    random = np.random.default_rng(3)
    a, b = normal(random, truth(4, 5), 5, 0.5), normal(random, truth(4, 5), 6, 0.5)
    weight = random.uniform(0.5, 2, a.shape[1:])

    def estimate(ours, reference):
        noise = ours.var(axis=0, ddof=1) / len(ours) + reference.var(axis=0, ddof=1) / len(reference)
        return (((ours.mean(axis=0) - reference.mean(axis=0)) ** 2 - noise) * weight).mean()

    total = 0.0
    for which, stack in enumerate((a, b)):
        left = [
            estimate(*((np.delete(s, k, 0) if i == which else s) for i, s in enumerate((a, b))))
            for k in range(len(stack))
        ]
        total += (len(stack) - 1) * np.var(left)
    assert replica_statistics._jackknife(a, b, weight, False) == pytest.approx(np.sqrt(total), rel=1e-9)


# --- null behaviour ---------------------------------------------------------


@pytest.mark.parametrize("is_paired", [False, True])
def test_where_only_noise_differs_every_check_rejects_as_rarely_as_it_says(is_paired):
    """400 pairs of equal truth. A binomial variable of 400 trials exceeds the bounds once in 10^4 runs."""
    trials, random, picture = 400, np.random.default_rng(4), truth()
    counts, spreads, relmse, errors = {}, [], [], []
    for _ in range(trials):
        checks, found, _ = judge(normal(random, picture), normal(random, picture), is_paired=is_paired)
        for name in differing(checks):
            counts[name] = counts.get(name, 0) + 1
        spreads.append(found["pixels"]["spread"])
        relmse.append(found["relmse"]["debiased"])
        errors.append(found["relmse"]["standard_error"])

    def most(level):
        return stats.binom.ppf(1 - 1e-4, trials, level)

    # Three channels are tested at 1 % each; their noise is independent here, so 3 % is the worst case.
    assert counts.pop("image_mean", 0) <= most(0.03)
    # A normal mean of t would leave +-4.4 / sqrt(n) in 1e-5 of the trials; its variance is nu / (nu - 2).
    assert counts.pop("structure", 0) <= most(0.001)
    # One pixel of 384 is over 0.25 %, so the family of pixels decides at its own level.
    for name in ("blocks_8", "blocks_4", "pixels", "alpha_mean", "alpha_blocks"):
        assert counts.pop(name, 0) <= most(0.01), name
    # These have margins of many standard deviations, so nothing may be rejected.
    assert not counts
    # And they are not merely blind: t is as wide as it should be (one spread has sd 1 / sqrt(2 * 1152)).
    assert np.mean(spreads) == pytest.approx(1, abs=4 * 0.021 / np.sqrt(trials) + 0.005)
    # The debiased relMSE is 0 on average; the jackknife's error is right or too large by up to sqrt(2).
    assert abs(np.mean(relmse)) < 4 * np.std(relmse) / np.sqrt(trials)
    assert 0.9 < np.sqrt(np.mean(np.square(errors))) / np.std(relmse) < 1.6


def test_the_error_rate_of_a_block_family_is_the_one_asked_for():
    """At a level of 30 % the rate is bounded from both sides: the family is neither blind nor too eager."""
    trials, random, picture = 300, np.random.default_rng(5), truth()
    rejected = sum(
        "blocks_8" in differing(judge(normal(random, picture), normal(random, picture), significance=0.3)[0])
        for _ in range(trials)
    )
    low, high = stats.binom.ppf([1e-4, 1 - 1e-4], trials, 0.3)
    assert low <= rejected <= high


# --- power ------------------------------------------------------------------


@pytest.mark.parametrize("is_paired", [False, True])
def test_a_shift_of_the_whole_picture_by_one_percent_is_found(is_paired):
    random = np.random.default_rng(6)
    ours, reference = normal(random, truth() * 1.01), normal(random, truth())
    checks, found, _ = judge(ours, reference, is_paired=is_paired)
    # The standard error is about 5 % / sqrt(384) * sqrt(2 / 16) = 0.09 %: 1 % is 11 of them.
    assert {"image_mean", "structure", "alpha_mean"} <= differing(checks)
    for row in found["means"]:
        assert row["relative_low"] < 0.01 < row["relative_high"]
        assert row["relative_standard_error"] == pytest.approx(0.0009, rel=0.5)
        assert row["noise_variance_ours"] == pytest.approx(
            np.mean((NOISE * 1.01 * truth()[..., NAMES.index(row["channel"])]) ** 2), rel=0.1
        )


def test_an_allowance_covers_a_shift_within_it_and_no_more():
    random = np.random.default_rng(7)
    reference = normal(random, truth())
    inside = judge(normal(random, truth() * 1.004), reference, systematic_allowance=0.005)[0]
    assert not differing(inside)
    outside = judge(normal(random, truth() * 1.012), reference, systematic_allowance=0.005)[0]
    assert "image_mean" in differing(outside)


def test_a_bias_of_one_block_is_found_where_the_image_mean_is_not_off():
    random = np.random.default_rng(8)
    picture = truth()
    corners = [truth()[rows, columns].sum(axis=(0, 1)) for rows, columns in CORNERS]
    picture[CORNERS[0]] *= 1.04
    picture[CORNERS[1]] *= 1 - 0.04 * corners[0] / corners[1]
    checks, found, _ = judge(normal(random, picture), normal(random, truth()))
    assert "blocks_8" in differing(checks) and "image_mean" not in differing(checks)
    worst = next(row for row in found["blocks"] if row["size"] == 8)
    assert (worst["worst_x"], worst["worst_y"]) in ((0, 0), (16, 8))


def test_a_pattern_that_no_mean_shows_is_found_or_at_least_named():
    """Columns 2 % brighter and darker by turns, two pixels wide: blocks of 8 and 4 do not see them."""
    random = np.random.default_rng(9)
    pattern = 1 + 0.02 * np.where(np.arange(WIDTH) // 2 % 2 == 0, 1, -1)[None, :, None]
    checks, _, _ = judge(normal(random, truth() * pattern), normal(random, truth()))
    assert not {"image_mean", "blocks_8", "blocks_4", "structure"} & differing(checks)
    # Per pixel 2 % is 1.1 standard errors (5 % sqrt(2 / 16) = 1.8 %): t spreads sqrt(1 + 1.1^2) = 1.5 times.
    assert "pixel_spread" in differing(checks)
    # Smooth structure is named in the notes: the left half 0.9 % brighter, the right one darker.
    halves = 1 + 0.009 * np.where(np.arange(WIDTH) < WIDTH // 2, 1, -1)[None, :, None]
    _, _, notes = judge(normal(random, truth() * halves), normal(random, truth()))
    assert any("Neighbouring pixels" in note for note in notes)


def test_a_bias_of_sub_pixel_images_does_not_hide_behind_the_pictures_own_changes():
    """Sub-pixel images of a steep picture: unpaired, its changes within a pixel are noise and hide 1 %."""
    random = np.random.default_rng(10)
    fine = truth(4 * HEIGHT, 4 * WIDTH)
    fine[..., :3] *= 1 + 0.9 * np.sin(np.arange(4 * WIDTH) * np.pi / 2)[None, :, None]
    ours, reference = (
        image_metrics.sub_pixel_images(picture * (1 + random.normal(0, NOISE, fine.shape)), 4, "t")
        for picture in (fine * 1.01, fine)
    )
    assert "image_mean" in differing(judge(ours, reference, is_paired=True)[0])
    assert "image_mean" not in differing(judge(ours, reference)[0])
    same = image_metrics.sub_pixel_images(fine * (1 + random.normal(0, NOISE, fine.shape)), 4, "t")
    checks, found, notes = judge(same, reference, is_paired=True)
    assert not differing(checks) and any("in pairs" in note for note in notes)
    # The spread of t stays that of noise although the picture changes by 90 % within a pixel.
    assert found["pixels"]["spread"] == pytest.approx(1, abs=0.1)


# --- what cannot be told, and noise that is not normal -----------------------


def test_noise_that_hides_one_percent_is_no_agreement():
    random = np.random.default_rng(11)
    checks, _, _ = judge(normal(random, truth(), noise=2.0), normal(random, truth(), noise=2.0))
    assert checks["image_mean_sensitivity"]["outcome"] == "could_not_tell"
    assert checks["image_mean"]["outcome"] == "agrees"
    # A difference that shows through the noise is one all the same.
    checks, _, _ = judge(normal(random, truth() * 3, noise=2.0), normal(random, truth(), noise=2.0))
    assert "image_mean" in differing(checks)


def test_few_replicas_can_differ_but_not_agree():
    random = np.random.default_rng(12)
    checks, _, _ = judge(normal(random, truth(), 4), normal(random, truth(), 16))
    assert checks["replicas"]["outcome"] == "could_not_tell"
    checks, found, _ = judge(normal(random, truth(), 2), normal(random, truth(), 2))
    assert checks["debiased_relmse"]["outcome"] == "could_not_tell"
    assert found["relmse"]["standard_error"] is None


def test_heavy_tails_are_named_and_their_error_rate_is_known():
    """Noise with fireflies (1 % of the pixels of a replica 5 times too bright, the mean kept).

    Equal noise on both sides: t is symmetric, and its tests reject too rarely. Fireflies on one side alone:
    the rates are higher than they say; the notes name the tails in every case, and a shift of 3 % is still
    found.
    """
    random, picture = np.random.default_rng(13), truth()

    def fireflies(scale=1.0):
        factor = np.where(random.random((REPLICAS, HEIGHT, WIDTH, 1)) < 0.01, 5.0, 0.96 / 0.99)
        return normal(random, picture * scale) * factor / (0.05 + 0.96)

    trials, rejected = 100, {"both": 0, "one": 0}
    for _ in range(trials):
        both, found, notes = judge(fireflies(), fireflies())
        assert any("heavy tails" in note for note in notes)
        assert found["tails"][0]["kurtosis"] > 1.2 * found["tails"][0]["kurtosis_of_normal_noise"]
        rejected["both"] += bool({"image_mean", "blocks_8"} & differing(both))
        rejected["one"] += bool(
            {"image_mean", "blocks_8"} & differing(judge(fireflies(), normal(random, picture))[0])
        )
    # Normal noise would be rejected at 2 % to 4 % here: 1 % to 3 % by the image mean, 1 % by the blocks.
    assert rejected["both"] <= stats.binom.ppf(1 - 1e-4, trials, 0.04)
    assert rejected["one"] < 12
    assert "image_mean" in differing(judge(fireflies(1.03), fireflies())[0])


def test_exact_estimators_are_compared_by_value():
    picture = np.repeat(truth()[None], REPLICAS, axis=0)
    checks, found, _ = judge(picture, picture.copy())
    assert {check["outcome"] for check in checks.values()} == {"agrees"}
    assert found["pixels"]["exact"] == HEIGHT * WIDTH * 3
    off = picture.copy()
    off[:, 3, 4, 1] *= 1.001
    assert "pixels" in differing(judge(off, picture)[0]), "one pixel of 384 is 0.26 %, above 0.25 %"
    # f32 replicas whose mean is not exact in binary are still without noise.
    third = np.full((12, HEIGHT, WIDTH, 4), np.float32(1 / 3))
    assert judge(third, third)[1]["pixels"]["tests"] == 0


def test_black_channels_agree_and_a_black_reference_does_not_divide_by_zero():
    random = np.random.default_rng(14)
    ours, reference = normal(random, truth()), normal(random, truth())
    ours[..., 2] = reference[..., 2] = 0
    assert not differing(judge(ours, reference)[0])
    black = np.zeros_like(ours)
    assert {check["outcome"] for check in judge(black, black)[0].values()} == {"agrees"}
    assert "image_mean" in differing(judge(ours, black)[0])


def test_negative_radiance_is_our_error_and_not_the_references():
    random = np.random.default_rng(15)
    ours, reference = normal(random, truth()), normal(random, truth())
    reference[2, 3, 4, 0] = -1e-4
    assert "negative_values" not in differing(judge(ours, reference)[0])
    ours[2, 3, 4, 0] = -1e-4
    assert "negative_values" in differing(judge(ours, reference)[0])


def test_a_colour_outside_of_the_gamut_is_negative_on_both_sides():
    random = np.random.default_rng(16)
    fire = truth()
    fire[..., 2] *= -0.1
    ours, reference = normal(random, fire), normal(random, fire)
    checks = judge(ours, reference)[0]
    assert not differing(checks)
    assert "of B, where the reference is negative" in checks["negative_values"]["reason"]
    # Another channel has no such excuse, and neither has a reference that is positive.
    ours[2, 3, 4, 0] = -1e-4
    assert "negative_values" in differing(judge(ours, reference)[0])
    assert "negative_values" in differing(judge(normal(random, fire), normal(random, truth()))[0])


def test_the_default_allowance_follows_the_reference():
    default = replica_statistics.default_allowance
    cycles = "Cycles, bpy 5.0.1"
    found = [
        default(count, cycles) and default(count, cycles)[0] for count in (16, 64, 256, 1023, 1024, 4096)
    ]
    assert found == [None, 0.01, 0.005, 0.005, 0.002, 0.002]
    assert default(256, cycles, by_subset=True)[0] == 0.12 / 256
    assert default(64, "Mitsuba")[0] == 0.0 and default(None, cycles) is None and default(64, None) is None


# --- files ------------------------------------------------------------------


def write(path, pixels, seed=None, samples=256, renderer="Cycles, bpy 5.0.1"):
    """One replica with its provenance."""
    save(path, pixels.astype(np.float32))
    image = oiio.ImageBuf(str(path))
    for name, value in (("seed", seed), ("samples", samples), ("renderer", renderer)):
        if value is not None:
            image.specmod().attribute(f"cloudparity:{name}", value)
    assert image.write(str(path)), oiio.geterror()
    return str(path)


def side(folder, name, stack, first_seed=100, **more):
    """The files of a stack."""
    return [
        write(folder / f"{name}{k}.exr", pixels, first_seed + k, **more) for k, pixels in enumerate(stack)
    ]


ASKED = {"significance": 0.01, "systematic_allowance": None, "debiased_relmse": 1e-3, "sub_pixels": None}


def test_files_of_replicas_give_a_verdict_maps_and_every_formula(tmp_path):
    random = np.random.default_rng(16)
    ours = side(tmp_path, "o", normal(random, truth(), 8))
    reference = side(tmp_path, "r", normal(random, truth(), 8), 5000)
    out = tmp_path / "run"
    result = diff(ours, reference, tolerances={}, statistics=ASKED, out=str(out))
    assert result["verdict"] == "agrees", result["reasons"]
    found = result["statistics"]
    assert found["systematic_allowance"] == 0.005 and "256" in found["allowance_rule"]
    assert found["design"] == "unpaired" and found["formulas"]["debiased"]
    assert {"t.png", "t_legend.svg", "relmse.png", "t.exr"} <= {path.name for path in out.iterdir()}
    assert json.loads((out / "diff.json").read_text()) == result
    t = oiio.ImageBuf(str(out / "t.exr")).get_pixels()
    assert t.shape == (HEIGHT, WIDTH, 3) and abs(t.mean()) < 0.2 and 0.8 < t.std() < 1.3


def test_one_picture_per_side_at_four_times_the_resolution_is_sixteen_pairs(tmp_path):
    random = np.random.default_rng(17)
    fine = truth(4 * HEIGHT, 4 * WIDTH)
    files = [
        write(tmp_path / name, fine * (1 + random.normal(0, NOISE, fine.shape)), seed)
        for name, seed in (("o.exr", 100), ("r.exr", 5000))
    ]
    asked = ASKED | {"sub_pixels": 4, "systematic_allowance": 0}
    result = diff(files[:1], files[1:], tolerances={}, statistics=asked)
    assert result["verdict"] == "agrees", result["reasons"]
    assert result["images"]["width"] == WIDTH and result["statistics"]["design"] == "paired"
    assert result["statistics"]["replicas"] == {"ours": 16, "reference": 16}
    for wrong in (5, 7):
        result = diff(files[:1], files[1:], tolerances={}, statistics=asked | {"sub_pixels": wrong})
        assert result["verdict"] == "could_not_tell" and "do not divide" in result["reasons"][0]


def test_replicas_that_are_none_are_refused_with_what_to_do(tmp_path):
    random = np.random.default_rng(18)
    stack = normal(random, truth(), 3)
    good = side(tmp_path, "r", stack, 5000)
    copied = write(tmp_path / "copy.exr", stack[0], None), write(tmp_path / "copy2.exr", stack[0], None)
    cases = {
        "is one file": ([good[0]], good[1:]),
        "the seed 7": ([write(tmp_path / f"s{k}.exr", stack[k] * 1.1, 7) for k in (0, 1)], good),
        "a copy is no replica": (list(copied), good),
        "on both sides": (good[:2], good[1:]),
        "64, 256 samples": (
            [write(tmp_path / f"n{n}.exr", stack[0] * n, n, samples=n) for n in (64, 256)],
            good,
        ),
        "is 24 x 15": ([write(tmp_path / f"h{k}.exr", stack[k][:-1], k) for k in (0, 1)], good),
        "no systematic allowance": (
            side(tmp_path, "o", stack * 1.01),
            side(tmp_path, "p", stack[::-1], 5000, samples=None),
        ),
    }
    for text, (ours, reference) in cases.items():
        result = diff(ours, reference, tolerances={}, statistics=ASKED)
        assert result["verdict"] == "could_not_tell" and text in result["reasons"][0], (
            text,
            result["reasons"],
        )
        assert result["statistics"] is None
    # Two seeds with the same pixels are what an exact estimator renders.
    same = [write(tmp_path / f"e{k}.exr", truth(), k) for k in range(8)]
    twin = [write(tmp_path / f"f{k}.exr", truth(), 5000 + k) for k in range(8)]
    result = diff(same, twin, tolerances={}, statistics=ASKED)
    assert result["verdict"] == "agrees", result["reasons"]


def test_values_that_are_not_finite_decide_before_any_statistics(tmp_path):
    stack = normal(np.random.default_rng(19), truth(), 4)
    stack[1, 2, 3, 0] = np.inf
    result = diff(side(tmp_path, "o", stack[:2]), side(tmp_path, "r", stack[2:], 5000), statistics=ASKED)
    assert result["verdict"] == "differs" and result["statistics"] is None
