# SPDX-License-Identifier: MIT
"""A row of the table of `imud check`, and the verdict on all of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Any

import msgspec


class RowVerdict(StrEnum):
    GOOD = "good"
    SKIPPED = "not judged"
    LOOK = "look at this"
    FAULT = "fault"


class Row(msgspec.Struct, frozen=True):
    """One thing that was checked. `advice`: what to do; empty if nothing is wrong.
    `numbers`: the measured values, for programs.
    """

    name: str
    measured: str
    normal: str
    verdict: RowVerdict
    advice: str = ""
    numbers: Mapping[str, Any] = {}


def worst(verdicts: Iterable[RowVerdict]) -> RowVerdict:
    """The most serious of them; good where there are none."""
    order = list(RowVerdict)
    return max(verdicts, key=order.index, default=RowVerdict.GOOD)


def overall(rows: Iterable[Row]) -> RowVerdict:
    """The verdict on a board. Rows that were not judged do not count."""
    found = worst(row.verdict for row in rows)
    return RowVerdict.GOOD if found is RowVerdict.SKIPPED else found


def summary(rows: Iterable[Row]) -> str:
    """The line below the table."""
    named: dict[RowVerdict, list[str]] = {verdict: [] for verdict in RowVerdict}
    for row in rows:
        named[row.verdict].append(row.name)
    parts = [
        f"{words}: {', '.join(named[verdict])}"
        for verdict, words in (
            (RowVerdict.FAULT, "fault"),
            (RowVerdict.LOOK, "look at"),
            (RowVerdict.SKIPPED, "not judged"),
        )
        if named[verdict]
    ]
    good = f"{len(named[RowVerdict.GOOD])} checks are good"
    return "; ".join([*parts, good])


def skipped(name: str, normal: str, why: str) -> Row:
    """A row without a verdict."""
    return Row(name, why, normal, RowVerdict.SKIPPED)


def graded(value: float, good: float, fault: float) -> RowVerdict:
    """By its magnitude: good up to one limit, a fault beyond the other."""
    if abs(value) <= good:
        return RowVerdict.GOOD
    return RowVerdict.LOOK if abs(value) <= fault else RowVerdict.FAULT
