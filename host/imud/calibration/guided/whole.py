# SPDX-License-Identifier: MIT
"""All three sensors at once from one recording of stops and turns."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from imud.calibration import accelerometer, gyroscope, joint, magnetometer, path
from imud.calibration.accelerometer import AccFit
from imud.calibration.algebra import units
from imud.calibration.gyroscope import GyrFit
from imud.calibration.magnetometer import MagFit, Readings
from imud.calibration.noise import density
from imud.calibration.recording import SensorRecording
from imud.calibration.score import CalibrationScore, score
from imud.calibration.stops import StaticInterval, find_stops
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

STOPS_MIN = 4  # with fewer there is nothing to fit


@dataclass(frozen=True, slots=True)
class ModuleFit:
    """The fits of one recording. `mag` is None without readings that determine it."""

    stops: tuple[StaticInterval, ...]
    acc: AccFit
    gyr: GyrFit
    mag: MagFit | None
    up: FloatArray  # (k, 3) unit vectors: where up is in the body, of each stop
    score: CalibrationScore
    step_s: float  # of the recording
    temperature_c: float | None
    noise: dict[str, float | None]  # densities of acc and gyr, where they are known


def fit(
    recording: SensorRecording, stops: list[StaticInterval] | None = None
) -> ModuleFit | None:
    """The calibration of a recording; None with fewer than STOPS_MIN stops. `stops`:
    those to use, else all that are found.
    """
    if stops is None:
        stops = find_stops(recording)
    if len(stops) < STOPS_MIN:
        return None
    readings, sigma = accelerometer.means(recording, stops)
    acc = accelerometer.fit(readings, sigma)
    acc = joint.refined(recording, stops, readings, sigma, acc)
    up = units(acc.force(readings))
    gyr = gyroscope.fit(recording, stops, up, sigma / GRAVITY_M_S2)
    middles = np.array([stop.middle for stop in stops])
    attitude = path.levelled(gyr.attitude, middles, up)[:-1]
    broken = [
        0.0 if recording.is_whole(int(start), int(end)) else 1.0
        for start, end in itertools.pairwise(middles)
    ]
    mag = magnetometer.fit(
        Readings.of(recording, attitude, gyr.rate),
        middles * recording.step_s,
        np.array(broken),
    )
    return ModuleFit(
        tuple(stops),
        acc,
        gyr,
        mag,
        up,
        score(acc, mag, len(stops)),
        recording.step_s,
        recording.temperature_c,
        {
            name: density((values[s.start : s.end] for s in stops), recording.step_s)
            for name, values in (("acc", recording.acc), ("gyr", recording.gyr))
        },
    )
