# SPDX-License-Identifier: MIT
"""The simulated motions: their sensors' readings agree with their paths."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual import bodies, curves
from imud.virtual.curves import Piece
from imud.virtual.motion import NPZ_KEYS
from imud.virtual.motions import groups, machines, ride, swings
from imud.virtual.motions.groups import GROUPS, Recipe
from imud.virtual.motions.module import LARGE, MODULES
from imud.virtual.motions.ride import RATE_HZ, Ride
from imud.virtual.motions.room import ROOMS, Room

pytestmark = pytest.mark.sampled(3)

UP = np.array([0.0, 0.0, GRAVITY_M_S2])
EVEN = Room(np.array([0.0, 20.0, -44.0]))

each_group = pytest.mark.parametrize("name", GROUPS)


@cache
def made(name: str, seed: int = 0) -> Ride:
    return GROUPS[name].ride(np.random.default_rng(seed))


def slope(values: FloatArray) -> FloatArray:
    """The derivative a second, from the records beside each but the first and last."""
    return (values[2:] - values[:-2]) * RATE_HZ / 2.0


def share_off(found: FloatArray, expected: FloatArray) -> float:
    """The largest difference, as a share of the largest value."""
    return float(np.abs(found - expected).max() / np.abs(expected).max())


@each_group
def test_the_rate_is_the_attitudes_derivative(name: str) -> None:
    turning = made(name).body.turning
    step = rotation.multiply(rotation.inverse(turning.quat[:-2]), turning.quat[2:])
    found = rotation.to_rotation_vector(step) * RATE_HZ / 2.0
    assert np.abs(turning.rate).max() > math.radians(5.0)
    # 4 ms are blunt for a tremor of 12 Hz.
    assert share_off(found, turning.rate[1:-1]) < 5e-4
    # Jerk jumps where quick moves follow each other.
    assert share_off(slope(turning.rate), turning.acceleration[1:-1]) < 2e-2


@each_group
def test_specific_force_is_the_positions_second_difference_and_gravity(
    name: str,
) -> None:
    motion = groups.exact(made(name), EVEN)
    assert motion.position is not None
    assert motion.quat is not None
    assert share_off(slope(motion.position), motion.velocity[1:-1]) < 1e-3
    place = motion.position
    found = (place[2:] - 2.0 * place[1:-1] + place[:-2]) * RATE_HZ**2
    expected = rotation.rotate(motion.quat, motion.acc) - UP
    # An impact of a runner lasts five records.
    assert share_off(found, expected[1:-1]) < (0.03 if "ing" in name else 1e-2)


@each_group
def test_the_start_is_a_rest_of_five_to_ten_seconds(name: str) -> None:
    own = made(name)
    motion = groups.exact(own, EVEN)
    assert motion.movement is not None
    assert 5.0 <= own.rest_s <= 10.0
    rest = ~motion.movement
    assert rest.sum() == pytest.approx(own.rest_s * RATE_HZ, abs=1.0)
    assert np.abs(motion.gyr[rest]).max() < 1e-9
    assert np.linalg.norm(motion.acc[rest], axis=1) == pytest.approx(GRAVITY_M_S2)
    assert np.linalg.norm(motion.mag, axis=1) == pytest.approx(math.hypot(20.0, 44.0))
    # It moves soon after.
    assert np.abs(motion.gyr[: round((own.rest_s + 5.0) * RATE_HZ)]).max() > 0.01


@each_group
def test_its_length_is_in_the_range_of_its_group(name: str) -> None:
    shortest, longest = {
        "one_axis": (600.0, 600.0),
        "east_pendulum": (168.0, 168.0),
    }.get(name, (80.0, 120.0))
    assert shortest <= len(made(name)) / RATE_HZ <= longest


def speed(own: Ride) -> FloatArray:
    return np.linalg.norm(own.body.turning.rate, axis=1)


def test_a_pendulum_turns_about_one_level_axis() -> None:
    turning = made("pendulum").body.turning
    axis = rotation.rotate(turning.quat, turning.rate)
    assert np.abs(axis[:, 2]).max() < 1e-9
    assert np.linalg.matrix_rank(axis, tol=1e-6) == 1
    other = made("two_axis_pendulum").body.turning
    assert np.linalg.matrix_rank(rotation.rotate(other.quat, other.rate)) == 3


def test_a_swing_has_its_amplitude_about_its_mean() -> None:
    t = ride.times(100.0)
    angle = np.degrees(swings.swing(t, 5.0, 0.7, degrees=40.0, mean_deg=10.0).value)
    assert np.abs(angle[t <= 5.0]).max() == 0.0
    assert angle.max() == pytest.approx(10.0 + 40.0 * 1.25, rel=0.01)
    assert angle.min() == pytest.approx(10.0 - 40.0 * 1.25, rel=0.01)


def test_the_east_pendulum_swings_about_an_axis_that_points_east() -> None:
    own = made("east_pendulum")
    z, y = (rotation.rotate(own.body.turning.quat, axis) for axis in (ride.Z, ride.Y))
    assert np.allclose(z, [1.0, 0.0, 0.0], atol=1e-9)  # east
    # Body y is up at an angle of 0 and turns about east from up to south.
    angle = np.degrees(np.arctan2(-y[:, 1], y[:, 2]))
    assert 80.0 < np.ptp(angle) < 150.0
    assert 10.0 < angle.mean() < 30.0
    assert np.linalg.norm(own.body.place.value, axis=1) == pytest.approx(0.5)
    gyr = MODULES["crossed"](np.random.default_rng(0)).gyr
    assert gyr @ [0.0, 0.0, 1.0] == pytest.approx([0.1, -0.07, 1.0])


@pytest.mark.parametrize("seed", range(4))
def test_machines_stay_within_what_they_promise(seed: int) -> None:
    assert speed(made("robot_arm", seed)).max() < math.radians(450.0)
    assert speed(made("turntable", seed)).max() <= math.radians(300.0)
    for name, limit in (("turntable", 8.0), ("centrifuge", 20.0)):
        own = made(name, seed)
        pulled = np.abs(own.body.place.second)[speed(own) > 0.0].max()
        # Acceleration along the track adds a little while it speeds up.
        assert 0.3 < pulled < 1.05 * limit
    drive = made("vehicle", seed).body
    assert np.linalg.norm(drive.place.first, axis=1).max() < 26.0
    assert np.linalg.norm(drive.place.second, axis=1).max() < 7.0


def test_a_centrifuge_pulls_for_a_quarter_of_a_minute_and_longer() -> None:
    own = made("centrifuge")
    is_pulled = np.linalg.norm(own.body.place.second, axis=1) > 2.9
    edges = np.flatnonzero(np.diff(is_pulled.astype(int), prepend=0, append=0))
    assert (np.diff(edges)[::2] / RATE_HZ).max() > 15.0


@pytest.mark.parametrize("seed", range(3))
def test_ten_minutes_are_about_one_axis_of_the_world(seed: int) -> None:
    turning = made("one_axis", seed).body.turning
    axis = rotation.rotate(turning.quat, turning.rate)
    assert np.linalg.matrix_rank(axis, tol=1e-6) == 1


def test_legs_swing_and_feel_the_ground() -> None:
    for name, rate_deg, force in (("walking", 200.0, 15.0), ("running", 400.0, 35.0)):
        own = made(name)
        assert math.radians(rate_deg) < speed(own).max() < math.radians(1000.0)
        felt = np.linalg.norm(own.body.specific_force(), axis=1)
        assert force < felt.max() < 16.0 * GRAVITY_M_S2  # within the chip's range


def test_a_hand_points_without_turning_over() -> None:
    turning = made("pointing").body.turning
    start = turning.quat[0]
    turned = rotation.multiply(turning.quat, rotation.inverse(start))
    angle = np.linalg.norm(rotation.to_rotation_vector(turned), axis=1)
    assert math.radians(30.0) < angle.max() < math.radians(110.0)


def test_pieces_join_without_a_jump() -> None:
    pieces = [Piece(1.0), Piece(2.0, step=3.0), Piece(1.0, end_rate=2.0)]
    pieces += [Piece(2.0, start_rate=2.0, end_rate=2.0), Piece(1.0, start_rate=2.0)]
    t = np.arange(9000) / 1000.0
    curve = curves.joined(pieces, t)
    assert curve.value[[0, 3000, 8999]] == pytest.approx([0.0, 3.0, 9.0])
    found = [np.gradient(part[:, 0], t) for part in (curve.value, curve.first)]
    assert np.allclose(found[0][1:-1], curve.first[1:-1, 0], atol=1e-4)
    assert np.allclose(found[1][1:-1], curve.second[1:-1, 0], atol=1e-2)


def test_a_point_off_the_axis_goes_round() -> None:
    t = ride.times(2.0)
    spun = curves.about(ride.Z, ride.phase(t, 1.0))
    place = bodies.RigidBody(
        spun, bodies.RigidBody.still(rotation.IDENTITY, len(t)).place
    ).at(np.array([0.5, 0.0, 0.0]))
    angle = 2.0 * np.pi * t
    ring = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=-1)
    assert np.allclose(place.value, 0.5 * ring)
    assert np.allclose(place.second, -0.5 * (2.0 * np.pi) ** 2 * ring)


def test_a_vehicle_is_where_its_speed_has_taken_it() -> None:
    t = ride.times(10.0)
    still = bodies.RigidBody.still(rotation.IDENTITY, len(t)).turning
    circle = still.then(curves.about(ride.Z, ride.phase(t, 0.1)))
    constant = curves.Curve(*(np.full((len(t), 1), v) for v in (2.0 * np.pi, 0.0, 0.0)))
    place = machines.driven(circle, constant).place.value
    # A circle of 10 m radius in 10 s, to the left.
    assert place[len(t) // 2] == pytest.approx([0.0, 20.0, 0.0], abs=1e-6)


def test_seeds_are_repeatable_and_differ() -> None:
    first, again, other = (Recipe("pendulum", seed).made() for seed in (3, 3, 5))
    for name in NPZ_KEYS:
        assert np.array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.gyr[:100], other.gyr[:100])


def test_tuning_and_judging_share_no_recording() -> None:
    tuning, judging = (list(groups.recipes(which)) for which in groups.SETS)
    assert len(tuning) == len(judging) == 14 * (len(GROUPS) - 1) + 8
    assert not set(tuning) & set(judging)
    assert {each.which for each in tuning} == {groups.TUNING}
    assert {each.which for each in judging} == {groups.JUDGING}
    for one, other in zip(tuning, judging, strict=True):
        assert (one.group, one.room, one.module) == (
            other.group,
            other.room,
            other.module,
        )
        assert one.room in ROOMS
        assert one.module in MODULES


def test_modules_of_one_size_stay_within_their_ranges() -> None:
    random = np.random.default_rng(1)
    drawn = [LARGE.drawn(random) for _ in range(50)]
    shares = np.abs([each.gyr - np.eye(3) for each in drawn])
    assert shares.min() >= 0.01
    assert 0.039 < shares.max() <= 0.04
    for name, limit in (
        ("gyr_bias", math.radians(3.0)),
        ("drift", math.radians(0.5)),
        ("acc_bias", 0.01 * GRAVITY_M_S2),
        ("mag_bias", 3.0),
    ):
        values = np.abs([getattr(each, name) for each in drawn])
        assert 0.9 * limit < values.max() <= limit
    assert all(np.array_equal(each.mag, each.mag.T) for each in drawn)


def test_a_module_changes_a_motion_by_its_errors_and_noise() -> None:
    motion = groups.exact(made("turntable"), EVEN)
    module = LARGE.drawn(np.random.default_rng(2))
    felt = module.measures(motion, np.random.default_rng(3))
    t = np.arange(len(motion)) / RATE_HZ
    drift = module.warming(t)[:, None] * module.drift
    sigma = module.noise.noise(RATE_HZ)
    for error, level in (
        (felt.gyr - motion.gyr @ module.gyr.T - module.gyr_bias - drift, sigma[0]),
        (felt.acc - motion.acc @ module.acc.T - module.acc_bias, sigma[1]),
        (felt.mag - motion.mag @ module.mag.T - module.mag_bias, sigma[2]),
    ):
        assert error.mean(axis=0) == pytest.approx(0.0, abs=0.05 * level[0])
        assert error.std(axis=0) == pytest.approx(level[0], rel=0.02)
    assert module.warming(np.array([0.0, 1e6])) == pytest.approx([0.0, 1.0])
