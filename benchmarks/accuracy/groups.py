# SPDX-License-Identifier: MIT
"""Orientation errors on made recordings: our C beside VQF, group by group.

docs/motions.md describes the groups. Both run on this machine, on the samples that the
virtual boards would read.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from benchmarks import harness
from benchmarks.accuracy import compared
from benchmarks.accuracy.compared import COLUMNS, KINDS, Outcome, Summary, grouped
from benchmarks.common.boards import BOARDS
from benchmarks.harness import Figure, Report, Table, ratio
from imud.params.trusted import known_to, place_of
from imud.virtual.motions.groups import GROUPS, Recipe, recipes

# The errors in the params of a module: those of GOOD, SMALL and LARGE in
# imud.virtual.motions.module, whose limits are root 3 times one sigma.
KNOWN = {
    "good": (0.008, 0.2),
    "small": (0.024, 0.4),
    "large": (0.08, 1.9),
    "crossed": (0.007, 0.05),
}

MAGNET = "magnet"
EAST = "east_pendulum"


def measure(recipe: Recipe, board: str) -> Outcome:
    """Make a recording and run both engines on it, at the board's rate."""
    motion, field_ut = recipe.made_in_field()
    params = known_to(*KNOWN[recipe.module], **place_of(field_ut))
    found = compared.compared(motion, board, params)
    return compared.outcome_of(recipe.group, recipe.seed, motion, found)


def by_group(outcomes: Sequence[Outcome]) -> dict[str, Summary]:
    """Each kind of ride; recordings with a magnet on the sensor are one group."""
    found = grouped(outcomes, lambda each: MAGNET if is_magnet(each) else each.group)
    return {name: Summary.of(each) for name, each in found.items()}


def is_magnet(outcome: Outcome) -> bool:
    return Recipe(outcome.group, outcome.seed).room == MAGNET


def table_of(groups: Mapping[str, Summary]) -> Table:
    """Errors in degrees rms, means over recordings."""
    return Table.of("groups", COLUMNS, [each.row(of) for of, each in groups.items()])


def figures(groups: Mapping[str, Summary]) -> Iterator[Figure]:
    """The required figures: the worst group of each kind."""
    rest = {name: each for name, each in groups.items() if name != EAST}
    if rest:
        yield from worst_groups(rest)
        count = sum(each.count for each in groups.values())
        worse = sum(each.worse * each.count for each in groups.values())
        worst = max(rest, key=lambda name: rest[name].worse)
        value = 100.0 * worse / count
        name = "recordings worse than VQF, %"
        yield Figure(name, value, (0.0, 4.0), (0.0, 1.0), f"most: {worst}")
    quiet = [each for name, each in rest.items() if name != MAGNET]
    if quiet:
        nulls = [each.coverage.heading_null for each in quiet]
        share = np.average(nulls, weights=[each.count for each in quiet])
        name = "heading withheld, without a magnet, %"
        yield Figure(name, 100.0 * float(share), (0.0, 1.0), (0.0, 0.5))
    if EAST in groups:
        mine, other = compared.pair_of(groups[EAST].scores, "heading")
        yield ratio(f"heading / VQF, {EAST}", mine, other, 1.05, 1.0)


def worst_groups(groups: Mapping[str, Summary]) -> Iterator[Figure]:
    for kind in KINDS:
        worst = max(groups, key=lambda name: groups[name].ratio(kind))
        value = groups[worst].ratio(kind)
        name = f"{kind} / VQF, worst group"
        yield Figure(name, value, (0.0, 1.05), (0.0, 0.85), worst)
    for kind in ("tilt", "heading"):
        shares = {name: getattr(each.coverage, kind) for name, each in groups.items()}
        value, worst = compared.worst_of(shares)
        name = f"{kind} inside 1.96 sigma, %, worst group"
        yield Figure(name, value, (88.0, 100.0), (93.0, 98.0), worst)


def measured(args: argparse.Namespace) -> Report:
    wanted = [each for each in recipes(args.set) if each.group in args.groups]
    task = partial(measure, board=args.board)
    outcomes = list(harness.each(task, wanted, args.jobs, "recordings"))
    found = by_group(outcomes)
    return Report([table_of(found)], [*figures(found)])


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--set", choices=harness.SETS, default="judging", help="seeds")


main = partial(
    harness.run,
    *("motions", __doc__, measured),
    harness.options(groups=GROUPS, boards=BOARDS, jobs=2, more=more),
    variants=["board"],
)
