# SPDX-License-Identifier: MIT
"""Faults that a probe reports as events: what each means, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass

from imud.probes.chip import DIES
from imud.probes.sensors import UNREADABLE, identity_words

# Events after which the sensor may be out of work.
OF_SENSOR = frozenset({"bus_fault", "sensor_fault"})


@dataclass(frozen=True, slots=True)
class _Wiring:
    """How a board's sensor is connected: docs/nano.md, f405.md, pico.md."""

    address: str
    lines: str  # to check if nobody answers
    ready: str  # the data-ready pin


_WIRING = {
    "nano": _Wiring("0x68", "power, SDA, SCL, AD0 to GND", "INT to D2"),
    "mega": _Wiring("0x68", "power, SDA (20), SCL (21), AD0 to GND", "INT to 2"),
    "f405": _Wiring(
        "0x6B or 0x1D",
        "power, SDA (X10), SCL (X9), SDO_G and SDO_XM to 3.3 V",
        "DRDY_G to Y11",
    ),
    "pico": _Wiring("0x68", "power, SDA (GP4), SCL (GP5), AD0 to GND", "INT to GP6"),
}
_OTHER = _Wiring(
    "the sensor's address", "power, SDA, SCL, the address pin", "its data-ready pin"
)
# What a bus reads where nobody drives it, or where it is held.
_NO_IDENTITIES = (0x00, 0xFF)

_NOT_READ = (
    "which this firmware can't read: buy an MPU-9250 (0x71), or an LSM6DSOX with a "
    "LIS3MDL (Adafruit 4517)"
)

# By event and cause; {} is the detail.
_WORDS = {
    ("bus_fault", "nack"): "no answer at {address}: check {lines}",
    ("bus_fault", "timeout"): (
        "a transfer at {address} does not end: check {lines}, and the pull-ups"
    ),
    ("bus_fault", "stuck_bus"): (
        "SDA or SCL is held low, and nine clocks do not free it: check both for a "
        "short, and the module's power"
    ),
    ("sensor_fault", "timeout"): (
        "the sensor answers but does not become ready: switch its power off and on; "
        "if that does not help, replace the module"
    ),
    ("sensor_fault", "no_data_ready"): (
        "the sensor signals no samples: check {ready}, then {lines}"
    ),
    ("sensor_fault", "mag_silent"): (
        "the magnetometer stopped measuring, or answers again: the sensor is set up "
        "again. If this repeats, check the module's power, then replace the module"
    ),
    ("sensor_fault", "mag_stuck"): (
        "the magnetometer blocks its bus; the probe retries, without heading "
        "meanwhile. If this repeats, switch the power off and on"
    ),
    ("calibration_refused", "motion"): (
        "the probe moved during its gyroscope's calibration at rest ({} counts): lay "
        "it down"
    ),
    ("overrun", "late"): "samples missed: {}; the processor was busy",
    ("settings_restored", "boot"): (
        "the stored settings were damaged or there were none: defaults are in use"
    ),
    ("settings_failed", "none"): (
        "the settings can't be stored: they are lost at power-off"
    ),
    ("params_lost", "worn"): (
        "the stored params are damaged: restore a saved file with imud params load"
    ),
    ("card_fault", "absent"): "no card: insert one prepared by imud card prepare",
    ("card_fault", "unprepared"): "the card is not prepared: run imud card prepare",
    (
        "card_fault",
        "timeout",
    ): "the card does not answer in time: reinsert or replace it",
    ("card_fault", "rejected"): (
        "data arrives damaged at the card, at block {}: shorten its wires, or replace "
        "it"
    ),
    ("card_fault", "worn"): (
        "the card does not store what is written, at block {}: replace it"
    ),
    ("card_fault", "late"): (
        "the card writes too slowly, at block {}: messages are not logged; use a "
        "faster one"
    ),
    ("card_full", "full"): (
        "the card is full: copy its recordings with imud card read, then prepare it "
        "again"
    ),
    ("battery_low", "battery"): "the battery is at {} mV: charge it",
    ("going_to_sleep", "battery"): "the battery is at {} mV: charge it",
    ("radio_dropped", "none"): "the host is out of range, or closed the link",
    ("radio_fault", "timeout"): (
        "the radio module does not answer: check its power and wires"
    ),
    ("radio_fault", "rejected"): (
        "the radio module refuses its settings: check its wires and its firmware"
    ),
    ("radio_fault", "none"): "the radio module was reset: check its power and wires",
    ("hook_failed", "none"): (
        "main.py raised an exception in supply, battery or hook, {} times since its "
        "start: see docs/micropython.md"
    ),
    ("hook_failed", "rejected"): (
        "imuprobe.mpy is of another processor or MicroPython, or has no room: raw "
        "samples are sent. Copy the file for this board: see docs/micropython.md"
    ),
    ("data_ready_polled", "no_data_ready"): (
        "the sensor is polled, because its data-ready signal does not come: for exact "
        "times check {ready}"
    ),
    ("bus_recovered", "none"): "the sensor works again",
    ("bus_recovered", "no_data_ready"): "data-ready signals come again",
}
# When the crystal failed, by the detail: 0 or 1.
_CLOCK_FAILED = ("at startup", "while running")


