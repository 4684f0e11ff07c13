# SPDX-License-Identifier: MIT
"""Motions with exact truth, on ground that misleads an orientation filter: magnets,
steel, mains, slow turns, walks, and sensors that have died.

A place and an attitude a sample; each function returns what a good module feels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from core import desk
from core.desk import DEGREE, G, ffi, lib
from core.scenes import Scene, scene
from imud import rotation
from imud.virtual.bodies import RigidBody
from imud.virtual.motions import misleading, ways
from imud.virtual.motions.misleading import EARTH_UT
from imud.virtual.motions.module import MG

RATE_HZ = 200
# Rates are means over the sample period, so 2.5 ms of delay need no lead.
MPU9250 = desk.identity_of(gyr_delay_us=2500)
POSE = desk.dtype_of("struct message_pose")
NOT_KNOWN = 2**16 - 1
SIGMAS = 1.96  # 95 % of normal errors fall inside

RANGE = 16 * G  # of the accelerometer


@dataclass(frozen=True, repr=False)
class Stated:
    """True errors of poses over time, and what the poses state; NaN: withheld."""

    times_s: desk.Array
    heading_deg: desk.Array
    tilt_deg: desk.Array
    heading_sigma_deg: desk.Array
    tilt_sigma_deg: desk.Array

    def since(self, begin_s: float, end_s: float = np.inf) -> Stated:
        """The poses of a part."""
        rows = (self.times_s >= begin_s) & (self.times_s < end_s)
        return Stated(*(getattr(self, name)[rows] for name in self.__annotations__))

    @property
    def honest_headings(self) -> float:
        """The share that is inside the stated 95 %, or withheld."""
        return _honest(self.heading_deg, self.heading_sigma_deg)

    @property
    def honest_tilts(self) -> float:
        """The same of tilts."""
        return _honest(self.tilt_deg, self.tilt_sigma_deg)

    @property
    def heading_rms_deg(self) -> float:
        return float(np.sqrt(np.mean(self.heading_deg**2)))

    @property
    def caution(self) -> float:
        """How many times the true error of heading its stated one is."""
        return float(np.nanmedian(self.heading_sigma_deg)) / self.heading_rms_deg


def _honest(error_deg: desk.Array, sigma_deg: desk.Array) -> float:
    return float(np.mean(np.isnan(sigma_deg) | (error_deg <= SIGMAS * sigma_deg)))


# Of sensors that were calibrated in the field of EARTH_UT, which is told in 0.25 uT.
CALIBRATED_C = 25.0
KNOWN = ffi.new("struct calibration *", desk.EXACT[0])
KNOWN.temperature = round(100 * CALIBRATED_C)
KNOWN.field_north, KNOWN.field_up = (4 * EARTH_UT[1:]).round().astype(int).tolist()


def poses_of(
    felt: Scene,
    *,
    is_known: bool = True,
    warmer_k: float = 0,
    drift_mg_k: float | None = None,
) -> Stated:
    """What the firmware's C makes of it, from power-on; `is_known`: of calibrated
    sensors, calibrated so much colder. `drift_mg_k`: as its params tell it.
    """
    samples = felt.samples(MPU9250)
    samples["temperature_cdeg"] = round(100 * (CALIBRATED_C + warmer_k))
    samples["acc_clipped"] = (np.abs(samples["acc"].astype(int)) >= 2**15 - 1).any(1)
    tracker: Any = ffi.new("struct pose_tracker *")
    calibration = KNOWN if is_known else desk.UNKNOWN
    if drift_mg_k is not None:
        calibration = ffi.new("struct calibration *", KNOWN[0])
        calibration.drift = round(12800 * MG * drift_mg_k)
    assert lib.pose_begin(tracker, calibration, MPU9250, lib.FILTER_FUSE)
    poses = np.zeros(len(felt), POSE)
    results = np.zeros(len(felt), np.int32)
    desk.call(lib.loop_pose, tracker, len(felt), samples, poses, results)
    sigmas = (
        np.where(poses[name] == NOT_KNOWN, np.nan, poses[name] / 100)
        for name in ("heading_sigma", "tilt_sigma")
    )
    q = poses["q"]
    return Stated(
        np.arange(len(felt)) / RATE_HZ,
        desk.heading_deg(q, felt.quat),
        desk.tilt_deg(q, felt.quat),
        *sigmas,
    )


def times(seconds: float) -> desk.Array:
    return np.arange(round(seconds * RATE_HZ)) / RATE_HZ


def direction(random: np.random.Generator) -> desk.Array:
    return desk.unit_rows(random, 1, 3)[0]


def feeling(
    body: RigidBody,
    random: np.random.Generator,
    *,
    field_ut: desk.Array = EARTH_UT,
    scale: float = 0.003,
) -> Scene:
    """What is felt on the way; the gyroscope's scales are wrong by up to `scale`."""
    quat = body.turning.quat
    felt = scene(
        quat, RATE_HZ, seed=int(random.integers(2**31)), field_ut=np.array(field_ut)
    )
    felt.gyr *= 1 + random.uniform(-scale, scale, 3)
    felt.acc += rotation.rotate(rotation.inverse(quat), body.place.second)
    return felt


