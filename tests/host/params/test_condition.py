# SPDX-License-Identifier: MIT
"""What a calibration is worth: uncalibrated, old, at another temperature, or good."""

from __future__ import annotations

import datetime
import json
import math
import re
from typing import Any

import pytest

from chain import Chain
from fakes.params import parts_of
from imud.params.condition import (
    APART_DEGC,
    DRIFT_M_S2_K,
    OLD_DAYS,
    Condition,
    advice,
    condition_of,
    done_words,
    flags_of,
    moved_words,
)
from imud.params.parts import kind_of
from params_bench import GOOD as PARAMS

DAY = datetime.date(2026, 11, 23)
GOOD: dict[str, Any] = {"sigma_uT": 0.1, "day": DAY, "temperature_c": 25.0}


def after(days: int, values: dict[str, Any] | None, degc: float | None) -> Condition:
    return condition_of(values, DAY + datetime.timedelta(days=days), degc)


@pytest.mark.parametrize("values", [None, {}, GOOD | {"sigma_uT": None}])
def test_a_sensor_without_stated_errors_is_uncalibrated(values):
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
    assert "which is unknown" in advice({"acc": unknown})
    assert flags_of({"acc": unknown}) == ()


def test_the_less_an_accelerometer_drifts_the_further_its_calibration_holds():
    acc = {"sigma_m_s2": 0.01, "day": DAY, "temperature_c": 25.0}
    assert after(0, acc, 36.0) == Condition.OTHER_TEMPERATURE
    calm, wild = acc | {"drift_m_s2_k": 0.0015}, acc | {"drift_m_s2_k": 0.015}
    assert after(0, calm, 36.0) == Condition.CALIBRATED
    assert after(0, calm, 75.0) == Condition.OTHER_TEMPERATURE
    assert after(0, wild, 31.0) == Condition.OTHER_TEMPERATURE


def test_words_say_how_far_the_temperature_is_and_what_that_may_do():
    acc = {"sigma_m_s2": 0.01, "temperature_c": 22.1}
    words = " (22 degC, now about 50: tilt may be off by up to 3.6 degrees)"
    assert moved_words(acc, 51.9) == moved_words(acc, 48.1) == words
    assert "off by up to 0.5 degrees" in moved_words(acc | {"drift_m_s2_k": 1e-3}, 52)
    assert moved_words(acc, None) == ""
    assert moved_words(None, 50.0) == ""
    assert moved_words(acc | {"temperature_c": None}, 50.0) == ""
    assert words in advice({"acc": Condition.OTHER_TEMPERATURE}, words)


@pytest.mark.parametrize("calibrated_c", [22.1, 60.0])
@pytest.mark.parametrize("temperature_c", [47.5, 50.0, 52.5])
def test_a_tilt_that_words_state_holds_at_each_temperature_that_they_mean(
    calibrated_c: float, temperature_c: float
):
    acc = {"sigma_m_s2": 0.01, "temperature_c": calibrated_c}
    words = moved_words(acc, temperature_c)
    assert "now about 50" in words
    off = math.hypot(0.01, DRIFT_M_S2_K * (temperature_c - calibrated_c)) / 9.80665
    stated_deg = float(words.partition("up to ")[2].split()[0])
    # Rounded to a tenth.
    assert math.degrees(1.96 * math.sqrt(2.0) * off) < stated_deg + 0.05


def test_what_is_assumed_of_a_drift_is_what_the_wire_calls_unknown():
    drift = kind_of("acc").keys["drift_m_s2_k"]
    assert drift.plain(drift.wire(None)) is None
    assert drift.wire(DRIFT_M_S2_K) == drift.null
    assert drift.wire(255 / 12800) == (255,)


def test_words_say_when_a_calibration_was_done_and_when_it_is_due_again():
    acc = {"sigma_m_s2": 0.0123, "day": DAY, "temperature_c": 24.0}
    acc["drift_m_s2_k"] = 2.0 * DRIFT_M_S2_K  # it holds half as far
    known = {
        "acc": acc,
        "gyr": GOOD | {"sigma_uT": None, "sigma": 0.002},
        "mag": GOOD | {"day": DAY - datetime.timedelta(days=30)},
    }
    assert done_words(known) == (
        "calibrated: accelerometer 2026-11-23 at 24 degC to 0.012 m/s2, gyroscope "
        "2026-11-23 at 25 degC to 0.2 %, magnetometer 2026-10-24 at 25 degC to 0.1 uT; "
        "again after 2027-10-24, below 19 or above 29 degC"
    )
    no_more = {"sigma_uT": 0.1, "day": None, "temperature_c": None}
    assert done_words({"mag": no_more, "acc": None, "gyr": {}}) == (
        "calibrated: magnetometer on an unknown day to 0.1 uT"
    )
    assert done_words({"acc": {}}) == ""


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


def test_poses_alone_tell_that_a_calibration_is_far_from_its_temperature(
    chain: Chain,
) -> None:
    """By the temperature in `status`; without one nothing is called good."""
    known = PARAMS
    for name in ("acc", "gyr", "mag"):
        sigma = {"acc": "sigma_m_s2", "gyr": "sigma", "mag": "sigma_uT"}[name]
        values = (known.plain("acc") or {}) | {"temperature_c": 22.0, "day": None}
        values = {
            key: value
            for key, value in values.items()
            if not key.startswith(("sigma", "residual", "drift"))
        }
        known = known.replaced(name, values | {sigma: 0.001})
    probe, poses = chain.probe, chain.hear("pose")
    probe.hello_fields = probe.hello_fields | {"params_digest": known.digest}
    chain.port.write(probe.say("hello"))
    parts = parts_of(known.encode())
    chain.port.write(b"".join(probe.say("params", **part) for part in parts))

    def advises(temperature_c: float | None, words: str) -> None:
        chain.port.write(probe.say("status", temperature=temperature_c))
        chain.status_when(lambda status: status["params"].get("advice") == words)

    which = "accelerometer, gyroscope and magnetometer"
    far = (
        f"{which} calibrated at another temperature (22 degC, now about 50: tilt may "
        "be off by up to 3.6 degrees): imud calibrate verify"
    )
    advises(52.0, far)
    chain.daemon.expect(re.escape(f"probe {probe.name}: {far}"))
    assert not [line for line in chain.daemon.lines if "is good" in line]
    chain.port.write(probe.say("pose"))
    flags = json.loads(poses.get())["flags"]
    assert flags == ["at_rest", "calibration_temperature"]
    advises(25.0, "")
    chain.daemon.expect(f"probe {probe.name}: its calibration is good")
    advises(25.9, "")
    advises(
        None,
        f"{which} perhaps calibrated at another temperature, which is unknown: imud "
        "calibrate verify",
    )


def test_a_probe_with_an_old_calibration_says_so_in_poses_status_and_journal(
    chain: Chain,
) -> None:
    acc = PARAMS.plain("acc")
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
    flags = json.loads(poses.get())["flags"]
    assert flags == ["at_rest", "calibration_old"]
