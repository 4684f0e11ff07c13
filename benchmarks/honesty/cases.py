# SPDX-License-Identifier: MIT
"""Cases of a desk that misleads a probe: what a module feels there, with its truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np

from imud import rotation
from imud.calibration.earth import Earth, with_field
from imud.params.trusted import known_to, place_of
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody
from imud.virtual.curves import Piece, about, joined
from imud.virtual.modules import calibrated
from imud.virtual.motion import Motion
from imud.virtual.motions import misleading
from imud.virtual.motions.groups import exact
from imud.virtual.motions.module import MG
from imud.virtual.motions.ride import ORIGIN, RATE_HZ, Ride, X, Z, facing, times
from imud.virtual.motions.room import Added, Room
from imud.virtual.sensors import SensorErrors, World, generate

HAND_S = 150.0
QUIET = SensorErrors(0.08, 0.05 / MG, 0.5, 0.5, 0.0, 0.0)
RANGE_M_S2 = 400.0  # beyond the range of any sensor


SAMPLES_C = 25.0  # of all simulated samples
EARTH_UT = World().field_at(np.zeros(3))


@dataclass(frozen=True, slots=True)
class Case:
    """A line of the table; `made` gets the seed."""

    group: str
    name: str
    made: Callable[[int], Motion]
    is_known: bool = True  # the sensors are calibrated
    from_s: float = 15.0  # poses count from here on
    colder_k: float = 0.0  # than its calibration
    has_place: bool = False  # params state the place of an uncalibrated one

    @property
    def params(self) -> bytes:
        """As a guided calibration leaves them in this field; or none."""
        if not self.is_known:
            here = Earth(**place_of(EARTH_UT), declination_deg=0.0)
            return with_field(b"", here) if self.has_place else b""
        then_c = SAMPLES_C + self.colder_k
        return known_to(0.007, 0.05, temperature_c=then_c, **place_of(EARTH_UT))

    def __str__(self) -> str:
        return f"{self.name}, {'calibrated' if self.is_known else 'uncalibrated'}"


@lru_cache(maxsize=1)
def hand(seed: int) -> Motion:
    """A hand that turns the probe, lays it down and draws with it."""
    return generate(HAND_S, seed, RATE_HZ, World(), QUIET)


def direction(*seed: int) -> FloatArray:
    """Any direction, as likely as any other."""
    return misleading.direction(np.random.default_rng(seed))


def own_field(seed: int, size_ut: int) -> Motion:
    """A magnet on the probe from power-on."""
    felt = hand(seed)
    return replace(felt, mag=felt.mag + size_ut * direction(1, size_ut, seed))


def with_room(felt: Motion, added: Added) -> Motion:
    """With a field of the room."""
    assert felt.quat is not None
    field_ut = added.at(np.arange(len(felt)) / felt.rate_hz)
    own = rotation.rotate(rotation.inverse(felt.quat), field_ut)
    return replace(felt, mag=felt.mag + own)


def steel(seed: int, size_ut: int) -> Motion:
    """Laid on steel at power-on."""
    field_ut = size_ut * direction(2, size_ut, seed)
    return with_room(hand(seed), misleading.left_behind(field_ut))


def mains(seed: int, hz: float, size_ut: float) -> Motion:
    """Near a motor or a power supply from 30 s on."""
    start = np.random.default_rng([3, seed]).uniform(0.0, 2.0 * np.pi)
    field_ut = size_ut * direction(3, seed)
    return with_room(hand(seed), misleading.mains(field_ut, hz, start, 30.0))


def on_desk(
    seed: int, tilt_deg: float, rate_deg_s: float = 0.0, turned_s: float = 0.0
) -> Motion:
    """Turns about the vertical from power-on, then lies still for a minute; leans."""
    random = np.random.default_rng([4, seed])
    t = times(turned_s + 60.0)
    rate = math.radians(rate_deg_s) * random.choice([-1.0, 1.0])
    turn = joined([Piece(max(turned_s, 0.1), 0.0, rate, rate), Piece(60.0)], t)
    lean = rotation.from_rotation_vector(math.radians(tilt_deg) * X)
    body = RigidBody.still(facing(random), len(t)).hinged(ORIGIN, about(Z, turn))
    ride = Ride(body, rest_s=-1.0).mounted(lean)
    room = Room(EARTH_UT)
    return calibrated().measures(exact(ride, room), random)


def turning(seed: int, rate_deg_s: float) -> Motion:
    """A ship or a turntable; counted while it lies still afterwards."""
    return on_desk(seed, 0.0, rate_deg_s, turned_s=30.0)


def in_car(seed: int, size_ut: int) -> Motion:
    """Iron that turns with the probe, about the vertical only."""
    felt = on_desk(seed, 5.0, 12.0, turned_s=60.0)
    return replace(felt, mag=felt.mag + size_ut * direction(6, size_ut, seed))


def blows(seed: int, g: float, ms: float, hz: float, *, in_hand: bool) -> Motion:
    """Hard blows along an axis from 15 s on, and a tenth of it back for ten times as
    long: without a mean.
    """
    felt = hand(seed) if in_hand else on_desk(seed, 5.0)
    since_ms = 1000.0 * np.mod(np.arange(len(felt)) / felt.rate_hz, 1.0 / hz)
    push = np.where(since_ms < ms, g, np.where(since_ms < 11.0 * ms, -g / 10.0, 0.0))
    push[: round(15.0 * felt.rate_hz)] = 0.0
    return shifted(felt, np.outer(1000.0 * push, np.eye(3)[seed // 2 % 3]))


def shifted(felt: Motion, bias_mg: Sequence[float] | FloatArray) -> Motion:
    """With another offset of the accelerometer, or one for each record."""
    return replace(felt, acc=felt.acc + MG * np.array(bias_mg))


def cold_lying(seed: int, bias_mg: Sequence[float]) -> Motion:
    return shifted(on_desk(seed, 10.0), bias_mg)


def cold_in_hand(seed: int, bias_mg: Sequence[float]) -> Motion:
    return shifted(hand(seed), bias_mg)


def acc_of_zeros(seed: int) -> Motion:
    felt = on_desk(seed, 60.0)
    return replace(felt, acc=0.0 * felt.acc)


def acc_at_its_end(seed: int) -> Motion:
    """Two of three axes, drawn by seed."""
    felt = hand(seed)
    acc = np.full_like(felt.acc, RANGE_M_S2)
    acc[:, seed // 2 % 3] = felt.acc[:, seed // 2 % 3]
    return replace(felt, acc=acc)


def mag_stuck(seed: int) -> Motion:
    felt = hand(seed)
    return replace(felt, mag=np.tile(felt.mag[10], (len(felt), 1)))


def mag_inverted(seed: int) -> Motion:
    """One of three axes, drawn by seed."""
    felt = hand(seed)
    signs = np.where(np.arange(3) == seed // 2 % 3, -1.0, 1.0)
    return replace(felt, mag=felt.mag * signs)


def both(
    group: str, name: str, made: Callable[[int], Motion], from_s: float = 15.0
) -> list[Case]:
    """The case of calibrated sensors, and of others."""
    return [Case(group, name, made, known, from_s) for known in (True, False)]


def all_cases() -> Iterator[Case]:
    """The lines in their order."""
    for size in (20, 40, 80, 150, 400, 2000):
        made = partial(own_field, size_ut=size)
        yield from both("own field", f"{size} uT on the probe", made)
    for size in (20, 45, 70, 120):
        made = partial(steel, size_ut=size)
        yield Case("steel", f"room +{size} uT for the first 12 s", made)
    for hz, size in ((50.0, 20), (49.9, 20), (49.5, 20), (60.0, 20), (50.0, 60)):
        made = partial(mains, hz=hz, size_ut=size)
        yield Case("mains", f"{size} uT at {hz:g} Hz from 30 s", made, from_s=60.0)
    for rate in (0.5, 1.0, 3.0, 6.0, 12.0, 25.0):
        made = partial(turning, rate_deg_s=rate)
        yield from both("turning start", f"{rate:g} deg/s for 30 s", made, 50.0)
    for size in (10, 30):
        name, made = f"iron of a car, {size} uT", partial(in_car, size_ut=size)
        yield from both("car", name, made, 20.0)
        yield Case("car", f"{name}, place known", made, False, 20.0, has_place=True)
    # The short ones end before a sample shows that they were clipped.
    for g, ms, hz, in_hand in (
        *((60.0, 10.0, 5.0, False), (60.0, 10.0, 2.0, True), (100.0, 8.0, 5.0, False)),
        *((60.0, 2.0, 5.0, False), (12.0, 5.0, 10.0, True)),
    ):
        name = f"blows of {g:g} g and {ms:g} ms, {'in hand' if in_hand else 'lies'}"
        made = partial(blows, g=g, ms=ms, hz=hz, in_hand=in_hand)
        yield Case("blows", name, made, from_s=17.0)
    for away_k, bias_mg in ((30.0, (45, -30, 20)), (45.0, (50, 30, 100))):
        name = f"{away_k:.0f} K from calibration"
        made = partial(cold_lying, bias_mg=bias_mg)
        yield Case("cold", f"{name}, lies", made, colder_k=away_k)
        made = partial(cold_in_hand, bias_mg=bias_mg)
        yield Case("cold", f"{name}, in hand", made, colder_k=away_k)
    yield from both("dead", "accelerometer 0 0 0, lies at 60 deg", acc_of_zeros)
    yield from both("dead", "accelerometer, 2 axes at the end", acc_at_its_end)
    yield from both("dead", "magnetometer stuck", mag_stuck)
    yield from both("dead", "magnetometer, 1 axis inverted", mag_inverted)


CASES = tuple(all_cases())
GROUPS = tuple(dict.fromkeys(case.group for case in CASES))
