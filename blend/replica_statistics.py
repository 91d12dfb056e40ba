"""The statistical verdict on two Monte Carlo pictures: are they the same, as far as their noise can tell?

A replica is one render of a picture, with its own random numbers and the number of samples of all others. The
replica is the unit of every test here: variances come from the spread over replicas, never from the samples
or from neighbouring pixels. With K replicas A_k of ours, L replicas B_k of the reference, means A and B, and
variances s_A^2, s_B^2 (K - 1 and L - 1 degrees of freedom):

  unpaired (other seeds): Welch, SE^2 = s_A^2 / K + s_B^2 / L, nu by Welch and Satterthwaite;
  paired (sub-pixel images): d_k = A_k - B_k, SE^2 = s_d^2 / K, nu = K - 1.

t = (A - B) / SE. A test rejects where p < alpha, p two-sided of max(|A - B| - tau |B|, 0) / SE under
Student's t with nu degrees of freedom; tau is the systematic allowance, an error of the reference that its
seeds share and do not show. Families of M tests use Sidak's alpha' = 1 - (1 - alpha)^(1/M). Every variance is
increased by (1e-5 (1 + |B|))^2, so that exact estimators do not divide by zero (both sides together, so
twice, where paired).

Why sub-pixel images are paired. Render both sides at n times the resolution per axis and let image k hold the
pixels at position k of every n x n cell: n^2 pictures of the size that is wanted, without shared samples.
Their expectations mu_k differ by position, because the picture changes within a pixel: positions are strata,
not random draws. If both renderers agree, mu_k is the same on both sides. Welch would count the spread of
mu_k as noise: its standard error is too large, and the test passes too easily. In d_k it cancels: E d_k is
the bias at position k. The d_k are independent with variances v_k, which may differ; Var(mean d) =
sum v_k / K^2, and E s_d^2 / K = sum v_k / K^2 + (spread of the bias over positions) / K. So SE^2 is unbiased
where there is no bias, and otherwise errs towards "not significant". Student's t holds exactly for equal v_k.
Unequal ones act like fewer degrees of freedom; single pixels feel that, means over blocks or the image sum
the noise of many pixels and hardly do.

Arrays are float64; stacks of replicas are [k, h, w, c], scene-linear. Memory: a few copies of all replicas.
"""

import math

import numpy as np
from scipy import stats

import image_metrics

DEFAULT_SIGNIFICANCE = 0.01  # alpha; finer levels would trust variances that are optimistic by up to 9 %
INTERVAL = 0.99  # coverage of the reported intervals
BLOCK_SIZES = (8, 4)
FEWEST_REPLICAS = 8  # below, the critical |t| of single pixels is over 8 and agreement would mean nothing
SENSITIVITY_LIMIT = 0.005  # standard error of an image mean, relative to the mean
VARIANCE_FLOOR = 1e-5
PIXEL_SHARE_LIMIT = 0.0025
SPREAD_LIMIT = 1.15
STRUCTURE_LIMIT = 4.4  # standard errors of the mean of t over the pixels of a channel
EXACT_TOLERANCE = 1e-4  # relative difference of pixels that have no noise on either side
EXACT_EPSILON = 1e-5
DEFAULT_RELMSE_LIMIT = 1e-3
HEAVY_TAILS = 1.2  # kurtosis over that of normal noise from which the notes warn
T_RANGE = 4.0  # the t-image runs from -4 to +4

