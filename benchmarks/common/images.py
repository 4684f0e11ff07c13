# SPDX-License-Identifier: MIT
"""The images that benchmarks run, and the virtual boards that run them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from benchmarks.common.paths import PROJECT
from imud import checkout
from imud.virtual import boards


class RunFailed(Exception):
    """An image could not be built, or the virtual probe failed."""


def flashed(board: str, given: Path | None = None) -> tuple[Path, Path]:
    """The virtual board of this name, and its image or the given one."""
    known = boards.BOARDS[board]
    return known.find_simulator(), known.find_image(given)


def simulated(board: str) -> list[str]:
    """The words of `imud` that run a board's image."""
    simulator, image = flashed(board)
    return ["sim", board, "--simulator", str(simulator), "--image", str(image)]


def build(environment: str) -> Path:
    """Build an image with PlatformIO and return its ELF."""
    done = subprocess.run(
        [sys.executable, "-m", "platformio", "run", "--silent", "-e", environment],
        cwd=PROJECT,
        env=checkout.environment_of(Path(sys.executable).parent),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    # An image that does not fit beside the bootloader is linked anyway; its line of the
    # table shows that.
    if done.returncode != 0 and "greater than maximum allowed" not in done.stderr:
        raise RunFailed(f"{environment}: {done.stderr.strip()}")
    return PROJECT / ".pio" / "build" / environment / "firmware.elf"
