# SPDX-License-Identifier: MIT
"""A double click of a probe's button closes the path of its strokes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imud.probes.path import Path

DOUBLE_US = 500_000  # between two presses

Said = Mapping[str, Any]


class PathCloser:
    """Keeps the path of one probe. A click may start the stream, which may set another
    origin: a double click closes the path of before its first press.
    """

    def __init__(self) -> None:
        self._path = Path()
        self._pressed_us: int | None = None  # none if a stroke has come since
        self._at_press: dict[str, Any] | None = None

    def closing(self) -> dict[str, Any] | None:
        """The path now, as Path.closing() has it."""
        return self._path.closing()

    def take(self, said: Said) -> dict[str, Any] | None:
        """A pose, stroke or event as published. The path, if this closes it."""
        if said["type"] == "pose":
            self._path.take_pose(said)
        elif said["type"] == "stroke":
            self._pressed_us = None
            self._path.take(said)
        elif said["type"] == "event":
            self._path.take(said)
            if said["event"] == "button_pressed":
                return self._press(said["t_device_us"])
        return None

    def _press(self, t_us: int) -> dict[str, Any] | None:
        before_us, self._pressed_us = self._pressed_us, t_us
        if before_us is not None and 0 < t_us - before_us <= DOUBLE_US:
            self._pressed_us = None
            return self._at_press
        self._at_press = self._path.closing()
        return None
