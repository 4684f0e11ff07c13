# SPDX-License-Identifier: MIT
"""Quaternions as angles and matrices, on the host: to the last digits of a double."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from imud import rotation
from imud.client import Pose
from imud.rotation import FloatArray, Row

HALF = 0.5**0.5
SINE, COSINE = np.sin(np.pi / 8), np.cos(np.pi / 8)
C30 = 0.75**0.5
CLIMB = ((90, -60, 0), (0, 60, 0), (0, -60, 90))
ONE = 2**30  # of a component on the wire
Quat = tuple[float, float, float, float]
RANDOM = np.random.default_rng(1)
COUNT = 20_000


def anywhere() -> FloatArray:
    rows = RANDOM.standard_normal((COUNT, 4))
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def built(angles: FloatArray) -> FloatArray:
    """The quaternion of z-y'-x'' angles, a row each."""
    turns = [
        rotation.from_rotation_vector(angles[:, [index]] * axis)
        for index, axis in enumerate(np.eye(3)[::-1])
    ]
    return rotation.multiply(turns[0], rotation.multiply(turns[1], turns[2]))


def apart(one: FloatArray, other: FloatArray) -> FloatArray:
    """Radians between attitudes."""
    between = rotation.multiply(one, rotation.inverse(other))
    return np.asarray(np.linalg.norm(rotation.to_rotation_vector(between), axis=-1))


def pose_of(q: Quat) -> Pose:
    return Pose(
        probe="p",
        seq=1,
        number=1,
        missing=0,
        t_device_us=0,
        q=q,
        position_m=None,
        normal=None,
        tilt_sigma_deg=None,
        heading_sigma_deg=None,
        flags=(),
    )


def test_angles_and_attitude_are_one_both_ways() -> None:
    angles = RANDOM.uniform(-np.pi, np.pi, (COUNT, 3)) * [1.0, 0.5, 1.0]
    quat = built(angles)
    away = rotation.to_yaw_pitch_roll(quat) - angles
    level = np.cos(angles[:, 1])[:, None]
    assert (np.abs(away) < 1e-14 + 2e-15 / level).all()
    assert np.array_equal(
        rotation.to_yaw_pitch_roll(-quat).round(9),
        rotation.to_yaw_pitch_roll(quat).round(9),
    )


def test_what_is_built_from_heading_pitch_and_roll_gives_them_back() -> None:
    quat = rotation.from_heading_pitch_roll(2.0, -0.7, 3.0)
    assert rotation.to_yaw_pitch_roll(quat) == pytest.approx([2.0, -0.7, 3.0])


@pytest.mark.parametrize("sign", [1, -1])
def test_in_gimbal_lock_yaw_has_the_whole_turn(sign: int) -> None:
    angles = RANDOM.uniform(-np.pi, np.pi, (COUNT, 3))
    away = 10 ** RANDOM.uniform(-16, 0, COUNT) * rotation.GIMBAL_LOCK_RAD * 0.999
    angles[:, 1] = sign * (np.pi / 2 - away)
    quat = built(angles)
    found = rotation.to_yaw_pitch_roll(quat)
    assert (found[:, 1] == sign * np.pi / 2).all()
    assert (found[:, 2] == 0).all()
    assert apart(built(found), quat).max() < rotation.GIMBAL_LOCK_RAD


@pytest.mark.parametrize("sign", [1, -1])
def test_up_to_gimbal_lock_the_angles_say_the_attitude_exactly(sign: int) -> None:
    angles = RANDOM.uniform(-np.pi, np.pi, (COUNT, 3))
    away = rotation.GIMBAL_LOCK_RAD * 10 ** RANDOM.uniform(0.001, 4, COUNT)
    angles[:, 1] = sign * (np.pi / 2 - away)
    quat = built(angles)
    assert apart(built(rotation.to_yaw_pitch_roll(quat)), quat).max() < 3e-15


def test_aerospace_angles_are_those_of_north_east_down() -> None:
    quat = anywhere()
    ned = np.array([0.0, HALF, HALF, 0.0])
    frd = np.array([0.0, 1.0, 0.0, 0.0])
    expected = rotation.to_yaw_pitch_roll(
        rotation.multiply(ned, rotation.multiply(quat, rotation.inverse(frd)))
    )
    away = np.remainder(rotation.to_aerospace(quat) - expected + 1, 2 * np.pi) - 1
    assert np.abs(away).max() < 1e-9


@pytest.mark.parametrize(
    ("convert", "expected"),
    [
        (rotation.to_yaw_pitch_roll, (90, 60, 0)),
        (rotation.to_aerospace, (0, -60, 0)),
        (rotation.to_nectec, (0, 60, 90)),
    ],
)
def test_a_dive_to_the_north(
    convert: Callable[[FloatArray], FloatArray], expected: tuple[float, ...]
) -> None:
    north = rotation.from_heading_pitch_roll(np.pi / 2, np.pi / 3, 0.0)
    assert np.degrees(convert(north)) == pytest.approx(expected, abs=1e-12)
    # Any shape goes: here none, and 2 by 3 of them.
    rows = np.broadcast_to(north, (2, 3, 4))
    assert np.degrees(convert(rows)).shape == (2, 3, 3)
    assert np.allclose(np.degrees(convert(rows)), expected)


