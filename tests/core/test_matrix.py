# SPDX-License-Identifier: MIT
"""Rotation matrices of 16 bits against doubles."""

from __future__ import annotations

import numpy as np
import pytest

from core import desk
from core.desk import ONE, ffi, lib
from imud import rotation
from length import choose

UNIT = 2.0**14  # q2_14


def matrix_of(quat: desk.Array) -> desk.Array:
    made = ffi.new("struct matrix *")
    steps = desk.rounded(quat * ONE).tolist()
    lib.matrix_from_quat(ffi.new("struct quat *", steps), made)
    return np.array([list(row) for row in made.row])


def true_matrix(quat: desk.Array) -> desk.Array:
    return np.stack([rotation.rotate(quat, axis) for axis in np.eye(3)], axis=-1)


@pytest.mark.long
def test_every_element_is_within_1_2e_4():
    random = np.random.default_rng(1)
    worst = 0.0
    for quat in desk.unit_rows(random, choose(everyday=800, long=3000), 4):
        away = matrix_of(quat) / UNIT - true_matrix(quat)
        worst = max(worst, float(np.abs(away).max()))
    assert worst < 1.2e-4


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("part", range(4))
def test_no_turn_and_half_turns_are_within_a_step_or_two(part, sign):
    quat = np.zeros(4)
    quat[part] = sign
    assert np.abs(matrix_of(quat) - true_matrix(quat) * UNIT).max() <= 2


def test_a_norm_a_millionth_too_long_overflows_nothing():
    for quat in desk.unit_rows(np.random.default_rng(2), 300, 4):
        away = matrix_of(quat * (1 + 1e-6)) / UNIT - true_matrix(quat)
        assert np.abs(away).max() < 1.3e-4
    quat = np.array([0.0, 1.0, 0.0, 0.0]) * (1 + 1e-6)
    assert matrix_of(quat).tolist() == [[16384, 0, 0], [0, -16382, 0], [0, 0, -16382]]


def test_a_vector_is_turned_up_to_the_longest():
    random = np.random.default_rng(3)
    made = ffi.new("struct matrix *")
    for quat in desk.unit_rows(random, 300, 4):
        lib.matrix_from_quat(
            ffi.new("struct quat *", (quat * ONE).astype(int).tolist()), made
        )
        v = desk.unit_rows(random, 1, 3)[0] * 2.1e9
        out = ffi.new("int32_t[3]")
        lib.matrix_turn(made, v.astype(int).tolist(), out)
        away = np.array(list(out)) - rotation.rotate(quat, v)
        assert np.abs(away).max() < 2.1e9 * 2.2e-4
        in_place = ffi.new("int32_t[3]", v.astype(int).tolist())
        lib.matrix_turn(made, in_place, in_place)
        assert list(in_place) == list(out)
