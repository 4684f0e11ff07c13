# SPDX-License-Identifier: MIT
"""A plugin of pytest that shows progress and time left on one line, instead of dots.
A failure is named when it happens.

Progress is a share of seconds, not of tests: seconds.json, written by `make test
MEASURE=1`, has the mean of each file. order.py uses it to run the longest files first.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import pytest

TABLE = Path(__file__).with_name("seconds.json")
UNKNOWN_S = 0.05  # a test whose file is not in the table
TERMINAL_S = 0.2  # between two updates
PIPE_S = 15.0  # between two lines of a log

Out = Callable[[str], None]


def seconds_of_files() -> dict[str, float]:
    """Mean seconds of a test, by file; empty without the table."""
    table: dict[str, float] = json.loads(TABLE.read_text()) if TABLE.exists() else {}
    return table


class Progress:
    """Counts tests and time in the main process, and writes the line."""

    def __init__(self, out: Out, *, is_terminal: bool) -> None:
        self._out = out
        self._is_terminal = is_terminal
        self._means = seconds_of_files()
        self._begun_s = time.monotonic()
        self._shown_s = float("-inf") if self._is_terminal else self._begun_s
        self._count = self._failed = self._done = 0
        self._expected_s = self._done_s = 0.0
        self.taken_s: Counter[str] = Counter()
        self._tests: Counter[str] = Counter()

    def expect(self, ids: Collection[str]) -> None:
        self._count = len(ids)
        self._expected_s = sum(self._mean_s(name) for name in ids)

    def take(self, report: pytest.TestReport) -> None:
        """Count the end of a test's set-up, call or tear-down."""
        file = file_of(report.nodeid)
        self.taken_s[file] += report.duration
        if report.failed:
            self._failed += 1
            self.say(f"FAILED {report.nodeid} ({report.when})")
        if report.when == "teardown":
            self._tests[file] += 1
            self._done += 1
            self._done_s += self._mean_s(report.nodeid)
        now_s = time.monotonic()
        if now_s - self._shown_s >= (TERMINAL_S if self._is_terminal else PIPE_S):
            self._shown_s = now_s
            self._show(now_s)

    def say(self, line: str) -> None:
        self._out(f"\r\x1b[K{line}\n" if self._is_terminal else f"{line}\n")

    def wipe(self) -> None:
        if self._is_terminal:
            self._out("\r\x1b[K")

    def means(self) -> dict[str, float]:
        """Mean seconds of a test by file in this run, for seconds.json."""
        return {
            file: round(self.taken_s[file] / count, 4)
            for file, count in sorted(self._tests.items())
        }

    def _mean_s(self, name: str) -> float:
        return self._means.get(file_of(name), UNKNOWN_S)

    def _show(self, now_s: float) -> None:
        share = self._done_s / self._expected_s if self._expected_s else 1.0
        gone_s = now_s - self._begun_s
        left = clock(gone_s / share - gone_s) if share > 0.02 else "?"
        done = f"{self._done} of {self._count} tests, {self._failed} failed"
        line = f"{share:4.0%}  {done}; {clock(gone_s)} gone, about {left} left"
        self._out(f"\r\x1b[K{line}" if self._is_terminal else f"{line}\n")


def file_of(test: str) -> str:
    return test.partition("::")[0]


def clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02}"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--measure", action="store_true", help=f"write {TABLE.name}: seconds by file"
    )


class Plugin:
    def __init__(self, reporter: pytest.TerminalReporter) -> None:
        def write(text: str) -> None:
            reporter.write(text, flush=True)

        self._progress = Progress(write, is_terminal=reporter.isatty)
        self._ids: set[str] = set()  # processes of xdist may collect different tests

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        self._expect([item.nodeid for item in session.items])

    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        self._expect(ids)

    def _expect(self, ids: list[str]) -> None:
        self._ids.update(ids)
        self._progress.expect(self._ids)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._progress.take(report)

    @pytest.hookimpl(tryfirst=True)
    def pytest_report_teststatus(self, report: Any) -> tuple[str, str, str] | None:
        if not isinstance(report, pytest.TestReport):
            return None
        if report.failed:
            is_call = report.when == "call"
            return ("failed", "", "FAILED") if is_call else ("error", "", "ERROR")
        if report.skipped:
            return ("skipped", "", "SKIPPED")
        return ("passed" if report.when == "call" else "", "", "")

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        self._progress.wipe()
        if session.config.getoption("--measure"):
            text = json.dumps(self._progress.means(), indent=1)
            TABLE.write_text(f"{text}\n", encoding="ascii")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    is_worker = hasattr(config, "workerinput")
    if not is_worker and config.get_verbosity() < 0:  # -q: whole runs
        reporter = config.pluginmanager.get_plugin("terminalreporter")
        assert isinstance(reporter, pytest.TerminalReporter)
        config.pluginmanager.register(Plugin(reporter), "imud progress")
