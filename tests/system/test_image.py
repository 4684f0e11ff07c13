# SPDX-License-Identifier: MIT
"""The image as flashed, in its emulator: button, commands, budget, settings."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import pytest

from length import choose
from system.virtual import (
    BOARDS,
    Board,
    Run,
    Stub,
    assert_nothing_is_lost,
    every_board,
    run,
    send,
    write_hand,
)

pytestmark = pytest.mark.sampled(4)

CLICK = ("--press", "200000:300000")  # before the sensor is ready


def each(cases: Callable[[Board], Iterable[Any]]) -> list[Any]:
    """For parametrize: each board with each of what is its own."""
    return [
        pytest.param(name, value, id=f"{name}-{value}")
        for name, board in BOARDS.items()
        for value in cases(board)
    ]


def without_card(done: Run) -> list[tuple[Any, Any]]:
    """Events, but for the one that a board with an empty slot tells at its start."""
    return [event for event in done.events if event != ("card_fault", "absent")]


# The button and commands.


@every_board
def test_a_click_starts_the_stream_and_the_next_one_stops_it(stub: Stub) -> None:
    done = run(stub, 4, *CLICK, "--press", "2000000:2100000")
    events = without_card(done)
    assert events[1:5] == [
        ("button_pressed", "button"),
        ("button_released", "button"),
        ("stream_started", "button"),
        ("button_pressed", "button"),
    ]
    assert events[5:7] == [
        ("button_released", "button"),
        ("stream_stopped", "button"),
    ]
    stopped_us = next(
        m.time_us for m in done.named("event") if m.fields["event"] == "stream_stopped"
    )
    times = [pose.time_us for pose in done.named("pose")]
    assert stub.board.ready_us < times[0] < stub.board.ready_us + 60_000
    assert 2_140_000 < times[-1] <= stopped_us < 2_170_000
    assert_nothing_is_lost(done)


@every_board
def test_poses_come_at_100_hz_by_default(stub: Stub) -> None:
    done = run(stub, 6, *CLICK)
    times = np.array([pose.time_us for pose in done.named("pose")])
    assert np.all(np.abs(np.diff(times) - 10_000) < stub.board.unevenness_us)
    assert abs((len(times) - 1) / (times[-1] - times[0]) * 1e6 - 100) < 0.3
    assert len(times) > 470
    assert_nothing_is_lost(done)


@pytest.mark.parametrize(
    ("stub", "rate_hz"),
    each(lambda board: (1, 7, 150, board.rate_hz)),
    indirect=["stub"],
)
def test_a_rate_is_kept_evenly(stub: Stub, rate_hz: int) -> None:
    done = run(stub, 5, *CLICK, "--send", f"350000:{send('rate', 0, rate_hz)}")
    (reply,) = done.named("reply")
    assert (reply.fields["result"], reply.fields["value"]) == ("ok", (0, rate_hz))
    times = np.array([pose.time_us for pose in done.named("pose")])
    seconds = 5 - stub.board.ready_us * 1e-6
    assert abs(len(times) - seconds * rate_hz) <= 0.01 * rate_hz + 1
    sample_us = 1e6 / stub.board.rate_hz
    assert np.all(np.abs(np.diff(times) - 1e6 / rate_hz) <= sample_us + 30)
    assert_nothing_is_lost(done)


@every_board
def test_commands_start_stop_tare_and_reset(stub: Stub) -> None:
    words = [("start", 1_500_000), ("tare", 2_000_000), ("stop", 2_500_000)]
    words += [("hello", 2_600_000), ("reset", 3_000_000)]
    options = itertools.chain.from_iterable(
        ("--send", f"{at}:{send(name, token=i + 1)}")
        for i, (name, at) in enumerate(words)
    )
    done = run(stub, 5, *options)
    replies = [
        (r.fields["replied_command"], r.fields["result"]) for r in done.named("reply")
    ]
    assert replies == [(name, "ok") for name, _ in words]
    assert ("stream_started", "command") in done.events
    assert ("stream_stopped", "command") in done.events
    poses = done.named("pose")
    tared = [pose for pose in poses if "tared" in pose.fields["pose_flags"]]
    assert poses[0] not in tared
    assert tared[0].fields["q"] == pytest.approx((1, 0, 0, 0), abs=1e-4)
    hellos = done.named("hello")
    assert hellos[0].fields["reset_cause"] == ("power_on",)
    assert hellos[-1].fields["reset_cause"] == ("software",)
    assert hellos[-1].fields["boot_count"] == hellos[0].fields["boot_count"] + 1
    assert done.summary["resets"] == 1


@every_board
def test_noise_on_the_wire_is_counted_and_a_command_behind_it_obeyed(
    stub: Stub,
) -> None:
    noise = bytes(np.random.default_rng(5).integers(0, 256, 600, np.uint8)).hex()
    done = run(
        stub,
        3,
        "--send",
        f"1000000:{noise}",
        "--send",
        f"1500000:{send('start', token=9)}",
    )
    assert ("stream_started", "command") in done.events
    assert done.last_status["commands_bad"] > 0
    assert done.last_status["commands_received"] == 1


# The budget, promise 4.


@pytest.mark.long
def test_nothing_is_late_with_all_streams_at_the_rate_of_samples(stub: Stub) -> None:
    board = stub.board
    seconds = choose(everyday=8, long=20)
    hand = write_hand(stub.folder / "hand", seconds)
    done = run(
        *(stub, seconds, "--motion", hand, *CLICK, *stub.raw_too),
        *("--send", f"350000:{send('rate', 0, board.rate_hz, token=8)}"),
    )
    assert_nothing_is_lost(done)
    least = (seconds - board.ready_us * 1e-6) * board.rate_hz * 0.99
    assert len(done.named("pose")) > least
    assert len(done.named("raw")) > least
    summary = done.summary
    assert summary["cycles_worst"] <= board.clock_hz / board.rate_hz
    assert summary["flash"] <= board.flash
    assert summary["ram"] + (board.stack or 0) <= board.ram
    assert summary["stack_max"] <= stub.stack_room(summary) - 128
    assert done.last_status["stack_free"] >= 128


def test_the_image_tells_its_cycles_and_stack_as_the_emulator_does(stub: Stub) -> None:
    done = run(stub, 5, *CLICK)
    status = done.last_status
    # The probe's clock starts when it takes a sample and stops when it is sent; it
    # counts whole microseconds, and none where the work takes less.
    microsecond = stub.board.clock_hz / 1e6
    assert status["cycles_mean"] == pytest.approx(
        done.summary["cycles_mean"], rel=0.1, abs=2 * microsecond
    )
    assert status["stack_free"] == pytest.approx(
        stub.stack_room(done.summary) - done.summary["stack_max"], abs=24
    )


# Settings.

START_S = 0.7  # its settings are read and written by then


def boot_of(done: Run) -> tuple[Any, int]:
    fields = done.named("hello")[-1].fields
    return fields["probe_id"], fields["boot_count"]


@every_board
def test_a_probe_keeps_its_id_and_settings_and_counts_its_boots(stub: Stub) -> None:
    memory = ("--eeprom", stub.folder / "memory")
    first = run(stub, 2, *memory, "--send", f"500000:{send('rate', 0, 50)}")
    second = run(stub, 2, *memory)
    assert without_card(first) == [("settings_restored", "boot")]
    assert without_card(second) == []
    assert boot_of(second) == (boot_of(first)[0], boot_of(first)[1] + 1)
    assert second.named("hello")[-1].fields["pose_rate"] == 50


def test_two_probes_have_two_ids(stub: Stub) -> None:
    ids = {boot_of(run(stub, 1, "--seed", seed))[0] for seed in range(1, 6)}
    assert len(ids) == 5


@pytest.fixture(scope="module")
def first_starts() -> dict[str, tuple[bytes, tuple[Any, int]]]:
    """By board: what a first start leaves in its memory, and its id and boot."""
    return {}


@pytest.mark.parametrize("write", [*range(1, 8), *range(8, 24, 5)])
def test_power_cut_at_a_write_of_memory_leaves_one_good_slot(
    stub: Stub, write: int, first_starts: dict[str, tuple[bytes, tuple[Any, int]]]
) -> None:
    path = stub.folder / "memory"
    memory = ("--eeprom", path)
    if stub.board.name not in first_starts:
        first = run(stub, START_S, *memory)
        first_starts[stub.board.name] = path.read_bytes(), boot_of(first)
    content, (kept, boots) = first_starts[stub.board.name]
    path.write_bytes(content)
    cut = run(
        stub,
        START_S,
        *memory,
        faults=[{"kind": "power_cut", "write": write, "after_us": stub.board.write_us}],
    )
    after = run(stub, START_S, *memory)
    assert ("settings_restored", "boot") not in after.events
    assert boot_of(after)[0] == kept
    assert boot_of(after)[1] in (
        (boots + 1, boots + 2) if cut.summary["power_cut"] else (boots + 2,)
    )


def test_resets_while_memory_is_written_lose_no_settings(stub: Stub) -> None:
    memory = ("--eeprom", stub.folder / "memory")
    kept, boots = boot_of(
        run(stub, 2, *memory, "--send", f"500000:{send('rate', 0, 50)}")
    )
    # A boot writes its number, a byte every 5 ms. Each reset comes 0.4 ms later in it.
    moments = [15_000 * n + 200 * n * n for n in range(1, 33)]
    resets = [{"kind": "reset", "at_us": at_us} for at_us in moments]
    done = run(stub, 2, *memory, faults=resets)
    assert done.summary["resets"] == len(resets)
    assert done.summary["firmware_complaint"] is None
    hello = done.named("hello")[-1].fields
    assert (hello["probe_id"], hello["pose_rate"]) == (kept, 50)
    assert boots < hello["boot_count"] <= boots + 1 + len(resets)
    assert ("settings_restored", "boot") not in done.events
