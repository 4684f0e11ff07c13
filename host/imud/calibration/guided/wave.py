# SPDX-License-Identifier: MIT
"""The magnetometer from free motion, with the aid of accelerometer and gyroscope: wave
the probe about, in all directions.

The gyroscope carries the attitude. Force, turned into that almost inertial frame and
averaged over some seconds, is gravity: motion averages out.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field

import numpy as np

from imud.calibration import magnetometer, path
from imud.calibration.affine import Affine
from imud.calibration.algebra import integrated, units
from imud.calibration.faults import CalibrationFault, of_field, of_magnets
from imud.calibration.magnetometer import MagFit, Readings
from imud.calibration.recording import (
    Gatherer,
    IntArray,
    Sample,
    Scale,
    SensorRecording,
)
from imud.calibration.score import HEADING_MAX_DEG, TILT_TO_HEADING, field_deg
from imud.calibration.stops import find_stops
from imud.rotation import FloatArray

LEAST_S = 10.0
AVERAGE_S = 3.0  # of the force, to find gravity
KNOT_S = 1.0  # between two corrections of the level
ALIKE_S = 4.0  # errors of an uneven field stay alike for so long


@dataclass(frozen=True, slots=True)
class Wave:
    """What a wave says of the magnetometer."""

    mag: MagFit
    heading_deg: float  # error to expect, with the tilt's part
    field_deg: float  # the magnetometer's part


def fit(
    recording: SensorRecording, acc: Affine, gyr: Affine, tilt_deg: float
) -> Wave | None:
    """The magnetometer's calibration in the frame of calibrated force and rate; None if
    the recording does not determine one. `tilt_deg`: how well the force is known.
    """
    if recording.seconds < LEAST_S:
        return None
    rate = gyr.apply(recording.gyr) - _rest_bias(recording, gyr)
    attitude = integrated(rate, recording.step_s)[:-1]
    known, up = _levels(attitude, acc.apply(recording.acc), recording.step_s)
    attitude = path.levelled(attitude, known, up)
    knots = np.append(np.arange(0.0, recording.seconds, ALIKE_S), recording.seconds)
    steps = np.minimum(knots / recording.step_s, len(recording) - 1).astype(int)
    broken = [
        0.0 if recording.is_whole(int(start), int(end)) else 1.0
        for start, end in itertools.pairwise(steps)
    ]
    readings = Readings.of(recording, attitude, rate)
    found = magnetometer.fit(readings, knots, np.array(broken))
    if found is None:
        return None
    # Two knots for each stop and move of the score's count.
    own = field_deg(found, len(knots) // 2 + 1)
    return Wave(found, math.hypot(TILT_TO_HEADING * tilt_deg, own), own)


def weakness(wave: Wave | None) -> CalibrationFault | None:
    """Why a wave is not good enough; None if it is."""
    if wave is None:
        return CalibrationFault(
            "too_short", "there is too little to go by", "wave it for half a minute"
        )
    if wave.heading_deg <= HEADING_MAX_DEG:
        return of_magnets(wave.mag)
    return of_field(wave.mag, wave.heading_deg) or CalibrationFault(
        "weak_heading",
        f"heading would be +-{wave.heading_deg:.1f} degrees",
        "turn it further: on its head, on each side",
    )


def _rest_bias(recording: SensorRecording, gyr: Affine) -> FloatArray:
    """What the calibrated rate is at rest; zero if it never rested."""
    stops = find_stops(recording)
    if not stops:
        return np.zeros(3)
    rests = [gyr.apply(recording.gyr[stop.start : stop.end]) for stop in stops]
    return np.asarray(np.concatenate(rests).mean(axis=0))


def _levels(
    attitude: FloatArray, force: FloatArray, step_s: float
) -> tuple[IntArray, FloatArray]:
    """Steps at which the level is known, and where up is in the body there."""
    inertial = np.einsum("tij,tj->ti", attitude, force)
    width = max(1, round(AVERAGE_S / step_s))
    window = np.hanning(2 * width + 1)[1:-1]
    known = np.arange(0, len(force), max(1, round(KNOT_S / step_s)))
    weights = np.convolve(np.ones(len(force)), window, "same")
    smooth = [np.convolve(inertial[:, axis], window, "same") for axis in range(3)]
    mean = np.stack(smooth, axis=1)[known] / weights[known, None]
    return known, units(np.einsum("kji,kj->ki", attitude[known], mean))


JUDGED_S, LONGEST_S = 20.0, 60.0  # of waving: when it is judged first and last
EVERY_S = 5.0
DONE_DEG = 1.0  # good enough to stop


@dataclass(slots=True)
class Waving:
    """Collects a wave until it is good; no I/O. `acc`, `gyr`: the calibrations in
    force for readings in nominal units.
    """

    scale: Scale
    acc: Affine
    gyr: Affine
    tilt_deg: float
    wave: Wave | None = None
    _gatherer: Gatherer = field(init=False)
    _judged_s: float = JUDGED_S - EVERY_S

    def __post_init__(self) -> None:
        self._gatherer = Gatherer(self.scale)

    @property
    def seconds(self) -> float:
        """How much it has heard."""
        return len(self._gatherer) * self._gatherer.step_s

    @property
    def temperature_c(self) -> float | None:
        """The mean of the die."""
        return self._gatherer.recording().temperature_c

    def feed(self, sample: Sample) -> Wave | CalibrationFault | None:
        """Takes a sample; what came of it once it is over."""
        self._gatherer.add(sample)
        if self.seconds < self._judged_s + EVERY_S:
            return None
        self._judged_s = self.seconds
        self._fit()
        if self.wave is not None and self.wave.heading_deg <= DONE_DEG:
            return self.end()
        return self.end() if self.seconds >= LONGEST_S else None

    def end(self) -> Wave | CalibrationFault:
        """What there is, judged."""
        self._fit()
        weak = weakness(self.wave)
        if weak is not None or self.wave is None:
            return weak or CalibrationFault(
                "too_short", "there is too little to go by", "go on"
            )
        return self.wave

    def _fit(self) -> None:
        recording = self._gatherer.recording()
        self.wave = fit(recording, self.acc, self.gyr, self.tilt_deg)

    @property
    def instruction(self) -> str:
        """What to do, and how good it is."""
        words = "Wave it about: on its head, on each side, slowly round and round."
        if self.wave is None:
            return words
        return f"{words} Heading +-{self.wave.heading_deg:.1f} degrees."
