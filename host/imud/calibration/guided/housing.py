# SPDX-License-Identifier: MIT
"""How a sensor is turned in its housing: base down on a table, then turned by half a
turn on the spot.

The table's slope changes its sign in the body, the sensor's does not: the mean of the
two directions of gravity is the housing's upright axis, whatever the table.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from imud.calibration.algebra import onto, units
from imud.calibration.faults import CalibrationFault
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.path import UP
from imud.calibration.recording import SensorRecording
from imud.rotation import FloatArray

# A base that is down, a table that is level enough, half a turn.
LEANING_MAX = math.radians(15.0)
SLOPE_MAX = math.radians(5.0)
HALF_TURN = (math.radians(150.0), math.radians(210.0))


def turned(
    first: FloatArray, second: FloatArray, angle_rad: float
) -> FloatArray | CalibrationFault:
    """The rotation matrix from the sensor's frame to the housing's, or the reason why
    there is none. `first`, `second`: unit vectors up in the sensor's frame at the two
    stops; `angle_rad`: how far the probe was turned between them, by the gyroscope.
    """
    leaning = math.acos(np.clip(min(first @ UP, second @ UP), -1.0, 1.0))
    if leaning > LEANING_MAX:
        return CalibrationFault(
            "not_base_down",
            f"it leans by {math.degrees(leaning):.0f} degrees",
            "lay it base down on a table",
        )
    if not HALF_TURN[0] < abs(angle_rad) < HALF_TURN[1]:
        return CalibrationFault(
            "not_half_turn",
            f"it was turned by {math.degrees(abs(angle_rad)):.0f} degrees",
            "turn it by 180 degrees on the spot",
        )
    slope = math.acos(np.clip(first @ second, -1.0, 1.0)) / 2.0
    if slope > SLOPE_MAX:
        return CalibrationFault(
            "sloping_table",
            f"the table slopes by {math.degrees(slope):.0f} degrees",
            "use a level table",
        )
    return onto(units(first + second), UP)


def turn_about_up(rate: FloatArray, step_s: float, up: FloatArray) -> float:
    """The angle about `up` (body frame) that calibrated rates (n, 3) add up to, rad."""
    return float((rate @ up).sum() * step_s)


def found(recording: SensorRecording, fit: ModuleFit) -> FloatArray | None:
    """The turn into the housing, from the last two successive stops of a recording that
    fit; None: there are none.
    """
    pairs = list(itertools.pairwise(zip(fit.stops, fit.up, strict=True)))
    for (first, up), (last, up_last) in reversed(pairs):
        rate = fit.gyr.rate[first.middle : last.middle]
        angle = turn_about_up(rate, recording.step_s, up_last)
        turn = turned(up, up_last, angle)
        if not isinstance(turn, CalibrationFault):
            return turn
    return None
