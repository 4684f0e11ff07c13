# SPDX-License-Identifier: MIT
"""Images that run on a motion with all streams on, profiled by part."""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import capture as captures
from benchmarks.common.boards import F405, Board
from benchmarks.common.capture import Capture
from benchmarks.common.images import RunFailed
from benchmarks.firmware import parts
from imud.cli import main as imud
from imud.virtual import motion

CARD_BYTES_A_SECOND = 120_000  # more than raw and pose take at 760 Hz


@dataclass(frozen=True, slots=True)
class Measured:
    """An image's capture and its profile, as the emulator wrote it."""

    capture: Capture
    profile: dict[str, Any]


def measure(
    board: Board, image: Path, hand: Path, seed: int, options: Sequence[str] = ()
) -> Measured:
    """Run an image on a motion with all streams on, and profile it."""
    rate_hz = int(board.chip.rate_hz)
    with tempfile.TemporaryDirectory() as folder:
        where, profile = Path(folder) / "parts", Path(folder) / "profile.json"
        parts.write(image, where)
        words = ["--seed", str(seed), *options]
        words += ["--profile", str(profile), "--parts", str(where)]
        if board is F405:
            words += ["--card", str(prepared(Path(folder), motion.load(hand).seconds))]
        capture = captures.run(
            board.name, hand, words, image=image, pose_rate_hz=rate_hz
        )
        return Measured(capture, json.loads(profile.read_text()))


def prepared(folder: Path, seconds: float) -> Path:
    """A card image with room for a log of this many seconds."""
    path = folder / "card.img"
    size = 48 + int(seconds * CARD_BYTES_A_SECOND) // 2**20
    with contextlib.redirect_stdout(io.StringIO()):
        if imud(["card", "prepare", str(path), "--size", f"{size}M"]):
            raise RunFailed("no card could be prepared")
    return path


def poses_a_second(capture: Capture) -> float:
    times = capture.pose_times_s
    return (len(times) - 1) / float(times[-1] - times[0])
