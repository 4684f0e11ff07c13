# SPDX-License-Identifier: MIT
"""How well modules from the shop are calibrated: simulated modules in simulated hands,
through the procedure, in single cases and through the images of two boards.
"""

from __future__ import annotations

import argparse
import itertools
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import harness
from benchmarks.calibration import simulated
from benchmarks.calibration.cases import CASES, Case, judged, laid
from benchmarks.harness import Figure, Report, Table
from imud.calibration.guided import whole
from imud.calibration.guided.events import Finished
from imud.calibration.guided.housing import found as housing_found
from imud.calibration.guided.procedure import Procedure
from imud.calibration.guided.whole import ModuleFit
from imud.calibration.recording import Gatherer
from imud.cli.calibrate_source import of_file
from imud.rotation import FloatArray
from imud.virtual.calibrating import RECORDS_HZ, SCALE, Sampler, pieces
from imud.virtual.modules import named, shop
from imud.virtual.motions.module import Module

GUIDED = "as the procedure guides"  # the case with the strictest requirements
BOARDS = ("nano", "f405")
IMAGE_MODULES = 10  # of which the image's samples are used
LONGEST_S = 150.0  # of a hand that is never done
FIT_MODULES = 10  # of which the time is measured

Row = dict[str, Any]


def row_of(module: Module, fit: ModuleFit, turn: FloatArray | None) -> Row:
    """The true errors of a fit, and the stated ones."""
    row: Row = dict(simulated.fit_errors(module, fit))
    row |= {"stated tilt": fit.score.tilt_deg, "stated": fit.score.heading_deg}
    if turn is not None:
        row["leans"] = simulated.housing_error(module, fit, turn)
    return row


def measure(task: tuple[Case, int]) -> Row:
    """One recording: its errors, its score, and why it is refused, if it is."""
    case, seed = task
    found = laid(case, seed)
    recording = found.recording()
    fit, fault = judged(recording)
    row: Row = {"seconds": recording.seconds}
    row["refused"] = fault.kind if fault is not None else None
    if fit is None:
        return row
    turn = housing_found(recording, fit) if case.has_housing else None
    return row | row_of(found.module, fit, turn)


def guided(seed: int) -> Row:
    """A hand that follows the procedure from start to end."""
    random = np.random.default_rng([seed, 0xCA11])
    module = shop(random, 0.0)
    procedure, sampler = Procedure(SCALE), Sampler()
    row: Row = {}
    for piece in pieces("calibrate", module, seed, RECORDS_HZ):
        for event in itertools.chain.from_iterable(
            map(procedure.feed, sampler.samples(piece))
        ):
            if isinstance(event, Finished) and event.turn is not None:
                row |= row_of(module, event.fit, event.turn)
        row["seconds"] = procedure.status().seconds
        if procedure.is_over or row["seconds"] > LONGEST_S:
            break
    return row


def through_image(task: tuple[str, int]) -> Row:
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
    row: Row = {"seconds": recording.seconds}
    fit = whole.fit(recording)
    if fit is None:
        return row
    return row | row_of(named("shop", seed), fit, housing_found(recording, fit))


def seconds_of_fit() -> float:
    """The median processor time of a fit of twelve poses, on this machine."""
    times = []
    for seed in range(FIT_MODULES):
        recording = laid(CASES[0], 2 * seed).recording()
        begun = time.process_time()
        whole.fit(recording)
        times.append(time.process_time() - begun)
    return float(np.median(times))


def percentile(rows: Sequence[Row], key: str, share: float) -> float:
    """Of the rows that have it; a fit that failed counts as infinite."""
    values = [row.get(key, math.inf) for row in rows]
    with np.errstate(invalid="ignore"):
        found = float(np.percentile(values, share))
    return math.inf if math.isnan(found) else found  # between two infinite ones


# Errors in degrees, of the gyroscope in percent, of the own field in uT.
COLUMNS = {
    "tilt": ("tilt", ".3f"),
    "heading": ("heading", ".2f"),
    "gyroscope scale": ("scale", ".3f"),
    "cross": ("cross", ".3f"),
    "own field": ("own", ".2f"),
    "stated tilt": ("stated tilt", ".2f"),
    "stated heading": ("stated", ".2f"),
    "leans": ("leans", ".3f"),
}


def line_of(rows: Sequence[Row]) -> dict[str, tuple[float, float] | None]:
    """Median and 95th percentile of each column; None: nobody has it."""
    return {
        head: (percentile(rows, key, 50), percentile(rows, key, 95))
        if any(key in row for row in rows)
        else None
        for head, (key, _) in COLUMNS.items()
    }


def table_of(lines: Mapping[str, Mapping[str, tuple[float, float] | None]]) -> Table:
    rows = []
    for name, line in lines.items():
        pairs = zip(line.values(), COLUMNS.values(), strict=True)
        cells = [
            " / ".join(format(each, form) for each in pair) if pair else None
            for pair, (_, form) in pairs
        ]
        rows.append([name, *cells])
    return Table("cases", {"case": ""} | dict.fromkeys(COLUMNS, ""), rows)


def figures(
    lines: Mapping[str, Mapping[str, tuple[float, float] | None]], fit_s: float
) -> Iterator[Figure]:
    """The required figures: 95th percentiles, and the time of a fit."""
    for case, head, must, goal in (
        (GUIDED, "tilt", 0.10, 0.05),
        (GUIDED, "heading", 0.4, 0.2),
        ("12, field uneven by 2 uT", "heading", 1.5, 1.1),
        (GUIDED, "gyroscope scale", 0.15, 0.07),
        (GUIDED, "leans", 0.15, 0.07),
    ):
        pair = lines.get(case, {}).get(head)
        if pair:
            name = f"{case}: {head}, 95th percentile"
            yield Figure(name, pair[1], (0.0, must), (0.0, goal))
    yield Figure("fit of 12 poses, s", fit_s, (0, 0.3), (0, 0.1))


def measured(args: argparse.Namespace) -> Report:
    """The procedure, the cases and the images, module by module."""
    seeds = harness.seeds_of(args)
    each = partial(harness.each, jobs=args.jobs)
    found = {GUIDED: [*each(guided, seeds, label=GUIDED)]}
    for case in CASES:
        tasks = [(case, seed) for seed in seeds]
        found[case.name] = [*each(measure, tasks, label=case.name)]
    for board in BOARDS:
        images = [(board, seed) for seed in seeds[: min(IMAGE_MODULES, args.images)]]
        if images:
            name = f"through the image, {board}"
            found[name] = [*each(through_image, images, label=name)]
    lines = {name: line_of(rows) for name, rows in found.items()}
    return Report([table_of(lines)], [*figures(lines, seconds_of_fit())])


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--images", type=int, default=IMAGE_MODULES, help="modules")


main = partial(
    harness.run,
    *("calibration", __doc__, measured),
    harness.options(seeds=40, jobs=1, more=more),
)
