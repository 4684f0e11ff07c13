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

from imud.calibration import magnetometer, path, rate_bias
from imud.calibration.affine import Affine
from imud.calibration.algebra import integrated, units
from imud.calibration.faults import CalibrationFault, of_field, of_magnets
from imud.calibration.magnetometer import MagFit, Readings
from imud.calibration.mount import PLAIN, ModuleMount
from imud.calibration.recording import Gatherer, Sample, Scale, SensorRecording
from imud.calibration.score import HEADING_MAX_DEG, TILT_TO_HEADING, field_deg
from imud.calibration.stops import find_stops
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

LEAST_S = 10.0
# Beyond these the field is not the cause: of samples that are clipped; of an
# accelerometer; of the heading's limit that the level takes; of a gyroscope's bias.
CLIPPED_MAX, OFF_M_S2, LEVEL_SHARE, REST_DEG_S = 0.005, 0.4, 0.9, 0.5
SURE = 4.0  # sigmas
ALIKE_S = 4.0  # correlation time of an uneven field's errors


@dataclass(frozen=True, slots=True)
class Wave:
    """The magnetometer's calibration by a wave."""

    mag: MagFit
    heading_deg: float  # error to expect, with the tilt's part
    field_deg: float  # the magnetometer's part
    tilt_deg: float  # of the accelerometer
    rest_deg_s: float  # one-sigma error of the gyroscope's bias
    off_m_s2: float  # of the accelerometer, if the force shows that it is off


