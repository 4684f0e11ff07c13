# SPDX-License-Identifier: MIT
"""Orientation filters to compare: each a function from samples to quaternions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from vqf import VQF

from imud.rotation import FloatArray


@dataclass(frozen=True, slots=True)
class Samples:
    """What a filter gets: equally spaced samples, in SI units."""

    rate_hz: float
    gyr: FloatArray  # rad/s
    acc: FloatArray  # m/s2
    mag: FloatArray  # uT; NaN where the magnetometer had nothing new

    def __len__(self) -> int:
        return len(self.gyr)


# Returns world_from_body after each sample, world east-north-up.
Engine = Callable[[Samples], FloatArray]


def vqf_defaults(samples: Samples) -> FloatArray:
    """VQF from PyPI with the parameters it comes with."""
    step_s = 1.0 / samples.rate_hz
    has_mag = np.asarray(np.isfinite(samples.mag).all(axis=1))
    # What the magnetometer gives less often than the rest is as far apart.
    every = max(1, round(len(samples) / max(1, int(has_mag.sum()))))
    vqf = VQF(step_s, step_s, every * step_s)
    out = np.empty((len(samples), 4))
    gyr, acc, mag = (
        np.ascontiguousarray(values, dtype=np.float64)
        for values in (samples.gyr, samples.acc, samples.mag)
    )
    for index in range(len(samples)):
        vqf.updateGyr(gyr[index])
        vqf.updateAcc(acc[index])
        if has_mag[index]:
            vqf.updateMag(mag[index])
        out[index] = vqf.getQuat9D()
    return out


ENGINES: dict[str, Engine] = {"vqf": vqf_defaults}
