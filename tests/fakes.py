# SPDX-License-Identifier: MIT
"""A probe made of Python, a port made of a pty, and a daemon of its own process."""

from __future__ import annotations

import contextlib
import os
import queue
import re
import select
import signal
import socket
import subprocess
import sys
import termios
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from imud.client import Client
from imud.wire import schema
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message, decode, encode

# A busy machine may take long; what goes well takes none of it.
PATIENCE_S = 30.0

HELLO: dict[str, Any] = {
    "protocol_version": schema.PROTOCOL_VERSION,
    "schema_fingerprint": schema.FINGERPRINT,
    "firmware": "0.1.0+fake",
    "board": "nano",
    "probe_id": bytes.fromhex("00112233445566aa"),
    "sensor": "mpu9250",
    "who_am_i": (0x71, 0x48),
    "mag_adjust": (176, 178, 166),
    "self_test": ("acc_passed", "gyr_passed"),
    "sample_rate": 200,
    "pose_rate": 100,
    "raw_rate": 0,
    "acc_lsb": 0.004788403,
    "gyr_lsb": 0.001065264,
    "mag_lsb": 0.15,
    "boot_count": 7,
    "reset_cause": ("power_on",),
    "filter": "fuse",
    "reset_address": 0,
}
POSE: dict[str, Any] = {
    "q": (0.5, 0.5, -0.5, 0.5),
    "position": None,
    "normal": None,
    "tilt_sigma": 0.37,
    "heading_sigma": 1.25,
    "pose_flags": ("at_rest",),
}
RAW: dict[str, Any] = {
    "acc": (0, -16, 2048),
    "gyr": (1, -2, 3),
    "mag": (10, -20, 300),
    "temperature": 23.45,
    "sample_flags": (),
}
EVENT: dict[str, Any] = {"event": "stream_started", "cause": "button", "detail": 0}
STATUS: dict[str, Any] = {
    "uptime": 5,
    "state": "streaming",
    "samples_ready": 1000,
    "samples_read": 1000,
    "samples_fused": 1000,
    "overruns": 0,
    "bus_faults": 0,
    "bus_recoveries": 0,
    "messages_sent": 500,
    "messages_dropped": 0,
    "commands_received": 0,
    "commands_bad": 0,
    "cycles_mean": 46000,
    "cycles_worst": 50000,
    "stack_free": 700,
    "supply": None,
}
EQUIPMENT: dict[str, Any] = {
    "clock": "crystal",
    "battery": 3900,
    "power": (),
    "radio": "none",
    "radio_resets": 0,
    "card": "logging",
    "card_block": 2,
    "card_blocks": 65536,
    "card_faults": 0,
    "card_busy": 3,
    "recording": 1,
    "messages_logged": 100,
    "messages_unlogged": 0,
}
REPLY: dict[str, Any] = {
    "replied_command": "start",
    "replied_token": 1,
    "result": "ok",
    "value": (0, 0),
}
COMMAND: dict[str, Any] = {"command": "start", "token": 1, "arguments": (0, 0)}
# Of serial ports, as far as tests set them.
RATES = (38_400, 115_200, 230_400, 500_000, 921_600)

# Commands that an event tells of.
CHANGES = {"restart": "restarted", "tare": "tared"}
EXAMPLES: dict[str, dict[str, Any]] = {
    "hello": HELLO,
    "raw": RAW,
    "pose": POSE,
    "event": EVENT,
    "status": STATUS,
    "equipment": EQUIPMENT,
    "command": COMMAND,
    "reply": REPLY,
}


