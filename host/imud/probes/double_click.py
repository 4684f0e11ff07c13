# SPDX-License-Identifier: MIT
"""A double click of a probe's button closes the path of its strokes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from imud.probes.path import StrokePath

DOUBLE_US = 500_000  # between two presses

Published = Mapping[str, Any]


class PathCloser:
    """Keeps the path of one probe. A click may start the stream, which may set another
    origin: a double click closes the path of before its first press.
    """

    def __init__(self) -> None:
        self._path = StrokePath()
        self._pressed_us: int | None = None  # none if a stroke has come since
        self._at_press: dict[str, Any] | None = None

    def closing(self) -> dict[str, Any] | None:
        """The path now, as StrokePath.closing() has it."""
        return self._path.closing()

    @property
    def sigma_m(self) -> list[float]:
        """One-sigma errors of the path's end; empty without strokes."""
        return self._path.sigma_m if self._path.places else []

    def on_record(self, record: Published) -> dict[str, Any] | None:
        """A pose, stroke or event as published. The path, if this closes it."""
        if record["type"] == "pose":
            self._path.add_pose(record)
        elif record["type"] == "stroke":
            self._pressed_us = None
            self._path.add(record)
        elif record["type"] == "event":
            self._path.add(record)
            if record["event"] == "button_pressed":
                return self._press(record["t_device_us"])
        return None

    def _press(self, t_us: int) -> dict[str, Any] | None:
        before_us, self._pressed_us = self._pressed_us, t_us
        if before_us is not None and 0 < t_us - before_us <= DOUBLE_US:
            self._pressed_us = None
            return self._at_press
        self._at_press = self._path.closing()
        return None