FORMULAS = {
    "t": "(A - B) / SE",
    "standard_error": {
        "unpaired": "sqrt((s_A^2 + f^2) / K + (s_B^2 + f^2) / L), f = 1e-5 (1 + |B|)",
        "paired": "sqrt((s_d^2 + 2 f^2) / K), d_k = A_k - B_k, f = 1e-5 (1 + |B|)",
    },
    "p": "two-sided p of max(|A - B| - tau |B|, 0) / SE, Student's t with nu degrees of freedom",
    "family": "reject where p < 1 - (1 - alpha)^(1 / M), M tests (Sidak)",
    "spread": "standard deviation of t / sqrt(nu / (nu - 2)) over pixels and channels; limit "
    "sqrt(1.15^2 + mean (tau B / SE)^2)",
    "structure": "mean of t over the pixels of a channel; limit 4.4 / sqrt(pixels) + tau mean |B| / SE",
    "neighbour_correlation": "mean of t_i t_j over horizontal and vertical neighbours over mean t^2, "
    "mean of t "
    "removed; about 0 with standard error 1 / sqrt(pairs) where only noise differs",
    "exact_pixels": "without noise on either side: |A - B| <= 1e-4 (|B| + 1e-5)",
    "debiased": "mean ((A - B)^2 - SE_0^2) / (B^2 + epsilon^2), SE_0 without floor: the mean of (A_i - "
    "B_j)(A_k - "
    "B_l) / (B^2 + epsilon^2) over all i != k, j != l, so its expectation holds no noise (paired: d_i "
    "d_k, i != k)",
    "debiased_halves": "mean (A_1 - B_1)(A_2 - B_2) / (B^2 + epsilon^2), means of even and odd replicas",
    "epsilon": "1 % of the mean of the reference over its pixels and colour channels",
    "relmse_standard_error": "jackknife over replicas, weights held; too large by up to sqrt(2) without bias",
    "kurtosis": "mean over pixels of m_4 / m_2^2 over replicas; 3 (K - 1) / (K + 1) for normal noise",
}


class Comparison:
    """The difference of two stacks of replicas [k, ...] at every place of [...], with what its noise is.

    difference, reference: A - B and B; error: SE with floor; degrees: nu; noise: SE_0^2, without floor;
    variance: pair of the variances of one replica, without floor; exact: no noise on either side.
    """

    def __init__(self, ours, reference, is_paired):
        ours, reference = np.asarray(ours, np.float64), np.asarray(reference, np.float64)
        self.reference = reference.mean(axis=0)
        self.variance = ours.var(axis=0, ddof=1), reference.var(axis=0, ddof=1)
        floor = (VARIANCE_FLOOR * (1 + np.abs(self.reference))) ** 2
        if is_paired:
            pairs = ours - reference
            count = len(pairs)
            self.difference = pairs.mean(axis=0)
            self.noise = pairs.var(axis=0, ddof=1) / count
            self.error = np.sqrt(self.noise + 2 * floor / count)
            self.degrees = np.full(self.difference.shape, count - 1.0)
            self.exact = np.ptp(pairs, axis=0) == 0
            return
        self.difference = ours.mean(axis=0) - self.reference
        shares = [
            (variance + floor) / len(stack)
            for variance, stack in zip(self.variance, (ours, reference), strict=True)
        ]
        self.noise = self.variance[0] / len(ours) + self.variance[1] / len(reference)
        self.error = np.sqrt(shares[0] + shares[1])
        self.degrees = (shares[0] + shares[1]) ** 2 / (
            shares[0] ** 2 / (len(ours) - 1) + shares[1] ** 2 / (len(reference) - 1)
        )
        self.exact = (np.ptp(ours, axis=0) == 0) & (np.ptp(reference, axis=0) == 0)

    @property
    def t(self):
        """(A - B) / SE."""
        return self.difference / self.error

    @property
    def unit(self):
        """t over the standard deviation of Student's t itself; NaN for 2 degrees of freedom or fewer."""
        spread = np.where(self.degrees > 2, self.degrees / np.maximum(self.degrees - 2, 1e-9), np.nan)
        return self.t / np.sqrt(spread)

    def p(self, allowance):
        """Two-sided p of the part of the difference that the systematic allowance does not cover."""
        excess = np.maximum(np.abs(self.difference) - allowance * np.abs(self.reference), 0.0)
        return 2 * stats.t.sf(excess / self.error, self.degrees)


def sidak(significance, tests):
    """Level of each of `tests` independent tests, so that all hold together with 1 - significance."""
    return -math.expm1(math.log1p(-significance) / max(tests, 1))


