# SPDX-License-Identifier: MIT
"""What board_test.c has printed, and how the virtual board came to run it."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

# enum bus_result.
OK, NACK, TIMEOUT, STUCK = 0, -1, -2, -3


@dataclass
class Run:
    lines: list[str]
    summary: dict[str, Any]

    def numbers(self, word: str) -> list[list[int]]:
        """The decimal numbers of each line that starts with `word`."""
        return [
            [int(n) for n in re.findall(r"(?<= )-?\d+(?= |$)", line)]
            for line in self.lines
            if line.startswith(word + " ")
        ]

    def words(self, word: str) -> list[list[str]]:
        """The words behind `word` of each line that starts with it."""
        return [line.split()[1:] for line in self.lines if line.startswith(word + " ")]


Board = Callable[..., Run]


def starts(run: Run) -> list[str]:
    """The cause of each."""
    return [cause for cause, _ in run.words("start")]


def addresses(run: Run) -> list[int]:
    """Where the program was struck before each start; 0: it was not, or who knows."""
    return [int(address, 16) for _, address in run.words("start")]


def places(program: Path) -> dict[str, range]:
    """The addresses of each function, as the linker has put it."""
    listed = subprocess.run(
        ["arm-none-eabi-nm", "--print-size", "--defined-only", program],
        capture_output=True,
        text=True,
        check=True,
    )
    found = {}
    for line in listed.stdout.splitlines():
        match line.split():
            case [address, size, "t" | "T", name]:
                begin = int(address, 16)
                found[name] = range(begin, begin + int(size, 16))
    return found
