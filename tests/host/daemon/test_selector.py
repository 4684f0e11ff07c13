# SPDX-License-Identifier: MIT
"""A loop with many events lets some gather; one with few wakes for each."""

from __future__ import annotations

import os
import selectors
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from imud.daemon import selector
from imud.daemon.selector import FEW_HZ, GATHER_S, MANY_HZ, GatheringSelector


class Pipe:
    """A selector over a pipe, the time that it sees and the pauses that it makes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.pauses: list[float] = []
        self.now_s = 100.0
        time = SimpleNamespace(sleep=self.pauses.append, monotonic=lambda: self.now_s)
        monkeypatch.setattr(selector, "time", time)
        self.read, self.write = os.pipe()
        self.waker = GatheringSelector()
        self.waker.register(self.read, selectors.EVENT_READ)

    def is_ready(self, timeout: float | None = 1.0) -> bool:
        return bool(self.waker.select(timeout))


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pipe]:
    made = Pipe(monkeypatch)
    yield made
    made.waker.close()
    os.close(made.read)
    os.close(made.write)


def turn(pipe: Pipe, rate_hz: float, seconds: float) -> None:
    """Events at this rate."""
    for _ in range(round(rate_hz * seconds)):
        os.write(pipe.write, b"x")
        assert pipe.is_ready()
        os.read(pipe.read, 1)
        pipe.now_s += 1 / rate_hz


def test_few_events_wake_it_at_once(pipe: Pipe) -> None:
    turn(pipe, 0.9 * MANY_HZ, 1.0)
    assert pipe.pauses == []


def test_many_events_gather_until_they_are_few_again(pipe: Pipe) -> None:
    turn(pipe, 1.2 * MANY_HZ, 1.0)
    assert set(pipe.pauses) == {GATHER_S}
    assert len(pipe.pauses) > 0.8 * 1.2 * MANY_HZ
    turn(pipe, (MANY_HZ + FEW_HZ) / 2, 0.5)
    pipe.pauses.clear()
    turn(pipe, (MANY_HZ + FEW_HZ) / 2, 0.5)
    assert pipe.pauses  # no toggling between both
    turn(pipe, 0.5 * FEW_HZ, 0.5)
    pipe.pauses.clear()
    turn(pipe, 0.5 * FEW_HZ, 0.5)
    assert pipe.pauses == []


@pytest.mark.parametrize("timeout", [-1.0, 0.0, GATHER_S / 2])
def test_a_loop_with_work_of_its_own_is_not_kept(pipe: Pipe, timeout: float) -> None:
    turn(pipe, 2 * MANY_HZ, 1.0)
    pipe.pauses.clear()
    assert not pipe.is_ready(timeout)
    assert pipe.pauses == []


def test_a_turn_ends_before_the_loop_waits(pipe: Pipe) -> None:
    turn(pipe, 2 * MANY_HZ, 0.2)
    pipe.pauses.clear()
    pauses: list[int] = []
    pipe.waker.on_turn = lambda: pauses.append(len(pipe.pauses))
    assert not pipe.is_ready(GATHER_S)
    assert pauses == [0]
    assert pipe.pauses == [GATHER_S]
