# SPDX-License-Identifier: MIT
"""What the choice of parameters is worth off the recordings that it was made on.

Draws parameters around the firmware's, and for each fold of the recordings takes those
that do best on the other two; then the stated errors' own, whose share of errors inside
is nearest to 95 %. Reports the fold that had no say, beside the firmware's parameters
there. Those take no part in the choice: they were made with all recordings in sight.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import report
import scoring
import twin
from scoring import Coverage, Score
from twin import Course, Pair, Params

from imud.progress import Progress
from imud.rotation import FloatArray

OUTPUT = twin.BUILD / "tune.json"

# What is drawn: of the estimate, and of how sure of it the filter says it is.
ESTIMATE = (
    "own_sd",
    "place_sd",
    "place_wander",
    "heading_wander",
    "surprise",
    "field_noise",
    "field_step",
    "rest_factor",
    "astray_share",
    "astray_wander",
)
TILT = ("tilt_floor", "tilt_rate")
HEADING = ("heading_floor", "covariance_share", "level_error")
FACTOR = 2.0  # each way

TOTAL_GOAL, BIASED_GOAL = 0.65, 0.55  # of VQF's
INSIDE = 0.95


def draws(names: Sequence[str], count: int, seed: int) -> list[dict[str, float]]:
    """Sets of parameters, log-uniform around the firmware's."""
    known = twin.defaults()
    random = np.random.default_rng(seed)
    exponents = random.uniform(-1.0, 1.0, (count, len(names)))
    return [
        known | {n: known[n] * FACTOR**e for n, e in zip(names, row, strict=True)}
        for row in exponents.tolist()
    ]


@dataclass(frozen=True, slots=True)
class Ratios:
    """Ours over VQF's, of the means over trials."""

    total: float
    inclination: float
    biased: float  # total, with a magnet on the probe

    @property
    def cost(self) -> float:
        return self.total / TOTAL_GOAL + self.biased / BIASED_GOAL

    def __str__(self) -> str:
        return f"{self.total:.2f} {self.inclination:.2f} {self.biased:.2f}"


def ratios(courses: Sequence[Course], pairs: Sequence[Pair]) -> Ratios:
    ours, ours_biased = means(pairs)
    vqf, vqf_biased = means([each.vqf for each in courses])
    return Ratios(
        ours.total / vqf.total,
        ours.inclination / vqf.inclination,
        ours_biased.total / vqf_biased.total,
    )


def means(pairs: Sequence[Pair]) -> tuple[Score, Score]:
    biased = [score for _, score in pairs if score]
    return Score.mean([score for score, _ in pairs]), Score.mean(biased)


@dataclass(frozen=True, slots=True)
class Stated:
    """True errors, and what the parameters make their stated ones from; degrees."""

    tilt: FloatArray
    heading: FloatArray
    rate: FloatArray  # 100 deg/s
    across: FloatArray  # of the heading, by the field's covariance
    leaning: FloatArray  # the same by a degree of level

    def inside(self, params: Params) -> tuple[float, float]:
        """Shares of tilt and heading errors."""
        tilt = (params["tilt_floor"] ** 2, params["tilt_rate"] ** 2 * self.rate**2)
        heading = (
            params["heading_floor"] ** 2,
            params["covariance_share"] * self.across**2,
            params["level_error"] ** 2 * self.leaning**2,
        )
        return (
            float(np.mean(self.tilt**2 <= scoring.SIGMAS**2 * sum(tilt))),
            float(np.mean(self.heading**2 <= scoring.SIGMAS**2 * sum(heading))),
        )


def stated(course: Course, params: Params) -> Stated:
    """Each term alone, by parameters that leave the others out."""
    nothing = dict.fromkeys((*TILT, *HEADING), 0.0)
    base = dict(params) | nothing
    one = course.track(base | {"tilt_rate": 1.0, "covariance_share": 1.0}, course.samples)
    other = course.track(base | {"level_error": 1.0}, course.samples)
    found = scoring.errors(one.quats, course.truth)
    rows = np.stack(
        [
            found.inclination,
            found.heading,
            *(one.sigmas_deg.T),
            other.sigmas_deg[:, 1],
        ]
    )
    return Stated(*rows[:, np.isfinite(rows).all(axis=0)])


