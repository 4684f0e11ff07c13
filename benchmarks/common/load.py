# SPDX-License-Identifier: MIT
"""Probes that a process writes to ptys, and what a process under such a load takes."""

from __future__ import annotations

import array
import os
import re
import resource
import selectors
import socket
import time
import tty
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common.source import RATE_HZ, Source
from imud.wire import messages
from imud.wire.frame import FrameDecoder, encode_frame
from imud.wire.messages import Message

PATIENCE_S = 30.0
_REPLY = {"replied_command": "time", "result": "ok", "value": (0, 0)}


class FedPort:
    """A pty with a probe at its other end."""

    def __init__(self, number: int, rate_hz: int = RATE_HZ) -> None:
        self.source = Source(number, hello_every=rate_hz)
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.name = os.ttyname(slave)
        self._slave = slave  # kept open: the pty must not hang up
        os.set_blocking(self.master, False)
        self._decoder = FrameDecoder()
        self.overrun = 0  # frames that the pty had no room for

    def write(self, frame: bytes) -> None:
        try:
            os.write(self.master, frame)
        except BlockingIOError:
            self.overrun += 1

    def answer(self, now_us: int) -> None:
        """Reply to the daemon's requests for the time, if any have come."""
        try:
            heard = os.read(self.master, 4096)
        except BlockingIOError:
            return
        for content in self._decoder.feed(heard):
            message = messages.decode(content)
            if isinstance(message, Message) and message.name == "command":
                fields = _REPLY | {
                    "replied_command": message.fields["command"],
                    "replied_token": message.fields["token"],
                }
                reply = messages.encode(
                    "reply", fields, self.source.sequence, now_us & 0xFFFFFFFF
                )
                self.source.sequence += 1
                self.source.sent += 1
                self.write(encode_frame(reply))


def feed(probes: int, rate_hz: int, to: Connection, path: Path) -> None:
    """Write frames to ptys, the probes' phases spread evenly over the period, until it
    is told to stop. Notes probe, sequence number and UTC of each pose, and whether its
    pty had no room for it.
    """
    least, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = min(most, max(least, 2 * probes + 100))
    resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, most))
    ports = [FedPort(number, rate_hz) for number in range(probes)]
    waker = selectors.DefaultSelector()
    for port in ports:
        waker.register(port.master, selectors.EVENT_READ, port)
    to.send([port.name for port in ports])
    to.recv()
    notes = array.array("q")
    sent_bytes = turn = 0
    step_ns = 1_000_000_000 // (rate_hz * probes)
    begin_ns = time.monotonic_ns() + 50_000_000
    while not to.poll():
        for number, port in enumerate(ports):
            due_ns = begin_ns + (turn * probes + number) * step_ns
            while (left_ns := due_ns - time.monotonic_ns()) > 0:
                for key, _ in waker.select(left_ns * 1e-9):
                    key.data.answer((time.monotonic_ns() - begin_ns) // 1000)
            sequence, before = port.source.sequence, port.overrun
            frame = port.source.say((time.monotonic_ns() - begin_ns) // 1000)
            sent_bytes += len(frame)
            t_ns = time.time_ns()
            port.write(frame)
            if sequence % rate_hz:  # others are hellos
                notes.extend((number, sequence, t_ns, port.overrun - before))
        turn += 1
    seconds = (time.monotonic_ns() - begin_ns) * 1e-9
    to.recv()
    np.save(path, np.array(notes, dtype=np.int64).reshape(-1, 4))
    sent = sum(port.source.sent for port in ports)
    overrun = sum(port.overrun for port in ports)
    rate = sent_bytes / seconds
    to.send({"sent": sent, "overrun": overrun, "bytes_s": rate, "fed_s": seconds})
    to.recv()  # ptys stay open until the daemons have published all


def free_endpoint() -> str:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{taken.getsockname()[1]}"


def cpu_s(pid: int) -> float:
    """Seconds of user and system time of a process."""
    stat = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


def idle_s() -> float:
    """Idle seconds of all cores: without any, other programs distort the figures."""
    words = Path("/proc/stat").read_text().split("\n", 1)[0].split()
    return int(words[4]) / os.sysconf("SC_CLK_TCK")


def rss_mib(pid: int | str = "self") -> float:
    """Resident memory of a process in MiB."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def answer_of(connection: Connection, patience_s: float) -> Any:
    if not connection.poll(patience_s):
        raise TimeoutError("a process of this benchmark does not report")
    return connection.recv()


def wait_for_line(path: Path, pattern: str) -> None:
    until = time.monotonic() + PATIENCE_S
    while not re.search(pattern, path.read_text()):
        if time.monotonic() > until:
            raise TimeoutError(f"the daemon did not start: {path.read_text()}")
        time.sleep(0.02)
