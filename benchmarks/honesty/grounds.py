# SPDX-License-Identifier: MIT
"""Stated and true errors on simulated motions of good modules, on uneven ground, of
modules from the shop and with faults, beside VQF's errors.

docs/accuracy.md describes the groups and the columns.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from benchmarks import harness
from benchmarks.accuracy import compared
from benchmarks.accuracy.compared import COLUMNS, Outcome, Summary, grouped
from benchmarks.common import scoring
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST, Estimate
from benchmarks.common.scoring import Coverage
from benchmarks.harness import Figure, Report, Table
from imud.virtual.motion import Motion
from imud.virtual.motions.grounds import GROUNDS, made

FIRST_S = 10.0  # of motion

# Groups in which a stated heading must inform: good modules in even rooms, and on foot.
GOOD = ("hand", "pointing", "wand", "vehicle", "robot", "arm")
WALKING = ("walking", "sloping")
UNCALIBRATED = ("shop", "one axis", "slow turn")
# Gross faults, of which hardly any error is stated: what is withheld is right, too.
GROSS = ("strong", "dead acc", "dead mag")


def measure(run: tuple[str, int], board: str) -> Outcome:
    """Make a motion of a group and run our filter and VQF on it."""
    group, seed = run
    motion = made(group, seed)
    found = compared.compared(motion, board, GROUNDS[group].params)
    outcome = compared.outcome_of(group, seed, motion, found)
    return outcome.with_first(first_of(found[HOST], motion))


def first_of(own: Estimate, motion: Motion) -> Coverage:
    """Shares over the first seconds of motion."""
    is_moving = scoring.counted(own.times_s, motion)
    start_s = own.times_s[np.argmax(is_moving)]
    first = is_moving & (own.times_s < start_s + FIRST_S)
    return scoring.coverage_where(first, own, motion)


def table_of(groups: Mapping[str, Sequence[Outcome]]) -> Table:
    """Errors in degrees rms, means over recordings."""
    rows = [Summary.of(group).row(name) for name, group in groups.items()]
    return Table.of("groups", COLUMNS, rows)


def figures(groups: Mapping[str, Sequence[Outcome]]) -> Iterator[Figure]:
    """The required figures that can be computed from these groups."""
    first = {
        str(each): each.first.heading
        for name in UNCALIBRATED
        for each in groups.get(name, ())
        if each.first and math.isfinite(each.first.heading)
    }
    if first:
        value, worst = compared.worst_of(first)
        name = "uncalibrated, first 10 s, worst recording: inside, %"
        yield Figure(name, value, (90.0, 100.0), (95.0, 100.0), worst)
    for title, names, must, goal in (
        ("good modules", GOOD, 2.0, 1.5),
        ("walking", WALKING, 3.0, 2.0),
    ):
        mine = {name: groups[name] for name in names if name in groups}
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
            value, worst = compared.worst_of(shares)
            name = f"{kind} inside 1.96 sigma, %, worst group"
            yield Figure(name, value, (88.0, 100.0), (93.0, 100.0), worst)


def share_of(group: str, kind: str, mean: Coverage) -> float:
    """The share of a group's errors that are inside what is stated."""
    inside, withheld = getattr(mean, kind), getattr(mean, f"{kind}_null")
    if group not in GROSS:
        return float(inside)
    return float(withheld + (1.0 - withheld) * inside)


def caution(
    title: str, groups: Mapping[str, Sequence[Outcome]], must: float, goal: float
) -> Figure:
    """How many times the true error of heading the stated one is."""
    each = {name: Summary.of(own).heading_stated for name, own in groups.items()}
    worst = max(each, key=lambda name: each[name])
    every = Summary.of([one for own in groups.values() for one in own])
    return Figure(
        f"heading, median stated / true rms, {title}",
        *(every.heading_stated, (0.0, must), (0.0, goal)),
        f"worst: {worst}, {each[worst]:.2f}",
    )


def measured(args: argparse.Namespace) -> Report:
    work = [(group, seed) for group in args.groups for seed in harness.seeds_of(args)]
    task = partial(measure, board=args.board)
    outcomes = harness.each(task, work, args.jobs, "recordings")
    groups = grouped(outcomes, lambda each: each.group)
    return Report([table_of(groups)], [*figures(groups)])


main = partial(
    harness.run,
    *("honesty-grounds", __doc__, measured),
    harness.options(seeds=16, groups=GROUNDS, boards=BOARDS, jobs=2),
    variants=["board"],
)
