# SPDX-License-Identifier: MIT
"""Hands messages to the stages of their probe, and carries out what they answer."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import ProbeEntry
from imud.probes.record import record_of
from imud.probes.session import ProbeFound, Received
from imud.stages import Adds, Outcome, Says, Stage, Tells, Wants
from imud.wire.messages import Message, decode


class StageRunner:
    """Where stages meet the daemon. `on_want` has commands sent to a probe by name."""

    def __init__(self, publisher: RecordPublisher, lines: ProbeLines) -> None:
        self._publisher = publisher
        self._lines = lines
        self.on_want: Callable[[str, Wants], None] = lambda *_: None

    def appear(self, entry: ProbeEntry, found: ProbeFound) -> None:
        for stage in entry.stages:
            stage.appear(found)

    def take(self, entry: ProbeEntry, received: Received) -> None:
        for stage in entry.stages:
            for outcome in stage.take(received):
                self._carry_out(entry, stage, received, outcome)

    def _carry_out(
        self, entry: ProbeEntry, stage: Stage, received: Received, outcome: Outcome
    ) -> None:
        if isinstance(outcome, Wants):
            self.on_want(entry.name, outcome)
        elif isinstance(outcome, Tells):
            self._lines.of_stage(entry, stage, outcome)
        elif isinstance(outcome, Says):
            t_ns, sequence = entry.last_heard_ns, received.message.sequence
            self._publisher.say(entry, outcome.topic, outcome.values, t_ns, sequence)
        elif isinstance(outcome, Adds):
            self._add(entry, received, outcome)

    def _add(self, entry: ProbeEntry, received: Received, added: Adds) -> None:
        message = decode(added.content)
        if not isinstance(message, Message):
            raise TypeError(f"a stage added {message}")
        stamp = msgspec.structs.replace(received.stamp, number=added.number, missing=0)
        record = record_of(
            message,
            added.content,
            entry.name,
            stamp,
            received.scales,
            entry.north,
            entry.host_flags,
        )
        self._publisher.put(entry, msgspec.structs.replace(record, content=b""))
        if message.name == "pose":
            entry.poses += 1
            entry.pose = record.said
