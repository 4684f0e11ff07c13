# SPDX-License-Identifier: MIT
"""The magnetometer's bias and matrix in the accelerometer's frame, from the attitudes
of the other sensors; after Kok and Schon (2016).

reading = D (v + lag w x v) + o, with v = R' h the field h of the place as the body sees
it, w its rate and `lag` the magnetometer's delay. Twelve parameters, the field, the
lag, and the drift of the heading at knots. D has the trace 3: only the direction of h,
and its length in the sensor's own unit, can be seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from imud.calibration.algebra import MEDIAN, row_slopes, skew
from imud.calibration.recording import SensorRecording
from imud.rotation import FloatArray

EVERY_S = 0.05  # a reading in this time is used
LEAST = 60  # readings
ROUNDS = 6

NOISE_UT = 0.6  # of a reading, at least
# One-sigma priors: the probe's own field, soft iron, and the rotation between the two
# dies, rad.
OWN_UT, SOFT, TURNED = 40.0, 0.05, 0.05
LAG_S, LAG_SIGMA_S = 0.0125, 0.02
DRIFT = math.radians(0.1)  # of the heading, rad in a second; grows with its root
BROKEN = math.radians(30.0)  # of the heading across missing samples, rad
OUTLIER = 3.0  # residuals beyond so many sigma count little
GAUGE = 1e8  # how strictly the trace is held

# Places of the parameters.
MATRIX, OWN, FIELD, LAG, KNOTS = slice(9), slice(9, 12), slice(12, 15), 15, 16


@dataclass(frozen=True, slots=True)
class Readings:
    """The magnetometer's readings, and the probe's attitudes at their times."""

    mag: FloatArray  # (n, 3) uT
    late_s: FloatArray  # (n,) since the attitude's time
    attitude: FloatArray  # (n, 3, 3) levelled, heading free
    rate: FloatArray  # (n, 3) rad/s
    t_s: FloatArray  # (n,)

    @classmethod
    def of(
        cls, recording: SensorRecording, attitude: FloatArray, rate: FloatArray
    ) -> Readings:
        """Picks readings EVERY_S or more apart."""
        there = np.flatnonzero(np.isfinite(recording.mag[:, 0]))
        slot = there // max(1, round(EVERY_S / recording.step_s))
        picked = there[np.diff(slot, prepend=-1) > 0]
        return cls(
            recording.mag[picked],
            recording.mag_late_s[picked],
            attitude[picked],
            rate[picked],
            np.asarray(picked * recording.step_s, dtype=float),
        )


@dataclass(frozen=True, slots=True)
class MagFit:
    """Field = matrix @ (reading - bias), in the accelerometer's frame, uT."""

    matrix: FloatArray
    bias: FloatArray
    field: FloatArray  # of the place: level components at a free heading, and up
    lag_s: float
    covariance: FloatArray  # of D (9), bias, field, lag, knots
    residual: FloatArray  # (n, 3) uT
    weights: FloatArray  # (n,) 1 for a reading that fits

    def scaled(self, factor: float) -> MagFit:
        """The same fit in a unit in which the field is stronger by that factor."""
        return replace(
            self,
            matrix=factor * self.matrix,
            field=factor * self.field,
            residual=factor * self.residual,
        )

    @property
    def level_ut(self) -> float:
        """The horizontal strength of the field."""
        return math.hypot(self.field[0], self.field[1])

    @property
    def norm_ut(self) -> float:
        """The strength of the field in the sensor's own unit."""
        return float(np.linalg.norm(self.field))

    @property
    def dip_deg(self) -> float:
        """By how much the field points below the horizontal."""
        return math.degrees(math.atan2(-self.field[2], self.level_ut))

    @property
    def residual_ut(self) -> float:
        """Rms residual of an axis."""
        return float(np.sqrt((self.residual**2).mean()))

    @property
    def noise_ut(self) -> float:
        """The white noise of an axis, from the differences of successive residuals: all
        other errors change more slowly.
        """
        steps = np.linalg.norm(np.diff(self.residual, axis=0), axis=1)
        return float(np.median(steps)) / (MEDIAN * math.sqrt(2.0))

    @property
    def uneven_ut(self) -> float:
        """Rms residual without the noise: of an uneven field, or of wrong attitudes."""
        return math.sqrt(max(self.residual_ut**2 - self.noise_ut**2, 0.0))


