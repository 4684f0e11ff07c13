# SPDX-License-Identifier: MIT
"""The accelerometer's shape from stops and from the turns between them, with the
gyroscope's at the same time.

Lengths of gravity alone leave shear unseen where a few faces were up. But gravity must
agree with the gyroscope's turns, so the angles between the faces count, too: nine
parameters of one sensor and twelve of the other, with the priors of both.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from imud.calibration import accelerometer, gyroscope
from imud.calibration.accelerometer import AccFit
from imud.calibration.algebra import symmetric, symmetric_slopes, units
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import StaticInterval
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

ROUNDS = 4
ACC = slice(0, accelerometer.PARAMETERS)
GYR = slice(accelerometer.PARAMETERS, accelerometer.PARAMETERS + gyroscope.PARAMETERS)
# Of the direction after a turn, beside its own fit's error, rad: the nonlinearity of a
# gyroscope of a few euros, 0.1 % of a half turn.
BENT_RAD = 2e-3
DIFFERENT_CHI = 5.0


def refined(
    recording: SensorRecording,
    stops: list[StaticInterval],
    readings: FloatArray,
    sigma: FloatArray,
    start: AccFit,
) -> AccFit:
    """The fit `start` of the mean readings (k, 3) with errors (k,), m/s2, with the
    evidence of the turns; `start` itself if no two stops follow each other without a
    gap.
    """
    turns = gyroscope.Turns.of(recording, stops, sigma / GRAVITY_M_S2)
    if not len(turns.pairs):
        return start
    six = start.matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] - [1, 1, 1, 0, 0, 0]
    x = np.concatenate([start.bias, six, np.zeros(gyroscope.PARAMETERS)])
    known = accelerometer.BAD if start.is_bad else accelerometer.USUAL
    of_prior = np.diag(np.concatenate([known, gyroscope.prior()]) ** -2.0)
    of_turn = np.repeat(np.hypot(turns.sigma, BENT_RAD), 3) ** -2.0
    weights = np.concatenate([sigma**-2.0, of_turn])
    for _ in range(ROUNDS):
        slopes, off = _linear(turns, readings, x)
        normal = slopes.T @ (slopes * weights[:, None]) + of_prior
        x = x - np.linalg.solve(normal, slopes.T @ (weights * off) + of_prior @ x)
    _, off = _linear(turns, readings, x)
    # Of three components of a difference of directions two are free.
    freedom = max(len(readings) + 2 * len(turns.pairs) - len(x), 1)
    chi = math.sqrt(float((weights * off**2).sum()) / freedom)
    if chi > max(DIFFERENT_CHI, DIFFERENT_CHI * start.chi):
        return start  # a gyroscope that disagrees with gravity
    return replace(
        start,
        matrix=np.eye(3) + symmetric(x[3:9]),
        bias=x[:3],
        covariance=np.asarray(np.linalg.inv(normal)[ACC, ACC]),
        residual=off[: len(readings)],
        chi=max(1.0, chi, _chi_of_lengths(off[: len(readings)], sigma)),
    )


def _chi_of_lengths(residual: FloatArray, sigma: FloatArray) -> float:
    """As accelerometer.fit() has it: a hand that shakes shows there first."""
    freedom = max(len(residual) - 4, 1)
    return math.sqrt(float(((residual / sigma) ** 2).sum()) / freedom)


def _linear(
    turns: gyroscope.Turns, readings: FloatArray, x: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Lengths and differences of directions: derivatives by all parameters, and
    residuals.
    """
    matrix, shifted = np.eye(3) + symmetric(x[3:9]), readings - x[:3]
    force = shifted @ matrix.T
    up, length = units(force), np.linalg.norm(force, axis=1)
    of_bias = np.broadcast_to(-matrix, (len(force), 3, 3))
    of_force = np.concatenate([of_bias, symmetric_slopes(shifted)], axis=2)
    across = np.eye(3) - up[:, :, None] * up[:, None, :]
    of_up = across @ of_force / length[:, None, None]
    of_gyr, away, attitude = turns.linear(x[GYR], up)
    first, last = turns.pairs, turns.pairs + 1
    before = attitude[turns.middles[first]] @ of_up[first]
    after = attitude[turns.middles[last]] @ of_up[last]
    of_acc = (before - after).reshape(-1, accelerometer.PARAMETERS)
    of_length = np.einsum("ki,kij->kj", up, of_force)
    nothing = np.zeros((len(readings), gyroscope.PARAMETERS))
    slopes = np.block([[of_length, nothing], [of_acc, of_gyr]])
    return slopes, np.concatenate([length - GRAVITY_M_S2, away])
