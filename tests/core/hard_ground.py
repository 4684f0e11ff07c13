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
from imud.virtual.sensors import Magnet

RATE_HZ = 200
# Rates are means over the sample period, so 2.5 ms of delay need no lead.
MPU9250 = desk.identity_of(gyr_delay_us=2500)
POSE = desk.dtype_of("struct message_pose")
NOT_KNOWN = 2**16 - 1
SIGMAS = 1.96  # 95 % of normal errors fall inside

EARTH = np.array([0.0, 20.0, -43.0])  # uT; east, north, up
RANGE = 16 * G  # of the accelerometer
READING_S = 0.0072  # for which the AK8963 measures


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


# Of sensors that were calibrated in the field of EARTH, which is told in 0.25 uT.
CALIBRATED_C = 25.0
KNOWN = ffi.new("struct calibration *", desk.EXACT[0])
KNOWN.temperature = round(100 * CALIBRATED_C)
KNOWN.field_north, KNOWN.field_up = (4 * EARTH[1:]).round().astype(int).tolist()


def poses_of(felt: Scene, *, is_known: bool = True, warmer_k: float = 0) -> Stated:
    """What the firmware's C makes of it, from power-on; `is_known`: of sensors that
    somebody has calibrated, and so much colder.
    """
    samples = felt.samples(MPU9250)
    samples["temperature_cdeg"] = round(100 * (CALIBRATED_C + warmer_k))
    samples["acc_clipped"] = (np.abs(samples["acc"].astype(int)) >= 2**15 - 1).any(1)
    tracker: Any = ffi.new("struct pose_tracker *")
    calibration = KNOWN if is_known else desk.UNKNOWN
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


# Where it goes.


def times(seconds: float) -> desk.Array:
    return np.arange(round(seconds * RATE_HZ)) / RATE_HZ


def begun(t: desk.Array, rest_s: float) -> desk.Array:
    """0 at rest, 1 two seconds later."""
    u = np.clip((t - rest_s) / 2, 0, 1)
    return np.asarray(u**2 * (3 - 2 * u))


def wandering(t: desk.Array, random: np.random.Generator, hz: float) -> desk.Array:
    """Slow sines about this frequency, 1 rms."""
    found = np.zeros_like(t)
    for share in random.uniform(0.5, 1.5, 4):
        found += np.sin(2 * np.pi * hz * share * t + random.uniform(0, 2 * np.pi))
    return np.asarray(found / np.sqrt(2))


def attitudes(yaw: desk.Array, pitch: desk.Array, roll: desk.Array) -> desk.Array:
    """World from body, by turns about z, y and x, rad."""
    about = [
        rotation.from_rotation_vector(angle[:, None] * np.eye(3)[axis])
        for axis, angle in ((2, yaw), (1, pitch), (0, roll))
    ]
    return rotation.multiply(rotation.multiply(about[0], about[1]), about[2])


def hand(random: np.random.Generator, seconds: float, rest_s: float = 8) -> desk.Array:
    """A hand that turns a probe by up to 150 deg/s, after a rest."""
    t = times(seconds)
    way = begun(t, rest_s)
    yaw, pitch, roll = (
        degrees * DEGREE * way * wandering(t, random, hz)
        for degrees, hz in ((60, 0.25), (35, 0.3), (35, 0.3))
    )
    return attitudes(yaw + random.uniform(-3, 3), pitch, roll)


def direction(random: np.random.Generator) -> desk.Array:
    return desk.unit_rows(random, 1, 3)[0]


def feeling(
    quat: desk.Array,
    random: np.random.Generator,
    *,
    field_ut: desk.Array = EARTH,
    place_m: desk.Array | None = None,
    scale: float = 0.003,
) -> Scene:
    """What is felt on the way; the gyroscope's scales are wrong by up to `scale`."""
    felt = scene(
        quat, RATE_HZ, seed=int(random.integers(2**31)), field_ut=np.array(field_ut)
    )
    felt.gyr *= 1 + random.uniform(-scale, scale, 3)
    if place_m is not None:
        speed = np.gradient(place_m, axis=0) * RATE_HZ
        force = np.gradient(speed, axis=0) * RATE_HZ
        felt.acc += rotation.rotate(rotation.inverse(quat), force)
    return felt


# Magnets and rooms.


def own_field(size_ut: float, seed: int) -> Scene:
    """A magnet on the probe from power-on; in a hand for 80 s."""
    random = np.random.default_rng([1, seed])
    felt = feeling(hand(random, 88), random)
    felt.mag += size_ut * direction(random)
    return felt


def laid_on_steel(size_ut: float, seed: int) -> Scene:
    """A room that has another field for the first 12 s; in a hand from 8 s on."""
    random = np.random.default_rng([2, seed])
    quat = hand(random, 128)
    share = np.clip((12 - times(128)) / 2, 0, 1)[:, None]
    room_ut = EARTH + share * size_ut * direction(random)
    return feeling(quat, random, field_ut=room_ut)


