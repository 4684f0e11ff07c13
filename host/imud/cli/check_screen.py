# SPDX-License-Identifier: MIT
"""The display of `imud check`: a screen on a terminal, lines in a pipe."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator
from typing import TextIO

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from imud.cli.keyboard import keys_of, pressed

DRAW_S = 0.1
BAR = 30  # characters


class CheckScreen:
    """show() is for a terminal, line() for a pipe; each does nothing elsewhere."""

    def __init__(self, out: TextIO, title: str) -> None:
        self._console = Console(file=out, highlight=False)
        self._title = title
        self._live: Live | None = None
        self._keyboard: int | None = None
        self._drawn_s = 0.0
        self._lines: set[str] = set()

    @property
    def is_terminal(self) -> bool:
        """Whether a user can answer."""
        return self._live is not None and self._keyboard is not None

    @contextlib.contextmanager
    def opened(self) -> Iterator[None]:
        """While it is open, keys go to it."""
        if not self._console.is_terminal:
            yield
            return
        with (
            keys_of(sys.stdin) as self._keyboard,
            Live(
                Text(""), console=self._console, auto_refresh=False, transient=True
            ) as self._live,
        ):
            yield

    def line(self, words: str) -> None:
        """Once each, in a pipe."""
        if self._live is None and words not in self._lines:
            self._lines.add(words)
            self._console.file.write(f"{words}\n")
            self._console.file.flush()

    def show(self, words: str, share: float | None) -> None:
        """What is going on, and how far."""
        now_s = time.monotonic()
        if self._live is None or now_s - self._drawn_s < DRAW_S:
            return
        self._drawn_s = now_s
        shown = [Text(self._title, style="bold"), Text(words)]
        if share is not None:
            filled = round(BAR * min(1.0, share))
            shown.append(Text("█" * filled + "░" * (BAR - filled), style="cyan"))
        self._live.update(Group(*shown), refresh=True)

    def key(self) -> str:
        """The last key pressed, in lower case; empty if none was. Quit for q."""
        return pressed(self._keyboard)[-1:]
