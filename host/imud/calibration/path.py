# SPDX-License-Identifier: MIT
"""The attitude of a probe through a recording, levelled; its heading is free and drifts
with the gyroscope.
"""

from __future__ import annotations

import numpy as np

from imud.calibration.algebra import onto, turn
from imud.calibration.recording import IntArray
from imud.rotation import FloatArray

UP = np.array([0.0, 0.0, 1.0])


def levelled(attitude: FloatArray, known: IntArray, up_known: FloatArray) -> FloatArray:
    """The attitudes (n, 3, 3) of an integrated gyroscope, turned so that gravity is
    vertical at the steps `known`, where it is `up_known` (k, 3) in the body. Between
    them the correction is interpolated.
    """
    seen = np.einsum("kij,kj->ki", attitude[known], up_known)
    first = onto(seen[0], UP)
    attitude, seen = first @ attitude, seen @ first.T
    across = np.cross(seen, UP)
    sine = np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.arctan2(sine, seen @ UP[:, None])
    tilt = across / np.maximum(sine, 1e-12) * angle
    steps = np.arange(len(attitude))
    course = [np.interp(steps, known, tilt[:, axis]) for axis in range(3)]
    return turn(np.stack(course, axis=1)) @ attitude
