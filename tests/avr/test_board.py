# SPDX-License-Identifier: MIT
"""firmware/avr in the virtual Nano, function by function.

board_test.c calls a function for each letter that it receives and prints a line.
"""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import pytest

import board_facts
import bootloaders
import images
from bits.processors import PROCESSORS, command
from board_facts import BOUND_US, POWER_ON, SOFTWARE, WATCHDOG, Fact, starts
from length import choose
from letters import FAILED_BURSTS, OK, Board, Run
from programs import ran

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
        *(*command(PROCESSORS[processor]), "-I", root / "tests" / "generic"),
        root / "tests" / "avr" / "board_test.c",
        root / "tests" / "generic" / "letters.c",
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
        done = ran(*command)
        assert done.returncode == 0, done.stderr
        return Run(
            record.read_text(encoding="ascii").splitlines(),
            json.loads(summary.read_text(encoding="ascii")),
        )

    return run


@pytest.mark.parametrize("fact", board_facts.ALL, ids=lambda fact: fact.__name__)
def test_a_fact_of_every_board(board: Board, fact: Fact, processor: str) -> None:
    def stack(run: Run) -> int:
        return int(RAM[processor] - run.summary["ram"])

    fact(board, board_facts.Room(slots=2, stack=stack))


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


@pytest.mark.parametrize(
    ("sent", "causes"),
    [
        (((100, "H"), (900, "r"), (1000, "H"), (1900, "r")), [WATCHDOG, WATCHDOG]),
        (((100, "I"), (900, "r"), (1000, "I"), (1900, "r")), [WATCHDOG, WATCHDOG]),
        (((100, "R"), (2000, "r"), (2100, "H"), (2700, "r")), [SOFTWARE, WATCHDOG]),
    ],
    ids=["a hang", "an unhandled interrupt", "a software reset, then a hang"],
)
def test_after_a_bootloader_that_runs_on_the_image_restarts_itself(
    board: Board, sent: Any, causes: list[int], after_it: tuple[str, ...]
) -> None:
    run = board(*sent, seconds=3.0, options=after_it)
    assert starts(run) == [POWER_ON, *causes]
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


def test_samples_are_stamped_every_5_ms(board: Board) -> None:
    run = board((100, "us" + "o" * 20), seconds=0.5)
    times = [int(words[1]) for words in run.words("sample")]
    assert len(times) == 20
    assert {b - a for a, b in itertools.pairwise(times)} <= {4999, 5000, 5001}
    assert all(words[0][8:12] == "0800" for words in run.words("sample"))


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
    ((*_, missed, ready),) = run.numbers("sample")
    assert ready == missed + 2, "the failed one and the last one"


def test_a_send_takes_all_or_nothing_and_idle_means_gone(board: Board) -> None:
    run = board((100, "f"), seconds=0.2)
    assert "-" + "." * 190 in run.lines
    assert "sent 1 1 0 1 0 0" in run.lines


def test_bytes_beyond_the_64_that_wait_are_lost_and_counted(board: Board) -> None:
    run = board((100, "w" + "l" * 80), seconds=0.5)
    assert run.numbers("lost") == [[16]] * 64


def test_entropy_differs_from_call_to_call_and_from_board_to_board(
    board: Board,
) -> None:
    found = [
        word
        for seed in ("1", "2")
        for words in board((100, "x"), seconds=0.2, options=("--seed", seed)).words(
            "entropy"
        )
        for word in words
    ]
    assert len(found) == len(set(found)) == 4


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


def test_a_board_with_nothing_to_do_sleeps(board: Board) -> None:
    assert board(seconds=1.0).summary["idle"] > 0.99
