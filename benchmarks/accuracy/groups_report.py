# SPDX-License-Identifier: MIT
"""The results of groups.py: tables, JSON and the required figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from benchmarks.accuracy import report
from benchmarks.common.engines import HOST, VQF
from benchmarks.common.figure import Figure, ratio
from benchmarks.common.paths import write_results
from benchmarks.common.scoring import Coverage, Score
from imud.virtual.motions.groups import Recipe

MAGNET = "magnet"
EAST = "east_pendulum"

# A recording is worse if both hold: our error over VQF's, and our error less VQF's.
WORSE_RATIO, WORSE_DEG = 1.2, 0.5
KINDS = ("heading", "inclination")


@dataclass(frozen=True, slots=True)
class Outcome:
    """The errors of the engines on one recording at one board's rate; ours is HOST."""

    recipe: Recipe
    board: str
    scores: Mapping[str, Score]
    coverage: Coverage

    @property
    def is_worse(self) -> bool:
        """Whether our heading or inclination is clearly worse than VQF's."""
        return is_worse(self.scores)


def is_worse(scores: Mapping[str, Score]) -> bool:
    """Whether our heading or inclination is clearly worse than VQF's."""
    return any(
        mine > WORSE_RATIO * other and mine > other + WORSE_DEG
        for mine, other in (
            (getattr(scores[HOST], kind), getattr(scores[VQF], kind)) for kind in KINDS
        )
    )


class Compared(Protocol):
    """The errors of our filter on a recording, beside others."""

    @property
    def scores(self) -> Mapping[str, Score]: ...
    @property
    def coverage(self) -> Coverage: ...
    @property
    def is_worse(self) -> bool: ...


@dataclass(frozen=True, slots=True)
class Summary:
    """Means over the recordings of a group."""

    count: int
    scores: Mapping[str, Score]
    coverage: Coverage
    worse: float  # the share of recordings
    tilt_stated: float  # median stated sigma / true rms
    heading_stated: float

    @staticmethod
    def of(outcomes: Sequence[Compared]) -> Summary:
        scores = report.average([each.scores for each in outcomes])
        coverage = Coverage.mean([each.coverage for each in outcomes])
        return Summary(
            len(outcomes),
            scores,
            coverage,
            float(np.mean([each.is_worse for each in outcomes])),
            coverage.tilt_sigma_deg / scores[HOST].inclination,
            coverage.heading_sigma_deg / scores[HOST].heading,
        )

    def ratio(self, kind: str) -> float:
        """Our error divided by VQF's."""
        return float(getattr(self.scores[HOST], kind) / getattr(self.scores[VQF], kind))

    def cells(self) -> list[str]:
        """A row of the table, as HEADS name it."""
        found = [str(self.count)]
        for kind in KINDS:
            mine, other = (getattr(self.scores[name], kind) for name in (HOST, VQF))
            found.append(f"{mine:.2f} / {other:.2f} = {self.ratio(kind):4.2f}")
        found.append(f"{100.0 * self.worse:.0f}")
        found.append(f"{100.0 * self.coverage.tilt:.0f} {self.tilt_stated:5.2f}")
        found.append(f"{100.0 * self.coverage.heading:.0f} {self.heading_stated:5.2f}")
        return found


HEADS = (
    *("n", "heading ours / VQF", "inclination ours / VQF", "worse %"),
    *("tilt in %, sigma/rms", "heading in %, sigma/rms"),
)


def by_group(outcomes: Sequence[Outcome]) -> dict[str, Summary]:
    """Each kind of ride; recordings with a magnet on the sensor are one group."""
    return summaries(outcomes, row_of)


def row_of(recipe: Recipe) -> str:
    """The name of the group in which a recording counts."""
    return MAGNET if recipe.room == MAGNET else recipe.group


def by_condition(outcomes: Sequence[Outcome]) -> dict[str, Summary]:
    """Each room and module, with all rides but the pendulum made to fail."""
    rest = [each for each in outcomes if each.recipe.group != EAST]
    return summaries(rest, lambda recipe: f"{recipe.room}, {recipe.module}")


