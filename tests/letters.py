# SPDX-License-Identifier: MIT
"""The output of both boards' board_test.c when they are sent letters."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest

# enum bus_result.
OK, NACK, TIMEOUT, STUCK = 0, -1, -2, -3

# Faults of a transfer of many bytes, and what the bus may say of each.
FAILED_BURSTS = pytest.mark.parametrize(
    ("fault", "failures"),
    [
        ({"kind": "nack"}, {NACK}),
        ({"kind": "nack", "byte": 1}, {NACK}),
        ({"kind": "stuck_sda", "clocks": 9}, {STUCK, TIMEOUT}),
        ({"kind": "stuck_sda", "byte": 6, "clocks": 9}, {STUCK, TIMEOUT}),
    ],
)


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
