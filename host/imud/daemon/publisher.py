# SPDX-License-Identifier: MIT
"""Hands records about probes to the hub, and counts them for the ledger."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from imud.daemon.hub import Hub
from imud.daemon.registry import ProbeEntry
from imud.probes.record import Presence, Record

AIM = "aim"  # topic: how near a probe is to where it should be

PATH = "path"  # topic: a path of strokes, closed

COMMAND = "command"  # topic: a command that was carried out, and who gave it

MARK = "mark"  # topic: a value or a note from outside, with the pose of then


class RecordPublisher:
    """The way of all records from the daemon to the hub."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._encoder = msgspec.json.Encoder()

    def put(self, entry: ProbeEntry, record: Record) -> None:
        """Hands a record to the hub, and after it what follows from it: how far a pose
        is from its aim.
        """
        entry.put += 1
        self._hub.put(record)
        if entry.aim is not None and record.topic == "pose" and record.values:
            captured = entry.probe.references.since_capture(entry.aim.capture)
            values = entry.aim.measure(record.values, captured)
            self.say(entry, AIM, values, record.t_ns, record.sequence)
        if record.values:
            entry.closer.on_record(record.values)
        if record.topic == "stroke":
            entry.gestures.forget_click()

    def say_closing(
        self, entry: ProbeEntry, closing: Mapping[str, Any], by: str, t_ns: int
    ) -> None:
        """The path of its strokes, closed at `t_ns` UTC by its button or a command."""
        self.say(entry, PATH, {"t_ns": t_ns, "by": by, **closing}, t_ns)

    def say(
        self,
        entry: ProbeEntry,
        topic: str,
        values: Mapping[str, Any],
        t_ns: int,
        sequence: int = 0,
    ) -> dict[str, Any]:
        """A record of the daemon's own, at `t_ns` UTC; `sequence` is that of the
        message it is about. Returns the object that is its payload.
        """
        published = {"type": topic, "probe": entry.name, **values}
        payload = self._encoder.encode(published)
        record = Record(entry.name, topic, payload, b"", sequence, t_ns, t_ns)
        self.put(entry, record)
        return published

    def set_alive(self, entry: ProbeEntry, *, is_alive: bool) -> None:
        if entry.is_alive != is_alive:
            entry.is_alive = is_alive
            self.announce(entry)

    def forget(self, entry: ProbeEntry) -> None:
        """Says that nothing more is known of a probe."""
        self._hub.put(Presence(entry.name, is_alive=False, is_forgotten=True))

    def announce(self, entry: ProbeEntry) -> None:
        """Says whether the probe is there."""
        self._hub.put(Presence(entry.name, entry.is_alive))
