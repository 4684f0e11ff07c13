# SPDX-License-Identifier: MIT
"""A progress bar of one line, on a terminal only.

`rich.progress` needs a wrapper of 40 lines for the same calls, and its import takes
60 ms of each command that reads a file.
"""

from __future__ import annotations

import sys
import threading
import time
from typing import TextIO

_WIDTH = 40  # characters: with label and percentage it fits 80 columns
_PERIOD_S = 0.1  # between two drawings: fast enough for the eye


class Progress:
    """A bar on stderr, or `file`, redrawn in place. Any thread may call it.

    `total` is in the unit of update() and advance(): bytes, seconds, files.
    """

    def __init__(self, label: str, total: float, file: TextIO | None = None) -> None:
        self._file = sys.stderr if file is None else file
        self._label = label
        self._total = total
        self._done = 0.0
        self._drawn_s = float("-inf")
        self._is_shown = self._file.isatty()
        self._lock = threading.Lock()

    def update(self, done: float) -> None:
        """Sets how much of the total is done."""
        with self._lock:
            self._done = done
            now = time.monotonic()
            if self._is_shown and now - self._drawn_s >= _PERIOD_S:
                self._drawn_s = now
                self._draw()

    def advance(self, step: float = 1.0) -> None:
        """Adds to what is done."""
        self.update(self._done + step)

    def wipe(self) -> None:
        """Clears the bar, so that a line can be printed; update() draws it below."""
        with self._lock:
            self._wipe()
            self._drawn_s = float("-inf")

    def say(self, text: str) -> None:
        """Writes a line above the bar."""
        self.wipe()
        self._file.write(f"{text}\n")
        self._file.flush()

    def end(self) -> None:
        """Removes the bar permanently."""
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
