# SPDX-License-Identifier: MIT
"""The parts that benchmarks/kept.py keeps of the results of calibrations."""

from __future__ import annotations

from benchmarks.common import scoring
from benchmarks.common.whole import Results, demand, without_colons


def judged(found: Results, count: str, fewest: int) -> Results:
    """Of a part of modules.py: all but its rows."""
    demand("judging" in found, f"sets {', '.join(found)}")
    part = found["judging"]
    demand(part[count] >= fewest, f"{part[count]} {count}")
    kept = {name: each for name, each in part.items() if name != "rows"}
    return {**kept, "figures": without_colons(kept["figures"])}


def cases(found: Results) -> Results:
    """Of the cases of modules.py, with images and other methods."""
    kept = judged(found, "modules", 40)
    demand(len(kept["cases"]) >= 16, f"{len(kept['cases'])} cases and boards")
    demand(len(kept["methods"]) >= 6, f"{len(kept['methods'])} methods")
    return {**kept, "cases": without_colons(kept["cases"])}


def crowd(found: Results) -> Results:
    """Of the recordings of all kinds of modules.py: verdicts."""
    return judged(found, "recordings", 1000)


def shops(found: Results) -> Results:
    """Of the public recordings of modules.py, with modules from a shop."""
    kept = judged(found, "modules", 4)
    demand(kept["recordings"] == scoring.TRIALS, f"{kept['recordings']} recordings")
    return kept


def rough(found: Results) -> Results:
    """Of the rough modules of modules.py, which learn in use."""
    return judged(found, "modules", 50)


def warm(found: Results) -> Results:
    """Of warm.py: each kind of drift, calibrated once and twice."""
    demand(found["set"] == "judging", f"set {found['set']}")
    demand(found["modules"] >= 100, f"{found['modules']} modules")
    return {"modules": found["modules"], "lines": found["lines"]}


def turns(found: Results) -> Results:
    """Of turns.py: right verdicts in percent, by fault, hand and angle."""
    demand("judging" in found, f"sets {', '.join(found)}")
    rights: dict[tuple[str, str, str], list[bool]] = {}
    for row in found["judging"]:
        key = (row["fault"], row["hand"], f"{row['turn_deg']:g}")
        is_right = (row["verdict"] == "good") == (row["fault"] == "nothing wrong")
        rights.setdefault(key, []).append(is_right)
    fewest = min(map(len, rights.values()))
    demand(len(rights) == 20 and fewest >= 25, f"{fewest} turns of each kind")
    shares: Results = {}
    for (fault, hand, degrees), each in rights.items():
        of_hand = shares.setdefault(fault, {}).setdefault(hand, {})
        of_hand[degrees] = 100.0 * sum(each) / len(each)
    return {"turns": fewest, "right": shares}
