# SPDX-License-Identifier: MIT
"""Strokes through a board's image on the virtual board."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from benchmarks.common import capture as captures
from benchmarks.common.boards import Board
from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed
from benchmarks.strokes.runs import Found, Run, found_of, heading_of, params_of

DEBOUNCE_S = 0.05
MOTION_FROM_US = 100_000  # on the virtual board


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
            *(board.name, felt, options),
            image=image,
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
            quat = np.array(event.message.fields["q"], float)
            off = heading_of(quat, run.exact, time_s)
        if event.message.fields.get("end", "running") != "running":
            ends.append(event.message)
            turned.append(off)
    return found_of(ends, np.array(turned), run.true)
