# SPDX-License-Identifier: MIT
"""A closed path as `imud strokes --close` prints it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from imud.probes.path import SIGMAS


def _row(place: Sequence[float]) -> str:
    return " ".join(f"{100 * each:8.2f}" for each in place)


def lines_of(probe: str, closing: Mapping[str, Any]) -> list[str]:
    """The path as measured and closed, cm, and how far its end is off."""
    off, sigma, number = closing["off_m"], closing["off_sigma_m"], closing["strokes"]
    verdict = "within" if closing["is_explained"] else "more than"
    places = zip(closing["path_m"], closing["closed_m"], strict=True)
    return [
        f"{probe}: {number} strokes end {100 * math.hypot(*off):.2f} cm from their "
        "origin:",
        f"  {_row(off)}  cm east, north, up; {verdict} the range of their errors:",
        f"  {_row([SIGMAS * each for each in sigma])}  (95 %)",
        f"{'stroke':>6}  {'measured (cm)':<26}  closed (cm)",
        *(
            f"{at:>6}  {_row(measured)}  {_row(closed)}"
            for at, (measured, closed) in enumerate(places, 1)
        ),
    ]
