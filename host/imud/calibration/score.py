# SPDX-License-Identifier: MIT
"""The quality of a calibration: the expected errors of tilt and heading.

The fits' covariances, grown by their residuals, are carried to tilt and heading and
averaged over all attitudes. Both scores are careful: in simulations the true rms is 0.6
to 0.8 of what they state.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration.accelerometer import AccFit
from imud.calibration.algebra import row_slopes, spread, symmetric_slopes
from imud.calibration.magnetometer import NOISE_UT, MagFit
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Calibration
from imud.rotation import FloatArray

# Worse scores than these are refused, degrees: of the tilt that is exceeded once in 200
# times, and of the heading's one-sigma error. On 1,259 simulated recordings of all
# kinds none that is accepted is off by over 0.5 of tilt or 3 of heading, and 7 % of the
# good ones are refused though their users lay what the guide asks for
# (docs/calibration.md).
TILT_LIMIT_MAX_DEG = 1.0
HEADING_MAX_DEG = 2.5

RARE = 2.576  # sigmas of a normal variable that is beyond it once in 200 times
HIDDEN_TILT_DEG = 0.05  # an error that no residual shows
UNKNOWN_TILT_DEG = 2.0  # of an uncalibrated accelerometer
TILT_TO_HEADING = 1.5  # a tilt error turns the heading by this times itself, dip 65

ATTITUDES = spread(np.random.default_rng(3), 120)
UP = ATTITUDES[:, 2, :]


@dataclass(frozen=True, slots=True)
class CalibrationScore:
    """One-sigma errors to expect. None: there is no calibration of that sensor."""

    tilt_deg: float
    tilt_limit_deg: float  # exceeded once in 200 times
    heading_deg: float | None = None
    field_deg: float | None = None  # the part of the heading that is the magnetometer's

    @property
    def is_good(self) -> bool:
        """Whether a calibration of all sensors may be activated."""
        return self.is_level and self.is_headed

    @property
    def is_headed(self) -> bool:
        """Whether one of the magnetometer may be activated."""
        return self.heading_deg is not None and self.heading_deg <= HEADING_MAX_DEG

    @property
    def is_level(self) -> bool:
        """Whether one of the accelerometer may be activated."""
        return self.tilt_limit_deg <= TILT_LIMIT_MAX_DEG


def direction_slopes(matrix: FloatArray, up: FloatArray) -> FloatArray:
    """How the calibrated force at rest changes with the nine parameters, where unit
    vectors `up` (n, 3) point up in the body: shape (n, 3, 9), m/s2.
    """
    of_bias = np.broadcast_to(-matrix, (len(up), 3, 3))
    return np.concatenate([of_bias, symmetric_slopes(up * GRAVITY_M_S2)], axis=2)


def tilt_errors(fit: AccFit) -> tuple[float, float]:
    """The rms error of tilt over all attitudes, degrees: its one-sigma value, and the
    value that is exceeded once in 200 times. Its square is a sum of squares of normal
    variables. Where one of them dominates, as when an axis was never up, large errors
    are more frequent than where many share it.
    """
    slopes = direction_slopes(fit.matrix, UP)
    across = np.eye(3) - UP[:, :, None] * UP[:, None, :]
    slopes = across @ slopes / GRAVITY_M_S2
    squares = np.einsum("tij,tik->jk", slopes, slopes) / len(UP)
    parts = np.abs(np.linalg.eigvals(fit.covariance @ squares))
    mean = float(parts.sum())
    # A chi-square distribution of as much freedom, by Wilson and Hilferty.
    freedom = mean**2 / float((parts**2).sum())
    spread_of = 2.0 / (9.0 * freedom)
    rare = mean * (1.0 - spread_of + RARE * math.sqrt(spread_of)) ** 3
    degrees = [fit.chi * math.degrees(math.sqrt(each)) for each in (mean, rare)]
    usual, limit = (math.hypot(HIDDEN_TILT_DEG, each) for each in degrees)
    return usual, limit


def field_deg(fit: MagFit, stops: int) -> float:
    """The rms error of heading over all attitudes that the magnetometer makes."""
    level = fit.level_ut
    if level < 1e-6:
        return math.inf
    into_body = np.swapaxes(ATTITUDES, 1, 2)
    slopes = np.concatenate(
        [
            row_slopes(np.einsum("tij,j->ti", into_body, fit.field)),
            np.broadcast_to(np.eye(3), (len(ATTITUDES), 3, 3)),
        ],
        axis=2,
    )
    across = np.array([-fit.field[1], fit.field[0], 0.0]) / level
    seen = np.einsum("tij,j->ti", into_body, across) @ fit.matrix
    turned = np.einsum("ti,tij->tj", seen, slopes) / level
    variance = np.einsum("tj,jk,tk->t", turned, fit.covariance[:12, :12], turned)
    white = math.degrees(math.sqrt(max(float(variance.mean()), 0.0)))
    return white * math.sqrt(_inflation(fit, stops))


def _inflation(fit: MagFit, stops: int) -> float:
    """The factor of the variance for a residual above the noise: the excess is an
    uneven field, which stays the same through a stop and a move.
    """
    found, noise = fit.residual_ut**2, fit.noise_ut**2
    alike = 2.0 * len(fit.residual) / max(2 * stops - 1, 1)
    return (min(noise, found) + max(found - noise, 0.0) * alike) / max(
        found, NOISE_UT**2
    )


def score(acc: AccFit, mag: MagFit | None, stops: int) -> CalibrationScore:
    """Of a calibration from so many stops."""
    tilt, limit = tilt_errors(acc)
    if mag is None:
        return CalibrationScore(tilt, limit)
    field = field_deg(mag, stops)
    return CalibrationScore(
        tilt, limit, math.hypot(TILT_TO_HEADING * tilt, field), field
    )


def stated_tilt_deg(acc: Calibration | None) -> float:
    """The tilt error of an accelerometer's calibration, by the params."""
    if acc is None or acc.sigma is None:
        return UNKNOWN_TILT_DEG
    return math.degrees(acc.sigma * math.sqrt(2.0) / GRAVITY_M_S2)
