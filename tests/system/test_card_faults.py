# SPDX-License-Identifier: MIT
"""Cards that give trouble: what that costs, and what the probe tells of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from imud.card.disk import opened
from imud.card.probe_log import find_log
from system.card_log import (
    CLICK,
    LOST_US,
    all_on_the_wire,
    assert_it_is_the_wires,
    equipment,
    prepare,
    recordings,
)
from system.virtual import Stub, assert_nothing_is_lost, run, send

pytestmark = [
    pytest.mark.parametrize("stub", ["f405"], indirect=True),
    pytest.mark.sampled(2),
]


def test_a_card_that_is_pulled_costs_what_comes_until_it_is_back(stub: Stub) -> None:
    card = prepare(stub.folder / "card")
    pulled = {"kind": "card_pulled", "at_us": 5_000_000, "for_us": 2_000_000}
    done = run(stub, 11, *CLICK, *all_on_the_wire(), "--card", card, faults=[pulled])
    assert_nothing_is_lost(done)  # over the wire
    told = [event for event, _ in done.events]
    assert ("card_fault", "absent") in done.events
    assert told.count("log_started") == 2
    first, second = recordings(card)
    assert_it_is_the_wires(first, done)
    assert_it_is_the_wires(second, done)
    last_us = first.named("raw")[-1].time_us
    assert 5_000_000 - LOST_US <= last_us <= 5_000_000
    assert 7_000_000 < second.named("raw")[0].time_us < 9_500_000


@pytest.mark.parametrize("busy_ms", [250, 700])
def test_a_card_that_is_slow_loses_nothing(stub: Stub, busy_ms: int) -> None:
    card = prepare(stub.folder / "card")
    slow = {"kind": "card_slow", "ms": busy_ms, "card_write": 40, "card_writes": 1}
    again = slow | {"card_write": 160}
    done = run(
        *(stub, 9, *CLICK, *all_on_the_wire(), "--card", card),
        *("--press", "8000000:8100000"),
        faults=[slow, again],
    )
    assert_nothing_is_lost(done)
    (recorded,) = recordings(card)
    assert recorded.is_ended
    assert_it_is_the_wires(recorded, done)
    numbers = [message.sequence for message in recorded.messages]
    assert numbers == list(range(len(numbers)))
    assert equipment(done)["card_busy"] >= busy_ms
    assert equipment(done)["messages_unlogged"] == 0


@pytest.mark.parametrize("kind", ["card_crc", "card_error"])
def test_a_block_that_is_rejected_is_written_again(stub: Stub, kind: str) -> None:
    card = prepare(stub.folder / "card")
    done = run(
        *(stub, 6, *CLICK, *all_on_the_wire(), "--card", card),
        *("--press", "5000000:5100000"),
        faults=[{"kind": kind, "card_write": 30}],
    )
    assert_nothing_is_lost(done)
    (recorded,) = recordings(card)
    assert_it_is_the_wires(recorded, done)
    assert recorded.is_ended
    assert equipment(done)["card_faults"] > 0


@pytest.mark.nightly
def test_a_worn_place_is_left_out_and_nothing_is_lost(stub: Stub) -> None:
    card = prepare(stub.folder / "card")
    with opened(card) as disk:
        lba = find_log(disk).lba
    worn = {"kind": "card_worn", "block": lba + 25, "blocks": 3, "value": 0}
    done = run(
        *(stub, 8, *CLICK, *all_on_the_wire(), "--card", card),
        *("--press", "7000000:7100000"),
        faults=[worn],
    )
    assert_nothing_is_lost(done)
    assert ("card_fault", "worn") in done.events
    (recorded,) = recordings(card)
    assert recorded.bad == 3
    assert_it_is_the_wires(recorded, done)
    assert recorded.is_ended


def test_a_full_card_is_told_and_the_probe_goes_on(stub: Stub) -> None:
    card = prepare(stub.folder / "card", log_size="64K")
    done = run(stub, 8, *CLICK, *all_on_the_wire(), "--card", card)
    assert_nothing_is_lost(done)
    assert ("card_full", "full") in done.events
    assert equipment(done)["card"] == "full"
    (recorded,) = recordings(card)
    assert recorded.is_ended
    assert_it_is_the_wires(recorded, done)
    assert done.named("pose")[-1].time_us > 7_900_000


def blank(path: Path) -> Path:
    with path.open("wb") as file:
        file.truncate(40 << 20)
    return path


@pytest.mark.parametrize(
    ("fault", "state", "cause"),
    [(None, "unprepared", "unprepared"), ({"kind": "card_dead"}, "absent", "absent")],
    ids=["unprepared", "dead"],
)
def test_a_card_that_is_no_use_is_told(
    stub: Stub, fault: dict[str, Any] | None, state: str, cause: str
) -> None:
    card = blank(stub.folder / "card")
    before = card.read_bytes()
    done = run(
        *(stub, 8, *CLICK, "--card", card), faults=[fault] if fault is not None else []
    )
    assert_nothing_is_lost(done)
    assert ("card_fault", cause) in done.events
    assert [c for e, c in done.events if e == "card_fault"].count(cause) == 1
    assert equipment(done)["card"] == state
    assert card.read_bytes() == before


def test_no_card_is_told_once_and_does_no_harm(stub: Stub) -> None:
    done = run(stub, 6, *CLICK)
    assert_nothing_is_lost(done)
    assert done.events.count(("card_fault", "absent")) == 1
    assert equipment(done)["card"] == "absent"


@pytest.mark.nightly
def test_a_reset_by_command_ends_the_log_first(stub: Stub) -> None:
    card = prepare(stub.folder / "card")
    done = run(stub, 7, *CLICK, "--card", card, "--send", f"5000000:{send('reset')}")
    assert done.summary["resets"] == 1
    (recorded,) = recordings(card)
    assert recorded.is_ended
    assert recorded.named("raw")[-1].time_us > 4_990_000