class FakeProbe:
    """Says what a probe says, in its order: one count for all its messages."""

    def __init__(self, **hello: Any) -> None:
        self.hello_fields = HELLO | hello
        self.sequence = 0
        self.time_us = 0
        self.results: dict[str, str] = {}
        self.commands: list[Mapping[str, Any]] = []
        self._decoder = FrameDecoder()
        self._replied: tuple[int, dict[str, Any]] | None = None

    @property
    def name(self) -> str:
        return str(self.hello_fields["probe_id"].hex())

    def content(self, name: str, **fields: Any) -> bytes:
        example = self.hello_fields if name == "hello" else EXAMPLES[name]
        content = encode(name, example | fields, self.sequence, self.time_us)
        self.sequence = (self.sequence + 1) & 0xFFFFFFFF
        self.time_us = (self.time_us + 5000) & 0xFFFFFFFF
        return content

    def say(self, name: str, **fields: Any) -> bytes:
        return encode_frame(self.content(name, **fields))

    def poses(self, count: int) -> bytes:
        return b"".join(self.say("pose") for _ in range(count))

    def restart(self) -> None:
        self.sequence = self.time_us = 0
        boots = self.hello_fields["boot_count"] + 1
        self.hello_fields = self.hello_fields | {"boot_count": boots}

    def hear(self, data: bytes) -> bytes:
        """The answers to commands among these bytes."""
        said = b""
        for content in self._decoder.feed(data):
            message = decode(content)
            if isinstance(message, Message) and message.name == "command":
                said += self._obey(message.fields)
        return said

    def _obey(self, fields: Mapping[str, Any]) -> bytes:
        said = b""
        token = fields["token"]
        if self._replied is None or self._replied[0] != token:
            # The daemon asks for the time whenever it likes.
            if fields["command"] != "time":
                self.commands.append(fields)
            result = self.results.get(fields["command"], "ok")
            reply = {
                "replied_command": fields["command"],
                "replied_token": token,
                "result": result,
                "value": fields["arguments"],
            }
            self._replied = token, reply
            if fields["command"] == "hello":
                said = self.say("hello")
            if result == "ok" and fields["command"] in CHANGES:
                is_same = fields["command"] == "restart" and not fields["arguments"][0]
                detail = schema.Filter.FUSE if is_same else fields["arguments"][0]
                what = {"event": CHANGES[fields["command"]], "cause": "command"}
                said = self.say("event", **what, detail=detail)
        return said + self.say("reply", **self._replied[1])


def misheard(data: bytes, sent_baud: int, read_baud: int) -> bytes:
    """What a receiver at another rate makes of these bytes: 8N1, sampled mid-bit."""
    if sent_baud == read_baud:
        return data
    levels = [1]
    for byte in data:
        levels += [0, *((byte >> bit) & 1 for bit in range(8)), 1]
    levels += [1] * 10
    step = sent_baud / read_baud  # bits of the sender in one of the receiver
    heard = bytearray()
    at = 0.0
    while start := next((i for i in range(int(at), len(levels)) if not levels[i]), 0):
        begin = max(at, start)
        bits = [int(begin + (place + 1.5) * step) for place in range(8)]
        at = begin + 9.5 * step
        if at >= len(levels):
            break
        heard.append(sum(levels[bit] << place for place, bit in enumerate(bits)))
    return bytes(heard)


class Port:
    """A pty: the daemon opens `path`, the test writes and reads the other end.

    With a rate, who has set another one hears other bytes, as on a wire.
    """

    def __init__(self, link: Path, baud: int | None = None) -> None:
        self._baud = baud
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        # For wait_open(): a pty begins without it.
        attributes = termios.tcgetattr(self._slave)
        attributes[2] |= termios.HUPCL
        termios.tcsetattr(self._slave, termios.TCSANOW, attributes)
        self.path = link
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._slave))

    def wait_open(self) -> None:
        """Until the daemon has opened it; bytes written before that are flushed."""
        until = time.monotonic() + PATIENCE_S
        while termios.tcgetattr(self._slave)[2] & termios.HUPCL:
            assert time.monotonic() < until, "the daemon did not open the port"
            time.sleep(0.005)

    @property
    def master(self) -> int:
        """What is to be read here was written by the daemon."""
        return self._master

    @property
    def speed(self) -> int:
        """The rate that the other end has set."""
        code = termios.tcgetattr(self._slave)[5]
        return next(rate for rate in RATES if getattr(termios, f"B{rate}") == code)

    def write(self, data: bytes) -> None:
        if self._baud is not None:
            data = misheard(data, self._baud, self.speed)
        while data:
            written = os.write(self._master, data)
            data = data[written:]

    def read(self) -> bytes:
        """Some bytes, as soon as there are any."""
        ready, _, _ = select.select([self._master], [], [], PATIENCE_S)
        assert ready, "the daemon wrote nothing"
        return os.read(self._master, 4096)

    def answers(self, probe: FakeProbe) -> bytes:
        """To what the daemon has written by now."""
        ready, _, _ = select.select([self._master], [], [], 0)
        return probe.hear(os.read(self._master, 4096)) if ready else b""

    def vanish(self) -> None:
        self.path.unlink(missing_ok=True)
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def serve(self, probe: FakeProbe, commands: int) -> None:
        """Lets the probe answer until it has heard so many commands."""
        until = len(probe.commands) + commands
        while len(probe.commands) < until:
            self.write(probe.hear(self.read()))


