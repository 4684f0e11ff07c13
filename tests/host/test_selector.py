# SPDX-License-Identifier: MIT
"""A loop with much to do lets some gather; one with little wakes for each."""

from __future__ import annotations

import os
import selectors
from collections.abc import Iterator

import pytest

from imud.daemon import selector
from imud.daemon.selector import BUSY, GATHER_S, GatheringSelector


class Pipe:
    """A selector over a pipe, and the pauses that it makes."""

    def __init__(self) -> None:
        self.pauses: list[float] = []
        self.read, self.write = os.pipe()
        self.waker = GatheringSelector()
        self.waker.register(self.read, selectors.EVENT_READ)

    def is_ready(self, timeout: float | None = 1.0) -> bool:
        return bool(self.waker.select(timeout))


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[Pipe]:
    made = Pipe()
    monkeypatch.setattr(selector.time, "sleep", made.pauses.append)
    yield made
    made.waker.close()
    os.close(made.read)
    os.close(made.write)


@pytest.mark.parametrize("timeout", [None, 1.0, 0.0])
def test_after_some_turns_that_had_not_to_be_waited_for_it_gathers(
    pipe: Pipe, timeout: float | None
) -> None:
    os.write(pipe.write, b"x")
    for _ in range(BUSY):
        assert pipe.is_ready(timeout)
    assert pipe.pauses == []
    assert pipe.is_ready(timeout)
    assert pipe.is_ready(timeout)
    assert pipe.pauses == [GATHER_S, GATHER_S]


def test_a_turn_that_is_waited_for_ends_that(pipe: Pipe) -> None:
    for _ in range(10 * BUSY):
        os.write(pipe.write, b"x")
        assert pipe.is_ready()
        os.read(pipe.read, 1)
        assert not pipe.is_ready(0.0)
    assert pipe.pauses == []


def test_a_loop_with_work_of_its_own_is_not_kept(pipe: Pipe) -> None:
    assert not pipe.is_ready(0.0)
    assert not pipe.is_ready(0.01)
    assert pipe.pauses == []
