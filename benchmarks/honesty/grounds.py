# SPDX-License-Identifier: MIT
"""Stated and true errors on simulated motions of good modules, on uneven ground, of
modules from the shop and with faults, beside VQF's errors.

docs/honesty.md describes the groups and the columns. Writes
build/benchmarks/honesty-grounds.json. Even seeds are for tuning, odd ones for judging.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial

import numpy as np

from benchmarks.accuracy import report
from benchmarks.common import engines, jobs, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST, VQF
from benchmarks.common.feed import sampled
from benchmarks.common.figure import SETS
from benchmarks.common.scoring import Coverage
from benchmarks.honesty import grounds_report
from benchmarks.honesty.arguments import output_of, parser_of
from benchmarks.honesty.grounds_report import Outcome
from imud.virtual.motion import Motion
from imud.virtual.motions.grounds import GROUNDS, made

FIRST_S = 10.0  # of motion
SEEDS = 16  # of each set


def measure(run: tuple[str, int], board: str) -> Outcome:
    """Make a motion of a group and run our filter and VQF on it."""
    group, seed = run
    motion = made(group, seed)
    feed = sampled(motion, BOARDS[board].chip, GROUNDS[group].params)
    found = {name: engines.ENGINES[name](feed) for name in (HOST, VQF)}
    own = found[HOST]
    assert own.tilt_sigma_deg is not None
    assert own.heading_sigma_deg is not None
    return Outcome(
        group,
        seed,
        board,
        {
            name: scoring.score_at(each.times_s, each.quats, motion)
            for name, each in found.items()
        },
        scoring.coverage_at(
            own.times_s, own.quats, own.tilt_sigma_deg, own.heading_sigma_deg, motion
        ),
        first_of(own, motion),
    )


def first_of(own: engines.Estimate, motion: Motion) -> Coverage:
    """Shares over the first seconds of motion."""
    assert own.tilt_sigma_deg is not None
    assert own.heading_sigma_deg is not None
    is_moving = scoring.counted(own.times_s, motion)
    start_s = own.times_s[np.argmax(is_moving)]
    first = is_moving & (own.times_s < start_s + FIRST_S)
    return scoring.coverage_of(
        scoring.errors_at(own.times_s[first], own.quats[first], motion),
        own.tilt_sigma_deg[first],
        own.heading_sigma_deg[first],
    )


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    example = "example: benchmarks/honesty/grounds.py --groups hand walking --each"
    parser = parser_of(__doc__, example, tuple(GROUNDS), seeds=SEEDS, few=3)
    parser.add_argument(
        "--each", action="store_true", help="also print a line for each recording"
    )
    args = parser.parse_args(argv)
    args.output = output_of(args, "grounds")
    return args


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables and write the JSON; return 1 if a required figure is missed."""
    args = parse(argv)
    work = [
        (group, SETS[which] + 2 * number)
        for which in args.sets
        for group in args.groups
        for number in range(args.seeds)
    ]
    task = partial(measure, board=args.board)
    outcomes = list(jobs.each(task, work, args.jobs, "recordings"))
    grounds_report.write(outcomes, args.output)
    missed = 0
    for which in args.sets:
        mine = [each for each in outcomes if each.which == which]
        grounds_report.print_tables(f"{which}, {args.board}", mine, is_each=args.each)
        figures = list(grounds_report.figures(mine))
        report.print_figures(figures, is_judged=True)
        if which == "judging":
            missed = sum(figure.verdict == "MISSED" for figure in figures)
    print(f"\n{missed} figures are outside their limits" if missed else "")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
