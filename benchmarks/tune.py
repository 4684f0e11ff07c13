# SPDX-License-Identifier: MIT
"""What the choice of parameters is worth off the recordings that it was made on.

Draws parameters around the firmware's, and for each fold of the recordings takes those
that do best on the other folds; then, for the stated errors, those that hold nearest to
95 % of the true ones. Reports them on the fold that had no say, beside the firmware's.
Those take no part in the choice: they were made with all recordings in sight.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from operator import methodcaller
from typing import TypeVar

import numpy as np
import report
import scoring
import twin
from scoring import Coverage, Score
from twin import Course, Pair, Params

from imud.progress import Progress
from imud.rotation import FloatArray

OUTPUT = twin.BUILD / "tune.json"

# What is drawn: for the estimate, and for how sure of it the filter says it is.
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
FACTOR = 2.0  # at most, each way

TOTAL_GOAL, BIASED_GOAL = 0.65, 0.55  # of VQF's
INSIDE = 0.95

ALL = "all, each off its own"

T = TypeVar("T")


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
    """Ours over VQF's, of means over trials."""

    total: float
    inclination: float
    biased: float  # total, with a magnet on the probe

    @property
    def cost(self) -> float:
        return self.total / TOTAL_GOAL + self.biased / BIASED_GOAL

    def __str__(self) -> str:
        return f"{self.total:.2f}  {self.inclination:.2f}  {self.biased:.2f}"


def ratios(ours: Iterable[Pair], vqf: Iterable[Pair]) -> Ratios:
    (mine, mine_biased), (other, other_biased) = means(ours), means(vqf)
    return Ratios(
        mine.total / other.total,
        mine.inclination / other.inclination,
        mine_biased.total / other_biased.total,
    )


def means(pairs: Iterable[Pair]) -> tuple[Score, Score]:
    plain, biased = zip(*pairs, strict=True)
    return Score.mean(plain), Score.mean(biased)


@dataclass(frozen=True, slots=True)
class Terms:
    """True errors, and what stated ones are the sums of squares of; degrees."""

    tilt: FloatArray
    heading: FloatArray
    rate: FloatArray  # tilt, of a tilt_rate of 1
    across: FloatArray  # heading, of all the field's covariance
    leaning: FloatArray  # heading, of a level_error of 1

    @staticmethod
    def of(course: Course, params: Params) -> Terms:
        none = dict(params) | dict.fromkeys((*TILT, *HEADING), 0.0)
        one, other = (
            course.track(none | dict.fromkeys(names, 1.0), course.samples)
            for names in (("tilt_rate", "covariance_share"), ("level_error",))
        )
        found = scoring.errors(one.quats, course.truth)
        terms = (*one.sigmas_deg.T, other.sigmas_deg[:, 1])
        rows = np.stack([found.inclination, found.heading, *terms])
        return Terms(*rows[:, np.isfinite(rows).all(axis=0)])

    def tilt_inside(self, params: Params) -> float:
        squares = params["tilt_floor"] ** 2 + params["tilt_rate"] ** 2 * self.rate**2
        return share_inside(self.tilt, squares)

    def heading_inside(self, params: Params) -> float:
        squares = (
            params["heading_floor"] ** 2
            + params["covariance_share"] * self.across**2
            + params["level_error"] ** 2 * self.leaning**2
        )
        return share_inside(self.heading, squares)


def share_inside(errors: FloatArray, squares: FloatArray) -> float:
    return float(np.mean(errors**2 <= scoring.SIGMAS**2 * squares))


def coverage(course: Course, params: Params) -> Coverage:
    """How often the errors keep within what the filter states."""
    track = course.track(params, course.samples)
    found = scoring.errors(track.quats, course.truth)
    shares, nulls = [], []
    for error, sigma in zip(
        (found.inclination, found.heading), track.sigmas_deg.T, strict=True
    ):
        is_stated = np.isfinite(error) & np.isfinite(sigma)
        shares.append(share_inside(error[is_stated], sigma[is_stated] ** 2))
        nulls.append(float(1.0 - is_stated.sum() / np.isfinite(error).sum()))
    return Coverage(*shares, *nulls)


def by_group(courses: Sequence[Course], values: Iterable[T]) -> dict[str, list[T]]:
    """What belongs to the trials of each group that occurs."""
    found: dict[str, list[T]] = {}
    for course, value in zip(courses, values, strict=True):
        for name in scoring.GROUPS:
            if course.trial.is_in(name):
                found.setdefault(name, []).append(value)
    return found


def honest(
    courses: Sequence[Course], params: Params, count: int, seed: int
) -> dict[str, float]:
    """The same with stated errors that hold nearest to 95 % of the true ones.

    Of each group alike: three trials with a magnet count as much as 13 without.
    """
    terms = [Terms.of(course, params) for course in courses]
    found = dict(params)
    for names, inside in ((TILT, "tilt_inside"), (HEADING, "heading_inside")):

        def gap(choice: Params, inside: str = inside) -> float:
            shares = map(methodcaller(inside, choice), terms)
            groups = by_group(courses, shares).values()
            return sum(abs(float(np.mean(group)) - INSIDE) for group in groups)

        best = min(draws(names, count, seed), key=gap)
        found |= {name: best[name] for name in names}
    return found


