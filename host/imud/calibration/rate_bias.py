# SPDX-License-Identifier: MIT
"""The gyroscope's bias from motion that never rests: gravity, averaged over some
seconds, must be constant in the frame of the integrated gyroscope.
"""

from __future__ import annotations

import numpy as np

from imud.calibration.algebra import MEDIAN, integrated, skew
from imud.calibration.recording import IntArray
from imud.rotation import FloatArray

AVERAGE_S = 3.0  # of the force, to find gravity: motion averages out
KNOT_S = 1.0  # between two such means
# Means of the force overlap, so they have less information than their number suggests.
ALIKE = AVERAGE_S / KNOT_S
APART = 6  # knots between two means that are compared, while the frame still turns
APART_ROUNDS, ROUNDS = 5, 10
FAR = 3.0  # sigmas, beyond which a mean counts less
WEIGHINGS = 4  # in each round


def averaged(rows: FloatArray, step_s: float) -> tuple[IntArray, FloatArray]:
    """Steps KNOT_S apart, and means of rows (n, ...) about them."""
    width = max(1, round(AVERAGE_S / step_s))
    window = np.hanning(2 * width + 1)[1:-1]
    known = np.arange(0, len(rows), max(1, round(KNOT_S / step_s)))
    weights = np.convolve(np.ones(len(rows)), window, "same")[known]
    flat = rows.reshape(len(rows), -1)
    smooth = [np.convolve(column, window, "same")[known] for column in flat.T]
    means = np.stack(smooth, axis=1) / weights[:, None]
    return known, np.asarray(means.reshape(len(known), *rows.shape[1:]))


def of_motion(
    rate: FloatArray, force: FloatArray, step_s: float
) -> tuple[FloatArray, float]:
    """The bias of calibrated rates (n, 3), rad/s, by calibrated force (n, 3), m/s2; and
    its one-sigma error, of the least certain axis.
    """
    bias = np.zeros(3)
    covariance = np.eye(3)
    for turn in range(ROUNDS):
        attitude = integrated(rate - bias, step_s)[:-1]
        _, mean = averaged(np.einsum("tij,tj->ti", attitude, force), step_s)
        _, turned = averaged(np.cumsum(attitude, axis=0) * step_s, step_s)
        apart = APART if turn < APART_ROUNDS and len(mean) > 2 * APART else 0
        step, covariance = _step(mean, turned, apart)
        bias = bias + step
    return bias, float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


def _step(
    mean: FloatArray, turned: FloatArray, apart: int
) -> tuple[FloatArray, FloatArray]:
    """A bias of d turns the frame by -C d, C being the attitude summed up: a constant g
    seems to be g - g x C d. Once with means `apart` knots apart, where g is what is
    seen there; else with one g throughout.
    """
    if apart:
        slopes = -skew(mean[:-apart]) @ (turned[apart:] - turned[:-apart])
        away = mean[apart:] - mean[:-apart]
        free = np.zeros((*slopes.shape[:2], 0))
    else:
        slopes = -skew(mean.mean(axis=0)) @ turned
        away = mean - mean.mean(axis=0)
        free = np.broadcast_to(np.eye(3), slopes.shape)
    rows = np.concatenate([slopes, free], axis=2)
    weights = np.ones(len(away))
    for _ in range(WEIGHINGS):
        weighted = rows * weights[:, None, None]
        normal = np.einsum("kij,kil->jl", weighted, rows)
        normal += 1e-9 * np.eye(len(normal))
        found = np.linalg.solve(normal, np.einsum("kij,ki->j", weighted, away))
        left = np.linalg.norm(away - rows @ found, axis=1)
        sigma = max(float(np.median(left)) / MEDIAN, 1e-6)
        weights = 1.0 / (1.0 + (left / (FAR * sigma)) ** 2)
    return found[:3], np.linalg.inv(normal)[:3, :3] * sigma**2 * ALIKE
