# SPDX-License-Identifier: MIT
"""White noise of a sensor, from rests of the probe: by the Allan deviation of means
over 0.1 s, which are within the bandwidth of every driver and faster than drift.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from imud.params.value import ROOM, Params
from imud.rotation import FloatArray

MEAN_S = 0.1
LEAST = 20  # differences
FAR = 4.5  # medians of the magnitude: three sigma
KEYS = {"acc": "acc_m_s2_rthz", "gyr": "gyr_rad_s_rthz"}
MOST = {"acc": 0.065, "gyr": 0.0065}  # on the wire


def density(rests: Iterable[FloatArray], step_s: float) -> float | None:
    """Of an axis, rms of the three, in the root of a Hz, from readings (n, 3) of each
    rest; None: they are too short.
    """
    size = max(1, round(MEAN_S / step_s))
    steps = []
    for rest in rests:
        means = rest[: len(rest) // size * size].reshape(-1, size, 3).mean(axis=1)
        steps.append(np.diff(means, axis=0))
    found = np.concatenate([np.zeros((0, 3)), *steps])
    if len(found) < LEAST:
        return None
    # Knocks do not count.
    usual = np.abs(found) <= FAR * np.median(np.abs(found), axis=0)
    squares = np.sum(found**2, axis=0, where=usual) / np.sum(usual, axis=0)
    return math.sqrt(float(np.mean(squares)) * size * step_s)


def with_noise(params: Params, found: dict[str, float | None]) -> Params:
    """The params with the densities of these sensors, as far as they are known and
    there is room.
    """
    values = dict(params.plain("noise") or {})
    for name, value in found.items():
        if value is not None:
            values[KEYS[name]] = min(value, MOST[name])
    told = params.replaced("noise", values) if values else params
    return told if len(told.encode()) <= ROOM else params
