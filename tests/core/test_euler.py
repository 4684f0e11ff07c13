# SPDX-License-Identifier: MIT
"""Angles and matrices of fixed point against independent formulas in doubles, dense
around gimbal lock; and the origin, as the angles show it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from core import desk
from core.desk import DEGREE, INT32_MIN, ONE, TURN, ffi, lib
from core.scenes import at_rest, scene
from imud import rotation
from length import choose

pytestmark = pytest.mark.sampled(2)

COUNT = choose(everyday=50_000, long=200_000)
LOCK = 1e-5  # rad, as euler.h says
ANGLE = 5e-6  # rad
HALF = 0.5**0.5
MPU9250 = desk.identity_of(gyr_delay_us=2500)  # rates that are means of a period
# The angles of a conversion as rows, and the formulas to hold them against.
CONVERSIONS = {
    "euler": lib.loop_euler,
    "aerospace": lib.loop_aerospace,
    "nectec": lib.loop_nectec,
}


def fixed(function: Any, q: desk.Array) -> desk.Array:
    """Angles in radians, in [-pi, pi)."""
    return desk.mapped(function, q, width=3) / TURN


def matrices(q: desk.Array) -> desk.Array:
    """Rotation matrices as textbooks write them, of q / |q|."""
    w, x, y, z = (q / desk.norms(q)[:, None]).T
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), -1, 0))


def angles_of(m: desk.Array) -> desk.Array:
    """z-y'-x'' of matrices, from the images of the axes."""
    return np.stack(
        [
            np.arctan2(m[:, 1, 0], m[:, 0, 0]),
            np.arctan2(-m[:, 2, 0], np.hypot(m[:, 0, 0], m[:, 1, 0])),
            np.arctan2(m[:, 2, 1], m[:, 2, 2]),
        ],
        axis=1,
    )


NED_FROM_ENU = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
FLU_FROM_FRD = np.diag([1, -1, -1])


def true_euler(q: desk.Array) -> desk.Array:
    return angles_of(matrices(q))


def true_aerospace(q: desk.Array) -> desk.Array:
    return angles_of(NED_FROM_ENU @ matrices(q) @ FLU_FROM_FRD)


def true_nectec(q: desk.Array) -> desk.Array:
    """Section 6.2.2 of the paper, letter by letter."""
    q0, q1, q2, q3 = (q / desk.norms(q)[:, None]).T
    yaw = np.arctan2(2 * (q0 * q1 + q2 * q3), 1 - 2 * (q1**2 + q2**2))
    pitch = np.arcsin(np.clip(2 * (q0 * q2 - q3 * q1), -1, 1))
    roll = np.arctan2(2 * (q0 * q3 + q1 * q2), 1 - 2 * (q2**2 + q3**2))
    return np.stack([yaw, pitch, roll], axis=1)


TRUTHS = {
    "euler": true_euler,
    "aerospace": true_aerospace,
    "nectec": true_nectec,
}


