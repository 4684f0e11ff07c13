# SPDX-License-Identifier: MIT
"""Battery, charger and sleep, in the virtual STM32F405."""

from __future__ import annotations

import pytest

from board_facts import starts
from letters import Board, Run

POWER_ON, EXTERNAL, SOFTWARE = "01", "02", "10"
UNKNOWN = 65535
SUPPLY, CHARGING, LOW = 1, 2, 4


def battery(mv: int) -> tuple[str, str]:
    return "--battery", str(mv)


def battery_in(run: Run) -> list[list[int]]:
    """Millivolts, flags, how often it has got low."""
    return run.numbers("battery")


def test_where_nothing_is_wired_no_battery_is_known_or_low(board: Board) -> None:
    run = board((100, "y"), (20_000, "y"), seconds=20.1)
    assert battery_in(run) == [[UNKNOWN, 0, 0]] * 2


@pytest.mark.parametrize("mv", [2500, 3300, 4200])
def test_a_battery_is_measured_through_its_divider(board: Board, mv: int) -> None:
    ((measured, flags, _),) = battery_in(
        board((500, "y"), seconds=0.6, options=battery(mv))
    )
    assert abs(measured - mv) < 20
    assert flags == 0


def test_a_low_battery_is_told_once_and_not_before_ten_seconds(board: Board) -> None:
    sent = [(at, "y") for at in (9000, 11_000, 20_000)]
    run = board(*sent, seconds=20.1, options=battery(3200))
    assert [line[1:] for line in battery_in(run)] == [[0, 0], [LOW, 1], [LOW, 1]]


def test_the_chargers_pins_are_told(board: Board) -> None:
    faults = [
        {"kind": "charger", "at_us": 1_000_000, "value": 3},
        {"kind": "charger", "at_us": 4_000_000, "value": 1},
        {"kind": "charger", "at_us": 6_000_000, "value": 0},
    ]
    sent = [(at, "y") for at in (500, 3000, 5000, 7000)]
    run = board(*sent, seconds=7.1, options=battery(3700), faults=faults)
    assert [line[1] for line in battery_in(run)] == [0, SUPPLY | CHARGING, SUPPLY, 0]


def test_the_button_ends_sleep_with_a_start_by_software(board: Board) -> None:
    run = board(
        *((100, "i"), (200, "S"), (4900, "i")),
        seconds=5,
        options=("--press", "4000000:4200000"),
    )
    assert starts(run) == [POWER_ON, SOFTWARE]
    assert len(run.words("id")) == 2


def test_nothing_but_a_steady_press_ends_sleep(board: Board) -> None:
    run = board(
        *((200, "S"), (1000, "iii")),
        seconds=10,
        options=("--press", "3000000:3040000", "--press", "5000000:5049000"),
    )
    assert starts(run) == [POWER_ON]
    assert run.words("id") == []
    assert run.summary["resets"] == 1


def test_a_charger_ends_sleep_and_keeps_it_away(board: Board) -> None:
    plugged = [{"kind": "charger", "at_us": 3_000_000, "value": 3}]
    run = board(
        *((200, "S"), (4000, "S")),
        seconds=6,
        options=battery(3200),
        faults=plugged,
    )
    assert starts(run) == [POWER_ON, SOFTWARE, SOFTWARE]


def test_a_reset_from_outside_ends_sleep(board: Board) -> None:
    reset = [{"kind": "reset", "at_us": 3_000_000}]
    run = board((200, "S"), seconds=5, faults=reset)
    assert starts(run) == [POWER_ON, EXTERNAL]


def test_samples_are_as_good_behind_a_sleep(board: Board) -> None:
    run = board(
        *((200, "S"), (2500, "usooor")),
        seconds=3,
        options=("--press", "2000000:2200000"),
    )
    assert len(run.words("sample")) == 3
    assert run.words("read")[0][:2] == ["0", "d4"]
