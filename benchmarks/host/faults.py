# SPDX-License-Identifier: MIT
"""What faults of wire, network, log and host cost: runs the tests that cause them, and
shows what these record. Also how well samples of virtual probes are dated (a clock that
follows the emulator's is not disturbed by a busy machine), and how soon all poses
arrive again after a fault between two sites, which needs network namespaces.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest

from benchmarks import harness
from benchmarks.common.paths import PROJECT
from benchmarks.harness import Figure, Report, Table

# Each table of faults: a test by its name, and the fault that it causes.
FAULTS = {
    "wire": {
        "a_wire_pulled_at_any_byte_costs_that_frame_and_is_back_in_2_s": (
            "unplugged, at any byte of a frame"
        ),
        "what_was_sent_while_unplugged_is_missing_in_the_next_pose": (
            "unplugged while it streams"
        ),
        "a_reset_in_mid_frame_costs_that_frame_and_is_a_boot_of_its_own": (
            "reset in mid-frame"
        ),
        "a_brown_out_is_told_with_its_cause": "brown-out",
        "a_probes_own_settings_are_applied_whenever_it_appears": (
            "any of these, with settings that are sent again"
        ),
        "a_second_start_while_it_streams_is_back_in_2_s": (
            "the daemon killed and started while it streams"
        ),
        "a_hundred_reconnects_leak_no_descriptor_and_no_memory": (
            "100 reconnects in a row"
        ),
    },
    "network": {
        "a_router_may_come_late_be_killed_and_come_back[client]": (
            "router killed for 1 s, daemon in mode `client`"
        ),
        "a_router_may_come_late_be_killed_and_come_back[peer]": (
            "the same, daemon in mode `peer`"
        ),
        "a_subscriber_that_stands_still_costs_another_nothing": (
            "subscriber stopped (SIGSTOP) for 30 s"
        ),
    },
    "log": {
        "a_full_disk_costs_what_comes_while_it_is_full": "disk full for some seconds",
        "a_stop_under_a_stream_is_clean_and_loses_nothing": "SIGTERM under a stream",
        "thirty_reloads_under_a_stream_lose_nothing_and_leak_no_descriptor": (
            "30 reloads (SIGHUP) under a stream"
        ),
    },
}
BIT_ERRORS = "a_minute_of_bit_errors"
SITES = "test_sites.py"
CLOCK = "test_clock.py"
# What runs for a table; files below tests.
TESTS = {
    "wire": ("host/daemon/test_wire_faults.py", "host/probes/test_bit_errors.py"),
    "network": (
        "host/net/test_network.py::test_a_router_may_come_late_be_killed_and_come_back",
        "host/daemon/test_slow_subscriber.py",
    ),
    "log": (
        "host/log/test_faults.py",
        "host/daemon/test_service.py"
        "::test_a_stop_under_a_stream_is_clean_and_loses_nothing",
        "host/daemon/test_reload.py"
        "::test_thirty_reloads_under_a_stream_lose_nothing_and_leak_no_descriptor",
    ),
    "clock": (f"system/{CLOCK}",),
    "sites": (f"hosts/{SITES}",),
}
# All seeds; and a subscriber that stands still for longer than a lease of Zenoh's.
SETTINGS = {"IMU_LONG": "1", "IMUD_STOPPED_SECONDS": "30"}

# Names under which tests record what was lost, and the seconds until all was back.
LOST = ("lost", "lost in the log", "lost of them", "missed")
BACK = ("back after, s", "back_s", "stopped after, s", "slowest reload, s")
# Recorded for other readers.
UNSHOWN = ("first_s", "told")

ERRORS = {
    "error_median_us": "error: median, us",
    "error_p99_us": "p99",
    "error_max_us": "max",
    "bound_median_us": "bound: median, us",
    "bound_max_us": "max of bounds",
    "bound_holds": "bound holds",
}
BETWEEN_SITES = {
    "cut_both_ways": "the link between the routers cut both ways for 1 s",
    "cut_one_way": "cut one way for 1 s",
    "kill_a_router": "a router killed and started again",
    "freeze_a_daemon": "a daemon stopped for 1 s (SIGSTOP)",
    "cut_off_a_host": "a daemon's machine cut off for 12 s, longer than Zenoh's lease",
    "cut_for_longer_than_a_lease": "the link cut one way for 12 s",
}


@dataclass(frozen=True, slots=True)
class Recorded:
    """What a test recorded, and its file."""

    file: str
    values: Mapping[str, Any]


class Recorder:
    """A plugin of pytest that keeps what each test recorded, by its name."""

    def __init__(self) -> None:
        self.found: dict[str, Recorded] = {}

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call" and report.user_properties:
            file, _, name = report.nodeid.partition("::")
            values = dict(report.user_properties)
            name = name.removeprefix("test_")
            self.found[name] = Recorded(file.removeprefix("tests/"), values)


def shown(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        return " and ".join(map(shown, value))
    if isinstance(value, str):
        return value
    return f"{value:,.3g}" if isinstance(value, float) else f"{value:,}"


def fault_row(fault: str, recorded: Recorded) -> tuple[str, ...]:
    """The fault, what it cost, and the rest of what its test recorded."""
    values = dict(recorded.values)
    told = values.get("told")
    if told is not None:  # by the subscriber that stood still
        values["lost"] = f"{told['missed']:,} at that one, as it is told"
    lost = [shown(values.pop(key)) for key in LOST if key in values]
    back = [shown(values.pop(key)) for key in BACK if key in values]
    rest = (
        f"{key.replace('_', ' ')}: {shown(value)}"
        for key, value in values.items()
        if key not in UNSHOWN
    )
    return fault, *(" ".join(each) for each in (lost, back)), "; ".join(rest)


def bit_errors(found: Mapping[str, Recorded]) -> Iterator[tuple[str, ...]]:
    """A row of all minutes with bit errors together."""
    minutes = [each for name, each in found.items() if name.startswith(BIT_ERRORS)]
    if minutes:
        passed = [each.values["passed on"] for each in minutes]
        wrong = sum(each.values["passed the CRC and wrong"] for each in minutes)
        expected = sum(each.values["expected of these"] for each in minutes)
        yield (
            f"1 % of all bits wrong for a minute, {len(minutes)} times",
            f"all but {min(passed)} to {max(passed)} of 12,000 frames",
            "",
            f"wrong ones that passed the CRC: {wrong}; expected: {expected:.1f}",
        )


def faults_of(name: str, found: Mapping[str, Recorded]) -> Table:
    """The faults of one table."""
    columns = dict.fromkeys(("fault", "lost", "back after, s", "besides"), "")
    rows = [
        fault_row(fault, found[test])
        for test, fault in FAULTS[name].items()
        if test in found
    ]
    return Table(name, columns, [*rows, *(bit_errors(found) if name == "wire" else ())])


def clock_of(found: Mapping[str, Recorded]) -> Table:
    """How well each board's samples are dated over each link."""
    columns = {"board and link": "", **dict.fromkeys(ERRORS.values(), ",.0f")}
    columns[ERRORS["bound_holds"]] = ".0%"
    rows = [
        (
            name.partition("[")[2].removesuffix("]").replace("-", ", ", 1),
            *(each.values[key] for key in ERRORS),
        )
        for name, each in found.items()
        if each.file.endswith(CLOCK)
    ]
    return Table("clock", columns, rows)


