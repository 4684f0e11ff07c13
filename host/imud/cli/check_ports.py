# SPDX-License-Identifier: MIT
"""Serial ports for `imud check`: the kind of adapter, and a daemon of its own on a
port.
"""

from __future__ import annotations

import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from serial.tools import list_ports

from imud.check.evidence import Wire
from imud.client import Client
from imud.config.settings import PortSettings
from imud.errors import DaemonNotFound, LinkError, PortNotFound, ProbeUnknown
from imud.ports.adapters import kind_of
from imud.ports.local import LocalPorts
from imud.ports.standing import Standing

START_S = 10.0  # until the daemon listens
PROBE_S = 12.0  # a board that restarts, and a round of all baud rates
WARNED_S = 4.0  # a warning may be about the bootloader's silence


def only_port(command: str) -> str:
    """The one port that may have a probe. ProbeUnknown if there is none, or several,
    or if it may be another program's; `command` is what to say then, as "imud check".
    """
    rows = LocalPorts(PortSettings()).rows()
    ours = [row.port for row in rows if row.is_opened]
    if len(ours) == 1:
        return ours[0]
    others = [row.port for row in rows if row.standing == Standing.UNKNOWN.value]
    found = ours or others
    if not found:
        raise ProbeUnknown(
            "imud run is not running, and there is no USB serial port; plug the board "
            f"in, or name its port: {command} /dev/ttyUSB0"
        )
    if len(found) == 1:
        raise ProbeUnknown(
            f"imud run is not running, and {found[0]} may be another program's; if it "
            f"is the board's: {command} {found[0]}"
        )
    raise ProbeUnknown(
        f"imud run is not running, and there are {len(found)} serial ports; name one: "
        f"{', '.join(found)}"
    )


def wire_of(port: str | None) -> Wire | None:
    """The kind and settings of a port of this machine."""
    if port is None or not Path(port).exists():
        return None
    real = os.path.realpath(port)
    if real.startswith("/dev/pts/"):
        return Wire("a pty: a virtual probe")
    known = next((each for each in list_ports.comports() if each.device == real), None)
    if known is None or known.vid is None:
        return Wire("a serial port that is not USB")
    return Wire(
        f"USB, {kind_of(known)}", latency_timer_ms=_latency_timer(Path(real).name)
    )


def _latency_timer(name: str) -> int | None:
    """Of an FTDI adapter, as its driver tells it."""
    try:
        text = Path(f"/sys/class/tty/{name}/device/latency_timer").read_text()
    except OSError:
        return None
    return int(text) if text.strip().isdigit() else None


class OwnDaemon:
    """`imud run` on one port, or with the ports of a file, without log and page, as
    long as it is open.
    """

    def __init__(self, port: str, config: Path | None = None) -> None:
        if config is None and not Path(port).exists():
            raise PortNotFound(
                f"{port} does not exist; plug the board in, and see ls /dev/tty*"
            )
        self.port = port
        self._ports = [port] if config is None else ["--config", str(config)]
        self.endpoint = f"tcp/127.0.0.1:{_free_port()}"
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._warned: tuple[float, str] | None = None
        names = ("SIGTERM", "SIGHUP")  # the latter not everywhere
        ends = [getattr(signal, name) for name in names if hasattr(signal, name)]
        self._signals: dict[int, Any] = dict.fromkeys(ends)

    def __enter__(self) -> Self:
        # Terminated, or closed with its terminal, this process ends the daemon first.
        # Ctrl-C is for it alone: the daemon has to leave the probe as it was.
        for number in self._signals:
            self._signals[number] = signal.signal(number, signal.default_int_handler)
        words = ["run", *self._ports, "--no-log", "--no-page", "--log-level", "warning"]
        # It must not outlive this process, if that is killed.
        words.append("--until-eof")
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "imud", *words, "--listen", self.endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._process.terminate()
        try:
            self._process.wait(START_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        for number, handler in self._signals.items():
            signal.signal(number, handler)
        for pipe in (self._process.stdin, self._process.stderr):
            if pipe is not None:
                pipe.close()

    def _read(self) -> None:
        for line in self._process.stderr or ():
            self._lines.put(line.strip())

    def client(self) -> Client:
        """Of this daemon, once it listens."""
        until_s = time.monotonic() + START_S
        while True:
            try:
                return Client(self.endpoint)
            except DaemonNotFound:
                self.check()
                if time.monotonic() > until_s:
                    raise
                time.sleep(0.05)

    def check(self) -> None:
        """LinkError with the daemon's message if its port does not work."""
        while not self._lines.empty():
            words = re.sub(
                r"^\d\d:\d\d:\d\d (warning|error)?:? *", "", self._lines.get()
            )
            self._warned = self._warned or (time.monotonic(), words)
        has_ended = self._process.poll() is not None
        if self._warned is None:
            if has_ended:
                raise LinkError(f"imud run on {self.port} ended; see its output")
            return
        warned_s, words = self._warned
        if has_ended or time.monotonic() - warned_s > WARNED_S:
            raise LinkError(words)


def _free_port() -> int:
    with socket.socket() as asked:
        asked.bind(("127.0.0.1", 0))
        return int(asked.getsockname()[1])
