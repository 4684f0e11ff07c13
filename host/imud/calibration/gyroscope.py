# SPDX-License-Identifier: MIT
"""The gyroscope's scale and cross-axis terms from turns between stops, after Tedaldi,
Pretto and Menegatti (2014).

Gravity at a stop, by the calibrated accelerometer, must agree with gravity at the stop
before, rotated by the gyroscope. The bias is interpolated between the stops' means.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from imud.calibration.algebra import integrated, skew
from imud.calibration.recording import IntArray, SensorRecording
from imud.calibration.stops import StaticInterval
from imud.rotation import FloatArray

ROUNDS = 3
PARAMETERS = 12  # nine of the matrix, a constant bias beyond the interpolated one

# One-sigma priors: scale, cross-axis, and the part of the bias that stops miss, rad/s.
SCALE, CROSS = 0.02, 0.01
BIAS_RAD_S = math.radians(0.005)

# Of the direction of gravity at a stop, and of an angle that grows with time.
LEVEL_RAD = 4e-4
WALK_RAD = math.radians(0.08)  # a reading's noise at 100 Hz
WALK_HZ = 100.0


@dataclass(frozen=True, slots=True)
class GyrFit:
    """Rate = matrix @ (reading - bias), rad/s."""

    matrix: FloatArray
    bias: FloatArray  # mean over the recording
    covariance: FloatArray  # 12 x 12: rows of the matrix, bias
    angle: FloatArray  # of each turn: how far gravity is off after it, rad
    chi: float
    rate: FloatArray  # calibrated, of each step of the recording
    attitude: FloatArray  # matrices of each step and the end; the first is the identity

    @property
    def residual_rad(self) -> float:
        """Rms angle by which gravity is off after a turn."""
        return float(np.sqrt((self.angle**2).mean())) if len(self.angle) else math.nan

    @property
    def sigma(self) -> float:
        """One-sigma error of scale and cross-axis terms, as a fraction."""
        return self.chi * float(np.sqrt(np.diag(self.covariance)[:9].mean()))


def bias_course(recording: SensorRecording, stops: list[StaticInterval]) -> FloatArray:
    """The bias of each step: the means of the stops, interpolated in time."""
    middles = [stop.middle for stop in stops]
    means = np.array([recording.gyr[s.start : s.end].mean(axis=0) for s in stops])
    steps = np.arange(len(recording))
    courses = [np.interp(steps, middles, means[:, axis]) for axis in range(3)]
    return np.stack(courses, axis=1)


@dataclass(frozen=True, slots=True)
class Turns:
    """The turns between stops that follow each other without a gap."""

    step_s: float
    shifted: FloatArray  # rates without the bias that the stops show
    middles: IntArray  # the step in the middle of each stop
    pairs: IntArray  # the stops after which there is a turn
    sigma: FloatArray  # of the direction of gravity after each turn, rad

    @classmethod
    def of(
        cls,
        recording: SensorRecording,
        stops: list[StaticInterval],
        sigma_rad: FloatArray,
    ) -> Turns:
        """`sigma_rad`: errors of the directions of gravity at the stops (k,)."""
        middles = np.array([stop.middle for stop in stops])
        pairs = _pairs(recording, middles)
        return cls(
            recording.step_s,
            recording.gyr - bias_course(recording, stops),
            middles,
            pairs,
            _turn_sigma(recording.step_s, middles, pairs, sigma_rad),
        )

    def linear(
        self, x: FloatArray, up: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The differences of gravity across turns, their slopes, and the attitudes."""
        matrix = np.eye(3) + x[:9].reshape(3, 3)
        shifted = self.shifted - x[9:]
        attitude = integrated(shifted @ matrix.T, self.step_s)
        halfway = (attitude[:-1] + attitude[1:]) / 2.0
        # A small error of the rate turns all that follows: sum R (dE y - E db) dt.
        slopes = np.zeros((len(attitude), 3, PARAMETERS))
        entries = np.einsum("nij,nk->nijk", halfway, shifted)
        slopes[1:, :, :9] = entries.reshape(-1, 3, 9)
        slopes[1:, :, 9:] = -halfway @ matrix
        grown = np.cumsum(slopes, axis=0)
        start, end = self.middles[self.pairs], self.middles[self.pairs + 1]
        before = np.einsum("kij,kj->ki", attitude[start], up[self.pairs])
        after = np.einsum("kij,kj->ki", attitude[end], up[self.pairs + 1])
        turned = skew(after) @ (grown[end] - grown[start]) * self.step_s
        return turned.reshape(-1, PARAMETERS), (before - after).ravel(), attitude


def prior() -> FloatArray:
    """One-sigma errors of the parameters before a fit."""
    matrix = np.where(np.eye(3).ravel() > 0.0, SCALE, CROSS)
    return np.concatenate([matrix, np.full(3, BIAS_RAD_S)])


def fit(
    recording: SensorRecording,
    stops: list[StaticInterval],
    up: FloatArray,
    sigma_rad: FloatArray,
) -> GyrFit:
    """From the directions of gravity at the stops, unit vectors of shape (k, 3) in the
    accelerometer's frame, and their errors (k,).
    """
    turns = Turns.of(recording, stops, sigma_rad)
    of_prior = np.diag(prior() ** -2.0)
    weights = np.repeat(turns.sigma**-2.0, 3)
    x = np.zeros(PARAMETERS)
    for _ in range(ROUNDS):
        slopes, off, _ = turns.linear(x, up)
        normal = slopes.T @ (slopes * weights[:, None]) + of_prior
        x = x - np.linalg.solve(normal, slopes.T @ (weights * off) + of_prior @ x)
    _, off, attitude = turns.linear(x, up)
    matrix = np.eye(3) + x[:9].reshape(3, 3)
    # Two of the three components of a small difference of directions are free.
    freedom = max(2 * len(turns.pairs) - 9, 1)
    chi = math.sqrt((weights * off**2).sum() / freedom)
    angle = np.arcsin(np.clip(np.linalg.norm(off.reshape(-1, 3), axis=1), 0.0, 1.0))
    course = bias_course(recording, stops)
    return GyrFit(
        matrix,
        course.mean(axis=0) + x[9:],
        np.asarray(np.linalg.inv(normal), dtype=float),
        angle,
        max(1.0, chi),
        (turns.shifted - x[9:]) @ matrix.T,
        attitude,
    )


def mismatch(
    recording: SensorRecording, stops: list[StaticInterval], up: FloatArray
) -> float:
    """The rms angle by which gravity is off after the turns, rad, without a fit."""
    turns = Turns.of(recording, stops, np.zeros(len(stops)))
    _, off, _ = turns.linear(np.zeros(PARAMETERS), up)
    return float(np.sqrt((off.reshape(-1, 3) ** 2).sum(axis=1).mean()))


def _pairs(recording: SensorRecording, middles: IntArray) -> IntArray:
    """Which stops are followed by another one without a gap between them."""
    whole = [
        recording.is_whole(int(start), int(end))
        for start, end in itertools.pairwise(middles)
    ]
    return np.flatnonzero(whole)


def _turn_sigma(
    step_s: float, middles: IntArray, pairs: IntArray, sigma_rad: FloatArray
) -> FloatArray:
    """The error of gravity after each turn, rad."""
    level = LEVEL_RAD + sigma_rad
    seconds = (middles[pairs + 1] - middles[pairs]) * step_s
    walk = WALK_RAD * np.sqrt(seconds / WALK_HZ)
    return np.asarray(np.sqrt(level[pairs] ** 2 + level[pairs + 1] ** 2 + walk**2))
