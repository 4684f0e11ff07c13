# SPDX-License-Identifier: MIT
"""What board_test.c shows of every board: each function takes a board and checks it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from letters import NACK, OK, STUCK, TIMEOUT, Board, Run

POWER_ON, EXTERNAL, BROWN_OUT, WATCHDOG, SOFTWARE = "01", "02", "04", "08", "10"

# Longest of any function of board.h but board_init, microseconds.
BOUND_US = 5000


@dataclass(frozen=True)
class Room:
    """What differs between boards."""

    slots: int  # samples that wait for the main loop
    stack: Callable[[Run], int]  # bytes that it may take


Fact = Callable[[Board, Room], None]


def starts(run: Run) -> list[str]:
    """The causes of all starts."""
    return [words[0] for words in run.words("start")]


def resets_are_told_by_their_kinds(board: Board, _: Room) -> None:
    assert starts(board(seconds=0.1)) == [POWER_ON]
    for kind, cause in (("reset", EXTERNAL), ("brown_out", BROWN_OUT)):
        run = board(seconds=0.5, faults=[{"kind": kind, "at_us": 200000}])
        assert starts(run) == [POWER_ON, cause]


def an_absent_device_is_a_nack(board: Board, _: Room) -> None:
    run = board((100, "nr"), seconds=0.2)
    assert [words[0] for words in run.words("read")] == [str(NACK), str(OK)]


def a_held_sda_is_reported_in_time_and_freed_by_clocks(board: Board, _: Room) -> None:
    for byte in range(4):
        fault = {"kind": "stuck_sda", "transaction": 1, "byte": byte, "clocks": 7}
        run = board((100, "rvr"), seconds=0.2, faults=[fault])
        reads = run.words("read")
        assert int(reads[0][0]) in (STUCK, TIMEOUT)
        assert int(reads[0][-1]) < BOUND_US
        assert run.numbers("recover")[0][0] == OK
        assert int(reads[1][0]) == OK


def an_sda_held_for_ever_is_reported_in_time_by_all(board: Board, _: Room) -> None:
    fault = {"kind": "stuck_sda", "at_us": 50000}
    run = board((100, "rvr"), seconds=0.2, faults=[fault])
    results = run.words("read") + run.words("recover")
    assert [int(words[0]) for words in results] == [STUCK] * 3
    assert all(int(words[-1]) < BOUND_US for words in results)


def every_edge_is_taken_or_counted_as_missed(board: Board, room: Room) -> None:
    run = board((100, "uswtwto"), seconds=0.5)
    took = run.numbers("took")
    missed, ready = run.numbers("sample")[0][-2:]
    assert [taken for taken, *_ in took] == [room.slots] * 2
    # The F405's line stays high while nobody reads: there are no more edges than
    # readings, but for the one whose reading came too late.
    assert sum(t + m for t, m, *_ in took) + 1 + missed == ready > 2 * room.slots


def samples_that_a_stop_leaves_behind_are_counted_as_missed(
    board: Board, room: Room
) -> None:
    run = board((100, "uswpswto"), seconds=0.5)
    ((taken, before, *_),) = run.numbers("took")
    missed, ready = run.numbers("sample")[0][-2:]
    assert taken == room.slots <= before
    assert taken + before + 1 + missed == ready


def what_is_stored_differs_nowhere_and_touches_nothing_else(
    board: Board, _: Room
) -> None:
    run = board((100, "e"), seconds=0.5)
    assert [stored[:2] for stored in run.numbers("stored")] == [[0, 0xFF]]


def the_free_stack_agrees_with_the_emulators_own_count(
    board: Board, room: Room
) -> None:
    run = board((100, "dd"), seconds=0.2)
    (before, after), (again, _) = run.numbers("stack")
    assert before - 380 <= after < before - 150
    assert again == after
    assert abs(room.stack(run) - run.summary["stack_max"] - after) <= 8


def the_button_is_down_while_it_is_pressed(board: Board, _: Room) -> None:
    letters = ((ms, "b") for ms in (100, 200, 300))
    run = board(*letters, seconds=0.4, options=("--press", "150000:250000"))
    assert run.numbers("button") == [[0], [1], [0]]


ALL = (
    resets_are_told_by_their_kinds,
    an_absent_device_is_a_nack,
    a_held_sda_is_reported_in_time_and_freed_by_clocks,
    an_sda_held_for_ever_is_reported_in_time_by_all,
    every_edge_is_taken_or_counted_as_missed,
    samples_that_a_stop_leaves_behind_are_counted_as_missed,
    what_is_stored_differs_nowhere_and_touches_nothing_else,
    the_free_stack_agrees_with_the_emulators_own_count,
    the_button_is_down_while_it_is_pressed,
)
