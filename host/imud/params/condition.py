# SPDX-License-Identifier: MIT
"""What a sensor's calibration is worth today: its age and its temperature; in words
with the cure, and as flags of poses."""

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
    UNKNOWN_TEMPERATURE = "unknown temperature"  # then, or now
    CALIBRATED = "calibrated"


TITLES = {"acc": "accelerometer", "gyr": "gyroscope", "mag": "magnetometer"}
_WORDS = {
    Condition.UNCALIBRATED: "not calibrated: imud calibrate",
    Condition.OLD: "calibrated over a year ago: imud calibrate verify",
    Condition.OTHER_TEMPERATURE: (
        "calibrated at another temperature: imud calibrate verify"
    ),
    Condition.UNKNOWN_TEMPERATURE: (
        "perhaps calibrated at another temperature, which nobody knows: imud calibrate "
        "verify"
    ),
}
_FLAGS = {
    Condition.OLD: "calibration_old",
    Condition.OTHER_TEMPERATURE: "calibration_temperature",
}


def advice(conditions: Mapping[str, Condition]) -> str:
    """Which sensors need something, and what; empty if none does."""
    sentences = []
    for condition, words in _WORDS.items():
        names = [TITLES[each] for each, of in conditions.items() if of is condition]
        if names:
            first = ", ".join(names[:-1])
            sentences.append(f"{first + ' and ' if first else ''}{names[-1]} {words}")
    return "; ".join(sentences)


def flags_of(conditions: Mapping[str, Condition]) -> tuple[str, ...]:
    """The flags that poses get from the host."""
    found = set(conditions.values())
    return tuple(flag for condition, flag in _FLAGS.items() if condition in found)


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
        return Condition.UNKNOWN_TEMPERATURE
    is_near = abs(temperature_c - calibrated_c) <= APART_DEGC
    return Condition.CALIBRATED if is_near else Condition.OTHER_TEMPERATURE
