# SPDX-License-Identifier: MIT
"""Hands that do what `imud check --turn 30` asks for: they lay the probe, turn it by 30
degrees, on the dividing plate or onto the wedge, and lay it again, over and over.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from imud import rotation
from imud.calibration.path import UP
from imud.rotation import FloatArray
from imud.virtual.calibrating import PROBE, felt_of
from imud.virtual.hand import HandMove, Stance
from imud.virtual.motion import Motion
from imud.virtual.motions.module import Module

TURN_DEG = 30.0
LAID_DEG = 0.2  # rms of an axis by which it misses the stops
SLOPE_DEG = 0.5  # of the table, rms of an axis

# The axis of each turn in the world, while the probe lies base down, heading north.
AXES = {"turn": UP, "wedge": np.array([0.0, 1.0, 0.0])}

# time to start imud; and the rest at each end.
FIRST_S, EACH_S, MOVE_S = 10.0, 8.0, 2.0


class TurningHand:
    """Turns it there and back about a fixed axis of the world. The probe is moved by
    some centimetres, as a hand does.
    """

    def __init__(
        self,
        random: np.random.Generator,
        rate_hz: float,
        axis: FloatArray,
        turn_deg: float = TURN_DEG,
        first_s: float = FIRST_S,
    ) -> None:
        self._random = random
        self._rate_hz = rate_hz
        self._turns = (0.0, turn_deg)
        self._first_s = first_s
        heading = rotation.from_rotation_vector(UP * random.uniform(-math.pi, math.pi))
        slope = np.append(random.normal(0.0, math.radians(SLOPE_DEG), 2), 0.0)
        table = rotation.from_rotation_vector(slope)
        self._base = rotation.multiply(table, heading)
        self._axis = rotation.rotate(self._base, axis)

    def moves(self) -> Iterator[HandMove]:
        """A rest at each end, and the way to the other."""
        before, rest_s = self._stance(self._turns[0]), self._first_s
        while True:
            for turn_deg in (*self._turns[1:], self._turns[0]):
                yield HandMove(before, before, self._records(rest_s), is_rest=True)
                stance = self._stance(turn_deg)
                bend = UP * 0.05 + self._random.normal(0.0, 0.03, 3)
                swerve = self._random.normal(0.0, 0.2, 3)
                records = self._records(MOVE_S)
                yield HandMove(before, stance, records, bend=bend, swerve=swerve)
                before, rest_s = stance, EACH_S

    def _stance(self, turn_deg: float) -> Stance:
        missed = self._random.normal(0.0, math.radians(LAID_DEG), 3)
        turn = rotation.multiply(
            rotation.from_rotation_vector(missed),
            rotation.from_rotation_vector(self._axis * math.radians(turn_deg)),
        )
        tip = self._random.normal(0.0, 0.01, 3)
        return Stance(tip, rotation.multiply(turn, self._base), held=0.0, free=0.0)

    def _records(self, seconds: float) -> int:
        return round(seconds * self._rate_hz)


def pieces(name: str, module: Module, seed: int, rate_hz: float) -> Iterator[Motion]:
    """The endless motion of the hand of that name as a module measures it."""
    return felt_of(
        *(module, seed, rate_hz, PROBE),
        lambda random, hz: TurningHand(random, hz, AXES[name]),
    )
