# SPDX-License-Identifier: MIT
"""The simulated hand: where it takes the probe, move by move. It rests, draws strokes
on a surface, turns the probe, regrips it and puts it down.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from imud import rotation
from imud.rotation import FloatArray


@dataclass(frozen=True, slots=True)
class Stance:
    """The probe at the beginning or end of a move."""

    tip: FloatArray
    quat: FloatArray
    held: float  # 0: it lies on its own, 1: it is in the hand, which sways
    free: float  # 0: the tip is on the surface, 1: in the air


@dataclass(frozen=True, slots=True)
class HandMove:
    """A stretch from stance to stance with least jerk, a whole number of records."""

    start: Stance
    end: Stance
    records: int
    bend: FloatArray = field(default_factory=lambda: np.zeros(3))  # m, at the middle
    swerve: FloatArray = field(default_factory=lambda: np.zeros(3))  # rad, there too
    is_rest: bool = False
    is_stroke: bool = False


_TURN_LIMIT = math.radians(450.0)  # rad/s at the peak of a turn
_PEAK = 1.875  # of a least-jerk step's speed over its mean speed


class Hand:
    """Decides, move by move, what the probe does next. All choices are drawn here."""

    def __init__(self, random: np.random.Generator, rate_hz: float) -> None:
        self.random = random
        self.rate_hz = rate_hz
        tip = np.array([*random.uniform(-0.1, 0.1, 2), 0.0])
        self.stance = Stance(tip, self._lying(False), held=0.0, free=0.0)

    def moves(self) -> Iterator[HandMove]:
        """A rest, then endless rounds with each act once, in random order."""
        yield self._rest(3.0, 5.0)
        acts = [self._draw, self._draw, self._turn, self._regrip, self._put_down]
        while True:
            for index in self.random.permutation(len(acts)):
                yield from acts[index]()

    def _draw(self) -> Iterator[HandMove]:
        surface = np.array([*self.random.uniform(-0.15, 0.15, 2), 0.0])
        pen = self._pen()
        high = np.array([0.0, 0.0, self.random.uniform(0.03, 0.08)])
        yield self._go(surface, pen, 0.8, 1.4, free=0.0, bend=high)
        for _ in range(self.random.integers(2, 5)):
            yield self._go(surface, pen, 0.2, 0.6, free=0.0)
            length = self.random.uniform(0.05, 0.15)
            # Back towards the middle, so that the hand stays over its table.
            towards = math.atan2(-surface[1], -surface[0])
            towards += self.random.uniform(-0.9, 0.9)
            ahead = np.array([math.cos(towards), math.sin(towards), 0.0])
            aside = np.array([-ahead[1], ahead[0], 0.0])
            bend = aside * length * self.random.uniform(-0.15, 0.15)
            surface = surface + ahead * length
            lean = np.radians(self.random.uniform(-12.0, 12.0, 3))
            pen = rotation.multiply(pen, rotation.from_rotation_vector(lean))
            yield self._go(surface, pen, 0.6, 2.0, free=0.0, bend=bend, is_stroke=True)
        yield self._go(surface, pen, 0.2, 0.6, free=0.0)

    def _turn(self) -> Iterator[HandMove]:
        for _ in range(self.random.integers(2, 4)):
            heading, roll = self.random.uniform(-np.pi, np.pi, 2)
            pitch = math.asin(self.random.uniform(-1.0, 1.0))
            quat = rotation.from_heading_pitch_roll(heading, pitch, roll)
            tip = np.array([*self.random.uniform(-0.2, 0.2, 2), 0.25])
            tip[2] += self.random.uniform(-0.08, 0.08)
            yield self._go(tip, quat, 0.5, 1.5, free=1.0)

    def _regrip(self) -> Iterator[HandMove]:
        before = self.stance
        roll = self.random.choice([-1.0, 1.0]) * self.random.uniform(1.0, 2.1)
        tilt = self.random.uniform(-0.25, 0.25, 2)
        twist = rotation.from_rotation_vector(np.array([roll, *tilt]))
        lifted = np.array([before.tip[0], before.tip[1], before.tip[2] + 0.03])
        rolled = rotation.multiply(before.quat, twist)
        yield self._go(lifted, rolled, 0.35, 0.6, free=1.0)
        again = rotation.multiply(
            before.quat, rotation.from_rotation_vector(np.array([0.2 * roll, *tilt]))
        )
        yield self._go(lifted, again, 0.35, 0.6, free=1.0)

    def _put_down(self) -> Iterator[HandMove]:
        down = np.array([*self.random.uniform(-0.2, 0.2, 2), 0.0])
        high = np.array([0.0, 0.0, self.random.uniform(0.02, 0.06)])
        is_upside_down = bool(self.random.random() < 0.3)
        lying = self._lying(is_upside_down)
        yield self._go(down, lying, 0.9, 1.5, free=0.0, held=0.0, bend=high)
        yield self._rest(2.0, 4.0)

    def _rest(self, shortest_s: float, longest_s: float) -> HandMove:
        records = self._records(self.random.uniform(shortest_s, longest_s))
        return HandMove(self.stance, self.stance, records, is_rest=True)

    def _go(
        self,
        tip: FloatArray,
        quat: FloatArray,
        shortest_s: float,
        longest_s: float,
        *,
        free: float,
        held: float = 1.0,
        bend: FloatArray | None = None,
        is_stroke: bool = False,
    ) -> HandMove:
        start = self.stance
        self.stance = Stance(tip, quat, held, free)
        change = rotation.multiply(rotation.inverse(start.quat), quat)
        angle = float(np.linalg.norm(rotation.to_rotation_vector(change)))
        seconds = max(
            self.random.uniform(shortest_s, longest_s), _PEAK * angle / _TURN_LIMIT
        )
        return HandMove(
            start,
            self.stance,
            self._records(seconds),
            bend=np.zeros(3) if bend is None else bend,
            is_stroke=is_stroke,
        )

    def _records(self, seconds: float) -> int:
        return max(2, round(seconds * self.rate_hz))

    def _lying(self, is_upside_down: bool) -> FloatArray:
        heading = self.random.uniform(-np.pi, np.pi)
        pitch, roll = np.radians(self.random.uniform(-3.0, 3.0, 2))
        if is_upside_down:
            roll += np.pi
        return rotation.from_heading_pitch_roll(heading, pitch, roll)

    def _pen(self) -> FloatArray:
        heading = self.random.uniform(-np.pi, np.pi)
        pitch = np.radians(self.random.uniform(45.0, 75.0))  # the tip points down
        roll = np.radians(self.random.uniform(-30.0, 30.0))
        return rotation.from_heading_pitch_roll(heading, pitch, roll)