def sites_of(found: Mapping[str, Recorded]) -> Table:
    """Until all poses of all probes arrive at all consumers again."""
    rows = [
        (fault, each.values[key])
        for each in found.values()
        if each.file.endswith(SITES)
        for key, fault in BETWEEN_SITES.items()
    ]
    return Table("sites", {"fault": "", "back after it ends, s": ".2f"}, rows)


def report_of(found: Mapping[str, Recorded], status: int) -> Report:
    """The tables; no test may fail, and each bound of a date has to hold."""
    tables = [*(faults_of(name, found) for name in FAULTS)]
    tables += [clock_of(found), sites_of(found)]
    figures = [Figure("tests that fail", status, (0, 0), (0, 0))]
    figures += [
        Figure(f"{name}: bound holds", 100.0 * holds, (100, 100), (100, 100))
        for name, *_, holds in clock_of(found).rows
        if isinstance(holds, float)
    ]
    data = {name: each.values for name, each in found.items()}
    return Report([table for table in tables if table.rows], figures, data)


def options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--only", choices=TESTS, help="this table")


def measured(args: argparse.Namespace) -> Report:
    """All tests in one run of pytest."""
    os.chdir(PROJECT)
    os.environ.update(SETTINGS)
    files = TESTS[args.only] if args.only else sum(TESTS.values(), ())
    recorder = Recorder()
    words = ["-q", "-p", "no:cacheprovider", *(f"tests/{each}" for each in files)]
    status = int(pytest.main(words, plugins=[recorder]))
    return report_of(recorder.found, status)


main = partial(harness.run, "faults", __doc__, measured, options)
