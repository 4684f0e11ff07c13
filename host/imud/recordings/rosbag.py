# SPDX-License-Identifier: MIT
"""`imud export --to rosbag2`: writes logs as bags of ROS 2, with the messages that the
daemon's node publishes. The bags are written by rosbags.
"""

from __future__ import annotations

import shutil
import struct
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from imud.errors import FileError
from imud.log.reader import METADATA_OF_PROBES, Logged, size_of
from imud.probes.record import Record
from imud.published import SinceOrigin
from imud.recordings.damage import DamageCount
from imud.recordings.each_log import each_of, items_of, tell_flaws, tell_fused
from imud.recordings.fused import FusedLog
from imud.ros2.topics import Topic
from imud.sinks.ros2 import RosMessage, RosTranslator
from imud.wire.params import digest_of

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag2 import Writer

HELLO, PARAMS = (METADATA_OF_PROBES[name] for name in ("hello", "params"))
TOPICS = frozenset({"pose", "raw", "stroke", "event", "status"})

# As the daemon's configuration has them by default.
NAMESPACE, WORLD = "imud", "world"

# Exceptions of the translator for an object that imud did not write.
STRANGE = (
    *(LookupError, TypeError, ValueError, AttributeError, OverflowError),
    *(struct.error, msgspec.MsgspecError),
)


class ProbeInLog:
    """Makes ROS 2 messages of what a log has of one probe, in its order."""

    def __init__(self, probe: str) -> None:
        self._translator = RosTranslator(probe, NAMESPACE, WORLD)
        self._hello = b""
        self._sets: dict[int | None, bytes] = {0: b""}

    def add(self, item: Logged) -> None:
        """Metadata: a hello, or params, which samples name by their digest."""
        if item.topic == HELLO:
            self._hello = item.data
        elif item.topic == PARAMS:
            self._sets[digest_of(item.data)] = item.data

    def messages(self, item: Logged) -> list[RosMessage]:
        """Messages for an object of a log; raises one of STRANGE."""
        values = item.values or msgspec.json.decode(item.data, type=dict[str, Any])
        if values.get("since_origin") is not None:
            since = msgspec.convert(values["since_origin"], SinceOrigin)
            values["since_origin"] = since
        record = Record(
            item.probe,
            item.topic,
            item.data,
            b"",
            0,
            item.t_sample_ns,
            item.t_ns,
            self._hello,
            self._sets.get(values.get("params_digest")),
            values,
        )
        return list(self._translator.translate(record))


class Bag:
    """A bag that is being written; gone if that fails."""

    def __init__(self, folder: Path) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

        self._folder = folder
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._writer: Writer = Writer(
            folder, version=Writer.VERSION_LATEST, storage_plugin=StoragePlugin.MCAP
        )
        self._connections: dict[str, Connection] = {}
        self.count = 0

    def __enter__(self) -> Bag:
        self._writer.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        is_good = False
        try:
            self._writer.close()
            is_good = kind is None
        finally:
            if not is_good:
                shutil.rmtree(self._folder, ignore_errors=True)

    def add(self, t_ns: int, topic: Topic, data: bytes) -> None:
        """`t_ns`: UTC at which it was received."""
        connection = self._connections.get(topic.name)
        if connection is None:
            connection = self._writer.add_connection(
                topic.name, topic.type.name, typestore=self._types
            )
            self._connections[topic.name] = connection
        self._writer.write(connection, t_ns, data)
        self.count += 1


def run(paths: Sequence[Path], out: Path | None, *, is_fused: bool = False) -> int:
    """Writes a bag of each log, the folder STEM-rosbag2, with poses of its raw samples
    if `is_fused`; returns 0. Raises FileError
    for logs that can't be exported, after all others are done.
    """
    try:
        import rosbags.rosbag2  # noqa: F401 - to see whether it is installed
    except ImportError as error:
        raise FileError(
            "writing bags needs rosbags: pip install 'imu-probe[rosbag2]'"
        ) from error
    return each_of(
        paths,
        lambda log, by: _export(log, out or by, FusedLog() if is_fused else None),
    )


def _export(path: Path, directory: Path, fused: FusedLog | None) -> None:
    folder = directory / f"{path.stem}-rosbag2"
    if folder.exists():
        raise FileError(f"{folder} already exists; choose another folder with --out")
    probes: dict[str, ProbeInLog] = {}
    damage = DamageCount()
    strange = 0
    size_of(path)  # no folder of what is no log
    try:
        with Bag(folder) as bag:
            for item in items_of(path, {*TOPICS, HELLO, PARAMS}, damage, fused):
                probe = probes.setdefault(item.probe, ProbeInLog(item.probe))
                if item.topic not in TOPICS:
                    probe.add(item)
                    continue
                try:
                    messages = probe.messages(item)
                except STRANGE:
                    strange += 1
                    continue
                for topic, data in messages:
                    bag.add(item.t_ns, topic, data)
    except OSError as error:
        raise FileError(f"can't export to {folder}: {error.strerror}") from error
    if not bag.count:
        shutil.rmtree(folder)
        sys.stdout.write(f"{path} has no messages for ROS 2\n")
    else:
        sys.stdout.write(f"{folder}: {bag.count} messages\n")
    tell_fused(fused)
    tell_flaws(path, strange, damage)
