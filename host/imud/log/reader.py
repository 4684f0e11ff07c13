# SPDX-License-Identifier: MIT
"""Reads the MCAP files of `imud run`, also cut off or damaged ones.

Messages are only taken from chunks, each of which has a CRC. The caller decides whether
damage is skipped or ends the reading.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import msgspec
from mcap.records import Channel, Metadata, Schema
from msgspec.structs import replace

from imud.defaults import PROBES_MAX
from imud.errors import FileError
from imud.log.chunk import NAME_MAX
from imud.log.parts import Damage, RecordGroup, channels_of, parts_of
from imud.log.writer import MAGIC
from imud.machine import system
from imud.wire import kept
from imud.wire.kept import KeptSchema

# The content of a frame: id, sequence, time and tagged fields, see PROTOCOL.md.
FRAME_ENCODING = "x-imud-frame"


# Metadata about a probe, and the topics under which they are read.
METADATA_OF_PROBES = {"hello": "hello", "params": "params_records"}


@dataclass(frozen=True, slots=True)
class LogHead:
    """The version of imud that wrote a log, and the fingerprint of its schema."""

    version: str
    fingerprint: int


class Logged(msgspec.Struct, frozen=True):
    """One message of a log. `topic` is the last part of its channel's name."""

    probe: str
    topic: str
    data: bytes
    t_ns: int  # UTC: when it was received
    t_sample_ns: int = 0  # UTC: when it was measured
    prefix: str = ""  # the part of its channel's name before the probe
    values: dict[str, Any] | None = None  # the object, where `data` does not hold it


def is_being_written(path: Path) -> bool:
    """Whether a process writes this log now: it holds a lock meanwhile."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        return not system.try_lock(file, is_shared=True)
    return False


class Reader:
    """Makes messages of the parts of a log."""

    def __init__(self, known: Iterable[Schema | Channel] = ()) -> None:
        self._channels: dict[int, tuple[str, str, str]] = {}
        self._probes: set[str] = set()
        for each in known:
            if isinstance(each, Channel):
                self._know(each)
        self._written_in: KeptSchema | None = None
        self.count = 0
        self.unknown = 0  # messages whose channel was in a damaged part

    def read(self, part: RecordGroup) -> Iterator[LogHead | Logged]:
        """The messages of a part; those of unknown channels are only counted."""
        for record in part.records:
            if isinstance(record, tuple):
                number, _, logged_ns, measured_ns, data = record
                channel = self._channels.get(number)
                if channel is None:
                    self.unknown += 1
                    continue
                self.count += 1
                prefix, probe, topic = channel
                data = self._in_ours(topic, data)
                yield Logged(probe, topic, data, logged_ns, measured_ns, prefix)
            elif isinstance(record, Channel):
                self._know(record)
            elif isinstance(record, Metadata):
                found = _parsed(record)
                if isinstance(found, Logged):
                    if not self._has_room(found.probe):
                        continue
                    content = self._in_ours(found.topic, found.data)
                    found = replace(found, data=content)
                elif found is not None:
                    self._written_in = kept.find(found.fingerprint)
                if found is not None:
                    yield found

    def topic_of(self, channel: int) -> str | None:
        """None: it was in no part that was read."""
        return self._channels.get(channel, (None, None, None))[2]

    def _in_ours(self, topic: str, data: bytes) -> bytes:
        if self._written_in is None or topic not in ("frame", "hello"):
            return data
        return self._written_in.to_ours(data)

    def _know(self, channel: Channel) -> None:
        prefix, probe, topic = split(channel.topic)
        if self._has_room(probe):
            self._channels[channel.id] = prefix, probe, topic

    def _has_room(self, probe: str) -> bool:
        if len(self._probes) < PROBES_MAX:
            self._probes.add(probe)
        return probe in self._probes


def _parsed(record: Metadata) -> LogHead | Logged | None:
    """The values of our metadata; None for other metadata, or another version."""
    values = record.metadata
    try:
        if record.name == "imud":
            version = named(values["version"])
            return LogHead(version, int(values["schema_fingerprint"], 16))
        if record.name in METADATA_OF_PROBES:
            topic = METADATA_OF_PROBES[record.name]
            probe, content = named(values["probe"]), bytes.fromhex(values["content"])
            return Logged(probe, topic, content, 0)
    except (KeyError, ValueError):
        pass
    return None


def salvage(
    path: Path, on_progress: Callable[[int], None] = lambda _: None
) -> Iterator[LogHead | Logged | Damage]:
    """All good messages of a log, also behind damage, which is yielded as Damage.

    `on_progress` gets the offset in bytes.
    """
    with opened(path) as file, legible(path):
        reader = Reader(channels_of(path))
        for part in parts_of(file, path.stat().st_size):
            if isinstance(part, Damage):
                yield part
            else:
                on_progress(part.end)
                yield from reader.read(part)


def opened(path: Path) -> BinaryIO:
    """Opens a log for reading; FileError if it is no MCAP file or can't be opened."""
    with legible(path):
        file = path.open("rb")
        with contextlib.ExitStack() as undone:
            undone.push(file)
            if file.read(len(MAGIC)) != MAGIC:
                raise FileError(
                    f"{path} is not a log of imud run, which is an MCAP file"
                )
            undone.pop_all()
        return file


def size_of(path: Path) -> int:
    """The size of a log in bytes; FileError if it is none."""
    with opened(path) as file:
        return file.seek(0, io.SEEK_END)


@contextlib.contextmanager
def legible(path: Path) -> Iterator[None]:
    """Turns an OSError into a FileError."""
    try:
        yield
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror}") from error


def named(text: str) -> str:
    """A name as it may be shown: control characters would reach the terminal."""
    return "".join(c if c.isprintable() else "?" for c in text[:NAME_MAX])


def split(topic: str) -> tuple[str, str, str]:
    """Splits the name of a channel, PREFIX/PROBE/TOPIC, which may be a stranger's."""
    topic = named(topic)
    prefix, _, rest = topic.rpartition("/")[0].rpartition("/")
    last = topic.rpartition("/")[2]
    return (prefix, rest, last) if rest else ("", "", last)
