# SPDX-License-Identifier: MIT
"""What faults of wire, network, log and host cost: runs the tests that cause them and
keeps what these record. docs/faults.md has the table.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Any

import pytest

from benchmarks.common.paths import PROJECT, RESULTS, write_results

# Below tests/host.
TESTS = (
    "daemon/test_wire_faults.py",
    "daemon/test_service.py::test_a_stop_under_a_stream_is_clean_and_loses_nothing",
    "daemon/test_reload.py"
    "::test_thirty_reloads_under_a_stream_lose_nothing_and_leak_no_descriptor",
    "net/test_network.py::test_a_router_may_come_late_be_killed_and_come_back",
    "daemon/test_slow_subscriber.py"
    "::test_a_subscriber_that_stands_still_costs_another_nothing",
    "probes/test_bit_errors.py",
    "log/test_faults.py",
)
# All seeds; and a subscriber that stands still for longer than a lease of Zenoh's.
SETTINGS = {"IMU_LONG": "1", "IMUD_STOPPED_SECONDS": "30"}
OUTPUT = RESULTS / "faults.json"


class Recorder:
    """A plugin of pytest that keeps what each test recorded, by its name."""

    def __init__(self) -> None:
        self.found: dict[str, dict[str, Any]] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.user_properties:
            name = report.nodeid.rpartition("::")[2].removeprefix("test_")
            self.found[name] = dict(report.user_properties)


def main(_: Sequence[str] | None = None) -> int:
    os.chdir(PROJECT)
    os.environ.update(SETTINGS)
    recorder = Recorder()
    words = ["-q", "-p", "no:cacheprovider", *(f"tests/host/{each}" for each in TESTS)]
    status = int(pytest.main(words, plugins=[recorder]))
    for name, values in recorder.found.items():
        print(f"{name}: {values}")
    results = {"failed": status, "tests": recorder.found}
    write_results(OUTPUT, results)
    return status


if __name__ == "__main__":
    sys.exit(main())
