# SPDX-License-Identifier: MIT
"""Whether a foot is calm enough to stand: the energy that its probe measures, besides
gravity, is small against that of its gait (the statistic is SHOE: I. Skog et al., IEEE
Trans. Biomed. Eng. 57(11):2657, 2010). A foot that runs turns faster while it stands
than one that strolls does in the air.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from imud.body.tracks import BoolArray
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

# A turn by 1 rad/s counts as a force of so many m/s2 beside gravity.
TURN_M_S2 = 5.0
WINDOW_S = 0.025
# Energies, (m/s2)^2: a foot below CALM stands, whatever its gait, as does one below
# this share of the mean over GAIT_S.
CALM = 4.0
SHARE = 0.05
GAIT_S = 1.5
RATE_RANGE_RAD_S, FORCE_RANGE_M_S2 = math.radians(240.0), 19.0  # the least there is


class StanceDetector:
    """The energy of a foot, sample by sample, and the threshold for its gait."""

    def __init__(self) -> None:
        self._window: deque[tuple[float, FloatArray, float, float]] = deque()
        self._gait = 0.0  # mean energy
        self.energy = math.inf  # over the last WINDOW_S
        self.is_calm = False

    def update(self, step_s: float, gyr: FloatArray, acc: FloatArray) -> None:
        """`step_s`: since the last sample."""
        self._window.append((step_s, acc, float(acc @ acc), float(gyr @ gyr)))
        passed_s = sum(each[0] for each in self._window)
        while passed_s > WINDOW_S * 1.05 and len(self._window) > 2:
            passed_s -= self._window.popleft()[0]
        _, forces, squares, turns = zip(*self._window, strict=True)
        # The mean square of forces less gravity along their mean.
        up = math.hypot(*np.mean(forces, axis=0).tolist())
        count = len(self._window)
        off = sum(squares) / count + GRAVITY_M_S2 * (GRAVITY_M_S2 - 2.0 * up)
        self.energy = off + TURN_M_S2**2 * sum(turns) / count
        self._gait += (self.energy - self._gait) * min(1.0, step_s / GAIT_S)
        self.is_calm = self.energy < max(CALM, SHARE * self._gait)


def clipped(values: FloatArray, least: float) -> BoolArray:
    """Rows of (n, 3) with an axis at the end of its range, which is the largest value
    if that comes again and again; no sensor's range ends below `least`.
    """
    size = np.abs(values)
    most = np.nanmax(size, axis=0)
    at_end = np.asarray(size >= most * (1.0 - 1e-4))
    is_range = (most > least) & (at_end.sum(axis=0) > 2)
    return np.asarray((at_end & is_range).any(axis=1))
