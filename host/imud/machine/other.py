# SPDX-License-Identifier: MIT
"""Systems without POSIX's modules, as Windows: the same functions as posix.py, whose
texts say what they do. No machine of ours has run it; tests run it on Linux.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import IO, Any, TextIO

import serial

try:
    import msvcrt
except ImportError:
    msvcrt = None  # type: ignore[assignment]

PORT_ERRORS = (OSError, ValueError)
# subprocess: "pass_fds: POSIX only".
HANDS_ON_SOCKETS = False

host_clock_ns = time.perf_counter_ns  # counts sleep, and does not tell it apart


def slept_ns() -> int:
    return 0


READ_S = 0.02  # how long a thread waits for bytes before it looks whether to end
WRITE_S = 0.2


def try_lock(file: IO[Any], *, is_shared: bool = False) -> bool:  # noqa: ARG001
    """Nothing is locked: a lock of Windows would keep readers from the bytes."""
    return True


def shorten_pipe(pipe: IO[Any]) -> None:
    """Its length can't be changed here."""


def sync(descriptor: int) -> None:
    os.fsync(descriptor)


def free_bytes(folder: Path, descriptor: int | None = None) -> int:  # noqa: ARG001
    return shutil.disk_usage(folder).free


def raise_files_limit() -> None:
    """Sockets are not limited so."""


def cpu_seconds() -> float:
    return time.process_time()


def is_administrator() -> bool:
    return False


def on_signals(stop: Callable[[], None], reload: Callable[[], None]) -> None:  # noqa: ARG001
    """There is no signal to read settings again."""
    loop = asyncio.get_running_loop()

    def end(_number: int, _frame: FrameType | None) -> None:
        loop.call_soon_threadsafe(stop)

    names = ("SIGTERM", "SIGINT", "SIGBREAK")
    for name in names:
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), end)


@contextlib.contextmanager
def keys_of(source: TextIO) -> Iterator[int | None]:
    yield 0 if msvcrt is not None and source.isatty() else None


def read_keys(keyboard: int) -> str | None:  # noqa: ARG001
    keys = ""
    while msvcrt is not None and msvcrt.kbhit():  # type: ignore[attr-defined]
        keys += msvcrt.getwch()  # type: ignore[attr-defined]
    return keys


def make_ours(port: serial.Serial) -> None:
    """pyserial's own settings do."""


def keep_others_out(port: serial.Serial, name: str) -> None:
    """A port of Windows is always its opener's alone."""


def drop_unsent(port: serial.Serial) -> None:
    with contextlib.suppress(OSError, serial.SerialException):
        port.reset_output_buffer()


class ThreadWatch:
    """As in posix.py, by a thread that reads: no loop can wait for such a port."""

    def __init__(
        self,
        port: serial.Serial,
        clock_ns: Callable[[], int],
        on_data: Callable[[bytes, int], None],
        on_end: Callable[[], None],
    ) -> None:
        self._port = port
        self._clock_ns = clock_ns
        self._on_data = on_data
        self._on_end = on_end
        self._loop = asyncio.get_running_loop()
        self._has_ended = threading.Event()
        port.timeout, port.write_timeout = READ_S, WRITE_S
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._has_ended.is_set():
            try:
                data = self._port.read(max(1, self._port.in_waiting))
            except (OSError, TypeError, serial.SerialException):
                self._tell(self._on_end)
                return
            if data:
                self._tell(self._on_data, data, self._clock_ns())

    def _tell(self, call: Callable[..., None], *arguments: object) -> None:
        def run() -> None:
            if not self._has_ended.is_set():
                call(*arguments)

        with contextlib.suppress(RuntimeError):  # the loop has ended
            self._loop.call_soon_threadsafe(run)

    def read(self) -> None:
        """The thread does."""

    def write(self, data: bytes, on_room: Callable[[], None]) -> int:
        try:
            written = self._port.write(data) or 0
        except serial.SerialTimeoutException:
            written = 0
        if written < len(data):
            self._loop.call_later(WRITE_S, on_room)
        return written

    def end(self) -> None:
        self._has_ended.set()
        if threading.current_thread() is not self._thread:
            self._thread.join(10 * READ_S)


SerialWatch = ThreadWatch
