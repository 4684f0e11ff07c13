# SPDX-License-Identifier: MIT
"""The 26 ways to lay a probe down that a guide asks for, in words, and which of them
adds most information.

A pose is named by where up points in the body: x ahead, y to the left, z to the top.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from imud.calibration.accelerometer import AccFit
from imud.calibration.algebra import units
from imud.calibration.score import direction_slopes
from imud.rotation import FloatArray

SIDES = (("front", "back"), ("left", "right"), ("top", "bottom"))
FACES = {
    (0, 0, 1): "base down",
    (0, 0, -1): "upside down",
    (1, 0, 0): "on its back, front up",
    (-1, 0, 0): "on its front, back up",
    (0, 1, 0): "on its right side, left up",
    (0, -1, 0): "on its left side, right up",
}


@dataclass(frozen=True, slots=True)
class StaticPose:
    """A way to lay a probe down."""

    sign: tuple[int, int, int]

    @property
    def up(self) -> FloatArray:
        """A unit vector: where up is in the body."""
        return units(np.array(self.sign, dtype=float))

    @property
    def words(self) -> str:
        """How to lay it: `upside down`, `with its top left edge up`."""
        if self.sign in FACES:
            return FACES[self.sign]
        named = reversed(list(zip(SIDES, self.sign, strict=True)))
        sides = [side[sign < 0] for side, sign in named if sign]
        what = "edge" if len(sides) == 2 else "corner"
        return f"with its {' '.join(sides)} {what} up"

    @property
    def name(self) -> str:
        """For files and keys: +x+y, -z."""
        axes = zip("xyz", self.sign, strict=True)
        return "".join(f"{'+' if sign > 0 else '-'}{a}" for a, sign in axes if sign)


def _all() -> tuple[StaticPose, ...]:
    signs = itertools.product((1, 0, -1), repeat=3)
    found = [StaticPose((x, y, z)) for x, y, z in signs if any((x, y, z))]
    return tuple(sorted(found, key=lambda pose: sum(map(abs, pose.sign))))


BASE_DOWN = StaticPose((0, 0, 1))
ALL = _all()  # six faces, twelve edges, eight corners

# The twelve of the picture in docs/calibration.md: the faces, and two edges at right
# angles between each two axes. Every beginning of the list is useful.
TWELVE = tuple(
    StaticPose(sign)
    for sign in (
        *((0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)),
        *((1, 1, 0), (1, 0, 1), (0, 1, 1)),
        *((1, -1, 0), (1, 0, -1), (0, 1, -1)),
    )
)
UPS = np.array([pose.up for pose in ALL])


def gains(fit: AccFit) -> FloatArray:
    """How uncertain the length of gravity is in each of ALL, m/s2: the information of a
    stop there.
    """
    slopes = np.einsum("ti,tij->tj", UPS, direction_slopes(fit.matrix, UPS))
    return np.asarray(np.sqrt(np.einsum("tj,jk,tk->t", slopes, fit.covariance, slopes)))


def wanted(fit: AccFit | None) -> StaticPose:
    """The pose that adds most information; faces before edges before corners if they
    are equal. `fit`: of the stops so far, None before the first.
    """
    if fit is None:
        return BASE_DOWN
    found = gains(fit)
    return ALL[int(np.argmax(found > 0.98 * found.max()))]
