# SPDX-License-Identifier: MIT
"""Phrases for the journal's lines about probes, their events and their ports."""

from __future__ import annotations

from collections.abc import Sequence

from imud.journal.faults import fault_words
from imud.probes.record import plain
from imud.probes.sensors import sensor_words
from imud.probes.session import OnlyNoise, OtherSchema, Silent
from imud.wire import schema
from imud.wire.messages import Message

# Events that are told as warnings.
FAULTS = frozenset(
    {
        "bus_fault",
        "overrun",
        "calibration_refused",
        "sensor_fault",
        "settings_restored",
        "settings_failed",
        "clock_failed",
        "card_fault",
        "card_full",
        "battery_low",
        "going_to_sleep",
        "radio_dropped",
        "radio_fault",
        "params_lost",
        "hook_failed",
    }
)

# The meaning of the detail of other events; of an event that is not listed, a bare
# number.
DETAILS = {
    "calibration_done": "{} samples",
    "card_ready": "at block {}",
    "log_started": "recording {}",
    "log_ended": "recording {}",
}

# Causes of a reset that leave the address of the code that ran.
WITH_ADDRESS = frozenset({"hard_fault", "watchdog"})


def port_problem(
    port: str, event: OnlyNoise | Silent | OtherSchema, bauds: Sequence[int]
) -> str:
    """The line about a port without a probe that this imud can read."""
    if isinstance(event, OnlyNoise):
        rates = f" at {' or '.join(map(str, bauds))} baud" if bauds else ""
        return (
            f"{port}: {event.count} bytes without a valid message; "
            f"check that it is a probe{rates}"
        )
    if isinstance(event, Silent):
        return (
            f"{port}: nothing received for {event.seconds:.0f} s; check that the "
            "probe is powered"
        )
    return (
        f"{port}: probe {event.probe_id} has schema {event.fingerprint:#010x} "
        f"(firmware {event.firmware}), this imud has {schema.FINGERPRINT:#010x}: "
        "update one of them"
    )


def who(hello: Message) -> str:
    """The description of a probe from its hello: board, firmware, sensor, rates,
    boot."""
    fields = {name: plain(value) for name, value in hello.fields.items()}
    rates = ", ".join(
        f"{label} {fields[name]} Hz" if fields[name] else f"{label} off"
        for label, name in (
            ("samples", "sample_rate"),
            ("pose", "pose_rate"),
            ("raw", "raw_rate"),
        )
    )
    has_sensor = fields["sensor"] != "none"
    runs = f"{sensor_words(fields)}, {rates}, filter {fields['filter']}"
    sensor = runs if has_sensor else "no sensor yet"
    cause = ", ".join(
        f"{name} at {fields['reset_address']:#010x}"
        if name in WITH_ADDRESS and fields["reset_address"]
        else name
        for name in fields["reset_cause"]
    ).replace("_", " ")
    return (
        f"{fields['board']}, firmware {fields['firmware']}, {sensor}, boot "
        f"{fields['boot_count']} ({cause or 'cause unknown'})"
    )


def event_words(name: str, cause: str, detail: int, board: str = "") -> str:
    """An event in words: what happened, its cause, and what its detail means."""
    what = name.replace("_", " ")
    fault = fault_words(name, cause, detail, board)
    if fault:
        return f"{what}: {fault}"
    why = "" if cause == "none" else f" ({cause.replace('_', ' ')})"
    if name == "params_changed":
        return f"{what}{why}, digest {detail & 0xFFFFFFFF:08x}"
    if detail == 0:
        return f"{what}{why}"
    return f"{what}{why}, {DETAILS.get(name, '{}').format(detail)}"
