# SPDX-License-Identifier: MIT
"""The results of benchmarks/calibration/modules.py: tables and the required figures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.calibration import rough, shop_trials
from benchmarks.common.figure import Figure
from imud.calibration.papers.methods import METHODS

GUIDED = "as the procedure guides"  # the case with the strictest requirements


@dataclass(slots=True)
class Results:
    """All results."""

    which: str
    cases: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    crowd: list[dict[str, Any]] = field(default_factory=list)
    methods: list[dict[str, Any]] = field(default_factory=list)
    shops: list[dict[str, Any]] = field(default_factory=list)
    rough: list[dict[str, Any]] = field(default_factory=list)
    fit_s: float = math.nan


def percentile(rows: Sequence[dict[str, Any]], key: str, share: float) -> float:
    """Of the rows that have it; a fit that failed counts as infinite."""
    values = [row.get(key, math.inf) for row in rows]
    if not values:
        return math.nan
    with np.errstate(invalid="ignore"):
        found = float(np.percentile(values, share))
    return math.inf if math.isnan(found) else found  # between two infinite ones


def figures(results: Results) -> list[Figure]:
    """The required figures."""
    found = []
    for case, key, name, must, goal in (
        (GUIDED, "tilt", "tilt, deg, 95th", 0.10, 0.05),
        (GUIDED, "heading", "heading, deg, 95th", 0.4, 0.2),
        ("12, field uneven by 2 uT", "heading", "heading, 2 uT uneven", 1.5, 1.1),
        (GUIDED, "scale", "gyroscope scale, %, 95th", 0.15, 0.07),
        (GUIDED, "housing", "against the housing, 95th", 0.15, 0.07),
    ):
        if case in results.cases:
            value = percentile(results.cases[case], key, 95)
            found.append(Figure(name, value, (0.0, must), (0.0, goal)))
    if results.crowd:
        found += of_crowd(results.crowd)
    if results.shops:
        found += shop_trials.figures(results.shops)
    if results.rough:
        found += rough.figures(results.rough)
    if math.isfinite(results.fit_s):
        found.append(Figure("fit of 12 poses, s", results.fit_s, (0, 0.3), (0, 0.1)))
    return found


def is_good(row: dict[str, Any]) -> bool:
    """Whether a recording gives a calibration that may be accepted."""
    tilt, heading = row.get("tilt", math.inf), row.get("heading", math.inf)
    return bool(tilt <= 0.5 and heading <= 3.0)


def of_crowd(rows: Sequence[dict[str, Any]]) -> list[Figure]:
    """How often the verdict is wrong: of the recordings as they are, and where a hand
    that lacks poses lays those that the guide asks for.
    """
    asked = [{**row, **row["asked"]} if "asked" in row else row for row in rows]
    found = []
    # Users who follow the guide may rarely be refused; recordings as they are come from
    # users of all kinds.
    as_they_are = (rows, "", (0.0, 35.0), (0.0, 15.0))
    for last, words, must, goal in (
        as_they_are,
        (asked, ", asked for poses", (0.0, 15.0), (0.0, 8.0)),
    ):
        accepted = [row for row in last if row["refused"] is None]
        wrong = sum(not is_good(row) for row in accepted) / max(len(accepted), 1)
        good = [now for row, now in zip(rows, last, strict=True) if is_good(row)]
        lost = sum(row["refused"] is not None for row in good) / max(len(good), 1)
        counts = f"{len(accepted)} accepted, {len(good)} good of {len(rows)}"
        name = f"accepted and bad{words}, %"
        found += [
            Figure(name, 100.0 * wrong, (0.0, 0.5), (0.0, 0.2), counts),
            Figure(f"good and refused{words}, %", 100.0 * lost, must, goal),
        ]
    return found


def show(results: Results) -> None:
    """Prints the tables: median and 95th percentile."""
    keys = ("tilt", "heading", "scale", "cross", "own", "stated_tilt", "stated")
    print(f"{'':32}" + "".join(f"{key:>16}" for key in keys) + f"{'s':>6}")
    for name, rows in results.cases.items():
        cells = "".join(
            f"{percentile(rows, key, 50):9.3f}{percentile(rows, key, 95):7.3f}"
            for key in keys
        )
        print(f"{name:32}{cells}{rows[0]['seconds']:6.0f}")
    print()
    for method in ("none", "guided", *METHODS):
        rows = [row[method] for row in results.methods if method in row]
        if not rows:
            continue
        cells = "".join(
            f"{percentile(rows, key, 50):9.3f}{percentile(rows, key, 95):7.3f}"
            if key in rows[0]
            else " " * 16
            for key in ("tilt", "heading")
        )
        print(f"{method:32}{cells}")
    print()
    for figure in figures(results):
        print(figure)
