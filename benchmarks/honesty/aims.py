# SPDX-License-Identifier: MIT
"""Whether green means what it says: aims at a desired orientation since an origin.

A hand sets an origin, goes on to other attitudes and holds each for 8 to 12 s; there it
corrects by the error that is shown until that is small, or stops a little beside. An
aim is green while the shown error and two sigma of it are within the tolerance of 2
degrees. Printed by the age of the origin: how often it was green while the true error
was beyond the tolerance, and how many of the aims that were truly on target got green
within 10 s.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common import engines
from benchmarks.common.boards import BOARDS
from benchmarks.common.engines import HOST, Estimate
from benchmarks.common.feed import sampled
from benchmarks.harness import Figure, Report, Table
from benchmarks.honesty.since_origin import (
    known_params,
    published,
    wrong_of,
)
from imud import rotation
from imud.probes.aim import Aim, Target
from imud.probes.references import References
from imud.published import SinceOrigin
from imud.rotation import FloatArray
from imud.virtual.motion import Motion
from imud.virtual.motions import aiming

ROOMS = {"3 µT/m": aiming.ROOM_UT_M, "12 µT/m": 4.0 * aiming.ROOM_UT_M}
HOLDS_S = (8.0, 12.0)
SECONDS = 200.0
FIRST_S = 30.0
EVERY = 10  # poses: 20 a second
TOLERANCE_DEG = 2.0
MISSES_DEG = {"corrects": 0.3, "stops beside": 1.2}  # rms of an axis
STEADY_DPS = 3.0  # it holds still below this rate
GREEN_S = 10.0
YOUNG_S = 30.0
# A pose as published, and its errors since the origin; None: before it.
Told = tuple[dict[str, Any], SinceOrigin | None]
AGES_S = (15.0, YOUNG_S, 60.0, 180.0)


@dataclass(frozen=True, slots=True)
class Aimed:
    """One aim."""

    room: str
    miss: str
    age_s: float  # of the origin, as it began
    poses: int
    green: int
    false_green: int  # of them with a true error beyond the tolerance
    is_true: bool  # half of the time the true error was within it, or more
    is_reached: bool  # green within GREEN_S


def holds_of(truth: Motion) -> Iterator[tuple[float, float]]:
    """From and to, seconds: when the hand held an attitude."""
    assert truth.quat is not None
    step = round(truth.rate_hz * 0.1)
    quats = truth.quat[::step]
    turn = rotation.multiply(rotation.inverse(quats[:-1]), quats[1:])
    rate = np.degrees(np.linalg.norm(rotation.to_rotation_vector(turn), axis=1)) / 0.1
    steady = np.convolve(rate, np.ones(5) / 5.0, "same") < STEADY_DPS
    edges = np.flatnonzero(np.diff(steady.astype(int), prepend=0, append=0))
    for begin, end in zip(edges[::2] * 0.1, edges[1::2] * 0.1, strict=True):
        if begin > FIRST_S and end - begin > 0.7 * HOLDS_S[0]:
            yield float(begin), float(end)


def aims_of(
    found: Estimate,
    truth: Motion,
    params: bytes,
    room: str,
    random: np.random.Generator,
) -> Iterator[Aimed]:
    """All pairs of a hold at which the origin is set and a later one that is aimed."""
    wrong = wrong_of(found, truth)
    holds = [*holds_of(truth)]
    for number, (origin_s, _) in enumerate(holds):
        at = int(np.searchsorted(found.times_s, origin_s + 1.0))
        since = followed(found, params, at)
        # The shown attitude less its error since the origin: the true attitude.
        off = rotation.multiply(wrong, rotation.inverse(wrong[at]))
        lies = rotation.multiply(rotation.inverse(off), found.quats)
        for begin_s, end_s in holds[number + 1 :]:
            poses = np.flatnonzero(
                (found.times_s > begin_s)
                & (found.times_s < min(end_s, begin_s + GREEN_S))
            )
            for miss, spread in MISSES_DEG.items():
                shown = found.quats[poses[len(poses) // 2]]
                beside = np.radians(random.normal(0.0, spread, 3))
                target = rotation.multiply(rotation.from_rotation_vector(beside), shown)
                age_s = begin_s - origin_s
                yield judged(
                    since, poses.tolist(), lies, target, room, miss, age_s=age_s
                )


def followed(found: Estimate, params: bytes, at: int) -> list[Told]:
    """Each pose as published, with its errors since the pose of that index."""
    references = References()
    references.tell(params)
    name: str | None = None
    told: list[Told] = []
    for index, pose in enumerate(published(found)):
        references.on_pose(pose)
        if index == at:
            name = references.capture()
        told.append((pose, references.since_capture(name) if name else None))
    return told


def judged(
    since: Sequence[Told],
    poses: Sequence[int],
    lies: FloatArray,
    target: FloatArray,
    room: str,
    miss: str,
    *,
    age_s: float,
) -> Aimed:
    aim = Aim(Target(tuple(target.tolist()), axis="all", tolerance_deg=TOLERANCE_DEG))
    green = false_green = true = 0
    for index in poses:
        pose, errors = since[index]
        said = aim.measure(pose, errors)
        apart = rotation.multiply(lies[index], rotation.inverse(target))
        error = np.degrees(np.linalg.norm(rotation.to_rotation_vector(apart)))
        is_green = said["state"] == "sure"
        green += is_green
        false_green += bool(is_green and error > TOLERANCE_DEG)
        true += bool(error <= TOLERANCE_DEG)
    return Aimed(
        room,
        miss,
        age_s,
        len(poses),
        green,
        false_green,
        2 * true >= len(poses),
        green > 0,
    )


def thinned(found: Estimate, every: int) -> Estimate:
    """Every so manieth pose, as at a lower rate."""
    tilt, heading = found.sigmas_deg
    return Estimate(
        *(found.times_s[::every], found.quats[::every]), tilt[::every], heading[::every]
    )


def measure(run: tuple[str, int], board: str) -> list[Aimed]:
    """All aims of a motion in a room with a seed."""
    room, seed = run
    motion = aiming.aim(seed, SECONDS, HOLDS_S, ROOMS[room])
    params = known_params()
    found = engines.ENGINES[HOST](sampled(motion, BOARDS[board].chip, params))
    random = np.random.default_rng([seed, 9])
    return [*aims_of(thinned(found, EVERY), motion, params, room, random)]


def row_of(aims: Sequence[Aimed]) -> dict[str, Any]:
    """Counts and percentages, as COLUMNS name them."""
    green = sum(each.green for each in aims)
    true = [each for each in aims if each.is_true]
    return {
        "aims": len(aims),
        "green": 100.0 * green / max(1, sum(each.poses for each in aims)),
        "false": 100.0 * sum(each.false_green for each in aims) / max(1, green),
        "on target": len(true),
        "reached": 100.0 * sum(each.is_reached for each in true) / max(1, len(true)),
    }


COLUMNS = {
    "room": ("room", ""),
    "the hand": ("miss", ""),
    "origin set before": ("age", ""),
    "aims": ("aims", "d"),
    "poses green, %": ("green", ".1f"),
    "of them truly beyond, %": ("false", ".2f"),
    "truly on target": ("on target", "d"),
    "of them green in 10 s, %": ("reached", ".1f"),
}


def rows_of(aims: Sequence[Aimed]) -> Iterator[dict[str, Any]]:
    """By room, by what the hand does, by the origin's age."""
    ages = [*zip((0.0, *AGES_S), AGES_S, strict=False), (0.0, AGES_S[-1])]
    for room, miss, (low, high) in product(ROOMS, MISSES_DEG, ages):
        mine = [
            each
            for each in aims
            if (each.room, each.miss) == (room, miss) and low <= each.age_s < high
        ]
        if mine:
            of = {"room": room, "miss": miss, "age": f"{low:.0f} to {high:.0f} s"}
            yield of | row_of(mine)


def figures_of(aims: Sequence[Aimed]) -> Iterator[Figure]:
    """The limits."""
    usual = next(iter(ROOMS)), next(iter(MISSES_DEG))
    young = [
        each
        for each in aims
        if each.age_s < YOUNG_S and (each.room, each.miss) == usual
    ]
    for name, value, must, goal in (
        ("green beyond the tolerance, %", row_of(aims)["false"], (0, 0.1), (0, 0.02)),
        (
            "green within 10 s, origin younger than 30 s, %",
            *(row_of(young)["reached"], (90, 100), (95, 100)),
        ),
    ):
        yield Figure(name, value, must, goal, f"{len(aims)} aims")


def measured(args: argparse.Namespace) -> Report:
    runs = [*product(args.groups, harness.seeds_of(args))]
    task = partial(measure, board=args.board)
    found = harness.each(task, runs, args.jobs, "motions")
    aims = [each for all_ in found for each in all_]
    return Report([Table.of("aims", COLUMNS, rows_of(aims))], [*figures_of(aims)])


main = partial(
    harness.run,
    *("aims", __doc__, measured),
    harness.options(seeds=16, groups=ROOMS, boards=BOARDS, jobs=2),
    variants=["board"],
)
