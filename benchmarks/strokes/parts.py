# SPDX-License-Identifier: MIT
"""The parts that benchmarks/kept.py keeps of the results of strokes."""

from __future__ import annotations

from benchmarks.common.whole import Results, demand, named, without_colons


def by_case(found: Results) -> Results:
    """The rows by their names."""
    return {
        row["case"]: {name: each for name, each in row.items() if name != "case"}
        for row in found["rows"]
    }


def strokes(found: Results) -> Results:
    """Of on_host.py: each case and path, with at least 30 runs of each."""
    demand(found["set"] == "judging", f"--set {found['set']}")
    cases = by_case(found)
    demand(len(cases) >= 21, f"{len(cases)} cases")
    fewest = min(each["strokes"] for each in cases.values())
    demand(fewest >= 120, f"{fewest} strokes a case")
    return {
        "cases": cases,
        "paths": found["paths"],
        "figures": without_colons(named(found["figures"])),
    }


def image(found: Results) -> Results:
    """Of on_board.py: each case, its worst samples, and what strokes cost."""
    cases = by_case(found)
    demand(found["runs"] >= 2, f"{found['runs']} runs a case")
    demand(len(cases) >= 5, f"{len(cases)} cases")
    return {
        "cases": cases,
        "cycles_worst": {
            name: max(each[name] for each in cases.values())
            for name in ("cycles_worst", "cycles_worst_tip")
        },
        "other_bits": found["other_bits"],
        "costs": found["costs"],
    }


def compared(found: Results) -> Results:
    """Of thesis.py: errors of both methods, and its Table II."""
    demand(found["runs"] >= 30, f"{found['runs']} runs a case")
    demand(len(found["cases"]) >= 5, "some cases")
    return {name: found[name] for name in ("cases", "lengths_cm", "errors_cm")}
