# SPDX-License-Identifier: MIT
"""How well modules from the shop are calibrated: simulated modules in simulated hands.

Prints tables and writes build/benchmarks/calibration.json. Seeds are kept apart: those
of --sets tuning were looked at while the method was made, those of judging were not.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import multiprocessing
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.calibration import rough, shop_trials, simulated
from benchmarks.calibration.report import GUIDED, Results, show
from benchmarks.common.figure import SETS
from benchmarks.common.paths import RESULTS
from imud.calibration import poses
from imud.calibration.affine import Affine, MethodError
from imud.calibration.algebra import units
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
from imud.virtual.motions.module import Module
from imud.virtual.sensors import World

OUTPUT = RESULTS / "calibration.json"

MODULES = 150
CROWD = 2000
ROUGH = 200
SHOPS = 12  # modules a public recording
CROWD_SEED = 300_000  # the first
IMAGE_MODULES = 10  # of which the image's samples are used
LONGEST_S = 150.0  # of a hand that is never done
FIT_MODULES = 10  # of which the time is measured


@dataclass(frozen=True, slots=True)
class Case:
    """How modules are calibrated."""

    name: str
    poses: int = 12
    stop_s: float = 2.0
    user: str = "guided"
    uneven_ut: float = 0.0
    warm_degc: float = 0.0
    is_held: bool = False
    has_housing: bool = False


CASES = (
    Case("12 poses"),
    Case("4 poses", poses=4),
    Case("6 poses", poses=6),
    Case("9 poses", poses=9),
    Case("18 poses", poses=18),
    Case("12, stops of 1 s", stop_s=1.0),
    Case("12, six faces only", user="faces"),
    Case("12, never upside down", user="upright"),
    Case("12, lazy: 20 degrees of tilt", user="lazy"),
    Case("12, field uneven by 2 uT", uneven_ut=2.0),
    Case("12, field uneven by 5 uT", uneven_ut=5.0),
    Case("12, 5 degC of warm-up", warm_degc=5.0),
    Case("12 and the housing", has_housing=True),
)
USERS = ("guided", "faces", "free", "upright", "lazy", "two axes")


def ups_of(case: Case, random: np.random.Generator) -> list[FloatArray | None]:
    """Where up is in the body, pose by pose; None: half a turn where it lies."""
    count = case.poses
    faces = [pose.up for pose in poses.ALL[:6]]
    if case.user == "guided":
        order = [*poses.TWELVE, *(p for p in poses.ALL if p not in poses.TWELVE)]
        found = np.array([pose.up for pose in order[:count]])
    elif case.user == "faces":
        found = np.array([faces[index % 6] for index in range(count)])
    else:
        found = random.standard_normal((count, 3))
        if case.user == "upright":
            found[:, 2] = np.abs(found[:, 2]) + 0.1
        elif case.user == "lazy":
            found = np.append(0.35 * found[:, :2], np.ones((count, 1)), axis=1)
        elif case.user == "two axes":
            found[:, 0] *= 0.15
    ups: list[FloatArray | None] = list(units(found))
    return [*ups, poses.BASE_DOWN.up, None] if case.has_housing else ups


def made(case: Case, seed: int) -> tuple[Module, SensorRecording]:
    """A module, and its recording as the case has it."""
    random = np.random.default_rng([seed, 0xCA11])
    module = shop(random, case.warm_degc)
    manners = Manners(
        stop_s=case.stop_s,
        off_rad=math.radians(2.0 if case.user == "faces" else 8.0),
        is_held=case.is_held,
    )
    world: World = simulated.EARTH
    if case.uneven_ut > 0.0:
        world = simulated.uneven(case.uneven_ut, random)
    ups = ups_of(case, random)
    return module, simulated.recorded(
        simulated.samples(module, seed, ups, manners, world)
    )


def measure(task: tuple[Case, int]) -> dict[str, Any]:
    """One recording: its errors, what the score says, whether it is accepted."""
    case, seed = task
    module, recording = made(case, seed)
    fit = whole.fit(recording)
    stops = find_stops(recording)
    fault = faults.of_module(recording, stops, fit)
    fault = fault or faults.of_score(fit, len(stops), has_mag=True)
    row: dict[str, Any] = {
        "case": case.name,
        "seed": seed,
        "seconds": recording.seconds,
    }
    row["refused"] = fault.kind if fault is not None else None
    if fit is None:
        return row
    row |= simulated.errors(module, fit)
    row["limit"] = fit.score.tilt_limit_deg
    row |= {"stated_tilt": fit.score.tilt_deg, "stated": fit.score.heading_deg}
    turn = housing_found(recording, fit) if case.has_housing else None
    if turn is not None:
        row["housing"] = simulated.housing_error(module, fit, turn)
    return row


def guided(seed: int) -> dict[str, Any]:
    """A hand that obeys the procedure, from its first word to its last."""
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
    """A module that warms up by 5 degrees on a virtual board, in a hand that obeys:
    what is found in the raw samples that the board's image sends.
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


