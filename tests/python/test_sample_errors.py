"""Noise and bias against the combined reference: pictures made of known ones are found out."""

import numpy as np
import pytest

import sample_errors
from protocol import InputError

SIZE = (24, 32, 3)
TRUTH = 1.0
NOISE = {"ours": 0.02, "cycles": 0.04}
# The replicas' figures are means over 24 * 32 * 3 pixels of 15 degrees of freedom: relative error
# sqrt(2 / 15 / 2304) = 0.8 %, times 6 so that no seed fails by chance.
TOLERANCE = 0.05


def stacks(bias=0.0, slope=0.03):
    """Paired stacks of 16 replicas whose expectations differ by position alike."""
    random = np.random.default_rng(7)
    positions = slope * np.linspace(-1, 1, 16).reshape(16, 1, 1, 1)
    made = [
        TRUTH + positions + NOISE[side] * random.standard_normal((16, *SIZE)) for side in ("ours", "cycles")
    ]
    return made[0] + bias, made[1]


def test_the_spread_over_positions_is_no_noise():
    found = sample_errors.combined(*stacks())
    for side, noise in NOISE.items():
        assert found[side]["noise"] == pytest.approx(noise**2, rel=TOLERANCE)


def test_a_bias_is_shared_by_weight():
    found = sample_errors.combined(*stacks(bias=0.1))
    share = NOISE["cycles"] ** 2 / (NOISE["ours"] ** 2 + NOISE["cycles"] ** 2)
    truth = (TRUTH + share * 0.1) ** 2
    assert found["ours"]["squared_bias"] == pytest.approx(((1 - share) * 0.1) ** 2 / truth, rel=TOLERANCE)
    assert found["cycles"]["squared_bias"] == pytest.approx((share * 0.1) ** 2 / truth, rel=TOLERANCE)


def test_another_picture_has_its_noise_and_bias_found():
    ours, cycles = stacks()
    found = sample_errors.combined(ours, cycles)
    random = np.random.default_rng(8)
    # Two by two positions: each the mean of four of the sixteen.
    positions = np.linspace(-0.03, 0.03, 16).reshape(4, 4)
    coarse = positions.reshape(2, 2, 2, 2).mean(axis=(1, 3)).reshape(4, 1, 1, 1)
    other = TRUTH + 0.05 + coarse + 0.03 * random.standard_normal((4, *SIZE))
    row = sample_errors.against(other, found, ours, cycles, 4, 2)
    assert row["noise"] == pytest.approx(0.03**2, rel=0.15)  # 3 degrees of freedom: 1.7 %, and c's own noise
    assert row["squared_bias"] == pytest.approx(0.05**2, rel=TOLERANCE)
    single = TRUTH + 0.03 * random.standard_normal((1, *SIZE))
    row = sample_errors.against(single, found, ours, cycles, 4, 1)
    assert row["error"] == pytest.approx(0.03**2, rel=0.15)  # sqrt(2 / 2304) = 3 %
    assert row["noise"] is None


def test_positions_that_do_not_divide_are_refused():
    with pytest.raises(InputError, match="divisor of 4"):
        sample_errors.coarser(stacks()[0], 4, 3)
