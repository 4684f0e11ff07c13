# SPDX-License-Identifier: MIT
"""Rows that need a user: the button and the LED."""

from __future__ import annotations

from collections.abc import Iterator

from imud.check.evidence import Evidence
from imud.check.rows import Row, RowVerdict, skipped

PINS = {
    "nano": "between D3 and GND",
    "mega": "between pin 3 and GND",
    "f405": "USR, or X17 to GND",
    "pico": "between GP15 and GND",
}
LED = {
    "nano": "the LED at D13",
    "mega": "the LED marked L",
    "f405": "the blue LED",
    "pico": "the LED beside the USB socket",
}

# As docs/nano.md has it.
SHOWS = {
    "idle": "a short flash every two seconds",
    "calibrating": "five blinks a second",
    "streaming": "on",
    "fault": "two flashes a second",
}


def led_words(board: str, state: str) -> str:
    """The expected pattern of a board's LED."""
    name = LED.get(board, "the LED")
    return f"{name} should show: {SHOWS.get(state, 'its state')}"


def rows(evidence: Evidence) -> Iterator[Row]:
    """The rows on button and LED; none for a log."""
    if not evidence.is_live:
        return
    board = str(evidence.hello.get("board"))
    normal = "pressed and released"
    if evidence.button is None:
        yield skipped("button", normal, "not tried")
    elif evidence.button:
        yield Row("button", "was pressed", normal, RowVerdict.GOOD)
    else:
        where = PINS.get(board, "as wired")
        advice = (
            f"no press was detected: check the button {where}. A probe works without it"
        )
        yield Row("button", "no press", normal, RowVerdict.LOOK, advice)
    state = str(evidence.counters.get("state"))
    shows = led_words(board, state)
    if evidence.led is None:
        yield skipped("LED", shows, "not answered")
    elif evidence.led:
        yield Row("LED", "as it should", shows, RowVerdict.GOOD)
    else:
        advice = "the LED is broken, or this clone has it on another pin"
        yield Row("LED", "different", shows, RowVerdict.LOOK, advice)
