# SPDX-License-Identifier: MIT
"""Checks in ten seconds whether a calibration is still good: lay the probe still, turn
it over, lay it still.

It compares the length of gravity at each stop, the gyroscope's turn with
gravity's, and the field's strength and dip in each attitude.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Literal

import msgspec
import numpy as np

from imud.calibration.affine import Affine, affine_of
from imud.calibration.algebra import integrated, units
from imud.calibration.recording import Gatherer, Sample, Scale, SensorRecording
from imud.calibration.stops import StaticInterval, find_stops
from imud.gravity import GRAVITY_M_S2
from imud.params.value import Calibration, Params
from imud.rotation import FloatArray

SECONDS = 10.0
LONGEST_S = 30.0  # to wait for two stops
APART_RAD = math.radians(60.0)  # between two stops: closer ones show too little

# Limits of a good calibration.
TILT_GOOD_DEG = 0.5
HEADING_GOOD_DEG = 3.0
GYR_GOOD = 0.01  # of the turned angle


class SensorCheck(msgspec.Struct, frozen=True):
    """The verdict on one sensor."""

    sensor: str  # acc, gyr, mag
    verdict: Literal["good", "bad", "not calibrated", "not seen"]
    words: str


class Report(msgspec.Struct, frozen=True):
    """The verdict on a calibration."""

    findings: tuple[SensorCheck, ...]

    @property
    def is_good(self) -> bool:
        """Whether every sensor is calibrated and good."""
        return all(each.verdict == "good" for each in self.findings)


@dataclass(slots=True)
class Verify:
    """Collects samples until a verdict is possible; no I/O."""

    scale: Scale
    params: Params
    has_mag: bool = True
    _gatherer: Gatherer = field(init=False)
    _looked: int = 0

    def __post_init__(self) -> None:
        self._gatherer = Gatherer(self.scale)

    @property
    def seconds(self) -> float:
        """The seconds of samples so far."""
        return len(self._gatherer) * self._gatherer.step_s

    def feed(self, sample: Sample) -> Report | None:
        """Takes a sample; the report once there is one."""
        self._gatherer.add(sample)
        if len(self._gatherer) - self._looked < 0.5 / self._gatherer.step_s:
            return None
        self._looked = len(self._gatherer)
        if self.seconds < SECONDS:
            return None
        recording = self._gatherer.recording()
        is_seen = _are_apart(recording, find_stops(recording))
        if is_seen or self.seconds >= LONGEST_S:
            return report(recording, self.scale, self.params, has_mag=self.has_mag)
        return None

    @property
    def instruction(self) -> str:
        """The next instruction."""
        recording = self._gatherer.recording()
        stops = find_stops(recording)
        if not stops:
            return "Lay it still."
        if not _are_apart(recording, stops):
            return "Good. Now turn it over and lay it still again."
        return "Good. Keep it still."


def _are_apart(recording: SensorRecording, stops: list[StaticInterval]) -> bool:
    if len(stops) < 2:
        return False
    ups = _ups(recording.acc, stops)
    return bool((ups @ ups.T).min() < math.cos(APART_RAD))


def _ups(acc: FloatArray, stops: list[StaticInterval]) -> FloatArray:
    return units(np.array([acc[stop.start : stop.end].mean(axis=0) for stop in stops]))


def report(
    recording: SensorRecording, scale: Scale, params: Params, *, has_mag: bool = True
) -> Report:
    """The verdict of a recording on a calibration."""
    stops = find_stops(recording)
    is_seen = _are_apart(recording, stops)
    acc = affine_of(params.acc, scale.acc_m_s2).apply(recording.acc)
    # Every start measures the bias again, at rest: the first stop does so here.
    gyr = affine_of(params.gyr, scale.gyr_rad_s)
    mag = affine_of(params.mag, scale.mag_ut).apply(recording.mag)
    findings = [
        _finding("acc", params.acc, _of_acc(acc, stops) if is_seen else None),
        _finding(
            "gyr",
            params.gyr,
            _of_gyr(recording, gyr, _ups(acc, stops), stops) if is_seen else None,
        ),
    ]
    if has_mag:
        found = _of_mag(mag, acc, stops, params.mag) if is_seen else None
        findings.append(_finding("mag", params.mag, found))
    return Report(tuple(findings))


Judged = tuple[bool, str]


def _finding(sensor: str, of: Calibration | None, found: Judged | None) -> SensorCheck:
    if of is None:
        return SensorCheck(sensor, "not calibrated", "imud calibrate PROBE")
    if found is None:
        return SensorCheck(sensor, "not seen", "it was not laid still in two attitudes")
    is_good, words = found
    return SensorCheck(sensor, "good" if is_good else "bad", words)


def _of_acc(acc: FloatArray, stops: list[StaticInterval]) -> Judged:
    lengths = [
        float(np.linalg.norm(acc[stop.start : stop.end].mean(axis=0))) for stop in stops
    ]
    off = max(abs(length - GRAVITY_M_S2) for length in lengths)
    tilt_deg = math.degrees(off / GRAVITY_M_S2)
    words = (
        f"gravity is off by {off / GRAVITY_M_S2 * 1000.0:.1f} mg at most, "
        f"a tilt error of {tilt_deg:.2f} degrees"
    )
    return tilt_deg < TILT_GOOD_DEG, words


def _of_gyr(
    recording: SensorRecording,
    gyr: Affine,
    ups: FloatArray,
    stops: list[StaticInterval],
) -> Judged:
    rest = stops[0]
    bias = recording.gyr[rest.start : rest.end].mean(axis=0)
    rate = (recording.gyr - bias) @ gyr.matrix.T
    attitude = integrated(rate, recording.step_s)
    worst, share = 0.0, 0.0
    for index, (first, last) in enumerate(itertools.pairwise(stops)):
        before = attitude[first.middle] @ ups[index]
        after = attitude[last.middle] @ ups[index + 1]
        off = math.acos(float(np.clip(before @ after, -1.0, 1.0)))
        between = rate[first.middle : last.middle]
        turned = float(np.linalg.norm(between, axis=1).sum() * recording.step_s)
        # The uncertainty of gravity itself does not count.
        allowed = GYR_GOOD * turned + math.radians(TILT_GOOD_DEG)
        if off / allowed > share:
            worst, share = off, off / allowed
    words = f"after a turn gravity is off by {math.degrees(worst):.2f} degrees at most"
    return share < 1.0, words


def _of_mag(
    mag: FloatArray,
    acc: FloatArray,
    stops: list[StaticInterval],
    of: Calibration | None,
) -> Judged | None:
    norms, dips, dip_deg = [], [], of.dip_deg if of is not None else None
    for stop in stops:
        field = mag[stop.start : stop.end]
        field = field[np.isfinite(field[:, 0])]
        if len(field) == 0:
            return None
        mean, up = field.mean(axis=0), units(acc[stop.start : stop.end].mean(axis=0))
        norms.append(float(np.linalg.norm(mean)))
        dips.append(math.asin(float(np.clip(-units(mean) @ up, -1.0, 1.0))))
    level = math.cos(float(np.mean(dips)))
    # The error across the field turns the heading by its share of the level part.
    spread = max(np.ptp(norms) / np.mean(norms), np.ptp(dips)) / 2.0
    heading_deg = math.degrees(float(spread) / max(level, 0.1))
    words = (
        f"the field is {min(norms):.1f} to {max(norms):.1f} uT and dips by "
        f"{math.degrees(min(dips)):.1f} to {math.degrees(max(dips)):.1f} degrees: "
        f"a heading error of about {heading_deg:.1f} degrees"
    )
    if of is not None and of.norm_ut:
        change = float(np.mean(norms)) / of.norm_ut - 1.0
        if abs(change) > 0.1:
            words += f"; it changed by {100.0 * change:+.0f} % since calibration"
        if dip_deg is not None and abs(change) > 0.1:
            words += ": another place, or iron nearby"
    return heading_deg < HEADING_GOOD_DEG, words
