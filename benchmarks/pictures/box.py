# SPDX-License-Identifier: MIT
"""A probe as a box, seen from in front and above."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from imud.calibration.algebra import onto, turn
from imud.calibration.path import UP
from imud.calibration.poses import StaticPose
from imud.rotation import FloatArray

HALF = np.array([1.2, 0.7, 0.35])  # of its length, width and height
SIDES = {
    (0, 1): "front",
    (0, -1): "back",
    (1, 1): "left",
    (1, -1): "right",
    (2, 1): "top",
    (2, -1): "bottom",
}
# From the world to the picture: turned about the vertical, then tipped to the eye.
VIEW = turn(np.array([0.42, 0.0, 0.0])) @ turn(np.array([0.0, 0.0, -0.6]))
EYE = -VIEW[1]  # towards the viewer


@dataclass(frozen=True, slots=True)
class Side:
    """A side of the box that is seen: its name, corners and middle in the picture, x to
    the right and y up.
    """

    name: str
    corners: FloatArray  # (4, 2)
    middle: FloatArray  # (2,)


def lying(pose: StaticPose) -> FloatArray:
    """The attitude of a box that lies so, as a matrix from the body to the world; its
    heading is one in which the sides that are up are seen best, then its front.
    """
    level = onto(pose.up, UP)
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    return max(
        (turn(UP * a) @ level for a in angles), key=lambda at: _seen_of(pose, at)
    )


def _seen_of(pose: StaticPose, attitude: FloatArray) -> float:
    """How well the sides of a pose are seen, and its front."""
    facing = attitude.T @ EYE  # of each axis of the body
    named = [sign * facing[axis] for axis, sign in enumerate(pose.sign) if sign]
    return float(min(named) + 0.3 * min(facing[0], 0.5))


def sides(attitude: FloatArray) -> Iterator[Side]:
    """The sides of a box that are seen."""
    for (axis, sign), name in SIDES.items():
        normal = attitude @ (sign * np.eye(3)[axis])
        if normal @ EYE <= 1e-6:
            continue
        others = [other for other in range(3) if other != axis]
        corners = []
        for one, two in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
            corner = np.zeros(3)
            corner[[axis, *others]] = sign, one, two
            corners.append(_seen(attitude @ (corner * HALF)))
        middle = _seen(attitude @ (sign * np.eye(3)[axis] * HALF))
        yield Side(name, np.array(corners), middle)


def _seen(point: FloatArray) -> FloatArray:
    return np.asarray((VIEW @ point)[[0, 2]])
