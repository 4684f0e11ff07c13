# SPDX-License-Identifier: MIT
"""Rests and paths of made feet that stroll, walk, jog, run and sprint in curves:
docs/limb.md. Seeds for tuning and for judging are kept apart.

example: python -m benchmarks.limb.feet --sets judging --feet 4
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from benchmarks.common.options import parser_of
from benchmarks.common.paths import RESULTS
from benchmarks.limb import made_gait
from benchmarks.limb.made_gait import GAITS, Gait, Walk
from imud.body import contact, fused
from imud.body.contact import FootPath
from imud.progress import Progress

OUTPUT = RESULTS / "limb_feet.json"
SETS = {"tuning": range(5), "judging": range(400, 412)}
STRIDES = 30
HEAD = "gait        rests  false  off at the end, worst  inside  true, stated: m"
SIGMAS = 1.96


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
    walk = made_gait.made(gait, strides, seed)
    return score(walk, path_of(walk))


def path_of(walk: Walk) -> FootPath:
    """What imud makes of the samples, as `imud export --body` does."""
    return contact.path(fused.attitudes(walk.times_s, walk.gyr, walk.acc, walk.mag))


def score(walk: Walk, found: FootPath) -> Score:
    spans = [(found.times_s[a], found.times_s[b]) for a, b in found.rests]
    meets = [[b < end and e > begin for b, e in spans] for begin, end in walk.contacts]
    truth = walk.place - walk.place[found.rests[0][0]]
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


def line_of(name: str, scores: Sequence[Score]) -> str:
    share = sum(each.found for each in scores) / sum(each.rests for each in scores)
    off = [each.off for each in scores]
    true, stated = (
        float(np.sqrt(np.mean([getattr(each, key) ** 2 for each in scores])))
        for key in ("true_m", "stated_m")
    )
    return (
        f"{name:10} {100 * share:6.1f} % {sum(each.false for each in scores):5} "
        f"{100 * float(np.mean(off)):6.2f} % {100 * max(off):6.2f} % "
        f"{100 * float(np.mean([each.inside for each in scores])):6.1f} % "
        f"{true:6.2f} {stated:6.2f}"
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, SETS, OUTPUT)
    parser.add_argument("--feet", metavar="N", type=int, help="only N of each set")
    args = parser.parse_args(argv)
    report = {}
    for name in args.sets:
        seeds = SETS[name][: args.feet]
        progress = Progress(f"{len(seeds)} feet", len(seeds) * len(GAITS))
        print(f"{name}: {len(seeds)} feet of {STRIDES} strides")
        print(
            "gait        rests   false   off at the end, worst   inside   m: true, said"
        )
        for label, gait in GAITS.items():
            scores = []
            for seed in seeds:
                scores.append(measure(gait, seed))
                progress.advance()
            progress.wipe()
            print(line_of(label, scores))
            report[f"{name} {label}"] = [asdict(each) for each in scores]
        progress.end()
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
