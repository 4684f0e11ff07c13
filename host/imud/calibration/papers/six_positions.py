# SPDX-License-Identifier: MIT
"""Calibration in six positions, and the ellipsoid: Rozanowski, Lewandowski and Placha,
"Determination of the Orientation of an Object within a 3D Space", equations 2 to 12
without the dead zones of 6 and 8, which would hide slow turns.
"""

from __future__ import annotations

import numpy as np

from imud.calibration.affine import Affine, MethodError
from imud.calibration.papers.basics import MethodResult, check_faces, faces, normalised
from imud.calibration.recording import SensorRecording
from imud.calibration.stops import StaticInterval
from imud.gravity import GRAVITY_M_S2
from imud.rotation import FloatArray

SIGNS = {"+": 1.0, "-": -1.0}


def fit(recording: SensorRecording, stops: list[StaticInterval]) -> MethodResult:
    """All three sensors; MethodError if one of the six positions is missing."""
    there = recording.mag[np.isfinite(recording.mag[:, 0])]
    return MethodResult(
        accelerometer(recording, stops),
        gyroscope(recording, stops),
        ellipsoid(there) if len(there) else None,
    )


def accelerometer(recording: SensorRecording, stops: list[StaticInterval]) -> Affine:
    """Twelve coefficients by least squares, equation 5."""
    positions = faces(recording, stops)
    check_faces(positions)
    rows, wanted = [], []
    for name, own in positions.items():
        direction = SIGNS[name[0]] * np.eye(3)["xyz".index(name[1])]
        for stop in own:
            readings = recording.acc[stop.start : stop.end]
            rows.append([*readings.mean(axis=0), 1.0])
            wanted.append(direction * GRAVITY_M_S2)
    known = np.array(rows)
    found = np.linalg.solve(known.T @ known, known.T @ np.array(wanted))
    matrix = found[:3].T
    bias = -np.linalg.solve(matrix, found[3])
    return Affine(matrix, bias)


def gyroscope(recording: SensorRecording, stops: list[StaticInterval]) -> Affine:
    """Offset at rest, equation 7: of the longest stop."""
    if not stops:
        raise MethodError("the probe never lay still")
    rest = max(stops, key=len)
    readings = recording.gyr[rest.start : rest.end]
    return Affine(np.eye(3), readings.mean(axis=0))


def ellipsoid(readings: FloatArray, *, as_printed: bool = False) -> Affine:
    """The ellipsoid's middle and axes, equations 9 to 12. MethodError if the readings
    are none.

    As printed, equation 12 leaves the field in the axes of the ellipsoid, whose order
    and signs are those of an eigenvalue routine; turned back, it is in the body's.
    """
    middle = readings.mean(axis=0)
    size = 2.0 * readings.std()
    x, y, z = ((readings - middle) / size).T
    # a x2 + b y2 + c z2 + 2 d xy + ... = 1 with a + b + c = 3: well posed near a sphere
    columns = np.stack(
        [
            x * x + y * y - 2.0 * z * z,
            x * x + z * z - 2.0 * y * y,
            *(2.0 * x * y, 2.0 * x * z, 2.0 * y * z),
            *(2.0 * x, 2.0 * y, 2.0 * z, np.ones(len(x))),
        ],
        axis=1,
    )
    squares = x * x + y * y + z * z
    p, *_ = np.linalg.lstsq(columns, squares, rcond=None)
    form = np.array(
        [
            [1.0 - p[0] - p[1], -p[2], -p[3]],
            [-p[2], 1.0 - p[0] + 2.0 * p[1], -p[4]],
            [-p[3], -p[4], 1.0 + 2.0 * p[0] - p[1]],
        ]
    )
    lengths, axes = np.linalg.eigh(form)
    if lengths.min() <= 0.0:
        raise MethodError("the readings form no ellipsoid: turn the probe further")
    centre = np.linalg.solve(form, p[5:8])
    matrix = np.diag(np.sqrt(lengths)) @ axes.T
    if not as_printed:
        matrix = axes @ matrix
    elif np.linalg.det(matrix) < 0.0:
        matrix = -matrix
    return Affine(normalised(matrix), middle + size * centre)
