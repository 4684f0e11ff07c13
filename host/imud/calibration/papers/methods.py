# SPDX-License-Identifier: MIT
"""The papers' methods on the same recordings as ours, each with its residuals."""

from __future__ import annotations

import datetime

import numpy as np

from imud.calibration.affine import Affine, MethodError
from imud.calibration.papers import extremes, half_turns, six_positions
from imud.calibration.papers.basics import MethodResult, means
from imud.calibration.recording import Scale, SensorRecording
from imud.calibration.result import CalibrationResult, with_sensor
from imud.calibration.stops import StaticInterval, find_stops
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Params

METHODS = ("positions", "extremes", "extremes-as-printed", "half-turns")


def of_method(
    recording: SensorRecording,
    method: str,
    scale: Scale,
    before: Params,
    day: datetime.date | None = None,
) -> CalibrationResult:
    """The params before with the result of one of the papers' METHODS.
    MethodError if it lacks what the method needs.
    """
    stops = find_stops(recording)
    found = by_method(recording, stops, method)
    kind = "extremes" if method.startswith("extremes") else "positions"
    made = {"temperature_c": recording.temperature_c, "day": day, "method": kind}
    params, done = before, []
    residuals = {
        "acc": ("residual_m_s2", _gravity_left(recording, stops, found.acc)),
        "mag": ("residual_uT", _field_left(recording, found.mag)),
    }
    for name, affine in (("acc", found.acc), ("gyr", found.gyr), ("mag", found.mag)):
        if affine is None:
            continue
        key, residual = residuals.get(name, ("", None))
        own = {key: residual} if residual is not None else {}
        params = with_sensor(params, name, affine, scale, made | own)
        done.append(name)
    params.check()
    return CalibrationResult(
        params,
        tuple(done),
        len(stops),
        recording.seconds,
        recording.temperature_c,
    )


def by_method(
    recording: SensorRecording, stops: list[StaticInterval], method: str
) -> MethodResult:
    """The result of one of METHODS."""
    if method == "positions":
        return six_positions.fit(recording, stops)
    if method == "half-turns":
        return half_turns.fit(recording, stops)
    there = recording.mag[np.isfinite(recording.mag[:, 0])]
    if len(there) == 0:
        raise MethodError("there are no magnetometer readings")
    is_printed = method == "extremes-as-printed"
    return MethodResult(mag=extremes.fit(there, as_printed=is_printed))


def _gravity_left(
    recording: SensorRecording, stops: list[StaticInterval], acc: Affine | None
) -> float | None:
    """Rms by which gravity's length is off at the stops, m/s2."""
    if acc is None:
        return None
    lengths = np.linalg.norm(acc.apply(means(recording.acc, stops)), axis=1)
    return float(np.sqrt(((lengths - GRAVITY_M_S2) ** 2).mean()))


def _field_left(recording: SensorRecording, mag: Affine | None) -> float | None:
    """Standard deviation of the field's strength, uT."""
    if mag is None:
        return None
    there = recording.mag[np.isfinite(recording.mag[:, 0])]
    return float(np.linalg.norm(mag.apply(there), axis=1).std())
