# SPDX-License-Identifier: MIT
"""A serial port made of a pty."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import time
import tty
from pathlib import Path

from fakes.probe import FakeProbe

# For waits that must be given a limit: longer than that of a test (pyproject.toml),
# which alone ends what hangs, and shows where each thread stands.
PATIENCE_S = 3600.0
# What ends at once, ends within it on a busy machine.
SOON_S = 5.0
# Baud rates that tests set.
RATES = (38_400, 115_200, 230_400, 500_000, 921_600)


def misheard(data: bytes, sent_baud: int, read_baud: int) -> bytes:
    """The bytes that a receiver at another baud rate reads: 8N1, sampled mid-bit."""
    if sent_baud == read_baud:
        return data
    levels = [1]
    for byte in data:
        levels += [0, *((byte >> bit) & 1 for bit in range(8)), 1]
    levels += [1] * 10
    step = sent_baud / read_baud  # the sender's bits in one of the receiver's
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

    With `baud`, a reader that has set another rate reads other bytes, as on a wire.
    """

    def __init__(self, link: Path, baud: int | None = None) -> None:
        self._baud = baud
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        # wait_open() waits until the daemon clears this flag.
        attributes = termios.tcgetattr(self._slave)
        attributes[2] |= termios.HUPCL
        termios.tcsetattr(self._slave, termios.TCSANOW, attributes)
        self.path = link
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._slave))

    def wait_open(self) -> None:
        """Wait until the daemon has opened the port; bytes written earlier are lost."""
        while termios.tcgetattr(self._slave)[2] & termios.HUPCL:
            time.sleep(0.005)

    @property
    def master(self) -> int:
        """The test's end; what the daemon writes is read here."""
        return self._master

    @property
    def speed(self) -> int:
        """The baud rate that the daemon has set."""
        code = termios.tcgetattr(self._slave)[5]
        return next(rate for rate in RATES if getattr(termios, f"B{rate}") == code)

    def write(self, data: bytes) -> None:
        if self._baud is not None:
            data = misheard(data, self._baud, self.speed)
        while data:
            written = os.write(self._master, data)
            data = data[written:]

    def read(self) -> bytes:
        """Wait for bytes from the daemon and return them."""
        return os.read(self._master, 4096)

    def answers(self, probe: FakeProbe) -> bytes:
        """The probe's answers to what the daemon has written so far."""
        ready, _, _ = select.select([self._master], [], [], 0)
        return probe.hear(os.read(self._master, 4096)) if ready else b""

    def vanish(self) -> None:
        self.path.unlink(missing_ok=True)
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)

    def serve(self, probe: FakeProbe, commands: int) -> None:
        """Let the probe answer until it has received this many more commands."""
        until = len(probe.commands) + commands
        while len(probe.commands) < until:
            self.write(probe.hear(self.read()))
