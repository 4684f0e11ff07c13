# SPDX-License-Identifier: MIT
"""The params that result from guided calibrations."""

from __future__ import annotations

import datetime
import math

import numpy as np

from imud.calibration.affine import Affine
from imud.calibration.algebra import closest_turn
from imud.calibration.drift import with_drift
from imud.calibration.earth import Earth, strangeness
from imud.calibration.guided.wave import Wave
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.noise import with_noise
from imud.calibration.recording import Scale
from imud.calibration.result import CalibrationResult, with_mag, with_sensor
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Calibration, Params
from imud.rotation import FloatArray

SENSORS = ("acc", "gyr", "mag")
GYR_SIGMA_MIN = 1e-4  # an error that turns of half a minute don't show
HOUSING_MAX_RAD = math.radians(15.0)  # of an old one that is kept


def result_of_fit(
    fit: ModuleFit,
    scale: Scale,
    before: Params,
    turn: FloatArray | None = None,
    day: datetime.date | None = None,
    sensors: tuple[str, ...] = SENSORS,
    earth: Earth | None = None,
) -> CalibrationResult:
    """The params before with new calibrations of these sensors. `turn`: from the
    sensor's frame into the housing's; None: as before. `earth`: the field of the place,
    which gives the magnetometer its scale if it was measured there.
    """
    into = housing_of(before.acc) if turn is None else turn
    made = {"temperature_c": fit.temperature_c, "day": day, "method": "guided"}
    params, done = before, []
    if "acc" in sensors:
        sigma = math.radians(fit.score.tilt_deg) * GRAVITY_M_S2 / math.sqrt(2.0)
        own = {"sigma_m_s2": sigma, "residual_m_s2": fit.acc.residual_m_s2}
        affine = Affine(into @ fit.acc.matrix, fit.acc.bias)
        params = with_sensor(params, "acc", affine, scale, made | own)
        params = with_drift(params, before.acc, scale.acc_m_s2)
        done.append("acc")
    if "gyr" in sensors or "gyro" in sensors:
        sigma = max(fit.gyr.sigma, GYR_SIGMA_MIN)
        own = {"sigma": sigma, "residual_rad": fit.gyr.residual_rad}
        affine = Affine(into @ fit.gyr.matrix, fit.gyr.bias)
        params = with_sensor(params, "gyr", affine, scale, made | own)
        done.append("gyr")
    mag, field_deg = fit.mag, fit.score.field_deg
    note = None
    if mag is not None and earth is not None and "mag" in sensors:
        note = strangeness(earth, mag.norm_ut, mag.dip_deg)
        mag = mag if note is not None else mag.scaled(earth.norm_uT / mag.norm_ut)
    if "mag" in sensors and mag is not None and field_deg is not None:
        params = with_mag(params, mag, field_deg, into, scale, made)
        done.append("mag")
    if not scale.is_sparse:
        noise = {name: each for name, each in fit.noise.items() if name in done}
        params = with_noise(params, noise)
    params.check()
    last = fit.stops[-1]
    return CalibrationResult(
        params,
        tuple(done),
        len(fit.stops),
        last.end * fit.step_s,
        fit.temperature_c,
        fit.score.tilt_deg,
        fit.score.heading_deg if "mag" in done else None,
        mag.level_ut if mag is not None and "mag" in done else None,
        None if turn is None else math.degrees(_angle(turn)),
        note,
    )


def result_of_wave(
    wave: Wave,
    scale: Scale,
    before: Params,
    temperature_c: float | None = None,
    day: datetime.date | None = None,
) -> CalibrationResult:
    """The params before with the magnetometer of a wave. It was found in the frame of
    the calibrated accelerometer, so it has the housing's turn in it.
    """
    made = {"temperature_c": temperature_c, "day": day, "method": "wave"}
    params = with_mag(before, wave.mag, wave.field_deg, np.eye(3), scale, made)
    params.check()
    return CalibrationResult(
        params,
        ("mag",),
        temperature_c=temperature_c,
        heading_deg=wave.heading_deg,
        level_ut=wave.mag.level_ut,
    )


def housing_of(before: Calibration | None) -> FloatArray:
    """How the accelerometer's calibration turns into the housing: the turn in its
    matrix. None, if there is no calibration or it turns by more than a module can be.
    """
    if before is None:
        return np.eye(3)
    matrix = np.array(before.matrix)
    if np.linalg.det(matrix) < 0.1:
        return np.eye(3)
    turn = closest_turn(matrix)
    return turn if _angle(turn) < HOUSING_MAX_RAD else np.eye(3)


def _angle(turn: FloatArray) -> float:
    return math.acos(float(np.clip((np.trace(turn) - 1.0) / 2.0, -1.0, 1.0)))
