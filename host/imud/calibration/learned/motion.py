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
from dataclasses import dataclass, field, replace

import numpy as np

from imud.calibration.accelerometer import BAD, AccFit
from imud.calibration.affine import Affine
from imud.calibration.algebra import (
    MEDIAN,
    integrated,
    row_slopes,
    skew,
    symmetric,
    symmetric_slopes,
    units,
)
from imud.calibration.magnetometer import MagFit
from imud.calibration.recording import IntArray, SensorRecording
from imud.calibration.score import ATTITUDES, TILT_TO_HEADING, tilt_errors
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
    soft_sigma: float  # of an entry of the soft iron, the least certain one
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


def soft_of(matrix: FloatArray) -> FloatArray:
    """The part of a magnetometer's matrix that soft iron makes, less its mean scale."""
    even = (matrix + matrix.T) / 2.0
    return np.asarray(even - np.eye(3) * np.trace(even) / 3.0)


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
    inflation = _excess(readings, motion) * _lasting(readings, motion)
    field_deg = inflation * _field_deg(mag, covariance[MAG, MAG])
    shapes = np.array([soft_of(each) for each in np.eye(9).reshape(9, 3, 3)])
    shapes = shapes.reshape(9, 9)
    soft = np.diag(shapes.T @ covariance[MAG_MATRIX, MAG_MATRIX] @ shapes)
    soft_sigma = inflation * math.sqrt(float(soft.max()))
    gyr = Affine(np.eye(3) + values[GYR_MATRIX].reshape(3, 3), np.zeros(3))
    return MotionFit(
        acc,
        gyr,
        mag,
        tilt_errors(acc)[0],
        field_deg,
        soft_sigma,
        values[ARM].copy(),
        max(FORCE_M_S2, float(np.median(acc.residual)) / MEDIAN),
    )
