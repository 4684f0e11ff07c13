# SPDX-License-Identifier: MIT
"""The Nano's image as a bootloader starts it, after each kind of reset and hang."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest

import bootloaders
from bootloaders import ATMEGABOOT, EVERY, HANDS_OVER, KEEPS_FLAGS, NONE, OPTIBOOT_4
from stm32.starts import places
from system.virtual import NANO, Run, Stub, damaged, run, send

pytestmark = pytest.mark.sampled(3)

WHEN_US = 2_000_000
START = ("--send", f"5500000:{send('start', token=9)}")
APPLY = ("--send", f"{WHEN_US}:{send('params_apply', token=2)}")
RESET = ("--send", f"{WHEN_US}:{send('reset', token=3)}")

STRUCK = "params_store_apply"  # what only that command calls
# rjmp to itself; cli.
HANG = 0xCFFF
INTERRUPTS_OFF = 0x94F8

UNKNOWN: tuple[str, ...] = ()
CLEARS = {OPTIBOOT_4, HANDS_OVER}  # MCUSR, before it starts the image

# Milliseconds from the end of a reset, as measured; from a hang or a command 524 and 25
# more at most.
WAITS = {
    NONE: 0,
    ATMEGABOOT: 1326,
    OPTIBOOT_4: 1399,
    KEEPS_FLAGS: 1024,
    HANDS_OVER: 1024,
}


@pytest.fixture
def probe(nano: Path, image: Path, tmp_path: Path) -> Stub:
    return Stub(NANO, nano, image, tmp_path)


def boots(done: Run) -> list[tuple[str, ...]]:
    """The cause of each boot. The clock of each begins at 0."""
    causes: dict[int, Any] = {}
    for hello in done.named("hello"):
        if hello.fields["boot_count"] not in causes:
            assert hello.time_us < 2000
            causes[hello.fields["boot_count"]] = hello.fields["reset_cause"]
    assert list(causes) == [*range(1, len(causes) + 1)]
    return [*causes.values()]


def ms_to_last_start(done: Run) -> float:
    summary = done.summary
    begun = summary["clock_restart_ns"] - summary["clock_start_ns"]
    return float(begun / 1e6 - WHEN_US / 1e3)


def assert_it_works(done: Run) -> None:
    assert not done.summary["crashed"]
    assert done.summary["firmware_complaint"] is None
    assert done.summary["sensor_complaint"] is None
    assert done.named("reply")[-1].fields["replied_command"] == "start"
    assert len(done.named("pose")) > 40
    faults = {"sensor_fault", "bus_fault"}
    assert not [event for event, _ in done.events if event in faults]


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("cause", ["external", "brown_out"])
def test_power_and_resets_are_told_where_the_bootloader_leaves_their_flags(
    probe: Stub, name: str, cause: str
) -> None:
    kind = "reset" if cause == "external" else cause
    faults = [{"kind": kind, "at_us": WHEN_US}]
    done = run(probe, 6, *bootloaders.options(name), *START, faults=faults)
    told = [UNKNOWN, UNKNOWN] if name in CLEARS else [("power_on",), (cause,)]
    assert boots(done) == told
    # Optiboot starts the image at once, unless the reset was external.
    waits = cause == "external" or name == ATMEGABOOT
    assert ms_to_last_start(done) == pytest.approx(WAITS[name] if waits else 0, abs=1)
    assert_it_works(done)


@pytest.mark.parametrize("name", EVERY)
def test_a_hang_ends_by_itself_and_is_told_as_the_watchdogs(
    probe: Stub, name: str
) -> None:
    hung = damaged(probe, places(probe.image)[STRUCK].start, HANG)
    again = ("--send", f"{WHEN_US + 1_500_000}:{send('params_apply', token=4)}")
    done = run(hung, 6, *bootloaders.options(name), *APPLY, *again, *START)
    last = UNKNOWN if name in CLEARS else ("watchdog",)
    assert boots(done)[1:] == [last, last]
    assert 1900 < ms_to_last_start(done) < 2030
    # After ATmegaBOOT the image starts itself.
    assert done.summary["resets"] == (0 if name == ATMEGABOOT else 2)
    assert_it_works(done)


@pytest.mark.parametrize("name", EVERY)
def test_a_reset_that_was_asked_for_is_told_whatever_the_bootloader_clears(
    probe: Stub, name: str
) -> None:
    done = run(probe, 6, *bootloaders.options(name), *RESET, *START)
    assert boots(done)[1:] == [("software",)]
    waits = WAITS[ATMEGABOOT] if name == ATMEGABOOT else 0
    assert waits < ms_to_last_start(done) < waits + 30
    assert_it_works(done)


def test_after_atmegaboot_a_reset_that_was_asked_for_lets_the_host_flash(
    probe: Stub,
) -> None:
    page = bytes(range(100, 228))
    there = "55c03b20"  # word address 0x3BC0, near the end of the image
    sent = {
        400_000: f"3020{there}",  # in sync?
        410_000: f"64008046{page.hex()}20",
        500_000: f"{there}7400804620",
    }
    options = [("--send", f"{WHEN_US + at_us}:{text}") for at_us, text in sent.items()]
    done = run(
        *(probe, 2.6, *bootloaders.options(ATMEGABOOT), *RESET),
        *itertools.chain.from_iterable(options),
    )
    in_sync = b"\x14\x10"
    read_back = b"\x14" + page + b"\x10"
    assert done.record.read_bytes().endswith(4 * in_sync + read_back)
    # 16 MHz / (16 * (16 + 1)), 2.1 % from 57,600.
    assert done.summary["uart_baud"] == 58823


def test_after_atmegaboot_a_hang_with_interrupts_off_lasts_until_the_port_is_opened(
    probe: Stub,
) -> None:
    at = places(probe.image)[STRUCK].start
    hung = damaged(damaged(probe, at, INTERRUPTS_OFF), at + 2, HANG)
    opened = [{"kind": "reset", "at_us": 2_900_000}]
    done = run(hung, 6, *bootloaders.options(ATMEGABOOT), *APPLY, *START, faults=opened)
    assert boots(done) == [("power_on",), ("external",)]
    assert ms_to_last_start(done) == pytest.approx(900 + WAITS[ATMEGABOOT], abs=1)
    assert_it_works(done)
