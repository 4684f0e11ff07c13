# SPDX-License-Identifier: MIT
"""A probe waved about without a stop, all of it perfect but for what is asked for."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from imud import rotation
from imud.calibration.recording import Sample
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray
from imud.virtual.calibrating import SCALE
from imud.virtual.motions.module import MG

OWN_UT = np.array([15.0, -20.0, 10.0])  # of the module
PLACE_UT = np.array([0.0, 20.0, -43.0])  # east, north, up
FREQUENCIES_HZ = (0.11, 0.23, 0.37, 0.61)
RATE_RAD_S = 1.2  # rms of an axis at each of them
BIAS_WAY = np.array([0.6, -0.5, 0.62])


@dataclass(frozen=True, slots=True)
class Troubles:
    """What is wrong with the sensors, and the rest before the wave."""

    rest_s: float = 0.0
    gyr_bias_dps: float = 0.0
    mag_noise_ut: float = 0.5
    acc_bias_mg: float = 0.0  # of y


@cache
def waved(troubles: Troubles, seed: int, seconds: float = 40.0) -> tuple[Sample, ...]:
    """The raw samples."""
    random = np.random.default_rng([11, seed])
    hz = SCALE.rate_hz
    t = np.arange(round(seconds * hz)) / hz
    rate = np.zeros((len(t), 3))
    for frequency in FREQUENCIES_HZ:
        phase = random.uniform(0.0, 2.0 * np.pi, 3)
        swing = np.sin(2.0 * np.pi * frequency * t[:, None] + phase)
        rate += RATE_RAD_S * random.normal(size=3) * swing
    if troubles.rest_s:
        rate *= np.clip((t - troubles.rest_s) / 0.5, 0.0, 1.0)[:, None]
    into_body = rotation.inverse(attitudes(rate / hz))
    count = (len(t), 3)
    up = np.array([0.0, 0.0, GRAVITY_M_S2])
    acc = rotation.rotate(into_body, up) + random.normal(0.0, 0.05, count)
    acc[:, 1] += troubles.acc_bias_mg * MG
    gyr = rate + math.radians(troubles.gyr_bias_dps) * BIAS_WAY
    gyr += random.normal(0.0, 0.002, count)
    mag = rotation.rotate(into_body, PLACE_UT) + OWN_UT
    mag += random.normal(0.0, troubles.mag_noise_ut, count)
    rows = np.hstack([acc / SCALE.acc_m_s2, gyr / SCALE.gyr_rad_s, mag / SCALE.mag_ut])
    return tuple(
        Sample(round(n * 1e6 / hz) + 1000, (ax, ay, az), (gx, gy, gz), (mx, my, mz))
        for n, (ax, ay, az, gx, gy, gz, mx, my, mz) in enumerate(
            np.rint(rows).astype(int).tolist()
        )
    )


def attitudes(turns: FloatArray) -> FloatArray:
    """Before each of these turns of the body, one after the other."""
    steps = rotation.from_rotation_vector(turns[:-1])
    return np.array(
        list(itertools.accumulate(steps, rotation.multiply, initial=rotation.IDENTITY))
    )
