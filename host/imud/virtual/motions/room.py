# SPDX-License-Identifier: MIT
"""The magnetic field of a room: even, with a gradient, beside steel, with iron that
passes, or with a magnet on the sensor.

North is that of the place where the sensor rests at the start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.motions.ride import Ride
from imud.virtual.sensors import Magnet

EARTH_UT = (42.0, 52.0)
DIP_DEG = (55.0, 70.0)


@dataclass(frozen=True, slots=True)
class Passing:
    """A dipole that moves along a straight line."""

    moment_a_m2: FloatArray
    nearest_m: FloatArray  # where it is at nearest_s
    nearest_s: float
    velocity_m_s: FloatArray

    def field_ut(self, position: FloatArray, t: FloatArray) -> FloatArray:
        """Its field at points of the world, shape (n, 3), m in and uT out."""
        place = self.nearest_m + np.outer(t - self.nearest_s, self.velocity_m_s)
        x, y, z = self.moment_a_m2.tolist()
        return Magnet((0.0, 0.0, 0.0), (x, y, z)).field_ut(position - place)


@dataclass(frozen=True, slots=True)
class Attached:
    """A magnet on the sensor, from one time to another."""

    field_ut: FloatArray  # sensor frame
    on_s: float
    off_s: float

    def at(self, t: FloatArray) -> FloatArray:
        """Its field over time, sensor frame; it takes half a second to come or go."""
        share = np.clip((t - self.on_s) / 0.5, 0.0, 1.0)
        share -= np.clip((t - self.off_s) / 0.5, 0.0, 1.0)
        return np.outer(share, self.field_ut)


@dataclass(frozen=True, slots=True)
class Added:
    """A field that is the same in the whole room, and comes and goes."""

    field_ut: FloatArray  # world frame
    share: Callable[[FloatArray], FloatArray]  # of it, over times in s

    def at(self, t: FloatArray) -> FloatArray:
        """The field over time, uT, shape (n, 3)."""
        return np.outer(self.share(t), self.field_ut)


@dataclass(frozen=True, slots=True)
class Room:
    """Where a ride takes place."""

    field_ut: FloatArray  # at `origin_m`, without what passes
    origin_m: FloatArray = field(default_factory=lambda: np.zeros(3))
    gradient_ut_m: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    iron: tuple[Magnet, ...] = ()
    passing: tuple[Passing, ...] = ()
    added: tuple[Added, ...] = ()
    attached: tuple[Attached, ...] = ()

    def field_at(self, position: FloatArray, t: FloatArray) -> FloatArray:
        """The field in the world without attached magnets, uT, shape (n, 3)."""
        found = self.field_ut + (position - self.origin_m) @ self.gradient_ut_m
        for magnet in self.iron:
            found = found + magnet.field_ut(position)
            found = found - magnet.field_ut(self.origin_m[None])
        for iron in self.passing:
            found = found + iron.field_ut(position, t)
        for other in self.added:
            found = found + other.at(t)
        return found

    def felt(self, ride: Ride) -> FloatArray:
        """The field over a ride, uT, sensor frame."""
        world = self.field_at(ride.body.place.value, ride.t)
        found = rotation.rotate(rotation.inverse(ride.body.turning.quat), world)
        for magnet in self.attached:
            found = found + magnet.at(ride.t)
        return found


def uniform(random: np.random.Generator, ride: Ride) -> Room:
    """42 to 52 uT everywhere, which point down by 55 to 70 degrees."""
    dip = math.radians(random.uniform(*DIP_DEG))
    earth = np.array([0.0, math.cos(dip), -math.sin(dip)])
    return Room(random.uniform(*EARTH_UT) * earth, ride.body.place.value[0].copy())


def gradient(random: np.random.Generator, ride: Ride) -> Room:
    """A field that changes evenly, by 3 to 8 uT/m and at most 6 uT on the ride."""
    room = uniform(random, ride)
    away = np.linalg.norm(ride.body.place.value - room.origin_m, axis=1).max()
    strength = min(random.uniform(3.0, 8.0), 6.0 / max(float(away), 1e-3))
    return Room(room.field_ut, room.origin_m, slope(random, strength))


def slope(random: np.random.Generator, ut_m: float) -> FloatArray:
    """How a field changes evenly: by so much in the strongest direction, uT/m."""
    # Symmetric without a trace: no currents and no charges.
    matrix = random.standard_normal((3, 3))
    matrix = matrix + matrix.T
    matrix -= np.eye(3) * np.trace(matrix) / 3.0
    strongest = np.abs(np.linalg.eigvalsh(matrix)).max()
    return np.asarray(matrix * ut_m / strongest)


def table(random: np.random.Generator, ride: Ride) -> Room:
    """A steel table: four dipoles 0.5 to 1 m below the lowest place. Where the ride
    comes nearest, their field is 6 to 20 uT.
    """
    room = uniform(random, ride)
    place = ride.body.place.value
    below = place[random.integers(len(place))].copy()
    below[2] = place[:, 2].min() - random.uniform(0.5, 1.0)
    moments = room.field_ut / np.linalg.norm(room.field_ut)
    moments = moments + random.normal(0.0, 0.4, (4, 3))
    corners = random.uniform(-0.5, 0.5, (4, 3)) * np.array([1.0, 1.0, 0.0])
    pairs = list(zip((below + corners).tolist(), moments, strict=True))
    units = [Magnet(as_triple(at), as_triple(moment)) for at, moment in pairs]
    whole = np.linalg.norm(sum(unit.field_ut(place) for unit in units), axis=1).max()
    size = random.uniform(6.0, 20.0) / float(whole)
    iron = tuple(
        Magnet(as_triple(at), as_triple(size * moment)) for at, moment in pairs
    )
    return Room(room.field_ut, room.origin_m, iron=iron)


def passing(random: np.random.Generator, ride: Ride) -> Room:
    """Iron that passes two to six times, 0.5 to 1.5 m away at 0.3 to 2 m/s, with 5 to
    25 uT at most.
    """
    room = uniform(random, ride)
    place, t = ride.body.place.value, ride.t
    found = []
    for _ in range(random.integers(2, 7)):
        index = int(random.integers(round(0.15 * len(t)), len(t)))
        side, along = _across(random)
        distance = random.uniform(0.5, 1.5)
        moment = random.standard_normal(3)
        near = place[index] + distance * side
        # It keeps up with what drives on, so that it takes seconds there too.
        speed = ride.body.place.first[index] + random.uniform(0.3, 2.0) * along
        unit = Passing(moment, near, float(t[index]), speed)
        strongest = np.linalg.norm(unit.field_ut(place, t), axis=1).max()
        size = random.uniform(5.0, 25.0) / float(strongest)
        found.append(Passing(size * moment, near, float(t[index]), speed))
    return Room(room.field_ut, room.origin_m, passing=tuple(found))


def magnet(random: np.random.Generator, ride: Ride) -> Room:
    """A magnet of 5 to 20 uT on the sensor: from the start on, put on, or put on and
    taken off again.
    """
    room = uniform(random, ride)
    direction = random.standard_normal(3)
    strength = random.uniform(5.0, 20.0) * direction / np.linalg.norm(direction)
    on, off = np.sort(random.uniform(0.2, 0.8, 2)) * float(ride.t[-1])
    choice = random.integers(3)
    on = -1.0 if choice == 0 else on
    off = off if choice == 2 else math.inf
    return Room(room.field_ut, room.origin_m, attached=(Attached(strength, on, off),))


def east(_random: np.random.Generator, ride: Ride) -> Room:
    """The field of the pendulum whose axis points east."""
    return Room(np.array([0.0, 20.0, -43.0]), ride.body.place.value[0].copy())


ROOMS: dict[str, Callable[[np.random.Generator, Ride], Room]] = {
    "uniform": uniform,
    "gradient": gradient,
    "table": table,
    "passing": passing,
    "magnet": magnet,
    "east": east,
}


def _across(random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A level direction, and another across it."""
    angle = random.uniform(-np.pi, np.pi)
    side = np.array([math.cos(angle), math.sin(angle), 0.0])
    return side, np.array([-side[1], side[0], 0.0])


def as_triple(vector: FloatArray) -> tuple[float, float, float]:
    """A vector as a Magnet takes it."""
    x, y, z = map(float, vector)
    return x, y, z
