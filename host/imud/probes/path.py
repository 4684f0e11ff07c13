# SPDX-License-Identifier: MIT
"""The path that the strokes of a probe add up to. Where it has returned to its origin,
what its end is off is spread evenly over its strokes: of a way there and back each
stroke's error counts by half.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import count
from typing import Any

from imud.gravity import GRAVITY_M_S2
from imud.wire.params import parts_of

SIGMAS = 1.96  # 95 % of errors are within
RAW_ACC_M_S2 = 0.2  # of an accelerometer that is not calibrated: stroke_way.c
REFUSED_SIGMAS = 3.0  # a path whose end is farther off has not returned, or is wrong

# A path continues where it ended, but for rounding; elsewhere it has another origin.
SAME_M = 1e-4
NEW_ORIGIN = ("tared", "restarted")  # events

Published = Mapping[str, Any]


def _apart(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [one - other for one, other in zip(a, b, strict=True)]


def scale_sigma(params: bytes | None) -> float:
    """One-sigma error of the scale of strokes, a share, by a probe's params."""
    sigma = parts_of(params or b"").get("acc", {}).get("sigma")
    return (sigma if isinstance(sigma, float) else RAW_ACC_M_S2) / GRAVITY_M_S2


class StrokePath:
    """The strokes of one probe since its origin. Its places, m, are those of the tip,
    or of the sensor where the tip is not known.
    """

    def __init__(self) -> None:
        self.places: list[list[float]] = []  # at the end of each stroke
        self.sigma_m: list[float] = []  # of the last one
        self._variances: list[list[float]] = []  # of each stroke, m2
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
        self._variances.append([each**2 for each in stroke["displacement_sigma_m"]])
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

    def closed_sigma(self, scale: float, return_m: float) -> list[list[float]]:
        """One-sigma errors of the closed places, m, an axis each: of the strokes before
        and after a place by what closing leaves of them, of the return, and of the
        accelerometer's `scale`, a share, which closing does not show.
        """
        found = []
        for number, place in enumerate(self.closed(), 1):
            share = number / len(self.places)
            variances = [
                (1.0 - share) ** 2 * sum(each[:number])
                + share**2 * (sum(each[number:]) + return_m**2)
                for each in zip(*self._variances, strict=True)
            ]
            length = scale * math.hypot(*place)
            found.append([math.sqrt(each + length**2) for each in variances])
        return found

    def closing(self, scale: float, return_m: float) -> dict[str, Any] | None:
        """The path as one that has returned: how far its end is off, m, whether the
        strokes' errors and that of the return explain it on each axis (95 %), its
        places as measured, and closed with their errors, unless the end is too far off.
        None: there is no path.
        """
        if not self.places:
            return None
        off = self.places[-1]
        sigma = [math.hypot(each, return_m) for each in self.sigma_m]
        most = max(abs(part) / each for part, each in zip(off, sigma, strict=True))
        is_refused = most > REFUSED_SIGMAS
        return {
            "strokes": len(self.places),
            "off_m": off,
            "off_sigma_m": sigma,
            "is_explained": most <= SIGMAS,
            "path_m": list(self.places),
            "closed_m": None if is_refused else self.closed(),
            "closed_sigma_m": (
                None if is_refused else self.closed_sigma(scale, return_m)
            ),
        }

    def _clear(self) -> None:
        self.places.clear()
        self._variances.clear()
        self._since_us = None
