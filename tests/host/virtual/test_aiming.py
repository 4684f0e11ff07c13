# SPDX-License-Identifier: MIT
"""Probes that lie still or aim: what their sensors feel agrees with where they go."""

from __future__ import annotations

import numpy as np
import pytest

from imud import rotation
from imud.virtual.motions.aiming import FIELD_UT, GRAVITY, MOTIONS, RATE_HZ, WAVED_S

each = pytest.mark.parametrize("name", MOTIONS)
SECONDS = 60.0


@each
def test_the_same_seed_makes_the_same_motion(name: str) -> None:
    first, again, other = (MOTIONS[name](seed, SECONDS) for seed in (1, 1, 3))
    assert first.seconds == SECONDS
    assert np.array_equal(first.gyr, again.gyr)
    assert not np.array_equal(first.gyr, other.gyr)


@each
def test_rates_forces_and_fields_are_those_of_the_attitudes(name: str) -> None:
    motion = MOTIONS[name](2, SECONDS)
    # Over a second noise is small beside the turn.
    second = round(RATE_HZ)
    step = rotation.multiply(
        rotation.inverse(motion.quat[:-25]), motion.quat[25:]
    )  # 50 ms
    true = rotation.to_rotation_vector(step) * RATE_HZ / 25.0
    sums = np.cumsum(motion.gyr, axis=0)
    mean = (sums[25:] - sums[:-25]) / 25.0
    waved = slice(9 * second, 24 * second)
    assert np.abs(mean - true)[waved].max() < 0.1 * np.abs(true[waved]).max()
    for felt, world, most in (
        (motion.acc, GRAVITY, 1.0),
        (motion.mag, FIELD_UT, 1.5),
    ):
        expected = rotation.rotate(rotation.inverse(motion.quat), world)
        assert np.sqrt(np.mean((felt - expected) ** 2)) < most


def test_one_lies_still_and_the_other_stays_near_the_middle() -> None:
    after = round((WAVED_S[1] + 1.0) * RATE_HZ)
    still = MOTIONS["still"](4, SECONDS).quat
    aim = MOTIONS["aim"](4, SECONDS).quat
    assert np.ptp(still[after:], axis=0).max() == 0.0
    step = rotation.multiply(rotation.inverse(aim[after]), aim[after:])
    turned = np.degrees(np.linalg.norm(rotation.to_rotation_vector(step), axis=1))
    assert 5.0 < turned.max() < 45.0
