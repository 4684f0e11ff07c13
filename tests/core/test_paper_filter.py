# SPDX-License-Identifier: MIT
"""Common parts of the filters from papers, at the bounds in their header."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import INT32_MAX, ONE, RATE, Array, ffi, lib
from core.doubles import matrix_of, quat_of
from core.test_fuse import STARTS
from imud import rotation
from length import choose

RANDOM = np.random.default_rng(8)
QUATS = [*STARTS, *desk.unit_rows(RANDOM, 300, 4)]


def quat(values: Array) -> object:
    return ffi.new("struct quat *", desk.rounded(values * ONE).tolist())


def numbers(c: object) -> Array:
    """The components of a vector or a quaternion."""
    return np.array([getattr(c, name) for name, _ in ffi.typeof(c[0]).fields]) / ONE


def rows_of(values: Array) -> object:
    return ffi.new("struct vector[3]", desk.rounded(values * ONE).tolist())


def test_rows_that_are_off_by_a_tenth_still_give_a_unit_quaternion():
    out = ffi.new("struct quat *")
    for q in QUATS:
        skewed = np.eye(3) + RANDOM.uniform(-0.05, 0.05, (3, 3))
        matrix = skewed @ matrix_of(q)
        matrix /= np.maximum(np.linalg.norm(matrix, axis=1), 1)[:, None]
        matrix *= RANDOM.choice([0.9, 1.0, 1 + 1e-6], (3, 1))
        matrix = np.clip(matrix, -1 - 1e-6, 1 + 1e-6)
        lib.quat_from_rows(rows_of(matrix), out)
        assert abs(np.linalg.norm(numbers(out)) - 1) < 1e-7
        assert desk.apart_deg(numbers(out), quat_of(matrix)) < 15


def test_any_quaternion_but_zero_is_normalised_within_1e_7():
    ends = [-INT32_MAX, -(2**30), -1, 0, 1, 2**30, INT32_MAX]
    grid = [[w, x, y, z] for w in ends for x in ends for y in ends for z in ends]
    anything = RANDOM.integers(-INT32_MAX, INT32_MAX, (3000, 4))
    small = anything // 2 ** RANDOM.integers(0, 31, (3000, 1))
    for values in [*grid, *anything.tolist(), *small.tolist()]:
        q = ffi.new("struct quat *", [int(value) for value in values])
        assert lib.quat_normalise(q) == any(values)
        if any(values):
            wanted = np.array(values, float) / np.linalg.norm(np.array(values, float))
            assert np.abs(numbers(q) - wanted).max() < 1e-7
            assert abs(np.linalg.norm(numbers(q)) - 1) < 1e-7
        else:
            assert not numbers(q).any()


@pytest.mark.long
def test_half_a_step_fits_at_the_longest_turn_from_anywhere():
    # A quarter of the angle of 1.3 rad, and a norm of 1 + 1e-6.
    edge = 1.3 * (1 - 1e-9)
    out = ffi.new("struct quat *")
    signs = [np.array([x, y, z]) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    turns = [
        *np.eye(3),
        *-np.eye(3),
        *signs,
        *desk.unit_rows(RANDOM, choose(everyday=8, long=40), 3),
    ]
    for q in QUATS:
        for direction in turns:
            u = direction / np.linalg.norm(direction) * edge
            turn = ffi.new("struct vector *", desk.rounded(u * ONE).tolist())
            lib.quat_half_step(quat(q * (1 + 1e-6)), turn, out)
            wanted = 0.5 * q + rotation.multiply(q, np.concatenate([[0.0], u]))
            assert np.abs(numbers(out) - wanted).max() < 3e-6


def test_seconds_are_exact_up_to_50_ms_and_held_there():
    for us in (0, 1, 999, 1250, 5000, 5263, 10_000, 49_999, 50_000):
        assert abs(lib.paper_filter_seconds_q33(us) - us * 2**33 / 1e6) < 1.1
    for us in (50_001, 10**6, 2**31, 2**32 - 1):
        assert lib.paper_filter_seconds_q33(us) == lib.paper_filter_seconds_q33(50_000)


def test_the_fastest_rate_less_the_largest_bias_fits_its_format():
    state = ffi.new("struct paper_filter *")
    lib.paper_filter_init(state)
    lib.paper_filter_set_bias(
        state, ffi.new("struct vector *", [INT32_MAX, -INT32_MAX, 0])
    )
    limit = int(38 * RATE)
    felt = ffi.new("struct measurement *")
    felt.gyr_rad_s_q25 = [-limit, limit, limit]
    rate = ffi.new("struct vector *")
    lib.paper_filter_rate(state, felt, rate)
    found = np.array([rate.x, rate.y, rate.z]) / RATE
    assert found == pytest.approx([-42, 42, 38])
