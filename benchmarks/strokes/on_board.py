# SPDX-License-Identifier: MIT
"""Strokes through a board's image on the virtual board: their errors, whether the
C on this machine computes the same bits, and what they cost in cycles.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks import harness
from benchmarks.common import capture as captures
from benchmarks.common.boards import STROKING, Board
from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed, build
from benchmarks.harness import SETS, Figure, Report, Table
from benchmarks.strokes import on_host
from benchmarks.strokes.runs import (
    Case,
    Found,
    Run,
    found_of,
    heading_of,
    params_of,
    run_of,
)

CASES = (
    *("supported, 1 s", "between rests, 1 s", "on paper, 2 s", "raw module, 1 s"),
    "A4 outline, 4 x 1 s",
)
COUNTED = "between rests, 1 s"  # a build without strokes takes a press for a click
DEBOUNCE_S = 0.05
MOTION_FROM_US = 100_000  # on the virtual board
COSTS = ("cycles_mean", "cycles_worst", "flash", "ram")
FLAG = "-DPOSE_WITHOUT_STROKES"


def sent(
    board: Board, image: Path, run: Run, pose_rate_hz: int | None = None
) -> Capture:
    """What the image sends on a run's motion; by default at its initial rate."""
    downs = [(time_s, is_down) for time_s, is_down in run.presses()]
    options: list[str] = []
    for (start_s, _), (end_s, _) in zip(downs[::2], downs[1::2], strict=True):
        begin, end = (
            round(1e6 * (each - DEBOUNCE_S)) + MOTION_FROM_US
            for each in (start_s, end_s)
        )
        options += ["--press", f"{begin}:{end}"]
    with tempfile.TemporaryDirectory() as folder:
        felt = Path(folder) / "felt.npz"
        run.felt.save(felt)
        capture = captures.run(
            *(board.name, felt, options),
            image=image,
            pose_rate_hz=pose_rate_hz,
            params=params_of(run.case),
        )
    if capture.feed.start_us != MOTION_FROM_US:
        raise RunFailed(f"the motion began at {capture.feed.start_us} us")
    return capture


def found_by(capture: Capture, run: Run) -> Found:
    """The strokes that the image told."""
    ends, turned = [], []
    off = 0.0  # of the heading, rad
    start_s = 1e-6 * capture.feed.start_us
    for event in capture.received:
        if event.message.name == "pose":
            time_s = 1e-6 * event.stamp.t_device_us - start_s
            off = heading_of(event.content, run.exact, time_s)
        if event.message.fields.get("end", "running") != "running":
            ends.append(event.message)
            turned.append(off)
    return found_of(ends, np.array(turned), run.true)


def without_strokes(board: Board, folder: Path) -> Path:
    """The image, built without strokes."""
    options = {"PLATFORMIO_BUILD_FLAGS": FLAG, "PLATFORMIO_BUILD_DIR": str(folder)}
    with patch.dict(os.environ, options):
        build(board.environment)
    return folder / board.environment / "firmware.elf"


def costs_of(board: Board, image: Path) -> dict[str, dict[str, float]]:
    """What a case costs the image, and one that is built without strokes."""
    run = run_of(*named(COUNTED), board.chip)
    found = {"with": sent(board, image, run).summary}
    with tempfile.TemporaryDirectory() as folder:
        other = without_strokes(board, Path(folder))
        found["without"] = sent(board, other, run).summary
    return {name: {key: each[key] for key in COSTS} for name, each in found.items()}


def named(name: str, number: int = 0) -> tuple[Case, int]:
    """The case of this name, and the seed of one of its runs."""
    case = next(each for each in on_host.CASES if each.name == name)
    return case, 1000 * on_host.CASES.index(case) + SETS["judging"] + 2 * number


def worst_of(captures: Sequence[Capture]) -> float:
    """The cycles of the worst sample."""
    return max(float(each.summary["cycles_worst"]) for each in captures)


def measured(args: argparse.Namespace) -> Report:
    """Each case through the image, whether its bits are the host's, and the costs."""
    board = STROKING[args.board]
    image = args.image or build(board.environment)
    unequal = 0
    rows: list[dict[str, Any]] = []
    for name in CASES:
        runs = [run_of(*named(name, each), board.chip) for each in range(args.runs)]
        tipped = replace(runs[0], case=replace(runs[0].case, has_tip=True))
        each = [sent(board, image, run) for run in runs]
        every = sent(board, image, tipped, round(board.chip.rate_hz))
        unequal += sum(one.twin().differed for one in [*each, every])
        row = on_host.row_of(runs[0].case, list(map(found_by, each, runs)))
        worst = {"worst": worst_of(each), "worst, with a tip": worst_of([every])}
        rows.append(row | worst)
    figure = Figure("poses and strokes of other bits", unequal, (0, 0), (0, 0))
    return Report(tables_of(rows, costs_of(board, image)), [figure])


def tables_of(
    rows: Sequence[dict[str, Any]], costs: dict[str, dict[str, float]]
) -> list[Table]:
    """Errors in cm and cycles of the worst sample; with a tip the image sends every
    pose. And what strokes cost the image.
    """
    columns = on_host.COLUMNS | {"worst": ",.0f", "worst, with a tip": ",.0f"}
    found = [(f"{which} strokes", *cost.values()) for which, cost in costs.items()]
    return [
        Table("cases", columns, [[*row.values()] for row in rows]),
        Table("costs", {"image": ""} | dict.fromkeys(COSTS, ",.0f"), found),
    ]


def more(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--runs", type=int, default=2, help="of each case")
    parser.add_argument(
        "--image", type=Path, help="default: builds the one that is flashed"
    )


main = partial(
    harness.run,
    *("strokes-image", __doc__, measured),
    harness.options(boards=STROKING, more=more),
    variants=["board"],
)

if __name__ == "__main__":
    sys.exit(main())
