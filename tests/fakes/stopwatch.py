# SPDX-License-Identifier: MIT
"""Measures what must happen within a time, on a busy machine, too."""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path

PROC = Path("/proc")


class Stopwatch:
    """The seconds since it was made, without those that this thread, or threads of the
    given processes, were ready to run in and had no processor
    (/proc/PID/task/TID/schedstat of Linux).
    """

    def __init__(self, *pids: int) -> None:
        self._threads = [f"self/task/{threading.get_native_id()}"]
        self._threads += [f"{pid}/task/*" for pid in pids]
        self._first_ns: dict[Path, int] = {}
        self._last_ns: dict[Path, int] = {}
        self._begin_s = time.monotonic()
        self.look()

    def look(self) -> float:
        """The seconds so far. What a thread has waited is known while it lives."""
        for each in self._threads:
            with contextlib.suppress(OSError):  # it may end while it is looked at
                for path in PROC.glob(f"{each}/schedstat"):
                    self._note(path)
        waited_ns = sum(self._last_ns.values()) - sum(self._first_ns.values())
        return time.monotonic() - self._begin_s - waited_ns / 1e9

    def _note(self, path: Path) -> None:
        with contextlib.suppress(OSError):
            _, waited_ns, _ = map(int, path.read_text().split())
            self._first_ns.setdefault(path, waited_ns)
            self._last_ns[path] = waited_ns