# Magnets and rooms.


def own_field(size_ut: float, seed: int) -> Scene:
    """A magnet on the probe from power-on; in a hand for 80 s."""
    random = np.random.default_rng([1, seed])
    felt = feeling(ways.in_hand(random, times(88)), random)
    felt.mag += size_ut * direction(random)
    return felt


def laid_on_steel(size_ut: float, seed: int) -> Scene:
    """A room that has another field for the first 12 s; in a hand from 8 s on."""
    random = np.random.default_rng([2, seed])
    t = times(128)
    body = ways.in_hand(random, t)
    steel = misleading.left_behind(size_ut * direction(random))
    return feeling(body, random, field_ut=EARTH_UT + steel.at(t))


def beside_a_motor(hz: float, size_ut: float, seed: int) -> Scene:
    """A field of mains from 20 s on, as means over the time of a reading."""
    random = np.random.default_rng([3, seed])
    t = times(88)
    motor = misleading.mains(size_ut * np.array([0.8, 0.6, 0.0]), hz, 1.0, from_s=20)
    body = ways.in_hand(random, t)
    return feeling(body, random, field_ut=EARTH_UT + motor.at(t))


def shop_module_turned_about_one_axis(seed: int) -> Scene:
    """Turned slowly about the one level axis along which most of its own field lies."""
    random = np.random.default_rng([4, seed])
    felt = feeling(ways.about_one_axis(random, times(50)), random, scale=0.01)
    felt.mag += [random.choice([-1, 1]) * 40, *random.uniform(-8, 8, 2)]
    return felt


# Motions that the filter should find easy.


def carried(seed: int) -> Scene:
    """Carried back and forth by 0.25 m in an uneven room, hardly turned; 60 s."""
    random = np.random.default_rng([5, seed])
    t = times(68)
    body = ways.carried(random, t)
    room = misleading.uneven(body.place.value, misleading.under_desk(random))
    felt_ut = room.field_at(body.place.value, t)
    return feeling(body, random, field_ut=felt_ut, scale=0.005)


def walking(seed: int) -> Scene:
    """In a pocket: a leg's swing at 0.9 Hz, through a room that differs by 2 uT."""
    random = np.random.default_rng([6, seed])
    t = times(86)
    body = ways.walking(random, t)
    room = misleading.uneven(body.place.value, misleading.under_floor(random))
    felt_ut = room.field_at(body.place.value, t)
    return feeling(body, random, field_ut=felt_ut, scale=0.005)


# Power-on, temperature and sensors that have died.


def turned_slowly(rate_deg_s: float, seed: int) -> Scene:
    """A turntable or a ship: turns about the vertical from power-on for 30 s, lies for
    20 s, then in a hand for 30 s.
    """
    random = np.random.default_rng([7, seed])
    return feeling(ways.turned_slowly(random, times(80), rate_deg_s), random)


def lying(tilt_deg: float, seconds: float = 60) -> Scene:
    """At rest, leaning."""
    random = np.random.default_rng(8)
    lean = rotation.from_rotation_vector(np.array([tilt_deg * DEGREE, 0, 0]))
    return feeling(RigidBody.still(lean, len(times(seconds))), random)


def in_hand(seed: int) -> Scene:
    """Nothing special."""
    random = np.random.default_rng([9, seed])
    return feeling(ways.in_hand(random, times(88)), random)


def laid_down(seed: int) -> Scene:
    """20 s in a hand, then at rest; a gyroscope that warms up by up to 0.1 deg/s."""
    random = np.random.default_rng([10, seed])
    t = times(180)
    felt = feeling(ways.laid_down(random, t), random)
    drift = random.uniform(-0.1, 0.1, 3) * DEGREE
    felt.gyr += -np.expm1(-t / 60)[:, None] * drift
    return felt
