# SPDX-License-Identifier: MIT
"""The phrases of the journal's lines, and how often they are written."""

from __future__ import annotations

from typing import Any

import pytest

from chain import Chain
from imud.journal import phrases
from imud.journal.speaker import Limiter
from imud.probes import record
from imud.probes.session import Session
from imud.wire import schema


@pytest.mark.parametrize(
    ("event", "words"),
    [
        (("clock_failed", "crystal", 0), "clock failed (crystal), at its start"),
        (("clock_failed", "crystal", 1), "clock failed (crystal), while it ran"),
        (("card_fault", "absent", 0), "card fault (absent)"),
        (("card_fault", "worn", 812), "card fault (worn), at block 812"),
        (("log_started", "none", 3), "log started, recording 3"),
        (("battery_low", "battery", 3310), "battery low (battery), 3310 mV"),
        (("radio_dropped", "none", 0), "radio dropped"),
        (("bus_fault", "stuck_bus", 2), "bus fault (stuck bus), 2"),
        (("overrun", "late", 4), "overrun (late), 4 missed"),
    ],
)
def test_an_event_is_told_in_words(event: tuple[str, str, int], words: str) -> None:
    assert phrases.event_words(*event) == words


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (
            {"reset_cause": ("hard_fault",), "reset_address": 0x08001234},
            "hard fault at ",
        ),
        ({"reset_cause": ("watchdog",), "reset_address": 0x08001234}, "watchdog at "),
        ({"reset_cause": ("watchdog",)}, "watchdog"),
        ({"reset_cause": ("power_on",), "reset_address": 0x08001234}, "power on"),
    ],
)
def test_a_restart_says_where_it_struck(
    chain: Chain, fields: dict[str, Any], words: str
) -> None:
    chain.probe.restart()
    chain.port.write(chain.probe.say("hello", **fields))
    where = "0x08001234" if words.endswith("at ") else ""
    line = chain.daemon.expect("restarted on")
    assert line.endswith(f"boot 8 ({words}{where})")


def test_a_kind_of_line_is_written_once_in_a_while() -> None:
    limiter = Limiter(quiet_s=10.0, burst=2)
    said = [limiter.allow("a", t) for t in (0.0, 1.0, 2.0, 9.9, 10.0, 10.5, 11.0)]
    assert said == [
        "",
        "",
        None,
        None,
        " (and 2 like it before)",
        None,
        " (and 1 like it before)",
    ]
    assert limiter.allow("b", 11.0) == ""


def test_the_status_names_only_what_the_schema_knows() -> None:
    known = {m.name for m in schema.MESSAGES}
    assert known >= record.JSON_TOPICS
    events = {member.name.lower() for member in schema.Event}
    assert events >= phrases.FAULTS | phrases.DETAILS.keys()
    causes = {member.name.lower() for member in schema.ResetCauseFlags}
    assert causes >= phrases.WITH_ADDRESS
    assert set(Session(lambda _: None, 0).counts()) >= {"corrupt", "foreign"}  # type: ignore[arg-type,return-value] # none is found here