def fault_words(event: str, cause: str, detail: int, board: str = "") -> str:
    """The fault and its remedy; empty for an event that is not a fault."""
    if event == "clock_failed":
        return (
            f"the crystal failed {_CLOCK_FAILED[detail != 0]}; the internal oscillator "
            "runs instead, good to 1 %: replace the board"
        )
    if event == "sensor_fault" and cause in _BY_IDENTITY:
        return _BY_IDENTITY[cause](detail, board)
    words = _WORDS.get((event, cause), "")
    wiring = _WIRING.get(board, _OTHER)
    text = words.format(
        detail, address=wiring.address, lines=wiring.lines, ready=wiring.ready
    )
    in_a_row = f", {detail} times in a row:" if detail > 1 else ":"
    return text.replace(":", in_a_row, 1) if event == "bus_fault" else text


def _wrong_chip(detail: int, board: str) -> str:
    wiring = _WIRING.get(board, _OTHER)
    if detail in _NO_IDENTITIES:
        return (
            f"answers 0x{detail:02X} at {wiring.address}, which is no chip's identity: "
            f"check {wiring.lines}"
        )
    if board == "f405":
        return (
            f"answers 0x{detail:02X} at {wiring.address}, which is not an LSM9DS0 (it "
            "answers 0xD4 and 0x49): check SDO_G and SDO_XM to 3.3 V, then replace "
            "the module"
        )
    if detail in UNREADABLE:
        return f"answers {identity_words(detail)}, {_NOT_READ}"
    return (
        f"answers {identity_words(detail)} at {wiring.address}, which no sensor that "
        "this firmware can read does: it may be a real-time clock (DS3231, DS1307, "
        "PCF8523), and nothing was written to it. Connect the sensor, and take off "
        "what else has its address"
    )


def _registers(detail: int, _: str) -> str:
    identity, register = detail & 0xFF, detail >> 8 & 0xFF
    what = f"register 0x{register:02X} does not hold what was written to it"
    if identity in DIES and DIES[identity].sensor:
        return (
            f"{what}: the sensor's supply sags or a wire is loose: check power and GND "
            "of the module"
        )
    if identity in UNREADABLE:
        return f"{what}: it answers {identity_words(identity)}, {_NOT_READ}"
    return (
        f"{what}, and it answers {identity_words(identity)}, which is not an MPU-9250 "
        "(0x71): if power and GND of the module are right, replace it"
    )


def _force(detail: int, _: str) -> str:
    return (
        "the accelerometer measures no force near 1 g at rest (it answers "
        f"{identity_words(detail)}): hold it still; if that does not help, it is "
        "broken or of another family: replace the module"
    )


_BY_IDENTITY = {"wrong_chip": _wrong_chip, "registers": _registers, "force": _force}