def summaries(
    outcomes: Sequence[Outcome], key: Callable[[Recipe], str]
) -> dict[str, Summary]:
    """A summary for each value of the key, in the order in which they come."""
    found: dict[str, list[Outcome]] = {}
    for outcome in outcomes:
        found.setdefault(key(outcome.recipe), []).append(outcome)
    return {name: Summary.of(each) for name, each in found.items()}


def print_tables(title: str, outcomes: Sequence[Outcome], *, is_each: bool) -> None:
    """Print the tables of one set of seeds on one board."""
    tables = {"group": by_group(outcomes), "room, module": by_condition(outcomes)}
    if is_each:
        tables["recording"] = summaries(outcomes, str)
    for by, rows in tables.items():
        if not rows:
            continue
        report.print_table(
            f"{title}, by {by}: errors in degrees rms, mean over recordings",
            HEADS,
            {name: summary.cells() for name, summary in rows.items()},
        )
    groups = by_group(outcomes)
    names = list(outcomes[0].scores)
    if len(names) > 2:
        report.print_table(
            f"{title}: total, heading, inclination error, degrees rms",
            list(groups),
            {
                name: [str(each.scores[name]) for each in groups.values()]
                for name in names
            },
        )


def figures(outcomes: Sequence[Outcome]) -> Iterator[Figure]:
    """The required figures: the worst group of each kind."""
    groups = by_group(outcomes)
    east = groups.pop(EAST, None)
    if groups:
        for kind in KINDS:
            worst = max(groups, key=lambda name: groups[name].ratio(kind))
            value = groups[worst].ratio(kind)
            yield Figure(
                f"{kind} / VQF, worst group", value, (0.0, 1.05), (0.0, 0.85), worst
            )
        worst = max(groups, key=lambda name: groups[name].worse)
        value = 100.0 * float(np.mean([each.is_worse for each in outcomes]))
        yield Figure(
            "recordings worse than VQF, %", value, (0.0, 4.0), (0.0, 1.0), worst
        )
        for kind in ("tilt", "heading"):
            shares = {
                name: getattr(each.coverage, kind) for name, each in groups.items()
            }
            worst = min(shares, key=lambda name: shares[name])
            yield Figure(
                f"{kind} inside 1.96 sigma, %, worst group",
                100.0 * shares[worst],
                (88.0, 100.0),
                (93.0, 98.0),
                worst,
            )
    quiet = [each for name, each in groups.items() if name != MAGNET]
    if quiet:
        nulls = [each.coverage.heading_null for each in quiet]
        counts = [each.count for each in quiet]
        yield withheld("heading withheld, without a magnet, %", nulls, counts)
    if east:
        mine, other = east.scores[HOST].heading, east.scores[VQF].heading
        yield ratio("heading / VQF, east_pendulum", mine, other, 1.05, 1.0)


def withheld(name: str, shares: Sequence[float], counts: Sequence[int]) -> Figure:
    """The share of poses of groups that state no error; their recordings count."""
    value = 100.0 * float(np.average(shares, weights=counts))
    return Figure(name, value, (0.0, 1.0), (0.0, 0.5))


def write(outcomes: Sequence[Outcome], path: Path) -> None:
    """Write every outcome, and the summaries by set, board and group, as JSON."""
    cells: dict[str, dict[str, dict[str, object]]] = {}
    for which in dict.fromkeys(each.recipe.which for each in outcomes):
        for board in dict.fromkeys(each.board for each in outcomes):
            mine = [
                each
                for each in outcomes
                if each.recipe.which == which and each.board == board
            ]
            cells.setdefault(which, {})[board] = {
                "groups": {name: asdict(s) for name, s in by_group(mine).items()},
                "conditions": {
                    name: asdict(s) for name, s in by_condition(mine).items()
                },
                "figures": [
                    asdict(figure) | {"verdict": figure.verdict}
                    for figure in figures(mine)
                ],
            }
    document = {
        "sets": cells,
        "recordings": [
            asdict(each) | {"room": each.recipe.room, "module": each.recipe.module}
            for each in outcomes
        ],
    }
    write_results(path, report.plain(document))
