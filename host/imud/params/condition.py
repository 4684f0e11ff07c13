# SPDX-License-Identifier: MIT
"""What a sensor's calibration is worth today: its age and its temperature."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from enum import StrEnum
from typing import Any

# A year: bias and scale of consumer sensors move by their specified accuracy in that
# time, and iron of the housing is magnetised anew.
OLD_DAYS = 365
# By so much another temperature moves an MPU-9250's accelerometer by 15 mg (product
# specification, table 2: 1.5 mg/degC).
APART_DEGC = 10.0


class Condition(StrEnum):
    """Of a sensor's calibration; what is wrong first comes first."""

    UNCALIBRATED = "uncalibrated"  # or nobody knows how well it is
    OLD = "old"
    OTHER_TEMPERATURE = "other temperature"
    CALIBRATED = "calibrated"


def condition_of(
    values: Mapping[str, Any] | None, today: datetime.date, temperature_c: float | None
) -> Condition:
    """By the values of a sensor's record, as Params.plain() gives them; None: it has
    none. `temperature_c`: of the die, None where it is not known.
    """
    if values is None or not any(
        key.startswith("sigma") and value is not None for key, value in values.items()
    ):
        return Condition.UNCALIBRATED
    day, calibrated_c = values.get("day"), values.get("temperature_c")
    if day is not None and (today - day).days > OLD_DAYS:
        return Condition.OLD
    if calibrated_c is None or temperature_c is None:
        return Condition.CALIBRATED
    is_near = abs(temperature_c - calibrated_c) <= APART_DEGC
    return Condition.CALIBRATED if is_near else Condition.OTHER_TEMPERATURE