def judge(ours, reference, names, colour, alpha, settings):
    """Judge two stacks [k, h, w, c] of finite replicas.

    `colour` and `alpha` are channel positions, `names` all channel names. `settings`: "significance",
    "systematic_allowance", "allowance_rule" (text), "debiased_relmse", "is_paired".
    Returns (statistics for the result, checks, notes, maps {"t": [h, w], "t_channels": [h, w, c],
    "relmse": [h, w]}).
    """
    alpha_level, allowance = settings["significance"], settings["systematic_allowance"]
    is_paired = settings["is_paired"]
    colours = [stack[..., colour].astype(np.float64) for stack in (ours, reference)]
    colour_names = [names[i] for i in colour]
    image = Comparison(*(stack.mean(axis=(1, 2)) for stack in colours), is_paired)
    pixels = Comparison(*colours, is_paired)
    means = _mean_rows(image, pixels, colour_names, alpha_level, allowance)
    checks = [
        _check_replicas(len(ours), len(reference)),
        _check_negative(ours, reference, names, alpha_level),
        _check_sensitivity(means, "image_mean_sensitivity"),
        _check_means(means, alpha_level, "image_mean"),
    ]
    blocks = []
    for size in BLOCK_SIZES:
        row, check = _test_blocks(colours, colour_names, size, settings, f"blocks_{size}")
        blocks.append(row)
        checks.append(check)
    pixel_row, pixel_checks = _test_pixels(pixels, alpha_level, allowance)
    structure, structure_check = _test_structure(pixels, colour_names, allowance)
    relmse, relmse_map, relmse_check = _test_relmse(*colours, pixels, settings)
    checks += [*pixel_checks, structure_check, relmse_check]
    alpha_row = None
    if alpha:
        alpha_row, alpha_checks = _test_alpha(
            [stack[..., alpha].astype(np.float64) for stack in (ours, reference)],
            [names[i] for i in alpha],
            settings,
        )
        checks += alpha_checks
    tails = _tails(colours, is_paired)
    statistics = {
        "design": "paired" if is_paired else "unpaired",
        "replicas": {"ours": len(ours), "reference": len(reference)},
        "significance": alpha_level,
        "systematic_allowance": allowance,
        "allowance_rule": settings["allowance_rule"],
        "interval": INTERVAL,
        "means": means,
        "blocks": blocks,
        "pixels": pixel_row,
        "structure": structure,
        "relmse": relmse,
        "alpha": alpha_row,
        "tails": tails,
        "t_range": T_RANGE,
        "formulas": FORMULAS
        | {"standard_error": FORMULAS["standard_error"]["paired" if is_paired else "unpaired"]},
    }
    bright = [image_metrics.luminance(stack) for stack in colours]
    maps = {"t": Comparison(*bright, is_paired).t, "t_channels": pixels.t, "relmse": relmse_map}
    return statistics, checks, _notes(statistics), maps


def _check(name, value, limit, outcome, reason):
    return {
        "name": name,
        "value": None if value is None else float(value),
        "limit": float(limit),
        "outcome": outcome,
        "reason": reason,
    }


def _check_replicas(ours, reference):
    fewest = min(ours, reference)
    enough = fewest >= FEWEST_REPLICAS
    reason = f"{ours} replicas of ours, {reference} of the reference; at least {FEWEST_REPLICAS} are needed"
    return _check(
        "replicas",
        fewest,
        FEWEST_REPLICAS,
        "agrees" if enough else "could_not_tell",
        reason + ("." if enough else " before agreement means anything: render more."),
    )


def _check_negative(ours, reference, names, significance):
    """Negative values are an error of ours, but in channels that the reference shows to be negative, too.

    Such is the blue of a fire: linear Rec. 709 does not hold the colours of blackbodies below some 1900 K.
    """
    counts = (ours < 0).sum(axis=(0, 1, 2))
    beyond = _is_negative(reference, significance)
    wrong, shared = int(counts[~beyond].sum()), int(counts[beyond].sum())
    reason = f"Ours has {wrong} negative values" + ("." if wrong == 0 else ", which no radiance is.")
    if shared:
        channels = ", ".join(name for name, found in zip(names, beyond & (counts > 0), strict=True) if found)
        reason += f" Not counted: {shared} of {channels}, where the reference is negative, too."
    return _check("negative_values", wrong, 0, "agrees" if wrong == 0 else "differs", reason)


def _is_negative(stack, significance):
    """Of each channel of a stack, whether the mean of some pixel is below 0 by more than its noise."""
    stack = stack.astype(np.float64)
    error = np.sqrt((stack.var(axis=0, ddof=1) + VARIANCE_FLOOR**2) / len(stack))
    smallest = stats.t.cdf(stack.mean(axis=0) / error, len(stack) - 1).min(axis=(0, 1))
    return smallest < sidak(significance, stack[0].size)


