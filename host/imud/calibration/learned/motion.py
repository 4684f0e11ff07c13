# SPDX-License-Identifier: MIT
"""All three sensors from free motion, without any procedure: the conditions that hold
if the gyroscope carries the attitude and motion averages out.

Turned into the almost inertial frame of the integrated rates and averaged, the force is
gravity, but for the sensor's distance from the pivot about which it is turned, whose
acceleration looks like an error of the accelerometer (the lever arm is estimated, too);
and the field is that of the place. Errors of the sensors, of which those of the rate
turn the frame, make a linear system, which is solved in a few rounds of weighted least
squares with priors: Gauss-Newton steps towards the most probable parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from imud.calibration.accelerometer import BAD, AccFit
from imud.calibration.affine import Affine
from imud.calibration.algebra import MEDIAN, row_slopes, symmetric
from imud.calibration.learned.equations import (
    ACC_BIAS,
    ACC_MATRIX,
    ARM,
    FIELD,
    FIELD_ALIKE,
    FIELD_S,
    FORCE_ALIKE,
    FORCE_M_S2,
    GYR_BIAS,
    GYR_DRIFT,
    GYR_MATRIX,
    KNOTS,
    LAG,
    LEAN,
    MAG,
    MAG_BIAS,
    MAG_MATRIX,
    RATE,
    Estimate,
    MotionEquations,
    Rows,
)
from imud.calibration.magnetometer import MagFit
from imud.calibration.recording import SensorRecording
from imud.calibration.score import ATTITUDES, TILT_TO_HEADING, tilt_errors
from imud.rotation import FloatArray

LEAST_S = 15.0
LEVEL_MIN_UT = 5.0  # of a field that shows a heading

WEIGHINGS = 5  # in each round
# One sigma of what turns the frame between two knots and no parameter explains, by
# round: errors of second order are large at first.
WALK_RAD = np.radians([2.0, 1.0, 0.4, 0.3])
FAR_WALK_RAD = np.radians([8.0, 4.0, 2.0, 2.0, 1.0, 0.4, 0.3, 0.3])
USUAL_M_S2 = 0.25  # of the bias of an uncalibrated accelerometer
REST_RAD_S = math.radians(0.03)  # of the bias that a rest shows
DRIFT_RAD_S2 = math.radians(0.004)
# Beyond so many sigmas of its bias, or such a force, a die may be a bad one.
EXPECTED, EXPECTED_M_S2 = 1.5, 0.15
BLOCK_S = 8.0  # over which a field's residual should average out
ARM_M, FIELD_SD_UT = 0.1, 60.0
LAG_SD_S, LAG_MAX_S = 0.008, 0.03


@dataclass(frozen=True, slots=True)
class Priors:
    """One-sigma errors before the fit; by default those of uncalibrated sensors."""

    acc_m_s2: float = USUAL_M_S2  # of a bias
    acc_scale: float = 0.01
    gyr_scale: float = 0.01
    gyr_cross: float = 0.005
    mag_ut: float = 25.0
    mag_soft: float = 0.03
    mag_turn_rad: float = math.radians(1.2)  # of the die against the other one
    rest_rad_s: float = REST_RAD_S  # of the gyroscope's bias

    @property
    def bad(self) -> Priors | None:
        """Errors of a die that is far outside its data sheet, as in accelerometer.py;
        None if it is calibrated.
        """
        if self.acc_m_s2 < USUAL_M_S2:
            return None
        bias, scale, _ = BAD[[0, 3, 6]]
        return replace(self, acc_m_s2=float(bias), acc_scale=float(scale))


@dataclass(frozen=True, slots=True)
class MotionFit:
    """True vector = matrix @ (reading - bias) for each sensor."""

    acc: AccFit
    gyr: Affine  # of no bias: that is the filter's
    mag: MagFit
    tilt_deg: float  # one-sigma errors to expect, over all attitudes
    field_deg: float  # of heading: the magnetometer's part
    arm_m: FloatArray  # from the pivot to the sensor, in the body
    force_m_s2: float  # what the mean force of an axis is off, robustly

    @property
    def heading_deg(self) -> float:
        """With the tilt's part."""
        return math.hypot(TILT_TO_HEADING * self.tilt_deg, self.field_deg)


