# SPDX-License-Identifier: MIT
"""The stated errors of poses where a desk misleads a probe: magnets on it, steel
and mains near it, slow turns at power-on, cold, and sensors that have died.

The poses are those of the firmware's C on this machine; docs/accuracy.md explains the
columns.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks import harness
from benchmarks.common import engines, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST
from benchmarks.common.feed import sampled
from benchmarks.harness import Figure, Report, Table
from benchmarks.honesty.cases import CASES, GROUPS, Case
from benchmarks.honesty.stated import Stated

MUST, GOAL = 90.0, 95.0


@dataclass(frozen=True, slots=True)
class Line:
    """A case over the seeds of a set."""

    case: str
    heading: Stated
    tilt: Stated
    worst: float  # the least honest share of a seed, tilt or heading

    def row(self) -> dict[str, Any]:
        """As COLUMNS name it."""
        row: dict[str, Any] = {"case": self.case, "worst": 100.0 * self.worst}
        for kind, each in (("heading", self.heading), ("tilt", self.tilt)):
            row |= {
                kind: each.true_deg,
                f"{kind} stated": each.stated_deg,
                f"{kind} withheld": 100.0 * each.withheld,
                f"{kind} honest": 100.0 * each.honest,
            }
        return row


COLUMNS = {
    "case": ("case", ""),
    "heading: true": ("heading", ".1f"),
    "stated": ("heading stated", ".1f"),
    "withheld, %": ("heading withheld", ".0f"),
    "honest, %": ("heading honest", ".0f"),
    "tilt: true": ("tilt", ".2f"),
    "tilt: stated": ("tilt stated", ".2f"),
    "tilt: withheld, %": ("tilt withheld", ".0f"),
    "tilt: honest, %": ("tilt honest", ".0f"),
    "worst seed, %": ("worst", ".0f"),
}


def measure(run: tuple[int, int], board: str) -> tuple[Stated, Stated]:
    """The stated errors of heading and tilt in CASES[index] with a seed."""
    index, seed = run
    case = CASES[index]
    motion = case.made(seed)
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, case.params))
    tilt_sigma_deg, heading_sigma_deg = found.sigmas_deg
    errors = scoring.errors_at(found.times_s, found.quats, motion)
    keep = found.times_s > case.from_s
    return (
        Stated.of(errors.heading[keep], heading_sigma_deg[keep]),
        Stated.of(errors.inclination[keep], tilt_sigma_deg[keep]),
    )


def line_of(case: Case, runs: Sequence[tuple[Stated, Stated]]) -> Line:
    """The runs of a case with the seeds of a set."""
    headings, tilts = zip(*runs, strict=True)
    worst = min(min(heading.honest, tilt.honest) for heading, tilt in runs)
    return Line(str(case), Stated.mean(headings), Stated.mean(tilts), worst)


def figures(lines: Sequence[Line]) -> Iterator[Figure]:
    """The required figures: the worst line of each kind."""
    for kind in ("heading", "tilt"):
        shares = {line.case: 100.0 * getattr(line, kind).honest for line in lines}
        worst = min(shares, key=lambda name: shares[name])
        short = sum(share < MUST for share in shares.values())
        yield Figure(
            f"{kind} inside 95 % or withheld, %, worst line",
            *(shares[worst], (MUST, 100.0), (GOAL, 100.0)),
            f"{worst}; {short} of {len(lines)} lines miss it",
        )


def measured(args: argparse.Namespace) -> Report:
    wanted = [at for at, case in enumerate(CASES) if case.group in args.groups]
    seeds = harness.seeds_of(args, first=2)
    # All cases of a seed in turn: they share its hand.
    work = [(at, seed) for seed in seeds for at in wanted]
    task = partial(measure, board=args.board)
    runs = harness.each(task, work, args.jobs, "runs")
    done = dict(zip(work, runs, strict=True))
    lines = [line_of(CASES[at], [done[at, seed] for seed in seeds]) for at in wanted]
    table = Table.of("cases", COLUMNS, [line.row() for line in lines])
    return Report([table], [*figures(lines)])


main = partial(
    harness.run,
    *("honesty-desk", __doc__, measured),
    harness.options(seeds=8, groups=GROUPS, boards=BOARDS, jobs=2),
    variants=["board"],
)
