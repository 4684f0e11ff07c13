# SPDX-License-Identifier: MIT
"""How well modules from the shop are calibrated: simulated modules in simulated hands.

Prints tables and writes build/benchmarks/calibration-PART.json for each part: cases,
crowd, shops, rough. A part of size 0 is left out, as in `--modules 0 --shops 0`. Seeds
are kept apart: --sets tuning was used while developing the method, judging was not.
"""

from __future__ import annotations

import argparse
import itertools
import math
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration import asking, rough, shop_trials, simulated
from benchmarks.calibration.cases import CASES, Case, Laid, crowd, laid
from benchmarks.calibration.report import GUIDED, Results, parts_of, show
from benchmarks.common.figure import SETS
from benchmarks.common.paths import RESULTS, write_results
from imud.calibration import poses
from imud.calibration.affine import Affine, MethodError
from imud.calibration.guided import faults, whole
from imud.calibration.guided.events import Finished
from imud.calibration.guided.housing import found as housing_found
from imud.calibration.guided.procedure import Procedure
from imud.calibration.papers.methods import METHODS, by_method
from imud.calibration.recording import Gatherer, SensorRecording
from imud.calibration.stops import find_stops
from imud.cli.calibrate_source import of_file
from imud.progress import Progress
from imud.rotation import FloatArray
from imud.virtual.boards import BOARDS
from imud.virtual.calibrating import RECORDS_HZ, SCALE, Manners, Sampler, pieces
from imud.virtual.modules import named, shop

MODULES = 40
CROWD = 1000
ROUGH = 50
SHOPS = 4  # modules a public recording
CROWD_SEED = 301_000  # the first; the limit of the heading was chosen on those before
BOARDS_JUDGED = ("nano", "f405")
IMAGE_MODULES = 10  # of which the image's samples are used
LONGEST_S = 150.0  # of a hand that is never done
FIT_MODULES = 10  # of which the time is measured


def measure(task: tuple[Case, int]) -> dict[str, Any]:
    """One recording: its errors, its score, and whether it is accepted."""
    found = laid(*task)
    recording = found.recording()
    return _row(task, found, recording, asking.judged(recording))


def of_crowd(task: tuple[Case, int]) -> dict[str, Any]:
    """The same, and the result if the guide asks for more poses; not for hands that
    never let go.
    """
    found = laid(*task)
    recording = found.recording()
    judged = asking.judged(recording)
    row = _row(task, found, recording, judged)
    if row["refused"] in faults.LACKS and not task[0].is_held:
        row["asked"] = asking.laid_as_asked(found, judged)
    return row


def _row(
    task: tuple[Case, int],
    found: Laid,
    recording: SensorRecording,
    judged: asking.Judged,
) -> dict[str, Any]:
    case, seed = task
    fit, fault = judged
    row: dict[str, Any] = {
        "case": case.name,
        "seed": seed,
        "seconds": recording.seconds,
    }
    row["refused"] = fault.kind if fault is not None else None
    if fit is None:
        return row
    row |= simulated.errors(found.module, fit)
    row["limit"] = fit.score.tilt_limit_deg
    row |= {"stated_tilt": fit.score.tilt_deg, "stated": fit.score.heading_deg}
    turn = housing_found(recording, fit) if case.has_housing else None
    if turn is not None:
        row["housing"] = simulated.housing_error(found.module, fit, turn)
    return row


def guided(seed: int) -> dict[str, Any]:
    """A hand that follows the procedure from start to end."""
    random = np.random.default_rng([seed, 0xCA11])
    module = shop(random, 0.0)
    procedure, sampler = Procedure(SCALE), Sampler()
    row: dict[str, Any] = {"case": GUIDED, "seed": seed, "refused": "not over"}
    for piece in pieces("calibrate", module, seed, RECORDS_HZ):
        for event in itertools.chain.from_iterable(
            map(procedure.feed, sampler.samples(piece))
        ):
            if isinstance(event, Finished) and event.turn is not None:
                fit = event.fit
                row |= simulated.errors(module, fit)
                row["refused"] = None
                row["housing"] = simulated.housing_error(module, fit, event.turn)
                row["stated_tilt"] = fit.score.tilt_deg
                row["stated"] = fit.score.heading_deg
        row["seconds"] = procedure.status().seconds
        if procedure.is_over or row["seconds"] > LONGEST_S:
            break
    return row


def through_image(task: tuple[str, int]) -> dict[str, Any]:
    """A module that warms up by 5 degrees on a virtual board, in a hand that obeys: the
    result from the raw samples of the board's image.
    """
    board, seed = task
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "raw.bin"
        words = ["sim", board, "--fast", "--stream", "--raw", "--record", str(path)]
        words += ["--module", "shop", "--hand", "calibrate", "--seed", str(seed)]
        command = [sys.executable, "-m", "imud", *words, "--seconds", "57"]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        _, subject, samples = of_file(path, None)
    recording = Gatherer.of(subject.scale, samples).recording()
    module, fit = named("shop", seed), whole.fit(recording)
    row: dict[str, Any] = {"case": board, "seed": seed, "seconds": recording.seconds}
    if fit is None:
        return row
    row |= simulated.errors(module, fit)
    row |= {"stated_tilt": fit.score.tilt_deg, "stated": fit.score.heading_deg}
    turn = housing_found(recording, fit)
    if turn is not None:
        row["housing"] = simulated.housing_error(module, fit, turn)
    return row


