# SPDX-License-Identifier: MIT
"""How a probe was wobbled: how far, how fast, and in which directions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration.algebra import across, integrated, units
from imud.rotation import FloatArray

SECTORS = 8  # of the directions in which it can lean
STEP_S = 0.02  # fine enough to see how it swings
HELD_S = 1.0  # at the beginning; where it leans then is the middle


@dataclass(frozen=True, slots=True)
class Swing:
    """A wobble. `leans_deg`: the farthest lean in each of SECTORS directions."""

    degrees: float  # rms lean, times the square root of 2: the swing of a sine
    hz: float
    roundness: float  # of the leans: 0 in one plane, 1 in all directions alike
    leans_deg: tuple[float, ...]


def swing_of(force: FloatArray, rate: FloatArray, step_s: float) -> Swing:
    """The wobble of calibrated readings (n, 3), which begin at rest."""
    each = max(1, round(STEP_S / step_s))
    whole = len(rate) // each * each
    force, rate = (v[:whole].reshape(-1, each, 3).mean(axis=1) for v in (force, rate))
    step_s *= each
    attitude = integrated(rate, step_s)[:-1]
    held = max(1, round(HELD_S / step_s))
    up = units(force[:held].mean(axis=0))
    lean = attitude @ up
    first = across(up)
    plane = np.stack([first, np.cross(up, first)])
    aside = lean @ plane.T
    angle = np.degrees(np.arctan2(np.linalg.norm(aside, axis=1), lean @ up))
    # The middle of the wobble need not be where it was held.
    centred = aside - aside.mean(axis=0)
    spread = np.linalg.eigvalsh(centred.T @ centred / len(centred))
    rms = math.sqrt(max(float(spread.sum()) / (1.0 + _share(spread)), 1e-12))
    speed = np.diff(centred, axis=0) / step_s
    pace = math.sqrt(float(np.mean(speed**2)) / max(float(np.mean(centred**2)), 1e-12))
    sector = np.floor(np.arctan2(aside[:, 1], aside[:, 0]) / (2.0 * np.pi) * SECTORS)
    leans = [
        float(angle[sector % SECTORS == k].max(initial=0.0)) for k in range(SECTORS)
    ]
    degrees = math.degrees(math.asin(min(1.0, math.sqrt(2.0) * rms)))
    roundness = math.sqrt(_share(spread))
    return Swing(degrees, pace / (2.0 * math.pi), roundness, tuple(leans))


def _share(spread: FloatArray) -> float:
    """Of the smaller of two variances in the larger one."""
    return float(max(spread[0], 0.0) / max(float(spread[1]), 1e-12))
