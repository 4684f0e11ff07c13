# SPDX-License-Identifier: MIT
"""What a calibration puts into the params of a probe, and what to know of it."""

from __future__ import annotations

import datetime
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from imud.calibration.affine import Affine
from imud.calibration.algebra import closest_turn
from imud.calibration.earth import Earth, strangeness
from imud.calibration.guided.wave import Wave
from imud.calibration.guided.whole import Fit
from imud.calibration.magnetometer import MagFit
from imud.calibration.recording import GRAVITY_M_S2, Scale
from imud.calibration.tip_found import TipFound
from imud.params.value import Calibration, Params, Tip
from imud.rotation import FloatArray

SENSORS = ("acc", "gyr", "mag")
GYR_SIGMA_MIN = 1e-4  # what no turn of half a minute shows
HOUSING_MAX_RAD = math.radians(15.0)  # of an old one that is kept
# The wire's largest residuals, m/s2 and rad.
ACC_RESIDUAL_MAX, GYR_RESIDUAL_MAX = 6.5, 0.65
TIP_SIGMA_MAX_M = 0.65  # the wire's largest


@dataclass(frozen=True, slots=True)
class Outcome:
    """New params, and what was found on the way."""

    params: Params
    sensors: tuple[str, ...]  # those that are calibrated anew
    poses: int = 0
    seconds: float = 0.0
    temperature_c: float | None = None
    tilt_deg: float | None = None  # one-sigma errors to expect
    heading_deg: float | None = None
    level_ut: float | None = None  # of the field; the heading's error scales with it
    housing_deg: float | None = None  # by how much the sensor is turned in its housing
    note: str | None = None  # what is strange about the room
    tip: TipFound | None = None


def of_fit(
    fit: Fit,
    scale: Scale,
    before: Params,
    turn: FloatArray | None = None,
    day: datetime.date | None = None,
    sensors: tuple[str, ...] = SENSORS,
    earth: Earth | None = None,
) -> Outcome:
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
    params.check()
    last = fit.stops[-1]
    return Outcome(
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


def of_wave(
    wave: Wave,
    scale: Scale,
    before: Params,
    temperature_c: float | None = None,
    day: datetime.date | None = None,
) -> Outcome:
    """The params before with the magnetometer of a wave. It was found in the frame of
    the calibrated accelerometer, so it has the housing's turn in it.
    """
    made = {"temperature_c": temperature_c, "day": day, "method": "wave"}
    params = with_mag(before, wave.mag, wave.field_deg, np.eye(3), scale, made)
    params.check()
    return Outcome(
        params,
        ("mag",),
        temperature_c=temperature_c,
        heading_deg=wave.heading_deg,
        level_ut=wave.mag.level_ut,
    )


def of_tip(
    found: TipFound, before: Params, day: datetime.date | None = None
) -> Outcome:
    """The params before with this tip; what it does not tell stays as it is."""
    old = before.tip or Tip()
    values: dict[str, object] = {
        "offset_m": old.offset_m,
        "sigma_m": old.sigma_m,
        "axis": old.axis if found.axis is None else found.axis.tolist(),
        "day": day,
        "method": found.method,
    }
    if found.offset_m is not None:
        sigma_m = found.sigma_m
        values["offset_m"] = found.offset_m.tolist()
        values["sigma_m"] = sigma_m and min(sigma_m, TIP_SIGMA_MAX_M)
    params = before.replaced("tip", values)
    params.check()
    return Outcome(params, (), seconds=found.seconds, tip=found)


def with_mag(
    params: Params,
    mag: MagFit,
    field_deg: float,
    into: FloatArray,
    scale: Scale,
    made: dict[str, Any],
) -> Params:
    """The params with the record of the magnetometer, turned `into` the housing."""
    own = {
        "sigma_uT": math.radians(field_deg) * mag.level_ut,
        "residual_uT": mag.residual_ut,
        "norm_uT": mag.norm_ut,
        "dip_deg": mag.dip_deg,
        "lag_s": mag.lag_s,
    }
    affine = Affine(into @ mag.matrix, mag.bias)
    return with_sensor(params, "mag", affine, scale, made | own)


_LIMITS = {"residual_m_s2": ACC_RESIDUAL_MAX, "residual_rad": GYR_RESIDUAL_MAX}


def with_sensor(
    params: Params, name: str, affine: Affine, scale: Scale, values: dict[str, Any]
) -> Params:
    """The params with the record of a sensor, with `values` by their keys; what a fit
    leaves over is at most what the wire can say.
    """
    unit = {"acc": scale.acc_m_s2, "gyr": scale.gyr_rad_s, "mag": scale.mag_ut}[name]
    shown = {
        key: min(value, _LIMITS[key]) if key in _LIMITS else value
        for key, value in values.items()
    }
    return params.replaced(
        name,
        {
            **shown,
            "bias_counts": (affine.bias / unit).tolist(),
            "matrix": affine.matrix.tolist(),
        },
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
