# SPDX-License-Identifier: MIT
"""Strokes through a board's image on the virtual board: their errors, whether the
C on this machine computes the same bits, and what they cost in cycles. Prints tables
and writes build/benchmarks/strokes-image-BOARD.json.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.common import capture as captures
from benchmarks.common.boards import F405, STROKING, Board
from benchmarks.common.capture import Capture
from benchmarks.common.figure import SETS, Figure
from benchmarks.common.images import RunFailed, build
from benchmarks.common.paths import RESULTS, write_results
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
from imud.errors import ImudError

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


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=2, help="of each case")
    parser.add_argument("--board", choices=STROKING, default=F405.name)
    parser.add_argument(
        "--image", type=Path, help="default: builds the one that is flashed"
    )
    args = parser.parse_args(arguments)
    board = STROKING[args.board]
    image = args.image or build(board.environment)
    unequal = 0
    rows: list[dict[str, Any]] = []
    print(f"{on_host.HEAD}  cycles of the worst sample; with a tip and every pose")
    for name in CASES:
        runs = [run_of(*named(name, number), board.chip) for number in range(args.runs)]
        tipped = replace(runs[0], case=replace(runs[0].case, has_tip=True))
        each = [sent(board, image, run) for run in runs]
        every = sent(board, image, tipped, round(board.chip.rate_hz))
        unequal += sum(one.twin().differed for one in [*each, every])
        row = on_host.row_of(runs[0].case, list(map(found_by, each, runs)))
        worst, worst_tip = worst_of(each), worst_of([every])
        rows.append(row | {"cycles_worst": worst, "cycles_worst_tip": worst_tip})
        print(f"{on_host.show(row)}{worst:10.0f}{worst_tip:10.0f}", flush=True)
    print(Figure("poses and strokes of other bits", unequal, (0, 0), (0, 0)))
    costs = costs_of(board, image)
    print(f"\n{COUNTED:22}" + "".join(f"{key:>14}" for key in COSTS))
    for name, cost in costs.items():
        print(f"{name:22}" + "".join(f"{cost[key]:>14.0f}" for key in COSTS))
    output = RESULTS / f"strokes-image-{board.name}.json"
    report = {"runs": args.runs, "rows": rows, "other_bits": unequal, "costs": costs}
    write_results(output, report)
    return 1 if unequal else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"on_board: {error}")
