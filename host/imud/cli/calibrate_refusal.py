# SPDX-License-Identifier: MIT
"""Shared by the parts of `imud calibrate`: refusals, and the day."""

from __future__ import annotations

import datetime

from imud.calibration.faults import CalibrationFault
from imud.errors import ImudError


class CalibrationRefused(ImudError):
    """It is not good enough: why, and what to do. What was in force still is."""


def refusal(fault: CalibrationFault) -> CalibrationRefused:
    """The error of a calibration that is not good enough."""
    return CalibrationRefused(
        f"refused: {fault}; the previous calibration stays active"
    )


def today() -> datetime.date:
    """The day that goes into the params, UTC."""
    return datetime.datetime.now(datetime.UTC).date()
