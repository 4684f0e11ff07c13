# SPDX-License-Identifier: MIT
"""A daemon as a process of its own, and addresses for it to listen on."""

from __future__ import annotations

import contextlib
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

from fakes.forked import Forked
from fakes.port import Port
from fakes.probe import FakeProbe
from fakes.stopwatch import Stopwatch
from imud.client import Client, client

# What is asked of a daemon on a busy machine is answered, but not soon.
client.QUERY_TIMEOUT_S = client.COMMAND_TIMEOUT_S = 60.0

# Bound, but not listening: a daemon, which sets SO_REUSEADDR, can still bind the port,
# while the system assigns it to nobody else (socket(7)).
_kept: deque[socket.socket] = deque(maxlen=100)


def free_address() -> tuple[str, int]:
    """A loopback address and port, reserved until 100 more have been taken."""
    if len(_kept) == _kept.maxlen:
        _kept.popleft().close()
    kept = socket.socket()
    kept.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    kept.bind(("127.0.0.1", 0))
    _kept.append(kept)
    return "127.0.0.1", int(kept.getsockname()[1])


def free_endpoint() -> str:
    """A free address as an endpoint of Zenoh."""
    host, port = free_address()
    return f"tcp/{host}:{port}"


def status_of(client: Client) -> dict[str, Any]:
    """The status of the only probe; waits, because the first comes after a second."""
    while not (found := client.statuses()):
        time.sleep(0.01)
    (status,) = found
    return status


class DaemonProcess:
    """`imud run` as a process. Its lines of stderr are read as they come."""

    def __init__(
        self,
        *arguments: object,
        directory: Path,
        log: bool | None = True,  # None: leave it to the configuration
        program: tuple[str, ...] = ("-m", "imud"),
        endpoint: str = "",
        page: bool | None = False,  # True: at any free port; None: as with the log
        before: tuple[str, ...] = (),  # what runs the command elsewhere
    ) -> None:
        self.endpoint = endpoint or free_endpoint()
        self.logs = directory / "logs"
        command = [*program, "run", *map(str, arguments)]
        command += ["--listen", self.endpoint]
        if log is not None:
            command += ["--log", str(self.logs)] if log else ["--no-log"]
        if page is not None:
            command += ["--page", "127.0.0.1:0"] if page else ["--no-page"]
        options: dict[str, Any] = {
            "stderr": subprocess.PIPE,
            "cwd": directory,
            "env": os.environ | {"XDG_STATE_HOME": str(directory / "state")},
        }
        if before or program[0] not in ("-m", "-c"):
            command = [*before, sys.executable, *command]
            self.process = subprocess.Popen(command, text=True, **options)
        else:
            self.process = Forked(*command, **options)
        self.lines: list[str] = []
        self._fresh: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self.process.stderr:
            self._fresh.put(line.rstrip("\n"))
        self._fresh.put(None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()
        self._reader.join()
        if self.process.stderr is not None:
            self.process.stderr.close()

    def expect(self, pattern: str) -> str:
        """Wait for the next line that matches; fail at its end."""
        while (line := self._fresh.get()) is not None:
            self.lines.append(line)
            if re.search(pattern, line):
                return line
        # Left running, it could open ptys of the tests that follow.
        self.process.kill()
        raise AssertionError(f"no line matches {pattern!r} in {self.lines}")

    def find(self, port: Port, probe: FakeProbe, up: str = "listens on") -> None:
        """Once it is up, let it find the probe, which says a hello."""
        self.expect(up)
        port.wait_open()
        port.write(probe.say("hello"))
        self.expect("found on")

    def seen(self) -> list[str]:
        """All lines so far; expect() will not see them again."""
        come: list[str] = []
        with contextlib.suppress(queue.Empty):
            while (line := self._fresh.get_nowait()) is not None:
                come.append(line)
            self._fresh.put(None)
        self.lines += come
        return come

    def stop(self, by: signal.Signals = signal.SIGTERM) -> float:
        """Send a signal, wait for exit code 0 and return the seconds that it took."""
        watch = Stopwatch(self.process.pid)
        self.process.send_signal(by)
        seconds = 0.0
        while (code := self.process.poll()) is None:
            seconds = watch.look()
            time.sleep(0.005)
        self.lines += self.rest()
        assert code == 0, f"ended with {code}: {self.lines}"
        return seconds

    def rest(self) -> Iterator[str]:
        """All lines up to the process's end."""
        while (line := self._fresh.get()) is not None:
            yield line

    @property
    def log(self) -> Path:
        (path,) = self.logs.glob("*.mcap")
        return path


def assert_honest(daemon: DaemonProcess) -> None:
    """Its journal reports no internal error and holds no line written by others."""
    for line in daemon.lines:
        assert "internal error" not in line, line
        assert "Traceback" not in line, line
        assert line.isprintable(), line
        assert re.match(r"\d\d:\d\d:\d\d ", line), line
