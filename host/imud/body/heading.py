# SPDX-License-Identifier: MIT
"""Brings the headings of probes into step by the joints between them.

A Sight is a joint's measurement at each moment: the angle by which the child's heading
must be turned. A scalar Kalman filter for each joint follows it. Axes of hinges: D.
Laidig et al., IFAC-PapersOnLine 50(1), 2017; Sensors 19(4), 2019. Forces at a joint's
centre: I. Weygers, M. Kok et al., IEEE Sensors J. 20(14):7969, 2020.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from imud import rotation
from imud.body.tracks import AWAY_S
from imud.rotation import FloatArray

BoolArray = npt.NDArray[np.bool_]

WALK = math.radians(0.7)  # rad for a root of a second: drift between two headings
MAGNETIC_S = 30.0  # headings of a magnetometer are wrong in the same way for so long
PLAY_S = 0.7  # turns about a joint's other axes last so long
FORCE_S = 0.3  # and errors of forces so long
LEVEL_MIN = 0.05  # of the product of both axes' squares across up
SLOPE_MIN = 0.3  # of an angle between two axes by the heading
FORCE_MIN = 2.0  # in errors of the forces
UNLIKELY = 3.0  # sigmas
UNKNOWN = math.radians(100.0)


@dataclass(frozen=True, slots=True)
class Sight:
    """A measurement of the turn over time. `turns`: (n, k) rad, of which the one
    nearest to the estimate counts; `variance`: (n,) rad2, NaN where it shows nothing.
    Its errors last `lasts_s`.
    """

    turns: FloatArray
    variance: FloatArray
    lasts_s: float


def magnetic(sigmas: FloatArray, apart: float = 0.0) -> Sight:
    """The headings that both probes state, (n, 2) rad, NaN without reference; `apart`:
    the difference between north at both places, rad rms.
    """
    own = np.minimum(np.hypot(np.hypot(*sigmas.T), apart), UNKNOWN)
    return Sight(np.zeros((len(own), 1)), own**2, MAGNETIC_S)


def of_axis(parent: FloatArray, child: FloatArray, play: float) -> Sight:
    """One axis seen by both probes, (n, 3) each in its world; `play`: rad rms."""
    (x1, y1, _), (x2, y2, _) = parent.T, child.T
    level = (x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2)
    seen = np.arctan2(x2 * y1 - y2 * x1, x1 * x2 + y1 * y2)
    # An upright axis shows no heading.
    variance = np.where(level < LEVEL_MIN, np.nan, play**2 / np.maximum(level, 1e-9))
    return Sight(seen[:, None], variance, PLAY_S)


def of_angle(
    parent: FloatArray, child: FloatArray, cosine: float, play: float
) -> Sight:
    """Two axes, one of each probe, (n, 3) in its world, that keep their angle."""
    (x1, y1, z1), (x2, y2, z2) = parent.T, child.T
    size = np.hypot(x1, y1) * np.hypot(x2, y2)
    share = (cosine - z1 * z2) / np.maximum(size, 1e-9)
    between = np.arctan2(y1, x1) - np.arctan2(y2, x2)
    off = np.arccos(np.clip(share, -1.0, 1.0))
    slope = size * np.sin(off)
    variance = np.where(
        slope < SLOPE_MIN, np.nan, (play / np.maximum(slope, 1e-9)) ** 2
    )
    return Sight(np.stack([between + off, between - off], 1), variance, PLAY_S)


def of_forces(parent: FloatArray, child: FloatArray, noise: float) -> Sight:
    """The force at the joint, as both probes find it in their worlds, (n, 3), m/s2."""
    (x1, y1, _), (x2, y2, _) = parent.T, child.T
    square = (x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2)
    seen = np.arctan2(x2 * y1 - y2 * x1, x1 * x2 + y1 * y2)
    size = np.sqrt(square)
    is_weak = size < (FORCE_MIN * noise) ** 2
    variance = np.where(is_weak, np.nan, 2.0 * noise**2 / np.maximum(size, 1e-9))
    return Sight(seen[:, None], variance, FORCE_S)


@dataclass(slots=True)
class HeadingFilter:
    """The filter of one joint. `turn`: by which the child's heading is turned, rad."""

    turn: float = 0.0
    variance: float = UNKNOWN**2
    last_s: float | None = None
    walk: float = WALK

    @property
    def sigma(self) -> float:
        return math.sqrt(self.variance)

    def update(
        self, time_s: float, seen: Sequence[tuple[Sequence[float], float, float]]
    ) -> None:
        """A moment: of each sight its turns, variance, and how long its errors last. It
        restarts if either probe was away.
        """
        if self.last_s is not None and time_s - self.last_s > AWAY_S:
            self.variance, self.last_s = UNKNOWN**2, None
        is_first = self.last_s is None
        passed = 0.0 if self.last_s is None else max(0.0, time_s - self.last_s)
        self.last_s = time_s
        self.variance = min(self.variance + self.walk**2 * passed, math.pi**2)
        for turns, variance, lasts_s in seen:
            if variance != variance or (passed == 0.0 and not is_first):
                continue
            off, *others = sorted(map(self._off, turns), key=abs)
            if others and abs(others[0]) < UNLIKELY * self.sigma:
                continue  # either could be meant
            # The first moment, in which the body rests, counts for as long.
            share = 1.0 if is_first else max(1.0, lasts_s / passed)
            gain = self.variance / (self.variance + variance * share)
            self.turn += gain * off
            self.variance *= 1.0 - gain

    def _off(self, turn: float) -> float:
        return (turn - self.turn + math.pi) % (2.0 * math.pi) - math.pi


def follow(
    step: HeadingFilter,
    times_s: FloatArray,
    is_there: BoolArray,
    sights: Sequence[Sight],
) -> tuple[FloatArray, FloatArray]:
    """The turns over time and their sigmas, rad, from the filter's current state on;
    NaN where a probe is missing.
    """
    found = np.full((2, len(times_s)), np.nan)
    rows = np.flatnonzero(is_there).tolist()
    seen = [(s.turns.tolist(), s.variance.tolist(), s.lasts_s) for s in sights]
    for index, time_s in zip(rows, times_s[rows].tolist(), strict=True):
        step.update(time_s, [(a[index], b[index], lasts) for a, b, lasts in seen])
        found[:, index] = step.turn, step.sigma
    return found[0], found[1]


def smoothed(
    times_s: FloatArray, turns: FloatArray, sigmas: FloatArray, walk: float = WALK
) -> tuple[FloatArray, FloatArray]:
    """The same, also from later measurements: H. Rauch et al., AIAA J. 3:1445, 1965.
    Those after a probe was away say nothing of the time before.
    """
    turns, variances = turns.copy(), sigmas**2
    rows = np.flatnonzero(np.isfinite(turns)).tolist()
    for later, row in zip(rows[:0:-1], rows[-2::-1], strict=True):
        if times_s[later] - times_s[row] > AWAY_S:
            continue
        grown = variances[row] + walk**2 * (times_s[later] - times_s[row])
        gain = variances[row] / grown
        turns[row] += gain * (turns[later] - turns[row])
        variances[row] += gain**2 * (variances[later] - grown)
    return turns, np.sqrt(variances)


def about_up(angle_rad: FloatArray | float) -> FloatArray:
    """Quaternions that turn headings."""
    turns = np.zeros((*np.shape(angle_rad), 3))
    turns[..., 2] = angle_rad
    return rotation.from_rotation_vector(turns)
