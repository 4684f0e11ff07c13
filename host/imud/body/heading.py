# SPDX-License-Identifier: MIT
"""Brings the headings of probes into step by the joints between them.

The axis of a joint points the same way in both segments. A scalar Kalman filter for
each joint follows the difference of both headings: D. Laidig et al., IFAC-PapersOnLine
50(1), 2017 (hinges); J. Sensors 2019, Sensors 19(4) (joints with play).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.body.chain import Joint
from imud.rotation import FloatArray

WALK = math.radians(0.7)  # rad for a root of a second: drift between two headings
MAGNETIC_S = 30.0  # headings of a magnetometer are wrong in the same way for so long
PLAY_S = 0.7  # turns about a joint's other axes last so long
LEVEL_MIN = 0.05  # of the product of both axes' squares across up
UNKNOWN = math.radians(100.0)


@dataclass(slots=True)
class Step:
    """The filter of one joint. `turn`: by which the child's heading is turned, rad."""

    joint: Joint
    turn: float = 0.0
    variance: float = UNKNOWN**2
    last_s: float | None = None

    @property
    def sigma(self) -> float:
        return math.sqrt(self.variance)

    def take(
        self, time_s: float, right: FloatArray, sigmas: tuple[float, float]
    ) -> None:
        """A moment: z of parent and child in their worlds, shape (2, 3), and the stated
        sigmas of both headings, rad, NaN without reference.
        """
        own = math.hypot(*sigmas)
        if self.last_s is None:
            self.variance = min(own, UNKNOWN) ** 2 if own == own else UNKNOWN**2
            passed = 0.0
        else:
            passed = max(0.0, time_s - self.last_s)
        self.last_s = time_s
        self.variance = min(self.variance + WALK**2 * passed, math.pi**2)
        if own == own and passed > 0.0:
            self._update(0.0, own**2 * MAGNETIC_S / passed)
        (x1, y1, _), (x2, y2, _) = right.tolist()
        level = (x1 * x1 + y1 * y1) * (x2 * x2 + y2 * y2)
        if level < LEVEL_MIN:
            return  # an upright axis shows no heading
        seen = math.atan2(x2 * y1 - y2 * x1, x1 * x2 + y1 * y2)
        play = math.radians(self.joint.play_deg) ** 2 / level
        # The first moment, in which the person stands, counts like PLAY_S.
        self._update(seen, play * max(1.0, PLAY_S / passed) if passed > 0.0 else play)

    def _update(self, seen: float, variance: float) -> None:
        gain = self.variance / (self.variance + variance)
        off = (seen - self.turn + math.pi) % (2.0 * math.pi) - math.pi
        self.turn += gain * off
        self.variance *= 1.0 - gain


def in_step(
    joint: Joint,
    times_s: FloatArray,
    parent: FloatArray,
    child: FloatArray,
    sigmas: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The turns of the child's heading over time and their sigmas, rad; NaN where
    either is missing. `parent`, `child`: world_from_segment; `sigmas`: (n, 2).
    """
    z = np.array([0.0, 0.0, 1.0])
    rights = np.stack([rotation.rotate(each, z) for each in (parent, child)], axis=1)
    step = Step(joint)
    found = np.full((2, len(times_s)), np.nan)
    for index in np.flatnonzero(np.isfinite(rights).all(axis=(1, 2))).tolist():
        first, second = sigmas[index].tolist()
        step.take(float(times_s[index]), rights[index], (first, second))
        found[:, index] = step.turn, step.sigma
    return found[0], found[1]


def about_up(angle_rad: FloatArray) -> FloatArray:
    """Quaternions that turn headings."""
    return rotation.from_rotation_vector(
        np.stack([np.zeros_like(angle_rad), np.zeros_like(angle_rad), angle_rad], -1)
    )
