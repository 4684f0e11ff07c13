# SPDX-License-Identifier: MIT
"""`imud recover`: writes the good part of a cut or damaged log as a complete log."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable
from pathlib import Path

from mcap.records import Channel, Message, Metadata, Schema

from imud.errors import FileError
from imud.log.parts import Damage, channels_of, parts_of, seal
from imud.log.reader import opened, size_of
from imud.log.writer import LogWriter
from imud.progress import Progress
from imud.version import version


class _Copy:
    """Writes a log from the records of another."""

    def __init__(self, writer: LogWriter) -> None:
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self.messages = 0
        self.unknown = 0  # messages of a channel that is lost

    def learn(self, records: Iterable[Schema | Channel]) -> None:
        for record in records:
            self.add(record)

    def add(self, record: Schema | Channel | Message | Metadata) -> None:
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
        elif record.channel_id in self._channels:
            self.messages += 1
            writer.add_message(
                self._channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )
        else:
            self.unknown += 1


def run(path: Path, to: Path | None) -> int:
    """Writes a complete log beside the damaged one, or to `to`; returns 0.

    Raises FileError if nothing is good or the file exists.
    """
    size = size_of(path)
    to = to or path.with_name(f"{path.stem}-recovered.mcap")
    if os.path.lexists(to):
        raise FileError(f"{to} already exists; choose another file with --to")
    part = to.with_name(f"{to.name}.part")
    try:
        copy, damages = _copy(path, size, part)
        if damages and copy.messages:
            _put(part, to)
    except OSError as error:
        raise FileError(f"can't recover {path} to {to}: {error.strerror}") from error
    finally:
        part.unlink(missing_ok=True)
    if not damages:
        sys.stdout.write(f"{path} is intact, with {_messages(copy.messages)}\n")
        return 0
    if not copy.messages:
        raise FileError(f"{path} has no intact messages")
    sys.stdout.write(f"{to}: {_messages(copy.messages)} saved; {_words(damages)}\n")
    if copy.unknown:
        sys.stdout.write(
            f"{_messages(copy.unknown)} left out: their probe is unknown, as that "
            "part is lost\n"
        )
    return 0


def _copy(path: Path, size: int, part: Path) -> tuple[_Copy, list[Damage]]:
    damages: list[Damage] = []
    bar = Progress("recovering", size)
    with opened(path) as file, part.open("wb") as out:
        writer = LogWriter(out, f"imud {version()}")
        copy = _Copy(writer)
        copy.learn(channels_of(path))
        try:
            for each in parts_of(file, size):
                if isinstance(each, Damage):
                    damages.append(each)
                    continue
                for record in each.records:
                    copy.add(record)
                writer.flush()  # damage of the copy is to cost no more
                bar.update(each.end)
        finally:
            bar.end()
        lost = str(sum(each.size for each in damages))
        origin = {"from": path.name, "bytes_lost": lost}
        writer.add_metadata("recovered", seal("recovered", origin))
        writer.finish()
        os.fsync(out.fileno())
    return copy, damages


def _put(part: Path, to: Path) -> None:
    """Gives a finished file its name; fails if that exists."""
    try:
        os.link(part, to)
    except FileExistsError:
        raise
    except OSError:
        # A file system without hard links, as on cards.
        with contextlib.suppress(FileNotFoundError):
            part.rename(to)


def _words(damages: list[Damage]) -> str:
    holes = [each for each in damages if not each.is_tail]
    tails = [each for each in damages if each.is_tail]
    sentences = []
    if holes:
        lost = sum(each.size for each in holes)
        sentences.append(f"{lost} damaged bytes in {_places(len(holes))} lost")
    if tails:
        lost = sum(each.size for each in tails)
        sentences.append(
            f"truncated, {lost} bytes at its end lost" if lost else "truncated"
        )
    return ", ".join(sentences)


def _places(count: int) -> str:
    return "1 place" if count == 1 else f"{count} places"


def _messages(count: int) -> str:
    return "1 message" if count == 1 else f"{count} messages"
