# SPDX-License-Identifier: MIT
"""Problems of a probe's sensors, for its status and for the journal."""

from __future__ import annotations

from typing import Any

from imud.daemon.registry import ProbeEntry, SensorFault
from imud.journal.faults import OF_SENSOR, fault_words
from imud.probes.sensors import SensorFinding, findings_of, flags_of
from imud.wire.messages import Message

_UNKNOWN_FAULT = "the sensor does not work: restart the probe to find the reason"


def follow_status(entry: ProbeEntry) -> None:
    """A transfer that failed for once is over with a status that tells no fault."""
    if entry.counters.get("state") != "fault":
        entry.fault = None


def follow_event(entry: ProbeEntry, event: Message) -> None:
    """Remembers why the sensor of the probe does not work."""
    name, cause, detail = (event.fields[key] for key in ("event", "cause", "detail"))
    if name in OF_SENSOR and isinstance(detail, int):
        entry.fault = SensorFault(str(name), str(cause), detail)
    elif name == "bus_recovered":
        entry.fault = None


def is_working(entry: ProbeEntry) -> bool:
    """Whether the probe has found its sensor, and it answers."""
    fault = entry.fault
    if fault is not None and fault.is_lasting:
        return False
    is_found = entry.probe.hello.get("sensor", "none") != "none"
    return is_found and entry.counters.get("state") != "fault"


def sensor_findings(entry: ProbeEntry) -> list[SensorFinding]:
    """Problems of sensors that work. A hello during a set-up does not report the
    sensors that are present.
    """
    if not is_working(entry):
        return []
    return findings_of(entry.probe.hello, entry.probe.verdicts)


def sensors_of(entry: ProbeEntry) -> dict[str, Any]:
    """The sensors in a probe's status."""
    verdicts = entry.probe.verdicts
    words = [finding.words for finding in sensor_findings(entry)]
    if entry.counters.get("state") == "fault":
        words = [_fault_words(entry)]
    return {
        "is_working": is_working(entry),
        "self_test": {
            verdict.sensor: {
                "outcome": verdict.outcome.value,
                "reason": verdict.reason,
            }
            for verdict in verdicts
        },
        "words": words,
        "flags": flags_of(verdicts),
    }


def _fault_words(entry: ProbeEntry) -> str:
    fault, board = entry.fault, str(entry.probe.hello.get("board", ""))
    if fault is None:
        return _UNKNOWN_FAULT
    text = fault_words(fault.event, fault.cause, fault.detail, board)
    return text or _UNKNOWN_FAULT
