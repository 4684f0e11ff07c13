# SPDX-License-Identifier: MIT
"""Hands messages to the stages of their probe, and carries out their results."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from imud.daemon.lines import ProbeLines
from imud.daemon.publisher import RecordPublisher
from imud.daemon.registry import ProbeEntry
from imud.probes.record import record_of
from imud.probes.session import ProbeFound, Received
from imud.stages import (
    InjectMessage,
    LogLine,
    Publish,
    SendCommands,
    Stage,
    StageResult,
)
from imud.wire.messages import Message, decode


class StageRunner:
    """Where stages meet the daemon. `on_commands` sends a probe, by its name, some."""

    def __init__(self, publisher: RecordPublisher, lines: ProbeLines) -> None:
        self._publisher = publisher
        self._lines = lines
        self.on_commands: Callable[[str, SendCommands], None] = lambda *_: None

    def on_probe_found(self, entry: ProbeEntry, found: ProbeFound) -> None:
        for stage in entry.stages:
            stage.on_probe_found(found)

    def replaces(self, entry: ProbeEntry, name: str) -> bool:
        """Whether a stage computes messages of that kind in the place of the probe's
        own now.
        """
        return any(name in stage.replaced for stage in entry.stages)

    def on_message(self, entry: ProbeEntry, received: Received) -> None:
        for stage in entry.stages:
            for result in stage.on_message(received):
                self._carry_out(entry, stage, received, result)

    def _carry_out(
        self, entry: ProbeEntry, stage: Stage, received: Received, result: StageResult
    ) -> None:
        if isinstance(result, SendCommands):
            self.on_commands(entry.name, result)
        elif isinstance(result, LogLine):
            self._lines.of_stage(entry, stage, result)
        elif isinstance(result, Publish):
            t_ns, sequence = entry.last_heard_ns, received.message.sequence
            self._publisher.say(entry, result.topic, result.values, t_ns, sequence)
        elif isinstance(result, InjectMessage):
            self._inject(entry, received, result)

    def _inject(
        self, entry: ProbeEntry, received: Received, added: InjectMessage
    ) -> None:
        message = decode(added.content)
        if not isinstance(message, Message):
            raise TypeError(f"a stage injected {message}")
        number = entry.next_number(message.name)
        stamp = msgspec.structs.replace(received.stamp, number=number, missing=0)
        record = record_of(
            message,
            added.content,
            entry.name,
            stamp,
            received.scales,
            entry.north,
            entry.host_flags,
            entry.probe.references,
        )
        self._publisher.put(entry, msgspec.structs.replace(record, content=b""))
        if message.name == "pose":
            entry.poses += 1
            entry.take_pose(record.values)
