# SPDX-License-Identifier: MIT
"""Cross-validation: how well chosen parameters do on recordings left out of the choice.

Draws parameters around the firmware's. For each fold of the recordings it takes those
with the smallest errors on the other folds, then those whose stated errors hold nearest
to 95 % of the true ones there, and reports both on the fold left out, beside the
firmware's. The firmware's own take no part: they were chosen with all recordings.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from operator import methodcaller

import numpy as np
import report
import scoring
import twin
from scoring import Coverage, Score
from stated import HEADING, TILT, by_group, coverage, draws, honest
from twin import Course, Pair, Params

from imud.progress import Progress

OUTPUT = twin.BUILD / "tune.json"

# The parameters of the estimate, drawn where the command line names no others.
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

TOTAL_GOAL, BIASED_GOAL = 0.65, 0.55  # of VQF's

ALL = "all, each off its own"


@dataclass(frozen=True, slots=True)
class Ratios:
    """Our errors divided by VQF's, means over trials."""

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


def measure(
    courses: Sequence[Course], tries: Sequence[Params], jobs: int
) -> list[list[Pair]]:
    """Score every course with every set of parameters."""
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
    """Scores of one set of parameters on one trial."""

    course: Course
    params: Params
    pair: Pair

    @property
    def coverage(self) -> Coverage:
        return coverage(self.course, self.params)


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the tables: means over some trials."""

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
    """For each fold its trials, with the parameters that the other folds chose."""
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
    """Print the tables, from rows by parameters' origin, then by fold."""
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
    """Print the chosen parameters beside the firmware's."""
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
    """Print the tables and write the JSON."""
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
