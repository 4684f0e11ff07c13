# SPDX-License-Identifier: MIT
"""Whether a sensor's calibration is still good: its age and its temperature; in words
with the cure, and as flags of poses."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Any

from imud.gravity import GRAVITY_M_S2

# A year: bias and scale of consumer sensors move by their specified accuracy in that
# time, and iron of the housing is magnetised again.
OLD_DAYS = 365
# By so much another temperature moves an MPU-9250's accelerometer by 15 mg (product
# specification, table 2: 1.5 mg/degC, here two sigma).
APART_DEGC = 10.0
STEP_DEGC = 5.0  # of what words say
# Of an accelerometer that was not calibrated at two temperatures: the sigma of an
# axis, a kelvin (CALIBRATION_DRIFT in firmware/core).
DRIFT_M_S2_K = 0.75e-3 * GRAVITY_M_S2


class Condition(StrEnum):
    """The condition of a sensor's calibration, the most serious first."""

    UNCALIBRATED = "uncalibrated"  # or with unknown errors
    OLD = "old"
    OTHER_TEMPERATURE = "other temperature"
    UNKNOWN_TEMPERATURE = "unknown temperature"  # then, or now
    CALIBRATED = "calibrated"


TITLES = {"acc": "accelerometer", "gyr": "gyroscope", "mag": "magnetometer"}
# Of the sigma of each: what the published value is multiplied by, and the unit then.
UNITS = {"sigma_m_s2": (1.0, "m/s2"), "sigma": (100.0, "%"), "sigma_uT": (1.0, "uT")}
_WORDS = {
    Condition.UNCALIBRATED: "not calibrated: imud calibrate",
    Condition.OLD: "calibrated over a year ago: imud calibrate verify",
    Condition.OTHER_TEMPERATURE: (
        "calibrated at another temperature{moved}: imud calibrate verify"
    ),
    Condition.UNKNOWN_TEMPERATURE: (
        "perhaps calibrated at another temperature, which is unknown: imud calibrate "
        "verify"
    ),
}
_FLAGS = {
    Condition.OLD: "calibration_old",
    Condition.OTHER_TEMPERATURE: "calibration_temperature",
}


def advice(conditions: Mapping[str, Condition], moved: str = "") -> str:
    """The sensors that need an action, and the action; empty if none does. `moved`:
    moved_words() of the accelerometer.
    """
    sentences = []
    for condition, words in _WORDS.items():
        names = [TITLES[each] for each, of in conditions.items() if of is condition]
        if names:
            first = ", ".join(names[:-1])
            names_said = f"{first + ' and ' if first else ''}{names[-1]}"
            sentences.append(f"{names_said} {words.format(moved=moved)}")
    return "; ".join(sentences)


def moved_words(acc: Mapping[str, Any] | None, temperature_c: float | None) -> str:
    """How far an accelerometer is from the temperature of its calibration, and by how
    much its tilt may be wrong, in 95 of 100 cases; in steps, so that the words stay
    while it warms up a little. Empty where that is not known.
    """
    if acc is None or temperature_c is None:
        return ""
    calibrated_c, sigma = acc.get("temperature_c"), acc.get("sigma_m_s2")
    if calibrated_c is None or sigma is None:
        return ""
    now_c = STEP_DEGC * round(temperature_c / STEP_DEGC)
    drift = acc.get("drift_m_s2_k") or DRIFT_M_S2_K
    # It is up to half a step further than the words say.
    apart_c = abs(now_c - calibrated_c) + STEP_DEGC / 2.0
    wrong = math.hypot(sigma, drift * apart_c) / GRAVITY_M_S2
    tilt_deg = math.degrees(1.96 * math.sqrt(2.0) * wrong)  # of two axes
    return (
        f" ({calibrated_c:.0f} degC, now about {now_c:.0f}: tilt may be off by up to "
        f"{tilt_deg:.1f} degrees)"
    )


def done_words(sensors: Mapping[str, Mapping[str, Any] | None]) -> str:
    """When each sensor was calibrated, at which temperature and how well (one sigma),
    and until when and between which temperatures that holds. `sensors`: values as
    Params.plain() gives them. Empty: none is calibrated.
    """
    parts, days, ranges = [], [], []
    for name, values in sensors.items():
        sigmas = [(k, v) for k, v in (values or {}).items() if k in UNITS and v]
        if not values or not sigmas:
            continue
        key, sigma = sigmas[0]
        scale, unit = UNITS[key]
        day, degc = values.get("day"), values.get("temperature_c")
        when = "on an unknown day" if day is None else f"{day}"
        where = "" if degc is None else f" at {degc:.0f} degC"
        parts.append(f"{TITLES[name]} {when}{where} to {scale * sigma:.2g} {unit}")
        days += [] if day is None else [day]
        if degc is not None:
            drift = values.get("drift_m_s2_k") or DRIFT_M_S2_K
            apart = APART_DEGC * DRIFT_M_S2_K / drift
            ranges.append((degc - apart, degc + apart))
    again = []
    if days:
        again.append(f"after {min(days) + datetime.timedelta(days=OLD_DAYS)}")
    if ranges:
        lows, highs = zip(*ranges, strict=True)
        again.append(f"below {max(lows):.0f} or above {min(highs):.0f} degC")
    told = f"; again {', '.join(again)}" if again else ""
    return f"calibrated: {', '.join(parts)}{told}" if parts else ""


def flags_of(conditions: Mapping[str, Condition]) -> tuple[str, ...]:
    """The flags that poses get from the host."""
    found = set(conditions.values())
    return tuple(flag for condition, flag in _FLAGS.items() if condition in found)


def condition_of(
    values: Mapping[str, Any] | None, today: datetime.date, temperature_c: float | None
) -> Condition:
    """By the values of a sensor's record, as Params.plain() gives them; None: it has
    none. `temperature_c`: of the die, None where it is not known. The less a sensor
    drifts, the further from its calibration it holds.
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
    drift = values.get("drift_m_s2_k") or DRIFT_M_S2_K
    is_near = abs(temperature_c - calibrated_c) * drift <= APART_DEGC * DRIFT_M_S2_K
    return Condition.CALIBRATED if is_near else Condition.OTHER_TEMPERATURE