def _prior(
    known: Priors, motion: MotionEquations, walk_rad: float
) -> tuple[FloatArray, FloatArray]:
    """Rows of the priors, over their sigmas, and their expected values."""
    knots = len(motion.knots)
    sigmas = np.ones(KNOTS)
    sigmas[ACC_BIAS] = known.acc_m_s2
    sigmas[ACC_MATRIX] = [*[known.acc_scale] * 3, *[known.acc_scale / 2.0] * 3]
    gyr = np.full((3, 3), known.gyr_cross)
    np.fill_diagonal(gyr, known.gyr_scale)
    sigmas[GYR_MATRIX] = gyr.ravel()
    sigmas[GYR_BIAS], sigmas[GYR_DRIFT] = known.rest_rad_s, DRIFT_RAD_S2
    sigmas[MAG_BIAS], sigmas[LAG] = known.mag_ut, LAG_SD_S
    sigmas[FIELD], sigmas[ARM] = FIELD_SD_UT, ARM_M
    rows = np.diag(1.0 / sigmas)
    rows[MAG_MATRIX, MAG_MATRIX] = _soft_rows(known)
    walk = np.zeros((3 * knots, KNOTS + 3 * knots))
    for at, row in enumerate(walk):
        row[KNOTS + at] = 1.0 / walk_rad
        if at >= 3:
            row[KNOTS + at - 3] = -1.0 / walk_rad
    # The first attitude is the frame itself.
    walk[:3] *= walk_rad / math.radians(0.01)
    away = -rows @ motion.estimate.moved()
    rows = np.concatenate([rows, np.zeros((KNOTS, 3 * knots))], axis=1)
    return np.concatenate([rows, walk]), np.append(away, np.zeros(3 * knots))


def _soft_rows(known: Priors) -> FloatArray:
    """Of the matrix's symmetric part by soft iron, of the other by the die's turn."""
    rows = np.zeros((9, 9))
    for axis in range(3):
        rows[axis, 4 * axis] = 1.0 / known.mag_soft
        one, other = 3 * axis + (axis + 1) % 3, 3 * ((axis + 1) % 3) + axis
        rows[3 + axis, [one, other]] = math.sqrt(0.5) / known.mag_soft
        rows[6 + axis, [one, other]] = (
            0.5 / known.mag_turn_rad,
            -0.5 / known.mag_turn_rad,
        )
    return rows


def _rounds(
    motion: MotionEquations, known: Priors
) -> Iterator[tuple[Rows, Rows, FloatArray]]:
    """Each round's equations, and the covariance; the estimate is moved on."""
    is_far = known.acc_m_s2 > USUAL_M_S2 or known.rest_rad_s > REST_RAD_S
    for at, walk_rad in enumerate(FAR_WALK_RAD if is_far else WALK_RAD):
        force, readings = motion.equations()
        if at == 0:
            # At first readings are wrong by more than a turn of the frame explains.
            readings.slopes[..., RATE] = readings.slopes[..., KNOTS:] = 0.0
        prior = _prior(known, motion, float(walk_rad))
        step: FloatArray | None = None
        information = np.eye(1)
        for _ in range(WEIGHINGS):
            parts = [force.weighted(step), readings.weighted(step), prior]
            slopes, away = (np.concatenate(each) for each in zip(*parts, strict=True))
            information = slopes.T @ slopes
            right = slopes.T @ away
            motion.step = step = np.asarray(np.linalg.solve(information, right))
        values = motion.estimate.values
        values += motion.step[:KNOTS]
        values[LEAN] = 0.0  # found again each time
        values[LAG] = np.clip(values[LAG], 0.0, LAG_MAX_S)
        yield force, readings, np.asarray(np.linalg.inv(information))


def fit(
    recording: SensorRecording,
    rest_rad_s: FloatArray,
    rest_step: float,
    known: Priors | None = None,
) -> MotionFit | None:
    """The calibration of all three sensors by a recording in motion; None if it does
    not determine them. `rest_rad_s`: the gyroscope's bias at a rest, at that step of
    the recording or before it.
    """
    is_mag = np.isfinite(recording.mag[:, 0]) if len(recording) else np.zeros(0)
    if recording.seconds < LEAST_S or is_mag.sum() < LEAST_S or recording.breaks:
        return None
    known = known or Priors()
    motion = MotionEquations(recording, rest_step, Estimate(np.asarray(rest_rad_s)))
    usual = _fit(motion, known)
    bad = known.bad
    if usual is None or bad is None or _is_expected(usual, known):
        return usual
    motion = MotionEquations(recording, rest_step, Estimate(np.asarray(rest_rad_s)))
    other = _fit(motion, bad)
    return usual if other is None or _cost(usual, known) <= _cost(other, bad) else other


