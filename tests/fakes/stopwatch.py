# SPDX-License-Identifier: MIT
"""Measures what has to happen within a time, on a machine that may be busy."""

from __future__ import annotations

import contextlib
import threading
import time
from pathlib import Path


class Stopwatch:
    """The seconds since it was made, without those that this thread, or threads of the
    given processes, were ready to run in and had no processor
    (/proc/PID/task/TID/schedstat: Documentation/scheduler/sched-stats.rst of Linux).
    """

    def __init__(self, *pids: int) -> None:
        own = Path(f"/proc/thread-self/../{threading.get_native_id()}")
        self._folders = [own, *(Path(f"/proc/{pid}/task") for pid in pids)]
        self._first_ns: dict[Path, int] = {}
        self._last_ns: dict[Path, int] = {}
        self._begin_s = time.monotonic()
        self.look()

    def look(self) -> float:
        """The seconds so far. What a thread has waited is known while it lives."""
        for folder in self._folders:
            for path in (folder / "schedstat", *folder.glob("*/schedstat")):
                with contextlib.suppress(OSError):
                    _, waited_ns, _ = map(int, path.read_text().split())
                    self._first_ns.setdefault(path, waited_ns)
                    self._last_ns[path] = waited_ns
        waited_ns = sum(self._last_ns.values()) - sum(self._first_ns.values())
        return time.monotonic() - self._begin_s - waited_ns / 1e9
