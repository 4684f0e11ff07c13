# SPDX-License-Identifier: MIT
"""A pty on which a log is replayed as if a probe were at a serial port."""

from __future__ import annotations

import contextlib
import os
import select
import struct
import time
from pathlib import Path

from imud.errors import FileError

try:
    import fcntl
    import termios
    import tty
except ImportError:
    fcntl = None  # type: ignore[assignment]

# How often it checks whether a reader has opened the pty.
LOOK_S = 0.02

# A reader flushes its input after it has opened the port, and what was written before
# would be gone. imud then clears HUPCL, which shows that it is done, on a busy machine
# after a second; other readers get this much time.
SETTLE_S = 3.0

# How long a reader has at the end to take what is left in the pty, which is lost when
# the pty closes: counted from when it last took something.
DRAIN_S = 10.0

# The wait where that can't be seen, because the reader has opened the pty exclusively.
LINGER_S = 2.0

# Checks in a row that must find nothing left: the kernel moves bytes in two steps.
EMPTY_LOOKS = 3

_INT = struct.Struct("i")
_CFLAG = 2  # index of the control flags in what tcgetattr returns


class PortGone(Exception):
    """The reader has closed the pty: an end, not an error."""


class PtyPort:
    """A pty that stands in for a probe's serial port. What a reader writes is ignored.

    `link`: a path to make as a symbolic link to it; FileError if that fails.
    """

    def __init__(self, link: Path | None) -> None:
        if fcntl is None:
            raise FileError("this system has no pseudo terminals: leave out --link")
        self._master, slave = os.openpty()
        tty.setraw(slave)
        attributes = termios.tcgetattr(slave)
        attributes[_CFLAG] |= termios.HUPCL
        termios.tcsetattr(slave, termios.TCSANOW, attributes)
        os.set_blocking(self._master, False)
        self.name = self._tty = os.ttyname(slave)
        self._link = link
        # With the slave closed, POLLHUP on the master shows that there is no reader.
        os.close(slave)
        if link is not None:
            try:
                if link.is_symlink():
                    link.unlink()
                link.symlink_to(self.name)
            except OSError as error:
                os.close(self._master)
                raise FileError(f"can't make {link}: {error.strerror}") from error
            self.name = str(link)

    def wait_open(self) -> None:
        """Waits until a reader has opened the pty and flushed its input."""
        while self._events(select.POLLOUT, 0) & select.POLLHUP:
            time.sleep(LOOK_S)
        until_s = time.monotonic() + SETTLE_S
        while self._is_settling() and time.monotonic() < until_s:
            time.sleep(LOOK_S)

    def _is_settling(self) -> bool:
        return bool(termios.tcgetattr(self._master)[_CFLAG] & termios.HUPCL)

    def write(self, data: bytes) -> None:
        """Writes all of it at the reader's pace; PortGone if the reader closes."""
        while data:
            events = self._events(select.POLLOUT | select.POLLIN, 1000)
            if events & select.POLLHUP:
                raise PortGone
            if events & select.POLLIN:
                with contextlib.suppress(OSError):
                    os.read(self._master, 4096)
            if events & select.POLLOUT:
                with contextlib.suppress(BlockingIOError):
                    data = data[os.write(self._master, data) :]

    def drain(self) -> int:
        """Waits until the reader has taken everything. How many bytes it has left, if
        it takes none for DRAIN_S.
        """
        try:
            slave = os.open(self._tty, os.O_RDONLY | os.O_NOCTTY | os.O_NONBLOCK)
        except OSError:
            time.sleep(LINGER_S)
            return 0
        try:
            looks, before = 0, -1
            until_s = time.monotonic() + DRAIN_S
            while looks < EMPTY_LOOKS and time.monotonic() < until_s:
                (waiting,) = _INT.unpack(
                    fcntl.ioctl(slave, termios.FIONREAD, bytes(_INT.size))
                )
                if waiting != before:
                    until_s = time.monotonic() + DRAIN_S
                before = waiting
                looks = looks + 1 if waiting == 0 else 0
                time.sleep(LOOK_S)
            return max(before, 0)
        finally:
            os.close(slave)

    def close(self) -> None:
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        os.close(self._master)

    def _events(self, mask: int, timeout_ms: int) -> int:
        poll = select.poll()
        poll.register(self._master, mask)
        found = poll.poll(timeout_ms)
        return found[0][1] if found else 0