def _fit(motion: MotionEquations, known: Priors) -> MotionFit | None:
    try:
        for force, readings, covariance in _rounds(motion, known):
            last = force, readings, covariance
    except np.linalg.LinAlgError:
        return None
    return _found(motion, *last) if np.isfinite(motion.estimate.values).all() else None


def _is_expected(found: MotionFit, known: Priors) -> bool:
    """Whether nothing indicates a die outside its data sheet."""
    is_near = float(np.abs(found.acc.bias).max()) < EXPECTED * known.acc_m_s2
    return is_near and found.force_m_s2 < EXPECTED_M_S2


def _cost(found: MotionFit, known: Priors) -> float:
    """Twice the logarithm of how unlikely force and bias are."""
    count = 3.0 * len(found.acc.residual) / FORCE_ALIKE
    moved = float((found.acc.bias**2).sum()) / known.acc_m_s2**2
    return (
        2.0 * count * math.log(found.force_m_s2)
        + moved
        + 6.0 * math.log(known.acc_m_s2)
    )


def _excess(rows: Rows, motion: MotionEquations) -> float:
    """The ratio of the residual to the noise of most means, at least 1: where some fit
    badly, as after a magnet was put on, the fit is less certain than its covariance.
    """
    left = rows.left(motion.step)
    return max(1.0, math.sqrt(float((left**2).mean())) / rows.noise(left))


def _lasting(readings: Rows, motion: MotionEquations) -> float:
    """The growth of the error of the field's part because residuals are correlated for
    longer than FIELD_ALIKE, at least 1: in the frame, where a room is uneven, or in the
    body, after a magnet was put on.
    """
    left = readings.left(motion.step)
    block = round(BLOCK_S / FIELD_S)
    count = len(left) // block
    if count < 2:
        return 1.0
    body = np.einsum("kji,kj->ki", motion.attitude[motion.field_means.at], left)
    whole = float((left**2).sum(axis=1).mean())
    inflation = 1.0
    for rows in (left, body):
        means = rows[: count * block].reshape(count, block, 3).mean(axis=1)
        inflation = max(inflation, block * float((means**2).sum(axis=1).mean()) / whole)
    return math.sqrt(max(1.0, inflation / FIELD_ALIKE))


def _field_deg(mag: MagFit, covariance: FloatArray) -> float:
    """The rms error of heading over all attitudes that the magnetometer makes, by the
    covariance of its bias and matrix. A scale of all axes turns no heading.
    """
    into_body = np.swapaxes(ATTITUDES, 1, 2)
    readings = row_slopes(into_body @ mag.field)
    of_bias = np.broadcast_to(-mag.matrix, (len(ATTITUDES), 3, 3))
    slopes = np.concatenate([of_bias, readings], axis=2)
    # The level field points along x: what is across turns the heading.
    turned = np.einsum("ti,tij->tj", into_body[:, :, 1], slopes) / mag.level_ut
    variance = np.einsum("tj,jk,tk->t", turned, covariance, turned)
    return math.degrees(math.sqrt(float(variance.mean())))


def _found(
    motion: MotionEquations, force: Rows, readings: Rows, covariance: FloatArray
) -> MotionFit | None:
    values = motion.estimate.values
    upward = float(values[FIELD] @ motion.up)
    level_ut = float(np.linalg.norm(values[FIELD] - upward * motion.up))
    if level_ut < LEVEL_MIN_UT:
        return None
    acc = AccFit(
        np.eye(3) - symmetric(values[ACC_MATRIX]),
        values[ACC_BIAS].copy(),
        covariance[:9, :9],
        np.linalg.norm(force.away, axis=1),
        _excess(force, motion),
    )
    mag = MagFit(
        np.eye(3) + motion.soft(),
        values[MAG_BIAS].copy(),
        np.array([level_ut, 0.0, upward]),
        float(values[LAG]),
        covariance[MAG_BIAS, MAG_BIAS],
        readings.away,
        np.ones(len(readings.away)),
    )
    field_deg = _field_deg(mag, covariance[MAG, MAG])
    field_deg *= _excess(readings, motion) * _lasting(readings, motion)
    gyr = Affine(np.eye(3) + values[GYR_MATRIX].reshape(3, 3), np.zeros(3))
    return MotionFit(
        acc,
        gyr,
        mag,
        tilt_errors(acc)[0],
        field_deg,
        values[ARM].copy(),
        max(FORCE_M_S2, float(np.median(acc.residual)) / MEDIAN),
    )
