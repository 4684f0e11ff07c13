# SPDX-License-Identifier: MIT
"""Orientation error of an image on recordings with optical truth, and of other filters.

Each recording moves a virtual board, a Nano at 200 samples a second or an STM32F405 at
380, which runs the same image as real boards. Its poses are scored, and so are those of
each filter of engines.py from the same samples. Without the engine named after the
board no image runs and the samples are simulated: seconds instead of minutes.
"""

from __future__ import annotations

import argparse
import itertools
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.common import engines, scoring
from benchmarks.common.boards import BOARDS, IMAGES
from benchmarks.common.capture import run as run_image
from benchmarks.common.engines import HOST, OFFLINE, PAPERS, VQF, Estimate
from benchmarks.common.feed import sampled, with_bias
from benchmarks.common.paths import RECORDINGS
from benchmarks.common.scoring import Coverage, Score, Trial
from benchmarks.harness import Figure, Report, Table, degrees, ratio
from imud.params.trusted import CALIBRATED

ENGINES = (*IMAGES, *engines.ENGINES)
GROUPS = (*scoring.GROUPS, "all")

# A magnet on the probe: the figure is the mean of all eight diagonals.
BODY_BIAS_UT = 2.8
DIAGONALS = np.array(list(itertools.product((1.0, -1.0), repeat=3))) / math.sqrt(3.0)

# The trial whose errors over time are kept for the picture: a walk in an office.
TRACED = "37"
TRACE_HZ = 10.0


@dataclass(frozen=True, slots=True)
class Result:
    """Scores of one trial by engine, and the course of its run."""

    trial: Trial  # its motion cut down to nothing
    scores: Mapping[str, Score]
    coverage: Mapping[str, Coverage]
    biased: Mapping[str, Score]  # with a magnet on the probe
    trace: Mapping[str, Any] | None
    poses: int  # of the image that were recomputed on this machine
    unequal: int  # of those, with different bits
    lost: int
    crashed: int


def measure(path: Path, board: str, names: Sequence[str]) -> Result:
    """Run every engine on one recording and score it."""
    trial = scoring.load_trial(path)
    chip = BOARDS[board].chip
    capture = None
    if board in names:
        capture = run_image(board, trial.path, params=CALIBRATED)
    feed = capture.feed if capture else sampled(trial.motion, chip)
    estimates: dict[str, Estimate] = {}
    again: list[bytes] = []
    for name in names:
        if name == board and capture:
            estimates[name] = engines.poses(feed.pose_times_s, capture.pose_contents)
        elif name == HOST:
            again = engines.replayed(feed, engines.MAIN)
            estimates[name] = engines.poses(feed.pose_times_s, again)
        else:
            estimates[name] = engines.ENGINES[name](feed)
    sent = capture.pose_contents if capture and again else []
    return Result(
        trial=replace(trial, motion=trial.motion[:0]),
        scores={name: score(each, trial) for name, each in estimates.items()},
        coverage={
            name: scoring.coverage_at(estimates[name], trial.motion)
            for name in (board, HOST)
            if name in estimates
        },
        biased=biased(trial, board) if {HOST, VQF} <= {*names} else {},
        trace=trace(estimates, trial) if trial.name.startswith(TRACED) else None,
        poses=len(sent),
        unequal=sum(one != other for one, other in zip(sent, again, strict=False)),
        lost=capture.lost if capture else 0,
        crashed=bool(capture and capture.summary["crashed"]),
    )


def score(estimate: Estimate, trial: Trial) -> Score:
    return scoring.score_at(estimate.times_s, estimate.quats, trial.motion)


def biased(trial: Trial, board: str) -> dict[str, Score]:
    """Means over magnets in eight directions, our C beside VQF on the same samples."""
    scores: dict[str, list[Score]] = {HOST: [], VQF: []}
    for direction in DIAGONALS:
        moved = with_bias(trial.motion, BODY_BIAS_UT * direction)
        feed = sampled(moved, BOARDS[board].chip)
        for name, found in scores.items():
            found.append(score(engines.ENGINES[name](feed), trial))
    return {name: Score.mean(each) for name, each in scores.items()}


