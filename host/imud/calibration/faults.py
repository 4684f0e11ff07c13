# SPDX-License-Identifier: MIT
"""Faults of a calibration, each with its remedy; those of the magnetic field, which
spoil every method for a magnetometer.
"""

from __future__ import annotations

import msgspec
import numpy as np

from imud.calibration.magnetometer import MagFit
from imud.rotation import FloatArray

MAGNET_UT = 200.0  # an own field that no module has without a magnet on it
UNEVEN_UT = 0.6  # rms of an axis beside its noise that speaks of an uneven field
NOISY_UT = 1.0  # more white noise than modules as sold have: 0.5 to 0.8
FIELD_UT = (18.0, 75.0)  # of the Earth, with some room


class CalibrationFault(msgspec.Struct, frozen=True):
    """What is wrong, and the remedy: one clause each."""

    kind: str
    reason: str
    cure: str

    def __str__(self) -> str:
        return f"{self.reason}; {self.cure}"


def of_field(mag: MagFit | None, heading_deg: float | None) -> CalibrationFault | None:
    """A room or a magnet that spoils the magnetometer's part."""
    if mag is None:
        return None
    sure = ""
    if heading_deg is not None:
        sure = f"; the heading error would be +-{heading_deg:.1f} degrees"
    if mag.uneven_ut > UNEVEN_UT:
        return CalibrationFault(
            "uneven_field",
            f"the field is uneven here ({mag.uneven_ut:.1f} uT{sure})",
            "move away from iron, cables and loudspeakers",
        )
    if mag.noise_ut > NOISY_UT:
        return CalibrationFault(
            "noisy",
            f"the magnetometer is noisy ({mag.noise_ut:.1f} uT{sure})",
            "move away from motors and mains cables, and continue for longer; if "
            "that does not help, try another module",
        )
    return of_magnets(mag.bias, mag.norm_ut)


def of_magnets(own_ut: FloatArray, norm_ut: float) -> CalibrationFault | None:
    """A field too strong or too weak for any room on Earth, or for any module."""
    own = float(np.linalg.norm(own_ut))
    if own > MAGNET_UT:
        return CalibrationFault(
            "magnet",
            f"the probe's own magnetic field is {own:.0f} uT",
            "remove the magnet or iron from it and start again",
        )
    low, high = FIELD_UT
    if not low < norm_ut < high:
        return CalibrationFault(
            "strange_field",
            f"the field here is {norm_ut:.0f} uT, which is not the Earth's",
            "move away from iron and magnets",
        )
    return None
