# SPDX-License-Identifier: MIT
"""Reads the MCAP files of `imud run`, also cut off or damaged ones.

Messages are only taken from chunks, each of which has a CRC. The caller decides whether
damage is skipped or ends the reading.
"""

from __future__ import annotations

import contextlib
import fcntl
import io
import itertools
import struct
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, breakup_chunk

from imud.errors import FileError
from imud.log.writer import MAGIC

# The content of a frame: id, sequence, time and tagged fields, see PROTOCOL.md.
FRAME_ENCODING = "x-imud-frame"

# Our chunks are shorter. A longer record is damage, and no memory is allocated for it.
RECORD_MAX = 64 << 20

# Metadata about a probe, and the topics under which they are read.
METADATA_OF_PROBES = {"hello": "hello", "params": "params_records"}

# What the mcap library raises for a file that is cut off or changed.
DAMAGE = (
    McapError,
    CRCValidationError,
    EOFError,
    MemoryError,  # a damaged length
    OverflowError,
    KeyError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)

_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_KINDS = range(int(Opcode.HEADER), int(Opcode.DATA_END) + 1)

# The name of a chunk's compression, which stands behind its times, size and CRC. The
# search for the next chunk after damage looks for it.
_CHUNK_SIGN = b"\x04\0\0\0zstd"
_CHUNK_SIGN_AT = _RECORD.size + 28
_SEARCH = 1 << 20  # bytes at a time


@dataclass(frozen=True, slots=True)
class LogHead:
    """The version of imud that wrote a log, and the fingerprint of its schema."""

    version: str
    fingerprint: int


@dataclass(frozen=True, slots=True)
class Logged:
    """One message of a log. `topic` is the last part of its channel's name."""

    probe: str
    topic: str
    data: bytes
    t_ns: int  # UTC: when it was received
    t_sample_ns: int = 0  # UTC: when it was measured
    prefix: str = ""  # the part of its channel's name before the probe


@dataclass(frozen=True, slots=True)
class Damage:
    """A stretch of a log that can't be read, in bytes."""

    at: int
    size: int
    is_tail: bool  # nothing good follows


def is_being_written(path: Path) -> bool:
    """Whether a process writes this log now: it holds a lock meanwhile."""
    with contextlib.suppress(OSError), path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


@dataclass(frozen=True, slots=True)
class RecordGroup:
    """The records of a chunk, or a metadata record; `end` is the offset behind it."""

    end: int
    records: list[Schema | Channel | Message | Metadata]