def trace(estimates: Mapping[str, Estimate], trial: Trial) -> dict[str, Any]:
    """Errors over time, ten a second; NaN where the optics saw nothing."""
    times = np.arange(0.0, trial.motion.seconds, 1.0 / TRACE_HZ)
    errors: dict[str, list[float]] = {}
    for name, estimate in estimates.items():
        nearest = np.searchsorted(estimate.times_s, times)
        nearest = nearest.clip(max=len(estimate.times_s) - 1)
        found = scoring.errors_at(
            estimate.times_s[nearest], estimate.quats[nearest], trial.motion
        )
        errors[name] = np.round(found.total, 3).tolist()
    return {
        "trial": trial.name,
        "t_s": np.round(times, 3).tolist(),
        "moving": scoring.counted(times, trial.motion).tolist(),
        "errors_deg": errors,
    }


def average(results: Sequence[Result], group: str) -> dict[str, Score]:
    """The mean over the trials of a group, engine by engine; empty without any."""
    return Score.means([each.scores for each in results if each.trial.is_in(group)])


def figures(results: Sequence[Result]) -> Iterator[Figure]:
    """The required figures that can be computed from these engines."""
    means = {group: average(results, group) for group in GROUPS}
    every, disturbed = means["all"], means["disturbed"]
    ours = next((name for name in IMAGES if name in every), HOST)
    mine = every[ours]
    if VQF in every:
        other, theirs = every[VQF], disturbed[VQF]
        heading = disturbed[ours].heading
        tilts = mine.inclination, other.inclination
        yield ratio("total / VQF", mine.total, other.total, 0.64, 0.58)
        yield ratio("inclination / VQF", *tilts, 0.92, 0.80)
        name = "heading / VQF, disturbed group"
        yield ratio(name, heading, theirs.heading, 0.75, 0.50)
        yield degrees("heading, disturbed group, deg", heading, 1.40, 1.25)
        yield degrees("heading less its mean, deg", mine.varying, 0.80, 0.75)
        both = Score.means([result.biased for result in results])
        name = "total / VQF, a magnet on the probe"
        yield ratio(name, both[HOST].total, both[VQF].total, 0.75, 0.55)
    total = means["attached magnet"][ours].total
    yield degrees("total, attached magnet, deg", total, 1.40, 1.15)
    if OFFLINE in every:
        other = every[OFFLINE]
        tilts = mine.inclination, other.inclination
        yield ratio("total / offline VQF", mine.total, other.total, math.inf, 1.0)
        yield ratio("inclination / offline VQF", *tilts, math.inf, 1.0)
    for group in GROUPS:
        shares = [each.coverage for each in results if each.trial.is_in(group)]
        mean = Coverage.mean([share[ours] for share in shares])
        for kind in ("tilt", "heading"):
            value = 100.0 * getattr(mean, kind)
            name = f"{kind} inside {scoring.SIGMAS:g} sigma, %, {group}"
            yield Figure(name, value, (88.0, 100.0), (93.0, 98.0))
    # Whether the stated errors inform: their medians divided by the true errors.
    for kind, sigma, error in (
        ("tilt", mean.tilt_sigma_deg, mine.inclination),
        ("heading", mean.heading_sigma_deg, mine.heading),
    ):
        yield ratio(f"{kind}, median stated / true rms", sigma, error, 2.0, 1.3)
    value = 100.0 * mean.heading_null
    yield Figure("heading withheld, %", value, (0.0, 1.0), (0.0, 0.5))


def of_images(results: Sequence[Result]) -> Iterator[Figure]:
    """What must not be."""
    poses = sum(each.poses for each in results)
    for name, counts, detail in (
        ("poses of other bits than here", "unequal", f"of {poses}"),
        ("samples and messages lost", "lost", ""),
        ("images that crashed", "crashed", f"of {len(results)}"),
    ):
        count = sum(getattr(each, counts) for each in results)
        yield Figure(name, count, (0, 0), (0, 0), detail)


