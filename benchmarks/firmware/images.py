# SPDX-License-Identifier: MIT
"""Images of the firmware: built by PlatformIO, run on a motion, profiled by part."""

from __future__ import annotations

import configparser
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.common import capture as captures
from benchmarks.common import scoring
from benchmarks.common.boards import F405, NANO, Board
from benchmarks.common.capture import Capture, RunFailed
from benchmarks.firmware import parts
from imud.cli import main as imud
from imud.virtual import motion

OFFICIAL = "nano_pio"  # the Nano's image from PlatformIO's own compiler
CARD_BYTES_A_SECOND = 120_000  # more than raw and pose take at 760 Hz


@dataclass(frozen=True, slots=True)
class Measured:
    """An image's capture and its profile, as the emulator wrote it."""

    capture: Capture
    profile: dict[str, Any]


def environments() -> list[str]:
    """Environments of platformio.ini for the Nano's images, the default one first;
    those without flags of their own have the image of another."""
    ini = configparser.ConfigParser(interpolation=None)
    ini.read(scoring.PROJECT / "platformio.ini")
    names = [
        section.removeprefix("env:")
        for section in ini
        if "env:" in section and "build_flags" in ini[section]
    ]
    others = [
        name
        for name in names
        if name.startswith(f"{NANO.environment}_") and name != OFFICIAL
    ]
    return [NANO.environment, *others]


def build(environment: str) -> Path:
    """Build an image with PlatformIO and return its ELF."""
    done = subprocess.run(
        [sys.executable, "-m", "platformio", "run", "--silent", "-e", environment],
        cwd=scoring.PROJECT,
        env={
            key: os.environ[key] for key in os.environ if key != "PLATFORMIO_CORE_DIR"
        },
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    # An image that does not fit beside the bootloader is linked all the same; its line
    # of the table shows that.
    if done.returncode != 0 and "greater than maximum allowed" not in done.stderr:
        raise RunFailed(f"{environment}: {done.stderr.strip()}")
    return scoring.PROJECT / ".pio" / "build" / environment / "firmware.elf"


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
    """A card image with room for the log of so many seconds."""
    path = folder / "card.img"
    size = 48 + int(seconds * CARD_BYTES_A_SECOND) // 2**20
    with contextlib.redirect_stdout(io.StringIO()):
        if imud(["card", "prepare", str(path), "--size", f"{size}M"]):
            raise RunFailed("no card could be prepared")
    return path


def poses_a_second(capture: Capture) -> float:
    times = capture.pose_times_s
    return (len(times) - 1) / float(times[-1] - times[0])
