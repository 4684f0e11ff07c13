# SPDX-License-Identifier: MIT
"""What a calibration is worth: uncalibrated, old, at another temperature, or good."""

from __future__ import annotations

import datetime
import json
from typing import Any

import pytest

from chain import Chain
from fakes import PATIENCE_S
from fakes.params import parts_of
from imud.params.condition import (
    APART_DEGC,
    OLD_DAYS,
    Condition,
    advice,
    condition_of,
    flags_of,
)
from params_bench import GOOD as PARAMS

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


def test_a_temperature_that_is_not_known_is_never_called_good():
    unknown = Condition.UNKNOWN_TEMPERATURE
    assert after(0, GOOD, None) == unknown
    assert after(0, GOOD | {"temperature_c": None}, 90.0) == unknown
    assert after(OLD_DAYS + 1, GOOD, None) == Condition.OLD
    assert "which nobody knows" in advice({"acc": unknown})
    assert flags_of({"acc": unknown}) == ()


def test_a_day_that_is_not_known_is_no_reproach():
    assert after(9999, GOOD | {"day": None}, 25.0) == Condition.CALIBRATED


CALIBRATED = Condition.CALIBRATED
OLD, OTHER = Condition.OLD, Condition.OTHER_TEMPERATURE


@pytest.mark.parametrize(
    ("conditions", "words", "flags"),
    [
        ((CALIBRATED, CALIBRATED, CALIBRATED), "", ()),
        (
            (Condition.UNCALIBRATED,) * 3,
            "accelerometer, gyroscope and magnetometer not calibrated: imud calibrate",
            (),
        ),
        (
            (OLD, CALIBRATED, OLD),
            "accelerometer and magnetometer calibrated over a year ago: imud calibrate "
            "verify",
            ("calibration_old",),
        ),
        (
            (OTHER, OLD, CALIBRATED),
            "gyroscope calibrated over a year ago: imud calibrate verify; "
            "accelerometer calibrated at another temperature: imud calibrate verify",
            ("calibration_old", "calibration_temperature"),
        ),
    ],
)
def test_what_to_do_is_said_in_words_and_by_flags(conditions, words, flags):
    found = dict(zip(("acc", "gyr", "mag"), conditions, strict=True))
    assert advice(found) == words
    assert flags_of(found) == flags


def test_a_probe_with_an_old_calibration_says_so_in_poses_status_and_journal(
    chain: Chain,
) -> None:
    acc = PARAMS.plain("acc")
    assert acc is not None
    old = PARAMS.replaced("acc", acc | {"day": datetime.date(2020, 1, 1)})
    words = (
        "gyroscope and magnetometer not calibrated: imud calibrate; accelerometer "
        "calibrated over a year ago: imud calibrate verify"
    )
    probe, poses = chain.probe, chain.hear("pose")
    probe.hello_fields = probe.hello_fields | {"params_digest": old.digest}
    chain.port.write(probe.say("hello"))
    parts = parts_of(old.encode())
    chain.port.write(b"".join(probe.say("params", **part) for part in parts))
    status = chain.status_when(lambda status: status["params"].get("advice") == words)
    assert status["params"]["flags"] == ["calibration_old"]
    chain.daemon.expect(f"probe {probe.name}: {words}")
    chain.port.write(probe.say("pose"))
    flags = json.loads(poses.get(timeout=PATIENCE_S))["flags"]
    assert flags == ["at_rest", "calibration_old"]
