# SPDX-License-Identifier: MIT
"""Orientation errors on made recordings: our C and other filters, group by group.

docs/motions.md describes the groups. Every filter runs on this machine, on the samples
that the virtual boards would read. Seeds for tuning and for judging are kept apart;
--further judges on odd seeds beyond both, without the pendulum to the east.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from benchmarks.accuracy import groups_report, report
from benchmarks.accuracy.groups_report import Outcome
from benchmarks.common import engines, jobs, scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST, VQF
from benchmarks.common.feed import sampled
from benchmarks.common.paths import RESULTS, write_results
from imud.params.trusted import known_to, place_of
from imud.virtual.motion import Motion
from imud.virtual.motions.groups import GROUPS, JUDGING, SETS, Recipe, recipes

# The errors in the params of a module: those of SMALL and LARGE in
# imud.virtual.motions.module, whose limits are root 3 times one sigma.
KNOWN = {"small": (0.024, 0.4), "large": (0.08, 1.9), "crossed": (0.007, 0.05)}

OUTPUT = RESULTS / "groups.json"
FURTHER = RESULTS / "groups-further.json"
FURTHER_SETS = 3


def measure(
    recipe: Recipe, boards: Sequence[str], names: Sequence[str]
) -> list[Outcome]:
    """Make a recording and run every engine on it, at each board's rate."""
    motion, field_ut = recipe.made_in_field()
    params = known_to(*KNOWN[recipe.module], **place_of(field_ut))
    return [outcome(recipe, motion, params, board, names) for board in boards]


def outcome(
    recipe: Recipe, motion: Motion, params: bytes, board: str, names: Sequence[str]
) -> Outcome:
    """Run every engine on a motion as a board with these params measures it."""
    feed = sampled(motion, BOARDS[board].chip, params)
    found = {name: engines.ENGINES[name](feed) for name in names}
    own = found[HOST]
    assert own.tilt_sigma_deg is not None
    assert own.heading_sigma_deg is not None
    return Outcome(
        recipe,
        board,
        {
            name: scoring.score_at(each.times_s, each.quats, motion)
            for name, each in found.items()
        },
        scoring.coverage_at(
            own.times_s, own.quats, own.tilt_sigma_deg, own.heading_sigma_deg, motion
        ),
    )


def measure_all(found: Sequence[Recipe], args: argparse.Namespace) -> list[Outcome]:
    """Measure all recordings, `--jobs` at a time."""
    task = partial(measure, boards=args.boards, names=args.engines)
    done = jobs.each(task, found, args.jobs, "recordings")
    return [outcome for each in done for outcome in each]


def measure_further(args: argparse.Namespace) -> None:
    """Print and write the required figures of further seeds."""
    judged = [each for each in recipes(JUDGING) if each.group in args.groups]
    judged = [each for each in judged if each.group != groups_report.EAST]
    span = 1 + max((each.seed for each in judged), default=0)
    sets: dict[str, dict[str, object]] = {}
    for index in range(1, 1 + FURTHER_SETS):
        wanted = [Recipe(each.group, each.seed + index * span) for each in judged]
        outcomes = measure_all(wanted, args)
        for board in args.boards:
            mine = [each for each in outcomes if each.board == board]
            name = f"{1 + index * span} to {(1 + index) * span - 1}"
            print(f"\nodd seeds {name}, {board}")
            figures = list(groups_report.figures(mine))
            report.print_figures(figures, is_judged=True)
            sets.setdefault(name, {})[board] = {
                "recordings": len(mine),
                "worse": sum(each.is_worse for each in mine),
                "figures": {figure.name: figure.value for figure in figures},
            }
    write_results(FURTHER, sets)


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="examples: benchmarks/accuracy/groups.py --sets tuning --boards nano; "
        "benchmarks/accuracy/groups.py --groups pendulum robot_arm --each",
    )
    for name, known, default in (
        ("groups", GROUPS, list(GROUPS)),
        ("sets", SETS, list(SETS)),
        ("boards", BOARDS, list(BOARDS)),
        ("engines", engines.ENGINES, [HOST, VQF]),
    ):
        parser.add_argument(
            f"--{name}",
            metavar="NAME",
            nargs="+",
            choices=known,
            default=default,
            help=f"of {', '.join(known)} (default: {', '.join(default)})",
        )
    parser.add_argument(
        "--each", action="store_true", help="also print a line for each recording"
    )
    parser.add_argument(
        "--further", action="store_true", help="judge on further odd seeds instead"
    )
    parser.add_argument("--jobs", metavar="N", type=int, default=2, help="at a time")
    parser.add_argument("--output", metavar="FILE", type=Path, default=OUTPUT)
    args = parser.parse_args(argv)
    args.engines = list(dict.fromkeys([HOST, VQF, *args.engines]))
    return args


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables and write the JSON; return 1 if a required figure is missed."""
    args = parse(argv)
    if args.further:
        measure_further(args)
        return 0
    wanted = [
        recipe
        for which in args.sets
        for recipe in recipes(which)
        if recipe.group in args.groups
    ]
    outcomes = measure_all(wanted, args)
    groups_report.write(outcomes, args.output)
    missed = 0
    for which in args.sets:
        for board in args.boards:
            mine = [
                each
                for each in outcomes
                if each.recipe.which == which and each.board == board
            ]
            groups_report.print_tables(f"{which}, {board}", mine, is_each=args.each)
            figures = list(groups_report.figures(mine))
            report.print_figures(figures, is_judged=True)
            missed += sum(figure.verdict == "MISSED" for figure in figures)
    print(f"\n{missed} figures are outside their limits" if missed else "")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
