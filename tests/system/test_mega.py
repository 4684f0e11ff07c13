# SPDX-License-Identifier: MIT
"""The Mega's image in simavr: the same bits as on the host, strokes on the board, each
sample within its period, and its bootloaders. The tests that all boards share run with
it in `make test-long`.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

import bootloaders
from benchmarks.common.boards import MEGA as MEASURED
from benchmarks.strokes import on_host
from benchmarks.strokes.runs import run_of
from bits.processors import replayed
from bootloaders import NONE, STK500BOOT, STK500BOOT_OLD
from fakes import free_endpoint
from imud import cli
from imud.cli import reached
from stm32.starts import places
from system import stroked
from system.live import LiveProbe
from system.virtual import (
    MEGA,
    Run,
    Stub,
    assert_nothing_is_lost,
    damaged,
    run,
    send,
    write_hand,
)

pytestmark = pytest.mark.nightly

PERIOD = MEGA.clock_hz // MEGA.rate_hz
WHEN_US = 2_000_000
APPLY = ("--send", f"{WHEN_US}:{send('params_apply', token=2)}")
STRUCK = "params_store_apply"  # what only that command calls
HANG = 0xCFFF  # rjmp to itself
WAITS_MS = 832.5  # of stk500boot, as measured
# Its watchdog's way back into the firmware jumps beside it, and ends in its own start.
WAITS_AGAIN = WAITS_MS


@pytest.fixture
def mega(boards: dict[str, tuple[Path, Path]], tmp_path: Path) -> Stub:
    return Stub(MEGA, *boards["mega"], tmp_path)


def causes(done: Run) -> list[tuple[str, ...]]:
    """Of each boot."""
    hellos = [hello.fields for hello in done.named("hello")]
    return [*{each["boot_count"]: each["reset_cause"] for each in hellos}.values()]


def ms_to_last_start(done: Run) -> float:
    begun = done.summary["clock_restart_ns"] - done.summary["clock_start_ns"]
    return float(begun / 1e6 - WHEN_US / 1e3)


def test_its_poses_are_in_every_bit_those_of_the_host_and_each_in_its_period(
    mega: Stub,
) -> None:
    motion = ("--motion", write_hand(mega.folder / "hand", 60))
    rate = ("--send", f"340000:{send('rate', 0, MEGA.rate_hz, token=9)}")
    words = (*motion, *rate, "--press", "200000:300000", *mega.raw_too)
    done = run(mega, 60, *words)
    both = zip(done.contents, done.messages, strict=True)
    poses = [content for content, message in both if message.name == "pose"]
    assert len(poses) > MEGA.rate_hz * 58
    assert poses == list(replayed(done.contents))
    assert_nothing_is_lost(done)
    assert done.summary["cycles_worst"] < PERIOD
    assert done.last_status["cycles_worst"] < PERIOD
    # It looks at what was never used of it.
    assert MEGA.ram - done.summary["ram"] - 600 < done.last_status["stack_free"]


def test_strokes_are_in_every_bit_those_of_the_host_and_take_no_longer(
    mega: Stub,
) -> None:
    for name in ("supported, 1 s", "between rests, 1 s"):
        case = next(each for each in on_host.CASES if each.name == name)
        motion = run_of(case, 1000 * on_host.CASES.index(case) + 1, MEASURED.chip)
        capture = stroked.sent(MEASURED, mega.image, motion)
        row = on_host.row_of(case, [stroked.found_by(capture, motion)])
        assert row["under 1 cm"] == 100.0
        assert capture.twin().differed == 0
        assert (capture.lost, capture.summary["late"]) == (0, 0)
        assert capture.summary["cycles_worst"] < PERIOD


def test_without_a_data_ready_wire_it_asks(mega: Stub) -> None:
    motion = ("--motion", write_hand(mega.folder / "hand", 9))
    words = (*motion, "--press", "200000:300000", "--ready", "none", *mega.raw_too)
    done = run(mega, 9, *words)
    assert ("data_ready_polled", "no_data_ready") in done.events
    assert len(done.named("pose")) > 600
    assert done.account["lost"] == 0


@pytest.mark.parametrize(
    ("name", "told", "waits_ms"),
    [
        (NONE, [("power_on",), ("external",)], 0.0),
        (STK500BOOT, [(), ()], WAITS_MS),
        (STK500BOOT_OLD, [("power_on",), ("external",)], WAITS_MS),
    ],
)
def test_a_reset_is_told_where_the_bootloader_leaves_its_flag(
    mega: Stub, name: str, told: list[tuple[str, ...]], waits_ms: float
) -> None:
    options = bootloaders.options(name)
    reset = [{"kind": "reset", "at_us": WHEN_US}]
    done = run(mega, 5, *options, faults=reset)
    assert causes(done) == told
    assert ms_to_last_start(done) == pytest.approx(waits_ms, abs=60)


@pytest.mark.parametrize(
    ("name", "told", "waits_ms", "resets"),
    [
        (NONE, ("watchdog",), 0.0, 1),
        (STK500BOOT, (), WAITS_AGAIN, 1),
        (STK500BOOT_OLD, ("watchdog",), 0.0, 0),  # the image starts itself
    ],
)
def test_a_hang_ends_by_itself(
    mega: Stub, name: str, told: tuple[str, ...], waits_ms: float, resets: int
) -> None:
    hung = damaged(mega, places(mega.image)[STRUCK].start, HANG)
    done = run(hung, 5, *bootloaders.options(name), *APPLY)
    assert causes(done)[1:] == [told]
    assert 400 + waits_ms < ms_to_last_start(done) < 600 + waits_ms
    assert done.summary["resets"] == resets


@pytest.mark.parametrize("name", [NONE, STK500BOOT, STK500BOOT_OLD])
def test_a_reset_that_was_asked_for_is_told(mega: Stub, name: str) -> None:
    order = send("reset", token=3)
    options = bootloaders.options(name)
    done = run(mega, 5, *options, "--send", f"{WHEN_US}:{order}")
    assert causes(done)[1:] == [("software",)]
    waits_ms = 0.0 if name == NONE else WAITS_MS
    assert ms_to_last_start(done) == pytest.approx(waits_ms + 20, abs=70)


@pytest.fixture
def live(mega: Stub) -> Iterator[LiveProbe]:
    options = (*bootloaders.options(STK500BOOT), "--eeprom", mega.folder / "eeprom")
    probe = LiveProbe(mega, "--reset-on-open", *options)
    yield probe
    probe.end()


def test_its_bootloader_takes_an_image(
    mega: Stub,
    live: LiveProbe,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(mega.folder / "state"))
    endpoint = free_endpoint()
    monkeypatch.setattr(reached, "ENDPOINT", endpoint)
    monkeypatch.setattr("imud.cli.arguments.ENDPOINT", endpoint)
    built = mega.image.with_suffix(".hex")
    assert json.loads(built.with_name("manifest.json").read_text())
    shutil.copy(built, mega.folder / built.name)
    shutil.copy(built.with_name("manifest.json"), mega.folder)
    words = [str(live.port), "--image", str(mega.folder / built.name), "--force"]
    assert cli.main(["flash", *words]) == 0
    said = capsys.readouterr().out
    assert "an Arduino Mega 2560, firmware" in said
    assert "pages written and read back" in said
    assert "active, as before: no params" in said
