# SPDX-License-Identifier: MIT
"""Half of smallest and largest reading, on the fly: NECTEC's project of 2018, algorithm
1, and the quality bar of its section 7.1.5.

Its printed loop runs from 1 to 2 and so leaves out one of three axes.
"""

from __future__ import annotations

import math

import numpy as np

from imud.calibration.affine import Affine, MethodError
from imud.rotation import FloatArray

SMOOTHING = 50  # readings of the bar's moving average


class Extremes:
    """The calibration so far; it never forgets, so one magnet spoils it."""

    def __init__(self, *, as_printed: bool = False) -> None:
        self._axes = (0, 1) if as_printed else (0, 1, 2)
        self.reset()

    def reset(self) -> None:
        """Restarts: its button "Reset calibration"."""
        self.low = np.full(3, math.inf)
        self.high = np.full(3, -math.inf)
        self._shares: list[float] = []

    def add_reading(self, reading: FloatArray) -> None:
        """The next reading of the magnetometer, shape (3,), uT."""
        self.stretch(reading)
        found = self.found()
        if found is not None:
            share = 1.0 - abs(1.0 - float(np.linalg.norm(found.apply(reading))))
            self._shares = [*self._shares[1 - SMOOTHING :], share]

    def stretch(self, reading: FloatArray) -> None:
        """Takes a reading without its share of the bar."""
        for axis in self._axes:
            if reading[axis] > self.high[axis]:
                self.high[axis] = reading[axis]
            elif reading[axis] < self.low[axis]:
                self.low[axis] = reading[axis]

    @property
    def quality_percent(self) -> float | None:
        """Its bar: how near the calibrated norm is to the expected one, averaged over
        the last readings. It does not cover attitudes that were never shown. None: too
        early.
        """
        return 100.0 * float(np.mean(self._shares)) if self._shares else None

    def found(self) -> Affine | None:
        """The calibration to a norm of 1; None before every axis has moved. An axis
        that is left out keeps its readings, at the scale of the others.
        """
        span = (self.high - self.low) / 2.0
        used = list(self._axes)
        if not np.isfinite(span[used]).all() or (span[used] <= 0.0).any():
            return None
        bias = np.zeros(3)
        bias[used] = (self.high[used] + self.low[used]) / 2.0
        scale = np.full(3, 1.0 / span[used].mean())
        scale[used] = 1.0 / span[used]
        return Affine(np.diag(scale), bias)


def fit(readings: FloatArray, *, as_printed: bool = False) -> Affine:
    """The calibration after these readings (n, 3), with the determinant 1. MethodError
    if an axis never moved.
    """
    extremes = Extremes(as_printed=as_printed)
    for reading in readings:
        extremes.stretch(reading)
    found = extremes.found()
    if found is None:
        raise MethodError("the magnetometer's readings did not change: turn the probe")
    size = np.cbrt(np.linalg.det(found.matrix))
    return Affine(found.matrix / size, found.bias)
