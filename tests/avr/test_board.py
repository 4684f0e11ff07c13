# SPDX-License-Identifier: MIT
"""firmware/avr in the virtual Nano, function by function.

board_test.c calls a function for each letter that it receives and prints a line.
"""

from __future__ import annotations

import itertools
import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

import bootloaders
import images
from bits.processors import PROCESSORS, command
from length import choose
from letters import FAILED_BURSTS, NACK, OK, STUCK, TIMEOUT, Board, Run

POWER_ON, EXTERNAL, BROWN_OUT, WATCHDOG, SOFTWARE = "01", "02", "04", "08", "10"

# The longest that any function of board.h takes, in microseconds.
BOUND_US = 5000


PROCESSOR = choose(everyday=["atmega328p"], long=["atmega328p", "atmega2560"])
RAM = {"atmega328p": 2048, "atmega2560": 8192}


@pytest.fixture(scope="module", params=PROCESSOR)
def processor(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(scope="module")
def program(root: Path, processor: str) -> Path:
    core = {*(root / "firmware" / "core").rglob("*.c")}
    avr = root / "firmware" / "avr"  # of its two sensors one is linked
    core.discard(root / "firmware" / "core" / "math" / "fixed_mul.c")
    return images.program(
        *(*command(PROCESSORS[processor]), root / "tests" / "avr" / "board_test.c"),
        *sorted(core),
        *sorted((root / "firmware" / "generic").glob("*.c")),
        *sorted({*avr.glob("*.[cS]")} - {avr / "chip_pair.c"}),
    )


@pytest.fixture
def board(program: Path, nano: Path, tmp_path: Path) -> Board:
    def run(
        *sent: tuple[int, str],
        seconds: float = 1.0,
        faults: list[dict[str, Any]] | None = None,
        options: tuple[str, ...] = (),
    ) -> Run:
        """Send letters at times in milliseconds."""
        record, summary = tmp_path / "record", tmp_path / "summary"
        (tmp_path / "faults").write_text(json.dumps(faults or []), encoding="ascii")
        command: list[str | Path] = [
            *(nano, "--image", program, "--record", record, "--summary", summary),
            *("--fast", "--seconds", str(seconds), "--faults", tmp_path / "faults"),
            *options,
        ]
        for at_ms, letters in sent:
            command += ["--send", f"{at_ms * 1000}:{letters.encode().hex()}"]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return Run(
            record.read_text(encoding="ascii").splitlines(),
            json.loads(summary.read_text(encoding="ascii")),
        )

    return run


def starts(run: Run) -> list[str]:
    return [line[6:] for line in run.lines if line.startswith("start ")]


def test_power_is_told_as_the_cause_of_the_first_start(board: Board) -> None:
    assert starts(board(seconds=0.1)) == [POWER_ON]


@pytest.mark.parametrize(
    ("kind", "cause"), [("reset", EXTERNAL), ("brown_out", BROWN_OUT)]
)
def test_a_reset_from_outside_is_told_by_its_kind(
    board: Board, kind: str, cause: str
) -> None:
    run = board(seconds=0.5, faults=[{"kind": kind, "at_us": 200000}])
    assert starts(run) == [POWER_ON, cause]


@pytest.mark.parametrize("letter", ["H", "I"])
def test_the_watchdog_ends_a_hang_and_an_interrupt_of_nobody(
    board: Board, letter: str
) -> None:
    run = board((100, letter), (900, "r"), seconds=1.0)
    assert starts(run) == [POWER_ON, WATCHDOG]
    assert run.numbers("read")[0][0] == OK


def test_a_software_reset_is_told_from_the_watchdogs_and_takes_50_ms_at_most(
    board: Board,
) -> None:
    run = board((100, "R"), (150, "r"), (200, "H"), seconds=1.0)
    assert starts(run) == [POWER_ON, SOFTWARE, WATCHDOG]
    assert run.numbers("read")[0][0] == OK


@pytest.fixture
def after_it(processor: str) -> tuple[str, ...]:
    """Has a bootloader start the image, which does not stop a watchdog."""
    return bootloaders.options(bootloaders.RUNS_ON[processor])


@pytest.mark.parametrize("letter", ["H", "I"])
def test_after_a_bootloader_that_runs_on_the_image_ends_a_hang_itself(
    board: Board, letter: str, after_it: tuple[str, ...]
) -> None:
    sent = ((100, letter), (900, "r"), (1000, letter), (1900, "r"))
    run = board(*sent, seconds=2.0, options=after_it)
    assert starts(run) == [POWER_ON, WATCHDOG, WATCHDOG]
    assert [result for result, *_ in run.numbers("read")] == [OK, OK]
    assert run.summary["resets"] == 0


def test_after_one_that_runs_on_a_software_reset_starts_the_bootloader(
    board: Board, after_it: tuple[str, ...]
) -> None:
    sent = ((100, "R"), (2000, "r"), (2100, "H"), (2700, "r"))
    run = board(*sent, seconds=3.0, options=after_it)
    assert starts(run) == [POWER_ON, SOFTWARE, WATCHDOG]
    assert [result for result, *_ in run.numbers("read")] == [OK, OK]
    assert run.summary["resets"] == 0


def test_a_start_without_a_reset_finds_the_bus_whatever_was_on_it(
    board: Board, after_it: tuple[str, ...]
) -> None:
    moments = [chr(ord("A") + i) for i in range(30)]  # a burst takes 0.6 ms
    sent = [
        (100 + 60 * i + after, letters)
        for i, moment in enumerate(moments)
        for after, letters in ((0, f"usJ{moment}"), (40, "ktrvr"))
    ]
    run = board(*sent, seconds=2.0, options=after_it)
    assert starts(run) == [POWER_ON, *[WATCHDOG] * 30]
    # OCIE0A alone, of the board's own clock.
    assert run.numbers("masks") == [[2]] * 30
    # The sensor continues, but nobody listens until sampling is started.
    assert [ready for *_, ready, _, _ in run.numbers("took")] == [0] * 30
    reads = run.numbers("read")
    assert all(us < BOUND_US for *_, us in reads)
    assert [result for result, *_ in reads[1::2]] == [OK] * 30
    assert [result for result, *_ in run.numbers("recover")] == [OK] * 30
    assert run.summary["firmware_complaint"] is None
    assert run.summary["sensor_complaint"] is None


def test_a_register_is_read(board: Board) -> None:
    (line,) = [x for x in board((100, "r"), seconds=0.2).lines if "read" in x]
    assert line.startswith("read 0 71 ")


def test_an_absent_device_is_a_nack(board: Board) -> None:
    run = board((100, "nr"), seconds=0.2)
    assert [result for result, *_ in run.numbers("read")] == [NACK, OK]


@pytest.mark.parametrize("byte", range(4))
def test_a_held_sda_is_reported_in_time_and_freed_by_clocks(
    board: Board, byte: int
) -> None:
    fault = {"kind": "stuck_sda", "transaction": 1, "byte": byte, "clocks": 7}
    run = board((100, "rvr"), seconds=0.2, faults=[fault])
    reads = run.numbers("read")
    assert reads[0][0] in (STUCK, TIMEOUT)
    assert reads[0][-1] < BOUND_US
    assert run.numbers("recover")[0][0] == OK
    assert reads[1][0] == OK


def test_an_sda_held_for_ever_is_reported_in_time_by_all(board: Board) -> None:
    run = board(
        (100, "rvr"), seconds=0.2, faults=[{"kind": "stuck_sda", "at_us": 50000}]
    )
    results = run.numbers("read") + run.numbers("recover")
    assert [result for result, *_ in results] == [STUCK] * 3
    assert all(us < BOUND_US for *_, us in results)


def test_samples_are_stamped_every_5_ms(board: Board) -> None:
    run = board((100, "us" + "o" * 20), seconds=0.5)
    times = [at for at, _, _ in run.numbers("sample")]
    assert len(times) == 20
    assert {b - a for a, b in itertools.pairwise(times)} <= {4999, 5000, 5001}
    assert all(
        line.startswith("sample 0x0800 ") for line in run.lines if "sample" in line
    )


def test_every_edge_is_taken_or_counted_as_missed(board: Board) -> None:
    run = board((100, "uswtwto"), seconds=0.5)
    took = run.numbers("took")
    (_, missed, ready) = run.numbers("sample")[0]
    assert [taken for taken, *_ in took] == [2, 2]
    assert sum(t + m for t, m, *_ in took) + 1 + missed == ready > 20


def test_samples_that_a_stop_leaves_behind_are_counted_as_missed(board: Board) -> None:
    run = board((100, "uswpswto"), seconds=0.5)
    ((taken, before, *_),) = run.numbers("took")
    _, missed, ready = run.numbers("sample")[0]
    assert taken == 2
    assert taken + before + 1 + missed == ready


@FAILED_BURSTS
def test_a_failed_burst_is_reported_once_and_sampling_goes_on_after_recovery(
    board: Board, fault: dict[str, Any], failures: set[int]
) -> None:
    run = board((100, "uswttpvso"), seconds=0.5, faults=[fault | {"transaction": 3}])
    first, second = run.numbers("took")
    assert first[-2] == -1
    assert first[-1] in failures
    assert second[-2] == 1
    assert run.numbers("recover")[0][0] == OK
    ((_, missed, ready),) = run.numbers("sample")
    assert ready == missed + 2, "the failed one and the last one"


def test_a_send_takes_all_or_nothing_and_idle_means_gone(board: Board) -> None:
    run = board((100, "f"), seconds=0.2)
    assert "-" + "." * 190 in run.lines
    assert "sent 1 1 0 1 gone 0 idle 0" in run.lines


def test_bytes_beyond_the_64_that_wait_are_lost_and_counted(board: Board) -> None:
    run = board((100, "w" + "l" * 80), seconds=0.5)
    assert run.numbers("lost") == [[16]] * 64


def test_the_eeprom_keeps_what_is_written(board: Board) -> None:
    assert "eeprom 0 ff" in board((100, "e"), seconds=0.5).lines


def test_entropy_differs_from_call_to_call_and_from_board_to_board(
    board: Board,
) -> None:
    seen = [
        word
        for seed in ("1", "2")
        for word in board((100, "x"), seconds=0.2, options=("--seed", seed)).lines[1:]
    ]
    words = " ".join(seen).replace("entropy ", "").split()
    assert len(words) == len(set(words)) == 4


def test_the_supply_is_known_from_the_second_look_on(board: Board) -> None:
    run = board((100, "m"), (110, "m"), (120, "m"), seconds=0.2)
    (first,), (second,), (third,) = run.numbers("supply")
    assert first == 0
    assert abs(second - 5000) < 50
    assert abs(third - 5000) < 50


def test_the_clock_neither_stops_nor_jumps_where_its_timer_overflows(
    board: Board,
) -> None:
    ((longest,),) = board((100, "c"), seconds=0.5).numbers("clock")
    assert longest < 60


def test_the_free_stack_agrees_with_the_emulators_own_count(
    board: Board, processor: str
) -> None:
    run = board((100, "dd"), seconds=0.2)
    (before, after), (again, _) = run.numbers("stack")
    assert before - 300 <= after < before - 150
    assert again == after
    used = run.summary["ram"] + run.summary["stack_max"]
    assert abs(RAM[processor] - used - after) <= 2


def test_the_button_is_down_while_it_is_pressed(board: Board) -> None:
    run = board(
        (100, "b"),
        (200, "b"),
        (300, "b"),
        seconds=0.4,
        options=("--press", "150000:250000"),
    )
    assert run.numbers("button") == [[0], [1], [0]]


def test_a_board_with_nothing_to_do_sleeps(board: Board) -> None:
    assert board(seconds=1.0).summary["idle"] > 0.99
