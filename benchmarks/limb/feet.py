# SPDX-License-Identifier: MIT
"""Rests and paths of made feet that stroll, walk, jog, run and sprint in curves, with a
compass and without: docs/limb-methods.md. Seeds for tuning and for judging are
kept apart.

example: python -m benchmarks.limb.feet --sets judging --feet 4
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from benchmarks.common.options import parser_of
from benchmarks.common.paths import RESULTS, write_results
from benchmarks.limb import made_gait, peers
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

OUTPUT = RESULTS / "limb_feet.json"
SETS = {"tuning": range(5), "judging": range(400, 412)}
STRIDES = 30
SIGMAS = 1.96
HEADER = (
    "gait            rests  by thresholds  false  off: mean, worst  inside  m: true, "
    "stated"
)


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
    by_thresholds: int  # of the rests those that fixed thresholds find
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
    meets, peers_meet = (
        [[b < end and e > begin for b, e in spans] for begin, end in walk.contacts]
        for spans in (
            [(found.times_s[a], found.times_s[b]) for a, b in found.rests],
            peers.rests_by_thresholds(track),
        )
    )
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
        by_thresholds=sum(map(any, peers_meet)),
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


def summary(scores: Sequence[Score]) -> dict[str, float]:
    """Over the feet of a line: shares, means, the worst, and root mean squares."""
    rests = sum(each.rests for each in scores)
    off = [each.off for each in scores]
    true_m, stated_m = (
        float(np.sqrt(np.mean([getattr(each, key) ** 2 for each in scores])))
        for key in ("true_m", "stated_m")
    )
    return {
        "feet": len(scores),
        "found": sum(each.found for each in scores) / rests,
        "by thresholds": sum(each.by_thresholds for each in scores) / rests,
        "false": sum(each.false for each in scores),
        "off mean": float(np.mean(off)),
        "off worst": max(off),
        "inside": float(np.mean([each.inside for each in scores])),
        "least inside": min(each.inside for each in scores),
        "true m": true_m,
        "stated m": stated_m,
    }


def line_of(name: str, row: Mapping[str, float]) -> str:
    return (
        f"{name:13} {100 * row['found']:6.1f} % {100 * row['by thresholds']:6.1f} % "
        f"{row['false']:5} {100 * row['off mean']:6.2f} % "
        f"{100 * row['off worst']:6.2f} % {100 * row['inside']:6.1f} % "
        f"{row['true m']:6.2f} {row['stated m']:6.2f}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, SETS, OUTPUT)
    parser.add_argument("--feet", metavar="N", type=int, help="only N of each set")
    args = parser.parse_args(argv)
    report: dict[str, Any] = {}
    for name in args.sets:
        seeds = SETS[name][: args.feet]
        progress = Progress(f"{len(seeds)} feet", len(seeds) * len(CASES))
        print(f"{name}: {len(seeds)} feet a line")
        print(HEADER)
        report[name] = {}
        for label, case in CASES.items():
            scores = []
            for seed in seeds:
                scores.append(measure_case(case, seed))
                progress.advance()
            progress.wipe()
            row = summary(scores)
            print(line_of(label, row), flush=True)
            report[name][label] = row | {"rows": [asdict(each) for each in scores]}
        progress.end()
    write_results(args.output, report)
    return 0


if __name__ == "__main__":
    sys.exit(main())
