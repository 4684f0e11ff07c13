# SPDX-License-Identifier: MIT
"""A hand that measures: it rests, strokes, rests, over and over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.hand import HandMove, Stance
from imud.virtual.motion import Motion
from imud.virtual.sensors import Sway

_TREMOR = 2.0 * math.pi * 10.0  # rad/s


def _swaying(turn_deg: float, turn_dps: float, tip_m: float, tip_m_s2: float) -> Sway:
    """A slow sway of these angles and lengths, and a tremor of these rates and forces,
    rms of an axis.
    """
    trembles = math.radians(turn_dps) / _TREMOR
    return Sway(
        turn=((0.2, 1.0, math.radians(turn_deg)), (8.0, 12.0, trembles)),
        tip=((0.2, 1.0, tip_m), (8.0, 12.0, tip_m_s2 / _TREMOR**2)),
        grain_m=0.0,
    )


# "supported": the probe lies or stands on something at both ends; "paper": in a hand,
# whose tip or heel of the palm rests on it. "hand" sways as the 157 real rests of hands
# in the recordings "ground": 0.41 cm/s and 1.17 deg/s an axis, together; "paper" and
# "air", of the study that the limits of benchmarks/strokes are from, turn three times
# as much for their speed.
SWAYS: dict[str, Sway] = {
    "supported": Sway(grain_m=0.0),
    "paper": _swaying(0.1, 0.3, 1e-4, 0.05),
    "air": _swaying(0.4, 1.0, 5e-4, 0.2),
    "hand": _swaying(0.31, 1.0, 1.05e-3, 0.2),
}

SETTLES_S = 7.0  # of rest at the start: calibration at rest, and level
PAUSE_S = 1.0  # between strokes
# A button is pressed 0.05 s before a stroke and released 0.05 s after it. The probe
# counts either when it was stable for 0.05 s: so long after the start and the end.
PRESSED_S = 0.0
RELEASED_S = 0.1


@dataclass(frozen=True, slots=True)
class Plan:
    """The measured motion. `corners`: a closed path through these points, m, on a
    table; without any, each stroke goes `length_m` in a direction of its own.
    """

    seconds: float = 1.0  # of a stroke
    length_m: float = 0.1
    turn_deg: float = 5.0  # rms about each axis, of each stroke
    bow: float = 0.05  # of the length, aside
    strokes: int = 8
    support: str = "supported"  # of SWAYS
    corners: tuple[tuple[float, float], ...] = ()


A4 = ((0.0, 0.0), (0.297, 0.0), (0.297, 0.21), (0.0, 0.21))
CIRCLE = tuple(
    (0.1 * math.cos(0.25 * math.pi * k), 0.1 * math.sin(0.25 * math.pi * k))
    for k in range(8)
)


class StrokingHand:
    """Rests, then a plan's strokes with a rest after each, then rests on."""

    def __init__(self, random: np.random.Generator, rate_hz: float, plan: Plan) -> None:
        self._random = random
        self._rate_hz = rate_hz
        self._plan = plan

    def moves(self) -> Iterator[HandMove]:
        plan, random = self._plan, self._random
        in_hand = 0.0 if plan.support == "supported" else 1.0
        quat = rotation.from_heading_pitch_roll(
            random.uniform(-np.pi, np.pi),
            math.radians(random.uniform(30.0, 60.0)),
            math.radians(random.uniform(-30.0, 30.0)),
        )
        tip = np.array([*(plan.corners[0] if plan.corners else (0.0, 0.0)), 0.0])
        lying = Stance(tip, quat, held=0.0, free=0.0)
        stance = Stance(tip, quat, held=in_hand, free=in_hand)
        yield self._move(lying, lying, SETTLES_S, is_rest=True)
        yield self._move(lying, stance, PAUSE_S, is_rest=in_hand == 0.0)
        # Windows of the filter and strokes begin anyhow to each other.
        yield self._move(stance, stance, PAUSE_S + random.uniform(0.0, 0.1))
        for number in range(plan.strokes):
            way = self._way(stance.tip, number)
            turn = np.radians(random.normal(0.0, plan.turn_deg, 3))
            after = Stance(
                stance.tip + way,
                rotation.multiply(stance.quat, rotation.from_rotation_vector(turn)),
                in_hand,
                in_hand,
            )
            aside = np.cross(way, random.standard_normal(3))
            aside *= plan.bow * np.linalg.norm(way) / np.linalg.norm(aside)
            yield self._move(stance, after, plan.seconds, bend=aside, is_stroke=True)
            stance = after
            yield self._move(stance, stance, PAUSE_S + random.uniform(0.0, 0.1))
        while True:
            yield self._move(stance, stance, PAUSE_S)

    def _way(self, tip: FloatArray, number: int) -> FloatArray:
        corners = self._plan.corners
        if corners:
            return np.array([*corners[(number + 1) % len(corners)], 0.0]) - tip
        way = self._random.standard_normal(3)
        return np.asarray(way * self._plan.length_m / np.linalg.norm(way))

    def _move(
        self,
        start: Stance,
        end: Stance,
        seconds: float,
        *,
        bend: FloatArray | None = None,
        is_rest: bool = False,
        is_stroke: bool = False,
    ) -> HandMove:
        return HandMove(
            start,
            end,
            max(2, round(seconds * self._rate_hz)),
            bend=np.zeros(3) if bend is None else bend,
            is_rest=is_rest,
            is_stroke=is_stroke,
        )


@dataclass(frozen=True, slots=True)
class TrueStroke:
    """The truth of a stroke: when it is, s, and how far sensor and tip move in it."""

    start_s: float
    end_s: float
    way_m: FloatArray
    tip_way_m: FloatArray


def strokes_of(motion: Motion) -> list[TrueStroke]:
    """The strokes of a motion, in order. ValueError: it has no truth."""
    if motion.is_stroke is None or motion.position is None or motion.tip is None:
        raise ValueError("a motion without true poses has no known strokes")
    edges = np.flatnonzero(np.diff(motion.is_stroke.astype(int)))
    return [
        TrueStroke(
            (first + 1) / motion.rate_hz,
            (last + 1) / motion.rate_hz,
            motion.position[last + 1] - motion.position[first],
            motion.tip[last + 1] - motion.tip[first],
        )
        for first, last in zip(edges[::2], edges[1::2], strict=True)
    ]
