# SPDX-License-Identifier: MIT
"""The stated errors of poses where a desk misleads a probe: magnets on it, steel
and mains near it, slow turns at power-on, cold, and sensors that have died.

Prints a line a case, from the firmware's C on this machine, and writes
build/benchmarks/honesty-desk.json. Even seeds are for tuning, odd ones for judging.
docs/honesty.md explains the columns.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial

from benchmarks.accuracy import report
from benchmarks.common import engines, jobs, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST
from benchmarks.common.feed import sampled
from benchmarks.common.figure import SETS, Figure
from benchmarks.common.paths import write_results
from benchmarks.honesty.arguments import output_of, parser_of
from benchmarks.honesty.cases import CASES, GROUPS, Case
from benchmarks.honesty.stated import Stated

SEEDS = 8  # of each set
MUST, GOAL = 90.0, 95.0


@dataclass(frozen=True, slots=True)
class Line:
    """A case over the seeds of a set."""

    case: str
    heading: Stated
    tilt: Stated
    worst: float  # the least honest share of a seed, tilt or heading

    @property
    def honest(self) -> float:
        return min(self.heading.honest, self.tilt.honest)


def measure(run: tuple[int, int], board: str) -> tuple[Stated, Stated]:
    """The stated errors of heading and tilt in CASES[index] with a seed."""
    index, seed = run
    case = CASES[index]
    motion = case.made(seed)
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, case.params))
    assert found.tilt_sigma_deg is not None
    assert found.heading_sigma_deg is not None
    errors = scoring.errors_at(found.times_s, found.quats, motion)
    keep = found.times_s > case.from_s
    return (
        Stated.of(errors.heading[keep], found.heading_sigma_deg[keep]),
        Stated.of(errors.inclination[keep], found.tilt_sigma_deg[keep]),
    )


def line_of(case: Case, runs: Sequence[tuple[Stated, Stated]]) -> Line:
    """The runs of a case with the seeds of a set."""
    headings, tilts = zip(*runs, strict=True)
    worst = min(min(heading.honest, tilt.honest) for heading, tilt in runs)
    return Line(str(case), Stated.mean(headings), Stated.mean(tilts), worst)


HEADS = (
    *("heading true", "stated", "withheld", "honest %", "tilt true", "stated"),
    *("withheld", "honest %", "worst seed", "verdict"),
)


def cells(line: Line) -> list[str]:
    """A row of the table, as HEADS name it."""
    found = []
    for each in (line.heading, line.tilt):
        found += [f"{each.true_deg:.2f}", f"{each.stated_deg:.2f}"]
        found += [f"{100.0 * each.withheld:.0f} %", f"{100.0 * each.honest:.1f}"]
    return [*found, f"{100.0 * line.worst:.0f}", figure(line.case, line.honest).verdict]


def figure(name: str, share: float, detail: str = "") -> Figure:
    """A share that must be inside the stated 95 % or withheld."""
    return Figure(name, 100.0 * share, (MUST, 100.0), (GOAL, 100.0), detail)


def figures(lines: Sequence[Line]) -> Iterator[Figure]:
    """The required figures: the worst line of each kind."""
    for kind in ("heading", "tilt"):
        shares = {line.case: getattr(line, kind).honest for line in lines}
        worst = min(shares, key=lambda name: shares[name])
        short = sum(100.0 * share < MUST for share in shares.values())
        detail = f"{worst}; {short} of {len(lines)} lines miss it"
        name = f"{kind} inside 95 % or withheld, %, worst line"
        yield figure(name, shares[worst], detail)


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    example = "example: benchmarks/honesty/desk.py --groups mains"
    parser = parser_of(__doc__, example, GROUPS, seeds=SEEDS, few=2)
    args = parser.parse_args(argv)
    args.output = output_of(args, "desk")
    return args


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables and write the JSON; return 1 if a required figure is missed."""
    args = parse(argv)
    wanted = [at for at, case in enumerate(CASES) if case.group in args.groups]
    seeds = {
        which: [SETS[which] + 2 * number for number in range(1, args.seeds + 1)]
        for which in args.sets
    }
    # All cases of a seed in turn: they share its hand.
    work = [(at, seed) for each in seeds.values() for seed in each for at in wanted]
    task = partial(measure, board=args.board)
    done = dict(zip(work, jobs.each(task, work, args.jobs, "runs"), strict=True))
    document, missed = {}, 0
    for which, each in seeds.items():
        lines = [line_of(CASES[at], [done[at, seed] for seed in each]) for at in wanted]
        title = f"{which}, {args.board}: degrees, {len(each)} seeds a line"
        report.print_table(title, HEADS, {line.case: cells(line) for line in lines})
        found = list(figures(lines))
        report.print_figures(found, is_judged=True)
        if which == "judging":
            missed = sum(one.verdict == "MISSED" for one in found)
        document[which] = {
            "lines": [asdict(line) for line in lines],
            "figures": [asdict(one) | {"verdict": one.verdict} for one in found],
        }
    write_results(args.output, report.plain(document))
    print(f"\n{missed} figures are outside their limits" if missed else "")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
