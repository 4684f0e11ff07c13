# SPDX-License-Identifier: MIT
"""firmware/stm32, function by function, in the virtual STM32F405.

board_test.c obeys letters on its wire; what it prints are the lines here.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

import board_facts
from board_facts import POWER_ON, SOFTWARE, WATCHDOG, Fact, starts
from letters import OK, Board
from stm32.starts import addresses, places

pytestmark = pytest.mark.sampled(3)

HARD_FAULT = "20"

# The first start erases a sector before it prints; then letters are obeyed.
READY_MS = 2500


@pytest.mark.parametrize("fact", board_facts.ALL, ids=lambda fact: fact.__name__)
def test_a_fact_of_every_board(board: Board, fact: Fact) -> None:
    fact(board, board_facts.Room(slots=8, stack=lambda _: 8192))


@pytest.mark.parametrize("letter", ["H", "D"])
def test_the_watchdogs_end_a_hang_with_and_without_interrupts(
    board: Board, letter: str
) -> None:
    run = board((100, letter), (1150, "r"), seconds=1.2)
    assert starts(run) == [POWER_ON, WATCHDOG]
    assert run.words("read")[0][0] == "0"


@pytest.mark.parametrize("letter", ["F", "Z", "I"])
def test_a_fault_is_told_at_the_next_start(board: Board, letter: str) -> None:
    run = board((100, letter), (200, "r"), seconds=0.3)
    assert starts(run) == [POWER_ON, HARD_FAULT]
    assert run.words("read")[0][0] == "0"


def test_a_software_reset_is_told_from_the_watchdogs(board: Board) -> None:
    run = board((100, "R"), (150, "r"), (200, "H"), seconds=0.6)
    assert starts(run) == [POWER_ON, SOFTWARE, WATCHDOG]
    assert run.words("read")[0][0] == "0"


@pytest.mark.parametrize(
    ("letter", "function"),
    [("H", "hang"), ("F", "load_from"), ("Z", "divide"), ("U", "undefined")],
)
def test_where_a_program_was_struck_is_told_at_the_next_start_and_only_then(
    board: Board, program: Path, letter: str, function: str
) -> None:
    run = board((100, letter), (400, "R"), seconds=0.5)
    cause = WATCHDOG if letter == "H" else HARD_FAULT
    assert starts(run) == [POWER_ON, cause, SOFTWARE]
    assert addresses(run) == [0, places(program)[function].start, 0]


def test_a_stray_interrupt_is_told_by_what_it_interrupted(
    board: Board, program: Path
) -> None:
    run = board((100, "I"), seconds=0.2)
    _, address = addresses(run)
    assert address in places(program)["interrupt"]


@pytest.mark.parametrize(
    ("letter", "cause"),
    # The hardware's watchdog saves nothing; what is not on the stack is not believed.
    [("D", WATCHDOG), ("L", HARD_FAULT)],
)
def test_no_address_is_told_where_none_was_kept(
    board: Board, letter: str, cause: str
) -> None:
    run = board((100, "F"), (200, letter), seconds=1.3)
    assert starts(run) == [POWER_ON, HARD_FAULT, cause]
    _, first, second = addresses(run)
    assert (first != 0, second) == (True, 0)


@pytest.mark.parametrize("kind", ["reset", "brown_out"])
def test_a_reset_from_outside_has_no_address(board: Board, kind: str) -> None:
    run = board((100, "F"), seconds=0.5, faults=[{"kind": kind, "at_us": 200000}])
    assert [address != 0 for address in addresses(run)] == [False, True, False]


def test_registers_are_read_one_two_three_and_four_at_a_time(board: Board) -> None:
    run = board((100, "ur234"), seconds=0.2)
    assert run.numbers("set up") == [[OK, OK]]
    assert [words[:2] for words in run.words("read")] == [
        ["0", "d4"],
        ["0", "8f20"],
        ["0", "8f2000"],
        ["0", "8f200000"],
    ]
    # One byte is three and a half on the wire, at 400 kHz.
    assert 80 <= int(run.words("read")[0][2]) <= 110


def test_samples_are_stamped_at_their_edges_and_none_is_stale(board: Board) -> None:
    run = board((100, "us" + "o" * 40), seconds=0.5)
    samples = run.words("sample")
    times = [int(words[1]) for words in samples]
    assert len(times) == 40
    # 380 Hz; the model's clock is off by a few hundred ppm, its stamp by 1 us.
    assert all(2600 <= b - a <= 2660 for a, b in itertools.pairwise(times))
    assert all(bytes.fromhex(words[0])[0] & 0x08 for words in samples), "ZYXDA"
    assert [int(words[2]) for words in samples] == [0] * 40
    ready = [int(words[3]) for words in samples]
    assert ready == list(range(ready[0], ready[0] + 40))


@pytest.mark.parametrize(
    ("letter", "at", "expected"),
    [("<", 0, "498f20"), (">", 6, "8f200049"), ("=", 6, "8f20")],
)
def test_bursts_of_one_two_and_three_bytes_follow_each_other(
    board: Board, letter: str, at: int, expected: str
) -> None:
    run = board((100, "u" + letter + "ooooo"), seconds=0.3)
    samples = run.words("sample")
    assert len(samples) == 5
    for words in samples:
        assert words[0][2 * at : 2 * at + len(expected)] == expected
        assert words[2] == "0"


def test_a_send_takes_all_or_nothing_and_idle_means_gone(board: Board) -> None:
    run = board((100, "f"), seconds=0.5)
    assert "-" + "." * 16250 in run.lines
    assert "sent 1 65 0 0" in run.lines


def test_bytes_beyond_the_1024_that_wait_are_lost_and_counted(board: Board) -> None:
    run = board((100, "w" + "b" * 1100 + "l"), seconds=0.5)
    lost = run.numbers("lost")
    assert lost == [[1102 - 1 - 1024]]


def test_what_is_stored_is_there_after_a_power_cut(
    board: Board, used_flash: bytes, tmp_path: Path
) -> None:
    flash = tmp_path / "kept"
    flash.write_bytes(used_flash)
    ((differences, untouched, longest),) = board(
        (100, "e"), seconds=0.2, flash=flash
    ).numbers("stored")
    assert (differences, untouched) == (0, 0xFF)
    assert longest < 200
    assert board((100, "k"), seconds=0.2, flash=flash).numbers("holds") == [
        [100 * 7 % 256, 119 * 7 % 256]
    ]


def test_the_id_is_one_and_the_same_at_each_start(board: Board) -> None:
    ids = [board((100, "i"), seconds=0.2).words("id")[0] for _ in range(2)]
    assert ids[0] == ids[1]
    assert ids[0][0] == "1"
    assert set(ids[0][1]) != {"0"}


def test_the_supply_is_known_from_the_first_look_on(board: Board) -> None:
    run = board((100, "mm"), seconds=0.2)
    assert all(abs(mv - 3300) < 30 for (mv,) in run.numbers("supply"))


def test_the_clock_neither_stops_nor_jumps(board: Board) -> None:
    ((longest,),) = board((100, "c"), seconds=0.5).numbers("clock")
    assert longest < 10
