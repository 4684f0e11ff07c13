# SPDX-License-Identifier: MIT
"""The benchmark of aims: which are true, and which were green though they were not."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.common.engines import Estimate
from benchmarks.honesty import aims
from benchmarks.honesty.since_origin import known_params
from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.motion import Motion

RATE_HZ = 100.0
MOVES_S = (45.0, 47.0)


def turned(degrees: FloatArray) -> FloatArray:
    """About the vertical."""
    zero = 0.0 * degrees
    return rotation.from_rotation_vector(
        np.deg2rad(np.stack([zero, zero, degrees], axis=1))
    )


def held_twice(seconds: float = 62.0) -> tuple[Motion, FloatArray]:
    """Still from 0 to 45 s, and from 47 s on at 20 degrees; the true headings."""
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    true = 20.0 * np.clip((t - MOVES_S[0]) / (MOVES_S[1] - MOVES_S[0]), 0.0, 1.0)
    still = np.zeros((len(t), 3))
    return Motion(RATE_HZ, still, still, still, turned(true)), true


def found_with(true: FloatArray, wrong_deg: FloatArray, sigma_deg: float) -> Estimate:
    """Poses, ten a second, whose heading is wrong by so much."""
    every = int(RATE_HZ // 10)
    times_s = np.arange(len(true))[::every] / RATE_HZ
    sigma = np.full(len(times_s), sigma_deg)
    return Estimate(times_s, turned((true + wrong_deg)[::every]), sigma / 4, sigma)


def test_holds_are_where_the_hand_is_still() -> None:
    truth, _ = held_twice()
    (hold,) = [each for each in aims.holds_of(truth) if each[0] > MOVES_S[0]]
    assert hold == pytest.approx((MOVES_S[1], 62.0), abs=0.5)


@pytest.mark.parametrize(
    ("jump_deg", "is_true", "is_false_green"), [(0.0, True, False), (4.0, False, True)]
)
def test_green_beyond_the_tolerance_is_counted(
    jump_deg: float, is_true: bool, is_false_green: bool
) -> None:
    """A heading that jumps by what no sigma tells, while the hand moves."""
    _, true = held_twice()
    wrong = np.where(np.arange(len(true)) / RATE_HZ < MOVES_S[1], 0.0, jump_deg)
    found = found_with(true, wrong, 1.2)
    told = aims.followed(found, known_params(), at=300)
    poses = [*range(500, 560)]
    lies = turned((true)[::10])  # its heading was right at the origin
    shown = found.quats[530]
    aimed = aims.judged(told, poses, lies, shown, "room", "none", age_s=20.0)
    assert aimed.poses == 60
    assert aimed.is_true == is_true
    assert aimed.is_reached
    assert bool(aimed.false_green) == is_false_green
    row = aims.row_of([aimed])
    assert row["false"] == (100.0 if is_false_green else 0.0)
    assert row["on target"] == int(is_true)
    figure, _ = aims.figures_of([aimed])
    assert figure.verdict == ("MISSED" if is_false_green else "goal")
