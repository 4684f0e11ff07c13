# SPDX-License-Identifier: MIT
"""The value of each part of the filter: its errors with that part taken away.

Uses the twin in doubles, on samples that the host simulates from the recordings or,
with --made, from made motions.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from operator import methodcaller
from pathlib import Path

import numpy as np
import report
import scoring
import twin
import wire
from feed import MPU9250, Feed, sampled
from groups_report import MAGNET, row_of
from scoring import Score
from twin import Course, Pair, Params

from imud.progress import Progress
from imud.virtual.motions.groups import GROUPS, SETS, Recipe, recipes

OUTPUT = twin.BUILD / "without.json"

WHOLE, VQF = "whole filter", "vqf, defaults"
NOTHING = 1e-3  # uT: a covariance of 0 has no inverse
FOREVER = 1e9  # a noise or a unit so large that what it scales has no weight

PARTS: dict[str, Params] = {
    WHOLE: {},
    "scales": {"scale_sd": 0.0},
    # The field tells nothing of the gyroscope; turning does not widen the heading's.
    "told by field": {"turning_share": FOREVER},
    "warming up": {"warm_wander": 0.0},
    # The level is as sure as if levelling corrected nothing.
    "level's error": {"field_drift": 0.0, "turning_drift": 0.0, "motion_drift": 0.0},
    # Any surprising reading may free the probe's own field.
    "length gate": {"astray_length": 0.0},
    "hard iron": {"own_sd": NOTHING, "astray_wander": 0.0},
    "freeing it": {"astray_wander": 0.0},
    # Nothing but readings tells of the probe's own field.
    "no magnet": {"own_doubt": FOREVER},
    # Keep the initial estimate of the lag; assume no lag.
    "lag learned": {"lag_sd": 0.0},
    "field's lag": {"lag_s": 0.0, "lag_sd": 0.0},
    "lead": {"lead_share": 0.0},
    # All readings weigh the same; none counts as disturbed or turned.
    "soft weights": {"surprise": FOREVER},
    "rest factor": {"rest_factor": 1.0},
    "turned rule": {"turned_wander": twin.defaults()["heading_wander"]},
    # The first field of a place is as uncertain as that of a moving probe.
    "field at rest": {"place_sd": 3.0},
    # Levelling informs neither bias nor scale; rest still does.
    "bias by motion": {"motion_noise": FOREVER},
    # Keep the calibration's result, if there is one.
    "bias": {"bias_sd": 0.0},
}
# Parts that are also measured without the calibration at start-up.
UNCALIBRATED = (WHOLE, "scales", "bias by motion", "bias")

BIASED = f"all, {twin.BODY_BIAS_UT:g} uT in the body"

# In that case: start so long after the movement began, with such a gyroscope bias.
BEGUN_AFTER_S = 2.0
BIAS_DEG_S = (0.57, -0.46, 0.34)

MADE = (*GROUPS, MAGNET)

Table = dict[str, dict[str, Score]]


def measure(courses: Sequence[Course], parts: Sequence[str], jobs: int) -> Table:
    """Scores by missing part, then by group."""
    progress = Progress(f"{len(parts)} parts", len(parts))
    table: Table = {}
    with ThreadPoolExecutor(jobs) as pool:
        for part in parts:
            score = methodcaller("score", twin.defaults() | dict(PARTS[part]))
            table[part] = means(courses, list(pool.map(score, courses)))
            progress.advance()
    progress.end()
    return table | {VQF: means(courses, [each.vqf for each in courses])}


def means(courses: Sequence[Course], pairs: Sequence[Pair]) -> dict[str, Score]:
    """Means over all trials, each group that occurs, and all trials with a magnet."""
    found = {}
    made = (name for each in courses for name in each.trial.groups if name in MADE)
    for name in dict.fromkeys(("all", *scoring.GROUPS, *made)):
        members = [
            score
            for each, (score, _) in zip(courses, pairs, strict=True)
            if each.trial.is_in(name) or name in each.trial.groups
        ]
        if members:
            found[name] = Score.mean(members)
    biased = [score for _, score in pairs if score]
    if biased:
        found[BIASED] = Score.mean(biased)
    return found


def load_in_motion(path: Path) -> Course:
    """Load a trial from the middle of its movement, with an uncalibrated gyroscope."""
    trial = scoring.load_trial(path)
    feed = sampled(trial.motion)
    is_moving = scoring.counted(feed.times_s, trial.motion)
    first = int(np.argmax(is_moving)) + round(BEGUN_AFTER_S * MPU9250.rate_hz)
    rows = feed.rows[first:].copy()
    rows["gyr"] += np.rint(np.radians(BIAS_DEG_S) / MPU9250.gyr_lsb).astype(np.int16)
    after = [index - first for index in feed.pose_after if index >= first]
    begun = Feed(feed.hello, wire.to_contents(rows), after, after, feed.start_us)
    after_s = float(begun.times_s[0]) + twin.STARTING_S
    return twin.course(trial, begun, is_calibrated=False, after_s=after_s)


def load_made(recipe: Recipe) -> Course:
    """Make a recording of docs/motions.md."""
    motion = recipe.made()
    trial = scoring.Trial(Path(str(recipe)), motion, (row_of(recipe),))
    return twin.course(trial, sampled(motion))


def print_table(title: str, table: Table) -> None:
    report.print_table(
        f"{title}; total, heading, inclination error, degrees rms",
        list(table[WHOLE]),
        {name: [str(score) for score in row.values()] for name, row in table.items()},
    )


def of_recordings(args: argparse.Namespace) -> dict[str, Table]:
    """Print and return the tables of recordings; none if there are none."""
    paths = twin.find(args)
    if not paths:
        return {}
    tables = {}
    for name, title, load, parts in (
        ("calibrated", "without", twin.load, tuple(PARTS)),
        ("uncalibrated", "begun in motion, without", load_in_motion, UNCALIBRATED),
    ):
        courses = twin.load_all(paths, load, args.jobs)
        tables[name] = measure(courses, parts, args.jobs)
        print_table(title, tables[name])
    return tables


def of_made(args: argparse.Namespace) -> dict[str, Table]:
    """Print and return the table of made motions."""
    courses = twin.load_all(list(recipes(args.made)), load_made, args.jobs)
    table = measure(courses, tuple(PARTS), args.jobs)
    print_table(f"{args.made}, without", table)
    return {args.made: table}


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables and write the JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="examples: benchmarks/without.py --trials 07 32; "
        "benchmarks/without.py --made tuning",
    )
    twin.add_arguments(parser, OUTPUT)
    parser.add_argument(
        "--made",
        metavar="SET",
        choices=SETS,
        help=f"made motions instead of recordings: {' or '.join(SETS)}",
    )
    args = parser.parse_args(argv)
    tables = of_made(args) if args.made else of_recordings(args)
    if not tables:
        return 0
    document = {"parts": PARTS, "scores_deg": tables}
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(report.plain(document), indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
