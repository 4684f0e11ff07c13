# SPDX-License-Identifier: MIT
"""How good a calibration is: the errors of tilt and heading to expect from it.

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
from imud.calibration.recording import GRAVITY_M_S2
from imud.rotation import FloatArray

# Worse scores than these are refused, degrees. Of 600 simulated recordings of all kinds
# none was accepted of which the error was over 0.5 of tilt or 3 of heading, and 41 % of
# the good ones were refused.
TILT_MAX_DEG = 0.4
HEADING_MAX_DEG = 2.5

TILT_FLOOR_DEG = 0.05  # what no residual shows
NOISE_RMS_UT = math.sqrt(0.5**2 + 0.15**2 / 12.0)  # of a reading, rounding included
TILT_TO_HEADING = 1.5  # a tilt error turns the heading by this times itself, dip 65

ATTITUDES = spread(np.random.default_rng(3), 120)
UP = ATTITUDES[:, 2, :]


@dataclass(frozen=True, slots=True)
class Score:
    """One-sigma errors to expect. None: there is no calibration of that sensor."""

    tilt_deg: float
    heading_deg: float | None = None
    field_deg: float | None = None  # the part of the heading that is the magnetometer's

    @property
    def is_good(self) -> bool:
        """Whether a calibration of all sensors may be put in force."""
        return (
            self.is_level
            and self.heading_deg is not None
            and (self.heading_deg <= HEADING_MAX_DEG)
        )

    @property
    def is_level(self) -> bool:
        """Whether one of the accelerometer may be put in force."""
        return self.tilt_deg <= TILT_MAX_DEG


def direction_slopes(matrix: FloatArray, up: FloatArray) -> FloatArray:
    """How the calibrated force at rest changes with the nine parameters, where unit
    vectors `up` (n, 3) point up in the body: shape (n, 3, 9), m/s2.
    """
    of_bias = np.broadcast_to(-matrix, (len(up), 3, 3))
    return np.concatenate([of_bias, symmetric_slopes(up * GRAVITY_M_S2)], axis=2)


def tilt_deg(fit: AccFit) -> float:
    """The rms error of tilt over all attitudes."""
    slopes = direction_slopes(fit.matrix, UP)
    across = np.eye(3) - UP[:, :, None] * UP[:, None, :]
    slopes = across @ slopes / GRAVITY_M_S2
    variance = np.einsum("tij,jk,tik->t", slopes, fit.covariance, slopes).mean()
    return math.hypot(TILT_FLOOR_DEG, fit.chi * math.degrees(math.sqrt(variance)))


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
    """By how much the variance grows because the residual is more than noise: the rest
    is an uneven field, which stays the same through a stop and a move.
    """
    found, noise = fit.residual_ut**2, NOISE_RMS_UT**2
    alike = 2.0 * len(fit.residual) / max(2 * stops - 1, 1)
    return (min(noise, found) + max(found - noise, 0.0) * alike) / max(
        found, NOISE_UT**2
    )


def score(acc: AccFit, mag: MagFit | None, stops: int) -> Score:
    """Of a calibration from so many stops."""
    tilt = tilt_deg(acc)
    if mag is None:
        return Score(tilt)
    field = field_deg(mag, stops)
    return Score(tilt, math.hypot(TILT_TO_HEADING * tilt, field), field)
