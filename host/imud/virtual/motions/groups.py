# SPDX-License-Identifier: MIT
"""Groups of made recordings: each draws its ride, its room and its module by seed.

Even seeds are for tuning, odd ones for judging.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.motions.limbs import pointing, running, walking
from imud.virtual.motions.machines import centrifuge, robot_arm, turntable, vehicle
from imud.virtual.motions.module import MODULES
from imud.virtual.motions.ride import RATE_HZ, Ride
from imud.virtual.motions.room import ROOMS, Room
from imud.virtual.motions.swings import (
    east_pendulum,
    one_axis,
    pendulum,
    two_axis_pendulum,
)

# Room and module of seeds 0 and 1, of 2 and 3, and so on.
CONDITIONS = 2 * (
    ("uniform", "small"),
    ("gradient", "large"),
    ("table", "small"),
    ("passing", "large"),
    ("uniform", "large"),
    ("passing", "small"),
    ("magnet", "small"),
)
# Pendulums have good modules in their second half.
SWUNG = CONDITIONS[:7] + tuple((room, "good") for room, _ in CONDITIONS[7:])
OWN = 4 * (("east", "crossed"), ("east", "good"))

TUNING, JUDGING = "tuning", "judging"
SETS = {TUNING: 0, JUDGING: 1}  # seeds: these, and every second one


@dataclass(frozen=True, slots=True)
class Group:
    """Recordings of one kind of ride. Conditions repeat from the first."""

    ride: Callable[[np.random.Generator], Ride]
    conditions: tuple[tuple[str, str], ...] = CONDITIONS


GROUPS = {
    "pendulum": Group(pendulum, SWUNG),
    "two_axis_pendulum": Group(two_axis_pendulum, SWUNG),
    "east_pendulum": Group(east_pendulum, OWN),
    "turntable": Group(turntable),
    "centrifuge": Group(centrifuge),
    "robot_arm": Group(robot_arm),
    "vehicle": Group(vehicle),
    "walking": Group(walking),
    "running": Group(running),
    "pointing": Group(pointing),
    "one_axis": Group(one_axis),
}


@dataclass(frozen=True, slots=True)
class Recipe:
    """A recording before it is made."""

    group: str
    seed: int

    def __str__(self) -> str:
        return f"{self.group} {self.seed}"

    @property
    def which(self) -> str:
        """TUNING or JUDGING."""
        return JUDGING if self.seed % 2 else TUNING

    @property
    def room(self) -> str:
        """A name in ROOMS."""
        return self._conditions[0]

    @property
    def module(self) -> str:
        """A name in MODULES."""
        return self._conditions[1]

    @property
    def _conditions(self) -> tuple[str, str]:
        known = GROUPS[self.group].conditions
        return known[self.seed // 2 % len(known)]

    def made(self) -> Motion:
        """The recording, always the same."""
        return self.made_in_field()[0]

    def made_in_field(self) -> tuple[Motion, FloatArray]:
        """The same with the field of the place, without what bends it: uT, east, north,
        up.
        """
        name = zlib.crc32(self.group.encode())
        randoms = map(
            np.random.default_rng, np.random.SeedSequence([name, self.seed]).spawn(4)
        )
        of_ride, of_room, of_module, of_noise = randoms
        ride = GROUPS[self.group].ride(of_ride)
        room = ROOMS[self.room](of_room, ride)
        module = MODULES[self.module](of_module)
        return module.measures(exact(ride, room), of_noise), room.field_ut


def recipes(which: str) -> Iterator[Recipe]:
    """All recordings for TUNING or for JUDGING."""
    for name, group in GROUPS.items():
        for index in range(len(group.conditions)):
            yield Recipe(name, 2 * index + SETS[which])


def exact(ride: Ride, room: Room) -> Motion:
    """A ride as a perfect sensor feels it, with its truth."""
    body = ride.body
    return Motion(
        RATE_HZ,
        gyr=body.turning.rate,
        acc=body.specific_force(),
        mag=room.felt(ride),
        quat=body.turning.quat,
        position=body.place.value,
        velocity=body.place.first,
        movement=ride.t > ride.rest_s,
        is_recorded=False,
    )