def measure(
    courses: Sequence[Course], tries: Sequence[Params], jobs: int
) -> list[list[Pair]]:
    """Scores by set of parameters, then by course."""
    progress = Progress(f"{len(tries)} sets of parameters", len(tries))
    found = []
    with ThreadPoolExecutor(jobs) as pool:
        for params in tries:
            found.append(list(pool.map(methodcaller("score", params), courses)))
            progress.advance()
    progress.end()
    return found


@dataclass(frozen=True, slots=True)
class Entry:
    """What one set of parameters does on one trial."""

    course: Course
    params: Params
    pair: Pair

    @property
    def coverage(self) -> Coverage:
        return coverage(self.course, self.params)


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the tables: some trials."""

    ratios: Ratios
    coverage: Mapping[str, Coverage]  # by group

    @staticmethod
    def of(entries: Sequence[Entry]) -> Row:
        courses = [each.course for each in entries]
        shares = by_group(courses, (each.coverage for each in entries))
        return Row(
            ratios((e.pair for e in entries), (c.vqf for c in courses)),
            {name: Coverage.mean(each) for name, each in shares.items()},
        )


def held_out(
    courses: Sequence[Course],
    tries: Sequence[Params],
    pairs: Sequence[Sequence[Pair]],
    seed: int,
) -> dict[str, list[Entry]]:
    """By fold, its trials with what the other folds chose."""
    found = {}
    for fold in scoring.FOLDS:
        is_held = [course.trial.is_in(fold) for course in courses]
        others = [index for index, held in enumerate(is_held) if not held]
        if not others or len(others) == len(courses):
            continue
        vqf = [courses[index].vqf for index in others]
        costs = [ratios((row[i] for i in others), vqf).cost for row in pairs]
        best = int(np.argmin(costs))
        trained = [courses[index] for index in others]
        params = honest(trained, tries[best], len(tries), seed)
        found[fold] = [
            Entry(course, params, pair)
            for course, pair, held in zip(courses, pairs[best], is_held, strict=True)
            if held
        ]
    return found


def print_rows(rows: Mapping[str, Mapping[str, Row]]) -> None:
    """The tables: who, then fold."""
    folds = list(next(iter(rows.values())))
    report.print_table(
        "ours / VQF: total, inclination, total with "
        f"{twin.BODY_BIAS_UT:g} uT in the body",
        folds,
        {who: [str(row[fold].ratios) for fold in folds] for who, row in rows.items()},
    )
    for group in scoring.GROUPS:
        report.print_table(
            f"{group}: errors inside {scoring.SIGMAS:g} sigma, %: tilt, heading "
            "(poses that state none)",
            folds,
            {
                who: [str(row[fold].coverage.get(group, "")) for fold in folds]
                for who, row in rows.items()
            },
        )


def print_params(params: Mapping[str, Params], names: Iterable[str]) -> None:
    """What was chosen, beside the firmware's."""
    report.print_table(
        "parameters chosen on the others of",
        [fold if fold != ALL else "the firmware's" for fold in params],
        {name: [f"{each[name]:.3g}" for each in params.values()] for name in names},
    )


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, epilog="example: benchmarks/tune.py --tries 50 --seed 3"
    )
    twin.add_arguments(parser, OUTPUT)
    parser.add_argument("--tries", metavar="N", type=int, default=400)
    parser.add_argument("--seed", metavar="N", type=int, default=1)
    parser.add_argument(
        "--vary",
        metavar="NAME",
        nargs="+",
        choices=twin.NAMES,
        default=ESTIMATE,
        help=f"what is drawn for the estimate (default: {' '.join(ESTIMATE)})",
    )
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the tables, writes the JSON."""
    args = parse(argv)
    paths = twin.find(args)
    if not paths:
        return 0
    courses = twin.load_all(paths, twin.load, args.jobs)
    tries = draws(args.vary, args.tries, args.seed)
    *pairs, own = measure(courses, [*tries, twin.defaults()], args.jobs)
    chosen = held_out(courses, tries, pairs, args.seed)
    if not chosen:
        print("nothing to hold out: these are of one fold", file=sys.stderr)
        return 2
    known = {
        course.trial.name: Entry(course, twin.defaults(), pair)
        for course, pair in zip(courses, own, strict=True)
    }
    chosen[ALL] = [entry for fold in chosen.values() for entry in fold]
    rows = {
        "chosen": {fold: Row.of(entries) for fold, entries in chosen.items()},
        "the firmware's": {
            fold: Row.of([known[each.course.trial.name] for each in entries])
            for fold, entries in chosen.items()
        },
    }
    params = {fold: entries[0].params for fold, entries in chosen.items()}
    params = params | {ALL: twin.defaults()}
    print_rows(rows)
    print_params(params, [*args.vary, *TILT, *HEADING])
    vqf = [course.vqf for course in courses]
    costs = [ratios(row, vqf).cost for row in pairs]
    better = sum(cost < ratios(own, vqf).cost for cost in costs)
    print(f"\n{better} of {len(tries)} beat the firmware's with all trials in sight")
    document = {
        "tries": args.tries,
        "seed": args.seed,
        "vary": args.vary,
        "better_in_sight": better,
        "rows": {
            who: {fold: asdict(each) for fold, each in row.items()}
            for who, row in rows.items()
        },
        "params": params,
    }
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(report.plain(document), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