def _mean_rows(image, pixels, names, significance, allowance):
    """One row per channel: bias of the image mean apart from the noise of either side."""
    p = image.p(allowance)
    reach = stats.t.ppf(0.5 + INTERVAL / 2, image.degrees) * image.error
    limit = stats.t.ppf(1 - significance / 2, image.degrees) * image.error + allowance * np.abs(
        image.reference
    )
    rows = []
    for c, name in enumerate(names):
        reference, difference = float(image.reference[c]), float(image.difference[c])

        def share(value, reference=reference):
            return float(value) / abs(reference) if reference else None

        noise = [float(side[..., c].mean()) for side in pixels.variance]
        rows.append(
            {
                "channel": name,
                "ours": reference + difference,
                "reference": reference,
                "bias": difference,
                "standard_error": float(image.error[c]),
                "degrees": float(image.degrees[c]),
                "t": float(image.t[c]),
                "p": float(p[c]),
                "relative_bias": share(difference),
                "relative_low": share(difference - reach[c]),
                "relative_high": share(difference + reach[c]),
                "relative_standard_error": share(image.error[c]),
                "relative_limit": share(limit[c]),
                "noise_variance_ours": noise[0],
                "noise_variance_reference": noise[1],
                "is_black": bool(reference == 0 and difference == 0 and not any(noise)),
            }
        )
    return rows


def _check_sensitivity(rows, name):
    """An image mean whose noise is over the limit proves nothing, whatever its t."""
    lit = [row for row in rows if not row["is_black"]]
    what = "image mean"
    if not lit:
        return _check(name, 0, SENSITIVITY_LIMIT, "agrees", f"Every {what} is exactly 0 on both sides.")
    worst = max(lit, key=lambda row: math.inf if row["reference"] == 0 else row["relative_standard_error"])
    value = worst["relative_standard_error"]
    if value is None:
        reason = (
            f"The reference's {what} of {worst['channel']} is 0 and ours is not, so no relative error exists."
        )
        return _check(name, None, SENSITIVITY_LIMIT, "could_not_tell", reason)
    enough = value <= SENSITIVITY_LIMIT
    reason = (
        f"The standard error of the {what} of {worst['channel']} is {100 * value:.3g} %, "
        f"limit {100 * SENSITIVITY_LIMIT:g} %"
    )
    return _check(
        name,
        value,
        SENSITIVITY_LIMIT,
        "agrees" if enough else "could_not_tell",
        reason + ("." if enough else ": too noisy to tell, add replicas or samples."),
    )


def _check_means(rows, significance, name):
    worst = min(rows, key=lambda row: row["p"])
    outcome = "agrees" if worst["p"] >= significance else "differs"
    reason = f"The image mean of {worst['channel']} is off by "
    if worst["relative_bias"] is None:
        reason += f"{worst['bias']:.3g} from a reference of 0, p = {worst['p']:.2g}."
        return _check(name, None, 0, outcome, reason)
    reason += (
        f"{100 * worst['relative_bias']:+.3g} % (99 % interval {100 * worst['relative_low']:+.3g} % to "
        f"{100 * worst['relative_high']:+.3g} %), limit {100 * worst['relative_limit']:.3g} %, "
        f"p = {worst['p']:.2g}."
    )
    return _check(name, abs(worst["relative_bias"]), worst["relative_limit"], outcome, reason)


def _block_stack(stack, size):
    return np.stack([image_metrics.blocks_of(replica, size) for replica in stack])


