# SPDX-License-Identifier: MIT
"""The benchmark of faults shows what tests record, and judges it."""

from __future__ import annotations

from types import SimpleNamespace as Made
from typing import Any

import pytest

from benchmarks.host import faults
from benchmarks.host.faults import Recorded


def test_what_a_test_records_is_kept_by_its_name() -> None:
    recorder = faults.Recorder()
    for name, when, recorded in (
        ("test_one", "setup", [("lost", 9)]),
        ("test_one", "call", [("lost", 3), ("first and last", (30, 29))]),
        ("test_that_records_nothing", "call", []),
    ):
        report: Any = Made(
            nodeid=f"tests/test_x.py::{name}", when=when, user_properties=recorded
        )
        recorder.pytest_runtest_logreport(report)
    values = {"lost": 3, "first and last": (30, 29)}
    assert recorder.found == {"one": Recorded("test_x.py", values)}


def test_a_fault_has_its_cost_and_the_rest() -> None:
    values = {"lost": 0, "back after, s": 0.1567, "kB_more": 1068, "first_s": 1.0}
    row = faults.fault_row("unplugged", Recorded("test_x.py", values))
    assert row == ("unplugged", "0", "0.157", "kB more: 1,068")


def test_minutes_of_bit_errors_are_taken_together() -> None:
    minutes = {
        f"{faults.BIT_ERRORS}[{seed}]": Recorded(
            "test_bit_errors.py",
            {
                "passed on": 90 + seed,
                "passed the CRC and wrong": 0,
                "expected of these": 0.25,
            },
        )
        for seed in range(4)
    }
    (row,) = faults.bit_errors(minutes)
    assert row[1] == "all but 90 to 93 of 12,000 frames"
    assert row[3] == "wrong ones that passed the CRC: 0; expected: 1.0"


@pytest.mark.parametrize(
    ("status", "holds", "missed"),
    [
        (0, 1.0, []),
        (1, 1.0, ["tests that fail"]),
        (0, 0.999, ["nano, a wire: bound holds"]),
    ],
)
def test_a_test_that_fails_and_a_bound_that_does_not_hold_are_missed(
    status: int, holds: float, missed: list[str]
) -> None:
    values = dict.fromkeys(faults.ERRORS, 10.0) | {"bound_holds": holds}
    found = {"dates[nano-a wire]": Recorded(f"system/{faults.CLOCK}", values)}
    report = faults.report_of(found, status)
    assert [table.name for table in report.tables] == ["clock"]
    verdicts = {each.name: each.verdict for each in report.figures}
    assert [name for name, verdict in verdicts.items() if verdict == "MISSED"] == missed


def test_each_fault_is_caused_by_a_test(pytestconfig: pytest.Config) -> None:
    root = pytestconfig.rootpath / "tests"
    sources = {
        file: (root / file.partition("::")[0]).read_text("utf-8")
        for files in faults.TESTS.values()
        for file in files
    }
    text = "".join(sources.values())
    names = [name for table in faults.FAULTS.values() for name in table]
    missing = [
        each for each in names if f"def test_{each.partition('[')[0]}(" not in text
    ]
    assert missing == []
