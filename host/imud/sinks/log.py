# SPDX-License-Identifier: MIT
"""The log: MCAP files that can be read up to 0.25 s before a kill -9.

Channels are named as Zenoh's keys. `frame` holds every good message as received and
is the truth; the others hold JSON for other people's tools, among them pose_in_frame,
which Foxglove draws.
"""

from __future__ import annotations

import json
import logging
import os
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path
from typing import Any

import msgspec

from imud import messages, schema
from imud.errors import FileError
from imud.logs import FRAME_ENCODING, seal
from imud.logwriter import LogWriter
from imud.messages import Message
from imud.names import PREFIX
from imud.record import Presence, Record, plain
from imud.version import version

# A file is handed to the kernel this often. The promise is 0.25 s; the rest of that is
# for a busy machine.
FLUSH_S = 0.1

# At the end: what is not written by then is lost, so a busy machine gets time. Service
# managers give a process 10 s and more.
PATIENCE_S = 5.0

# Entries of the index that the writer keeps in memory up to a file's end, one a channel
# in each flush: an hour of four probes with four channels. 86 bytes each were measured.
INDEX_MAX = 600_000

# Logging goes on when there is so much more room than the floor: not a file for each
# few blocks that come free.
ROOM_AGAIN = 1.1

# The world in which Foxglove draws poses: the fixed frame of its 3D panel.
WORLD = "world"

_NUMBER: dict[str, Any] = {"type": "number"}
_COUNT: dict[str, Any] = {"type": "integer"}
_OPTIONAL_COUNT: dict[str, Any] = {"type": ["integer", "null"]}
_HEAD = {
    "type": {"type": "string"},
    "probe": {"type": "string"},
    "seq": _COUNT,
    "number": _COUNT,
    "missing": _COUNT,
    "t_device_us": _COUNT,
    "t_ns": _OPTIONAL_COUNT,
    "t_bound_us": _OPTIONAL_COUNT,
    "age_us": _OPTIONAL_COUNT,
}


def _vector(size: int, *, is_optional: bool = True) -> dict[str, Any]:
    kind = ["array", "null"] if is_optional else "array"
    return {"type": kind, "items": _NUMBER, "minItems": size, "maxItems": size}


def _object(**properties: Any) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _whole(**properties: Any) -> dict[str, Any]:
    """An object that lacks none of them."""
    return _object(**properties) | {"required": [*properties]}


_TEXT = {"type": "string"}
_ABOUT = {"type": _TEXT, "probe": _TEXT, "t_ns": _COUNT}
_FLAGS = {"type": "array", "items": {"type": "string"}}
_OPTIONAL = {"type": ["number", "null"]}

_TIME = _whole(
    sec=_COUNT | {"minimum": 0}, nsec=_COUNT | {"minimum": 0, "maximum": 10**9 - 1}
)
_XYZ = {axis: _NUMBER for axis in "xyz"}

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
    "status": _object(**_ABOUT),
    "clock": _object(**_ABOUT, step_ns=_COUNT),
    "log": _object(
        **_ABOUT,
        state={"enum": ["on", "paused", "off"]},
        reason={"type": ["string", "null"]},
        dropped=_COUNT,
    ),
}

# The schema of Foxglove's by that name, as far as a pose fills it.
FOXGLOVE_SCHEMA = {
    "title": "foxglove.PoseInFrame",
    **_whole(
        timestamp=_TIME,
        frame_id=_TEXT,
        pose=_whole(position=_whole(**_XYZ), orientation=_whole(**_XYZ, w=_NUMBER)),
    ),
}

# Topics with a schema: its name and what it says.
_SCHEMAS = {name: (f"imud.{name}", body) for name, body in JSON_SCHEMAS.items()} | {
    "pose_in_frame": ("foxglove.PoseInFrame", FOXGLOVE_SCHEMA)
}

_ENCODER = msgspec.json.Encoder()

logger = logging.getLogger("imud")


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
            name, body = _SCHEMAS.get(topic) or (f"imud.{topic}", _object(**_ABOUT))
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


