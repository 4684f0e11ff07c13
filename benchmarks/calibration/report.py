# SPDX-License-Identifier: MIT
"""The results of benchmarks/calibration/modules.py: tables and the required figures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.calibration import rough, shop_trials
from benchmarks.common.figure import Figure
from imud.calibration.papers.methods import METHODS

GUIDED = "as the procedure guides"  # the case with the strictest requirements
KEYS = ("tilt", "heading", "scale", "cross", "own", "stated_tilt", "stated")
MORE = 3  # requested poses: most hands need no more


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
    found = of_cases(results)
    if results.crowd:
        found += of_crowd(results.crowd)
    if results.shops:
        found += shop_trials.figures(results.shops)
    if results.rough:
        found += rough.figures(results.rough)
    return found


def of_cases(results: Results) -> list[Figure]:
    """Those of single cases, and the time of a fit."""
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
    if math.isfinite(results.fit_s):
        found.append(Figure("fit of 12 poses, s", results.fit_s, (0, 0.3), (0, 0.1)))
    return found


def is_good(row: dict[str, Any]) -> bool:
    """Whether a recording gives a calibration that may be accepted."""
    tilt, heading = row.get("tilt", math.inf), row.get("heading", math.inf)
    return bool(tilt <= 0.5 and heading <= 3.0)


def as_asked(rows: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """The recordings after the poses that the guide asks for."""
    return [{**row, **row["asked"]} if "asked" in row else row for row in rows]


def verdicts(
    rows: Sequence[dict[str, Any]], last: Sequence[dict[str, Any]]
) -> dict[str, int]:
    """The numbers of right and wrong verdicts on the last state of recordings."""
    accepted = [row for row in last if row["refused"] is None]
    good = [now for row, now in zip(rows, last, strict=True) if is_good(row)]
    return {
        "accepted": len(accepted),
        "accepted_bad": sum(not is_good(row) for row in accepted),
        "good": len(good),
        "good_refused": sum(row["refused"] is not None for row in good),
    }


def of_crowd(rows: Sequence[dict[str, Any]]) -> list[Figure]:
    """How often the verdict is wrong: of the recordings as they are, and where a hand
    that lacks poses lays those that the guide asks for.
    """
    found = []
    # Users who follow the guide may rarely be refused; recordings as they are come from
    # users of all kinds.
    as_they_are = (rows, "", (0.0, 35.0), (0.0, 15.0))
    for last, words, must, goal in (
        as_they_are,
        (as_asked(rows), ", asked for poses", (0.0, 15.0), (0.0, 8.0)),
    ):
        of = verdicts(rows, last)
        wrong = of["accepted_bad"] / max(of["accepted"], 1)
        lost = of["good_refused"] / max(of["good"], 1)
        counts = f"{of['accepted']} accepted, {of['good']} good of {len(rows)}"
        name = f"accepted and bad{words}, %"
        found += [
            Figure(name, 100.0 * wrong, (0.0, 0.5), (0.0, 0.2), counts),
            Figure(f"good and refused{words}, %", 100.0 * lost, must, goal),
        ]
    return found


def values(found: Iterable[Figure]) -> dict[str, float | None]:
    """By name; an infinite one has none in JSON."""
    return {each.name: finite(each.value) for each in found}


def finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def line_of(rows: Sequence[dict[str, Any]], keys: Iterable[str]) -> dict[str, Any]:
    """Median and 95th percentile of each key that a row has."""
    return {
        key: {
            "median": finite(percentile(rows, key, 50)),
            "p95": finite(percentile(rows, key, 95)),
        }
        for key in keys
        if any(key in row for row in rows)
    }


def parts_of(results: Results) -> dict[str, dict[str, Any]]:
    """What documents cite of each part that was measured, and its rows."""
    parts: dict[str, dict[str, Any]] = {}
    if results.cases:
        methods = {
            method: [row[method] for row in results.methods if method in row]
            for method in ("none", "guided", *METHODS)
        }
        parts["cases"] = {
            "modules": len(results.cases.get(GUIDED, ())),
            "seconds": float(np.median([r["seconds"] for r in results.cases[GUIDED]])),
            "cases": {
                name: line_of(rows, (*KEYS, "housing"))
                for name, rows in results.cases.items()
            },
            "methods": {
                name: line_of(rows, ("tilt", "heading"))
                for name, rows in methods.items()
                if rows
            },
            "figures": values(of_cases(results)),
            "rows": results.cases,
        }
    if results.crowd:
        last = as_asked(results.crowd)
        asked = [row["asked"] for row in results.crowd if "asked" in row]
        helped = [row for row in asked if row["refused"] is None]
        parts["crowd"] = {
            "recordings": len(results.crowd),
            "as they are": verdicts(results.crowd, results.crowd),
            "asked for poses": verdicts(results.crowd, last),
            "lacked": len(asked),
            "lacked_accepted": len(helped),
            "lacked_accepted_soon": sum(row["more"] <= MORE for row in helped),
            "figures": values(of_crowd(results.crowd)),
            "rows": results.crowd,
        }
    if results.shops:
        parts["shops"] = {
            "modules": len({row["seed"] for row in results.shops}),
            "recordings": len({row["trial"] for row in results.shops}),
            "figures": values(shop_trials.figures(results.shops)),
            "rows": results.shops,
        }
    if results.rough:
        others = [row for row in results.rough if not row["is_usual"]]
        parts["rough"] = {
            "modules": len(results.rough),
            "proposals": sum(len(row["proposals"]) for row in results.rough),
            "usual": len(results.rough) - len(others),
            "others": len(others),
            "others_proposed": sum(bool(row["proposals"]) for row in others),
            "figures": values(rough.figures(results.rough)),
            "rows": results.rough,
        }
    return parts


def show(results: Results) -> None:
    """Prints the tables: median and 95th percentile."""
    print(f"{'':32}" + "".join(f"{key:>16}" for key in KEYS) + f"{'s':>6}")
    for name, rows in results.cases.items():
        cells = "".join(
            f"{percentile(rows, key, 50):9.3f}{percentile(rows, key, 95):7.3f}"
            for key in KEYS
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
