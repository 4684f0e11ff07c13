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
import multiprocessing
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy import report
from benchmarks.accuracy.report import Result
from benchmarks.common import engines, scoring
from benchmarks.common.boards import BOARDS, IMAGES, NANO
from benchmarks.common.capture import Capture
from benchmarks.common.capture import run as run_image
from benchmarks.common.engines import HOST, VQF, Estimate
from benchmarks.common.feed import sampled, with_bias
from benchmarks.common.figure import Figure
from benchmarks.common.images import RunFailed
from benchmarks.common.paths import RESULTS
from benchmarks.common.scoring import Coverage, Score, Trial
from imud.errors import ImudError
from imud.params.trusted import CALIBRATED
from imud.progress import Progress

ENGINES = (*IMAGES, *engines.ENGINES)

# A magnet on the probe. The figure of all eight diagonals is the mean; with
# --body-bias the image, and all that is beside it, feels the first of them.
BODY_BIAS_UT = 2.8
DIAGONALS = np.array(list(itertools.product((1.0, -1.0), repeat=3))) / math.sqrt(3.0)

# The trial whose errors over time are kept for the picture: a walk in an office.
TRACED = "37"
TRACE_HZ = 10.0


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings for every trial."""

    board: str
    engines: tuple[str, ...]
    body_bias_ut: float  # 0: as recorded
    traced: str


def measure(path: Path, settings: Settings) -> Result:
    """Run every engine on one recording and score it."""
    trial = scoring.load_trial(path)
    if settings.body_bias_ut:
        bias_ut = settings.body_bias_ut * DIAGONALS[0]
        trial = replace(trial, motion=with_bias(trial.motion, bias_ut))
    image = settings.board
    capture = run(trial, settings) if image in settings.engines else None
    chip = BOARDS[image].chip
    feed = capture.feed if capture else sampled(trial.motion, chip)
    estimates: dict[str, Estimate] = {}
    again: list[bytes] = []
    for name in settings.engines:
        if name == image and capture:
            estimates[name] = engines.poses(feed.pose_times_s, capture.pose_contents)
        elif name == HOST:
            again = engines.replayed(feed, engines.MAIN)
            estimates[name] = engines.poses(feed.pose_times_s, again)
        else:
            estimates[name] = engines.ENGINES[name](feed)
    sent = capture.pose_contents if capture and again else []
    is_traced = trial.name.startswith(settings.traced)
    return Result(
        trial=replace(trial, motion=trial.motion[:0]),
        scores={name: score(each, trial) for name, each in estimates.items()},
        coverage={
            name: coverage(estimates[name], trial)
            for name in (image, HOST)
            if name in estimates
        },
        biased=biased(trial, settings),
        trace=trace(estimates, trial) if is_traced else None,
        poses=len(sent),
        unequal=sum(one != other for one, other in zip(sent, again, strict=False)),
        lost=capture.lost if capture else 0,
        summary=capture.summary if capture else {},
    )


def run(trial: Trial, settings: Settings) -> Capture:
    """Run the image on a trial, as recorded or with a magnet on the probe."""
    if not settings.body_bias_ut:
        return run_image(settings.board, trial.path, params=CALIBRATED)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{trial.name}.npz"
        trial.motion.save(path)
        return run_image(settings.board, path, params=CALIBRATED)


def score(estimate: Estimate, trial: Trial) -> Score:
    return scoring.score_at(estimate.times_s, estimate.quats, trial.motion)


def coverage(estimate: Estimate, trial: Trial) -> Coverage:
    tilt, heading = estimate.tilt_sigma_deg, estimate.heading_sigma_deg
    assert tilt is not None
    assert heading is not None
    return scoring.coverage_at(
        estimate.times_s, estimate.quats, tilt, heading, trial.motion
    )


def biased(trial: Trial, settings: Settings) -> dict[str, Score]:
    """Means over magnets in eight directions, our C beside VQF on the same samples."""
    names = [name for name in (HOST, VQF) if name in settings.engines]
    if len(names) < 2:
        return {}
    bias_ut = settings.body_bias_ut or BODY_BIAS_UT
    # --body-bias has been added to the motion already.
    own_ut = settings.body_bias_ut * DIAGONALS[0]
    scores: dict[str, list[Score]] = {name: [] for name in names}
    for direction in DIAGONALS:
        moved = with_bias(trial.motion, bias_ut * direction - own_ut)
        feed = sampled(moved, BOARDS[settings.board].chip)
        for name in names:
            scores[name].append(score(engines.ENGINES[name](feed), trial))
    return {name: Score.mean(each) for name, each in scores.items()}


def trace(estimates: Mapping[str, Estimate], trial: Trial) -> dict[str, Any]:
    """Errors over time, ten a second; null where the optics saw nothing."""
    times = np.arange(0.0, trial.motion.seconds, 1.0 / TRACE_HZ)
    errors: dict[str, dict[str, list[float]]] = {}
    for name, estimate in estimates.items():
        nearest = np.searchsorted(estimate.times_s, times)
        nearest = nearest.clip(max=len(estimate.times_s) - 1)
        found = scoring.errors_at(
            estimate.times_s[nearest], estimate.quats[nearest], trial.motion
        )
        errors[name] = {
            kind: np.round(values, 3).tolist() for kind, values in asdict(found).items()
        }
    return {
        "trial": trial.name,
        "t_s": np.round(times, 3).tolist(),
        "moving": scoring.counted(times, trial.motion).tolist(),
        "errors_deg": errors,
    }


def live(result: Result) -> str:
    """The line that is printed as soon as a trial is done."""
    totals = ", ".join(
        f"{name} {result.scores[name].total:.2f}"
        for name in (*IMAGES, HOST, VQF)
        if name in result.scores
    )
    if not result.summary:
        return f"{result.trial.name:46}{totals}"
    crash = ", CRASHED" if result.summary["crashed"] else ""
    return (
        f"{result.trial.name:46}{totals}; lost {result.lost}, "
        f"late {result.summary['late']}, "
        f"worst {result.summary['cycles_worst']} cycles{crash}"
    )


def parse(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="examples: benchmarks/accuracy/recordings.py --trials 07 32; "
        "benchmarks/accuracy/recordings.py --host-only",
    )
    scoring.add_arguments(parser)
    parser.add_argument(
        "--board",
        choices=BOARDS,
        default=NANO.name,
        help="whose image, and at whose rate (default: %(default)s)",
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
    parser.add_argument(
        "--body-bias",
        metavar="UT",
        type=float,
        default=0.0,
        help="a magnet on the probe: a constant field of this many uT in its frame, "
        f"along 1 1 1; one ratio averages eight diagonals ({BODY_BIAS_UT:g} uT of it "
        "without this option)",
    )
    parser.add_argument(
        "--trace",
        metavar="NAME",
        default=TRACED,
        help="trial whose errors over time go into the JSON (default: %(default)s)",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        type=Path,
        help="default: accuracy-BOARD.json, of the Nano accuracy.json",
    )
    args = parser.parse_args(argv)
    others = set(IMAGES) - {args.board}
    args.engines = args.engines or [each for each in ENGINES if each not in others]
    if others & set(args.engines):
        parser.error(f"the image is that of --board {args.board}")
    name = "" if args.board == NANO.name else f"-{args.board}"
    args.output = args.output or RESULTS / f"accuracy{name}.json"
    return args


def measure_all(paths: Sequence[Path], args: argparse.Namespace) -> list[Result]:
    """Measure all trials, `--jobs` at a time; print a line for each when it is done."""
    task = partial(
        measure,
        settings=Settings(args.board, tuple(args.engines), args.body_bias, args.trace),
    )
    progress = Progress(f"{len(paths)} recordings", len(paths))
    results = []
    # Processes, because other filters are Python and would share one interpreter lock.
    with ProcessPoolExecutor(
        min(args.jobs, len(paths)), multiprocessing.get_context("spawn")
    ) as pool:
        for result in pool.map(task, paths):
            results.append(result)
            progress.wipe()
            print(live(result), flush=True)
            progress.advance()
    progress.end()
    return results


def main(argv: Sequence[str] | None = None) -> int:
    """Print the tables and write the JSON; return 1 if a required figure is missed."""
    args = parse(argv)
    absent = [path for path in args.paths if not path.exists()]
    if absent:
        print(f"skipped: no recordings at {absent[0]}; see docs/motion-files.md")
        return 0
    paths = scoring.find_trials(args.paths, args.trials)
    if not paths:
        print("no recording has such a name", file=sys.stderr)
        return 2
    results = measure_all(paths, args)
    asked = {"board": args.board, "engines": args.engines}
    asked["body_bias_ut"] = args.body_bias
    report.write(results, asked, args.output)
    report.print_tables(results, args.engines)
    # The figures are of all the public trials as they are, and of no others.
    count = sum(report.members(results, tuple(scoring.FOLDS)).values())
    is_judged = count == scoring.TRIALS == len(results) and not args.body_bias
    found = list(report.figures(results))
    if found:
        report.print_figures(found, is_judged=is_judged)
    return end(results, found if is_judged else [], args.board)


def end(results: Sequence[Result], judged: Sequence[Figure], image: str) -> int:
    """Print the last lines; return the exit code."""
    missed = sum(figure.verdict == "MISSED" for figure in judged)
    unequal = sum(result.unequal for result in results)
    lost = sum(result.lost for result in results)
    runs = [result.summary for result in results if result.summary]
    crashed = sum(bool(each["crashed"]) for each in runs)
    print()
    if runs:
        late = sum(each["late"] for each in runs)
        print(f"{crashed} crashes, {lost} samples or messages lost, {late} late")
    if any(result.poses for result in results):
        poses = sum(result.poses for result in results)
        print(
            f"{HOST} and {image}: {poses} poses, "
            + (f"{unequal} DIFFER" if unequal else "equal in every bit")
        )
    if missed:
        print(f"{missed} figures are outside their limits")
    return 1 if crashed or lost or unequal or missed else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"accuracy: {error}")
