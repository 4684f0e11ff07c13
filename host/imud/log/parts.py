# SPDX-License-Identifier: MIT
"""The parts of an MCAP file, also of one that is cut off, damaged or a stranger's.

Messages are only taken from chunks, each of which has a CRC. No part takes more memory
than some chunks of ours.
"""

from __future__ import annotations

import io
import itertools
import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Metadata, Schema

from imud.log.chunk import CONTENT_MAX, ChunkRecords
from imud.log.writer import MAGIC

# A longer record is damage. Only chunks and metadata are read at all.
RECORD_MAX = 64 << 20
_READ_MAX = {int(Opcode.CHUNK): CONTENT_MAX + 1000, int(Opcode.METADATA): 1 << 20}

# A longer summary is left unread: those of whole logs are some 100 kB.
_SUMMARY_MAX = 4 << 20

# Exceptions of the mcap library for a file that is truncated or changed.
DAMAGE = (
    McapError,
    EOFError,
    OverflowError,
    KeyError,
    ValueError,
    struct.error,
    zstandard.ZstdError,
)

_HEAD_MAX = 4096  # the header and the first metadata have some 300 bytes

_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_FOOTER = struct.Struct("<QQI")  # where summary and its index begin; CRC
_KINDS = range(int(Opcode.HEADER), int(Opcode.DATA_END) + 1)

# The name of a chunk's compression, which stands behind its times, size and CRC. The
# search for the next chunk after damage looks for it.
_CHUNK_SIGN = b"\x04\0\0\0zstd"
_CHUNK_SIGN_AT = _RECORD.size + 28
_SEARCH = 1 << 20  # bytes at a time


@dataclass(frozen=True, slots=True)
class Damage:
    """A stretch of a log that can't be read, in bytes."""

    at: int
    size: int
    is_tail: bool  # nothing good follows


@dataclass(frozen=True, slots=True)
class RecordGroup:
    """The records of a chunk, or a metadata record; `end` is the offset behind it."""

    end: int
    records: ChunkRecords | list[Metadata]


def first_metadata(file: BinaryIO) -> dict[str, str]:
    """The metadata that a log of ours begins with; empty where there is none."""
    data = file.read(_HEAD_MAX)
    at = len(MAGIC)
    try:
        for _ in range(2):  # the header comes first
            kind, length = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            if kind == Opcode.METADATA:
                stream = ReadDataStream(BytesIO(data[at : at + length]))
                found = Metadata.read(stream)
                return dict(found.metadata) if is_sealed(found) else {}
            at += length
    except DAMAGE:
        pass
    return {}


def has_end(file: BinaryIO) -> bool:
    """Whether a log was finished: one that was cut off, or is empty, has no end."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(0, size - len(MAGIC)))
    return file.read() == MAGIC and size > len(MAGIC)


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
    end = at + _RECORD.size + length
    if kind not in _READ_MAX:
        if end > file.seek(0, io.SEEK_END):
            raise EOFError
        return RecordGroup(end, []), kind == Opcode.DATA_END
    if length > _READ_MAX[kind]:
        raise ValueError(length)
    body = file.read(length)
    if len(body) < length:
        raise EOFError
    stream = ReadDataStream(BytesIO(body))
    if kind == Opcode.CHUNK:
        return RecordGroup(end, ChunkRecords(Chunk.read(stream))), False
    metadata = Metadata.read(stream)
    if not is_sealed(metadata):
        raise ValueError(metadata.name)
    return RecordGroup(end, [metadata]), False


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
            if not 0 < _summary_size(file) <= _SUMMARY_MAX:
                return []
            summary = make_reader(file, validate_crcs=True).get_summary()
        except (*DAMAGE, OSError):  # a damaged offset
            return []
    if summary is None:
        return []
    return [*summary.schemas.values(), *summary.channels.values()]


def _summary_size(file: BinaryIO) -> int:
    """Bytes of the summary, its index and the footer, as the footer states."""
    size = file.seek(0, io.SEEK_END)
    footer = _RECORD.size + _FOOTER.size
    file.seek(max(0, size - footer - len(MAGIC)))
    (start, _, _) = _FOOTER.unpack_from(file.read(footer), _RECORD.size)
    return size - int(start) if start else 0
