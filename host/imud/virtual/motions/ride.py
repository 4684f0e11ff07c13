# SPDX-License-Identifier: MIT
"""A ride: where a sensor goes and how it turns, exactly, before any error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imud import rotation
from imud.rotation import FloatArray
from imud.virtual.bodies import RigidBody, held
from imud.virtual.curves import Curve, Piece, joined

# A record every 2 ms: the fastest oscillation, an impact of 8 ms, is still smooth.
RATE_HZ = 500.0
REST_S = (5.0, 10.0)  # at the start of each ride

ORIGIN = np.zeros(3)
X, Y, Z = np.eye(3)


@dataclass(frozen=True, slots=True)
class Ride:
    """The body of a sensor at RATE_HZ, and how long it rests first."""

    body: RigidBody
    rest_s: float

    def __len__(self) -> int:
        return len(self.body.turning.quat)

    @property
    def t(self) -> FloatArray:
        """The times of the records, s."""
        return times(len(self) / RATE_HZ)

    def mounted(self, quat: FloatArray) -> Ride:
        """The same ride of a sensor that is turned by `quat` in its body."""
        body = self.body.hinged(ORIGIN, held(quat, len(self)))
        return Ride(body, self.rest_s)


def times(seconds: float) -> FloatArray:
    """The times of the records of a ride, s."""
    return np.arange(round(seconds * RATE_HZ)) / RATE_HZ


def facing(random: np.random.Generator) -> FloatArray:
    """Level, in any direction."""
    return rotation.from_rotation_vector(Z * random.uniform(-np.pi, np.pi))


def anyhow(random: np.random.Generator) -> FloatArray:
    """An attitude of which each is as likely as any other."""
    quat = random.standard_normal(4)
    return np.asarray(quat / np.linalg.norm(quat))


def envelope(t: FloatArray, rest_s: float, rise_s: float) -> Curve:
    """0 during the rest at the start, then up to 1 with least jerk."""
    return joined([Piece(rest_s), Piece(rise_s, step=1.0)], t)


def phase(
    t: FloatArray, rate_hz: float, start_s: float = 0.0, cycles: float = 0.0
) -> Curve:
    """The phase of an oscillation in radians: `cycles` turns at `start_s`."""
    angle = 2.0 * np.pi * (rate_hz * (t - start_s) + cycles)
    rate = np.full(len(t), 2.0 * np.pi * rate_hz)
    return Curve(angle[:, None], rate[:, None], np.zeros((len(t), 1)))


def sine(phase_rad: Curve) -> Curve:
    """The sine of a phase."""
    return phase_rad.through(np.sin, np.cos, lambda angle: -np.sin(angle))


def scaled(curve: Curve, factor: float, shift: float = 0.0) -> Curve:
    """A curve times a factor, plus a shift."""
    return Curve(
        factor * curve.value + shift, factor * curve.first, factor * curve.second
    )
