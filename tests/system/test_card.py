# SPDX-License-Identifier: MIT
"""The log on the card: the image that is flashed writes it to a modelled card, imud
reads it back, and each sample is compared with what went over the wire."""

from __future__ import annotations

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from imud.card.disk import opened
from imud.card.probe_log import find_log
from imud.cli import main
from imud.log.reader import Logged, read_log
from imud.wire.frame import FrameDecoder
from imud.wire.messages import Message, decode
from length import choose
from system.virtual import (
    BOARDS,
    Run,
    Stub,
    assert_nothing_is_lost,
    run,
    send,
    write_hand,
)

RATE_HZ = 380
SAMPLE_US = 1_000_000 / RATE_HZ
PRESS_US = 3_000_000  # it is calibrated by then
STREAMS_US = PRESS_US + 250_000  # and debounced; the log begins there
CLICK = ("--press", f"{PRESS_US}:{PRESS_US + 100_000}")
CUTS = choose(everyday=10, long=200)
LOST_US = 500_000  # before a cut, at most
RUN_MESSAGES = 8 * 496 // 39  # in the blocks that the card is given at once


@pytest.fixture
def stub(boards: dict[str, tuple[Path, Path]], tmp_path: Path) -> Stub:
    """The board that has a card."""
    return Stub(BOARDS["f405"], *boards["f405"], tmp_path)


def all_on_the_wire() -> tuple[object, ...]:
    """Options that have raw and pose of every sample sent, so as to compare."""
    orders = (send("fields", 3, token=6), send("rate", 1, RATE_HZ, token=7))
    orders = (*orders, send("rate", 0, RATE_HZ, token=8))
    return tuple(
        word
        for number, order in enumerate(orders)
        for word in ("--send", f"{1_600_000 + 20_000 * number}:{order}")
    )


def prepare(path: Path, size: str = "40M", log_size: str | None = None) -> Path:
    limit = ("--log-size", log_size) if log_size else ()
    assert main(["card", "prepare", str(path), "--size", size, "--yes", *limit]) == 0
    return path


@dataclass(frozen=True)
class Recorded:
    """A recording, as imud reads it from a card's image."""

    number: int
    is_ended: bool
    bad: int
    contents: list[bytes]

    @cached_property
    def messages(self) -> list[Message]:
        decoded = [decode(content) for content in self.contents]
        assert all(isinstance(message, Message) for message in decoded)
        return [message for message in decoded if isinstance(message, Message)]

    @cached_property
    def samples(self) -> dict[tuple[str, int], bytes]:
        """Raw and pose by kind and time: all but id and sequence number."""
        return samples(self.messages, self.contents)

    def named(self, name: str) -> list[Message]:
        return [message for message in self.messages if message.name == name]


def samples(
    messages: list[Message], contents: list[bytes]
) -> dict[tuple[str, int], bytes]:
    return {
        (message.name, message.time_us): content[5:]
        for message, content in zip(messages, contents, strict=True)
        if message.name in ("raw", "pose")
    }


def recordings(path: Path) -> list[Recorded]:
    with opened(path) as disk:
        log = find_log(disk)
        found = []
        for recording in log.recordings():
            decoder = FrameDecoder()
            contents = [c for data in log.frames(recording) for c in decoder.feed(data)]
            found.append(
                Recorded(recording.number, recording.is_ended, recording.bad, contents)
            )
        return found


def events(messages: list[Message]) -> list[tuple[Any, Any]]:
    return [
        (message.fields["event"], message.fields["cause"])
        for message in messages
        if message.name == "event"
    ]


def assert_it_is_the_wires(recorded: Recorded, done: Run) -> None:
    """Every sample from the first to the last of the recording, bit by bit."""
    wire = samples(done.messages, done.contents)
    log = recorded.samples
    begun, ended = min(t for _, t in log), max(t for _, t in log)
    expected = {key: data for key, data in wire.items() if begun <= key[1] <= ended}
    assert log == expected


