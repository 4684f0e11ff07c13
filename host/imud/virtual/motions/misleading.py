# SPDX-License-Identifier: MIT
"""Fields that mislead a probe: steel below it, magnets on it or beside it, mains.

North is that of the field's mean on the way, or else of the Earth's field alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from imud.rotation import FloatArray
from imud.virtual.motions.ride import Ride
from imud.virtual.motions.room import Added, Attached, Room, as_triple, slope
from imud.virtual.sensors import Magnet

Random = np.random.Generator

EARTH_UT = np.array([0.0, 20.0, -43.0])
# For which the AK8963 measures: it sees the mean of an alternating field.
READING_S = 0.0072


def direction(random: Random) -> FloatArray:
    """Any, as likely as any other."""
    drawn = random.standard_normal(3)
    return np.asarray(drawn / np.linalg.norm(drawn))


def left_behind(field_ut: FloatArray) -> Added:
    """The field of steel under a probe at power-on: it leaves within 10 to 12 s."""
    return Added(field_ut, lambda t: np.clip((12.0 - t) / 2.0, 0.0, 1.0))


def mains(field_ut: FloatArray, hz: float, start_rad: float, from_s: float) -> Added:
    """The field of a motor or a power supply, averaged over a reading."""
    size = float(np.sinc(hz * READING_S))
    return Added(
        field_ut,
        lambda t: size * np.sin(2.0 * np.pi * hz * t + start_rad) * (t > from_s),
    )


def irons(
    random: Random, count: int, within_m: float, up_m: float, moment_a_m2: float
) -> tuple[Magnet, ...]:
    """Dipoles at one height; `moment_a_m2` is one sigma of an axis."""
    found = []
    for _ in range(count):
        x, y = random.uniform(-within_m, within_m, 2)
        east, north, up = random.normal(0.0, moment_a_m2, 3)
        found.append(Magnet((x, y, up_m), (east, north, up)))
    return tuple(found)


def under_desk(random: Random) -> tuple[Magnet, ...]:
    """A metre below a probe that is carried about a desk."""
    return irons(random, 4, within_m=1.0, up_m=-1.05, moment_a_m2=20.0)


def under_floor(random: Random) -> tuple[Magnet, ...]:
    """Under a floor that a person walks on: differs by 2 uT."""
    return irons(random, 6, within_m=2.0, up_m=-1.3, moment_a_m2=60.0)


def uneven(place_m: FloatArray, iron: tuple[Magnet, ...]) -> Room:
    """A room with iron whose mean field on the way is the Earth's."""
    room = Room(EARTH_UT, iron=iron)
    mean = room.field_at(place_m, np.zeros(len(place_m))).mean(axis=0)
    return replace(room, field_ut=2.0 * EARTH_UT - mean)


def plain(_random: Random, _ride: Ride) -> Room:
    """The Earth's field alone."""
    return Room(EARTH_UT)


def beneath_desk(random: Random, ride: Ride) -> Room:
    """Iron below a probe that is carried about a desk."""
    return uneven(ride.body.place.value, under_desk(random))


def beneath_floor(random: Random, ride: Ride) -> Room:
    """Iron under a floor."""
    return uneven(ride.body.place.value, under_floor(random))


def hall(random: Random, ride: Ride) -> Room:
    """Changes evenly by 8 uT/m; on the way its mean is the Earth's."""
    middle = ride.body.place.value.mean(axis=0)
    return Room(EARTH_UT, middle, slope(random, 8.0))


def sloping(random: Random, ride: Ride) -> Room:
    """Changes evenly, by 2 to 6 uT/m; on the way its mean is the Earth's."""
    middle = ride.body.place.value.mean(axis=0)
    return Room(EARTH_UT, middle, slope(random, random.uniform(2.0, 6.0)))


PLATE_M = np.array([0.7, 0.4])  # half of its sides
PLATE_UP_M = -0.03  # below the surface on which a probe lies


def steel_desk(random: Random, ride: Ride) -> Room:
    """A plate of 28 dipoles and two legs of two: magnetized by the Earth and anyhow.

    Where the ride comes nearest, their field is 10 to 40 uT; on the way its mean is the
    Earth's.
    """
    earth = EARTH_UT / np.linalg.norm(EARTH_UT)
    places = [
        (x, y, PLATE_UP_M)
        for x in np.linspace(-PLATE_M[0], PLATE_M[0], 7).tolist()
        for y in np.linspace(-PLATE_M[1], PLATE_M[1], 4).tolist()
    ]
    legs = [(x, PLATE_M[1], up) for x in (-0.6, 0.6) for up in (-0.25, -0.55)]
    iron = []
    for at in (*places, *legs):
        size = 4.0 if at in legs else 1.0
        moment = size * (earth + random.normal(0.0, 0.7, 3))
        iron.append((at, moment))
    way = ride.body.place.value
    whole = sum(Magnet(at, as_triple(moment)).field_ut(way) for at, moment in iron)
    size = random.uniform(10.0, 40.0) / float(np.linalg.norm(whole, axis=1).max())
    return uneven(way, tuple(Magnet(at, as_triple(size * one)) for at, one in iron))


def phone(random: Random, ride: Ride) -> Room:
    """A floor with iron; a phone of 5 to 40 uT is put beside the probe once or twice,
    for 5 to 25 s.
    """
    room, attached, at = beneath_floor(random, ride), [], ride.rest_s
    for _ in range(random.integers(1, 3)):
        on = at + random.uniform(5.0, 20.0)
        at = on + random.uniform(5.0, 25.0)
        attached.append(Attached(random.uniform(5.0, 40.0) * direction(random), on, at))
    return replace(room, attached=tuple(attached))


def from_the_start(least_ut: float, most_ut: float) -> Callable[[Random, Ride], Room]:
    """A magnet on the probe from power-on; strengths even in their logarithm."""

    def room(random: Random, _ride: Ride) -> Room:
        own = _between(random, least_ut, most_ut) * direction(random)
        return Room(EARTH_UT, attached=(Attached(own, -1.0, math.inf),))

    return room


def on_steel(random: Random, _ride: Ride) -> Room:
    """Laid on steel of 15 to 300 uT at power-on."""
    field_ut = _between(random, 15.0, 300.0) * direction(random)
    return Room(EARTH_UT, added=(left_behind(field_ut),))


def near_mains(random: Random, _ride: Ride) -> Room:
    """20 or 60 uT of 49.8, 50, 50.05 or 60 Hz, from 20 s on."""
    hz, size = random.choice([49.8, 50.0, 50.05, 60.0]), random.choice([20.0, 60.0])
    start = random.uniform(0.0, 2.0 * np.pi)
    return Room(EARTH_UT, added=(mains(size * direction(random), hz, start, 20.0),))


def _between(random: Random, least: float, most: float) -> float:
    return math.exp(random.uniform(math.log(least), math.log(most)))
