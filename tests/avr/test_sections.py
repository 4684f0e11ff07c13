# SPDX-License-Identifier: MIT
"""Calls in assembler, whatever the order in which the linker places functions."""

from __future__ import annotations

import re
from pathlib import Path

AVR = Path(__file__).resolve().parents[2] / "firmware" / "avr"
SECTION = re.compile(r"\s*\.section\s+([^\s,]+)")
LABEL = re.compile(r"([A-Za-z_]\w*):")
SHORT = re.compile(r"\b(?:rcall|rjmp|br[a-z]{2})\s+([A-Za-z_]\w*)\s*(?:;|$)")


def short_calls(source: Path) -> list[tuple[int, str, bool]]:
    """Line and target of each, and whether both ends are in one section."""
    section = ""
    where: dict[str, str] = {}
    calls: list[tuple[int, str, str]] = []
    for number, line in enumerate(source.read_text().splitlines(), 1):
        if named := SECTION.match(line):
            section = named[1]
        if label := LABEL.match(line):
            where[label[1]] = section
        if call := SHORT.search(line):
            calls.append((number, call[1], section))
    return [(number, to, where.get(to, "") == begins) for number, to, begins in calls]


def test_a_short_call_stays_in_its_section() -> None:
    # Another section may lie out of its reach; a long one is shortened where it can be.
    sources = sorted(AVR.glob("*.S"))
    assert sources
    for source in sources:
        calls = short_calls(source)
        assert calls, source.name
        gone = [f"{source.name}:{n}: {to}" for n, to, stays in calls if not stays]
        assert not gone, "\n".join(gone)