def equipment(done: Run) -> dict[str, Any]:
    return dict(done.named("equipment")[-1].fields)


def test_the_log_has_every_sample_and_event_of_the_wire(stub: Stub) -> None:
    card = prepare(stub.folder / "card")
    hand = write_hand(stub.folder / "hand", 20)
    done = run(
        stub,
        18,
        *("--motion", hand, "--card", card, *CLICK, *all_on_the_wire()),
        *("--send", f"9000000:{send('tare', 0, token=9)}"),
        *("--press", "15000000:15100000"),
    )
    assert_nothing_is_lost(done)
    assert done.summary["card_complaint"] is None
    (recorded,) = recordings(card)
    assert (recorded.number, recorded.is_ended, recorded.bad) == (1, True, 0)
    assert recorded.messages[0].name == "hello"
    numbers = [message.sequence for message in recorded.messages]
    assert numbers == list(range(len(numbers)))
    assert_it_is_the_wires(recorded, done)
    wire = samples(done.messages, done.contents)
    assert len(recorded.samples) == len(wire) > 11.9 * 2 * RATE_HZ
    assert ("tared", "command") in events(recorded.messages)
    assert len(recorded.named("status")) in (11, 12)
    told = [event for event, _ in done.events if event.startswith(("log", "card"))]
    assert told == ["card_ready", "log_started", "log_ended"]
    assert equipment(done)["messages_unlogged"] == 0
    assert equipment(done)["messages_logged"] == len(numbers)


def test_what_is_read_is_the_log_that_the_daemon_would_have_written(
    stub: Stub, capsys: pytest.CaptureFixture[str]
) -> None:
    card = prepare(stub.folder / "card")
    run(stub, 8, "--card", card, *CLICK, "--press", "6000000:6100000")
    assert main(["card", "read", str(card), "--to", str(stub.folder / "out")]) == 0
    assert "ended cleanly" in capsys.readouterr().out
    (path,) = (stub.folder / "out").glob("*.mcap")
    (recorded,) = recordings(card)
    frames = [
        item.data
        for item in read_log(path)
        if isinstance(item, Logged) and item.topic == "frame"
    ]
    assert frames == recorded.contents
    assert main(["decode", str(path), "--json"]) == 0
    assert capsys.readouterr().out.count('"type":"raw"') == len(recorded.named("raw"))


def test_the_wire_may_have_less_than_the_log(stub: Stub) -> None:
    card = prepare(stub.folder / "card")
    done = run(stub, 8, "--card", card, *CLICK, "--press", "6000000:6100000")
    assert_nothing_is_lost(done)
    (recorded,) = recordings(card)
    kept = recorded.samples
    wire = samples(done.messages, done.contents)
    assert len(wire) < len(kept) / 7
    assert all(kept[key] == data for key, data in wire.items() if key in kept)
    assert sum(key in kept for key in wire) >= len(wire) - 1


def test_recordings_are_numbered_on_over_power_cuts_and_cards_stay_the_same(
    stub: Stub,
) -> None:
    card = prepare(stub.folder / "card")
    for _ in range(3):
        run(stub, 5, "--card", card, *CLICK)  # ends by losing power
    found = recordings(card)
    assert [(r.number, r.is_ended) for r in found] == [
        (1, False),
        (2, False),
        (3, False),
    ]
    assert all(len(r.named("raw")) > 1.4 * RATE_HZ for r in found)


# Power cut.


@dataclass(frozen=True)
class Undisturbed:
    """The run that the cut ones are the beginning of."""

    stub: Stub
    template: Path  # the card before
    options: tuple[object, ...]
    reference: Recorded


