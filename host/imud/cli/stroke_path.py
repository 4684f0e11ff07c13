# SPDX-License-Identifier: MIT
"""A closed path as `imud strokes --close` prints it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from imud.probes.path import Path

SIGMAS = 1.96  # 95 % of errors are within


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
