# SPDX-License-Identifier: MIT
"""Madgwick's filter against the equations of his report in doubles."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, Array
from core.doubles import (
    apart_from,
    assert_within_0_001_degrees,
    matrix_of,
    motions,
    rms,
    unit,
    wild,
)
from core.scenes import Attitude, at_rest, scene
from imud import rotation

pytestmark = pytest.mark.sampled(4)

# Madgwick's earth has x to the north.
ENU_FROM_EARTH = rotation.from_heading_pitch_roll(np.pi / 2, 0, 0)


def gradient(quat: Array, force: Array, field: Array | None) -> Array:
    """J^T f of equation 34, by the matrices of equations 25, 26, 29 and 30."""
    q1, q2, q3, q4 = quat
    a = unit(force)
    vertical = np.array(
        [
            2 * (q2 * q4 - q1 * q3) - a[0],
            2 * (q1 * q2 + q3 * q4) - a[1],
            2 * (0.5 - q2**2 - q3**2) - a[2],
        ]
    )
    of_vertical = np.array(
        [
            [-2 * q3, 2 * q4, -2 * q1, 2 * q2],
            [2 * q2, 2 * q1, 2 * q4, 2 * q3],
            [0, -4 * q2, -4 * q3, 0],
        ]
    )
    if field is None:
        return np.asarray(of_vertical.T @ vertical)
    m = unit(field)
    h = matrix_of(quat) @ m  # equation 45
    bx, bz = np.hypot(h[0], h[1]), h[2]  # equation 46
    magnetic = np.array(
        [
            2 * bx * (0.5 - q3**2 - q4**2) + 2 * bz * (q2 * q4 - q1 * q3) - m[0],
            2 * bx * (q2 * q3 - q1 * q4) + 2 * bz * (q1 * q2 + q3 * q4) - m[1],
            2 * bx * (q1 * q3 + q2 * q4) + 2 * bz * (0.5 - q2**2 - q3**2) - m[2],
        ]
    )
    of_magnetic = 2 * np.array(
        [
            [-bz * q3, bz * q4, -2 * bx * q3 - bz * q1, -2 * bx * q4 + bz * q2],
            [
                -bx * q4 + bz * q2,
                bx * q3 + bz * q1,
                bx * q2 + bz * q4,
                bz * q3 - bx * q1,
            ],
            [bx * q3, bx * q4 - 2 * bz * q2, bx * q1 - 2 * bz * q3, bx * q2],
        ]
    )
    return np.asarray(of_vertical.T @ vertical + of_magnetic.T @ magnetic)


def step(
    quat: Array,
    rate: Array,
    force: Array,
    field: Array | None,
    seconds: float,
    beta: float = 0.041,
) -> Array:
    """Equations 42 to 44."""
    earth = rotation.multiply(rotation.inverse(ENU_FROM_EARTH), quat)
    change = 0.5 * rotation.multiply(earth, np.concatenate([[0.0], rate]))
    slope = gradient(earth, force, field) if force.any() else np.zeros(4)
    if slope.any():
        change = change - beta * unit(slope)
    return rotation.multiply(ENU_FROM_EARTH, unit(earth + seconds * change))


@pytest.mark.long
@motions
def test_fixed_point_is_within_0_001_degrees_of_doubles(rate_hz, start, dip_deg):
    assert_within_0_001_degrees("madgwick", step, rate_hz, start, dip_deg)


@pytest.mark.nightly
def test_the_comparison_would_see_another_beta():
    felt = wild(200, 15, 5)
    apart, _ = apart_from(felt, "madgwick", partial(step, beta=0.045))
    assert rms(apart) > 0.05


def test_a_step_against_the_gradient_has_the_length_of_beta():
    felt = scene(at_rest(2), 200, noise=0)
    felt.has_mag[200:] = False
    felt.acc[200:] = (0, 5, 5)
    found, _ = Attitude("madgwick").feel(felt)
    turned = desk.apart_deg(found[200:-1], found[201:])
    # Along a circle of the vertical: the report's gradient has a part along q as well,
    # which its normalisation counts in and the next one takes out again.
    assert turned.max() < 2 * 0.041 / 200 / DEGREE * 1.001
    assert turned.min() > 0.6 * turned.max()
