# SPDX-License-Identifier: MIT
"""The phrases for a status that `imud listen`, `list` and `monitor` share."""

from __future__ import annotations

from typing import Any

import pytest

from imud.cli.status_text import equipment_words, ledger_words, notes_words

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
