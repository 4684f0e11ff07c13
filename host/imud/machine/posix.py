# SPDX-License-Identifier: MIT
"""Linux, macOS and their relatives. asyncio is loaded where a loop runs: the command
line needs the rest at once.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import resource
import select
import signal
import termios
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, TextIO

from imud._core import read_some

if TYPE_CHECKING:
    import serial

# Exceptions of opening or setting a port.
PORT_ERRORS = (termios.error, OSError, ValueError)
# Whether a program that is started can get open sockets.
HANDS_ON_SOCKETS = True

_UP = time.CLOCK_MONOTONIC
if hasattr(time, "CLOCK_BOOTTIME"):  # Linux
    _CLOCKS = time.CLOCK_MONOTONIC_RAW, time.CLOCK_BOOTTIME, _UP
elif hasattr(time, "CLOCK_UPTIME_RAW"):  # macOS, whose raw clock counts sleep
    _CLOCKS = time.CLOCK_UPTIME_RAW, time.CLOCK_MONOTONIC_RAW, time.CLOCK_UPTIME_RAW
else:
    _CLOCKS = getattr(time, "CLOCK_MONOTONIC_RAW", _UP), _UP, _UP
# Two clocks are read at most so far apart, mostly; a sleep is longer.
_APART_NS, _READINGS = 100_000, 5


class _HostClock:
    """The host's time in ns: of its oscillator, and of the time that it slept.

    Nothing sets or slews the oscillator: NTP changes the rate of CLOCK_MONOTONIC by up
    to 500 ppm, which would look like a jump of the probe's clock. It stands still in
    suspend, and two other clocks differ by that.
    """

    def __init__(self) -> None:
        self._oscillator, self._counting, self._standing = _CLOCKS
        self._slept_ns = 0

    def __call__(self) -> int:
        read = time.clock_gettime_ns
        # The clock that stands still is read last: a pause in between makes the
        # difference too small, and the greatest one is right.
        more_ns = read(self._counting) - read(self._standing) - self._slept_ns
        if more_ns > _APART_NS:
            self._slept_ns += max(
                read(self._counting) - read(self._standing) - self._slept_ns
                for _ in range(_READINGS)
            )
        return read(self._oscillator) + self._slept_ns

    def slept_ns(self) -> int:
        """How long the machine had slept when the time was read last; 0 where no clock
        counts that.
        """
        return self._slept_ns


host_clock_ns = _HostClock()
slept_ns = host_clock_ns.slept_ns

_CFLAG, _CC = 2, 6  # places in what tcgetattr returns


def try_lock(file: IO[Any], *, is_shared: bool = False) -> bool:
    """Locks an open file; False if another process has locked it. OSError where the
    file system can't.
    """
    kind = fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX
    try:
        fcntl.flock(file, kind | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def shorten_pipe(pipe: IO[Any]) -> None:
    """Lets as little as possible wait in a pipe: a page, 4 kB. Linux alone can."""
    with contextlib.suppress(OSError, AttributeError):
        fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, 4096)


def sync(descriptor: int) -> None:
    """Has the disk keep what was written to a file."""
    getattr(os, "fdatasync", os.fsync)(descriptor)  # macOS has only the latter


def free_bytes(folder: Path, descriptor: int | None = None) -> int:
    """Free for this user on the disk of a folder, or of an open file."""
    disk = os.statvfs(folder) if descriptor is None else os.fstatvfs(descriptor)
    return disk.f_bavail * disk.f_frsize


def raise_files_limit() -> None:
    """Takes as many open files and connections as the system allows at most: the usual
    limit of 1,024 is for programs that use select().
    """
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))


def cpu_seconds() -> float:
    """The CPU seconds that this process has used."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def is_administrator() -> bool:
    return os.geteuid() == 0


def on_signals(stop: Callable[[], None], reload: Callable[[], None]) -> None:
    """Has the running loop call these when the process is told to end or to read its
    settings again.
    """
    import asyncio

    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop)
    loop.add_signal_handler(signal.SIGHUP, reload)


@contextlib.contextmanager
def keys_of(source: TextIO) -> Iterator[int | None]:
    """The descriptor of a keyboard that passes each key on at once. None if `source` is
    not a terminal.
    """
    if not source.isatty():
        yield None
        return
    descriptor = source.fileno()
    before = termios.tcgetattr(descriptor)
    try:
        tty.setcbreak(descriptor)
        yield descriptor
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)


def read_keys(keyboard: int) -> str | None:
    """The keys that were pressed; None if the terminal was closed."""
    if not select.select([keyboard], [], [], 0)[0]:
        return ""
    return os.read(keyboard, 64).decode(errors="replace") or None


def make_ours(port: serial.Serial) -> None:
    """Sets what pyserial sets otherwise; to be called after each of its changes.
    OSError if the port has vanished.
    """
    try:
        attributes = termios.tcgetattr(port.fileno())
        # A board resets when DTR goes active, which the kernel does at opening unless
        # DTR is active still: keep it active when the port is closed.
        attributes[_CFLAG] &= ~termios.HUPCL
        # An empty read then means a hang-up, and never "no bytes yet".
        attributes[_CC][termios.VMIN] = 1
        termios.tcsetattr(port.fileno(), termios.TCSANOW, attributes)
    except termios.error as error:
        raise OSError(*error.args) from error


def keep_others_out(port: serial.Serial, name: str) -> None:
    """Programs that ignore the lock (flock) that pyserial has set get an error
    instead of some of our bytes. Of a port, until it is closed; a pty would keep it.
    """
    if not os.path.realpath(name).startswith("/dev/pts/"):
        with contextlib.suppress(OSError):
            fcntl.ioctl(port.fileno(), termios.TIOCEXCL)


def drop_unsent(port: serial.Serial) -> None:
    """Unsent bytes would make close() wait for the kernel's 30 s. On a port that is
    gone this fails, and need not succeed.
    """
    with contextlib.suppress(termios.error):
        termios.tcflush(port.fileno(), termios.TCOFLUSH)


class LoopWatch:
    """Calls back in the running loop with bytes of an open port, as they come, and the
    time of a clock then; and once when the port has hung up.
    """

    def __init__(
        self,
        port: serial.Serial,
        clock_ns: Callable[[], int],
        on_data: Callable[[bytes, int], None],
        on_end: Callable[[], None],
    ) -> None:
        import asyncio

        self._descriptor = port.fileno()
        self._clock_ns = clock_ns
        self._on_data = on_data
        self._on_end = on_end
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._descriptor, self.read)

    def read(self) -> None:
        """Reads what is there."""
        try:
            # os.read would release the GIL, and a busy sink's thread would keep it for
            # longer than the time between two reads of many ports.
            data = read_some(self._descriptor)
        except OSError:
            data = b""  # a pty whose other end closed says EIO, a USB port ENXIO
        if data is None:
            return
        if data:
            self._on_data(data, self._clock_ns())
        else:
            self._on_end()

    def write(self, data: bytes, on_room: Callable[[], None]) -> int:
        """Writes as much as the port takes at once, and returns how many bytes; if some
        are left, `on_room` is called when there is room. OSError if the port is gone.
        """
        try:
            written = os.write(self._descriptor, data) if data else 0
        except BlockingIOError:
            written = 0
        if written < len(data):
            self._loop.add_writer(self._descriptor, on_room)
        else:
            self._loop.remove_writer(self._descriptor)
        return written

    def end(self) -> None:
        """Ends before the port is closed."""
        self._loop.remove_reader(self._descriptor)
        self._loop.remove_writer(self._descriptor)


SerialWatch = LoopWatch
