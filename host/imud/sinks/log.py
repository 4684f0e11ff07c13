# SPDX-License-Identifier: MIT
"""The log: MCAP files that can be read up to 0.25 s before a kill -9.

Channels are named as Zenoh's keys. `frame` holds every good message as received and
is the truth; pose, raw, event, twin and status hold JSON for other people's tools.
"""

from __future__ import annotations

import json
import os
import struct
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Any

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import CompressionType, Writer

from imud import schema
from imud.errors import FileError
from imud.record import Presence, Record
from imud.version import version

# A file is handed to the kernel this often. The promise is 0.25 s; the rest of that is
# for a busy machine.
FLUSH_S = 0.1

# At the end: what is not written by then is lost, so a busy machine gets time. Service
# managers give a process 10 s and more.
PATIENCE_S = 5.0

# A file per hour: the writer keeps an index entry for each flush in memory.
ROTATE_S = 3600.0

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

# Content of a frame: id, sequence, time and tagged fields, as PROTOCOL.md says.
FRAME_ENCODING = "x-imud-frame"

_NUMBER: dict[str, Any] = {"type": "number"}
_COUNT: dict[str, Any] = {"type": "integer"}
_HEAD = {
    "type": {"type": "string"},
    "probe": {"type": "string"},
    "seq": _COUNT,
    "t_device_us": _COUNT,
    "t_ns": {"type": ["integer", "null"]},
}


def _vector(size: int, *, is_optional: bool = True) -> dict[str, Any]:
    kind = ["array", "null"] if is_optional else "array"
    return {"type": kind, "items": _NUMBER, "minItems": size, "maxItems": size}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


_FLAGS = {"type": "array", "items": {"type": "string"}}
_OPTIONAL = {"type": ["number", "null"]}

JSON_SCHEMAS: dict[str, dict[str, Any]] = {
    "pose": _object(
        **_HEAD,
        q=_vector(4, is_optional=False),
        position_m=_vector(3),
        normal=_vector(3),
        tilt_sigma_deg=_OPTIONAL,
        heading_sigma_deg=_OPTIONAL,
        flags=_FLAGS,
    ),
    "raw": _object(
        **_HEAD,
        acc_m_s2=_vector(3),
        gyr_rad_s=_vector(3),
        mag_uT=_vector(3),
        temperature_c=_OPTIONAL,
        acc_counts=_vector(3, is_optional=False),
        gyr_counts=_vector(3, is_optional=False),
        mag_counts=_vector(3),
        flags=_FLAGS,
    ),
    "event": _object(
        **_HEAD, event={"type": "string"}, cause={"type": "string"}, detail=_COUNT
    ),
    "twin": _object(
        **_HEAD,
        state={"type": "string"},
        compared=_COUNT,
        differed=_COUNT,
        lost={"type": ["object", "null"]},
        first_difference={"type": ["object", "null"]},
    ),
    "status": _object(type={"type": "string"}, probe={"type": "string"}),
}


class LogFile:
    """One file of records: channels, schemas and who wrote it."""

    def __init__(self, file: BufferedWriter, prefix: str) -> None:
        self._file = file
        self._prefix = prefix
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._hellos: dict[str, bytes] = {}
        # Frames and JSON of one pose are much alike; zstd takes a quarter of the space.
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=f"imud {version()}")
        fingerprint = f"{schema.FINGERPRINT:#010x}"
        self._writer.add_metadata(
            "imud", {"version": version(), "schema_fingerprint": fingerprint}
        )

    def take(self, record: Record) -> None:
        if record.hello and self._hellos.get(record.probe) != record.hello:
            self._hellos[record.probe] = record.hello
            metadata = {"probe": record.probe, "content": record.hello.hex()}
            self._writer.add_metadata("hello", metadata)
        if record.payload and record.topic in JSON_SCHEMAS:
            self._add(record, record.topic, "json", record.payload)
        if record.content:
            self._add(record, "frame", FRAME_ENCODING, record.content)

    def flush(self) -> None:
        self._writer.flush()

    def fileno(self) -> int:
        return self._file.fileno()

    def finish(self) -> None:
        self._writer.finish()
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def _add(self, record: Record, topic: str, encoding: str, data: bytes) -> None:
        channel = self._channels.get((record.probe, topic))
        if channel is None:
            channel = self._writer.register_channel(
                f"{self._prefix}/{record.probe}/{topic}", encoding, self._schema(topic)
            )
            self._channels[record.probe, topic] = channel
        sequence = record.sequence & 0xFFFFFFFF
        self._writer.add_message(channel, record.t_ns, data, record.t_ns, sequence)

    def _schema(self, topic: str) -> int:
        """The id of a topic's schema in this file; 0: none."""
        if topic not in JSON_SCHEMAS:
            return 0
        if topic not in self._schemas:
            data = json.dumps(JSON_SCHEMAS[topic]).encode()
            self._schemas[topic] = self._writer.register_schema(
                f"imud.{topic}", "jsonschema", data
            )
        return self._schemas[topic]


