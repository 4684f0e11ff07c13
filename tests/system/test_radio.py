# SPDX-License-Identifier: MIT
"""A host at the far end of an RN-41: the image that is flashed sets the module up,
streams through it, and accounts for what a dropped link has cost."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from imud.recordings import decode
from system.virtual import BOARDS, Run, Stub, run, send

PRESS_US = 5_000_000  # calibrated, and a host is there
CLICK = ("--press", f"{PRESS_US}:{PRESS_US + 100_000}")
POSE_US = 10_000

Runner = Callable[..., Run]


@pytest.fixture
def stub(boards: dict[str, tuple[Path, Path]], tmp_path: Path) -> Stub:
    """The board that has a radio."""
    return Stub(BOARDS["f405"], *boards["f405"], tmp_path)


@pytest.fixture
def radio(stub: Stub) -> Runner:
    """Runs with one module, from the factory the first time."""

    def with_it(seconds: float, *options: object, **how: Any) -> Run:
        words = ("--radio", stub.folder / "rn41", "--eeprom", stub.folder / "flash")
        done = run(stub, seconds, *words, *options, **how)
        assert not done.summary["crashed"]
        for who in ("firmware", "sensor", "radio"):
            assert done.summary[f"{who}_complaint"] is None
        return done

    return with_it


def told(done: Run, event: str) -> list[Mapping[str, Any]]:
    return [m.fields for m in done.named("event") if m.fields["event"] == event]


def corrupt(done: Run) -> int:
    """Frames that came damaged."""
    tally = decode.Tally()
    for _ in decode.decode_file(done.record, tally):
        pass
    (link,) = tally.links
    return int(link["corrupt"])


def test_a_host_gets_a_hello_first_and_nothing_of_the_modules_own(
    radio: Runner, stub: Stub
) -> None:
    first = radio(9)
    second = radio(9, *CLICK)
    for done in (first, second):
        assert done.messages[0].name == "hello"
        assert done.account["lost"] == 0
        assert corrupt(done) == 0
        assert done.named("equipment")[-1].fields["radio"] == "connected"
    # Configured once, permanently.
    assert (first.summary["radio_writes"], second.summary["radio_writes"]) == (3, 0)
    (probe_id,) = {m.fields["probe_id"] for m in second.named("hello")}
    assert isinstance(probe_id, bytes)
    settings = (stub.folder / "rn41").read_text(encoding="ascii")
    assert f"\nSN=imu-probe-{probe_id.hex()[-4:]}".lower() in settings.lower()
    times = [m.time_us for m in second.named("pose")]
    assert len(times) > 350
    assert max(b - a for a, b in pairwise(times)) < 1.5 * POSE_US


def test_a_dropped_link_costs_what_was_sent_without_it_and_each_is_counted(
    radio: Runner,
) -> None:
    radio(7)
    drop = {"kind": "radio_drop", "at_us": 8_000_000, "for_us": 2_000_000}
    done = radio(14, *CLICK, faults=[drop])
    (back,) = [e for e in told(done, "radio_connected") if e["detail"]]
    gap_us = back["detail"] * 1000
    assert 1_900_000 < gap_us < 4_500_000
    after = next(
        n
        for n, m in enumerate(done.messages)
        if n and m.sequence != done.messages[n - 1].sequence + 1
    )
    hello, connected = done.messages[after : after + 2]
    assert hello.name == "hello"
    assert connected.fields["event"] == "radio_connected"
    missing = hello.sequence - done.messages[after - 1].sequence - 1
    dropped = done.last_status["messages_dropped"] - told_before(done, after)
    # Beside those that found no link: what the module held when it dropped, and what
    # the probe had on its way into it.
    assert 0 <= missing - dropped <= 40
    assert done.account["lost"] == missing
    assert abs(missing * POSE_US - gap_us) < 0.25 * gap_us
    later = done.messages[after:]
    assert [m.sequence for m in later] == list(
        range(hello.sequence, hello.sequence + len(later))
    )


def told_before(done: Run, index: int) -> int:
    """Messages that were dropped before the first host came, by the last status."""
    statuses = [m for m in done.messages[:index] if m.name == "status"]
    return int(statuses[-1].fields["messages_dropped"])


def test_a_command_over_the_radio_is_obeyed_and_data_is_no_command(
    radio: Runner,
) -> None:
    radio(7)
    # Three of its escape characters, alone in their second, while a host is there.
    order = send("rate", 0, 50, token=5)
    done = radio(
        *(10, "--send", f"5000000:{b'$$$'.hex()}", "--send", f"8000000:{order}")
    )
    assert [m.fields["result"] for m in done.named("reply")] == ["ok"]
    assert done.named("hello")[-1].fields["pose_rate"] == 50
    assert done.last_status["commands_bad"] == 1  # what it is to a probe: noise
    assert done.named("equipment")[-1].fields["radio"] == "connected"


@pytest.mark.nightly
def test_more_than_the_radio_carries_is_dropped_by_whole_messages(
    radio: Runner,
) -> None:
    radio(7)
    quiet = radio(7)
    every = [send("fields", 3, token=6), send("rate", 1, 380, token=7)]
    every.append(send("rate", 0, 380, token=8))
    orders = [
        word
        for n, order in enumerate(every)
        for word in ("--send", f"{4_000_000 + 50_000 * n}:{order}")
    ]
    done = radio(15, *orders, *CLICK)
    assert corrupt(done) == 0
    # What a start says while the module starts, too, reaches nobody.
    lost = done.summary["radio_lost_to_host"]
    assert lost == quiet.summary["radio_lost_to_host"] < 500
    assert done.summary["late"] == 0
    assert done.last_status["samples_fused"] == done.last_status["samples_read"]
    assert done.last_status["messages_dropped"] > 0


@pytest.mark.nightly
def test_a_module_that_is_deaf_is_told_once_and_found_when_it_hears(
    radio: Runner,
) -> None:
    faults = [
        {"kind": "radio_deaf", "at_us": 0, "for_us": 25_000_000},
        {"kind": "radio_away", "at_us": 0, "for_us": 60_000_000},
    ]
    done = radio(75, faults=faults)
    assert done.messages[0].name == "hello"
    assert done.named("equipment")[-1].fields["radio"] == "connected"
    assert done.named("equipment")[-1].fields["radio_resets"] >= 1
    assert done.summary["radio_writes"] == 3
