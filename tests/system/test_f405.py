# SPDX-License-Identifier: MIT
"""Features of the STM32F405 alone: a crystal that can die, three bursts a sample, flash
that is erased by the sector."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from imud.wire.messages import Message
from stm32.starts import places
from system.virtual import (
    FIELDS_ALL,
    Run,
    Stub,
    assert_nothing_is_lost,
    damaged,
    run,
    send,
)

CLICK = ("--press", "200000:300000")
SECTORS = 0x0C0000  # of the settings: 10 and 11, to the end of flash

# Instructions: one that is none, and a branch to itself.
UNDEFINED, HANG = 0xDE00, 0xE7FE

pytestmark = pytest.mark.parametrize("stub", ["f405"], indirect=True)


def clocks(done: Run) -> list[Any]:
    return [message.fields["clock"] for message in done.named("equipment")]


def clock_failures(done: Run) -> list[tuple[Any, Any]]:
    """Cause and detail."""
    failed = [m for m in done.named("event") if m.fields["event"] == "clock_failed"]
    return [(m.fields["cause"], m.fields["detail"]) for m in failed]


def hellos(done: Run) -> list[Message]:
    return done.named("hello")


# 42 MHz / 46: what 921,600 baud come to.
BAUD = 913_043


@pytest.mark.parametrize("mhz", [8, 16, 25])
def test_boards_with_another_usual_crystal_lose_nothing(stub: Stub, mhz: int) -> None:
    done = run(stub, 4, *CLICK, *stub.raw_too, "--crystal", mhz)
    assert clock_failures(done) == []
    assert set(clocks(done)) == {"crystal"}
    assert done.summary["uart_baud"] == BAUD
    assert_nothing_is_lost(done)
    steps = np.diff([raw.time_us for raw in done.named("raw")])
    assert np.mean(steps) == pytest.approx(1e6 / stub.board.rate_hz, rel=0.002)


@pytest.mark.parametrize("mhz", [10, 24])
def test_a_crystal_of_another_frequency_is_told_at_a_readable_rate(
    stub: Stub, mhz: int
) -> None:
    done = run(stub, 4, *CLICK, *stub.raw_too, "--crystal", mhz)
    assert clock_failures(done) == [("crystal", 0)]
    assert set(clocks(done)) == {"spare"}
    assert done.summary["uart_baud"] == BAUD
    assert_nothing_is_lost(done)


def test_a_crystal_that_never_swings_is_told_and_costs_no_sample(stub: Stub) -> None:
    done = run(stub, 5, *CLICK, *stub.raw_too, faults=[{"kind": "crystal"}])
    assert clock_failures(done) == [("crystal", 0)]
    assert set(clocks(done)) == {"spare"}
    assert_nothing_is_lost(done)
    steps = np.diff([raw.time_us for raw in done.named("raw")])
    assert np.all(steps < 1.5e6 / stub.board.rate_hz)


def test_a_crystal_that_dies_while_it_streams_costs_a_torn_byte(stub: Stub) -> None:
    fault = {"kind": "crystal", "at_us": 3_000_000}
    done = run(stub, 6, *CLICK, *stub.raw_too, faults=[fault])
    assert clock_failures(done) == [("crystal", 1)]
    assert clocks(done)[0] == "crystal"
    assert clocks(done)[-1] == "spare"
    assert done.summary["resets"] == 0
    status = done.last_status
    assert status["bus_faults"] == status["messages_dropped"] == 0
    # The device clock loses 0.3 ms at most, and a message is torn where one was sent.
    raws = done.named("raw")
    steps = np.diff([raw.time_us for raw in raws]) * 1e-6 * stub.board.rate_hz
    assert np.sum(np.rint(steps) > 1) <= 1
    assert steps.max() < 2.4
    assert done.account["lost"] <= 1
    assert raws[-1].time_us > 5_950_000


def test_a_glitch_on_the_bus_never_passes_as_a_sample(stub: Stub) -> None:
    glitches = [{"kind": "glitch", "at_us": 3_000_000 + 90 * n} for n in range(30)]
    done = run(stub, 5, *CLICK, *stub.raw_too, faults=glitches)
    assert ("bus_fault", "stuck_bus") in done.events
    # At rest nothing turns: whatever came of the torn readings was thrown away.
    raws = np.array([raw.fields["gyr"] for raw in done.named("raw")])
    assert np.max(np.abs(raws)) < 50
    assert done.named("pose")[-1].time_us > 4_700_000


def test_bus_errors_that_did_not_happen_stop_no_stream(stub: Stub) -> None:
    # Over a whole period of 2.63 ms, in which there is a reading of 0.7.
    errors = [
        {"kind": "spurious_berr", "at_us": 3_000_000 + 2713 * n} for n in range(32)
    ]
    done = run(stub, 4, *CLICK, *stub.raw_too, faults=errors)
    hits = done.summary["i2c_bus_errors"]
    assert hits >= 6
    assert done.last_status["bus_faults"] <= hits / 5
    assert done.account["lost"] == 0


def test_raw_and_pose_beyond_what_the_sensor_has_are_refused(stub: Stub) -> None:
    done = run(stub, 3, "--send", f"2000000:{send('rate', 1, 381)}")
    (reply,) = done.named("reply")
    assert reply.fields["result"] == "bad_argument"


def test_a_used_sector_that_holds_no_settings_is_erased_once(stub: Stub) -> None:
    memory = stub.folder / "memory"
    flash = bytearray(b"\xff" * (1 << 20))
    flash[SECTORS : SECTORS + 16] = bytes(16)
    memory.write_bytes(flash)
    # The processor stands still for a second meanwhile; what was sent is not lost.
    first = run(stub, 3, "--eeprom", memory, "--send", f"1500000:{FIELDS_ALL}")
    second = run(stub, 1, "--eeprom", memory)
    assert ("settings_restored", "boot") in first.events
    assert [reply.fields["result"] for reply in first.named("reply")] == ["ok"]
    assert ("settings_restored", "boot") not in second.events
    assert first.summary["firmware_complaint"] is None


def test_two_runs_give_the_same_bytes(stub: Stub) -> None:
    records = [run(stub, 3.5, *CLICK).record.read_bytes() for _ in range(2)]
    assert records[0] == records[1]
    assert len(records[0]) > 1000


@pytest.mark.parametrize(
    ("instruction", "cause"), [(UNDEFINED, "hard_fault"), (HANG, "watchdog")]
)
def test_where_the_program_was_struck_is_in_the_next_hello(
    stub: Stub, instruction: int, cause: str
) -> None:
    place = places(stub.image)["pose_set_origin"].start
    tare = ("--send", f"2000000:{send('tare')}")
    start = ("--send", f"4000000:{send('start')}")
    done = run(damaged(stub, place, instruction), 5, *CLICK, *tare, *start)
    told = {(m.fields["reset_cause"], m.fields["reset_address"]) for m in hellos(done)}
    assert told == {(("power_on",), 0), ((cause,), place)}
    assert done.summary["resets"] == 1
    assert hellos(done)[-1].fields["boot_count"] == 2
    # And it works, as long as nobody asks for what is damaged.
    assert [m.fields["replied_command"] for m in done.named("reply")] == ["start"]
    assert done.named("pose")[-1].sequence > done.named("reply")[0].sequence


def test_a_reset_that_was_asked_for_has_no_address(stub: Stub) -> None:
    done = run(stub, 3, "--send", f"2000000:{send('reset')}")
    assert [m.fields["reset_address"] for m in hellos(done)] == [0] * len(hellos(done))
    assert hellos(done)[-1].fields["reset_cause"] == ("software",)
