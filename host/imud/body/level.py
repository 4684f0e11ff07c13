# SPDX-License-Identifier: MIT
"""Attitudes from rates and forces alone, at 40 Hz or more: for recordings of sensors
without poses. The heading starts anywhere and drifts.

The forces are low-passed in an almost inertial frame, where gravity stays and motion
averages out (D. Laidig, T. Seel, VQF, Information Fusion 91:187, 2023).
"""

from __future__ import annotations

import math

import numpy as np

from imud import rotation
from imud.body.tracks import Track
from imud.rotation import FloatArray

SETTLING_S = 6.0  # time constant of the low-pass: walking averages out
RATE_MIN_HZ = 40.0
STILL_RAD_S = math.radians(3.0)  # spread of rates at rest
STILL_M_S2 = 0.4
STILL_S = 1.0
TILT_SIGMA = math.radians(1.0)
UP = np.array([0.0, 0.0, 1.0])


def attitudes(gyr: FloatArray, acc: FloatArray, rate_hz: float) -> Track:
    """A track of samples at a constant rate: gyr rad/s, acc m/s2, both (n, 3).

    Rests of a second give the gyroscope's bias, which each keeps until the next one.
    ValueError below RATE_MIN_HZ: between samples a limb turns too far.
    """
    if rate_hz < RATE_MIN_HZ * 0.99:
        raise ValueError(
            f"{rate_hz:g} samples a second are too few; {RATE_MIN_HZ:g} are needed"
        )
    rates = gyr - biases(gyr, acc, rate_hz)
    turned = strapdown(rates, rate_hz)
    forces = lowpass(rotation.rotate(turned, acc), rate_hz)
    level = _turn_to_up(forces)
    times_s = np.arange(len(gyr)) / rate_hz
    return Track(
        times_s,
        rotation.multiply(level, turned),
        rates,
        np.full(len(gyr), TILT_SIGMA),
        np.full(len(gyr), np.nan),
        acc,
    )


def strapdown(rates: FloatArray, rate_hz: float) -> FloatArray:
    """The turns since the first sample: (n, 4), by the mean rate of each step."""
    means = (rates[1:] + rates[:-1]) / 2.0
    found = np.concatenate(
        [rotation.IDENTITY[None], rotation.from_rotation_vector(means / rate_hz)]
    )
    # Cumulative products, by doubling: log2(n) products of arrays.
    reach = 1
    while reach < len(found):
        found[reach:] = rotation.multiply(found[:-reach], found[reach:])
        reach *= 2
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


def lowpass(values: FloatArray, rate_hz: float) -> FloatArray:
    """A first-order low-pass that begins as a plain mean, rows over time."""
    found = np.empty_like(values)
    state = np.zeros(values.shape[1])
    share = 1.0 / (SETTLING_S * rate_hz)
    for index, row in enumerate(values):
        state = state + (row - state) * max(share, 1.0 / (index + 1))
        found[index] = state
    return found


def _turn_to_up(forces: FloatArray) -> FloatArray:
    """The shortest turns that bring directions up: (n, 4)."""
    up = forces / np.linalg.norm(forces, axis=1, keepdims=True)
    cross = np.cross(up, UP)
    quat = np.concatenate([1.0 + up[:, 2:], cross], axis=1)
    # Downwards any horizontal axis does.
    quat[up[:, 2] < -1.0 + 1e-9] = (0.0, 1.0, 0.0, 0.0)
    return np.asarray(quat / np.linalg.norm(quat, axis=1, keepdims=True))


def biases(gyr: FloatArray, acc: FloatArray, rate_hz: float) -> FloatArray:
    """The gyroscope's bias at each sample, by the rests; zero without any."""
    size = max(2, round(STILL_S * rate_hz))
    count = len(gyr) // size
    found = np.zeros_like(gyr)
    bias = None
    for index in range(count):
        rows = slice(index * size, (index + 1) * size)
        is_still = (
            gyr[rows].std(axis=0).max() < STILL_RAD_S
            and acc[rows].std(axis=0).max() < STILL_M_S2
            and np.abs(gyr[rows].mean(axis=0)).max() < math.radians(8.0)
        )
        if is_still:
            mean = gyr[rows].mean(axis=0)
            if bias is None:
                found[: rows.start] = mean
                bias = mean
            bias = bias + 0.5 * (mean - bias)
        if bias is not None:
            found[rows.start :] = bias
    return found
