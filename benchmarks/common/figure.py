# SPDX-License-Identifier: MIT
"""Figures that must be reached, and the seeds that they are judged on."""

from __future__ import annotations

import math
from dataclasses import dataclass

# Seeds: these, and every second one. Those for tuning were looked at while a method was
# made, those for judging were not.
SETS = {"tuning": 0, "judging": 1}


@dataclass(frozen=True, slots=True)
class Figure:
    """A figure that the project must reach."""

    name: str
    value: float
    must: tuple[float, float]
    goal: tuple[float, float]
    detail: str = ""

    @property
    def verdict(self) -> str:
        low, high = self.goal
        if low <= self.value <= high:
            return "goal"
        low, high = self.must
        return "must" if low <= self.value <= high else "MISSED"

    def __str__(self) -> str:
        return (
            f"{self.name:54}{self.value:8.2f}  {_range(self.must):>12}"
            f"{_range(self.goal):>12}  {self.verdict:7} {self.detail}"
        ).rstrip()


def _range(limits: tuple[float, float]) -> str:
    low, high = limits
    if high == math.inf:
        return ""
    return f"{low:g}-{high:g}" if low else f"{high:g}"


def ratio(name: str, ours: float, other: float, must: float, goal: float) -> Figure:
    """Our score divided by another engine's."""
    detail = f"{ours:.2f} / {other:.2f}"
    return Figure(name, ours / other, (0.0, must), (0.0, goal), detail)


def degrees(name: str, ours: float, must: float, goal: float) -> Figure:
    """Our error, degrees."""
    return Figure(name, ours, (0.0, must), (0.0, goal))
