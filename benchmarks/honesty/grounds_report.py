# SPDX-License-Identifier: MIT
"""The results of grounds.py: tables, JSON and the required figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from benchmarks.accuracy import groups_report, report
from benchmarks.accuracy.groups_report import Summary
from benchmarks.common.figure import SETS, Figure
from benchmarks.common.paths import write_results
from benchmarks.common.scoring import Coverage, Score

# Groups in which a stated heading must inform: good modules in even rooms, and on foot.
GOOD = ("hand", "pointing", "wand", "vehicle", "robot", "arm")
WALKING = ("walking", "sloping")
UNCALIBRATED = ("shop", "one axis", "slow turn")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The errors of our filter and of VQF on one recording at one board's rate."""

    group: str
    seed: int
    board: str
    scores: Mapping[str, Score]
    coverage: Coverage
    first: Coverage  # of the first 10 s of motion

    def __str__(self) -> str:
        return f"{self.group} {self.seed}"

    @property
    def which(self) -> str:
        """The set to which its seed belongs."""
        return next(name for name, rest in SETS.items() if self.seed % 2 == rest)

    @property
    def is_worse(self) -> bool:
        """Whether our heading or inclination is clearly worse than VQF's."""
        return groups_report.is_worse(self.scores)


HEADS = (*groups_report.HEADS, "withheld %: tilt, heading")
FIRST_HEADS = ("n", "heading in %", "worst", "withheld %", "tilt in %", "worst")


def by(
    outcomes: Sequence[Outcome], key: Callable[[Outcome], str]
) -> dict[str, list[Outcome]]:
    """The outcomes of each group, or of another key."""
    found: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        found.setdefault(key(outcome), []).append(outcome)
    return found


def by_group(outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    return by(outcomes, lambda each: each.group)


def cells(outcomes: Sequence[Outcome]) -> list[str]:
    """A row of the table, as HEADS name it."""
    summary = Summary.of(outcomes)
    nulls = (summary.coverage.tilt_null, summary.coverage.heading_null)
    return [*summary.cells(), " ".join(f"{100.0 * each:5.1f}" for each in nulls)]


def first_cells(outcomes: Sequence[Outcome]) -> list[str]:
    """A row of the table of the first seconds, as FIRST_HEADS name it."""
    mean = Coverage.mean([each.first for each in outcomes])
    return [
        str(len(outcomes)),
        f"{100.0 * mean.heading:.0f}",
        f"{100.0 * least([each.first.heading for each in outcomes]):.0f}",
        f"{100.0 * mean.heading_null:.0f}",
        f"{100.0 * mean.tilt:.0f}",
        f"{100.0 * least([each.first.tilt for each in outcomes]):.0f}",
    ]


def least(shares: Sequence[float]) -> float:
    """The least share; recordings that state no error have none."""
    return min((share for share in shares if math.isfinite(share)), default=math.nan)


def print_tables(title: str, outcomes: Sequence[Outcome], *, is_each: bool) -> None:
    """Print the tables of one set of seeds."""
    groups = by_group(outcomes)
    tables = {"group": groups}
    if is_each:
        tables["recording"] = by(outcomes, str)
    for name, rows in tables.items():
        report.print_table(
            f"{title}, by {name}: errors in degrees rms, mean over recordings",
            HEADS,
            {name: cells(each) for name, each in rows.items()},
        )
    shop = {name: each for name, each in groups.items() if name in UNCALIBRATED}
    if shop:
        report.print_table(
            f"{title}, uncalibrated, the first 10 s of motion",
            FIRST_HEADS,
            {name: first_cells(each) for name, each in shop.items()},
        )


def figures(outcomes: Sequence[Outcome]) -> Iterator[Figure]:
    """The required figures that can be computed from these groups."""
    groups = by_group(outcomes)
    first = {
        str(each): each.first.heading
        for each in outcomes
        if each.group in UNCALIBRATED and math.isfinite(each.first.heading)
    }
    if first:
        worst = min(first, key=lambda name: first[name])
        yield Figure(
            "uncalibrated, first 10 s, worst recording: inside, %",
            100.0 * first[worst],
            (90.0, 100.0),
            (95.0, 100.0),
            worst,
        )
    for title, names, must, goal in (
        ("good modules", GOOD, 2.0, 1.5),
        ("walking", WALKING, 3.0, 2.0),
    ):
        mine = [each for each in outcomes if each.group in names]
        if mine:
            yield caution(title, mine, must, goal)
    means = {
        name: Coverage.mean([one.coverage for one in each])
        for name, each in groups.items()
    }
    for kind in ("tilt", "heading"):
        shares = {name: share_of(name, kind, mean) for name, mean in means.items()}
        shares = {name: one for name, one in shares.items() if math.isfinite(one)}
        if shares:
            worst = min(shares, key=lambda name: shares[name])
            yield Figure(
                f"{kind} inside 1.96 sigma, %, worst group",
                100.0 * shares[worst],
                (88.0, 100.0),
                (93.0, 100.0),
                worst,
            )


# Gross faults, of which hardly any error is stated: what is withheld is right, too.
GROSS = ("strong", "dead acc", "dead mag")


def share_of(group: str, kind: str, mean: Coverage) -> float:
    """The share of a group's errors that are inside what is stated."""
    inside, withheld = getattr(mean, kind), getattr(mean, f"{kind}_null")
    if group not in GROSS:
        return float(inside)
    return float(withheld + (1.0 - withheld) * inside)


def caution(
    title: str, outcomes: Sequence[Outcome], must: float, goal: float
) -> Figure:
    """How many times the true error of heading the stated one is."""
    each = {name: Summary.of(own) for name, own in by_group(outcomes).items()}
    worst = max(each, key=lambda name: each[name].heading_stated)
    return Figure(
        f"heading, median stated / true rms, {title}",
        Summary.of(outcomes).heading_stated,
        (0.0, must),
        (0.0, goal),
        f"worst: {worst}, {each[worst].heading_stated:.2f}",
    )


def write(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write every outcome, and the summaries by set and group, as JSON."""
    sets = {}
    for which, mine in by(outcomes, lambda each: each.which).items():
        sets[which] = {
            "groups": {
                name: asdict(Summary.of(each)) for name, each in by_group(mine).items()
            },
            "figures": [
                asdict(each) | {"verdict": each.verdict} for each in figures(mine)
            ],
        }
    document = {"sets": sets, "recordings": [asdict(each) for each in outcomes]}
    write_results(path, report.plain(document))
