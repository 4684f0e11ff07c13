# SPDX-License-Identifier: MIT
"""The battery of a whole board: a low one ends the log and has the board sleep."""

from __future__ import annotations

import pytest

from length import choose
from system.card_log import CLICK, equipment, prepare, recordings
from system.virtual import Stub, run

pytestmark = pytest.mark.parametrize("stub", ["f405"], indirect=True)


def test_a_low_battery_ends_the_log_says_so_and_sleeps_until_the_button(
    stub: Stub,
) -> None:
    card = prepare(stub.folder / "card")
    empty = {"kind": "battery", "at_us": 4_000_000, "mv": 3100}
    full = {"kind": "battery", "at_us": 30_000_000, "mv": 3900}
    done = run(
        *(stub, 45, *CLICK, "--card", card, "--battery", 3900),
        *("--press", "35000000:35500000"),
        faults=[empty, full],
    )
    assert not done.summary["crashed"]
    assert done.summary["firmware_complaint"] is None
    events = [event for event in done.events if event[0] not in ("card_ready",)]
    at = events.index(("battery_low", "battery"))
    assert events[at + 1 : at + 4] == [
        ("stream_stopped", "battery"),
        ("log_ended", "battery"),
        ("going_to_sleep", "battery"),
    ]
    (low,) = [m for m in done.named("event") if m.fields["event"] == "battery_low"]
    assert 14_000_000 < low.time_us < 17_000_000  # ten seconds of it, smoothed
    assert 3050 <= low.fields["detail"] <= 3200
    (recorded,) = recordings(card)
    assert recorded.is_ended
    assert recorded.named("raw")[-1].time_us > low.time_us - 20_000
    hellos = done.named("hello")
    assert hellos[-1].fields["reset_cause"] == ("software",)
    assert done.summary["resets"] == 1
    assert done.last_status["state"] == "idle"
    assert equipment(done)["battery"] > 3800


def test_a_charger_is_told_and_keeps_a_low_battery_awake(stub: Stub) -> None:
    faults = [
        {"kind": "battery", "at_us": 1_000_000, "mv": 3000},
        {"kind": "charger", "at_us": 6_000_000, "value": 3},
    ]
    done = run(stub, 16, *CLICK, "--battery", 3900, faults=faults)
    assert not any(event == "battery_low" for event, _ in done.events)
    assert equipment(done)["power"] == ("external", "charging")
    assert done.last_status["state"] == "streaming"


@pytest.mark.long
def test_where_nothing_is_wired_no_battery_is_low(stub: Stub) -> None:
    for seed in choose(everyday=(1,), long=(1, 2, 3)):
        done = run(stub, 14, "--seed", seed)
        assert all(m.fields["battery"] is None for m in done.named("equipment"))
        assert all(m.fields["power"] == () for m in done.named("equipment"))