def crowd(seed: int) -> Case:
    """A recording of any kind."""
    random = np.random.default_rng([seed, 0xC0D])
    return Case(
        "any",
        poses=int(random.integers(4, 19)),
        stop_s=float(random.uniform(0.75, 3.0)),
        user=str(random.choice(USERS)),
        uneven_ut=float(random.choice([0.0, random.uniform(0.0, 6.0)])),
        warm_degc=float(random.choice([0.0, random.uniform(0.0, 8.0)])),
        is_held=bool(random.random() < 0.15),
    )


def by_methods(seed: int) -> dict[str, Any]:
    """Each method on one recording: six faces with a half turn on each, then six edges,
    so that every method has what it needs.
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
        _, recording = made(CASES[0], 2 * seed)
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
    """All that the arguments ask for, of one set of seeds."""
    results = Results(which)
    seeds = [2 * index + SETS[which] for index in range(args.modules)]
    context = multiprocessing.get_context("forkserver")
    with ProcessPoolExecutor(args.jobs, mp_context=context) as pool:
        for board in args.boards:
            tasks = [(board, seed) for seed in seeds[:IMAGE_MODULES]]
            name = f"through the image, {board}"
            results.cases[name] = run(pool, through_image, tasks, name)
        if seeds:
            results.cases[GUIDED] = run(pool, guided, seeds, GUIDED)
        for case in CASES if seeds and not args.guided else ():
            tasks = [(case, seed) for seed in seeds]
            results.cases[case.name] = run(pool, measure, tasks, case.name)
        if not args.guided:
            results.methods = run(pool, by_methods, seeds, "methods")
        many = [2 * index + SETS[which] + CROWD_SEED for index in range(args.crowd)]
        tasks = [(crowd(seed), seed) for seed in many]
        results.crowd = run(pool, measure, tasks, "recordings of all kinds")
        shops = shop_trials.tasks(
            2 * index + SETS[which] for index in range(args.shops)
        )
        results.shops = run(pool, shop_trials.measure, shops, "public recordings")
        rough_ones = [2 * index + SETS[which] for index in range(args.rough)]
        results.rough = run(pool, rough.measure, rough_ones, "rough modules")
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
        "--boards", nargs="*", choices=BOARDS, default=list(BOARDS), help="virtual ones"
    )
    parser.add_argument(
        "--guided", action="store_true", help="only as the procedure guides"
    )
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--output", type=Path, default=OUTPUT)
    args = parser.parse_args(arguments)
    report: dict[str, Any] = {}
    for which in args.sets:
        results = measured(args, which)
        print(f"\nseeds for {which}\n")
        show(results)
        report[which] = {
            "cases": results.cases,
            "crowd": results.crowd,
            "methods": results.methods,
            "shops": results.shops,
            "rough": results.rough,
            "fit_s": results.fit_s,
        }
    args.output.parent.mkdir(parents=True, exist_ok=True)
    args.output.write_text(json.dumps(report, indent=1))


if __name__ == "__main__":
    main(sys.argv[1:])
