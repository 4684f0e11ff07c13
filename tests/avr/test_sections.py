# SPDX-License-Identifier: MIT
"""Calls in assembler, whatever the order in which the linker places functions."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

AVR = Path(__file__).resolve().parents[2] / "firmware" / "avr"
SECTION = re.compile(r"\s*\.section\s+([^\s,]+)")
LABEL = re.compile(r"([A-Za-z_]\w*):")
SHORT = re.compile(r"\b(?:rcall|rjmp|br[a-z]{2})\s+([A-Za-z_]\w*)\s*(?:;|$)")


@pytest.mark.parametrize("source", sorted(AVR.glob("*.S")), ids=lambda path: path.name)
def test_a_short_call_stays_in_its_section(source: Path) -> None:
    # Another section may lie out of its reach; a long one is shortened where it can be.
    section = ""
    where: dict[str, str] = {}
    calls: list[tuple[str, str, int]] = []
    for number, line in enumerate(source.read_text().splitlines(), 1):
        if named := SECTION.match(line):
            section = named[1]
        if label := LABEL.match(line):
            where[label[1]] = section
        if call := SHORT.search(line):
            calls.append((call[1], section, number))
    assert calls
    assert [call for call in calls if where.get(call[0], "") != call[1]] == []
