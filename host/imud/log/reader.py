# SPDX-License-Identifier: MIT
"""Logs read back: MCAP files of ours, whole, cut off or damaged.

Messages lie in chunks, each with a CRC of its own; nothing outside of one is taken for
a message. What is broken is stepped over or ends the reading, as the caller likes.
"""

from __future__ import annotations

import contextlib
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

# Content of a frame: id, sequence, time and tagged fields, as PROTOCOL.md says.
FRAME_ENCODING = "x-imud-frame"

# More than a chunk of ours can be: a longer record is damage, not to be allocated.
RECORD_MAX = 64 << 20

# What the reader's library says of a file that is cut off or changed.
DAMAGE = (
    McapError,
    CRCValidationError,
    EOFError,
    MemoryError,  # a length that was struck
    OverflowError,
    KeyError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)

_RECORD = struct.Struct("<BQ")  # what is it, how long is the rest
_KINDS = range(int(Opcode.HEADER), int(Opcode.DATA_END) + 1)

# Where a chunk says how it is compressed, behind its times, size and CRC: a sign by
# which one is found again behind damage.
_CHUNK_SIGN = b"\x04\0\0\0zstd"
_CHUNK_SIGN_AT = _RECORD.size + 28
_SEARCH = 1 << 20  # bytes at a time


@dataclass(frozen=True, slots=True)
class LogHead:
    """Who wrote a log."""

    version: str
    fingerprint: int


@dataclass(frozen=True, slots=True)
class Logged:
    """One message of a log. `topic` is the last part of its channel's name."""

    probe: str
    topic: str
    data: bytes
    t_ns: int  # UTC: when it came
    t_sample_ns: int = 0  # UTC: when what it says was so
    prefix: str = ""  # of its channel's name, before the probe's


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes of a log that are of no use."""

    at: int
    size: int
    is_tail: bool  # nothing good comes after them


@dataclass(frozen=True, slots=True)
class Part:
    """What stands at one place of a log: metadata, or a chunk's records."""

    end: int
    records: list[Schema | Channel | Message | Metadata]


def parts_of(file: BinaryIO, size: int) -> Iterator[Part | Damage]:
    """A log from its beginning, damage and all. The last is Damage if it was cut."""
    at = len(MAGIC)
    file.seek(0)
    if file.read(at) != MAGIC:
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


def _part(file: BinaryIO, at: int) -> tuple[Part, bool]:
    """The record at a place, and whether it ends the messages."""
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
        return Part(end, _opened(Chunk.read(stream))), False
    if kind == Opcode.METADATA:
        metadata = Metadata.read(stream)
        if not is_sealed(metadata):
            raise ValueError(metadata.name)
        return Part(end, [metadata]), False
    return Part(end, []), kind == Opcode.DATA_END


def _opened(chunk: Chunk) -> list[Schema | Channel | Message | Metadata]:
    records = breakup_chunk(chunk, validate_crc=True)
    return [each for each in records if isinstance(each, Schema | Channel | Message)]


def _next_chunk(file: BinaryIO, start: int, size: int) -> int:
    """Where the next chunk that is whole begins, or the file's size."""
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


def seal(name: str, said: dict[str, str]) -> dict[str, str]:
    """With a CRC: metadata stand outside the chunks and have none."""
    return said | {"crc32": _crc(name, said)}


def is_sealed(metadata: Metadata) -> bool:
    rest = dict(metadata.metadata)
    return rest.pop("crc32", None) == _crc(metadata.name, rest)


def _crc(name: str, said: dict[str, str]) -> str:
    parts = [name, *itertools.chain.from_iterable(sorted(said.items()))]
    text = "\0".join(parts)
    return f"{zlib.crc32(text.encode()):08x}"


def channels_of(path: Path) -> list[Schema | Channel]:
    """What the summary at a log's end says of channels; nothing if it has none.

    They are also in the chunk of their first message, which may be the damaged one.
    """
    with path.open("rb") as file:
        try:
            summary = make_reader(file, validate_crcs=True).get_summary()
        except (*DAMAGE, OSError):  # an offset that was struck
            return []
    if summary is None:
        return []
    return [*summary.schemas.values(), *summary.channels.values()]


class Reader:
    """What parts of a log mean."""

    def __init__(self, known: Iterable[Schema | Channel] = ()) -> None:
        self._channels = {
            each.id: split(each.topic) for each in known if isinstance(each, Channel)
        }
        self.count = 0
        self.unknown = 0  # messages whose channel stood in a part that is lost

    def read(self, part: Part) -> Iterator[LogHead | Logged]:
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
                said = _said_by(record)
                if said is not None:
                    yield said


def _said_by(record: Metadata) -> LogHead | Logged | None:
    """Of metadata, what is of use here; None: nothing, or of another version."""
    said = record.metadata
    try:
        if record.name == "imud":
            return LogHead(said["version"], int(said["schema_fingerprint"], 16))
        if record.name == "hello":
            return Logged(said["probe"], "hello", bytes.fromhex(said["content"]), 0)
    except (KeyError, ValueError):
        pass
    return None


def read_log(path: Path) -> Iterator[LogHead | Logged]:
    """All that a log holds, in order, up to where it was cut off.

    FileError at the end where it was, or where it is damaged: all before it is good.
    """
    reader = Reader()
    with opened(path) as file, legible(path):
        for part in parts_of(file, path.stat().st_size):
            if isinstance(part, Damage):
                raise FileError(
                    f"{path} ends without an end, after {reader.count} messages: imud "
                    "was killed or the file is damaged; imud recover saves what is good"
                )
            yield from reader.read(part)


def salvage(
    path: Path, on_progress: Callable[[int], None] = lambda _: None
) -> Iterator[LogHead | Logged | Damage]:
    """All that is good in a log, behind damage, too; told how far it is, in bytes."""
    with opened(path) as file, legible(path):
        reader = Reader(channels_of(path))
        for part in parts_of(file, path.stat().st_size):
            if isinstance(part, Damage):
                yield part
            else:
                on_progress(part.end)
                yield from reader.read(part)


def opened(path: Path) -> BinaryIO:
    """A log for reading; FileError if it is none."""
    with legible(path):
        file = path.open("rb")
        with contextlib.ExitStack() as undone:
            undone.push(file)
            if file.read(len(MAGIC)) != MAGIC:
                raise FileError(f"{path} is no log of imud run: those are MCAP files")
            undone.pop_all()
        return file


def size_of(path: Path) -> int:
    """Bytes of a log; FileError if it is none."""
    with opened(path) as file:
        return file.seek(0, io.SEEK_END)


@contextlib.contextmanager
def legible(path: Path) -> Iterator[None]:
    """What the system says where a log can't be read, as a FileError."""
    try:
        yield
    except OSError as error:
        raise FileError(f"can't read {path}: {error.strerror}") from error


def split(topic: str) -> tuple[str, str, str]:
    """Prefix, probe and topic of a channel's name."""
    prefix, _, rest = topic.rpartition("/")[0].rpartition("/")
    last = topic.rpartition("/")[2]
    return (prefix, rest, last) if rest else ("", "", last)
