# SPDX-License-Identifier: MIT
"""The equations of free motion: the expected force and field along the gyroscope's
attitude, and their derivatives by the parameters of three sensors. See motion.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from imud.calibration.algebra import (
    integrated,
    row_slopes,
    skew,
    symmetric,
    symmetric_slopes,
    units,
)
from imud.calibration.recording import IntArray, SensorRecording
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

FORCE_S = 4.0  # of the raised cosine by which force is averaged
FORCE_STEP_S = 1.0
FIELD_S = 0.2  # of a mean of the field
KNOT_S = 5.0  # between two corrections of the attitude

# The parameters, in their order; three of attitude at each knot follow.
ACC_BIAS, ACC_MATRIX = slice(0, 3), slice(3, 9)  # m/s2; as symmetric() has them
GYR_MATRIX, GYR_BIAS, GYR_DRIFT = slice(9, 18), slice(18, 21), slice(21, 24)
RATE = slice(9, 24)  # these three: what turns the frame
LEAN = slice(24, 26)  # rad: of gravity in the frame
MAG_BIAS, MAG_MATRIX, LAG = slice(26, 29), slice(29, 38), 38  # uT; s
MAG = slice(26, 38)  # the first two
FIELD, ARM = slice(39, 42), slice(42, 45)  # uT, of the place; m
KNOTS = 45

LAG_S = 0.005  # expected
ROOM_UT = 0.4  # least noise of a mean of the field
FORCE_M_S2 = 0.02  # and of a mean force
# Overlapping windows, and rooms whose field changes slowly, have less information than
# their number suggests: factors of their variances.
FORCE_ALIKE, FIELD_ALIKE = 4.0, 5.0
FAR = 3.0  # sigmas, beyond which a mean counts less


@dataclass(slots=True)
class Estimate:
    """The parameters so far, without the knots."""

    rest: FloatArray  # rad/s, the bias that a rest showed
    values: FloatArray = field(default_factory=lambda: np.zeros(KNOTS))

    def __post_init__(self) -> None:
        self.values[LAG] = LAG_S
        self.values[GYR_BIAS] = self.rest

    def moved(self) -> FloatArray:
        """The differences from the expected values, for the prior."""
        away = self.values.copy()
        away[GYR_BIAS] -= self.rest
        away[LAG] -= LAG_S
        away[FIELD] = away[LEAN] = 0.0
        return away


@dataclass(frozen=True, slots=True)
class Means:
    """Where the recording is averaged, and with which weights."""

    at: IntArray
    half: int  # steps to each side
    window: FloatArray

    def of(self, rows: FloatArray) -> FloatArray:
        """Weighted means of rows (n, ...): shape (k, ...)."""
        steps = self.at[:, None] + np.arange(-self.half, self.half + 1)
        weights = self.window * ((steps >= 0) & (steps < len(rows)))
        steps = np.clip(steps, 0, len(rows) - 1)
        flat = rows.reshape(len(rows), -1)
        found = np.einsum("ks,ksf->kf", weights, flat[steps])
        found /= weights.sum(axis=1, keepdims=True)
        return np.asarray(found.reshape(len(self.at), *rows.shape[1:]))


@dataclass(frozen=True, slots=True)
class Rows:
    """Equations of one kind, three for each mean: slopes @ step = away."""

    slopes: FloatArray  # (k, 3, parameters)
    away: FloatArray  # (k, 3)
    least: float  # of their noise
    variance_inflation: float

    def left(self, step: FloatArray) -> FloatArray:
        """The residuals after a step, (k, 3)."""
        return self.away - self.slopes @ step

    def noise(self, left: FloatArray) -> float:
        """Noise of an axis, by the residuals of most means."""
        return max(self.least, 1.2 * float(np.median(_sizes(left))))

    def weighted(self, step: FloatArray | None) -> tuple[FloatArray, FloatArray]:
        """Both sides, whitened by the noise that the last step shows."""
        noise, weights = 5.0 * self.least, np.ones(len(self.away))
        if step is not None:
            left = self.left(step)
            noise = self.noise(left)
            weights = 1.0 / (1.0 + (_sizes(left) / (FAR * noise)) ** 2)
        weights = np.repeat(weights, 3) / (noise * math.sqrt(self.variance_inflation))
        slopes = self.slopes.reshape(len(weights), -1)
        return slopes * weights[:, None], self.away.ravel() * weights


def _sizes(left: FloatArray) -> FloatArray:
    """Of an axis, of each mean (k, 3)."""
    return np.asarray(np.linalg.norm(left, axis=1) / math.sqrt(3.0))


@dataclass(slots=True)
class MotionEquations:
    """A recording while it is fitted."""

    recording: SensorRecording
    rest_step: float  # at which the bias was that of the rest
    estimate: Estimate
    step: FloatArray = field(init=False)  # the last one
    attitude: FloatArray = field(init=False)  # of each step, by the last equations
    up: FloatArray = field(init=False)  # in the frame, by the last equations
    mag: FloatArray = field(init=False)
    force_means: Means = field(init=False)
    field_means: Means = field(init=False)

    def __post_init__(self) -> None:
        count, step_s = len(self.recording), self.recording.step_s
        steps, mag = np.arange(count), self.recording.mag
        there = np.isfinite(mag[:, 0])
        self.mag = np.stack(
            [np.interp(steps, steps[there], mag[there, axis]) for axis in range(3)], 1
        )
        half = round(FORCE_S / step_s / 2.0)
        at = np.arange(
            half // 2, count - half // 2, max(1, round(FORCE_STEP_S / step_s))
        )
        self.force_means = Means(at, half, np.hanning(2 * half + 3)[1:-1])
        half = max(1, round(FIELD_S / step_s / 2.0))
        self.field_means = Means(
            np.arange(half, count - half, 2 * half), half, np.ones(2 * half + 1)
        )

    @property
    def knots(self) -> FloatArray:
        """Steps at which the attitude is corrected."""
        count, step_s = len(self.recording), self.recording.step_s
        return np.linspace(0, count - 1, max(2, int(count * step_s / KNOT_S) + 1))

    def hats(self, at: IntArray) -> FloatArray:
        """How much of each knot's correction there is at these steps, (k, knots)."""
        each = np.eye(len(self.knots))
        return np.stack([np.interp(at, self.knots, row) for row in each], axis=1)

    def rates(self) -> tuple[FloatArray, FloatArray]:
        """Without their bias, and with their matrix besides."""
        values = self.estimate.values
        age_s = (
            np.arange(len(self.recording)) - self.rest_step
        ) * self.recording.step_s
        plain = (
            self.recording.gyr - values[GYR_BIAS] - np.outer(age_s, values[GYR_DRIFT])
        )
        return plain, plain + plain @ values[GYR_MATRIX].reshape(3, 3).T

    def equations(self) -> tuple[Rows, Rows]:
        """Of force and of field, about the estimate."""
        step_s, values = self.recording.step_s, self.estimate.values
        plain, rate = self.rates()
        self.attitude = attitude = integrated(rate, step_s)[:-1]
        age_s = (np.arange(len(attitude)) - self.rest_step) * step_s
        turned = np.concatenate(
            [
                np.einsum("tij,tjk->tik", attitude, row_slopes(plain)),
                -attitude,
                -attitude * age_s[:, None, None],
            ],
            axis=2,
        )
        turned = np.cumsum(turned, axis=0) * step_s
        force = self._of_force(attitude, turned)
        mag = (self.mag - values[MAG_BIAS]) @ (np.eye(3) + self.soft()).T
        return force, self._of_field(attitude, turned, mag, np.cross(mag, rate))

    def soft(self) -> FloatArray:
        """The magnetometer's matrix, less the identity."""
        return self.estimate.values[MAG_MATRIX].reshape(3, 3)

    def _of_force(self, attitude: FloatArray, turned: FloatArray) -> Rows:
        """The mean force is gravity, level by level."""
        values, means = self.estimate.values, self.force_means
        centred = self.recording.acc - values[ACC_BIAS]
        # The second derivative of the attitude: of the sensor's place, over the arm.
        bent = np.zeros_like(attitude)
        bent[1:-1] = attitude[2:] - 2.0 * attitude[1:-1] + attitude[:-2]
        bent /= self.recording.step_s**2
        own = centred - centred @ symmetric(values[ACC_MATRIX]).T
        seen = means.of(np.einsum("tij,tj->ti", attitude, own) - bent @ values[ARM])
        self.up = up = units(seen.mean(axis=0))
        across = np.linalg.svd(up[None])[2][1:]
        lean = -skew(GRAVITY_M_S2 * up)
        slopes = np.zeros((len(seen), 3, KNOTS + 3 * len(self.knots)))
        slopes[..., ACC_BIAS] = -means.of(attitude)
        slopes[..., ACC_MATRIX] = -means.of(
            np.einsum("tij,tjk->tik", attitude, symmetric_slopes(centred))
        )
        slopes[..., RATE] = lean @ means.of(turned)
        slopes[..., LEAN] = -GRAVITY_M_S2 * across.T
        slopes[..., ARM] = -means.of(bent)
        slopes[..., KNOTS:] = _spread(self.hats(means.at), lean)
        return Rows(slopes, GRAVITY_M_S2 * up - seen, FORCE_M_S2, FORCE_ALIKE)

    def _of_field(
        self,
        attitude: FloatArray,
        turned: FloatArray,
        mag: FloatArray,
        slope: FloatArray,
    ) -> Rows:
        """The field of the place is the same throughout. `slope`: by how much the
        calibrated readings `mag` change with their delay.
        """
        values, means = self.estimate.values, self.field_means
        late = mag + values[LAG] * slope
        seen = means.of(np.einsum("tij,tj->ti", attitude, late))
        if not values[FIELD].any():
            values[FIELD] = seen.mean(axis=0)
        about = -skew(values[FIELD])
        slopes = np.zeros((len(seen), 3, KNOTS + 3 * len(self.knots)))
        slopes[..., MAG_BIAS] = -means.of(attitude @ (np.eye(3) + self.soft()))
        readings = row_slopes(self.mag - values[MAG_BIAS])
        slopes[..., MAG_MATRIX] = means.of(
            np.einsum("tij,tjk->tik", attitude, readings)
        )
        slopes[..., LAG] = means.of(np.einsum("tij,tj->ti", attitude, slope))
        slopes[..., RATE] = about @ means.of(turned)
        slopes[..., FIELD] = -np.eye(3)
        slopes[..., KNOTS:] = _spread(self.hats(means.at), about)
        return Rows(slopes, values[FIELD] - seen, ROOM_UT, FIELD_ALIKE)


def _spread(hats: FloatArray, about: FloatArray) -> FloatArray:
    """Slopes by the knots' corrections: (k, 3, 3 * knots)."""
    each = np.einsum("kq,ij->kiqj", hats, about)
    return np.asarray(each.reshape(len(hats), 3, -1))
