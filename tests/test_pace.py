# SPDX-License-Identifier: MIT
"""The line that tells how far the tests are."""

from __future__ import annotations

import pytest

import pace
from pace import Progress


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time, to be set."""
    now = [1000.0]
    monkeypatch.setattr(pace.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(pace, "seconds_of_files", lambda: {"slow.py": 9.0})
    return now


def report(
    test: str, when: str = "teardown", outcome: str = "passed", duration: float = 0.0
) -> pytest.TestReport:
    location = (test, None, test)
    return pytest.TestReport(
        test,
        location,
        {},
        outcome,
        None,
        when,
        duration=duration,  # type: ignore[arg-type]
    )


def test_the_share_is_that_of_seconds_and_gives_the_rest(now: list[float]) -> None:
    lines: list[str] = []
    progress = Progress(lines.append, is_terminal=False)
    tests = ["slow.py::a", "slow.py::b", *(f"quick.py::{n}" for n in range(40))]
    progress.expect(tests)
    now[0] += 30.0
    progress.take(report("slow.py::a"))
    # 9 of 20 seconds are done; at this pace the others take 37.
    assert lines == [" 45%  1 of 42 tests, 0 failed; 0:30 gone, about 0:37 left\n"]


def test_a_log_gets_a_line_now_and_then_and_a_terminal_one_in_place(
    now: list[float],
) -> None:
    for is_terminal, seconds, counts in ((False, 60, (3, 4)), (True, 1, (5, 6))):
        lines: list[str] = []
        progress = Progress(lines.append, is_terminal=is_terminal)
        progress.expect(["quick.py::a"] * 100)
        for _ in range(100):
            now[0] += seconds / 100
            progress.take(report("quick.py::a"))
        assert len(lines) in counts
        assert all(line.startswith("\r\x1b[K") == is_terminal for line in lines)
        assert all(line.endswith("\n") != is_terminal for line in lines)


@pytest.mark.usefixtures("now")
def test_a_failure_is_named_at_once() -> None:
    lines: list[str] = []
    progress = Progress(lines.append, is_terminal=False)
    progress.expect(["quick.py::a"])
    progress.take(report("quick.py::a", "call", "failed"))
    assert lines == ["FAILED quick.py::a (call)\n"]


@pytest.mark.usefixtures("now")
def test_the_mean_of_a_file_is_that_of_its_tests_with_all_their_phases() -> None:
    progress = Progress(lambda _: None, is_terminal=False)
    for test in ("a", "b"):
        for when, seconds in (("setup", 1.0), ("call", 2.0), ("teardown", 0.5)):
            progress.take(report(f"quick.py::{test}", when, duration=seconds))
    progress.take(report("other.py::c", duration=0.25))
    assert progress.means() == {"other.py": 0.25, "quick.py": 3.5}
