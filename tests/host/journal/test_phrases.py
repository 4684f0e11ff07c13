# SPDX-License-Identifier: MIT
"""The phrases of the journal's lines, and how often they are written."""

from __future__ import annotations

from typing import Any

import pytest

from chain import Chain
from imud.journal import phrases
from imud.journal.faults import fault_words
from imud.journal.output import RateLimiter
from imud.probes import record
from imud.probes.session import Session
from imud.wire import schema


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (
            ("clock_failed", "crystal", 1),
            "clock failed: the crystal failed while running; the internal oscillator "
            "runs instead, good to 1 %: replace the board",
        ),
        (
            ("card_fault", "worn", 812),
            "card fault: the card does not store what is written, at block 812: "
            "replace it",
        ),
        (("log_started", "none", 3), "log started, recording 3"),
        (("stream_started", "button", 0), "stream started (button)"),
        (
            ("battery_low", "battery", 3310),
            "battery low: the battery is at 3310 mV: charge it",
        ),
        (
            ("overrun", "late", 4),
            "overrun: samples missed: 4; the processor was busy",
        ),
        (("bus_recovered", "none", 3), "bus recovered: the sensor works again"),
    ],
)
def test_an_event_is_told_in_words(event: tuple[str, str, int], words: str) -> None:
    assert phrases.event_words(*event) == words


@pytest.mark.parametrize(
    ("board", "words"),
    [
        ("nano", "no answer at 0x68: check power, SDA, SCL, AD0 to GND"),
        (
            "f405",
            "no answer at 0x6B or 0x1D: check power, SDA (X10), SCL (X9), SDO_G and "
            "SDO_XM to 3.3 V",
        ),
        (
            "micropython",
            "no answer at the sensor's address: check power, SDA, SCL, the address pin",
        ),
    ],
)
def test_a_sensor_that_is_not_there_is_told_with_its_address_and_its_pins(
    board: str, words: str
) -> None:
    assert fault_words("bus_fault", "nack", 0, board) == words


def test_a_bus_that_fails_again_and_again_says_how_often() -> None:
    assert fault_words("bus_fault", "nack", 4, "nano") == (
        "no answer at 0x68, 4 times in a row: check power, SDA, SCL, AD0 to GND"
    )


@pytest.mark.parametrize(
    ("cause", "detail", "board", "words"),
    [
        ("no_data_ready", 0, "nano", "the sensor signals no samples: check INT to D2"),
        ("no_data_ready", 0, "f405", "check DRDY_G to Y11"),
        ("wrong_chip", 0xFF, "nano", "answers 0xFF at 0x68, which is no chip's"),
        ("wrong_chip", 0x03, "nano", "at 0x68, which no sensor that this firmware can"),
        (
            "wrong_chip",
            0x03,
            "nano",
            "a real-time clock (DS3231, DS1307, PCF8523),",
        ),
        ("wrong_chip", 0xEA, "micropython", "0xEA (ICM-20948), which this firmware"),
        ("wrong_chip", 0x6A, "pico", "(LSM6DS3TR-C or LSM6DSL), which this firmware"),
        ("wrong_chip", 0x69, "pico", "can't read: buy an MPU-9250 (0x71), or an LSM6"),
        ("wrong_chip", 0xD1, "pico", "answers 0xD1 (BMI160), which this firmware"),
        ("wrong_chip", 0x68, "f405", "answers 0x68 at 0x6B or 0x1D, which is not an"),
        ("registers", 0x1B71, "nano", "register 0x1B does not hold what was written"),
        ("registers", 0x1B71, "nano", "the sensor's supply sags or a wire is loose"),
        ("registers", 0x1D98, "nano", "it answers 0x98 (ICM-20689), which is not an"),
        ("registers", 0x1D68, "nano", "0x68 (MPU-6050 or MPU-9150), which this firmw"),
        ("force", 0x74, "nano", "no force near 1 g at rest (it answers 0x74 (MPU-6515"),
        ("mag_silent", 0, "nano", "the magnetometer stopped measuring"),
        ("mag_stuck", 0, "nano", "the magnetometer blocks its bus"),
        ("timeout", 0, "nano", "the sensor answers but does not become ready"),
    ],
)
def test_a_fault_of_the_sensor_says_what_to_look_at(
    cause: str, detail: int, board: str, words: str
) -> None:
    assert words in fault_words("sensor_fault", cause, detail, board)


# Causes by events of which the firmware's sources tell: events without a fault have
# none.
TOLD = {
    "bus_fault": ("nack", "timeout", "stuck_bus"),
    "sensor_fault": (
        *("timeout", "no_data_ready", "wrong_chip", "registers", "force"),
        *("mag_silent", "mag_stuck"),
    ),
    "card_fault": ("absent", "unprepared", "timeout", "rejected", "worn", "late"),
    "card_full": ("full",),
    "calibration_refused": ("motion",),
    "overrun": ("late",),
    "settings_restored": ("boot",),
    "settings_failed": ("none",),
    "clock_failed": ("crystal",),
    "battery_low": ("battery",),
    "going_to_sleep": ("battery",),
    "radio_dropped": ("none",),
    "radio_fault": ("timeout", "rejected", "none"),
    "params_lost": ("worn",),
    "hook_failed": ("none",),
}


@pytest.mark.parametrize("board", ["nano", "f405", "micropython"])
def test_each_cause_of_a_fault_has_words_of_its_own(board: str) -> None:
    assert TOLD.keys() == phrases.FAULTS
    texts = [
        fault_words(event, cause, 0x1B75, board)
        for event, causes in TOLD.items()
        for cause in causes
    ]
    assert all(texts)
    assert not [words for words in texts if "{" in words]
    # A battery that is low has one cure, whatever comes of it.
    assert len(set(texts)) == len(texts) - 1


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"reset_cause": ("hard_fault",), "reset_address": 0x08001234},
            "hard fault at ",
        ),
        ({"reset_cause": ("watchdog",), "reset_address": 0x08001234}, "watchdog at "),
        ({"reset_cause": ("watchdog",)}, "watchdog"),
        ({"reset_cause": ("power_on",), "reset_address": 0x08001234}, "power on"),
    ],
)
def test_a_restart_says_where_it_struck(
    chain: Chain, fields: dict[str, Any], words: str
) -> None:
    chain.probe.restart()
    chain.port.write(chain.probe.say("hello", **fields))
    where = "0x08001234" if words.endswith("at ") else ""
    line = chain.daemon.expect("restarted on")
    assert line.endswith(f"boot 8 ({words}{where})")


def test_a_kind_of_line_is_written_once_in_a_while() -> None:
    limiter = RateLimiter(quiet_s=10.0, burst=2)
    allowed = [limiter.allow("a", t) for t in (0.0, 1.0, 2.0, 9.9, 10.0, 10.5, 11.0)]
    assert allowed == [
        "",
        "",
        None,
        None,
        " (and 2 like it before)",
        None,
        " (and 1 like it before)",
    ]
    assert limiter.allow("b", 11.0) == ""


def test_the_status_names_only_what_the_schema_knows() -> None:
    known = {m.name for m in schema.MESSAGES}
    assert known >= record.JSON_TOPICS
    events = {member.name.lower() for member in schema.Event}
    assert events >= phrases.FAULTS | phrases.DETAILS.keys()
    causes = {member.name.lower() for member in schema.ResetCauseFlags}
    assert causes >= phrases.WITH_ADDRESS
    assert set(Session(lambda _: None, 0).counts()) >= {"corrupt", "foreign"}  # type: ignore[arg-type,return-value] # none is found here
