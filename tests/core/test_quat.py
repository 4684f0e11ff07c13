# SPDX-License-Identifier: MIT
"""Quaternions of fixed point against numpy's doubles, up to the limits of quat.h."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from core import desk
from core.desk import INT32_MAX, INT32_MIN, ONE, TURN, ffi, lib
from imud import rotation

COUNT = 100_000
AXES = [sign * row for row in np.eye(4) for sign in (1, -1)]


def units(seed: int) -> desk.Array:
    """Quaternions of norm at most 1, those along an axis among them."""
    random = np.random.default_rng(seed)
    rows = np.concatenate([AXES, desk.unit_rows(random, COUNT - len(AXES), 4)])
    return np.trunc(rows * ONE).astype(np.int32)


def quat(*wxyz: int) -> object:
    return ffi.new("struct quat *", wxyz)


def numbers(q: object) -> tuple[int, int, int, int]:
    return q.w, q.x, q.y, q.z


@pytest.mark.parametrize("norm_product", [1.0, 1.2])
def test_products_are_within_2_steps_up_to_their_limit(norm_product):
    a = np.trunc(units(1) * np.sqrt(norm_product)).astype(np.int32)
    b = np.trunc(units(2)[::-1] * np.sqrt(norm_product)).astype(np.int32)
    exact = rotation.multiply(a / ONE, b / ONE) * ONE
    assert np.abs(desk.mapped(lib.loop_multiply, a, b, width=4) - exact).max() <= 2


def test_products_of_axes_are_hamiltons():
    one, i, j, k = (quat(*(2**30 * row).astype(int).tolist()) for row in np.eye(4))
    out = quat()
    for a, b, wanted in ((i, j, k), (j, k, i), (k, i, j), (one, k, k), (i, one, i)):
        lib.quat_multiply(a, b, out)
        assert numbers(out) == numbers(wanted)
    lib.quat_multiply(i, i, out)
    assert numbers(out) == (-(2**30), 0, 0, 0)


def test_a_product_may_be_written_over_either_factor_or_both():
    a, b, out = quat(2**29, 3, -(2**28), 77), quat(-5, 2**29, 2**28, -(2**27)), quat()
    lib.quat_multiply(a, b, out)
    left, right = quat(*numbers(a)), quat(*numbers(b))
    lib.quat_multiply(left, b, left)
    lib.quat_multiply(a, right, right)
    assert numbers(left) == numbers(right) == numbers(out)
    square, both = quat(), quat(*numbers(a))
    lib.quat_multiply(a, a, square)
    lib.quat_multiply(both, both, both)
    assert numbers(both) == numbers(square)


def test_a_quaternion_times_its_conjugate_is_identity_within_rounding():
    q = units(3)
    back = q * np.array([1, -1, -1, -1], np.int32)
    out, one = quat(), quat(*q[-1].tolist())
    lib.quat_conjugate(one, out)
    assert numbers(out) == tuple(back[-1].tolist())
    lib.quat_conjugate(one, one)
    assert numbers(one) == numbers(out)
    turned = desk.mapped(lib.loop_multiply, q, back, width=4)
    assert np.abs(turned - np.array([2**30, 0, 0, 0])).max() <= 8


def test_a_norm_off_by_e_comes_back_to_within_1_65_e2():
    random = np.random.default_rng(4)
    off = np.concatenate([[-0.3, 0.3], random.uniform(-0.3, 0.3, COUNT - 2)])
    q = np.trunc(units(4) * (1 + off)[:, None]).astype(np.int32)
    before = desk.norms(q) / ONE - 1
    truth = q / desk.norms(q)[:, None]
    desk.call(lib.loop_renormalise, COUNT, q)
    after = desk.norms(q) / ONE - 1
    assert (np.abs(after) <= 1.65 * before**2 + 3 / ONE).all()
    # The direction stays, to the rounding of a component.
    assert np.abs(q / desk.norms(q)[:, None] - truth).max() < 4 / ONE


def test_a_unit_quaternion_stays_one_through_many_turns():
    q, step = quat(2**30, 0, 0, 0), quat()
    turn = ffi.new("struct vector *", [323_456_789, -198_765_432, 155_555_555])
    lib.quat_from_small_angle(turn, step)
    for _ in range(20_000):
        lib.quat_multiply(q, step, q)
        lib.quat_renormalise(q)
        assert abs(np.linalg.norm(numbers(q)) / ONE - 1) < 2e-8


def test_small_angles_are_within_their_bound_up_to_the_limit():
    random = np.random.default_rng(5)
    length = np.concatenate(
        [np.full(1000, 0.55), 2.0 ** random.uniform(-30, 0, COUNT - 1000) * 0.55]
    )
    angle = np.trunc(desk.unit_rows(random, COUNT, 3) * length[:, None] * ONE)
    angle = angle.astype(np.int32)
    turned = desk.mapped(lib.loop_small_angle, angle, width=4) / ONE
    error = desk.norms(turned - rotation.from_rotation_vector(angle / ONE))
    bound = desk.norms(angle / ONE) ** 5 / 3840
    assert (error <= bound + 2 / ONE).all()
    assert error.max() > 0.9 * 0.55**5 / 3840  # the bound is no wider than needed


def test_no_angle_is_the_identity():
    out = quat()
    lib.quat_from_small_angle(ffi.new("struct vector *"), out)
    assert numbers(out) == (2**30, 0, 0, 0)


def test_rotations_at_the_length_limit_are_within_4_steps():
    random = np.random.default_rng(6)
    q = units(6)
    v = np.trunc(desk.unit_rows(random, COUNT, 3) * 1.07e9).astype(np.int32)
    for index, row in enumerate(np.eye(3)):
        v[index :: 10 * (index + 1)] = (1.07e9 * row).astype(np.int32)
    turned = desk.mapped(lib.loop_rotate, q, v, width=3)
    exact = rotation.rotate(q / ONE, v.astype(float))
    assert np.abs(turned - exact).max() <= 4
    again = v.copy()
    desk.call(lib.loop_rotate, COUNT, q, again, again)
    assert np.array_equal(again, turned)


def test_half_turns_of_the_longest_vectors_stay_in_range():
    for axis in np.eye(3, dtype=np.int32):
        q = np.array([[0, *(axis * 2**30)]], np.int32)
        for signs in product((1, -1), repeat=3):
            v = (np.array([signs]) * (1.07e9 / np.sqrt(3))).astype(np.int32)
            turned = desk.mapped(lib.loop_rotate, q, v, width=3)
            assert np.abs(turned - v * (2 * axis - 1)).max() <= 4


def test_a_heading_turns_about_the_vertical_alone():
    edges = [INT32_MIN, INT32_MIN + 1, -1, 0, 1, 2**30, -(2**30), INT32_MAX]
    grid = np.arange(INT32_MIN, INT32_MAX, 2**23 + 12345)
    heading = np.concatenate([edges, grid]).astype(np.int32)
    q = desk.mapped(lib.loop_from_heading, heading, width=4) / ONE
    half = heading / TURN / 2
    truth = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    assert np.abs(q - truth).max() < 1e-8


def angle_about_z(q: desk.Array) -> desk.Array:
    assert (q[:, 1:3] == 0).all()
    return 2 * np.arctan2(q[:, 3], q[:, 0])


def apart(angle: desk.Array, truth: desk.Array) -> desk.Array:
    return np.abs(np.remainder(angle - truth + np.pi, 2 * np.pi) - np.pi)


@pytest.mark.parametrize("length", [1.0, 1000.0, ONE, 2.0**31 - 1])
def test_a_point_tells_the_angle_about_z_whatever_its_length(length):
    angle = np.linspace(-np.pi, np.pi, 4001)
    points = [desk.rounded(length * f(angle)) for f in (np.cos, np.sin)]
    q = desk.mapped(lib.loop_about_z, *points, width=4)
    assert np.abs(desk.norms(q) / ONE - 1).max() < 2e-7
    truth = np.arctan2(points[1].astype(float), points[0].astype(float))
    assert apart(angle_about_z(q), truth).max() < 3e-7


def test_no_point_tells_no_angle():
    made = desk.ffi.new("struct quat *")
    lib.quat_about_z(0, 0, made)
    assert [made.w, made.x, made.y, made.z] == [2**30, 0, 0, 0]


def test_what_turns_a_heading_away_is_the_opposite_of_its_x_axiss():
    q = units(7)
    x = rotation.rotate(q / ONE, np.array([1.0, 0.0, 0.0]))
    level = np.hypot(x[:, 0], x[:, 1])
    away = angle_about_z(desk.mapped(lib.loop_to_no_heading, q, width=4))
    error = apart(-away, np.arctan2(x[:, 1], x[:, 0]))
    # Rounding turns a short level part by more, the shorter it is.
    assert (error < 3e-7 + 1e-8 / np.maximum(level, 1e-9)).all()


def test_an_x_axis_that_points_straight_up_or_down_has_no_heading_to_turn_away():
    half = 2**29
    straight = np.array(
        [[half, half, -half, half], [half, half, half, -half]], np.int32
    )
    away = desk.mapped(lib.loop_to_no_heading, straight, width=4)
    assert away.tolist() == [[2**30, 0, 0, 0]] * 2