def fit(
    recording: SensorRecording, acc: Affine, gyr: Affine, tilt_deg: float
) -> Wave | None:
    """The magnetometer's calibration in the frame of calibrated force and rate; None if
    the recording does not determine one. `tilt_deg`: the error of the force's
    direction.
    """
    if recording.seconds < LEAST_S:
        return None
    rate, force = gyr.apply(recording.gyr), acc.apply(recording.acc)
    bias, bias_sigma = _bias(recording, rate, force)
    rate = rate - bias
    attitude = integrated(rate, recording.step_s)[:-1]
    inertial = np.einsum("tij,tj->ti", attitude, force)
    known, mean = rate_bias.averaged(inertial, recording.step_s)
    up = units(np.einsum("kji,kj->ki", attitude[known], mean))
    attitude = path.levelled(attitude, known, up)
    knots = np.append(np.arange(0.0, recording.seconds, ALIKE_S), recording.seconds)
    steps = np.minimum(knots / recording.step_s, len(recording) - 1).astype(int)
    broken = [
        0.0 if recording.is_whole(int(start), int(end)) else 1.0
        for start, end in itertools.pairwise(steps)
    ]
    readings = Readings.of(recording, attitude, rate)
    found = magnetometer.fit(readings, knots, np.array(broken), bias_sigma)
    if found is None:
        return None
    # Two knots for each stop and move of the score's count.
    own = field_deg(found, len(knots) // 2 + 1)
    return Wave(
        found,
        math.hypot(TILT_TO_HEADING * tilt_deg, own),
        own,
        tilt_deg,
        math.degrees(bias_sigma),
        _off(mean, up),
    )


def weakness(wave: Wave | None, clipped: float = 0.0) -> CalibrationFault | None:
    """Why a wave is not good enough; None if it is. `clipped`: the share of its samples
    in which a sensor was at the end of its range.
    """
    if wave is None:
        return CalibrationFault(
            "too_short", "there are too few samples", "wave it for half a minute"
        )
    if wave.heading_deg <= HEADING_MAX_DEG:
        return of_magnets(wave.mag.bias, wave.mag.norm_ut)
    return (
        _of_motion(wave, clipped)
        or of_field(wave.mag, wave.heading_deg)
        or CalibrationFault(
            "weak_heading",
            f"the heading error would be +-{wave.heading_deg:.1f} degrees",
            "turn it further: upside down, on each side",
        )
    )


def _of_motion(wave: Wave, clipped: float) -> CalibrationFault | None:
    """Faults of the attitude, which make an even field look uneven."""
    if clipped > CLIPPED_MAX:
        return CalibrationFault(
            "clipped",
            f"a sensor was at the end of its range in {clipped:.0%} of the samples",
            "wave it more slowly, and do not knock it",
        )
    level = TILT_TO_HEADING * wave.tilt_deg
    why = ""
    if wave.off_m_s2 > OFF_M_S2:
        off_mg = wave.off_m_s2 / GRAVITY_M_S2 * 1000.0
        why = f"the accelerometer is off by {off_mg:.0f} mg or more"
    elif level > HEADING_MAX_DEG * LEVEL_SHARE:
        why = (
            "the accelerometer is not calibrated: its tilt error of "
            f"+-{wave.tilt_deg:.1f} degrees alone turns the heading by +-{level:.1f}"
        )
    if why:
        cure = "calibrate all sensors together, which takes no longer: imud calibrate"
        return CalibrationFault("no_level", why, cure)
    if wave.rest_deg_s > REST_DEG_S:
        return CalibrationFault(
            "no_rest",
            "it never lay still, so the gyroscope's bias is known only to "
            f"{wave.rest_deg_s:.1f} deg/s",
            "lay it still for three seconds first",
        )
    return None


def _off(mean: FloatArray, up: FloatArray) -> float:
    """The bias of the accelerometer that the lengths of mean forces (k, 3) show, m/s2:
    they differ by as much of it as points up. 0 where motion explains as much.
    """
    away = np.linalg.norm(mean, axis=1) - GRAVITY_M_S2
    rows = np.column_stack([up, np.ones(len(up))])
    found, *_ = np.linalg.lstsq(rows, away, rcond=None)
    left = away - rows @ found
    freedom = max(len(rows) / rate_bias.ALIKE - 4.0, 1.0)
    noise = math.sqrt(float(left @ left) / len(rows) / freedom)
    size = float(np.linalg.norm(found[:3]))
    return size if size > SURE * noise else 0.0


def _bias(
    recording: SensorRecording, rate: FloatArray, force: FloatArray
) -> tuple[FloatArray, float]:
    """The calibrated rate at rest, and its one-sigma error, rad/s; if it never rested,
    the rate that keeps gravity constant.
    """
    stops = find_stops(recording)
    if not stops:
        return rate_bias.of_motion(rate, force, recording.step_s)
    rests = [rate[stop.start : stop.end] for stop in stops]
    return np.asarray(np.concatenate(rests).mean(axis=0)), 0.0


JUDGED_S, LONGEST_S = 20.0, 60.0  # of waving: when it is judged first and last
EVERY_S = 5.0
DONE_DEG = 1.0  # good enough to stop


@dataclass(slots=True)
class Waving:
    """Collects a wave until it is good; no I/O. `acc`, `gyr`: the active calibrations
    for readings in nominal units. `mount`: how the module is mounted, which they
    include.
    """

    scale: Scale
    acc: Affine
    gyr: Affine
    tilt_deg: float
    mount: ModuleMount = PLAIN
    wave: Wave | None = None
    _gatherer: Gatherer = field(init=False)
    _judged_s: float = JUDGED_S - EVERY_S

    def __post_init__(self) -> None:
        self._gatherer = Gatherer(self.scale)

    @property
    def seconds(self) -> float:
        """The seconds of samples so far."""
        return len(self._gatherer) * self._gatherer.step_s

    @property
    def temperature_c(self) -> float | None:
        """The mean of the die."""
        return self._gatherer.recording().temperature_c

    def feed(self, sample: Sample) -> Wave | CalibrationFault | None:
        """Takes a sample; returns the result once it is over."""
        self._gatherer.add(self.mount.sample(sample))
        if self.seconds < self._judged_s + EVERY_S:
            return None
        self._judged_s = self.seconds
        self._fit()
        if self.wave is not None and self.wave.heading_deg <= DONE_DEG:
            return self.end()
        return self.end() if self.seconds >= LONGEST_S else None

    def end(self) -> Wave | CalibrationFault:
        """Evaluates the samples so far."""
        self._fit()
        weak = weakness(self.wave, self._gatherer.clipped_share)
        if weak is not None or self.wave is None:
            return weak or CalibrationFault(
                "too_short", "there are too few samples", "keep waving it"
            )
        return self.wave

    def _fit(self) -> None:
        recording = self._gatherer.recording()
        acc, gyr = map(self.mount.of_turned, (self.acc, self.gyr))
        self.wave = fit(recording, acc, gyr, self.tilt_deg)

    @property
    def instruction(self) -> str:
        """The instruction, and the expected error so far."""
        words = "Wave it slowly in all directions: upside down, on each side."
        if self.wave is None:
            return words
        return f"{words} Heading error +-{self.wave.heading_deg:.1f} degrees."
