# SPDX-License-Identifier: MIT
"""Foxglove gets live what it gets from a log. The client here is of our own, written
from Foxglove's description of its protocol, `foxglove.sdk.v1`.
"""

from __future__ import annotations

import contextlib
import json
import socket
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from configured import running
from fakes import PATIENCE_S, free_address
from imud.errors import ConfigError
from imud.log.reader import Logged
from imud.log.schemas import schema_of
from imud.sinks.foxglove import FoxgloveSink
from log_files import read_log, records

# Operation 1: the id of a subscription, the time in ns, the message.
_MESSAGE = struct.Struct("<BIQ")


class Viewer:
    """Subscribes to whatever is advertised."""

    def __init__(self, connection: ClientConnection) -> None:
        self._connection = connection
        self.channels: dict[str, dict[str, Any]] = {}
        self._topics: dict[int, str] = {}

    def hear(self, patience_s: float) -> tuple[str, int, bytes]:
        """Topic, time in ns and data of the next message."""
        while True:
            data = self._connection.recv(patience_s)
            if isinstance(data, str):
                self._subscribe(json.loads(data))
                continue
            operation, number, t_ns = _MESSAGE.unpack_from(data)
            if operation == 1:
                return self._topics[number], t_ns, data[_MESSAGE.size :]

    def abort(self) -> None:
        """Ends the connection without reading what has come."""
        self._connection.socket.shutdown(socket.SHUT_RDWR)

    def _subscribe(self, message: dict[str, Any]) -> None:
        if message["op"] != "advertise":
            return
        wanted = []
        for channel in message["channels"]:
            self.channels[channel["topic"]] = channel
            self._topics[channel["id"]] = channel["topic"]
            wanted.append({"id": channel["id"], "channelId": channel["id"]})
        message = {"op": "subscribe", "subscriptions": wanted}
        self._connection.send(json.dumps(message))


@contextlib.contextmanager
def viewer(host: str, port: int) -> Iterator[Viewer]:
    protocol = Subprotocol("foxglove.sdk.v1")
    where = f"ws://{host}:{port}"
    # The other end may leave a closing unanswered.
    with connect(where, subprotocols=[protocol], close_timeout=1.0) as connection:
        yield Viewer(connection)


def test_a_daemon_says_live_what_it_logs(tmp_path: Path) -> None:
    host, port = free_address()
    section = f"[foxglove]\nenabled = true\nlisten = '{host}:{port}'"
    with running(tmp_path, section) as (daemon, probe, pty):
        told = [line for line in daemon.lines if "Foxglove connects to" in line]
        assert told[0].endswith(f"ws://{host}:{port}")
        topics = {f"imud/{probe.name}/{kind}" for kind in ("pose", "pose_in_frame")}
        heard: dict[str, dict[int, bytes]] = {topic: {} for topic in topics}
        with viewer(host, port) as live:
            while min(map(len, heard.values())) < 5:
                # A subscription takes effect a while after it is sent.
                pty.write(probe.poses(1))
                with contextlib.suppress(TimeoutError):
                    topic, t_ns, data = live.hear(0.2)
                    if topic in topics:
                        heard[topic][t_ns] = data
            for topic in topics:
                name, body = schema_of(topic.rpartition("/")[2])
                channel = live.channels[topic]
                assert channel["schemaName"] == name
                assert channel["schemaEncoding"] == "jsonschema"
                assert json.loads(channel["schema"]) == body
                assert channel["encoding"] == "json"
        log = daemon.log
        daemon.stop()
    logged = {
        (f"imud/{each.probe}/{each.topic}", each.data)
        for each in read_log(log)
        if isinstance(each, Logged)
    }
    for topic, messages in heard.items():
        assert all((topic, data) in logged for data in messages.values())


def test_a_viewer_that_stands_still_holds_nobody_up() -> None:
    address = free_address()
    sink = FoxgloveSink(address, "imud")
    sink.open()
    # More than its connection's buffers hold.
    payload = json.dumps("x" * 100_000).encode()
    large = replace(records(3)[2], payload=payload)
    with viewer(*address) as live, viewer(*address) as stopped:
        for each in (stopped, live):
            heard = False
            while not heard:  # a subscription takes effect a while after it is sent
                sink.write(large)
                with contextlib.suppress(TimeoutError):
                    heard = each.hear(0.05)[2] == payload
        for _ in range(200):
            sink.write(large)
            assert live.hear(PATIENCE_S)[2] == payload
        stopped.abort()
    sink.close()


def test_without_the_library_it_is_said_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(ConfigError, match=r"pip install 'imu-probe\[foxglove\]'"):
        FoxgloveSink(("127.0.0.1", 0), "imud").open()