def by_methods(seed: int) -> dict[str, Any]:
    """Each method on one recording: six faces with a half turn on each, then six edges,
    which meets the needs of every method.
    """
    random = np.random.default_rng([seed, 0xCA11])
    module = shop(random, 0.0)
    ups: list[FloatArray | None] = []
    for pose in poses.TWELVE[:6]:
        ups += [pose.up, None]
    ups += [pose.up for pose in poses.TWELVE[6:]]
    manners = Manners(off_rad=math.radians(1.0))
    recording = simulated.recorded(
        simulated.samples(module, seed, ups, manners, simulated.EARTH)
    )
    stops = find_stops(recording)
    row: dict[str, Any] = {}
    fit = whole.fit(recording, stops)
    if fit is not None:
        own = simulated.errors(module, fit)
        row["guided"] = {"tilt": own["tilt"], "heading": own["heading"]}
    nothing = Affine(np.eye(3), np.zeros(3))
    row["none"] = simulated.affine_errors(module, nothing, nothing)
    for method in METHODS:
        try:
            found = by_method(recording, stops, method)
        except MethodError:
            continue
        assert found.mag is not None
        acc = found.acc or nothing
        row[method] = simulated.affine_errors(module, acc, found.mag)
        if found.acc is None:
            del row[method]["tilt"]
    return row


def seconds_of_fit() -> float:
    """The median processor time of a fit of twelve poses, on this machine."""
    times = []
    for seed in range(FIT_MODULES):
        recording = laid(CASES[0], 2 * seed).recording()
        begun = time.process_time()
        whole.fit(recording)
        times.append(time.process_time() - begun)
    return float(np.median(times))


def run(
    pool: ProcessPoolExecutor,
    function: Callable[[Any], dict[str, Any]],
    tasks: Sequence[Any],
    label: str,
) -> list[dict[str, Any]]:
    """Each task's row, in order."""
    progress = Progress(label, len(tasks))
    rows = []
    for row in pool.map(function, tasks, chunksize=4):
        rows.append(row)
        progress.advance()
    progress.end()
    return rows


def measured(args: argparse.Namespace, which: str) -> Results:
    """All requested results of one set of seeds."""
    results = Results(which)
    seeds = [2 * index + SETS[which] for index in range(args.modules)]
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(args.jobs, mp_context=context) as pool:
        for board in args.boards if seeds else ():
            tasks = [(board, seed) for seed in seeds[:IMAGE_MODULES]]
            name = f"through the image, {board}"
            results.cases[name] = run(pool, through_image, tasks, name)
        if seeds:
            results.cases[GUIDED] = run(pool, guided, seeds, GUIDED)
        for case in CASES if seeds and not args.guided else ():
            tasks = [(case, seed) for seed in seeds]
            results.cases[case.name] = run(pool, measure, tasks, case.name)
        if seeds and not args.guided:
            results.methods = run(pool, by_methods, seeds, "methods")
        many = [2 * index + SETS[which] + CROWD_SEED for index in range(args.crowd)]
        tasks = [(crowd(seed), seed) for seed in many]
        results.crowd = run(pool, of_crowd, tasks, "recordings of all kinds")
        shops = shop_trials.tasks(
            2 * index + SETS[which] for index in range(args.shops)
        )
        results.shops = run(pool, shop_trials.measure, shops, "public recordings")
        rough_ones = [2 * index + SETS[which] for index in range(args.rough)]
        results.rough = run(pool, rough.measure, rough_ones, "rough modules")
    if seeds:
        results.fit_s = seconds_of_fit()
    return results


def main(arguments: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="example: benchmarks/calibration/modules.py --modules 20",
    )
    parser.add_argument("--sets", nargs="+", choices=SETS, default=["judging"])
    parser.add_argument("--modules", type=int, default=MODULES)
    parser.add_argument("--crowd", type=int, default=CROWD)
    parser.add_argument("--shops", type=int, default=SHOPS, help="modules a recording")
    parser.add_argument("--rough", type=int, default=ROUGH, help="modules in use")
    parser.add_argument(
        "--boards", nargs="*", choices=BOARDS, default=BOARDS_JUDGED, help="virtual"
    )
    parser.add_argument(
        "--guided", action="store_true", help="only as the procedure guides"
    )
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args(arguments)
    report: dict[str, dict[str, Any]] = {}  # by part, then by set
    for which in args.sets:
        results = measured(args, which)
        print(f"\nseeds for {which}\n")
        show(results)
        for part, found in parts_of(results).items():
            report.setdefault(part, {})[which] = found
    for part, of_sets in report.items():
        write_results(RESULTS / f"calibration-{part}.json", of_sets)


if __name__ == "__main__":
    main(sys.argv[1:])