def _test_blocks(stacks, names, size, settings, name):
    """Every block mean of every channel, as one family."""
    blocks = Comparison(*(_block_stack(stack, size) for stack in stacks), settings["is_paired"])
    p = blocks.p(settings["systematic_allowance"])
    level = sidak(settings["significance"], p.size)
    rejected = int((p < level).sum())
    y, x, c = np.unravel_index(int(np.argmin(p)), p.shape)
    reference = float(blocks.reference[y, x, c])
    relative = float(blocks.difference[y, x, c]) / abs(reference) if reference else None
    row = {
        "size": size,
        "tests": int(p.size),
        "level": level,
        "rejected": rejected,
        "smallest_p": float(p[y, x, c]),
        "worst_x": int(x) * size,
        "worst_y": int(y) * size,
        "worst_channel": names[c],
        "worst_t": float(blocks.t[y, x, c]),
        "worst_relative_bias": relative,
    }
    reason = f"{rejected} of {p.size} means of {size} x {size} blocks differ at p < {level:.2g}"
    if rejected:
        reason += (
            f", the worst at x {row['worst_x']}, y {row['worst_y']} in {names[c]}: t = {row['worst_t']:+.3g}"
        )
        reason += f", {100 * relative:+.3g} %" if relative is not None else ""
    else:
        reason += f"; the smallest p is {row['smallest_p']:.2g}"
    return row, _check(name, rejected, 0, "differs" if rejected else "agrees", reason + ".")


def _test_pixels(pixels, significance, allowance):
    """Share of pixels that differ, and whether t spreads as wide as noise alone would."""
    p = pixels.p(allowance)
    noisy = ~pixels.exact
    level = sidak(significance, int(noisy.sum()))
    scale = np.abs(pixels.reference) + EXACT_EPSILON
    is_off = np.where(noisy, p < level, np.abs(pixels.difference) > EXACT_TOLERANCE * scale)
    share = float(is_off.any(axis=-1).mean())
    reason = (
        f"{100 * share:.3g} % of the pixels differ at p < {level:.2g} (without noise: by over 0.01 %), "
        f"limit {100 * PIXEL_SHARE_LIMIT:g} %."
    )
    checks = [
        _check(
            "pixels", share, PIXEL_SHARE_LIMIT, "differs" if share > PIXEL_SHARE_LIMIT else "agrees", reason
        )
    ]
    unit = pixels.unit[noisy & np.isfinite(pixels.unit)]
    spread = float(unit.std()) if unit.size > 1 else None
    allowed = allowance * np.abs(pixels.reference[noisy]) / pixels.error[noisy]
    limit = math.sqrt(SPREAD_LIMIT**2 + (float((allowed**2).mean()) if allowed.size else 0.0))
    floored = noisy & (pixels.error**2 > 2 * pixels.noise)
    row = {
        "tests": int(noisy.sum()),
        "exact": int(pixels.exact.sum()),
        "level": level,
        "rejected_share": share,
        "spread": spread,
        "spread_limit": limit,
        "floored_share": float(floored.mean()),
    }
    if spread is None:
        text = "No pixel has noise, so t has no spread."
        checks.append(_check("pixel_spread", None, limit, "agrees", text))
    else:
        outcome = "agrees" if spread <= limit else "differs"
        text = f"t spreads {spread:.3g} times as wide as noise alone would, limit {limit:.3g}."
        checks.append(_check("pixel_spread", spread, limit, outcome, text))
    return row, checks


def _test_structure(pixels, names, allowance):
    """Mean of t per channel, and whether neighbours share the sign of their difference."""
    rows, worst = [], None
    for c, name in enumerate(names):
        noisy = ~pixels.exact[..., c]
        count = int(noisy.sum())
        if count == 0:
            continue
        t = np.where(noisy, pixels.t[..., c], 0.0)
        mean = float(t[noisy].mean())
        cover = np.abs(pixels.reference[..., c][noisy]) / pixels.error[..., c][noisy]
        limit = STRUCTURE_LIMIT / math.sqrt(count) + allowance * float(cover.mean())
        correlation, pairs = _neighbour_correlation(np.where(noisy, t - mean, 0.0), noisy)
        row = {
            "channel": name,
            "mean_t": mean,
            "limit": limit,
            "neighbour_correlation": correlation,
            "neighbour_pairs": pairs,
            "neighbour_z": None if correlation is None else correlation * math.sqrt(pairs),
        }
        rows.append(row)
        if worst is None or abs(mean) / limit > abs(worst["mean_t"]) / worst["limit"]:
            worst = row
    if worst is None:
        return rows, _check("structure", None, 0, "agrees", "No pixel has noise, so t has no structure.")
    outcome = "agrees" if abs(worst["mean_t"]) <= worst["limit"] else "differs"
    reason = (
        f"The mean of t over the pixels of {worst['channel']} is {worst['mean_t']:+.3g}, limit "
        f"{worst['limit']:.3g}."
    )
    return rows, _check("structure", abs(worst["mean_t"]), worst["limit"], outcome, reason)


