# SPDX-License-Identifier: MIT
"""The images that benchmarks run, and the virtual boards that run them."""

from __future__ import annotations

import configparser
import subprocess
import sys
from pathlib import Path

from benchmarks.common.boards import NANO
from benchmarks.common.paths import PROJECT
from imud import checkout
from imud.virtual import boards

OFFICIAL = "nano_pio"  # the Nano's image from PlatformIO's own compiler


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


def environments() -> list[str]:
    """Environments of platformio.ini for the Nano's images, the default one first;
    those without flags of their own have the image of another, and those with sources
    of their own another sensor."""
    ini = configparser.ConfigParser(interpolation=None)
    ini.read(PROJECT / "platformio.ini")
    names = [
        section.removeprefix("env:")
        for section in ini
        if "env:" in section
        and "build_flags" in ini[section]
        and "build_src_filter" not in ini[section]
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