def coverage(course: Course, params: Params) -> Coverage:
    """Of the parameters as they are, end to end."""
    track = course.track(params, course.samples)
    found = scoring.errors(track.quats, course.truth)
    shares, nulls = [], []
    for errors, sigmas in zip(
        (found.inclination, found.heading), track.sigmas_deg.T, strict=True
    ):
        is_stated = np.isfinite(errors) & np.isfinite(sigmas)
        inside = errors[is_stated] <= scoring.SIGMAS * sigmas[is_stated]
        shares.append(float(inside.mean()))
        nulls.append(float(1.0 - is_stated.sum() / np.isfinite(errors).sum()))
    return Coverage(*shares, *nulls)


def honest(
    courses: Sequence[Course], params: Params, count: int, seed: int
) -> dict[str, float]:
    """The parameters with stated errors whose shares inside are nearest to 95 %.

    Of all groups together, each the mean over its trials, so that three trials with a
    magnet count as much as thirteen without.
    """
    known = [stated(each, params) for each in courses]

    def gap(kind: int, choice: Params) -> float:
        inside = [each.inside(choice)[kind] for each in known]
        return sum(
            abs(float(np.mean(shares)) - INSIDE)
            for shares in by_group(courses, inside).values()
        )

    found = dict(params)
    for kind, names in enumerate((TILT, HEADING)):
        choices = draws(names, count, seed + kind)
        best = min(choices, key=lambda choice, kind=kind: gap(kind, choice))
        found |= {name: best[name] for name in names}
    return found


def by_group(courses: Sequence[Course], values: Sequence[T]) -> dict[str, list[T]]:
    """What belongs to the trials of each group that occurs."""
    found = {
        name: [
            value
            for each, value in zip(courses, values, strict=True)
            if each.trial.is_in(name)
        ]
        for name in scoring.GROUPS
    }
    return {name: members for name, members in found.items() if members}


@dataclass(frozen=True, slots=True)
class Judged:
    """What parameters do on some trials."""

    ratios: Ratios
    coverage: Mapping[str, Coverage]  # by group


def judged(
    courses: Sequence[Course], pairs: Sequence[Pair], shares: Sequence[Coverage]
) -> Judged:
    grouped = by_group(courses, shares).items()
    return Judged(
        ratios(courses, pairs), {name: Coverage.mean(each) for name, each in grouped}
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the tables, writes the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/tune.py --tries 50 --seed 3"
    )
    twin.add_arguments(parser, OUTPUT)
    parser.add_argument("--tries", metavar="N", type=int, default=400, help="sets drawn")
    parser.add_argument("--seed", metavar="N", type=int, default=1)
    parser.add_argument(
        "--vary",
        metavar="NAME",
        nargs="+",
        choices=twin.NAMES,
        default=ESTIMATE,
        help=f"what is drawn of the estimate (default: {' '.join(ESTIMATE)})",
    )
    args = parser.parse_args(argv)
    paths = twin.find(args)
    if not paths:
        return 0
    courses = twin.load_all(paths, twin.load, args.jobs)
    folds = [
        name for name in scoring.FOLDS if any(each.trial.is_in(name) for each in courses)
    ]
    if len(folds) < 2:
        print("this takes recordings of two folds at least", file=sys.stderr)
        return 2
    tries = draws(args.vary, args.tries, args.seed)
    # The firmware's own come last.
    pairs = measure(courses, [*tries, twin.defaults()], args.jobs)
    chosen = {}
    for fold in folds:
        others = [i for i, each in enumerate(courses) if not each.trial.is_in(fold)]
        chosen[fold] = choose(courses, others, tries, pairs, args.seed)
    document = report_folds(courses, chosen, pairs)
    document |= {"tries": args.tries, "seed": args.seed, "vary": args.vary}
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(report.plain(document), indent=1) + "\n")
    return 0