def _neighbour_correlation(t, noisy):
    """Correlation of t (mean removed, 0 where there is no noise) with its right and lower neighbours."""
    pairs = int((noisy[:, 1:] & noisy[:, :-1]).sum() + (noisy[1:] & noisy[:-1]).sum())
    power = float((t[noisy] ** 2).mean())
    if pairs == 0 or power == 0:
        return None, pairs
    total = float((t[:, 1:] * t[:, :-1]).sum() + (t[1:] * t[:-1]).sum())
    return total / pairs / power, pairs


def _test_relmse(ours, reference, pixels, settings):
    """Squared relative bias without noise, its standard error, and the plain figure with noise."""
    epsilon = image_metrics.RELATIVE_EPSILON * abs(float(pixels.reference.mean()))
    limit = settings["debiased_relmse"]
    row = {
        "epsilon": epsilon,
        "plain": None,
        "noise": None,
        "debiased": None,
        "debiased_halves": None,
        "standard_error": None,
        "limit": limit,
        "mean_squared_difference": float((pixels.difference**2).mean()),
        "mean_squared_noise": float(pixels.noise.mean()),
        "mean_squared_bias": float((pixels.difference**2 - pixels.noise).mean()),
    }
    if epsilon == 0:
        same = not pixels.difference.any()
        reason = "The reference is black, and " + ("ours too." if same else "ours is not.")
        check = _check("debiased_relmse", None, limit, "agrees" if same else "differs", reason)
        return row, np.zeros(pixels.difference.shape[:2]), check
    weight = 1 / (pixels.reference**2 + epsilon**2)
    plain = pixels.difference**2 * weight
    value = float(((pixels.difference**2 - pixels.noise) * weight).mean())
    halves = [ours[i::2].mean(axis=0) - reference[i::2].mean(axis=0) for i in (0, 1)]
    error = _jackknife(ours, reference, weight, settings["is_paired"])
    row.update(
        plain=float(plain.mean()),
        noise=float((pixels.noise * weight).mean()),
        debiased=value,
        debiased_halves=float((halves[0] * halves[1] * weight).mean()),
        standard_error=error,
    )
    text = f"The relMSE without noise is {value:.3g}, limit {limit:.3g}"
    if error is None:
        return (
            row,
            plain.mean(axis=-1),
            _check(
                "debiased_relmse", value, limit, "could_not_tell", text + "; two replicas give it no error."
            ),
        )
    text += f", standard error {error:.2g}"
    reach = float(stats.t.ppf(0.5 + INTERVAL / 2, min(len(ours), len(reference)) - 1)) * error
    if value - reach > limit:
        outcome = "differs"
    elif value <= limit and error <= limit:
        outcome = "agrees"
    else:
        outcome = "could_not_tell"
        text += ": too noisy to tell, add replicas or samples"
    return row, plain.mean(axis=-1), _check("debiased_relmse", value, limit, outcome, text + ".")


def _jackknife(ours, reference, weight, is_paired):
    """Standard error of the debiased relMSE, leaving out one replica (of each side, or pair) at a time."""
    stacks = [ours - reference] if is_paired else [ours, reference]
    if min(len(stack) for stack in stacks) < 3:
        return None
    means = [stack.mean(axis=0) for stack in stacks]
    noises = [stack.var(axis=0, ddof=1) / len(stack) for stack in stacks]
    signs = [1.0] if is_paired else [1.0, -1.0]
    difference = sum(sign * mean for sign, mean in zip(signs, means, strict=True))
    total = 0.0
    for which, stack in enumerate(stacks):
        count = len(stack)
        others = sum(noise for index, noise in enumerate(noises) if index != which)
        squares = noises[which] * count * (count - 1)
        estimates = []
        for replica in stack:
            step = replica - means[which]
            # Mean and variance of the other count - 1 replicas, from those of all.
            moved = difference - signs[which] * step / (count - 1)
            spread = (squares - step**2 * count / (count - 1)) / (count - 2)
            noise = spread / (count - 1) + others
            estimates.append(float(((moved**2 - noise) * weight).mean()))
        total += (count - 1) * float(np.var(estimates))
    return math.sqrt(total)