class LogSink:
    """Writes records to a file of its own, a fresh one each hour and after a fault."""

    name = "log"
    period_s = FLUSH_S
    patience_s = PATIENCE_S

    def __init__(self, directory: Path, prefix: str) -> None:
        self._directory = directory
        self._prefix = prefix
        self._syncer: ThreadPoolExecutor | None = None
        self._syncing: Future[None] | None = None
        self._log: LogFile | None = None
        self._began_s = 0.0
        self.path: Path | None = None

    def open(self) -> None:
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            self.path, file = self._create()
        except OSError as error:
            raise FileError(
                f"can't log to {self._directory}: {error.strerror}; "
                "name another place with --log DIR, or --no-log"
            ) from error
        self._syncer = self._syncer or ThreadPoolExecutor(1, "imud-sync")
        self._began_s = time.monotonic()
        self._log = LogFile(file, self._prefix)

    def take(self, record: Record | Presence) -> None:
        if self._log is not None and isinstance(record, Record):
            self._log.take(record)

    def flush(self) -> None:
        if self._log is None or self._syncer is None:
            return
        self._log.flush()
        if self._syncing is None or self._syncing.done():
            if self._syncing is not None:
                self._syncing.result()
            # Takes up to 20 ms, and longer on a busy disk: not in this thread.
            self._syncing = self._syncer.submit(os.fdatasync, self._log.fileno())
        if time.monotonic() - self._began_s > ROTATE_S:
            self._finish()
            self.open()

    def close(self) -> None:
        self._finish()
        if self._syncer is not None:
            self._syncer.shutdown()
            self._syncer = None

    def _finish(self) -> None:
        log, self._log = self._log, None
        syncing, self._syncing = self._syncing, None
        if log is None:
            return
        try:
            # The kernel has it all before a disk that is stuck is waited for.
            log.finish()
            if syncing is not None:
                syncing.result()
        finally:
            log.close()

    def _create(self) -> tuple[Path, BufferedWriter]:
        stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
        number = 1
        while True:
            suffix = "" if number == 1 else f"-{number}"
            path = self._directory / f"imud-{stamp}{suffix}.mcap"
            try:
                return path, path.open("xb")
            except FileExistsError:
                number += 1


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
    t_ns: int


def read_log(path: Path) -> Iterator[LogHead | Logged]:
    """All that a log holds, in order, up to where it was cut off.

    FileError at the end where it was, or where it is damaged: all before it is good.
    """
    channels: dict[int, tuple[str, str]] = {}
    count = 0
    with path.open("rb") as file:
        try:
            reader = StreamReader(
                file, validate_crcs=True, record_size_limit=RECORD_MAX
            )
            for record in reader.records:
                if isinstance(record, Channel):
                    channels[record.id] = _split(record.topic)
                elif isinstance(record, Message):
                    probe, topic = channels[record.channel_id]
                    count += 1
                    yield Logged(probe, topic, record.data, record.log_time)
                elif isinstance(record, Metadata) and record.name == "imud":
                    yield LogHead(
                        record.metadata.get("version", ""),
                        int(record.metadata.get("schema_fingerprint", "0"), 16),
                    )
                elif isinstance(record, Metadata) and record.name == "hello":
                    content = bytes.fromhex(record.metadata["content"])
                    yield Logged(record.metadata["probe"], "hello", content, 0)
        except DAMAGE as error:
            raise FileError(
                f"{path} ends without an end, after {count} messages: imud was killed "
                "or the file is damaged"
            ) from error


def _split(topic: str) -> tuple[str, str]:
    parts = topic.split("/")
    return (parts[-2], parts[-1]) if len(parts) > 1 else ("", topic)