def tables_of(results: Sequence[Result], board: str) -> list[Table]:
    """Score of each engine, means over trials."""
    means = {group: average(results, group) for group in GROUPS}
    counts = {group: sum(e.trial.is_in(group) for e in results) for group in GROUPS}
    names = [*results[0].scores]
    if board in names:
        names.remove(HOST)  # which computes the same poses
    titles = TITLES | dict.fromkeys((board, HOST), f"imu-probe, {BOARDS[board].title}")
    columns = {f"{group}, {count}": "" for group, count in counts.items() if count}
    rows = {
        name: [titles[name], *(str(found[name]) for found in means.values() if found)]
        for name in names
    }
    return [
        Table(
            "errors",
            {"": ""} | columns,
            [row for name, row in rows.items() if name not in PAPERS],
        ),
        Table(
            "papers",
            {"filter": ""} | columns,
            [row for name, row in rows.items() if name in PAPERS],
        ),
    ]


TITLES = {
    VQF: "VQF in doubles",
    OFFLINE: "VQF offline, which also uses later samples",
    "ahrs-madgwick": "Madgwick (`ahrs`, gain 0.06)",
    "ahrs-mahony": "Mahony (`ahrs`, gain 0.2)",
    "imufusion": "Fusion (`imufusion` with its `Bias`, gain 0.1)",
    "complementary": "complementary, of a thesis",
    "mahony": "Mahony, as NECTEC's paper has it (Kp = 15)",
    "madgwick": "Madgwick",
    "dcm_pi": "Baranek's DCM with PI, which has no magnetometer",
}


def measured(args: argparse.Namespace) -> Report:
    names = args.engines or [e for e in ENGINES if e not in IMAGES or e == args.board]
    absent = [path for path in args.paths if not path.exists()]
    if absent:
        print(f"skipped: no recordings at {absent[0]}; see docs/motions.md")
        sys.exit(0)
    paths = scoring.find_trials(args.paths, args.trials)
    if not paths:
        sys.exit("no recording has such a name")
    task = partial(measure, board=args.board, names=names)
    results = list(harness.each(task, paths, args.jobs, "recordings"))
    found = [*of_images(results)] if args.board in names else []
    # The other figures are of all the public trials, and of no others.
    is_whole = sum(each.trial.is_public for each in results) == scoring.TRIALS
    if is_whole and len(results) == scoring.TRIALS and HOST in names:
        found += figures(results)
    data = {
        "means_deg": {"all": asdicts(average(results, "all"))},
        "trials": {each.trial.name: asdicts(each.scores) for each in results},
        "trace": next((each.trace for each in results if each.trace), None),
    }
    return Report(tables_of(results, args.board), found, data)


def asdicts(scores: Mapping[str, Score]) -> dict[str, dict[str, float]]:
    return {name: asdict(each) for name, each in scores.items()}


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "paths",
        metavar="PATH",
        nargs="*",
        type=Path,
        default=[RECORDINGS],
        help="recordings or folders of them (default: ../shared/data/broad)",
    )
    parser.add_argument(
        "--trials", metavar="NAME", nargs="+", default=[], help="how their names begin"
    )
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument(
        "--engines",
        metavar="NAME",
        nargs="+",
        choices=ENGINES,
        help=f"of {', '.join(ENGINES)} (default: all, with the board's own image)",
    )
    choice.add_argument(
        "--host-only",
        dest="engines",
        action="store_const",
        const=engines.QUICK,
        help=f"no image, and only fast engines: {', '.join(engines.QUICK)}",
    )


main = partial(
    harness.run,
    *("recordings", __doc__, measured),
    harness.options(boards=BOARDS, jobs=2, more=more),
    variants=["board"],
)