def turned(axis: int, angle: desk.Array) -> desk.Array:
    out = np.zeros((len(angle), 4))
    out[:, 0], out[:, 1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    return out


def built(yaw: desk.Array, pitch: desk.Array, roll: desk.Array) -> desk.Array:
    """The quaternion of z-y'-x'' angles."""
    leaned = rotation.multiply(turned(1, pitch), turned(0, roll))
    return rotation.multiply(turned(2, yaw), leaned)


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


def near_lock(seed: int, nearest: float, furthest: float) -> desk.Array:
    """Attitudes whose x is so near to the vertical, up and down."""
    random = np.random.default_rng(seed)
    yaw, roll = random.uniform(-np.pi, np.pi, (2, COUNT))
    away = np.exp(random.uniform(np.log(nearest), np.log(furthest), COUNT))
    pitch = random.choice([-1, 1], COUNT) * (np.pi / 2 - away)
    return desk.rounded(built(yaw, pitch, roll) * ONE)


def away(one: desk.Array, other: desk.Array) -> desk.Array:
    return np.abs(np.remainder(one - other + np.pi, 2 * np.pi) - np.pi)


def level_part(q: desk.Array) -> desk.Array:
    """How far x is from the vertical, radians where it is near."""
    m = matrices(q)
    return np.hypot(m[:, 0, 0], m[:, 1, 0])


@pytest.mark.parametrize("name", CONVERSIONS)
def test_angles_of_any_attitude_are_within_5e_6_rad(name):
    q = anywhere(1)
    q = q[level_part(q) > 2 * LOCK]
    assert len(q) > 0.99 * COUNT
    assert away(fixed(CONVERSIONS[name], q), TRUTHS[name](q)).max() < ANGLE


@pytest.mark.parametrize("name", CONVERSIONS)
def test_they_are_so_up_to_the_edge_of_gimbal_lock(name):
    q = near_lock(2, LOCK * 1.001, 0.1)
    assert level_part(q).min() < 1.1 * LOCK
    assert away(fixed(CONVERSIONS[name], q), TRUTHS[name](q)).max() < ANGLE


@pytest.mark.parametrize("seed", range(3))
def test_in_gimbal_lock_yaw_has_the_whole_turn(seed):
    q = near_lock(seed, 1e-12, LOCK * 0.999)
    found = desk.mapped(lib.loop_euler, q, width=3)
    assert (np.abs(found[:, 1]) == 2**30).all()
    assert (found[:, 2] == 0).all()
    yaw, pitch, roll = (found / TURN).T
    # What is left out is how far x is from the vertical.
    error = desk.apart_deg(built(yaw, pitch, roll), q) * DEGREE
    assert error.max() < LOCK + ANGLE
    up = desk.mapped(lib.loop_aerospace, q, width=3)
    assert np.array_equal(
        up,
        np.stack([2**30 - found[:, 0], -found[:, 1], 0 * yaw], 1)
        .astype(np.int64)
        .astype(np.int32),
    )
    assert np.array_equal(desk.mapped(lib.loop_nectec, q, width=3), found[:, ::-1])


def test_no_step_through_gimbal_lock_moves_the_attitude():
    # A straight line over the pole, 1e-7 rad a step, and what the angles make of it.
    tilt = np.arange(-600, 600) * 1e-7
    for yaw, roll in ((0.3, 0.0), (2.0, -1.1), (-3.0, 2.9)):
        start = built(*(np.full(len(tilt), a) for a in (yaw, np.pi / 2, roll)))
        for axis in (1, 2):
            q = desk.rounded(rotation.multiply(start, turned(axis, tilt)) * ONE)
            shown = built(*fixed(lib.loop_euler, q).T)
            assert (desk.apart_deg(shown, q) * DEGREE).max() < 2e-5


def test_the_attitude_comes_back_from_its_angles_wherever_it_is():
    for q in (anywhere(3), near_lock(4, 1e-12, 0.1)):
        shown = built(*fixed(lib.loop_euler, q).T)
        error = desk.apart_deg(shown, q) * DEGREE
        assert error.max() < 2e-5
        assert error[level_part(q) > 2 * LOCK].max() < 2 * ANGLE


@pytest.mark.parametrize(
    ("q", "euler", "aerospace", "nectec"),
    [
        # Level, x to the east.
        ((1, 0, 0, 0), (0, 0, 0), (90, 0, 0), (0, 0, 0)),
        # Level, x to the north.
        ((HALF, 0, 0, HALF), (90, 0, 0), (0, 0, 0), (0, 0, 90)),
        # Level, x to the south-west.
        (
            (0.3826834323650898, 0, 0, -0.9238795325112867),
            (-135, 0, 0),
            (-135, 0, 0),
            (0, 0, -135),
        ),
        # x to the north and 60 degrees down: a dive.
        (
            (0.75**0.5 * HALF, -0.5 * HALF, 0.5 * HALF, 0.75**0.5 * HALF),
            (90, 60, 0),
            (0, -60, 0),
            (0, 60, 90),
        ),
        # x to the north, the right side 90 degrees down.
        ((0.5, 0.5, 0.5, 0.5), (90, 0, 90), (0, 0, 90), (90, 0, 90)),
        # Upside down, x to the east.
        ((0, 1, 0, 0), (0, 0, -180), (90, 0, -180), (-180, 0, 0)),
        # x straight up, z to the west: y has come to the north.
        ((HALF, 0, -HALF, 0), (0, -90, 0), (90, 90, 0), (0, -90, 0)),
        # x straight down, and a turn that yaw and roll could share.
        ((0.5, 0.5, 0.5, -0.5), (-90, 90, 0), (-180, -90, 0), (0, 90, -90)),
    ],
)
def test_attitudes_worked_out_by_hand(q, euler, aerospace, nectec):
    row = desk.rounded(np.array([q, np.negative(q)]) * ONE)
    for name, wanted in (
        ("euler", euler),
        ("aerospace", aerospace),
        ("nectec", nectec),
    ):
        found = fixed(CONVERSIONS[name], row)
        assert away(found, np.radians(wanted)).max() < ANGLE, name
        assert np.abs(found[:, 1]).max() <= np.pi / 2


def test_what_nectec_calls_yaw_is_a_turn_about_x():
    # The paper's formula and the textbooks' of the same attitude.
    q = anywhere(5)
    q = q[level_part(q) > 1e-3]
    assert away(true_nectec(q), true_euler(q)[:, ::-1]).max() < 1e-7


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


def test_any_numbers_at_all_make_angles():
    # Not of unit length, so no angle is promised; the arithmetic still does not
    # overflow.
    random = np.random.default_rng(10)
    edges = np.array([-(2**30), -1, 0, 1, 2**30])
    q = random.choice(edges, (2000, 4)).astype(np.int32)
    q = q[desk.norms(q) <= ONE * (1 + 1e-9)]
    for function in CONVERSIONS.values():
        found = desk.mapped(function, q, width=3)
        assert (np.abs(found[:, 1].astype(np.int64)) <= 2**30).all()


# The origin, NECTEC's section 7.1.2, as the angles show it.


def after_a_turn(origin: int, start: desk.Array, turn: desk.Array) -> desk.Array:
    """Yaw, pitch and roll after a turn of the world's since the origin, degrees."""
    smooth = np.linspace(0, 1, 400)[:, None] * turn
    path = rotation.multiply(rotation.from_rotation_vector(smooth), start)
    quat = np.vstack([at_rest(12, quat=start), path, at_rest(8, quat=path[-1])])
    samples = scene(quat, 200, noise=0.1).samples(MPU9250)
    tracker = ffi.new("struct pose_tracker *")
    assert lib.pose_begin(tracker, desk.EXACT, MPU9250, lib.FILTER_FUSE)
    poses = np.zeros(len(samples), desk.dtype_of("struct message_pose"))
    results = np.zeros(len(samples), np.int32)
    for rows in (slice(0, 2400), slice(2400, None)):
        part = samples[rows].copy()
        desk.call(lib.loop_pose, tracker, len(part), part, poses[rows], results[rows])
        if rows.start == 0:
            lib.pose_set_origin(tracker, origin)
    return np.degrees(fixed(lib.loop_euler, poses["q"][-1:].copy())[0])


def test_from_the_full_origin_the_angles_are_those_of_the_turn_since():
    lying = built(*np.radians([[130.0], [-25.0], [70.0]]))[0]
    turn = np.array([0.0, 0.0, 40.0]) * DEGREE
    found = after_a_turn(lib.POSE_ORIGIN_FULL, lying, turn)
    assert found == pytest.approx([40, 0, 0], abs=0.3)
    found = after_a_turn(lib.POSE_ORIGIN_FULL, lying, turn[::-1].copy())
    assert found == pytest.approx([0, 0, 40], abs=0.3)


def test_from_the_heading_origin_pitch_and_roll_stay_those_of_the_vertical():
    lying = built(*np.radians([[130.0], [-25.0], [70.0]]))[0]
    turn = np.array([0.0, 0.0, 40.0]) * DEGREE
    found = after_a_turn(lib.POSE_ORIGIN_HEADING, lying, turn)
    assert found == pytest.approx([40, -25, 70], abs=0.3)
