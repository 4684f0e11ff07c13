# SPDX-License-Identifier: MIT
"""The benchmark of faults keeps what tests record."""

from __future__ import annotations

import json
from types import SimpleNamespace as Made
from typing import Any

from benchmarks import kept
from benchmarks.host import faults


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
    assert recorder.found == {"one": {"lost": 3, "first and last": (30, 29)}}


def test_minutes_of_bit_errors_are_taken_together() -> None:
    minutes = {
        f"a_minute_of_bit_errors[{seed}]": {
            "passed on": 90 + seed,
            "passed the CRC and wrong": 0,
            "expected of these": 0.25,
        }
        for seed in range(4)
    }
    found = {"failed": 0, "tests": {"one": {"lost": 3}} | minutes}
    part = kept.faults(json.loads(json.dumps(found)))
    assert part["tests"] == {"one": {"lost": 3}}
    assert part["bit_errors"] == {
        "passed_least": 90,
        "passed_most": 93,
        "wrong": 0,
        "expected": 1.0,
    }
