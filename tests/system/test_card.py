# SPDX-License-Identifier: MIT
"""The log on the card: the image that is flashed writes it to a modelled card, imud
reads it back, and each sample is compared with what went over the wire."""

from __future__ import annotations

import pytest

from imud.cli import main
from imud.log.reader import Logged
from log_files import read_log
from system.card_log import (
    CLICK,
    RATE_HZ,
    all_on_the_wire,
    assert_it_is_the_wires,
    equipment,
    events,
    prepare,
    recordings,
    samples,
)
from system.virtual import Stub, assert_nothing_is_lost, run, send, write_hand

pytestmark = pytest.mark.parametrize("stub", ["f405"], indirect=True)


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


@pytest.mark.nightly
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
