# SPDX-License-Identifier: MIT
"""One log file, of the daemon or of a card's recording: which channels it has and what
they hold.

Channels have the names of Zenoh keys. `frame` holds every good message as received and
is what our own tools read. The others hold JSON for other tools.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from io import BufferedWriter

from imud.defaults import PREFIX
from imud.log.channels import payload_on, topics_of
from imud.log.parts import seal
from imud.log.reader import FRAME_ENCODING
from imud.log.retention import KEEP_ALL, Retention
from imud.log.schemas import schema_of
from imud.log.writer import LogWriter
from imud.probes.record import Record, plain
from imud.version import version
from imud.wire import messages, schema
from imud.wire.messages import Message
from imud.wire.params import digest_of

FRAME = "frame"  # the topic of messages as received


@dataclass(frozen=True, slots=True)
class Settings:
    """The contents of a log, and when the next file begins."""

    prefix: str = PREFIX
    rotate_bytes: int = 1 << 30  # start a new file after this many bytes
    rotate_s: float = 3600.0  # and after this many seconds
    floor_bytes: int = 0  # logging pauses while the disk has less free
    retention: Retention = KEEP_ALL  # which old files are removed
    unlogged: frozenset[str] = frozenset()  # names of probes not to log
    has_foxglove: bool = True
    configuration: str = ""  # the daemon's settings as JSON


class Channels(dict[tuple[str, str, str], int]):
    """The ids of a log's channels by prefix, probe and topic: each is opened when it is
    first asked for.
    """

    def __init__(self, writer: LogWriter) -> None:
        self._writer = writer
        self._schemas = {FRAME: 0}  # frames have none

    def __missing__(self, of: tuple[str, str, str]) -> int:
        topic = of[-1]
        if topic not in self._schemas:
            name, body = schema_of(topic)
            data = json.dumps(body).encode()
            self._schemas[topic] = self._writer.register_schema(
                name, "jsonschema", data
            )
        encoding = FRAME_ENCODING if topic == FRAME else "json"
        found = self._writer.register_channel(
            "/".join(of), encoding, self._schemas[topic]
        )
        self[of] = found
        return found

    def add(self, prefix: str, record: Record, *, has_foxglove: bool = True) -> None:
        """Adds the messages of a record."""
        probe, add = record.probe, self._writer.add_message
        # log_time: when it was received; publish_time: when it was measured.
        log_ns, t_ns = record.t_received_ns, record.t_ns
        sequence = record.sequence & 0xFFFFFFFF
        for topic in topics_of(record, has_foxglove=has_foxglove):
            payload = payload_on(record, topic)
            add(self[prefix, probe, topic], log_ns, payload, t_ns, sequence)
        if record.content:
            add(self[prefix, probe, FRAME], log_ns, record.content, t_ns, sequence)


class LogFile:
    """Writes records to a log: their channels and schemas, and the probes' hellos and
    params, which the file may have no frames of.
    """

    def __init__(
        self,
        file: BufferedWriter,
        settings: Settings,
        origin: Mapping[str, str] | None = None,
    ) -> None:
        """`origin`: where it belongs among others (`log/retention`)."""
        self._file = file
        self._settings = settings
        self._hellos: dict[str, bytes] = {}
        self._params: dict[str, bytes] = {}
        self.index_size = 0
        self._writer = LogWriter(file, f"imud {version()}")
        self._channels = Channels(self._writer)
        fingerprint = f"{schema.FINGERPRINT:#010x}"
        if origin:
            self._add_metadata("origin", dict(origin))
        self._add_metadata(
            "imud", {"version": version(), "schema_fingerprint": fingerprint}
        )
        if settings.configuration:
            self._add_metadata("configuration", {"json": settings.configuration})

    def add(self, record: Record) -> None:
        """Adds a record; it is in the file after flush()."""
        hello = self._hellos.get(record.probe, b"")
        if record.hello and record.hello is not hello:
            self._hellos[record.probe] = record.hello
            # A probe sends its hello each second: only changes are written.
            if record.hello[messages.FIELDS_OF] != hello[messages.FIELDS_OF]:
                self._add_metadata("hello", _identity(record.probe, record.hello))
        if record.params and self._params.get(record.probe) != record.params:
            self._params[record.probe] = record.params
            self._add_metadata("params", _params(record.probe, record.params))
        self._channels.add(
            self._settings.prefix, record, has_foxglove=self._settings.has_foxglove
        )

    def add_like(
        self, record: Record, payload: bytes, content: bytes, sequence: int, t_ns: int
    ) -> None:
        """Adds a message whose topic, hello and params are those of a record before."""
        prefix, probe, add = (
            self._settings.prefix,
            record.probe,
            self._writer.add_message,
        )
        add(self._channels[prefix, probe, record.topic], t_ns, payload, t_ns, sequence)
        add(self._channels[prefix, probe, FRAME], t_ns, content, t_ns, sequence)

    def flush(self) -> None:
        self._writer.flush()
        self.index_size += len(self._channels)

    def size(self) -> int:
        """Bytes written so far."""
        return self._file.tell()

    def fileno(self) -> int:
        return self._file.fileno()

    def finish(self) -> None:
        self._writer.finish()

    def close(self) -> None:
        self._file.close()

    def _add_metadata(self, name: str, values: dict[str, str]) -> None:
        self._writer.add_metadata(name, seal(name, values))


def _identity(probe: str, hello: bytes) -> dict[str, str]:
    """A hello as metadata: its fields as text, and its content in hex."""
    hello_message = messages.decode(hello)
    fields = hello_message.fields if isinstance(hello_message, Message) else {}
    words = {name: str(plain(value)) for name, value in fields.items()}
    return words | {"probe": probe, "content": hello.hex()}


def _params(probe: str, records: bytes) -> dict[str, str]:
    """Params as metadata: their records in hex, and the digest that names them."""
    digest = f"{digest_of(records):#010x}"
    return {"probe": probe, "digest": digest, "content": records.hex()}