class LogSink:
    """Writes records to files of its own; one that fails is followed by a fresh one.

    What can't be written is an error to who hands it over, who counts it and comes
    again; a disk without room is no reason not to start.
    """

    name = "log"
    period_s = FLUSH_S
    patience_s = PATIENCE_S

    def __init__(self, directory: Path, settings: Settings | None = None) -> None:
        self._directory = directory
        self.settings = settings or Settings()
        self._syncer: ThreadPoolExecutor | None = None
        self._syncing: Future[None] | None = None
        self._log: LogFile | None = None
        self._began_s = 0.0
        self._has_flushed = False
        self._is_paused = False
        self.path: Path | None = None

    def open(self) -> None:
        try:
            self._directory.mkdir(parents=True, exist_ok=True)
            if self._is_full(os.statvfs(self._directory)):
                self._is_paused = True
                return
            self.path, file = self._create()
        except OSError as error:
            raise FileError(
                f"can't log to {self._directory}: {error.strerror}; "
                "name another place with --log DIR, or --no-log"
            ) from error
        self._is_paused = False
        self._has_flushed = False
        self._syncer = self._syncer or ThreadPoolExecutor(1, "imud-sync")
        self._began_s = time.monotonic()
        self._log = LogFile(file, self.settings)

    def take(self, record: Record | Presence) -> None:
        if not isinstance(record, Record) or record.probe in self.settings.unlogged:
            return
        if self._log is None and not self._is_paused:
            self.open()
        if self._log is None:
            raise FileError(
                f"{self._directory} is on a disk with less than "
                f"{self.settings.floor_bytes / 1e6:.0f} MB free (log.floor_mb); "
                "logging pauses until there is room"
            )
        self._log.take(record)

    def flush(self) -> None:
        log = self._log
        if log is None or self._syncer is None:
            return
        if os.fstat(log.fileno()).st_nlink == 0:
            raise FileError(f"{self.path} was removed while it was written")
        try:
            log.flush()
            self._has_flushed = True
            if self._syncing is None or self._syncing.done():
                if self._syncing is not None:
                    self._syncing.result()
                # Takes up to 20 ms, and longer on a busy disk: not in this thread.
                self._syncing = self._syncer.submit(os.fdatasync, log.fileno())
        except OSError as error:
            raise FileError(f"can't write {self.path}: {error.strerror}") from error
        self._is_paused = self._is_full(os.fstatvfs(log.fileno()))
        if (
            self._is_paused
            or log.size() >= self.settings.rotate_bytes
            or log.index_size >= INDEX_MAX
            or time.monotonic() - self._began_s >= self.settings.rotate_s
        ):
            self._end()

    def close(self) -> None:
        try:
            self._finish()
        except OSError as error:
            raise FileError(f"can't finish {self.path}: {error.strerror}") from error
        if self._syncer is not None:
            self._syncer.shutdown()
            self._syncer = None

    def _is_full(self, disk: os.statvfs_result) -> bool:
        floor = self.settings.floor_bytes * (ROOM_AGAIN if self._is_paused else 1.0)
        return disk.f_bavail * disk.f_frsize < floor

    def _end(self) -> None:
        """Finishes a file of which all is written; the next record begins another."""
        try:
            self._finish()
        except OSError as error:
            logger.warning(
                "log: can't finish %s: %s; imud recover does", self.path, error.strerror
            )

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
        except OSError:
            self._leave_no_empty_one()
            raise
        finally:
            log.close()

    def _leave_no_empty_one(self) -> None:
        """On a disk that takes nothing each attempt would leave a file."""
        if not self._has_flushed and self.path is not None:
            self.path.unlink(missing_ok=True)

    def _create(self) -> tuple[Path, BufferedWriter]:
        stamp = time.strftime("%Y%m%dT%H%M%SZ", time.gmtime())
        number = 1
        while True:
            # Sorted by name is sorted by time: '_' comes after '.'.
            suffix = "" if number == 1 else f"_{number:03}"
            path = self._directory / f"imud-{stamp}{suffix}.mcap"
            try:
                return path, path.open("xb")
            except FileExistsError:
                number += 1