def records_of(file: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
    """Each record up to the summary by its head alone: offset, kind, and offset of its
    body. Damage is left out.
    """
    at = len(MAGIC)
    while at + _RECORD.size <= size:
        file.seek(at)
        kind, length = _RECORD.unpack(file.read(_RECORD.size))
        if kind not in _KINDS or length > RECORD_MAX:
            at = _next_chunk(file, at + 1, size)
            continue
        if kind == Opcode.DATA_END:
            return
        yield at, kind, at + _RECORD.size
        at += _RECORD.size + length


def parts_of(
    file: BinaryIO, size: int, start: int = 0
) -> Iterator[RecordGroup | Damage]:
    """All parts of a log and its damage, in order, from that offset of a record on.
    Damage is last if it was cut off.
    """
    at = start or len(MAGIC)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        at = 0
    while at < size:
        try:
            part, is_end = _part(file, at)
        except DAMAGE:
            end = _next_chunk(file, at + 1, size)
            yield Damage(at, end - at, end == size)
            at = end
            continue
        if part.records:
            yield part
        if is_end:
            file.seek(max(0, size - len(MAGIC)))
            if file.read() != MAGIC:
                yield Damage(part.end, size - part.end, is_tail=True)
            return
        at = part.end
    yield Damage(size, 0, is_tail=True)


def _part(file: BinaryIO, at: int) -> tuple[RecordGroup, bool]:
    """The record at an offset, and whether it is the end of the data section."""
    file.seek(at)
    kind, length = _RECORD.unpack(file.read(_RECORD.size))
    if kind not in _KINDS or length > RECORD_MAX:
        raise ValueError(kind)
    body = file.read(length)
    if len(body) < length:
        raise EOFError
    end = at + _RECORD.size + length
    stream = ReadDataStream(BytesIO(body))
    if kind == Opcode.CHUNK:
        return RecordGroup(end, _opened(Chunk.read(stream))), False
    if kind == Opcode.METADATA:
        metadata = Metadata.read(stream)
        if not is_sealed(metadata):
            raise ValueError(metadata.name)
        return RecordGroup(end, [metadata]), False
    return RecordGroup(end, []), kind == Opcode.DATA_END


def _opened(chunk: Chunk) -> list[Schema | Channel | Message | Metadata]:
    records = breakup_chunk(chunk, validate_crc=True)
    return [each for each in records if isinstance(each, Schema | Channel | Message)]


def _next_chunk(file: BinaryIO, start: int, size: int) -> int:
    """The offset of the next good chunk, or the file's size."""
    at = start
    while at < size:
        file.seek(at)
        block = file.read(_SEARCH + len(_CHUNK_SIGN))
        place = block.find(_CHUNK_SIGN)
        if place < 0:
            at += _SEARCH
            continue
        begin = at + place - _CHUNK_SIGN_AT
        if begin >= start:
            try:
                if _part(file, begin)[0].records:
                    return begin
            except DAMAGE:
                pass
        at += place + 1
    return size


def seal(name: str, values: dict[str, str]) -> dict[str, str]:
    """Adds a CRC to metadata, which MCAP does not protect."""
    return values | {"crc32": _crc(name, values)}


def is_sealed(metadata: Metadata) -> bool:
    """Whether the CRC that `seal` added is right."""
    rest = dict(metadata.metadata)
    return rest.pop("crc32", None) == _crc(metadata.name, rest)


def _crc(name: str, values: dict[str, str]) -> str:
    parts = [name, *itertools.chain.from_iterable(sorted(values.items()))]
    text = "\0".join(parts)
    return f"{zlib.crc32(text.encode()):08x}"


def channels_of(path: Path) -> list[Schema | Channel]:
    """Schemas and channels from the summary at a log's end; empty if it has none.

    They are also in the chunk with their first message, but that may be damaged.
    """
    with path.open("rb") as file:
        try:
            summary = make_reader(file, validate_crcs=True).get_summary()
        except (*DAMAGE, OSError):  # a damaged offset
            return []
    if summary is None:
        return []
    return [*summary.schemas.values(), *summary.channels.values()]


class Reader:
    """Makes messages of the parts of a log."""

    def __init__(self, known: Iterable[Schema | Channel] = ()) -> None:
        self._channels = {
            each.id: split(each.topic) for each in known if isinstance(each, Channel)
        }
        self.count = 0
        self.unknown = 0  # messages whose channel was in a damaged part

    def read(self, part: RecordGroup) -> Iterator[LogHead | Logged]:
        """The messages of a part; those of unknown channels are only counted."""
        for record in part.records:
            if isinstance(record, Channel):
                self._channels[record.id] = split(record.topic)
            elif isinstance(record, Message):
                channel = self._channels.get(record.channel_id)
                if channel is None:
                    self.unknown += 1
                    continue
                self.count += 1
                prefix, probe, topic = channel
                yield Logged(
                    probe,
                    topic,
                    record.data,
                    record.log_time,
                    record.publish_time,
                    prefix,
                )
            elif isinstance(record, Metadata):
                found = _parsed(record)
                if found is not None:
                    yield found


def _parsed(record: Metadata) -> LogHead | Logged | None:
    """What our metadata say; None for metadata of others or of another version."""
    values = record.metadata
    try:
        if record.name == "imud":
            return LogHead(values["version"], int(values["schema_fingerprint"], 16))
        if record.name in METADATA_OF_PROBES:
            topic = METADATA_OF_PROBES[record.name]
            return Logged(values["probe"], topic, bytes.fromhex(values["content"]), 0)
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
                raise FileError(f"{path} is no log of imud run: those are MCAP files")
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


def split(topic: str) -> tuple[str, str, str]:
    """Splits the name of a channel, PREFIX/PROBE/TOPIC."""
    prefix, _, rest = topic.rpartition("/")[0].rpartition("/")
    last = topic.rpartition("/")[2]
    return (prefix, rest, last) if rest else ("", "", last)
