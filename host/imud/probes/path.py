# SPDX-License-Identifier: MIT
"""The path that the strokes of a probe add up to. Where it has returned to its origin,
what its end is off is spread evenly over its strokes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

SIGMAS = 1.96  # 95 % of errors are within

# A path continues where it ended, but for rounding; elsewhere it has another origin.
SAME_M = 1e-4
NEW_ORIGIN = ("tared", "restarted")  # events

Published = Mapping[str, Any]


def _apart(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [one - other for one, other in zip(a, b, strict=True)]


class StrokePath:
    """The strokes of one probe since its origin. Its places, m, are those of the tip,
    or of the sensor where the tip is not known.
    """

    def __init__(self) -> None:
        self.places: list[list[float]] = []  # at the end of each stroke
        self.sigma_m: list[float] = []  # of the last one
        self.is_moving = False  # a stroke is under way
        self._sensor: list[float] = []
        self._since_us: int | None = None  # from when on a pose has the last place

    def add(self, record: Published) -> bool:
        """A stroke, or an event, as published. Whether the path ended or began."""
        if record["type"] == "stroke":
            return self.add_stroke(record)
        if record["event"] in NEW_ORIGIN:
            self._clear()
            return True
        return False

    def add_stroke(self, stroke: Published) -> bool:
        """A stroke as published. One without length ends the path, and one from another
        place begins another. Whether the path ended or began.
        """
        self.is_moving = stroke["end"] == "running"
        if self.is_moving:
            return False
        way, sensor = stroke["displacement_m"], stroke["path_m"]
        if way is None or sensor is None:
            self._clear()
            return True
        if self.places and math.hypot(*_apart(_apart(sensor, way), self._sensor)) > (
            SAME_M
        ):
            self._clear()
        self.places.append(list(sensor))
        self.sigma_m = list(stroke["path_sigma_m"])
        self._sensor = list(sensor)
        self._since_us = stroke["t_device_us"]
        return len(self.places) == 1

    def add_pose(self, pose: Published) -> bool:
        """A pose as published: the first one after a stroke tells where the tip is.
        Whether it is that one.
        """
        if self._since_us is None or pose["t_device_us"] < self._since_us:
            return False
        self._since_us = None
        if not self.places or pose["position_m"] is None:
            return False
        self.places[-1] = list(pose["position_m"])
        return True

    def closed(self) -> list[list[float]]:
        """The places, if the path has returned to its origin with the last stroke."""
        shares = (number / len(self.places) for number in count(1))
        return [
            _apart(place, [share * off for off in self.places[-1]])
            for place, share in zip(self.places, shares, strict=False)
        ]

    def closing(self) -> dict[str, Any] | None:
        """The path as one that has returned: how far its end is off, m, whether the
        strokes' errors explain that on each axis (95 %), its places as measured and
        closed. None: there is no path.
        """
        if not self.places:
            return None
        off = self.places[-1]
        pairs = zip(off, self.sigma_m, strict=True)
        return {
            "strokes": len(self.places),
            "off_m": off,
            "off_sigma_m": self.sigma_m,
            "is_explained": all(abs(part) <= SIGMAS * each for part, each in pairs),
            "path_m": list(self.places),
            "closed_m": self.closed(),
        }

    def _clear(self) -> None:
        self.places.clear()
        self._since_us = None
