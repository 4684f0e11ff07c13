# SPDX-License-Identifier: MIT
"""A path of strokes that has returned to its origin: what its end is off is spread
evenly over its strokes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

# A path goes on where it ended, but for rounding; elsewhere it has another origin.
SAME_M = 1e-4
SIGMAS = 1.96  # 95 % of errors are within


def _apart(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [one - other for one, other in zip(a, b, strict=True)]


class Path:
    """The strokes of one probe since its origin. Its places, m, are those of the tip,
    or of the sensor where the tip is not known.
    """

    def __init__(self) -> None:
        self.places: list[list[float]] = []  # at the end of each stroke
        self.sigma_m: list[float] = []  # of the last one
        self._sensor: list[float] = []
        self._since_us: int | None = None  # from when on a pose has the last place

    def take_stroke(self, stroke: Mapping[str, Any]) -> None:
        """A stroke as published. One without length ends the path."""
        if stroke["end"] == "running":
            return
        way, sensor = stroke["displacement_m"], stroke["path_m"]
        if way is None or sensor is None:
            self.places.clear()
            return
        if self.places and math.hypot(*_apart(_apart(sensor, way), self._sensor)) > (
            SAME_M
        ):
            self.places.clear()
        self.places.append(list(sensor))
        self.sigma_m = list(stroke["path_sigma_m"])
        self._sensor = list(sensor)
        self._since_us = stroke["t_device_us"]

    def take_pose(self, pose: Mapping[str, Any]) -> None:
        """A pose as published: the first one after a stroke tells where the tip is."""
        if self._since_us is None or pose["t_device_us"] < self._since_us:
            return
        self._since_us = None
        if self.places and pose["position_m"] is not None:
            self.places[-1] = list(pose["position_m"])

    def closed(self) -> list[list[float]]:
        """The places, if the path has returned to its origin with the last stroke."""
        shares = (number / len(self.places) for number in count(1))
        return [
            _apart(place, [share * off for off in self.places[-1]])
            for place, share in zip(self.places, shares, strict=False)
        ]


def object_of(probe: str, path: Path) -> dict[str, Any]:
    """What `imud strokes --close --json` prints."""
    return {
        "probe": probe,
        "strokes": len(path.places),
        "off_m": path.places[-1],
        "off_sigma_m": path.sigma_m,
        "path_m": path.places,
        "closed_m": path.closed(),
    }


def _row(place: Sequence[float]) -> str:
    return " ".join(f"{100 * each:8.2f}" for each in place)


def lines_of(probe: str, path: Path) -> list[str]:
    """The path as measured and closed, cm, and how far its end is off."""
    end, sigma, number = path.places[-1], path.sigma_m, len(path.places)
    off = math.hypot(*end)
    is_inside = all(
        abs(part) <= SIGMAS * each for part, each in zip(end, sigma, strict=True)
    )
    verdict = "within" if is_inside else "more than"
    return [
        f"{probe}: {number} strokes end {100 * off:.2f} cm from their origin:",
        f"  {_row(end)}  cm east, north, up; {verdict} what their errors explain:",
        f"  {_row([SIGMAS * each for each in sigma])}  (95 %)",
        f"{'stroke':>6}  {'measured (cm)':<26}  closed (cm)",
        *(
            f"{at:>6}  {_row(measured)}  {_row(closed)}"
            for at, (measured, closed) in enumerate(
                zip(path.places, path.closed(), strict=True), 1
            )
        ),
    ]
