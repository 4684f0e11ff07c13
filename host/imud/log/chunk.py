# SPDX-License-Identifier: MIT
"""The chunks of a log, also of a stranger's: what one holds never takes more memory
than it says that it does, and that is bounded.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema

# Content of a chunk. Ours hold some 100 kB; other tools write 1 to 4 MB.
CONTENT_MAX = 16 << 20
KEPT_MAX = 1 << 18  # content whose records are made once

# Length of the name of a channel: prefix, probe and topic.
NAME_MAX = 400

_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, number, two times; then the content
_KIND_OF_MESSAGE = int(Opcode.MESSAGE)
_KINDS = {int(kind) for kind in (Opcode.SCHEMA, Opcode.CHANNEL)}

# Of a message: its channel, number, when it was received and measured (UTC, ns), and
# its content.
ChunkMessage = tuple[int, int, int, int, bytes]
ChunkRecord = Schema | Channel | ChunkMessage


class ChunkRecords:
    """The records of a chunk; of a large one made one by one as they are asked for:
    half a million empty messages would take 200 MB. Damage shows when it is made, and
    raises what `log.reader.DAMAGE` names.
    """

    def __init__(self, chunk: Chunk) -> None:
        self._data = _content(chunk)
        is_small = len(self._data) <= KEPT_MAX
        self._kept = [*self._records()] if is_small else []
        self._count = len(self._kept) if is_small else sum(1 for _ in self._records())

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[ChunkRecord]:
        return iter(self._kept) if self._kept else self._records()

    def _records(self) -> Iterator[ChunkRecord]:
        data, at, size = self._data, 0, len(self._data)
        record_at, message_at = _RECORD.unpack_from, _MESSAGE.unpack_from
        while at < size:
            kind, length = record_at(data, at)
            at += _RECORD.size
            end = at + length
            if end > size:
                raise EOFError
            if kind == _KIND_OF_MESSAGE:
                if length < _MESSAGE.size:
                    raise EOFError
                yield (*message_at(data, at), data[at + _MESSAGE.size : end])
            elif kind in _KINDS:
                yield _record(kind, data[at:end])
            at = end


def _record(kind: int, body: bytes) -> Schema | Channel:
    stream = ReadDataStream(BytesIO(body))
    if kind == Opcode.SCHEMA:
        schema: Schema = Schema.read(stream)
        return schema
    channel: Channel = Channel.read(stream)
    if len(channel.topic) > NAME_MAX:
        raise ValueError(channel.topic[:NAME_MAX])
    return channel


def _content(chunk: Chunk) -> bytes:
    """Its contents, with the stated size and CRC."""
    size = chunk.uncompressed_size
    if size > CONTENT_MAX:
        raise ValueError(size)
    if chunk.compression == "zstd":
        data = _zstd(chunk.data, size)
    elif chunk.compression == "lz4":
        # One byte more than it should be shows that it is more.
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, size + 1)
    else:
        data = chunk.data
    if len(data) != size:
        raise ValueError(len(data))
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError(chunk.uncompressed_crc)
    return data


def _zstd(data: bytes, size: int) -> bytes:
    """A frame may say itself how large it is, and is believed: 4 GB in 131 kB."""
    said = zstandard.frame_content_size(data)
    if said not in (-1, size):
        raise ValueError(said)
    limits = zstandard.ZstdDecompressor(max_window_size=CONTENT_MAX)
    return limits.decompress(data, max_output_size=size)
