# SPDX-License-Identifier: MIT
"""A virtual probe in real time, and what a subscriber hears."""

from __future__ import annotations

import json
import queue
import signal
import subprocess
from typing import Any

from fakes import PATIENCE_S
from imud.client import Client
from system.virtual import Stub


class LiveProbe:
    """A virtual probe on a pty, in real time."""

    def __init__(self, stub: Stub, *options: object) -> None:
        self.port = stub.folder / "probe"
        self.summary = stub.folder / "live.json"
        words = ["--image", stub.image, "--pty", self.port, "--summary", self.summary]
        words += ["--seconds", PATIENCE_S]  # not only until its motion is over
        self.process = subprocess.Popen(
            [str(stub.simulator), *map(str, [*words, *options])],
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stderr.readline().startswith("ready")

    def end(self, by: signal.Signals = signal.SIGTERM) -> dict[str, Any]:
        """Ends it and returns its summary."""
        self.process.send_signal(by)
        self.process.wait()
        if self.process.stderr is not None:
            self.process.stderr.close()
        if by == signal.SIGKILL:
            self.port.unlink(missing_ok=True)
            return {}
        return json.loads(self.summary.read_text())


def hear(client: Client, topic: str) -> queue.Queue[dict[str, Any]]:
    heard: queue.Queue[dict[str, Any]] = queue.Queue()
    client.subscribe(topic, None, lambda _, payload: heard.put(json.loads(payload)))
    return heard


def take(heard: queue.Queue[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    return [heard.get() for _ in range(count)]
