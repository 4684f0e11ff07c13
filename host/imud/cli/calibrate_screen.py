# SPDX-License-Identifier: MIT
"""What `imud calibrate` shows meanwhile: a screen on a terminal, lines in a pipe."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Iterator

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from imud.calibration.guided.events import ProcedureStatus
from imud.calibration.tip.guide import TipStatus
from imud.cli.calibrate_tip_screen import tip_lines
from imud.cli.keyboard import keys_of, pressed

DRAW_S = 0.1
BAR = 20  # characters


def lines(probe: str, status: ProcedureStatus) -> list[Text]:
    """The screen of the guided calibration."""
    head = Text(f"{probe}  ", style="bold")
    head.append(f"pose {status.poses} of {status.of}", style="cyan")
    head.append(f"  {status.seconds:.0f} s", style="dim")
    filled = round(BAR * status.still_share) if status.is_still else 0
    bar = "█" * filled + "░" * (BAR - filled)
    style = "bold green" if status.phase == "done" else "bold"
    return [
        head,
        Text(status.instruction, style=style),
        Text(f"{bar} {'still' if status.is_still else 'moves'}"),
        Text(""),
        _error("tilt   ", status.tilt_deg, is_good=status.is_level),
        _error("heading", status.heading_deg, is_good=status.is_headed),
        Text(""),
        Text(status.trouble or _mounting(status), style="yellow"),
        Text("Enter evaluates now; q stops without changes", style="dim"),
    ]


def _mounting(status: ProcedureStatus) -> str:
    """How the module is mounted, if that is worth a word."""
    if status.mount is None or status.mount.is_plain:
        return ""
    return f"{status.mount.words}; the calibration allows for it"


def _error(what: str, deg: float | None, *, is_good: bool) -> Text:
    if deg is None:
        return Text(f"{what}  not yet", style="dim")
    style = "green" if is_good else "red"
    return Text(f"{what}  +-{deg:.2f} degrees", style=style)


def _drawn(probe: str, status: ProcedureStatus | TipStatus) -> list[Text]:
    if isinstance(status, TipStatus):
        return tip_lines(probe, status)
    return lines(probe, status)


class CalibrationScreen:
    """Shows a status whenever it is due. In a pipe: each new sentence and trouble."""

    def __init__(self, probe: str) -> None:
        self._probe = probe
        self._console = Console(highlight=False)
        self._live: Live | None = None
        self._drawn_s = 0.0
        self._last: tuple[str, str | None] = ("", None)
        self._keyboard: int | None = None

    @contextlib.contextmanager
    def opened(self) -> Iterator[CalibrationScreen]:
        """While it is open, keys go to it."""
        if not self._console.is_terminal:
            yield self
            return
        with keys_of(sys.stdin) as self._keyboard:
            live = Live(Text(""), console=self._console, auto_refresh=False)
            with live as self._live:
                yield self

    def show(self, status: ProcedureStatus | TipStatus) -> None:
        """Shows the guided procedure."""
        if self._live is None:
            self.show_text(status.instruction, status.trouble)
            return
        now_s = time.monotonic()
        if now_s - self._drawn_s >= DRAW_S or status.phase in ("done", "refused"):
            self._drawn_s = now_s
            self._live.update(Group(*_drawn(self._probe, status)), refresh=True)

    def show_text(self, words: str, trouble: str | None = None) -> None:
        """One sentence, if it is another one than before."""
        last, self._last = self._last, (words, trouble)
        if self._live is not None:
            if last != self._last:
                self._live.update(Text(words, style="bold"), refresh=True)
            return
        if trouble is not None and trouble != last[1]:
            sys.stdout.write(f"{trouble}\n")
        if words != last[0]:
            sys.stdout.write(f"{words}\n")
        sys.stdout.flush()

    def is_ended(self) -> bool:
        """Whether Enter was pressed; Quit for q."""
        keys = pressed(self._keyboard)
        return "\n" in keys or "\r" in keys