# Bound and never listening: a daemon, which sets SO_REUSEADDR, can have the port, and
# the system gives it to nobody else (socket(7)).
_kept: deque[socket.socket] = deque(maxlen=100)


def free_address() -> tuple[str, int]:
    """An address that the system has given to this process, for a while."""
    if len(_kept) == _kept.maxlen:
        _kept.popleft().close()
    kept = socket.socket()
    kept.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    kept.bind(("127.0.0.1", 0))
    _kept.append(kept)
    return "127.0.0.1", int(kept.getsockname()[1])


def free_endpoint() -> str:
    """The same, as Zenoh calls it."""
    host, port = free_address()
    return f"tcp/{host}:{port}"


def status_of(client: Client) -> dict[str, Any]:
    """That of the only probe, which may have none for its first second."""
    until = time.monotonic() + PATIENCE_S
    while not (found := client.statuses()):
        assert time.monotonic() < until, "no status came"
        time.sleep(0.01)
    (status,) = found
    return status


class DaemonProcess:
    """`imud run` as a user runs it. Its lines are read as they come."""

    def __init__(
        self,
        *arguments: object,
        directory: Path,
        log: bool | None = True,  # None: as a configuration says
        program: tuple[str, ...] = ("-m", "imud"),
        endpoint: str = "",
    ) -> None:
        self.endpoint = endpoint or free_endpoint()
        self.logs = directory / "logs"
        command = [sys.executable, *program, "run", *map(str, arguments)]
        command += ["--listen", self.endpoint]
        if log is not None:
            command += ["--log", str(self.logs)] if log else ["--no-log"]
        self.process = subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, cwd=directory
        )
        self.lines: list[str] = []
        self._fresh: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
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
        """The next line that matches."""
        until = time.monotonic() + PATIENCE_S
        while (left := until - time.monotonic()) > 0:
            try:
                line = self._fresh.get(timeout=left)
            except queue.Empty:
                break
            if line is None:
                break
            self.lines.append(line)
            if re.search(pattern, line):
                return line
        # One that was left to itself would take up ptys of the tests that follow.
        self.process.kill()
        raise AssertionError(f"no line matches {pattern!r} in {self.lines}")

    def seen(self) -> list[str]:
        """The lines that came by now, which are expected no longer."""
        come: list[str] = []
        with contextlib.suppress(queue.Empty):
            while (line := self._fresh.get_nowait()) is not None:
                come.append(line)
            self._fresh.put(None)
        self.lines += come
        return come

    def stop(self, by: signal.Signals = signal.SIGTERM) -> float:
        """Asks it to end and returns the seconds that it took."""
        begin = time.monotonic()
        self.process.send_signal(by)
        code = self.process.wait(PATIENCE_S)
        seconds = time.monotonic() - begin
        self.lines += self.rest()
        assert code == 0, f"ended with {code}: {self.lines}"
        return seconds

    def rest(self) -> Iterator[str]:
        """All lines up to its end."""
        while (line := self._fresh.get(timeout=PATIENCE_S)) is not None:
            yield line

    @property
    def log(self) -> Path:
        (path,) = self.logs.glob("*.mcap")
        return path
