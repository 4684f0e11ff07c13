# SPDX-License-Identifier: MIT
"""A short recording whose attitudes are known exactly."""

from __future__ import annotations

import numpy as np

from imud import rotation
from imud.gravity import GRAVITY_M_S2
from imud.refine.model import Recording
from imud.rotation import FloatArray

RATE_HZ = 50.0
FIELD = np.array([0.0, 20.0, -43.0])
GRAVITY = np.array([0.0, 0.0, GRAVITY_M_S2])


def made(
    seconds: float = 30.0,
    *,
    bias: FloatArray | None = None,
    own: FloatArray | None = None,
    seed: int = 1,
) -> tuple[Recording, FloatArray]:
    """It turns about all axes between two rests, and the attitudes at the ends of its
    samples. `bias`: of the gyroscope, rad/s; `own`: a magnet on the sensor, uT.
    """
    random = np.random.default_rng(seed)
    count = round(seconds * RATE_HZ)
    at_s = (np.arange(count) + 0.5) / RATE_HZ
    is_moving = (at_s > 4.0) & (at_s < seconds - 4.0)
    phases = np.stack([1.1 * at_s, 0.7 * at_s + 1.0, 0.5 * at_s + 2.0], axis=1)
    rates = np.where(is_moving[:, None], 1.5 * np.sin(2.0 * phases), 0.0)
    steps = rotation.from_rotation_vector(rates / RATE_HZ)
    halves = rotation.from_rotation_vector(0.5 * rates / RATE_HZ)
    ends, middles = np.empty_like(steps), np.empty_like(steps)
    attitude = rotation.IDENTITY
    for index in range(count):
        middles[index] = rotation.multiply(attitude, halves[index])
        ends[index] = attitude = rotation.multiply(attitude, steps[index])

    def seen(vector: FloatArray, quats: FloatArray, noise: float) -> FloatArray:
        body = rotation.rotate(rotation.inverse(quats), np.tile(vector, (count, 1)))
        return np.asarray(body + noise * random.standard_normal((count, 3)))

    gyr = rates + 0.001 * random.standard_normal((count, 3))
    mag = seen(FIELD, ends, 0.3) + (0.0 if own is None else own)
    mag[::2] = np.nan
    return (
        Recording(
            RATE_HZ,
            gyr if bias is None else gyr + bias,
            seen(GRAVITY, middles, 0.02),
            mag,
        ),
        ends,
    )


def off_deg(quats: FloatArray, truth: FloatArray) -> FloatArray:
    """Angles between attitudes."""
    turns = rotation.multiply(quats, rotation.inverse(truth[: len(quats)]))
    return np.degrees(np.linalg.norm(rotation.to_rotation_vector(turns), axis=1))
