# SPDX-License-Identifier: MIT
"""Starts that board_test.c has printed, and where in the program they came from."""

from __future__ import annotations

from pathlib import Path

from letters import Run
from programs import ran


def addresses(run: Run) -> list[int]:
    """Where the program was struck before each start; 0: it was not, or who knows."""
    return [int(address, 16) for _, address in run.words("start")]


def places(program: Path) -> dict[str, range]:
    """The addresses of each function, as the linker has put it."""
    listed = ran(
        "arm-none-eabi-nm", "--print-size", "--defined-only", program, check=True
    )
    found = {}
    for line in listed.stdout.splitlines():
        match line.split():
            case [address, size, "t" | "T", name]:
                begin = int(address, 16)
                found[name] = range(begin, begin + int(size, 16))
    return found
