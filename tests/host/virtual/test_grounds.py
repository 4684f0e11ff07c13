# SPDX-License-Identifier: MIT
"""Motions on ground that misleads: what is felt agrees with where they go, and fields
are as strong as they say."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.motions import grounds, handling, misleading, ways
from imud.virtual.motions.grounds import GROUNDS
from imud.virtual.motions.groups import exact
from imud.virtual.motions.misleading import EARTH_UT
from imud.virtual.motions.ride import RATE_HZ, Ride, times

UP = np.array([0.0, 0.0, GRAVITY_M_S2])

pytestmark = pytest.mark.sampled(6)
each_ground = pytest.mark.parametrize("name", GROUNDS)


def seeded(seed: int = 3) -> np.random.Generator:
    return np.random.default_rng(seed)


@cache
def ridden(name: str) -> Ride:
    return GROUNDS[name].ride(seeded())


@cache
def felt(name: str) -> Motion:
    """By a sensor without errors."""
    return exact(ridden(name), misleading.plain(seeded(), ridden(name)))


def share_off(found: FloatArray, expected: FloatArray) -> float:
    """The difference of all but 1 % of records, as a share of the largest value:
    accelerations jump where a motion begins and where moves follow each other.
    """
    difference = np.abs(found - expected).max(axis=1)
    return float(np.quantile(difference, 0.99) / np.abs(expected).max())


@each_ground
def test_the_rate_is_the_attitudes_derivative(name: str) -> None:
    turning = ridden(name).body.turning
    step = rotation.multiply(rotation.inverse(turning.quat[:-2]), turning.quat[2:])
    found = rotation.to_rotation_vector(step) * RATE_HZ / 2.0
    assert share_off(found, turning.rate[1:-1]) < 1e-3
    slope = (turning.rate[2:] - turning.rate[:-2]) * RATE_HZ / 2.0
    assert share_off(slope, turning.acceleration[1:-1]) < 5e-3


@each_ground
def test_specific_force_is_the_places_second_difference_and_gravity(name: str) -> None:
    motion = felt(name)
    place, quat = motion.position, motion.quat
    assert quat is not None
    found = (place[2:] - 2.0 * place[1:-1] + place[:-2]) * RATE_HZ**2 + UP
    assert share_off(found, rotation.rotate(quat, motion.acc)[1:-1]) < 2e-3


@each_ground
def test_a_motion_rests_first(name: str) -> None:
    motion = felt(name)
    if name == "slow turn":
        return  # which turns from the start
    assert motion.movement is not None
    rest = ~motion.movement
    assert rest.sum() > 4.9 * RATE_HZ
    assert np.abs(motion.gyr[rest]).max() < 1e-9
    assert np.abs(motion.gyr[~rest]).max() > math.radians(5.0)


@each_ground
def test_a_motion_is_always_the_same_and_another_seed_gives_another(name: str) -> None:
    one, same, other = (grounds.made(name, seed) for seed in (4, 4, 5))
    assert np.array_equal(one.mag, same.mag)
    assert np.array_equal(one.acc, same.acc)
    assert not np.array_equal(one.mag[:100], other.mag[:100])


def test_a_ring_starts_after_its_swing_and_dies_away() -> None:
    t = times(4.0)
    found = handling.ring(t, 1.0, 6.0, 0.2)
    assert not found.value[t <= 1.0].any()
    assert 0.8 < np.abs(found.value).max() <= 1.0
    assert np.abs(found.value[t > 2.5]).max() < 1e-3
    slope = (found.value[2:] - found.value[:-2]) * RATE_HZ / 2.0
    assert np.allclose(slope, found.first[1:-1], atol=0.1)
    bend = (found.first[2:] - found.first[:-2]) * RATE_HZ / 2.0
    assert np.quantile(np.abs(bend - found.second[1:-1]), 0.99) < 5.0  # of 1421


def test_a_wand_is_quick() -> None:
    fastest = np.degrees(np.linalg.norm(felt("wand").gyr, axis=1).max())
    assert 350.0 < fastest < 750.0


def test_a_desk_is_left_by_five_to_thirty_centimetres() -> None:
    height = felt("steel desk").position[:, 2]  # type: ignore[index]  # never None
    assert height.min() == pytest.approx(0.05, abs=0.02)
    assert 0.2 < height.max() < 0.33


def test_the_mean_of_an_uneven_field_is_the_earths() -> None:
    for name in ("carried", "walking", "sloping", "arm", "steel desk"):
        ride = ridden(name)
        room = GROUNDS[name].room(seeded(), ride)
        field = room.field_at(ride.body.place.value, ride.t)
        assert np.allclose(field.mean(axis=0), EARTH_UT)
        assert np.linalg.norm(field - EARTH_UT, axis=1).max() > 2.0


def test_a_steel_desk_is_strongest_where_the_probe_is_low() -> None:
    ride = ridden("steel desk")
    room = misleading.steel_desk(seeded(), ride)
    place = ride.body.place.value
    field = np.linalg.norm(sum(each.field_ut(place) for each in room.iron), axis=1)
    assert 10.0 < field.max() < 40.0
    is_low = place[:, 2] < 0.1
    assert field[is_low].mean() > 2.0 * field[place[:, 2] > 0.2].mean()


def test_steel_is_left_after_twelve_seconds() -> None:
    steel = misleading.left_behind(np.array([0.0, 30.0, 40.0]))
    size = np.linalg.norm(steel.at(np.array([0.0, 10.0, 11.0, 12.0, 50.0])), axis=1)
    assert size.tolist() == [50.0, 50.0, 25.0, 0.0, 0.0]


def test_mains_are_means_over_a_reading() -> None:
    t = np.linspace(20.0, 21.0, 100_000, endpoint=False)
    motor = misleading.mains(np.array([20.0, 0.0, 0.0]), 50.0, 0.3, from_s=20.5)
    found = motor.at(t)[:, 0]
    assert not found[t <= 20.5].any()
    # sin(x) / x of half a reading's phase, 0.36 pi.
    assert found.max() == pytest.approx(20.0 * math.sin(1.131) / 1.131, rel=1e-3)


def test_a_phone_comes_and_goes() -> None:
    ride = ridden("phone")
    room = misleading.phone(seeded(), ride)
    assert 1 <= len(room.attached) <= 2
    for magnet in room.attached:
        assert 5.0 <= np.linalg.norm(magnet.field_ut) <= 40.0
        assert ride.rest_s + 5.0 <= magnet.on_s
        assert 5.0 <= magnet.off_s - magnet.on_s <= 25.0


def test_magnets_from_the_start_have_sizes_between() -> None:
    room = misleading.from_the_start(40.0, 2000.0)
    sizes = []
    for seed in range(200):
        (magnet,) = room(seeded(seed), ridden("strong")).attached
        assert magnet.at(np.zeros(1)).any()
        sizes.append(float(np.linalg.norm(magnet.field_ut)))
    assert 40.0 < min(sizes) < 60.0
    assert 1500.0 < max(sizes) < 2000.0
    assert 200.0 < np.median(sizes) < 400.0


def test_faults_hit_one_sensor_alone() -> None:
    plain = felt("hand")
    kinds = set()
    for seed in range(20):
        dead = grounds.dead_accelerometer(seeded(seed), plain)
        assert np.array_equal(dead.mag, plain.mag)
        is_stuck = np.ptp(dead.acc, axis=0) == 0.0
        kinds.add((int(is_stuck.sum()), bool(dead.acc.any())))
        dead = grounds.dead_magnetometer(seeded(seed), plain)
        assert np.array_equal(dead.acc, plain.acc)
        assert not np.array_equal(dead.mag, plain.mag)
    assert kinds == {(1, True), (2, True), (3, True), (3, False)}


def test_a_turn_at_power_on_ends_after_thirty_seconds() -> None:
    t = times(60.0)
    body = ways.turned_slowly(seeded(), t, 6.0)
    rate = np.degrees(np.linalg.norm(body.turning.rate, axis=1))
    assert np.allclose(rate[t < 30.0], 6.0)
    assert not rate[(t > 30.0) & (t < 50.0)].any()
    assert rate[t > 52.0].max() > 20.0
