# SPDX-License-Identifier: MIT
"""What `imud listen` draws, and what it calls missing."""

from __future__ import annotations

import io
import json
from typing import Any

import pytest

from fakes import FakeProbe
from imud.cli.view import (
    PIPE_S,
    TERMINAL_S,
    Heard,
    Screen,
    equipment_words,
    ledger_words,
    notes_words,
)

POSE: dict[str, Any] = {
    "q": [1.0, 0.0, 0.0, 0.0],
    "tilt_sigma_deg": 0.375,
    "heading_sigma_deg": None,
    "flags": ["at_rest", "heading_free"],
}
LEDGER: dict[str, Any] = {"sent": 9, "received": 6, "lost": 2, "duplicated": 1}
EARLIER: dict[str, Any] = {"sent": 5, "received": 5, "lost": 0, "duplicated": 0}
STATUS: dict[str, Any] = {
    "ledger": LEDGER
    | {
        "skewed": {"missing": 1},
        "corrupt": 3,
        "dropped": {"log": 0, "zenoh": 4},
        "earlier_boots": EARLIER | {"skewed": {}},
    },
    "twin": {"state": "off", "compared": 0, "differed": 0},
}


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def heard() -> Heard:
    one = Heard(status=STATUS)
    for number in range(101):
        one.take_pose(json.dumps(POSE).encode(), number * 0.01)
    return one


def test_a_terminal_is_drawn_over_in_place() -> None:
    out = Terminal()
    screen = Screen(out)
    assert screen.period_s == TERMINAL_S
    screen.draw({"p": heard()}, 1.0)
    first = out.getvalue()
    screen.draw({"p": heard()}, 1.0)
    assert out.getvalue() == first + "\x1b[2F" + first
    assert first.count("\n") == 2


def test_a_pipe_gets_plain_lines_under_one_heading() -> None:
    out = io.StringIO()
    screen = Screen(out)
    assert screen.period_s == PIPE_S
    screen.draw({}, 0.0)
    assert out.getvalue() == ""
    for _ in range(2):
        screen.draw({"p": heard()}, 1.0)
    lines = out.getvalue().splitlines()
    assert "\x1b" not in out.getvalue()
    assert len(lines) == 3
    assert lines[1].split() == [
        *("p", "0.00", "0.00", "0.00", "±0.38", "?", "100", "Hz"),
        *("at_rest", "heading_free"),
    ]


def test_the_ledger_is_told_in_a_line() -> None:
    assert ledger_words(STATUS) == (
        "14 sent = 11 received + 1 skewed + 2 lost; 3 corrupt, 1 duplicated, 4 dropped"
    )


@pytest.mark.parametrize(
    ("state", "differed", "words"),
    [
        ("off", 0, "4 dropped"),
        ("waiting", 0, "4 dropped; twin waiting"),
        ("following", 3, "4 dropped; twin following, 3 of 50"),
    ],
)
def test_the_twin_is_a_word(state: str, differed: int, words: str) -> None:
    twin = {"state": state, "compared": 50, "differed": differed}
    assert ledger_words(STATUS | {"twin": twin}).endswith(words)


EQUIPMENT: dict[str, Any] = {
    "clock": "crystal",
    "battery_v": None,
    "power": [],
    "radio": {"state": "cable", "resets": 0},
    "card": None,
}
CARD: dict[str, Any] = {
    "state": "logging",
    "recording": 1,
    "block": 16384,
    "blocks": 65536,
    "faults": 0,
    "busy_ms": 3,
    "logged": 100,
    "unlogged": 0,
}


@pytest.mark.parametrize(
    ("parts", "words"),
    [
        ({}, ""),
        ({"card": CARD | {"state": "absent", "blocks": 0}}, ""),
        ({"clock": "spare"}, "spare clock"),
        ({"battery_v": 3.9}, "battery 3.90 V"),
        (
            {"battery_v": 3.9, "power": ["external", "charging"]},
            "battery 3.90 V charging",
        ),
        ({"battery_v": 3.31, "power": ["low"]}, "battery 3.31 V low"),
        ({"radio": {"state": "waiting", "resets": 2}}, "radio waiting"),
        ({"radio": None}, ""),
        ({"card": CARD}, "card logging 25 %"),
        ({"card": CARD | {"unlogged": 7}}, "card logging 25 %, 7 not logged"),
        ({"card": CARD | {"state": "unprepared", "blocks": 0}}, "card unprepared"),
        (
            {"clock": "spare", "battery_v": 3.3, "card": CARD | {"state": "failed"}},
            "spare clock, battery 3.30 V, card failed 25 %",
        ),
    ],
)
def test_equipment_is_told_where_there_is_something_to_say(
    parts: dict[str, Any], words: str
) -> None:
    assert equipment_words(EQUIPMENT | parts) == words


def test_a_board_without_equipment_has_nothing_to_say() -> None:
    assert equipment_words(None) == ""


def test_a_log_that_pauses_is_said_beside_it() -> None:
    spare = EQUIPMENT | {"clock": "spare"}
    paused = {"state": "paused", "reason": "no room"}
    assert notes_words({"equipment": None, "log": paused}) == "log paused"
    words = notes_words({"equipment": spare, "log": paused})
    assert words.startswith("log paused, spare clock")
    assert notes_words({"equipment": None, "log": {"state": "on"}}) == ""


def test_the_rate_is_that_of_the_last_second() -> None:
    one = heard()
    assert one.mean_hz == pytest.approx(100.0)
    assert one.rate_hz(1.5) == 50
    assert one.rate_hz(9.0) == 0


def test_missing_numbers_are_counted_and_a_restart_is_none() -> None:
    one, probe = Heard(), FakeProbe()
    contents = [probe.content("pose") for _ in range(10)]
    for content in contents[:3] + contents[5:]:
        one.take_frame(content)
    assert one.missing == 2
    probe.restart()
    for _ in range(3):
        one.take_frame(probe.content("pose"))
    assert one.missing == 2