def _test_alpha(stacks, names, settings):
    """Alpha: image mean and 8 x 8 blocks, by the same tests as colour."""
    is_paired, allowance = settings["is_paired"], settings["systematic_allowance"]
    image = Comparison(*(stack.mean(axis=(1, 2)) for stack in stacks), is_paired)
    rows = _mean_rows(image, Comparison(*stacks, is_paired), names, settings["significance"], allowance)
    blocks, block_check = _test_blocks(stacks, names, BLOCK_SIZES[0], settings, "alpha_blocks")
    checks = [
        _check_sensitivity(rows, "alpha_mean_sensitivity"),
        _check_means(rows, settings["significance"], "alpha_mean"),
        block_check,
    ]
    return {"means": rows, "blocks": blocks}, checks


def _tails(stacks, is_paired):
    """How far the noise of single pixels is from normal; paired: that of the differences."""
    wanted = [stacks[0] - stacks[1]] if is_paired else stacks
    rows = []
    for name, stack in zip(["difference"] if is_paired else ["ours", "reference"], wanted, strict=True):
        noisy = np.ptp(stack, axis=0) > 0
        normal = 3 * (len(stack) - 1) / (len(stack) + 1)
        found = stats.kurtosis(stack[:, noisy], axis=0, fisher=False) if noisy.any() else np.array([normal])
        rows.append({"of": name, "kurtosis": float(found.mean()), "kurtosis_of_normal_noise": normal})
    return rows


def _notes(statistics):
    notes = []
    for row in statistics["tails"]:
        if row["kurtosis"] > HEAVY_TAILS * row["kurtosis_of_normal_noise"]:
            where = " (or differs by position)" if row["of"] == "difference" else ""
            notes.append(
                f"The noise of {row['of']} has heavy tails{where}: its kurtosis over replicas is "
                f"{row['kurtosis']:.3g}, {row['kurtosis_of_normal_noise']:.3g} for normal noise. The "
                "levels of the "
                "tests of pixels and blocks are approximate there; where the two sides differ in kind of "
                "noise, "
                "they reject too often."
            )
    known = [row for row in statistics["structure"] if row["neighbour_z"] is not None]
    row = max(known, key=lambda row: row["neighbour_z"], default=None)
    if row is not None and row["neighbour_z"] > STRUCTURE_LIMIT:
        notes.append(
            f"Neighbouring pixels of {row['channel']} differ in the same direction (correlation of t "
            f"{row['neighbour_correlation']:.3g}, {row['neighbour_z']:.3g} standard errors): look for "
            "the shape of "
            "the scene in the t-image. Such a pattern is bias even where every check passes."
        )
    spread = statistics["pixels"]["spread"]
    if spread is not None and spread < 0.9:
        notes.append(
            f"t spreads only {spread:.3g} times as wide as noise should: the tests of pixels are less "
            "sensitive "
            "than their level says (heavy tails, correlated sides, or the variance floor, which decides at "
            f"{100 * statistics['pixels']['floored_share']:.3g} % of the pixels)."
        )
    if statistics["design"] == "paired":
        notes.append(
            "Sub-pixel images are compared in pairs; their variances per side hold the picture's own changes "
            "within a pixel besides noise."
        )
    return notes


# So many samples' worth of light does a render by Cycles lose while it learns where light is scattered
# (docs/findings).
LOST_SAMPLES = 0.12


def default_allowance(samples, renderer, by_subset=False):
    """(systematic allowance, rule) for a reference of `samples` per pixel; None where no rule is known.

    Cycles' null collision has an error that all seeds share; measured budgets per sample count. Replicas by
    subset of the samples have it in their spread, and miss only what every render loses. Other renderers are
    taken to have none.
    """
    if renderer is None or not renderer.startswith("Cycles"):
        return (0.0, "0: the reference is not by Cycles") if renderer else None
    if by_subset and samples:
        allowance = LOST_SAMPLES / samples
        return allowance, f"{100 * allowance:.2g} %: replicas by subset, {LOST_SAMPLES} of {samples} samples"
    for fewest, allowance in ((1024, 0.002), (256, 0.005), (64, 0.01)):
        if samples is not None and samples >= fewest:
            return allowance, f"{100 * allowance:g} %: Cycles with {fewest} samples or more ({samples})"
    return None
