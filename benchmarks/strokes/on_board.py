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
from pathlib import Path
from unittest.mock import patch

import numpy as np

from benchmarks.common import capture as captures
from benchmarks.common.boards import F405, STROKING, Board
from benchmarks.common.capture import Capture
from benchmarks.common.figure import Figure
from benchmarks.common.images import RunFailed, build
from benchmarks.strokes import on_host
from benchmarks.strokes.runs import Found, Run, found_of, heading_of, params_of, run_of
from imud.errors import ImudError
from imud.stages.twin import Twin
from imud.stages.twin_outcomes import TwinState

CASES = (
    *("supported, 1 s", "between rests, 1 s", "on paper, 2 s", "raw module, 1 s"),
    "A4 outline, 4 x 1 s",
)
COUNTED = "between rests, 1 s"  # a build without strokes takes a press for a click
DEBOUNCE_S = 0.05
MOTION_FROM_US = 100_000  # on the virtual board
COSTS = ("cycles_mean", "cycles_worst", "flash", "ram")
FLAG = "-DPOSE_WITHOUT_STROKES"


def sent(board: Board, image: Path, run: Run) -> Capture:
    """What the image sends on a run's motion."""
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
            board.name, felt, options, image=image, params=params_of(run.case)
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


def differing(capture: Capture) -> int:
    """How many poses and strokes of the image this machine's C computes otherwise.
    RunFailed: it could not follow to the end.
    """
    twin = Twin()
    for event in capture.received:
        twin.on_message(event.message, event.content, event.params)
    if twin.state not in (TwinState.FOLLOWING, TwinState.DIFFERS):
        raise RunFailed(f"the twin is {twin.state.value} at the end")
    return twin.differed


def without_strokes(board: Board, folder: Path) -> Path:
    """The image, built without strokes."""
    options = {"PLATFORMIO_BUILD_FLAGS": FLAG, "PLATFORMIO_BUILD_DIR": str(folder)}
    with patch.dict(os.environ, options):
        build(board.environment)
    return folder / board.environment / "firmware.elf"


def print_costs(board: Board, image: Path) -> None:
    """Cycles a sample of the image, and of one built without strokes."""
    case = next(each for each in on_host.CASES if each.name == COUNTED)
    run = run_of(case, 1000 * on_host.CASES.index(case) + 1, board.chip)
    with tempfile.TemporaryDirectory() as folder:
        other = without_strokes(board, Path(folder))
        for name, each in (("with strokes", image), ("without", other)):
            summary = sent(board, each, run).summary
            words = (
                f"{summary[key]:.0f}"
                for key in ("cycles_mean", "cycles_worst", "flash", "ram")
            )
            print(f"{name:16}" + "".join(f"{word:>10}" for word in words))


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
    figures: list[Figure] = []
    unequal = 0
    print(on_host.HEAD)
    for case in on_host.CASES:
        if case.name not in CASES:
            continue
        first = 1000 * on_host.CASES.index(case)
        runs = []
        for seed in range(1, 2 * args.runs, 2):
            run = run_of(case, first + seed, board.chip)
            capture = sent(board, image, run)
            runs.append(found_by(capture, run))
            unequal += differing(capture)
        print(on_host.show(on_host.row_of(case, runs)), flush=True)
    figures.append(Figure("poses and strokes of other bits", unequal, (0, 0), (0, 0)))
    print(*figures, sep="\n")
    print("\ncycles a sample:      mean     worst     flash       RAM")
    print_costs(board, image)
    return 1 if unequal else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ImudError, RunFailed) as error:
        sys.exit(f"on_board: {error}")
