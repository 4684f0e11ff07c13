# SPDX-License-Identifier: MIT
"""The part that benchmarks/kept.py keeps of the results of wobbles."""

from __future__ import annotations

from collections import Counter

from benchmarks.common.whole import Results, demand, named, without_colons

CROWD = "of all kinds"


def wobbles(found: Results) -> Results:
    """Of wobbles.py: each case, and those of all kinds by their base."""
    rows = {row["case"]: row for row in found["rows"]}
    demand(found["set"] == "judging", f"--set {found['set']}")
    demand(len(rows) == 12, f"{len(rows)} cases")
    crowd = found["runs"].get(CROWD, [])
    demand(len(crowd) >= 500, f"{len(crowd)} runs {CROWD}")
    accepted = [run for run in crowd if run["kind"] == "found"]
    return {
        "cases": {
            name: {key: each for key, each in row.items() if key != "case"}
            for name, row in rows.items()
        },
        "crowd": {
            "drawn": Counter(run["base"] for run in crowd),
            "accepted": dict.fromkeys(("firm", "soft", "slips"), 0)
            | Counter(run["base"] for run in accepted),
            "worst_mm": max(run["error_mm"] for run in accepted),
        },
        "figures": without_colons(named(found["figures"])),
    }
