# SPDX-License-Identifier: MIT
"""For imud bridge: messages as subscribers get them, and other ends: a socket, liblo's
oscdump, and mosquitto with a client that notes everything.
"""

from __future__ import annotations

import contextlib
import queue
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import paho.mqtt.client as mqtt
import pytest

from fakes import PATIENCE_S, POSE, free_address
from imud.client import Pose, Status

ID = "00112233445566aa"
# Debian's administrators' programs are not in every user's PATH.
MOSQUITTO = shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin")
# `make test` installs it but where systemd runs, which would start its broker for good.
needs_mosquitto = pytest.mark.skipif(
    MOSQUITTO is None and Path("/run/systemd/system").exists(),
    reason="mosquitto's package would start a broker on this machine",
)


def pose(**changes: Any) -> Pose:
    fields: dict[str, Any] = {
        "probe": "stylus",
        "seq": 1,
        "number": 1,
        "missing": 0,
        "t_device_us": 5000,
        "t_ns": time.time_ns(),
        "t_bound_us": 250,
        "q": (0.8, 0.36, -0.48, 0.0),
        "position_m": None,
        "normal": None,
        "tilt_sigma_deg": POSE["tilt_sigma"],
        "heading_sigma_deg": POSE["heading_sigma"],
        "flags": (),
    }
    return Pose(**fields | changes)


def status(state: str = "streaming", **changes: Any) -> Status:
    fields: dict[str, Any] = {
        "probe": "stylus",
        "probe_id": ID,
        "state": state,
        "port": None,
        "t_ns": time.time_ns(),
        "pose_rate_hz": 100.0,
        "quality": {},
        "ledger": {},
        "hello": {"pose_rate": 100, "sensor": "mpu9250", "firmware": "0.2.0"},
    }
    return Status(**fields | changes)


class Receiver:
    """A UDP socket that somebody sends to."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(PATIENCE_S)
        self.to = f"127.0.0.1:{self._socket.getsockname()[1]}"

    def hear(self) -> bytes:
        return self._socket.recv(65536)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()


class Broker:
    """mosquitto on a port of its own, with these lines of configuration."""

    def __init__(self, folder: Path, *lines: str) -> None:
        self.host, self.port = free_address()
        self._file = folder / "mosquitto.conf"
        first = f"listener {self.port} {self.host}"
        # As root it would take another user, who can't read this folder.
        self._file.write_text("\n".join((first, "user root", *lines)))
        self.start()

    def start(self) -> None:
        assert MOSQUITTO is not None
        command = [MOSQUITTO, "-c", str(self._file)]
        self._process = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        while not self._answers():
            assert self._process.poll() is None
            time.sleep(0.01)

    def _answers(self) -> bool:
        with socket.socket() as tried:
            return tried.connect_ex((self.host, self.port)) == 0

    def stop(self) -> None:
        self._process.terminate()
        self._process.wait()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


class Follower:
    """A client that gets all there is, of paho's."""

    def __init__(self, broker: Broker) -> None:
        self.heard: queue.Queue[mqtt.MQTTMessage] = queue.Queue()
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        self._client.on_message = lambda _, __, message: self.heard.put(message)
        ready = threading.Event()
        self._client.on_subscribe = lambda *_: ready.set()
        self._client.connect(broker.host, broker.port)
        self._client.subscribe("#")
        self._client.loop_start()
        ready.wait()

    def hear(self, topic: str) -> mqtt.MQTTMessage:
        while (found := self.heard.get()).topic != topic:
            pass
        return found

    def hear_while(self, act: Callable[[], object], topic: str, payload: bytes) -> None:
        """Until that comes, does so again and again."""
        while True:
            act()
            with contextlib.suppress(queue.Empty):
                found = self.heard.get(timeout=0.02)
                if (found.topic, found.payload) == (topic, payload):
                    return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()
