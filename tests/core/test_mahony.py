# SPDX-License-Identifier: MIT
"""Mahony's filter with NECTEC's gains, against its paper's equations in doubles."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from core.desk import Array
from core.doubles import (
    apart_from,
    assert_within_0_001_degrees,
    matrix_of,
    motions,
    rms,
    unit,
    wild,
)
from imud import rotation

pytestmark = pytest.mark.sampled(4)

UP = np.array([0.0, 0.0, 1.0])


def step(
    quat: Array,
    rate: Array,
    force: Array,
    field: Array | None,
    seconds: float,
    gain: float = 15.0,
) -> Array:
    """Mahony 2008, equations 32, Ki 0; the field's reference as NECTEC has it."""
    body = matrix_of(quat).T
    error = np.zeros(3)
    if force.any():
        error = np.cross(unit(force), body @ UP)
        if field is not None:
            seen = matrix_of(quat) @ unit(field)
            reference = np.array([0.0, np.hypot(seen[0], seen[1]), seen[2]])
            error += np.cross(unit(field), body @ reference)
    spin = np.concatenate([[0.0], rate + gain * error])
    return unit(quat + 0.5 * seconds * rotation.multiply(quat, spin))


@pytest.mark.long
@motions
def test_fixed_point_is_within_0_001_degrees_of_doubles(rate_hz, start, dip_deg):
    assert_within_0_001_degrees("mahony", step, rate_hz, start, dip_deg)


@pytest.mark.nightly
def test_the_comparison_would_see_another_gain():
    felt = wild(200, 15, 5)
    apart, _ = apart_from(felt, "mahony", partial(step, gain=14.5))
    assert rms(apart) > 0.05