@pytest.fixture(scope="module")
def undisturbed(
    boards: dict[str, tuple[Path, Path]], tmp_path_factory: pytest.TempPathFactory
) -> Undisturbed:
    stub = Stub(BOARDS["f405"], *boards["f405"], tmp_path_factory.mktemp("cuts"))
    template = prepare(stub.folder / "template")
    card = stub.folder / "card"
    shutil.copy(template, card)
    options = ("--motion", write_hand(stub.folder / "hand", 8), *CLICK)
    assert_nothing_is_lost(run(stub, 7, *options, "--card", card))
    (reference,) = recordings(card)
    return Undisturbed(stub, template, options, reference)


def lost_us(whole: Undisturbed, folder: Path, at_us: int) -> int:
    """How much older than the cut the last sample is that it has left on the card."""
    folder.mkdir()
    card = folder / "card"
    subprocess.run(["cp", "--sparse=always", whole.template, card], check=True)
    cut = {"kind": "power_cut", "at_us": at_us}
    stub = replace(whole.stub, folder=folder)
    done = run(stub, 7, *whole.options, "--card", card, faults=[cut])
    assert done.summary["power_cut"]
    (recorded,) = recordings(card)
    assert not recorded.is_ended
    card.unlink()
    # Whatever is there is what would have been, byte by byte. Of the run that the card
    # was at, blocks may be there before which others are missing: those don't count.
    reference = whole.reference.contents
    numbers = [message.sequence for message in recorded.messages]
    assert recorded.contents == [reference[number] for number in numbers]
    whole_until = next(
        (n for n, number in enumerate(numbers) if n != number), len(numbers)
    )
    assert len(numbers) - whole_until < RUN_MESSAGES
    kept = [m for m in recorded.messages[:whole_until] if m.name == "raw"]
    return at_us - kept[-1].time_us


@pytest.mark.long
@pytest.mark.parametrize("part", range(CUTS // 10))
def test_a_cut_at_any_moment_loses_half_a_second_at_most(
    undisturbed: Undisturbed, tmp_path: Path, part: int
) -> None:
    moments = np.random.default_rng(4).integers(STREAMS_US + LOST_US, 6_500_000, CUTS)
    with ThreadPoolExecutor(2) as pool:
        losses = pool.map(
            lambda number: lost_us(
                undisturbed, tmp_path / str(number), int(moments[number])
            ),
            range(10 * part, 10 * part + 10),
        )
        assert all(0 <= lost <= LOST_US for lost in losses)


@pytest.mark.parametrize("after_us", [0, 120, 400])
def test_a_cut_in_the_midst_of_a_block_is_written_over_by_the_next_recording(
    stub: Stub, after_us: int
) -> None:
    card = prepare(stub.folder / "card")
    cut = {"kind": "power_cut", "card_write": 60, "after_us": after_us}
    assert run(stub, 9, "--card", card, *CLICK, faults=[cut]).summary["power_cut"]
    (first,) = recordings(card)
    run(stub, 6, "--card", card, *CLICK, "--press", "4000000:4100000")
    found = recordings(card)
    assert [r.number for r in found] == [1, 2]
    assert found[0].contents == first.contents
    # Blocks of the run that the card was at may be there, and others before them not.
    assert found[0].bad < 8
    assert found[1].bad == 0
    assert found[1].is_ended


# Cards that give trouble.


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


def test_a_reset_by_command_ends_the_log_first(stub: Stub) -> None:
    card = prepare(stub.folder / "card")
    done = run(stub, 7, *CLICK, "--card", card, "--send", f"5000000:{send('reset')}")
    assert done.summary["resets"] == 1
    (recorded,) = recordings(card)
    assert recorded.is_ended
    assert recorded.named("raw")[-1].time_us > 4_990_000


# Battery.


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
    told = [event for event in done.events if event[0] not in ("card_ready",)]
    at = told.index(("battery_low", "battery"))
    assert told[at + 1 : at + 4] == [
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


def test_where_nothing_is_wired_no_battery_is_low(stub: Stub) -> None:
    for seed in (1, 2, 3):
        done = run(stub, 14, "--seed", seed)
        assert all(m.fields["battery"] is None for m in done.named("equipment"))
        assert all(m.fields["power"] == () for m in done.named("equipment"))
