# SPDX-License-Identifier: MIT
"""The accelerometer's bias and shape from stops in different attitudes.

At rest the force is gravity, whatever the attitude: |A (a - b)| = g for the mean
reading a of each stop. A is I + S with S symmetric: nothing here sees how the sensor is
turned in its housing. Nine parameters with priors, by Gauss-Newton steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imud.calibration.algebra import symmetric, symmetric_slopes
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import StaticInterval
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

PARAMETERS = 9
ROUNDS = 6

# One-sigma priors of bias (m/s2), scale and shear: an MPU-9250's data sheet with some
# room, and a bad chip, of which some have half a g.
USUAL = np.repeat([0.04 * GRAVITY_M_S2, 0.02, 0.01], 3)
BAD = np.repeat([0.6 * GRAVITY_M_S2, 0.05, 0.03], 3)
BAD_COST = 4.0  # weighted squares for each residual and parameter that indicate BAD

# Of the mean of a stop, m/s2: white noise of a reading, and an error that stays.
NOISE_M_S2 = 0.035
FLOOR_M_S2 = 0.004


@dataclass(frozen=True, slots=True)
class AccFit:
    """Force = matrix @ (reading - bias), m/s2."""

    matrix: FloatArray  # symmetric
    bias: FloatArray
    covariance: FloatArray  # 9 x 9: bias, then xx, yy, zz, xy, xz, yz of the matrix
    residual: FloatArray  # of each stop, m/s2
    chi: float  # residuals over what was expected, 1 at least
    is_bad: bool = False  # its bias is beyond what a usual chip has

    def force(self, readings: FloatArray) -> FloatArray:
        """Calibrated force of readings, shape (..., 3), m/s2."""
        return np.asarray((readings - self.bias) @ self.matrix.T)

    @property
    def residual_m_s2(self) -> float:
        """Rms residual of the fit, for its number of parameters."""
        freedom = max(len(self.residual) - 4, 1)
        return float(np.sqrt((self.residual**2).sum() / freedom))


def means(
    recording: SensorRecording, stops: list[StaticInterval]
) -> tuple[FloatArray, FloatArray]:
    """The mean reading of each stop and its one-sigma error, m/s2."""
    found = np.array([recording.acc[stop.start : stop.end].mean(0) for stop in stops])
    counts = np.array([len(stop) for stop in stops])
    return found, np.hypot(NOISE_M_S2 / np.sqrt(counts), FLOOR_M_S2)


def fit(readings: FloatArray, sigma: FloatArray) -> AccFit:
    """From the mean readings of stops, shape (k, 3), and their errors (k,), m/s2."""
    usual, cost = _fit(readings, sigma, USUAL)
    if cost < BAD_COST * (len(readings) + PARAMETERS):
        return usual
    bad, other = _fit(readings, sigma, BAD)
    return bad if other < cost else usual


def _fit(
    readings: FloatArray, sigma: FloatArray, prior: FloatArray
) -> tuple[AccFit, float]:
    """The fit, and the sum of its weighted squares."""
    x = np.zeros(PARAMETERS)
    weights, of_prior = sigma**-2.0, np.diag(prior**-2.0)
    for _ in range(ROUNDS):
        slopes, residual = _linear(readings, x)
        normal = slopes.T @ (slopes * weights[:, None]) + of_prior
        x = x - np.linalg.solve(normal, slopes.T @ (weights * residual) + of_prior @ x)
    _, residual = _linear(readings, x)
    freedom = max(len(readings) - 4, 1)
    chi = np.sqrt((weights * residual**2).sum() / freedom)
    matrix = np.eye(3) + symmetric(x[3:])
    covariance = np.asarray(np.linalg.inv(normal), dtype=float)
    found = AccFit(
        matrix, x[:3], covariance, residual, max(1.0, float(chi)), prior is BAD
    )
    return found, float((weights * residual**2).sum() + x @ of_prior @ x)


def _linear(readings: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of each force's length by the parameters, and its difference from
    gravity.
    """
    matrix = np.eye(3) + symmetric(x[3:])
    shifted = readings - x[:3]
    force = shifted @ matrix.T
    length = np.linalg.norm(force, axis=1)
    up = force / length[:, None]
    of_shape = np.einsum("ki,kij->kj", up, symmetric_slopes(shifted))
    return np.concatenate([-up @ matrix, of_shape], axis=1), length - GRAVITY_M_S2