def start(readings: Readings) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Matrix, bias and field in closed form: A m - c - R' h = 0 is linear in fifteen
    unknowns, and the smallest singular vector solves it.
    """
    middle = readings.mag.mean(axis=0)
    size = math.sqrt(3.0) * readings.mag.std(axis=0).mean()
    count = len(readings.mag)
    turned = np.swapaxes(readings.attitude, 1, 2)
    rows = np.concatenate(
        [
            row_slopes((readings.mag - middle) / size),
            np.broadcast_to(-np.eye(3), (count, 3, 3)),
            -turned,
        ],
        axis=2,
    ).reshape(-1, 15)
    _, vectors = np.linalg.eigh(rows.T @ rows)
    found = vectors[:, 0]
    matrix = found[:9].reshape(3, 3)
    if np.linalg.det(matrix) < 0.0:
        found, matrix = -found, -matrix
    scale = np.cbrt(np.linalg.det(matrix))
    bias = middle + size * np.linalg.solve(matrix, found[9:12])
    return matrix / scale, bias, found[12:] / scale * size


def fit(
    readings: Readings,
    knots_s: FloatArray,
    broken: FloatArray,
    bias_rad_s: float = 0.0,
) -> MagFit | None:
    """The refined fit; None if the readings do not determine one. The heading drifts
    between the times `knots_s`; `broken` (one less) is 1 where samples are missing.
    `bias_rad_s`: one-sigma error of the gyroscope's bias.
    """
    if len(readings.mag) < LEAST:
        return None
    try:
        matrix, bias, field = start(readings)
        begun = np.linalg.inv(matrix)
        drift = _Drift.at(readings.t_s, knots_s, broken, bias_rad_s)
        centre = np.concatenate([np.eye(3).ravel(), np.zeros(6), [LAG_S], drift.zero])
        x = np.concatenate([begun.ravel(), bias, field, [LAG_S], drift.zero])
        prior = _prior(drift)
        for _ in range(ROUNDS):
            slopes, residual = _linear(readings, x, drift)
            weights, sigma = _robust(residual)
            each = np.repeat(weights, 3) / sigma**2
            normal = slopes.T @ (slopes * each[:, None]) + prior
            pull = slopes.T @ (each * residual.ravel()) - prior @ (x - centre)
            x = x + np.linalg.solve(normal, pull)
        _, residual = _linear(readings, x, drift)
        true = np.linalg.inv(x[MATRIX].reshape(3, 3))
        covariance = np.asarray(np.linalg.inv(normal), dtype=float)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(x).all() or not np.isfinite(covariance).all():
        return None
    return MagFit(true, x[OWN], x[FIELD], float(x[LAG]), covariance, residual, weights)


@dataclass(frozen=True, slots=True)
class _Drift:
    """The heading's drift: its values at knots, interpolated."""

    shares: FloatArray  # (n, knots): the angle of a reading is shares @ knots
    prior: FloatArray  # (knots, knots)

    @property
    def zero(self) -> FloatArray:
        return np.zeros(len(self.prior))

    @classmethod
    def at(
        cls,
        t_s: FloatArray,
        knots_s: FloatArray,
        broken: FloatArray,
        bias_rad_s: float,
    ) -> _Drift:
        count = len(knots_s)
        shares = [np.interp(t_s, knots_s, one) for one in np.eye(count)]
        prior = np.zeros((count, count))
        prior[0, 0] = 1e8  # rad^-2: where the drift begins is the field's azimuth
        gaps = np.diff(knots_s)
        for index, (gap_s, is_broken) in enumerate(zip(gaps, broken, strict=True)):
            variance = DRIFT**2 * max(gap_s, EVERY_S) + is_broken * BROKEN**2
            variance += (bias_rad_s * gap_s) ** 2
            pair = slice(index, index + 2)
            prior[pair, pair] += np.array([[1.0, -1.0], [-1.0, 1.0]]) / variance
        return cls(np.stack(shares, axis=1), prior)


def _prior(drift: _Drift) -> FloatArray:
    """The weights of the priors."""
    prior = np.zeros((KNOTS + len(drift.prior),) * 2)
    of_matrix = prior[MATRIX, MATRIX]
    for row in range(3):
        of_matrix[4 * row, 4 * row] += SOFT**-2.0
        for column in range(row):
            pair = [3 * row + column, 3 * column + row]
            for sign, sigma in ((1.0, SOFT), (-1.0, TURNED)):
                half = np.array([0.5, 0.5 * sign])
                of_matrix[np.ix_(pair, pair)] += np.outer(half, half) / sigma**2
    trace = np.eye(3).ravel() / 3.0
    of_matrix += GAUGE * np.outer(trace, trace)
    prior[OWN, OWN] = np.eye(3) / OWN_UT**2
    prior[LAG, LAG] = LAG_SIGMA_S**-2.0
    prior[KNOTS:, KNOTS:] = drift.prior
    return prior


def _robust(residual: FloatArray) -> tuple[FloatArray, float]:
    """Weights that passing iron does not get, and the sigma of an axis, uT."""
    error = np.linalg.norm(residual, axis=1)
    sigma = max(NOISE_UT, float(np.median(error)) / MEDIAN)
    return (1.0 + (error / (OUTLIER * sigma)) ** 2) ** -2.0, sigma


def _linear(
    readings: Readings, x: FloatArray, drift: _Drift
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of predicted readings by the parameters, shape (3 n, parameters), and
    residuals (measured less predicted), shape (n, 3).
    """
    matrix, field, lag = x[MATRIX].reshape(3, 3), x[FIELD], x[LAG]
    angle = drift.shares @ x[KNOTS:]
    cosine, sine, zero = np.cos(angle), np.sin(angle), np.zeros(len(angle))
    east = field[0] * cosine - field[1] * sine
    north = field[0] * sine + field[1] * cosine
    up = np.full(len(angle), field[2])
    into_body = np.swapaxes(readings.attitude, 1, 2)
    exact = np.einsum("tij,tj->ti", into_body, np.stack([east, north, up], axis=1))
    turning = np.cross(readings.rate, exact)
    delay = (lag - readings.late_s)[:, None]
    seen = exact + delay * turning
    late = into_body + delay[:, :, None] * (skew(readings.rate) @ into_body)
    felt = matrix @ late
    turned = np.stack(
        [
            np.stack([cosine, -sine, zero], axis=1),
            np.stack([sine, cosine, zero], axis=1),
            np.broadcast_to([0.0, 0.0, 1.0], (len(angle), 3)),
        ],
        axis=1,
    )
    of_angle = np.einsum("tij,tj->ti", felt, np.stack([-north, east, zero], axis=1))
    count = len(angle)
    slopes = np.concatenate(
        [
            row_slopes(seen),
            np.broadcast_to(np.eye(3), (count, 3, 3)),
            felt @ turned,
            (turning @ matrix.T)[:, :, None],
            of_angle[:, :, None] * drift.shares[:, None, :],
        ],
        axis=2,
    )
    residual = readings.mag - seen @ matrix.T - x[OWN]
    return slopes.reshape(3 * count, -1), residual
