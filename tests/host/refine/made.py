# SPDX-License-Identifier: MIT
"""A short recording whose attitudes are known exactly."""

from __future__ import annotations

import math

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.refine.model import BoolArray, Recording
from imud.rotation import FloatArray

RATE_HZ = 50.0
FIELD = np.array([0.0, 20.0, -43.0])
GRAVITY = np.array([0.0, 0.0, GRAVITY_M_S2])


def made(
    seconds: float = 30.0,
    *,
    bias: FloatArray | None = None,
    own: FloatArray | None = None,
    walk_m: float = 0.0,
    still_s: tuple[float, float] = (0.0, 0.0),
    seed: int = 1,
) -> tuple[Recording, FloatArray]:
    """It turns about all axes between two rests, and the attitudes at the ends of its
    samples. `bias`: of the gyroscope, rad/s; `own`: a magnet on the sensor, uT;
    `walk_m`: to the north, by who carries it; `still_s`: a rest on the way.
    """
    random = np.random.default_rng(seed)
    count = round(seconds * RATE_HZ)
    at_s = (np.arange(count) + 0.5) / RATE_HZ
    is_moving = (at_s > 4.0) & (at_s < seconds - 4.0)
    is_moving &= (at_s < still_s[0]) | (at_s > still_s[1])
    phases = np.stack([1.1 * at_s, 0.7 * at_s + 1.0, 0.5 * at_s + 2.0], axis=1)
    rates = np.where(is_moving[:, None], 1.5 * np.sin(2.0 * phases), 0.0)
    steps = rotation.from_rotation_vector(rates / RATE_HZ)
    halves = rotation.from_rotation_vector(0.5 * rates / RATE_HZ)
    ends, middles = np.empty_like(steps), np.empty_like(steps)
    attitude = rotation.IDENTITY
    for index in range(count):
        middles[index] = rotation.multiply(attitude, halves[index])
        ends[index] = attitude = rotation.multiply(attitude, steps[index])

    def seen(vectors: FloatArray, quats: FloatArray, noise: float) -> FloatArray:
        vectors = np.broadcast_to(vectors, (count, 3))
        body = rotation.rotate(rotation.inverse(quats), vectors)
        return np.asarray(body + noise * random.standard_normal((count, 3)))

    gyr = rates + 0.001 * random.standard_normal((count, 3))
    mag = seen(FIELD, ends, 0.3) + (0.0 if own is None else own)
    mag[::2] = np.nan
    return (
        Recording(
            RATE_HZ,
            gyr if bias is None else gyr + bias,
            seen(GRAVITY + _walk(at_s, is_moving, walk_m), middles, 0.02),
            mag,
        ),
        ends,
    )


def _walk(at_s: FloatArray, is_moving: BoolArray, walk_m: float) -> FloatArray:
    """Accelerations: off within 2 s, steps up and down, and a stop within 2 s."""
    found = np.zeros((len(at_s), 3))
    if walk_m:
        begin, end = at_s[is_moving][[0, -1]]
        speed = walk_m / (end - begin - 2.0)
        found[:, 1] += np.where(
            (at_s >= begin) & (at_s < begin + 2.0), speed / 2.0, 0.0
        )
        found[:, 1] -= np.where((at_s > end - 2.0) & (at_s <= end), speed / 2.0, 0.0)
        found[:, 2] = np.where(is_moving, 3.0 * np.sin(4.0 * math.pi * at_s), 0.0)
    return found


def off_deg(quats: FloatArray, truth: FloatArray) -> FloatArray:
    """Angles between attitudes."""
    turns = rotation.multiply(quats, rotation.inverse(truth[: len(quats)]))
    return np.degrees(np.linalg.norm(rotation.to_rotation_vector(turns), axis=1))
