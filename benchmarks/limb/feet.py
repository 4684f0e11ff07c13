# SPDX-License-Identifier: MIT
"""Rests and paths of made feet that stroll, walk, jog, run and sprint in curves, with a
compass and without: docs/limb.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.harness import Report, Table
from benchmarks.limb import made_gait
from benchmarks.limb.made_gait import (
    BARE,
    GAITS,
    NARROW,
    ROOM_RUN,
    USUAL_SENSOR,
    Gait,
    Sensor,
    Walk,
)
from imud import rotation
from imud.body import contact, fused, heading
from imud.body.contact import FootPath
from imud.body.tracks import Track
from imud.progress import Progress
from imud.rotation import FloatArray

FIRST = {"tuning": 0, "judging": 400}  # seeds
STRIDES = 30
SIGMAS = 1.96


@dataclass(frozen=True, slots=True)
class Case:
    """The motion of a foot, and the probe on it."""

    strides: Sequence[Gait]
    sensor: Sensor


CASES = {name: Case([gait] * STRIDES, USUAL_SENSOR) for name, gait in GAITS.items()} | {
    "walk, bare": Case([GAITS["walk"]] * STRIDES, BARE),
    "jog, bare": Case([GAITS["jog"]] * STRIDES, BARE),
    "run, bare": Case([GAITS["run"]] * STRIDES, BARE),
    "in a room": Case([ROOM_RUN] * STRIDES, BARE),
    "mixed, bare": Case(made_gait.mixed(), BARE),
    "sprint, bare": Case([GAITS["sprint"]] * STRIDES, BARE),
    "run, narrow": Case([GAITS["run"]] * STRIDES, NARROW),
    "mixed, narrow": Case(made_gait.mixed(), NARROW),
}


@dataclass(frozen=True, slots=True)
class Score:
    """Of one foot. `off`: distance of the last rest from where it is, a share of the
    way. Root mean squares in m, of each axis, of all moments after the first rest.
    """

    rests: int
    found: int
    false: int
    off: float
    inside: float
    true_m: float
    stated_m: float


def measure(gait: Gait, seed: int, strides: int = STRIDES) -> Score:
    return measure_case(Case([gait] * strides, USUAL_SENSOR), seed)


def measure_case(case: Case, seed: int) -> Score:
    return score(made_gait.of_strides(case.strides, seed, case.sensor))


def track_of(walk: Walk) -> Track:
    """The poses that imud computes from the samples, as `imud export --body` does."""
    return fused.attitudes(walk.times_s, walk.gyr, walk.acc, walk.mag)


def score(walk: Walk) -> Score:
    """Without a compass, the truth is turned to the heading of the path's start."""
    track = track_of(walk)
    found = contact.path(track)
    rests = [(found.times_s[a], found.times_s[b]) for a, b in found.rests]
    meets = [[b < end and e > begin for b, e in rests] for begin, end in walk.contacts]
    truth = true_path(walk, found, track)
    last = found.rests[-1][0]
    at = [int(np.searchsorted(walk.times_s, begin)) for begin, _ in walk.contacts]
    way = np.linalg.norm(np.diff(walk.place[at], axis=0), axis=1).sum()
    off = found.place - truth
    rows = np.isfinite(off[:, 0]) & (found.times_s > found.times_s[found.rests[0][1]])
    is_in = np.abs(off[rows]) <= SIGMAS * found.sigmas[rows]
    return Score(
        rests=len(meets),
        found=sum(map(any, meets)),
        false=sum(not any(column) for column in zip(*meets, strict=True)),
        off=float(np.linalg.norm(off[last]) / way),
        inside=float(is_in.mean()),
        true_m=float(np.sqrt((off[rows] ** 2).mean())),
        stated_m=float(np.sqrt((found.sigmas[rows] ** 2).mean())),
    )


def true_path(walk: Walk, found: FootPath, track: Track) -> FloatArray:
    """Where the foot is, m, from its first rest, in the world of the path."""
    truth = np.asarray(walk.place - walk.place[found.rests[0][0]])
    if np.isfinite(walk.mag).any():
        return truth
    row = found.rests[0][1]
    off = rotation.multiply(track.quat[row], rotation.inverse(walk.quat[row]))
    turn = np.array(2.0 * np.arctan2(off[3], off[0]))
    return np.asarray(rotation.rotate(heading.about_up(turn), truth))


def summary(name: str, scores: Sequence[Score]) -> dict[str, Any]:
    """Over the feet of a line: percentages, the worst, and root mean squares."""
    true_m, stated_m = (
        float(np.sqrt(np.mean([getattr(each, key) ** 2 for each in scores])))
        for key in ("true_m", "stated_m")
    )
    rests = sum(each.rests for each in scores)
    off = [100.0 * each.off for each in scores]
    return {
        "foot": name,
        "found": 100.0 * sum(each.found for each in scores) / rests,
        "false": sum(each.false for each in scores),
        "off": float(np.mean(off)),
        "worst": max(off),
        "inside": 100.0 * float(np.mean([each.inside for each in scores])),
        "least": 100.0 * min(each.inside for each in scores),
        "true": true_m,
        "stated": stated_m,
    }


COLUMNS = {
    "foot": ("foot", ""),
    "rests found, %": ("found", ".1f"),
    "false ones": ("false", "d"),
    "off, %": ("off", ".1f"),
    "worst foot": ("worst", ".1f"),
    "inside, %": ("inside", ".1f"),
    "worst foot's": ("least", ".1f"),
    "true, m": ("true", ".2f"),
    "stated, m": ("stated", ".2f"),
}


def measured(args: argparse.Namespace) -> Report:
    first = FIRST[args.set]
    progress = Progress("feet", args.seeds * len(CASES))
    rows = []
    for name, case in CASES.items():
        scores = []
        for seed in range(first, first + args.seeds):
            scores.append(measure_case(case, seed))
            progress.advance()
        rows.append(summary(name, scores))
    progress.end()
    return Report([Table.of("paths", COLUMNS, rows)])


main = partial(
    harness.run, *("limb-feet", __doc__, measured), harness.options(seeds=12)
)
