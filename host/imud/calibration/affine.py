# SPDX-License-Identifier: MIT
"""The calibration of one sensor as a matrix and a bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from imud.errors import ImudError
from imud.params.value import Calibration
from imud.rotation import FloatArray


class MethodError(ImudError):
    """A recording lacks what a method needs."""


@dataclass(frozen=True, slots=True)
class Affine:
    """True vector = matrix @ (reading - bias), in the unit of the readings."""

    matrix: FloatArray
    bias: FloatArray

    def after(self, before: Affine) -> Affine:
        """This one of what `before` has calibrated, as one."""
        bias = before.bias + np.linalg.solve(before.matrix, self.bias)
        return Affine(self.matrix @ before.matrix, bias)

    def apply(self, readings: FloatArray) -> FloatArray:
        """Of readings, shape (..., 3)."""
        return np.asarray((readings - self.bias) @ self.matrix.T)


def affine_of(of: Calibration | None, unit: float) -> Affine:
    """A calibration of the params for readings in nominal units, which are counts times
    `unit`; none: as read.
    """
    if of is None:
        return Affine(np.eye(3), np.zeros(3))
    return Affine(np.array(of.matrix), np.array(of.bias_counts) * unit)
