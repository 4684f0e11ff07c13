# SPDX-License-Identifier: MIT
"""The STM32F405's clocks, whatever crystal its board has.

The emulator's crystal and the oscillator inside have the frequencies of its options;
what the firmware makes of them shows in the rates of core and UART.
"""

from __future__ import annotations

import itertools

import pytest

from board_facts import starts
from letters import Board, Run

pytestmark = pytest.mark.sampled(3)

POWER_ON = "01"
CORE_HZ = 168_000_000
BAUD = 913_043  # 42 MHz / 46

# Of HSI, from -10 to 85 degC.
COLD, WARM = 15.36, 16.64


def crystal(mhz: float, hsi_mhz: float = 16) -> tuple[str, ...]:
    return "--crystal", str(mhz), "--hsi", str(hsi_mhz)


def rates(run: Run) -> tuple[int, int]:
    return run.summary["core_hz"], run.summary["uart_baud"]


@pytest.mark.parametrize("mhz", [8, 12, 16, 25])
def test_any_usual_crystal_makes_the_same_rates(board: Board, mhz: float) -> None:
    run = board((100, "us" + "o" * 20), (200, "r"), seconds=0.3, options=crystal(mhz))
    assert starts(run) == [POWER_ON]
    assert rates(run) == (CORE_HZ, BAUD)
    times = [int(words[1]) for words in run.words("sample")]
    assert len(times) == 20
    assert all(2600 <= b - a <= 2660 for a, b in itertools.pairwise(times))
    assert run.words("read")[0][:2] == ["0", "d4"]


@pytest.mark.parametrize(
    ("mhz", "hsi_mhz"),
    [
        *itertools.product([8, 12, 16], [COLD, WARM]),
        # From 24 and 26 MHz it is told apart where HSI is within 2.4 %.
        *itertools.product([25], [15.63, 16.37]),
    ],
)
def test_a_crystal_is_known_by_an_oscillator_that_is_off(
    board: Board, mhz: float, hsi_mhz: float
) -> None:
    run = board(seconds=0.1, options=crystal(mhz, hsi_mhz))
    assert rates(run) == (CORE_HZ, BAUD)


# HSI is off by 1 % at most at 25 degC, and is what these boards run from.
@pytest.mark.parametrize("hsi_mhz", [15.84, 16.16])
@pytest.mark.parametrize(
    "mhz", [4, 6, 7.3728, 10, 11.0592, 14.31818, 14.7456, 18.432, 20, 24, 26]
)
def test_another_crystal_is_left_for_the_oscillator_inside(
    board: Board, mhz: float, hsi_mhz: float
) -> None:
    run = board((100, "r"), seconds=0.2, options=crystal(mhz, hsi_mhz))
    core_hz = round(CORE_HZ * hsi_mhz / 16)
    assert rates(run) == (core_hz, round(core_hz / 4 / 46))
    assert run.words("read")[0][:2] == ["0", "d4"]


@pytest.mark.parametrize("at_us", range(3000, 4300, 100))
def test_a_crystal_that_dies_at_any_step_of_the_start_ends_none(
    board: Board, at_us: int
) -> None:
    """Before it swings, while it is measured, as the PLL locks, and behind that."""
    dead = {"kind": "crystal", "at_us": at_us}
    run = board((100, "r"), seconds=0.2, faults=[dead])
    assert starts(run) == [POWER_ON]
    assert rates(run) == (CORE_HZ, BAUD)
    assert run.words("read")[0][:2] == ["0", "d4"]


def test_a_crystal_that_never_starts_changes_no_rate(board: Board) -> None:
    dead = {"kind": "crystal", "at_us": 0}
    run = board((200, "ur"), seconds=0.4, faults=[dead])
    assert starts(run) == [POWER_ON]
    assert run.words("read")[0][:2] == ["0", "d4"]


def test_a_crystal_that_dies_costs_a_moment(board: Board) -> None:
    dead = {"kind": "crystal", "at_us": 150000}
    run = board((100, "us" + "o" * 60), (400, "r"), seconds=0.6, faults=[dead])
    assert starts(run) == [POWER_ON]
    times = [int(words[1]) for words in run.words("sample") if len(words) == 4]
    assert len(times) >= 58
    steps = [b - a for a, b in itertools.pairwise(times)]
    assert sum(not 2600 <= step <= 2660 for step in steps) <= 2
