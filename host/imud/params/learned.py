# SPDX-License-Identifier: MIT
"""Whether a filter can go on where its calibration changes."""

from __future__ import annotations

from imud.errors import ParamsError
from imud.params.value import SENSORS, Calibration, Params, Vector

METHOD = "learned"  # in motion, while the filter ran
ALIKE = 0.19  # entries of the matrices differ by less: the axes are the same


def filter_can_continue(before: bytes | None, after: bytes) -> bool:
    """Whether each sensor that is calibrated otherwise was learned in motion, with the
    same axes, and the rates have the same bias. Otherwise a filter has to restart with
    the records `after`.
    """
    if before is None:
        return False
    try:
        old, new = Params.decode(before), Params.decode(after)
    except ParamsError:
        return False
    changed = [name for name in SENSORS if getattr(old, name) != getattr(new, name)]
    # The filter keeps the bias that it has found.
    is_same_bias = _bias(old.gyr) == _bias(new.gyr)
    return is_same_bias and all(_is_continuable(old, new, name) for name in changed)


def _bias(gyr: Calibration | None) -> Vector:
    return gyr.bias_counts if gyr is not None else (0.0, 0.0, 0.0)


def _is_continuable(old: Params, new: Params, name: str) -> bool:
    one, other = getattr(old, name), getattr(new, name)
    if other is None or other.method != METHOD:
        return False
    for row, column in ((row, column) for row in range(3) for column in range(3)):
        was = one.matrix[row][column] if one is not None else float(row == column)
        if abs(other.matrix[row][column] - was) >= ALIKE:
            return False
    return True
