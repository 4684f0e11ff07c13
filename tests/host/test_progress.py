# SPDX-License-Identifier: MIT
"""The progress bar, which is drawn on a terminal only."""

from __future__ import annotations

import io

import pytest

from imud import progress
from imud.progress import Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(progress.time, "monotonic", lambda: now[0])
    return now


def test_a_bar_shows_the_share_that_is_done(clock: list[float]) -> None:
    terminal = Terminal()
    bar = Progress("work", 8.0, terminal)
    bar.advance(2.0)
    assert terminal.getvalue() == f"\r\033[Kwork {'█' * 10}{'░' * 30}  25%"
    clock[0] += 1.0
    bar.update(20.0)
    assert terminal.getvalue().endswith(f"{'█' * 40} 100%")


def test_it_is_not_drawn_oftener_than_an_eye_follows(clock: list[float]) -> None:
    terminal = Terminal()
    bar = Progress("work", 8.0, terminal)
    for _ in range(5):
        bar.advance()
    assert terminal.getvalue().count("work") == 1
    clock[0] += 0.2
    bar.advance()
    assert terminal.getvalue().endswith(" 75%")


def test_lines_go_above_the_bar_which_comes_back_and_ends(clock: list[float]) -> None:
    terminal = Terminal()
    bar = Progress("work", 2.0, terminal)
    bar.advance()
    bar.say("a line")
    assert terminal.getvalue().endswith("\r\033[Ka line\n")
    bar.advance()
    assert terminal.getvalue().endswith("100%")
    bar.end()
    assert terminal.getvalue().endswith("\r\033[K")
    clock[0] += 1.0
    bar.update(1.0)
    assert terminal.getvalue().endswith("\r\033[K")


def test_a_file_gets_the_lines_only() -> None:
    file = io.StringIO()
    bar = Progress("work", 2.0, file)
    bar.advance()
    bar.say("a line")
    bar.end()
    assert file.getvalue() == "a line\n"