# Attitudes worked out by hand from docs/pose-details.md, degrees.
AT_HAND = [
    # Level, x to the east.
    ((1, 0, 0, 0), (0, 0, 0), (90, 0, 0), (0, 0, 0)),
    # Level, x to the north: a compass heading of 0.
    ((HALF, 0, 0, HALF), (90, 0, 0), (0, 0, 0), (0, 0, 90)),
    # Level, x to the south-west: a compass heading of 225, which is -135.
    ((SINE, 0, 0, -COSINE), (-135, 0, 0), (-135, 0, 0), (0, 0, -135)),
    # x to the north and 60 up: a climb.
    ((C30 * HALF, 0.5 * HALF, -0.5 * HALF, C30 * HALF), *CLIMB),
    # x to the north, the right side 90 down.
    ((0.5, 0.5, 0.5, 0.5), (90, 0, 90), (0, 0, 90), (90, 0, 90)),
    # Upside down, x to the east.
    ((0, 1, 0, 0), (0, 0, -180), (90, 0, -180), (-180, 0, 0)),
    # x straight up, where yaw takes the whole rotation.
    ((HALF, 0, -HALF, 0), (0, -90, 0), (90, 90, 0), (0, -90, 0)),
]


@pytest.mark.parametrize(("q", "nautical", "aerospace", "nectec"), AT_HAND)
def test_a_pose_tells_its_angles_in_each_convention(
    q: Quat, nautical: Row, aerospace: Row, nectec: Row
) -> None:
    for sign in (1, -1):
        pose = pose_of(tuple(sign * each for each in q))
        found = pose.angles("nautical")
        assert found == pytest.approx(nautical, abs=1e-12)
        assert found == pose.yaw_pitch_roll_deg
        assert (found.yaw_deg, found.pitch_deg, found.roll_deg) == found
        assert pose.angles("aerospace") == pytest.approx(aerospace, abs=1e-12)
        assert pose.angles("nectec") == pytest.approx(nectec, abs=1e-12)


def test_the_columns_of_a_pose_s_matrix_are_its_axes_in_the_world() -> None:
    # x to the north, y to the west, z up.
    east, north, up = pose_of((HALF, 0.0, 0.0, HALF)).matrix
    assert east == pytest.approx((0, -1, 0))
    assert north == pytest.approx((1, 0, 0))
    assert up == pytest.approx((0, 0, 1))


@pytest.mark.parametrize("convention", rotation.CONVERSIONS)
def test_angles_stay_in_their_ranges(convention: rotation.Convention) -> None:
    # Turns by half a turn and a few last digits beside it, about each axis.
    half_turns = np.pi + np.arange(-4, 5) * 2.0**-52
    for axis, angle, sign in itertools.product(np.eye(3), half_turns, (1, -1)):
        quat = rotation.from_rotation_vector(axis * angle * sign)
        yaw, pitch, roll = rotation.angles_deg(quat.tolist(), convention)
        assert -180 <= yaw < 180
        assert -90 <= pitch <= 90
        assert -180 <= roll < 180


def test_nectec_angles_are_those_of_its_formula() -> None:
    q0, q1, q2, q3 = quat = anywhere().T
    expected = np.array(
        [
            np.arctan2(2 * (q0 * q1 + q2 * q3), 1 - 2 * (q1**2 + q2**2)),
            np.arcsin(2 * (q0 * q2 - q3 * q1)),
            np.arctan2(2 * (q0 * q3 + q1 * q2), 1 - 2 * (q2**2 + q3**2)),
        ]
    )
    assert np.abs(rotation.to_nectec(quat.T) - expected.T).max() < 1e-10


def test_a_matrix_turns_vectors_as_its_quaternion_does() -> None:
    quat = anywhere()
    matrix = rotation.to_matrix(quat)
    vectors = RANDOM.standard_normal((COUNT, 3))
    turned = np.einsum("nij,nj->ni", matrix, vectors)
    assert np.abs(turned - rotation.rotate(quat, vectors)).max() < 1e-14
    assert np.abs(matrix @ np.moveaxis(matrix, 1, 2) - np.eye(3)).max() < 1e-14


def test_a_quaternion_comes_back_from_its_matrix() -> None:
    axes = np.eye(4)
    between = [HALF * (a + b) for a in axes for b in axes if not np.array_equal(a, b)]
    quat = np.concatenate([axes, -axes, between, anywhere()])
    found = rotation.from_matrix(rotation.to_matrix(quat))
    assert apart(found, quat).max() < 5e-15
    assert (found.max(axis=-1) >= 0.5 - 1e-15).all()
    assert found.max(axis=-1) == pytest.approx(np.abs(found).max(axis=-1))
    assert rotation.from_matrix(np.eye(3)).tolist() == [1.0, 0.0, 0.0, 0.0]
