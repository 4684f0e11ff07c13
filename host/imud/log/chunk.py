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
from mcap.records import Channel, Chunk, Message, Schema

# Content of a chunk. Ours hold some 100 kB; other tools write 1 to 4 MB.
CONTENT_MAX = 16 << 20

# Length of the name of a channel: prefix, probe and topic.
NAME_MAX = 400

_RECORD = struct.Struct("<BQ")  # opcode, length of what follows
_MESSAGE = struct.Struct("<HIQQ")  # channel, number, two times; then the content
_KINDS = {int(kind) for kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)}

ChunkRecord = Schema | Channel | Message


class ChunkRecords:
    """The records of a chunk, made one by one as they are asked for: half a million
    empty messages would take 200 MB. Damage shows when it is made, and raises what
    `log.reader.DAMAGE` names.
    """

    def __init__(self, chunk: Chunk) -> None:
        self._data = _content(chunk)
        self._count = 0
        for kind, begin, end in self._places():
            self._count += 1
            if kind != Opcode.MESSAGE:
                _record(kind, self._data[begin:end])
            elif end - begin < _MESSAGE.size:
                raise EOFError

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[ChunkRecord]:
        for kind, begin, end in self._places():
            yield _record(kind, self._data[begin:end])

    def _places(self) -> Iterator[tuple[int, int, int]]:
        """Kind, begin and end of each record that counts."""
        at, size = 0, len(self._data)
        while at < size:
            kind, length = _RECORD.unpack_from(self._data, at)
            at += _RECORD.size
            if length > size - at:
                raise EOFError
            if kind in _KINDS:
                yield kind, at, at + length
            at += length


def _record(kind: int, body: bytes) -> ChunkRecord:
    if kind == Opcode.MESSAGE:
        channel_id, number, logged_ns, published_ns = _MESSAGE.unpack_from(body)
        content = body[_MESSAGE.size :]
        return Message(channel_id, logged_ns, content, published_ns, number)
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
