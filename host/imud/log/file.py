# SPDX-License-Identifier: MIT
"""One file of records, as the daemon logs them and as a card's recording is written.

Channels are named as Zenoh's keys. `frame` holds every good message as received and
is the truth; the others hold JSON for other people's tools, among them pose_in_frame,
which Foxglove draws.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from io import BufferedWriter

import msgspec

from imud.defaults import PREFIX
from imud.log.reader import FRAME_ENCODING, seal
from imud.log.schemas import schema_of
from imud.log.writer import LogWriter
from imud.probes.record import Record, plain
from imud.version import version
from imud.wire import messages, schema
from imud.wire.messages import Message

# The world in which Foxglove draws poses: the fixed frame of its 3D panel.
WORLD = "world"

_ENCODER = msgspec.json.Encoder()


@dataclass(frozen=True, slots=True)
class Settings:
    """How logs are kept."""

    prefix: str = PREFIX
    rotate_bytes: int = 1 << 30  # a fresh file after so many
    rotate_s: float = 3600.0  # and after so long
    floor_bytes: int = 0  # no logging where the disk has less free
    unlogged: frozenset[str] = frozenset()  # names of probes that are left out
    has_foxglove: bool = True
    configuration: str = ""  # of the daemon, JSON


class LogFile:
    """One file of records: channels, schemas and who wrote it."""

    def __init__(self, file: BufferedWriter, settings: Settings) -> None:
        self._file = file
        self._settings = settings
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._hellos: dict[str, bytes] = {}
        self.index_size = 0
        # Frames and JSON of one pose are much alike; zstd takes a quarter of the space.
        self._writer = LogWriter(file, f"imud {version()}")
        fingerprint = f"{schema.FINGERPRINT:#010x}"
        self._add_metadata(
            "imud", {"version": version(), "schema_fingerprint": fingerprint}
        )
        if settings.configuration:
            self._add_metadata("configuration", {"json": settings.configuration})

    def take(self, record: Record) -> None:
        if record.hello and self._hellos.get(record.probe) != record.hello:
            self._hellos[record.probe] = record.hello
            self._add_metadata("hello", _identity(record.probe, record.hello))
        if record.payload:
            self._add(record, record.topic, "json", record.payload)
        if record.topic == "pose" and record.said and self._settings.has_foxglove:
            self._add(record, "pose_in_frame", "json", pose_in_frame(record))
        if record.content:
            self._add(record, "frame", FRAME_ENCODING, record.content)

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

    def _add_metadata(self, name: str, said: dict[str, str]) -> None:
        self._writer.add_metadata(name, seal(name, said))

    def _add(self, record: Record, topic: str, encoding: str, data: bytes) -> None:
        channel = self._channels.get((record.probe, topic))
        if channel is None:
            name = f"{self._settings.prefix}/{record.probe}/{topic}"
            channel = self._writer.register_channel(name, encoding, self._schema(topic))
            self._channels[record.probe, topic] = channel
        sequence = record.sequence & 0xFFFFFFFF
        # log_time is when it came, publish_time when what it says was so.
        self._writer.add_message(
            channel, record.t_received_ns, data, record.t_ns, sequence
        )

    def _schema(self, topic: str) -> int:
        """The id of a topic's schema in this file; 0: none."""
        if topic == "frame":
            return 0
        if topic not in self._schemas:
            name, body = schema_of(topic)
            data = json.dumps(body).encode()
            self._schemas[topic] = self._writer.register_schema(
                name, "jsonschema", data
            )
        return self._schemas[topic]


def _identity(probe: str, hello: bytes) -> dict[str, str]:
    """What a probe says of itself: its message, and the same in words."""
    said = messages.decode(hello)
    fields = said.fields if isinstance(said, Message) else {}
    words = {name: str(plain(value)) for name, value in fields.items()}
    return words | {"probe": probe, "content": hello.hex()}


def pose_in_frame(record: Record) -> bytes:
    """A pose as Foxglove draws it; one that has no position is at the origin."""
    sec, nsec = divmod(record.t_ns, 10**9)
    w, x, y, z = record.said["q"]
    px, py, pz = record.said["position_m"] or (0.0, 0.0, 0.0)
    return _ENCODER.encode(
        {
            "timestamp": {"sec": sec, "nsec": nsec},
            "frame_id": WORLD,
            "pose": {
                "position": {"x": px, "y": py, "z": pz},
                "orientation": {"x": x, "y": y, "z": z, "w": w},
            },
        }
    )
