# SPDX-License-Identifier: MIT
"""Shared by the papers' methods: their result, and the distinction of stops."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration import poses
from imud.calibration.affine import Affine, MethodError
from imud.calibration.algebra import units
from imud.calibration.poses import FACES
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import StaticInterval
from imud.rotation import FloatArray

FACE_MAX_RAD = math.radians(30.0)  # between a stop and the face that it shows


@dataclass(frozen=True, slots=True)
class MethodResult:
    """A method's result; None: it does not calibrate that sensor."""

    acc: Affine | None = None
    gyr: Affine | None = None
    mag: Affine | None = None


def normalised(matrix: FloatArray) -> FloatArray:
    """The same matrix with the determinant 1; MethodError if that can't be."""
    size = float(np.linalg.det(matrix))
    if not math.isfinite(size) or size <= 0.0:
        raise MethodError("the readings form no ellipsoid: turn the probe further")
    return np.asarray(matrix / np.cbrt(size))


def means(readings: FloatArray, stops: list[StaticInterval]) -> FloatArray:
    """The mean of each stop, shape (k, 3); NaN where there is no reading."""
    return np.array([_mean(readings[stop.start : stop.end]) for stop in stops])


def _mean(rows: FloatArray) -> FloatArray:
    there = rows[np.isfinite(rows[:, 0])]
    return there.mean(axis=0) if len(there) else np.full(3, math.nan)


def faces(
    recording: SensorRecording, stops: list[StaticInterval]
) -> dict[str, list[StaticInterval]]:
    """The stops of each of the six faces by its name (+z: base down), as far as they
    are near one.
    """
    found: dict[str, list[StaticInterval]] = {
        poses.StaticPose(sign).name: [] for sign in FACES
    }
    for stop, mean in zip(stops, means(recording.acc, stops), strict=True):
        up = units(mean)
        for sign in FACES:
            face = poses.StaticPose(sign)
            if face.up @ up > math.cos(FACE_MAX_RAD):
                found[face.name].append(stop)
    return found


def check_faces(found: dict[str, list[StaticInterval]]) -> None:
    """MethodError if a face was never up."""
    missing = [
        poses.StaticPose(s).words for s in FACES if not found[poses.StaticPose(s).name]
    ]
    if missing:
        raise MethodError(f"six positions are needed; missing: {', '.join(missing)}")