def beside_a_motor(hz: float, size_ut: float, seed: int) -> Scene:
    """A field of mains from 20 s on, as means over the time of a reading."""
    random = np.random.default_rng([3, seed])
    quat, t = hand(random, 88), times(88)
    swing = np.sin(2 * np.pi * hz * t + 1.0) * np.sinc(hz * READING_S) * (t > 20)
    room_ut = EARTH + swing[:, None] * size_ut * np.array([0.8, 0.6, 0.0])
    return feeling(quat, random, field_ut=room_ut)


def shop_module_turned_about_one_axis(seed: int) -> Scene:
    """Turned slowly about the one level axis along which most of its own field lies."""
    random = np.random.default_rng([4, seed])
    t = times(50)
    way = begun(t, 20)
    pitch, yaw = (2 * DEGREE * way * wandering(t, random, 0.2) for _ in range(2))
    roll = 35 * DEGREE * way * wandering(t, random, 0.1)
    quat = attitudes(yaw + random.uniform(-3, 3), pitch, roll)
    felt = feeling(quat, random, scale=0.01)
    felt.mag += [random.choice([-1, 1]) * 40, *random.uniform(-8, 8, 2)]
    return felt


# Motions that the filter should find easy.


def uneven(place_m: desk.Array, irons: list[Magnet]) -> desk.Array:
    """The field on the way beside pieces of iron; on its mean it is the Earth's."""
    found = np.sum([iron.field_ut(place_m) for iron in irons], axis=0)
    return np.asarray(found + EARTH - found.mean(axis=0))


def carried(seed: int) -> Scene:
    """Carried to and fro by 0.25 m in an uneven room, hardly turned; 60 s."""
    random = np.random.default_rng([5, seed])
    t = times(68)
    way = begun(t, 8)
    wander = [wandering(t, random, 0.8) for _ in range(6)]
    place_m = 0.25 * (way * np.array(wander[:3])).T
    yaw, pitch, roll = (3 * DEGREE * way * each for each in wander[3:])
    quat = attitudes(yaw + random.uniform(-3, 3), pitch, roll)
    irons = [
        Magnet((*random.uniform(-1, 1, 2), -1.05), tuple(random.normal(0, 20, 3)))
        for _ in range(4)
    ]
    room_ut = uneven(place_m, irons)
    return feeling(quat, random, field_ut=room_ut, place_m=place_m, scale=0.005)


def walking(seed: int) -> Scene:
    """In a pocket: a leg's swing at 0.9 Hz, through a room that differs by 2 uT."""
    random = np.random.default_rng([6, seed])
    t, step_hz = times(86), 0.9
    way = begun(t, 6)
    swing = random.uniform(15, 30) * DEGREE * way * np.sin(2 * np.pi * step_hz * t)
    bounce = np.sin(4 * np.pi * step_hz * t)
    quat = attitudes(
        120 * DEGREE * way * wandering(t, random, 0.05),
        swing,
        70 * DEGREE + 4 * DEGREE * way * bounce,
    )
    x, y = (1.2 * way * wandering(t, random, 0.06) for _ in range(2))
    up = 0.03 * way * np.cos(4 * np.pi * step_hz * t) + 0.35 * (1 - np.cos(swing))
    place_m = np.stack([x + 0.35 * np.sin(swing), y, up], axis=1)
    irons = [
        Magnet((*random.uniform(-2, 2, 2), -1.3), tuple(random.normal(0, 60, 3)))
        for _ in range(6)
    ]
    room_ut = uneven(place_m, irons)
    return feeling(quat, random, field_ut=room_ut, place_m=place_m, scale=0.005)


# Power-on, temperature and sensors that have died.


def turned_slowly(rate_deg_s: float, seed: int) -> Scene:
    """A turntable or a ship: turns about the vertical from power-on for 30 s, lies for
    20 s, then in a hand for 30 s.
    """
    random = np.random.default_rng([7, seed])
    t = times(80)
    way = begun(t, 50)
    yaw, pitch, roll = (
        degrees * DEGREE * way * wandering(t, random, 0.3) for degrees in (60, 35, 35)
    )
    turn = rate_deg_s * DEGREE * np.minimum(t, 30)
    return feeling(attitudes(turn + yaw, pitch, roll), random)


def lying(tilt_deg: float, seconds: float = 60) -> Scene:
    """At rest, leaning."""
    random = np.random.default_rng(8)
    none = np.zeros(round(seconds * RATE_HZ))
    return feeling(attitudes(none, none, none + tilt_deg * DEGREE), random)


def in_hand(seed: int) -> Scene:
    """Nothing special."""
    random = np.random.default_rng([9, seed])
    return feeling(hand(random, 88), random)


def laid_down(seed: int) -> Scene:
    """20 s in a hand, then at rest; a gyroscope that warms up by up to 0.1 deg/s."""
    random = np.random.default_rng([10, seed])
    t = times(180)
    way = begun(t, 8) * (1 - begun(t, 25))
    yaw, pitch, roll = (
        degrees * DEGREE * way * wandering(t, random, 0.25) for degrees in (60, 35, 35)
    )
    quat = attitudes(yaw + random.uniform(-3, 3), 0.3 + pitch, roll)
    felt = feeling(quat, random)
    drift = random.uniform(-0.1, 0.1, 3) * DEGREE
    felt.gyr += -np.expm1(-t / 60)[:, None] * drift
    return felt
