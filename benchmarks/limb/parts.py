# SPDX-License-Identifier: MIT
"""The parts that benchmarks/kept.py keeps of the results on limbs."""

from __future__ import annotations

from benchmarks.common.whole import Results, demand

LEGS = {"tuning": 6, "judging": 10}


def legs(found: Results) -> Results:
    """Of limb/legs.py: means by method, and the worst leg, of each set."""
    demand(found["walk_s"] == 60.0, f"{found['walk_s']:g} s of walking")
    counts = {name: each["legs"] for name, each in found["sets"].items()}
    demand(counts == LEGS, f"legs: {counts}")
    return {
        name: {"means": each["means"], "worst": each["worst"]}
        for name, each in found["sets"].items()
    }


def chains(found: Results) -> Results:
    """Of limb/chains.py: each kind of joint on the chains for judging."""
    demand(found["seconds"] == 60.0, f"{found['seconds']:g} s")
    demand("judging" in found["sets"], "--sets")
    return {way: each["kinds"] for way, each in found["sets"]["judging"].items()}


def feet(found: Results) -> Results:
    """Of limb/feet.py: each line of the feet for judging."""
    demand("judging" in found, "--sets")
    fewest = min(each["feet"] for each in found["judging"].values())
    demand(fewest == 12, f"{fewest} feet a line")
    return {
        name: {key: value for key, value in each.items() if key != "rows"}
        for name, each in found["judging"].items()
    }
