# SPDX-License-Identifier: MIT
"""The wire over a cable and over an RN-41, in the virtual STM32F405."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from letters import Board, Run

WAITING_MS = 6000  # by then a host is there, even with a module from the factory
CABLE, CONNECTED = 1, 4


@pytest.fixture
def radio(board: Board, tmp_path: Path) -> Board:
    """A board with an RN-41, from the factory the first time."""

    def run(*sent: tuple[int, str], **how: Any) -> Run:
        done = board(*sent, options=("--radio", str(tmp_path / "rn41")), **how)
        assert done.summary["radio_complaint"] is None
        return done

    return run


def test_a_cable_is_known_as_one(board: Board) -> None:
    run = board((100, "g"), seconds=0.2)
    assert run.numbers("radio") == [[CABLE, 0, 0, 0, 0, 0]]


def test_all_that_is_sampled_fits_on_a_cable(board: Board) -> None:
    run = board((100, "a"), seconds=1.3)
    assert run.numbers("refused") == [[0]]
    assert ":" * 38000 in run.lines[-2]


@pytest.mark.nightly
def test_a_wire_that_is_held_is_no_hang_and_no_loss(board: Board) -> None:
    run = board((100, "jg"), seconds=2)
    ((is_taken, took_us),) = run.numbers("held")
    assert is_taken
    assert 500_000 <= took_us < 520_000
    assert "held" in run.lines
    assert len(run.words("start")) == 1


def test_a_module_is_corrected_once(radio: Board, tmp_path: Path) -> None:
    first = radio((WAITING_MS, "g"), seconds=6.5)
    assert first.numbers("radio") == [[CONNECTED, 0, 0, 1, 0, 0]]
    assert first.summary["radio_writes"] == 3
    settings = (tmp_path / "rn41").read_text(encoding="ascii")
    assert "\nSN=imu-probe-" in settings
    assert {"SU=92", "SM=0", "ST=0"} <= set(settings.splitlines())
    second = radio((4000, "g"), seconds=4.5)
    assert second.numbers("radio") == [[CONNECTED, 0, 0, 1, 0, 0]]
    assert (second.summary["radio_writes"], second.summary["radio_resets"]) == (0, 1)


@pytest.mark.nightly
def test_a_link_that_drops_comes_back_and_what_follows_is_whole(radio: Board) -> None:
    radio(seconds=6)
    drop = {"kind": "radio_drop", "at_us": 5_000_000, "for_us": 2_000_000}
    run = radio((4000, "gi"), (8000, "gi"), seconds=9, faults=[drop])
    assert [line[4:] for line in run.numbers("radio")] == [[0, 0], [1, 0]]
    assert len({tuple(words) for words in run.words("id")}) == 1


def test_more_than_the_radio_takes_is_held_back_by_cts_and_arrives(
    radio: Board,
) -> None:
    radio(seconds=6)
    run = radio((4000, "f"), (4100, "g"), seconds=6)
    assert "-" + "." * 16250 in run.lines
    assert "sent 1 65 0 0" in run.lines
    assert run.summary["resets"] == 0


def test_a_module_that_says_nothing_for_a_minute_is_brought_back(radio: Board) -> None:
    faults = [
        {"kind": "radio_deaf", "at_us": 0, "for_us": 60_000_000},
        {"kind": "radio_away", "at_us": 0, "for_us": 100_000_000},
    ]
    run = radio((110_000, "g"), seconds=111, faults=faults)
    ((state, resets, cause, links, drops, faulty),) = run.numbers("radio")
    assert (state, cause, links, drops, faulty) == (CONNECTED, 0, 1, 0, 1)
    assert resets >= 3


def test_a_host_that_comes_while_nothing_is_known_is_served_in_the_end(
    radio: Board,
) -> None:
    radio(seconds=6)
    deaf = {"kind": "radio_deaf", "at_us": 0, "for_us": 20_000_000}
    run = radio((25_000, "g"), seconds=26, faults=[deaf])
    assert run.numbers("radio") == [[CONNECTED, 3, 0, 1, 0, 0]]


def test_what_a_host_sends_at_once_is_obeyed(radio: Board) -> None:
    radio(seconds=6)
    run = radio(*((at, "g") for at in range(3000, 5000, 100)), seconds=6)
    assert run.summary["radio_from_host"] == len(run.numbers("radio"))
