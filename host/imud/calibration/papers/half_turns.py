# SPDX-License-Identifier: MIT
"""Offsets at rest and half turns on a level table: the thesis of 2016, sections 5.1 to
5.3.

A half turn about the vertical turns the Earth's horizontal field against the probe and
leaves its own: half of the sum is the probe's own (equation 5.1). The soft iron follows
from the faces in the same way as its tool has it: a face up and the same face down
differ by twice the vertical field, as that axis sees it.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from imud.calibration import gyroscope
from imud.calibration.affine import Affine, MethodError
from imud.calibration.algebra import units
from imud.calibration.papers import six_positions
from imud.calibration.papers.basics import (
    MethodResult,
    check_faces,
    faces,
    means,
    normalised,
)
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import StaticInterval
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

HALF_TURN = (math.radians(150.0), math.radians(210.0))

Pair = tuple[StaticInterval, StaticInterval]


def fit(recording: SensorRecording, stops: list[StaticInterval]) -> MethodResult:
    """All three sensors; MethodError if a position or a half turn is missing."""
    positions = faces(recording, stops)
    check_faces(positions)
    pairs = {name: _half_turn(recording, stops, own) for name, own in positions.items()}
    return MethodResult(
        accelerometer(recording, positions["+z"]),
        six_positions.gyroscope(recording, stops),
        magnetometer(recording, pairs),
    )


def accelerometer(recording: SensorRecording, level: list[StaticInterval]) -> Affine:
    """The offset with z up on a level table, equation 5: gravity is taken off z."""
    bias = means(recording.acc, level).mean(axis=0) - np.array([0, 0, GRAVITY_M_S2])
    return Affine(np.eye(3), bias)


def magnetometer(recording: SensorRecording, pairs: dict[str, Pair]) -> Affine:
    """Offset by half turns with z up (x, y) and with z level (z), then the matrix."""
    mean = {
        name: means(recording.mag, list(pair)).mean(axis=0)
        for name, pair in pairs.items()
    }
    if not np.isfinite(list(mean.values())).all():
        raise MethodError("the magnetometer gave no readings")
    bias = np.array([*mean["+z"][:2], mean["+x"][2]])
    columns = [(mean[f"+{axis}"] - mean[f"-{axis}"]) / 2.0 for axis in "xyz"]
    felt = np.stack(columns, axis=1)
    if np.linalg.det(felt) < 0.0:
        felt = -felt  # the field points down
    return Affine(normalised(np.linalg.inv(felt)), bias)


def _half_turn(
    recording: SensorRecording, stops: list[StaticInterval], own: list[StaticInterval]
) -> Pair:
    """Two stops of a face with half a turn between them."""
    course = gyroscope.bias_course(recording, stops)
    for first, last in itertools.pairwise(own):
        between = slice(first.middle, last.middle)
        up = units(means(recording.acc, [first])[0])
        rate: FloatArray = recording.gyr[between] - course[between]
        angle = abs(float((rate @ up).sum()) * recording.step_s)
        if HALF_TURN[0] < angle < HALF_TURN[1]:
            return first, last
    raise MethodError(
        "turn the probe by 180 degrees on the spot on each of its six sides"
    )
