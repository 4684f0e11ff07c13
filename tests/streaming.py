# SPDX-License-Identifier: MIT
"""Processes on the network, and a probe that streams to a daemon."""

from __future__ import annotations

import json
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from typing import Any, ClassVar, Self

from fakes import FakeProbe, Forked, Port
from imud.client import Client


class Process:
    """Python in a process of its own, once it has said that it is up."""

    made: ClassVar[list[Process]] = []

    def __init__(self, code: str, endpoint: str) -> None:
        self.made.append(self)
        pipe = subprocess.PIPE
        self.process = Forked("-c", code, endpoint, stdin=pipe, stdout=pipe)
        assert self.process.stdout.readline() == "up\n"

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    def ask(self) -> dict[str, Any]:
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        return json.loads(self.process.stdout.readline())

    def kill(self) -> None:
        self.made.remove(self)
        self.process.kill()
        self.process.communicate()


class Streaming:
    """A probe that says poses, or what `say` returns, until it is told not to."""

    def __init__(
        self,
        port: Port,
        probe: FakeProbe,
        period_s: float = 0.005,
        say: Callable[[], bytes] | None = None,
    ) -> None:
        self._port, self._period_s = port, period_s
        self._say = say or (lambda: probe.say("pose"))
        self.sent_s: list[float] = []  # when each was written
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.wait(self._period_s):
            self.sent_s.append(time.monotonic())
            self._port.write(self._say())

    @property
    def sent(self) -> int:
        return len(self.sent_s)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Also where a test fails: before its daemon, which reads what is said."""
        self.stop()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()


def until(is_so: Callable[[], object]) -> None:
    while not is_so():
        time.sleep(0.02)


def zenoh_of(client: Client) -> dict[str, int]:
    """The outcome of all records on their way to the network."""
    (status,) = client.statuses()
    return status["ledger"]["sinks"]["zenoh"]
