# SPDX-License-Identifier: MIT
"""Quaternions as the rows of matrices and back against formulas in doubles."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, INT32_MIN, ONE, lib
from length import choose

pytestmark = pytest.mark.sampled(2)

COUNT = choose(everyday=50_000, long=200_000)
HALF = 0.5**0.5


def matrices(q: desk.Array) -> desk.Array:
    """Rotation matrices as textbooks write them, of q / |q|."""
    w, x, y, z = (q / desk.norms(q)[:, None]).T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), -1, 0))


def anywhere(seed: int) -> desk.Array:
    """Quaternions of all directions, those along axes and between two among them, with
    norms up to 1e-6 from 1."""
    random = np.random.default_rng(seed)
    axes = np.eye(4)
    edges = [
        *(sign * axis for axis in axes for sign in (1, -1)),
        *(HALF * (a + sign * b) for a in axes for b in axes for sign in (1, -1)),
        *(np.array(signs) / 2 for signs in np.ndindex(2, 2, 2, 2)),
    ]
    edges = [edge for edge in edges if abs(np.linalg.norm(edge) - 1) < 1e-9]
    rows = np.concatenate([edges, desk.unit_rows(random, COUNT - len(edges), 4)])
    norm = 1 + 1e-6 * random.choice([-0.99, 0, 0.99], (COUNT, 1))
    return desk.rounded(rows * norm * ONE)


def test_matrices_are_within_3_steps():
    q = anywhere(6)
    found = desk.mapped(lib.loop_axes, q, width=9).reshape(-1, 3, 3)
    excess = np.abs(desk.norms(q) / ONE - 1)[:, None, None]
    assert (np.abs(found / ONE - matrices(q)) <= 3 / ONE + 4 * excess).all()


def test_half_turns_reach_the_end_of_the_range_and_no_further():
    q = np.diag([INT32_MIN // 2] * 4).astype(np.int32)
    found = desk.mapped(lib.loop_axes, q, width=9).reshape(-1, 3, 3) / ONE
    for row, diagonal in enumerate(([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])):
        assert np.array_equal(found[row], np.diag(diagonal))


def same_way(q: desk.Array, other: desk.Array) -> desk.Array:
    return q * np.where(np.sum(q * other, axis=1) < 0, -1.0, 1.0)[:, None]


def test_a_quaternion_comes_back_from_its_matrix_within_1e_7():
    q = anywhere(7)
    exact = matrices(q)
    rows = np.clip(np.round(exact * ONE), -ONE, ONE).astype(np.int32)
    found = desk.mapped(lib.loop_quat_of_axes, rows.reshape(-1, 9), width=4)
    unit = q / desk.norms(q)[:, None]
    assert np.abs(found / ONE - same_way(unit, found)).max() <= 1e-7
    assert np.abs(desk.norms(found) / ONE - 1).max() <= 1e-7
    assert (np.max(found, axis=1) >= 2**29 - 100).all()


def test_a_matrix_of_small_errors_gives_a_unit_quaternion_as_near():
    q = anywhere(8)
    random = np.random.default_rng(8)
    noise = random.choice([-1e-5, 0, 1e-5], (COUNT, 3, 3)) * ONE
    rows = desk.rounded(matrices(q) * ONE + noise)
    found = desk.mapped(lib.loop_quat_of_axes, rows.reshape(-1, 9), width=4)
    unit = q / desk.norms(q)[:, None]
    assert np.abs(found / ONE - same_way(unit, found)).max() <= 2e-5
    assert np.abs(desk.norms(found) / ONE - 1).max() <= 1e-7


def test_the_round_trip_through_the_matrix_keeps_the_attitude():
    q = anywhere(9)
    rows = desk.mapped(lib.loop_axes, q, width=9)
    again = desk.mapped(lib.loop_quat_of_axes, rows, width=4)
    assert (desk.apart_deg(again, q) * DEGREE).max() < 1e-5
    assert np.abs(desk.norms(again) / ONE - 1).max() <= 1e-7
