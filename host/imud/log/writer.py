# SPDX-License-Identifier: MIT
"""Writes the same MCAP files as the mcap library's own writer, but faster:
https://mcap.dev/spec, version 0.

Messages and their indexes are packed by `_core.Chunk`; the library makes all other
records.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from io import BufferedWriter
from struct import Struct

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from imud import _core

MAGIC = b"\x89MCAP0\r\n"

# A chunk ends at this size, also between two flushes: damage costs the chunk that it
# hits.
CHUNK_MAX = 1 << 16

# The part of a footer that its CRC covers.
_FOOTER_HEAD = Struct("<BQQQ")
_FOOTER_LENGTH = 20


class LogWriter:
    """Writes one file, open for writing. Messages are in it after flush()."""

    def __init__(self, file: BufferedWriter, library: str) -> None:
        self._file = file
        self._compressor = zstandard.ZstdCompressor()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._times: list[int] = []  # first and last time of each chunk
        self._chunk = _core.Chunk()
        file.write(MAGIC + _bytes_of(Header(profile="", library=library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Adds a schema; returns its id."""
        number = len(self._schemas) + 1
        schema = Schema(id=number, name=name, encoding=encoding, data=data)
        self._schemas.append(schema)
        self._chunk.add_record(_bytes_of(schema))
        return number

    def register_channel(
        self,
        topic: str,
        encoding: str,
        schema: int,
        metadata: Mapping[str, str] | None = None,
    ) -> int:
        """Adds a channel; returns its id. `schema` 0: none."""
        number = len(self._channels) + 1
        channel = Channel(
            id=number,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata or {}),
            schema_id=schema,
        )
        self._channels.append(channel)
        self._chunk.add_record(_bytes_of(channel))
        return number

    def add_metadata(self, name: str, values: dict[str, str]) -> None:
        """Writes metadata, ahead of messages that are not flushed yet."""
        record = _bytes_of(Metadata(name=name, metadata=values))
        place = self._file.tell()
        self._file.write(record)
        self._metadata.append(
            MetadataIndex(offset=place, length=len(record), name=name)
        )

    def add_message(
        self, channel: int, log_time: int, data: bytes, publish_time: int, sequence: int
    ) -> None:
        """Adds a message; times in nanoseconds since 1970."""
        size = self._chunk.add(channel, log_time, data, publish_time, sequence)
        if size > CHUNK_MAX:
            self._end_chunk()

    def flush(self) -> None:
        """Ends the chunk and hands everything to the kernel."""
        self._end_chunk()
        self._file.flush()

    def _end_chunk(self) -> None:
        taken = self._chunk.take()
        if taken is None:
            return  # schemas and channels wait for a first message
        data, first, last, indexes = taken
        compressed = self._compressor.compress(data)
        chunk = _bytes_of(
            Chunk(
                compression="zstd",
                data=compressed,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=zlib.crc32(data),
                uncompressed_size=len(data),
            )
        )
        place = self._file.tell()
        parts, end, offsets = [chunk], place + len(chunk), {}
        for channel, count, index in indexes:
            offsets[channel] = end
            parts.append(index)
            end += len(index)
            self._counts[channel] = self._counts.get(channel, 0) + count
        self._file.write(b"".join(parts))
        self._times += (first, last)
        self._chunks.append(
            ChunkIndex(
                chunk_length=len(chunk),
                chunk_start_offset=place,
                compression="zstd",
                compressed_size=len(compressed),
                message_start_time=first,
                message_end_time=last,
                message_index_length=end - place - len(chunk),
                message_index_offsets=offsets,
                uncompressed_size=len(data),
            )
        )

    def finish(self) -> None:
        """Writes the summary at the end of the file, which stays open."""
        self._end_chunk()
        self._file.write(_bytes_of(DataEnd(data_section_crc=0)))
        begin = self._file.tell()
        summary, offsets = bytearray(), bytearray()
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            message_start_time=min(self._times, default=0),
            message_end_time=max(self._times, default=0),
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        groups: tuple[tuple[Opcode, list[McapRecord]], ...] = (
            (Opcode.SCHEMA, [*self._schemas]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, [*self._chunks]),
            (Opcode.ATTACHMENT_INDEX, []),
            (Opcode.METADATA_INDEX, [*self._metadata]),
        )
        for kind, records in groups:
            group = _bytes_of(*records)
            offsets += _bytes_of(
                SummaryOffset(
                    group_opcode=kind,
                    group_start=begin + len(summary),
                    group_length=len(group),
                )
            )
            summary += group
        places = begin, begin + len(summary)
        crc = zlib.crc32(summary + offsets)
        crc = zlib.crc32(_FOOTER_HEAD.pack(Opcode.FOOTER, _FOOTER_LENGTH, *places), crc)
        footer = Footer(
            summary_start=places[0], summary_offset_start=places[1], summary_crc=crc
        )
        self._file.write(summary + offsets + _bytes_of(footer) + MAGIC)
        self._file.flush()


def _bytes_of(*records: McapRecord) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()
    return data
