# SPDX-License-Identifier: MIT
"""What board_test.c has printed, and how the virtual board came to run it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


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
    return [cause for (cause,) in run.words("start")]
