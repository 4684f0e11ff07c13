# SPDX-License-Identifier: MIT
"""Copies the good parts of a log that was cut off or damaged, as a complete log."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from mcap.records import Channel, Metadata, Schema

from imud.log.chunk import ChunkRecord
from imud.log.parts import Damage, channels_of, parts_of, seal
from imud.log.reader import opened
from imud.log.writer import LogWriter
from imud.version import version


class Copy:
    """Writes a log from the records of another."""

    def __init__(self, writer: LogWriter) -> None:
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self.messages = 0
        self.latest_ns = 0  # when the last of them was received
        self.unknown = 0  # messages of a channel that is lost
        self.damages: list[Damage] = []

    def learn(self, records: Iterable[Schema | Channel]) -> None:
        for record in records:
            self.add(record)

    def add(self, record: ChunkRecord | Metadata) -> None:
        writer = self._writer
        if isinstance(record, Schema):
            if record.id not in self._schemas:
                self._schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
        elif isinstance(record, Channel):
            if record.id not in self._channels:
                self._channels[record.id] = writer.register_channel(
                    record.topic,
                    record.message_encoding,
                    self._schemas.get(record.schema_id, 0),
                    record.metadata,
                )
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
        elif record[0] in self._channels:
            self.messages += 1
            channel, number, logged_ns, measured_ns, data = record
            to = self._channels[channel]
            self.latest_ns = max(self.latest_ns, logged_ns)
            writer.add_message(to, logged_ns, data, measured_ns, number)
        else:
            self.unknown += 1


def copy_good(
    path: Path,
    to: Path,
    on_progress: Callable[[int], None],
    add: Callable[[LogWriter, int], None] | None = None,
) -> Copy:
    """Writes `to`, and says what is in it. `on_progress` gets the offset in bytes;
    `add` adds what belongs beside it, up to the time (ns) at which the part ends.
    """
    with opened(path) as file, to.open("wb") as out:
        writer = LogWriter(out, f"imud {version()}")
        copy = Copy(writer)
        copy.learn(channels_of(path))
        for each in parts_of(file, os.fstat(file.fileno()).st_size):
            if isinstance(each, Damage):
                copy.damages.append(each)
                continue
            for record in each.records:
                copy.add(record)
            if add is not None:
                add(writer, copy.latest_ns)
            writer.flush()  # damage of the copy is to cost no more
            on_progress(each.end)
        if add is None:
            lost = str(sum(each.size for each in copy.damages))
            origin = {"from": path.name, "bytes_lost": lost}
            writer.add_metadata("recovered", seal("recovered", origin))
        writer.finish()
        os.fsync(out.fileno())
    return copy
