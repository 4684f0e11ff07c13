# SPDX-License-Identifier: MIT
"""Groups of simulated motions that show whether stated errors are true: good modules in
use, uneven fields, modules from the shop, and faults. docs/accuracy.md lists them.

Even seeds are for tuning, odd ones for judging.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from imud import rotation
from imud.params.trusted import known_to
from imud.virtual.modules import shop
from imud.virtual.motion import Motion
from imud.virtual.motions import handling, misleading, ways
from imud.virtual.motions.groups import exact
from imud.virtual.motions.limbs import pointing
from imud.virtual.motions.machines import robot_arm, vehicle
from imud.virtual.motions.misleading import Random
from imud.virtual.motions.module import GOOD, LARGE, MG, Module
from imud.virtual.motions.ride import Ride
from imud.virtual.motions.room import Room

# What a calibration tells: one sigma of an axis is a limit over root 3, and the field
# is that of misleading.EARTH_UT.
PLACE = {"norm_uT": 47.4, "dip_deg": 65.1}
OF_GOOD = known_to(0.009, 0.2, gyr=0.002, **PLACE)
AWAY_K = 25.0  # of the samples, which have 25 degC
OF_WARM = known_to(0.009, 0.2, gyr=0.002, temperature_c=25.0 - AWAY_K, **PLACE)
OF_LARGE = known_to(0.08, 1.9, **PLACE)
UNKNOWN = b""  # no calibration


@dataclass(frozen=True, slots=True)
class Ground:
    """Motions of one kind."""

    says: str
    ride: Callable[[Random], Ride]
    room: Callable[[Random, Ride], Room] = misleading.plain
    module: Callable[[Random], Module] = GOOD.drawn
    params: bytes = OF_GOOD
    fault: Callable[[Random, Motion], Motion] | None = None


def along_x(random: Random) -> Module:
    """A module from the shop whose own field lies along x: 35 to 45 uT."""
    own = [random.choice([-1.0, 1.0]) * random.uniform(35.0, 45.0)]
    return replace(shop(random), mag_bias=np.array([*own, *random.uniform(-8, 8, 2)]))


def dead_accelerometer(random: Random, felt: Motion) -> Motion:
    """Two axes at the end of their range, one, all zero, or all stuck."""
    acc = felt.acc.copy()
    kind = random.integers(4)
    if kind < 2:
        acc[:, : 2 - kind] = 157.0
    else:
        acc[:] = 0.0 if kind == 2 else 5.7 * random.standard_normal(3)
    return replace(felt, acc=acc)


def dead_magnetometer(random: Random, felt: Motion) -> Motion:
    """All axes stuck, one that reads zero, or one inverted."""
    mag, axis = felt.mag.copy(), int(random.integers(3))
    kind = random.integers(3)
    if kind == 0:
        mag[:] = mag[0]
    else:
        mag[:, axis] *= 0.0 if kind == 1 else -1.0
    return replace(felt, mag=mag)


def far_from_calibration(random: Random, felt: Motion) -> Motion:
    """Each axis of the accelerometer has moved by 0.75 mg/K (one sigma)."""
    return replace(felt, acc=felt.acc + random.normal(0.0, 0.75 * MG * AWAY_K, 3))


def leaning(random: Random) -> Ride:
    """Lying at 60 degrees, then in a hand."""
    ride = handling.of(ways.in_hand, 68.0, 15.0)(random)
    return ride.mounted(rotation.from_rotation_vector(np.radians([60.0, 0.0, 0.0])))


IN_HAND = handling.of(ways.in_hand, 88.0, 8.0)
WALKING = handling.of(ways.walking, 86.0, 6.0)

GROUNDS = {
    "hand": Ground("a good module in a hand, up to 150 deg/s", IN_HAND),
    "pointing": Ground("a good module on a forearm that points", pointing),
    "wand": Ground("waved by up to 600 deg/s, with a ring after", handling.waved),
    "vehicle": Ground("long turns of a vehicle", vehicle),
    "robot": Ground("a robot arm with four joints", robot_arm),
    "arm": Ground(
        "a tool on an arm of 0.6 m, in a hall that differs by 8 uT/m",
        handling.arm,
        misleading.hall,
    ),
    "rough": Ground(
        "a roughly calibrated module in a hand",
        IN_HAND,
        module=LARGE.drawn,
        params=OF_LARGE,
    ),
    "carried": Ground(
        "carried back and forth by 0.25 m over iron, hardly turned",
        handling.of(ways.carried, 68.0, 8.0),
        misleading.beneath_desk,
    ),
    "walking": Ground(
        "in a pocket, over iron under the floor", WALKING, misleading.beneath_floor
    ),
    "sloping": Ground(
        "in a pocket, in a room that differs by 2 to 6 uT/m",
        WALKING,
        misleading.sloping,
    ),
    "phone": Ground(
        "in a pocket, with a phone beside it once or twice", WALKING, misleading.phone
    ),
    "steel desk": Ground(
        "laid on a desk of steel and moved about it",
        handling.on_desk,
        misleading.steel_desk,
    ),
    "magnet": Ground(
        "5 to 40 uT on the probe from power-on, in a hand",
        IN_HAND,
        misleading.from_the_start(5.0, 40.0),
    ),
    "strong": Ground(
        "40 to 2000 uT on the probe from power-on, in a hand",
        IN_HAND,
        misleading.from_the_start(40.0, 2000.0),
    ),
    "steel": Ground(
        "switched on lying on steel, 15 to 300 uT, removed after 12 s",
        handling.of(ways.in_hand, 128.0, 8.0),
        misleading.on_steel,
    ),
    "mains": Ground(
        "near mains from 20 s on, in a hand", IN_HAND, misleading.near_mains
    ),
    "shop": Ground(
        "from the shop, turned slowly after 20 s of rest",
        handling.of(ways.about_all_axes, 50.0, 20.0),
        module=shop,
        params=UNKNOWN,
    ),
    "one axis": Ground(
        "from the shop, turned about the level axis of its own field",
        handling.of(ways.about_one_axis, 50.0, 20.0),
        module=along_x,
        params=UNKNOWN,
    ),
    "slow turn": Ground(
        "from the shop, turned by 0.3 to 25 deg/s at power-on",
        handling.turned_slowly,
        module=shop,
        params=UNKNOWN,
    ),
    "dead acc": Ground(
        "an accelerometer that is at its end, zero or stuck",
        leaning,
        fault=dead_accelerometer,
    ),
    "dead mag": Ground(
        "a magnetometer that is stuck, or has a dead or inverted axis",
        IN_HAND,
        fault=dead_magnetometer,
    ),
    "warm": Ground(
        "25 K from its calibration, laid down five times",
        handling.laid_about,
        params=OF_WARM,
        fault=far_from_calibration,
    ),
}


def made(name: str, seed: int) -> Motion:
    """A motion of a group, always the same."""
    seeds = np.random.SeedSequence([zlib.crc32(name.encode()), seed])
    of_ride, of_room, of_module, of_noise, of_fault = map(
        np.random.default_rng, seeds.spawn(5)
    )
    ground = GROUNDS[name]
    ride = ground.ride(of_ride)
    room = ground.room(of_room, ride)
    felt = ground.module(of_module).measures(exact(ride, room), of_noise)
    return ground.fault(of_fault, felt) if ground.fault else felt
