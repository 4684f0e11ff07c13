# SPDX-License-Identifier: MIT
"""Gestures of a probe's button, by the device's times of its presses and releases, and
the path of its strokes, which one of them closes.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from imud.probes.path import StrokePath

DOUBLE_US = 500_000  # between two presses

# A message from before may come this much later than one from after it.
LATE_US = 50_000
# How long it is held, from and to: between them the hand had no clear intention, and
# later it lies upon the button.
HELD = {"hold": (1_000_000, 3_000_000), "long": (3_000_000, 10_000_000)}
PRESSED = "button_pressed"
EVENTS = (PRESSED, "button_released")


class Gestures:
    """Those of one probe since it was found."""

    def __init__(self) -> None:
        self._pressed_us: int | None = None  # none: its release means nothing
        self.clicked_us: int | None = None  # pressed then; a second one may follow

    def look(self, t_us: int) -> str | None:
        """A click, once anything of later than a second press has come."""
        begin_us = self.clicked_us
        if begin_us is None or t_us - begin_us <= DOUBLE_US + LATE_US:
            return None
        self.clicked_us = None
        return "click"

    def forget_click(self) -> None:
        """A stroke has come: that press was no click, or jolted the probe."""
        self.clicked_us = None

    def on_event(self, name: str, t_us: int, *, is_after_gap: bool) -> str | None:
        """The gesture that a press or release completes: `double`, `hold` or `long`.
        `is_after_gap`: messages before it were lost, which may have been others.
        """
        if is_after_gap:
            self._pressed_us = self.clicked_us = None
        if name == PRESSED:
            before_us, self.clicked_us = self.clicked_us, None
            is_double = before_us is not None and t_us - before_us <= DOUBLE_US
            self._pressed_us = None if is_double else t_us
            return "double" if is_double else None
        begin_us, self._pressed_us = self._pressed_us, None
        if begin_us is None:
            return None
        held_us = t_us - begin_us
        if 0 < held_us <= DOUBLE_US:
            self.clicked_us = begin_us
        found = (name for name, (a, b) in HELD.items() if a <= held_us < b)
        return next(found, None)


class PathCloser:
    """Keeps the path of one probe. A click may start the stream, which may set another
    origin: a double click closes the path of before its first press.
    """

    def __init__(self) -> None:
        self._path = StrokePath()
        self._at_presses = StrokePath(), StrokePath()

    def closing(
        self, scale: float, return_m: float, *, is_double: bool = False
    ) -> dict[str, Any] | None:
        """The path now, or of before the last press but one, as StrokePath has it."""
        path = self._at_presses[0] if is_double else self._path
        return path.closing(scale, return_m)

    @property
    def sigma_m(self) -> list[float]:
        """One-sigma errors of the path's end; empty without strokes."""
        return self._path.sigma_m if self._path.places else []

    def on_record(self, record: Mapping[str, Any]) -> None:
        """A pose, stroke or event as published."""
        if record["type"] == "pose":
            self._path.add_pose(record)
        elif record["type"] in ("stroke", "event"):
            self._path.add(record)
            if record.get("event") == PRESSED:
                self._at_presses = self._at_presses[1], copy.deepcopy(self._path)
