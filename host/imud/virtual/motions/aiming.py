# SPDX-License-Identifier: MIT
"""A calibrated probe after it was waved: it lies still, or a hand aims with it. What
its errors since a moment are measured on. Even seeds to tune, odd ones to judge.
"""

from __future__ import annotations

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.motion import Motion

RATE_HZ = 500.0
GRAVITY = np.array([0.0, 0.0, GRAVITY_M_S2])
FIELD_UT = np.array([0.0, 20.0, -43.0])  # of the Earth: east, north, up

# What an axis of the sensors adds: noise a record, and errors that stay (one sigma).
GYR_NOISE = np.radians(0.1)  # rad/s
ACC_NOISE, MAG_NOISE = 0.08, 0.6  # m/s2, uT
GYR_SCALE, MAG_OWN_UT = 0.002, 0.3
WARMING, WARMING_S = np.radians(0.1), 60.0  # rad/s at most in the end; time constant

WAVED_S = 8.0, 27.0  # from and to: a hand waves it, so that its own field is learned
SWINGS_DEG = np.array([60.0, 35.0, 35.0])  # rms about up, and two level axes
SWINGS_HZ = np.array([0.25, 0.3, 0.3])

AIMS_DEG = np.array([15.0, 12.0, 8.0])  # targets are at most so far from the middle
TREMOR_DEG, TREMOR_HZ = 0.05, 6.0
ARM_M = 0.3  # from the elbow to the sensor
ROOM_UT_M = 3.0  # the strongest slope of the field


def still(seed: int, seconds: float = 330.0) -> Motion:
    """It is waved for 19 s and lies still from then on, while its gyroscope warms."""
    random = np.random.default_rng([8, seed])
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    angles = _start(random) + _waved(t, random)
    return _felt(t, angles, np.zeros((len(t), 3)), np.zeros((3, 3)), random)


def aim(
    seed: int,
    seconds: float = 180.0,
    holds_s: tuple[float, float] = (1.0, 4.0),
    room_ut_m: float = ROOM_UT_M,
) -> Motion:
    """It is waved for 19 s; then it points at targets within 30 degrees of each other,
    holds each for 1 to 4 s with tremor and moves on within 0.5 to 1.5 s, on a forearm
    in a room whose field differs by about 1 uT.
    """
    random = np.random.default_rng([9, seed])
    t = np.arange(0.0, seconds, 1.0 / RATE_HZ)
    angles = _start(random) + _waved(t, random)
    now, begin_s = np.zeros(3), WAVED_S[1] + 1.0
    while begin_s < seconds - 2.0:
        goal = np.radians(AIMS_DEG) * random.uniform(-1.0, 1.0, 3)
        takes_s = random.uniform(0.5, 1.5)
        share = np.clip((t - begin_s) / takes_s, 0.0, 1.0)
        # The smoothest way there: no jerk at either end.
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        angles += np.outer(share, goal - now)
        now, begin_s = goal, begin_s + takes_s + random.uniform(*holds_s)
    tremor = [_slow(t, random, TREMOR_HZ) for _ in range(3)]
    angles += np.radians(TREMOR_DEG) * np.stack(tremor, axis=1)
    places = rotation.rotate(_attitudes(angles), np.array([ARM_M, 0.0, 0.0]))
    slope = random.normal(size=(3, 3))
    slope += slope.T
    slope -= np.eye(3) * np.trace(slope) / 3.0
    slope *= room_ut_m / np.abs(np.linalg.eigvalsh(slope)).max()
    return _felt(t, angles, places, slope, random)


MOTIONS = {"still": still, "aim": aim}


def _start(random: np.random.Generator) -> FloatArray:
    return np.array([random.uniform(-3.0, 3.0), random.uniform(-0.5, 0.5), 0.0])


def _waved(t: FloatArray, random: np.random.Generator) -> FloatArray:
    begin_s, end_s = WAVED_S
    amount = _ramp(t, begin_s) * (1.0 - _ramp(t, end_s - 2.0))
    swings = [_slow(t, random, hz) for hz in SWINGS_HZ]
    found = amount[:, None] * np.stack(swings, axis=1) * np.radians(SWINGS_DEG)
    return np.asarray(found)


def _ramp(t: FloatArray, begin_s: float) -> FloatArray:
    """From 0 to 1 within 2 s."""
    share = np.clip((t - begin_s) / 2.0, 0.0, 1.0)
    return np.asarray(share**2 * (3.0 - 2.0 * share))


def _slow(t: FloatArray, random: np.random.Generator, hz: float) -> FloatArray:
    """Four sines of about that frequency, together of rms 1."""
    rates, phases = random.uniform(0.5, 1.5, 4), random.uniform(0.0, 2.0 * np.pi, 4)
    waves = np.sin(2.0 * np.pi * hz * np.outer(rates, t) + phases[:, None])
    return np.asarray(waves.sum(axis=0) / np.sqrt(2.0))


def _attitudes(angles: FloatArray) -> FloatArray:
    """world_from_body of turns about z, then y, then x of the body; radians."""
    turns = [
        rotation.from_rotation_vector(np.outer(angle, axis))
        for angle, axis in zip(angles.T, np.eye(3)[::-1], strict=True)
    ]
    return rotation.multiply(rotation.multiply(turns[0], turns[1]), turns[2])


def _felt(
    t: FloatArray,
    angles: FloatArray,
    places: FloatArray,
    slope: FloatArray,
    random: np.random.Generator,
) -> Motion:
    """The sensors' readings; `slope` of the field is in uT/m."""
    quat = _attitudes(angles)
    step = rotation.multiply(rotation.inverse(quat[:-1]), quat[1:])
    rate = rotation.to_rotation_vector(step) * RATE_HZ
    rate = np.vstack([rate, rate[-1:]])
    moved = np.gradient(np.gradient(places, axis=0), axis=0) * RATE_HZ**2
    force = rotation.rotate(rotation.inverse(quat), moved + GRAVITY)
    field = FIELD_UT + (places - places[0]) @ slope
    warming = -np.expm1(-t / WARMING_S)
    drift = WARMING * random.uniform(-1.0, 1.0, 3)
    scale = 1.0 + random.normal(0.0, GYR_SCALE, 3)
    own = random.normal(0.0, MAG_OWN_UT, 3)
    shape = quat.shape[0], 3
    return Motion(
        rate_hz=RATE_HZ,
        gyr=rate * scale
        + np.outer(warming, drift)
        + random.normal(0, GYR_NOISE, shape),
        acc=force + random.normal(0.0, ACC_NOISE, shape),
        mag=rotation.rotate(rotation.inverse(quat), field)
        + own
        + random.normal(0.0, MAG_NOISE, shape),
        quat=quat,
        movement=t > WAVED_S[0],
    )
