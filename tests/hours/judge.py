# SPDX-License-Identifier: MIT
"""Judges what a probe says for hours: each pose against the twin's, the sequence
numbers, the device clock, the stack, and how long it was silent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from imud.probes.ledger import totals
from imud.probes.probe import Probe
from imud.probes.session import Event, ProbeFound, Received, Session
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import TwinDiffers, TwinLost, TwinState
from imud.wire.messages import Message

_WRAP = 1 << 32  # of the device clock, us

# The longest fault of the plan is 5 s; then the sensor is set up again.
SILENT_MAX_S = 9.0
# From the start of a stream until its twin follows: a second until the filter is
# restarted, as the plan has it.
WAITS_MAX_S = 3.0
# A status tells whole seconds, and comes some messages later than it was filled in.
UPTIME_SLACK_S = 2.0
# What the stack must leave of its room: an interrupt of the deepest kind, once more.
STACK_FREE_MIN = 64
# Where a fault makes floods of events, the wire may have no room for a message, which
# is counted. Of all that are sent:
DROPPED_MAX = 1e-6
# As many problems as one reads; all are counted.
PROBLEMS_MAX = 20


class Judge:
    """Checks a probe's bytes. `problems` lists the errors, the first one first."""

    def __init__(self) -> None:
        self.problems: list[str] = []
        self.problem_count = 0
        self.poses = self.raws = 0
        self.twin = Twin()
        self.events: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()  # replies other than ok
        self.status: Mapping[str, Any] = {}
        self.stack_free: int | None = None  # the least since part() was called
        self.silent_s = 0.0  # the longest since then
        self.device_us = 0  # of the latest message, without wraps
        self._last_us: int | None = None
        self._raw_us: int | None = None  # None: it does not stream
        self._followed_us: int | None = None  # the twin did; None: it waits too long
        self._probe = Probe("")
        self._session = Session(self._named)

    @property
    def wraps(self) -> int:
        """How often the device clock wrapped."""
        return self.device_us // _WRAP

    def take(self, data: bytes) -> None:
        self._see(self._session.receive(data, None))

    def part(self) -> dict[str, Any]:
        """Totals so far, and the extremes since the last call."""
        found = {
            "hours": round(self.device_us / 3.6e9, 3),
            "wraps": self.wraps,
            "poses": self.poses,
            "compared": self.twin.compared,
            "differed": self.twin.differed,
            "raws": self.raws,
            "faults_told": sum(
                self.events[name] for name in ("bus_fault", "sensor_fault")
            ),
            "stack_free": self.stack_free,
            "silent_s": round(self.silent_s, 2),
            "problems": self.problem_count,
        }
        self.stack_free, self.silent_s = None, 0.0
        return found

    def end(self, summary: Mapping[str, Any]) -> dict[str, Any]:
        """The run is over; `summary` is the emulator's. Returns the last counts."""
        self._see(self._session.close())
        total = totals(self._probe.account.counts())
        dropped = int(self.status.get("messages_dropped", 0))
        received = total.received + dropped
        if dropped > 1 + total.sent * DROPPED_MAX:
            self._problem(f"{dropped} of {total.sent} messages were dropped")
        link = self._session.counts()
        for name, found, expected in (
            ("lost messages, of those dropped", total.lost, dropped),
            ("skewed messages", total.skewed.total(), 0),
            ("duplicated messages", total.duplicated, 0),
            ("received and dropped, of those sent", received, total.sent),
            (
                *("good frames, of those that left the UART", link["frames"]),
                summary["frames"],
            ),
            ("corrupt frames", link["corrupt"], 0),
            ("boots", self._probe.account.boots, 1),
            ("resets", summary["resets"], 0),
            ("crashed", summary["crashed"], False),
            ("complaint of the firmware", summary["firmware_complaint"], None),
            ("complaint of the sensor", summary["sensor_complaint"], None),
        ):
            if found != expected:
                self._problem(f"{name}: {found}, expected {expected}")
        return {
            "sent": total.sent,
            "received": total.received,
            "lost": total.lost,
            "dropped": dropped,
            "resets": summary["resets"],
            "commands_refused": dict(sorted(self.refused.items())),
            "events": dict(sorted(self.events.items())),
            "commands_bad": self.status.get("commands_bad"),
        }

    def _named(self, name: str) -> Probe:
        self._probe = Probe(name)
        return self._probe

    def _see(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, Received):
                self._message(event)
            elif isinstance(event, ProbeFound):
                self.twin.on_probe_found()
                if event.is_restart:
                    self._problem("it restarted")
            else:
                self._problem(f"{type(event).__name__}: {event}")

    def _message(self, event: Received) -> None:
        message = event.message
        self._clock(message.time_us)
        match message.name:
            case "pose":
                self.poses += 1
            case "raw":
                self._on_raw()
            case "status":
                self._on_status(message)
            case "event":
                self._on_event(message)
            case "reply":
                if message.fields["result"] != "ok":
                    command = message.fields["replied_command"]
                    self.refused[f"{command} {message.fields['result']}"] += 1
        outcome = self.twin.on_message(message, event.content, event.params)
        if isinstance(outcome, (TwinDiffers, TwinLost)):
            self._problem(f"the twin: {str(outcome)[:200]}")

    def _clock(self, time_us: int) -> None:
        if self._last_us is None:
            self.device_us = time_us
        else:
            step_us = (time_us - self._last_us + _WRAP // 2) % _WRAP - _WRAP // 2
            self.device_us += step_us
        self._last_us = time_us

    def _on_raw(self) -> None:
        self.raws += 1
        if self._raw_us is not None:
            silent_s = (self.device_us - self._raw_us) * 1e-6
            self.silent_s = max(self.silent_s, silent_s)
            if silent_s > SILENT_MAX_S:
                self._problem(f"no sample for {silent_s:.1f} s")
        self._raw_us = self.device_us
        if self.twin.state is TwinState.FOLLOWING:
            self._followed_us = self.device_us
        elif (
            self._followed_us is not None
            and self.device_us - self._followed_us > WAITS_MAX_S * 1e6
        ):
            self._problem(f"the twin is {self.twin.state.value}, not following")
            self._followed_us = None

    def _on_event(self, message: Message) -> None:
        name = str(message.fields["event"])
        self.events[name] += 1
        if name == "stream_started":
            self._raw_us = self._followed_us = self.device_us
        elif name == "stream_stopped":
            self._raw_us = None

    def _on_status(self, message: Message) -> None:
        self.status = status = message.fields
        free = int(status["stack_free"])
        self.stack_free = min(free, self.stack_free or free)
        if free < STACK_FREE_MIN:
            self._problem(f"the stack has left {free} bytes")
        uptime_s = int(status["uptime"])
        if abs(uptime_s - self.device_us * 1e-6) > UPTIME_SLACK_S:
            self._problem(f"up for {uptime_s} s, at {self.device_us * 1e-6:.1f} s")

    def _problem(self, text: str) -> None:
        self.problem_count += 1
        if len(self.problems) < PROBLEMS_MAX:
            self.problems.append(f"at {self.device_us * 1e-6:.3f} s: {text}")
