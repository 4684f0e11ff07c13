# SPDX-License-Identifier: MIT
"""One line that shows how far a long job is, on a terminal and nowhere else."""

from __future__ import annotations

import sys
import threading
import time
from typing import TextIO

_WIDTH = 40  # cells of the bar: with label and figures it fits 80 columns
_PERIOD_S = 0.1  # between two pictures, as fast as an eye follows


class Progress:
    """A bar that redraws itself in place; any thread may call it."""

    def __init__(self, label: str, total: float, file: TextIO | None = None) -> None:
        self._file = sys.stderr if file is None else file
        self._label = label
        self._total = total
        self._done = 0.0
        self._drawn_s = float("-inf")
        self._is_shown = self._file.isatty()
        self._lock = threading.Lock()

    def update(self, done: float) -> None:
        """So much of the total is done."""
        with self._lock:
            self._done = done
            now = time.monotonic()
            if self._is_shown and now - self._drawn_s >= _PERIOD_S:
                self._drawn_s = now
                self._draw()

    def advance(self, step: float = 1.0) -> None:
        """So much more is done."""
        self.update(self._done + step)

    def wipe(self) -> None:
        """Makes room for a line; the bar comes back below it."""
        with self._lock:
            self._wipe()
            self._drawn_s = float("-inf")

    def say(self, text: str) -> None:
        """Writes a line above the bar."""
        self.wipe()
        self._file.write(f"{text}\n")
        self._file.flush()

    def end(self) -> None:
        """Takes the bar away."""
        with self._lock:
            self._wipe()
            self._is_shown = False

    def _draw(self) -> None:
        share = min(1.0, self._done / self._total) if self._total > 0 else 1.0
        filled = round(share * _WIDTH)
        bar = "█" * filled + "░" * (_WIDTH - filled)
        self._file.write(f"\r\033[K{self._label} {bar} {share:4.0%}")
        self._file.flush()

    def _wipe(self) -> None:
        if self._is_shown:
            self._file.write("\r\033[K")
            self._file.flush()
