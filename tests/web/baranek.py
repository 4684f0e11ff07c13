# SPDX-License-Identifier: MIT
"""Baranek's filter in doubles, from his equations."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

COUNT = math.radians(8.75e-3)
KP, KI = 500 * COUNT, 10 * COUNT


def outputs(gyr: Array, acc: Array, step_s: float) -> Array:
    """Error x, y and offset x, y (rad/s) at each sample, from level at rest."""
    matrix, sums, found = np.eye(3), np.zeros(2), []
    for rate, force in zip(gyr, acc, strict=True):
        norm = float(np.linalg.norm(force))
        error = np.cross(matrix[2], force / norm)[:2]
        sums = sums + KI * error * step_s
        offset = math.exp(-abs(9.80665 - norm)) * (KP * error + sums)
        x, y, z = (rate - np.append(offset, 0.0)) * step_s / 2
        for _ in range(2):  # 10 ms in parts of at most 7.5
            skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            turned = matrix @ (np.eye(3) + skew)
            half = turned[0] @ turned[1] / 2
            a, b = turned[0] - half * turned[1], turned[1] - half * turned[0]
            rows = (a, b, np.cross(a, b))
            matrix = np.array([(3 - row @ row) / 2 * row for row in rows])
        found.append([*error, *offset])
    return np.array(found)
