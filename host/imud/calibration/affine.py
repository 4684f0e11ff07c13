# SPDX-License-Identifier: MIT
"""One sensor's calibration as the papers' methods give it, and how stops are told apart
for them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from imud.calibration import poses
from imud.calibration.algebra import units
from imud.calibration.poses import FACES
from imud.calibration.recording import Recording
from imud.calibration.stops import Stop
from imud.errors import ImudError
from imud.params.value import Calibration
from imud.rotation import FloatArray

FACE_MAX_RAD = math.radians(30.0)  # between a stop and the face that it shows


class MethodError(ImudError):
    """A recording lacks what a method needs."""


@dataclass(frozen=True, slots=True)
class Affine:
    """True vector = matrix @ (reading - bias), in the unit of the readings. `sigma` is
    the noise of each axis at rest, if the method uses it.
    """

    matrix: FloatArray
    bias: FloatArray
    sigma: FloatArray | None = None

    def apply(self, readings: FloatArray) -> FloatArray:
        """Of readings, shape (..., 3)."""
        return np.asarray((readings - self.bias) @ self.matrix.T)

    def silenced(self, readings: FloatArray) -> FloatArray:
        """The same; values within three sigma of zero become zero."""
        values = self.apply(readings)
        if self.sigma is None:
            return values
        return np.where(np.abs(values) < 3.0 * self.sigma, 0.0, values)


def affine_of(of: Calibration | None, unit: float) -> Affine:
    """A calibration of the params for readings in nominal units, which are counts times
    `unit`; none: as read.
    """
    if of is None:
        return Affine(np.eye(3), np.zeros(3))
    return Affine(np.array(of.matrix), np.array(of.bias_counts) * unit)


@dataclass(frozen=True, slots=True)
class Found:
    """What a method makes of a recording; None: it does not calibrate that sensor."""

    acc: Affine | None = None
    gyr: Affine | None = None
    mag: Affine | None = None


def normalised(matrix: FloatArray) -> FloatArray:
    """The same matrix with the determinant 1; MethodError if that can't be."""
    size = float(np.linalg.det(matrix))
    if not math.isfinite(size) or size <= 0.0:
        raise MethodError("the readings are no ellipsoid: turn the probe further")
    return np.asarray(matrix / np.cbrt(size))


def means(readings: FloatArray, stops: list[Stop]) -> FloatArray:
    """The mean of each stop, shape (k, 3); NaN where there is no reading."""
    return np.array([_mean(readings[stop.start : stop.end]) for stop in stops])


def _mean(rows: FloatArray) -> FloatArray:
    there = rows[np.isfinite(rows[:, 0])]
    return there.mean(axis=0) if len(there) else np.full(3, math.nan)


def faces(recording: Recording, stops: list[Stop]) -> dict[str, list[Stop]]:
    """The stops of each of the six faces by its name (+z: base down), as far as they
    are near one.
    """
    found: dict[str, list[Stop]] = {poses.Pose(sign).name: [] for sign in FACES}
    for stop, mean in zip(stops, means(recording.acc, stops), strict=True):
        up = units(mean)
        for sign in FACES:
            face = poses.Pose(sign)
            if face.up @ up > math.cos(FACE_MAX_RAD):
                found[face.name].append(stop)
    return found


def check_faces(found: dict[str, list[Stop]]) -> None:
    """MethodError if a face was never up."""
    missing = [poses.Pose(s).words for s in FACES if not found[poses.Pose(s).name]]
    if missing:
        raise MethodError(f"six positions are needed; missing: {', '.join(missing)}")
