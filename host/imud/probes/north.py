# SPDX-License-Identifier: MIT
"""Poses and strokes that refer to true north."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

# Poses with these flags refer to no north.
FREE = {"tared", "heading_free"}

VECTORS = ("position_m", "normal", "displacement_m", "path_m")


class North:
    """Turns described poses from magnetic to true north. `declination_deg`: from true
    to magnetic north, east positive.
    """

    def __init__(self, declination_deg: float) -> None:
        angle = -math.radians(declination_deg)  # about up
        self._half = math.cos(angle / 2.0), math.sin(angle / 2.0)
        self._whole = math.cos(angle), math.sin(angle)

    def turned(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """A pose or stroke as describe() gives it, with east and north of the map."""
        if FREE & set(values["flags"]):
            return dict(values)
        vectors = {key: self._vector(values[key]) for key in VECTORS if key in values}
        if "q" not in values:
            return {**values, **vectors}
        cosine, sine = self._half
        w, x, y, z = values["q"]
        q = (
            cosine * w - sine * z,
            cosine * x - sine * y,
            cosine * y + sine * x,
            cosine * z + sine * w,
        )
        return {**values, "q": q, **vectors}

    def _vector(self, vector: Any) -> Any:
        if vector is None:
            return None
        cosine, sine = self._whole
        east, north, up = vector
        return (cosine * east - sine * north, sine * east + cosine * north, up)
