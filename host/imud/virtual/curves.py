# SPDX-License-Identifier: MIT
"""Smooth quantities and attitudes over time with their exact derivatives: the parts of
simulated motions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from imud import rotation
from imud.rotation import FloatArray


@dataclass(frozen=True, slots=True)
class Curve:
    """A quantity over time with its first two derivatives, as arrays of one length."""

    value: FloatArray
    first: FloatArray
    second: FloatArray

    def __add__(self, other: Curve) -> Curve:
        return Curve(
            self.value + other.value,
            self.first + other.first,
            self.second + other.second,
        )

    def __mul__(self, other: Curve) -> Curve:
        return Curve(
            self.value * other.value,
            self.first * other.value + self.value * other.first,
            self.second * other.value
            + 2.0 * self.first * other.first
            + self.value * other.second,
        )

    def through(self, *functions: Callable[[FloatArray], FloatArray]) -> Curve:
        """A function of this curve, given with its first and second derivative."""
        value, first, second = (function(self.value) for function in functions)
        return Curve(
            value, first * self.first, second * self.first**2 + first * self.second
        )

    def along(self, vector: FloatArray) -> Curve:
        """This scalar curve times a constant vector, shape (n, 3)."""
        return Curve(self.value * vector, self.first * vector, self.second * vector)


@dataclass(frozen=True, slots=True)
class Turning:
    """An attitude over time, world_from_body, with its angular rate (rad/s) and angular
    acceleration (rad/s2) in the body's frame.
    """

    quat: FloatArray
    rate: FloatArray
    acceleration: FloatArray

    def then(self, other: Turning) -> Turning:
        """This attitude, further turned by `other` in the body's frame."""
        back = rotation.inverse(other.quat)
        rate = rotation.rotate(back, self.rate)
        acceleration = rotation.rotate(back, self.acceleration)
        return Turning(
            rotation.multiply(self.quat, other.quat),
            rate + other.rate,
            acceleration - np.cross(other.rate, rate) + other.acceleration,
        )


def about(axis: FloatArray, angle: Curve) -> Turning:
    """A turn about a constant axis: rate and acceleration are those of the angle."""
    turned = angle.along(axis)
    return Turning(
        rotation.from_rotation_vector(turned.value), turned.first, turned.second
    )


# s(u) = 10u^3 - 15u^4 + 6u^5 goes from 0 to 1 with the least jerk, and
# b(u) = 64 u^3 (1-u)^3 from 0 to 1 at the middle and back; neither has speed or
# acceleration at its ends.
STEP = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
BUMP = np.polynomial.Polynomial([0, 0, 0, 64, -192, 192, -64])


def shape(polynomial: np.polynomial.Polynomial, u: FloatArray, span: float) -> Curve:
    """A polynomial of u = 0..1 as a curve over `span` seconds."""
    return Curve(
        np.asarray(polynomial(u)),
        np.asarray(polynomial.deriv(1)(u)) / span,
        np.asarray(polynomial.deriv(2)(u)) / span**2,
    )


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch of a scalar curve: a step with least jerk, and a rate a second that
    goes smoothly from one value to another.
    """

    seconds: float
    step: float = 0.0
    start_rate: float = 0.0
    end_rate: float = 0.0


RISE = STEP.integ()


def joined(pieces: Sequence[Piece], t: FloatArray) -> Curve:
    """Pieces one after the other as a curve of shape (n, 1) that starts at 0.

    The last piece should end after the last of `t`; its end is held.
    """
    seconds, step, start_rate, end_rate = np.array([astuple(each) for each in pieces]).T
    change = end_rate - start_rate
    ends = np.cumsum(seconds)
    gains = np.cumsum(step + seconds * (start_rate + change * RISE(1.0)))
    index = np.minimum(np.searchsorted(ends, t, side="right"), len(ends) - 1)
    span = seconds[index]
    u = np.minimum((t - ends[index]) / span + 1.0, 1.0)
    step, start_rate, change = step[index], start_rate[index], change[index]
    moved, turned = shape(STEP, u, 1.0), shape(RISE, u, 1.0)
    whole = Curve(
        np.concatenate([[0.0], gains])[index]
        + step * moved.value
        + span * (start_rate * u + change * turned.value),
        step * moved.first / span + start_rate + change * turned.first,
        step * moved.second / span**2 + change * turned.second / span,
    )
    return Curve(whole.value[:, None], whole.first[:, None], whole.second[:, None])


@dataclass(frozen=True, slots=True)
class Waves:
    """The sway of a hand: a sum of sines for each of three axes."""

    amplitude: FloatArray  # waves, 3
    pulsation: FloatArray  # rad/s
    phase: FloatArray

    @classmethod
    def draw(
        cls, random: np.random.Generator, bands: Iterable[tuple[float, float, float]]
    ) -> Waves:
        """Five sines in each band of (lowest Hz, highest Hz, rms)."""
        table = np.repeat(np.array(list(bands)), 5, axis=0)
        low, high, rms = table.T[:, :, None]
        shape = (len(table), 3)
        return cls(
            amplitude=np.broadcast_to(rms * math.sqrt(2.0 / 5.0), shape),
            pulsation=2.0 * np.pi * random.uniform(low, high, shape),
            phase=random.uniform(0.0, 2.0 * np.pi, shape),
        )

    def at(self, t: FloatArray) -> Curve:
        """The sway at times `t`, s."""
        angle = self.pulsation * t[:, None, None] + self.phase
        swing = self.amplitude * np.sin(angle)
        speed = self.amplitude * self.pulsation * np.cos(angle)
        return Curve(
            swing.sum(axis=1),
            speed.sum(axis=1),
            -(self.pulsation**2 * swing).sum(axis=1),
        )


def blend(start: float, end: float, step: Curve) -> Curve:
    """From `start` to `end` along a step from 0 to 1."""
    change = end - start
    return Curve(start + change * step.value, change * step.first, change * step.second)
