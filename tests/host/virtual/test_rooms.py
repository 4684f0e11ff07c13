# SPDX-License-Identifier: MIT
"""The fields in which simulated motions take place."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from imud import rotation
from imud.virtual.motions import room
from imud.virtual.motions.groups import GROUPS
from imud.virtual.motions.ride import Ride
from imud.virtual.motions.room import ROOMS, Room

pytestmark = pytest.mark.sampled(2)

SEEDS = range(3)
each_seed = pytest.mark.parametrize("seed", SEEDS)


@cache
def ride_of(group: str, seed: int) -> Ride:
    return GROUPS[group].ride(np.random.default_rng(seed))


def place(name: str, seed: int, of: str = "robot_arm") -> tuple[Ride, Room]:
    ride = ride_of(of, seed)
    return ride, ROOMS[name](np.random.default_rng(seed + 100), ride)


def change(ride: Ride, own: Room) -> rotation.FloatArray:
    """How far the field is from that of the start, uT."""
    field = own.field_at(ride.body.place.value, ride.t) - own.field_ut
    return np.linalg.norm(field, axis=1)


@each_seed
@pytest.mark.parametrize("name", sorted(set(ROOMS) - {"passing"}))
def test_north_is_that_of_the_start(name: str, seed: int) -> None:
    ride, own = place(name, seed)
    assert change(ride, own)[0] == pytest.approx(0.0, abs=1e-9)
    east, north, up = own.field_ut
    assert east == 0.0
    assert 42.0 <= math.hypot(north, up) <= 52.0
    assert 55.0 <= math.degrees(math.atan2(-up, north)) <= 70.0


@each_seed
def test_a_gradient_has_neither_currents_nor_charges(seed: int) -> None:
    ride, own = place("gradient", seed)
    assert np.array_equal(own.gradient_ut_m, own.gradient_ut_m.T)
    assert np.trace(own.gradient_ut_m) == pytest.approx(0.0, abs=1e-12)
    assert 1.0 < change(ride, own).max() <= 6.0


@each_seed
def test_a_gradient_is_weak_where_the_way_is_long(seed: int) -> None:
    ride, own = place("gradient", seed, of="vehicle")
    assert change(ride, own).max() <= 6.0 + 1e-9


@each_seed
def test_a_table_lies_below_and_its_field_is_bounded(seed: int) -> None:
    ride, own = place("table", seed)
    lowest = ride.body.place.value[:, 2].min()
    assert len(own.iron) == 4
    assert all(0.5 <= lowest - each.position_m[2] <= 1.0 for each in own.iron)
    whole = sum(each.field_ut(ride.body.place.value) for each in own.iron)
    strongest = np.linalg.norm(whole, axis=1).max()
    assert 6.0 <= strongest <= 20.0


@each_seed
@pytest.mark.parametrize("of", ["pointing", "vehicle"])
def test_iron_passes_and_is_gone(seed: int, of: str) -> None:
    ride, own = place("passing", seed, of)
    assert 2 <= len(own.passing) <= 6
    strongest = []
    for each in own.passing:
        field = np.linalg.norm(each.field_ut(ride.body.place.value, ride.t), axis=1)
        strongest.append(field.max())
        assert np.median(field) < 0.25 * field.max()
    assert min(strongest) >= 5.0
    assert max(strongest) <= 25.0 + 1e-9


def test_a_magnet_is_put_on_and_taken_off() -> None:
    on = room.Attached(np.array([10.0, 0.0, 0.0]), on_s=2.0, off_s=5.0)
    found = on.at(np.array([0.0, 2.0, 2.25, 2.5, 5.0, 5.5, 9.0]))
    assert found[:, 0] == pytest.approx([0.0, 0.0, 5.0, 10.0, 10.0, 0.0, 0.0])
    always = room.Attached(np.array([10.0, 0.0, 0.0]), on_s=-1.0, off_s=math.inf)
    assert always.at(np.array([0.0, 1e3]))[:, 0] == pytest.approx([10.0, 10.0])


def test_a_magnet_turns_with_the_sensor() -> None:
    kinds = set()
    for seed in range(12):
        ride, own = place("magnet", seed, of="turntable")
        (magnet,) = own.attached
        assert 5.0 <= np.linalg.norm(magnet.field_ut) <= 20.0
        back = rotation.inverse(ride.body.turning.quat)
        extra = own.felt(ride) - rotation.rotate(back, own.field_ut)
        is_on = (ride.t > magnet.on_s + 0.5) & (ride.t < magnet.off_s)
        assert np.allclose(extra[is_on], magnet.field_ut)
        assert np.allclose(extra[ride.t < magnet.on_s], 0.0)
        kinds.add((magnet.on_s < 0.0, math.isfinite(magnet.off_s)))
    assert kinds == {(True, False), (False, False), (False, True)}
