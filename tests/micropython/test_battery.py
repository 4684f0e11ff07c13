# SPDX-License-Identifier: MIT
"""A battery in MicroPython: smoothed, low after ten seconds, and told once."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "firmware/micropython/probe/battery.py"
FULL_MV = 6600
UNKNOWN = 65535


class Board:
    """Its converter, and what the probe is told."""

    def __init__(self) -> None:
        self.mv = 3900
        self.told: list[tuple[int, bool]] = []
        self.events: list[tuple[int, int, int]] = []

    def read_u16(self) -> int:
        return round(self.mv * 65535 / FULL_MV)

    def battery(self, mv: int, is_low: bool) -> None:
        self.told.append((mv, is_low))

    def tell(self, event: int, cause: int, detail: int) -> None:
        self.events.append((event, cause, detail))


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.setitem(sys.modules, "micropython", SimpleNamespace(const=int))
    spec = importlib.util.spec_from_file_location("battery", SOURCE)
    assert spec is not None
    assert spec.loader is not None
    found = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(found)
    return found


def stepped(battery: Any, board: Board, seconds: int) -> tuple[int, bool]:
    for _ in range(seconds):
        battery.step(board)
    return board.told[-1]


def test_a_low_battery_is_told_once_until_it_was_good_again(module: ModuleType) -> None:
    board = Board()
    battery = module.Battery(board, FULL_MV)
    assert stepped(battery, board, 3) == (pytest.approx(3900, abs=1), False)
    board.mv = 3100
    stepped(battery, board, 9)
    assert board.events == []
    mv, is_low = stepped(battery, board, 60)
    assert is_low
    assert mv == pytest.approx(3100, abs=3)
    board.mv = 3450
    assert stepped(battery, board, 60)[1]
    assert [event[:2] for event in board.events] == [(21, 18)]
    board.mv = 3600
    assert not stepped(battery, board, 60)[1]
    board.mv = 3200
    stepped(battery, board, 60)
    assert len(board.events) == 2


@pytest.mark.parametrize("mv", [0, 1900, 4700])
def test_what_is_no_cell_is_not_known_and_not_low(module: ModuleType, mv: int) -> None:
    board = Board()
    board.mv = mv
    assert stepped(module.Battery(board, FULL_MV), board, 60) == (UNKNOWN, False)
    assert board.events == []
