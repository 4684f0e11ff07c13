# SPDX-License-Identifier: MIT
"""What a calibration is worth: uncalibrated, old, at another temperature, or good."""

from __future__ import annotations

import datetime
from typing import Any

import pytest

from imud.params.condition import APART_DEGC, OLD_DAYS, Condition, condition_of

DAY = datetime.date(2026, 11, 23)
GOOD: dict[str, Any] = {"sigma_uT": 0.1, "day": DAY, "temperature_c": 25.0}


def after(days: int, values: dict[str, Any] | None, degc: float | None) -> Condition:
    return condition_of(values, DAY + datetime.timedelta(days=days), degc)


@pytest.mark.parametrize("values", [None, {}, GOOD | {"sigma_uT": None}])
def test_a_sensor_is_uncalibrated_until_somebody_knows_how_good_it_is(values):
    assert after(0, values, 25.0) == Condition.UNCALIBRATED


def test_a_calibration_is_old_after_a_year():
    assert after(OLD_DAYS, GOOD, 25.0) == Condition.CALIBRATED
    assert after(OLD_DAYS + 1, GOOD, 25.0) == Condition.OLD


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_calibration_holds_near_its_temperature(sign):
    assert after(0, GOOD, 25.0 + sign * APART_DEGC) == Condition.CALIBRATED
    warmer = 25.0 + sign * (APART_DEGC + 0.01)
    assert after(0, GOOD, warmer) == Condition.OTHER_TEMPERATURE


def test_what_is_not_known_is_no_reproach():
    assert after(0, GOOD, None) == Condition.CALIBRATED
    assert after(0, GOOD | {"temperature_c": None}, 90.0) == Condition.CALIBRATED
    assert after(9999, GOOD | {"day": None}, 25.0) == Condition.CALIBRATED
