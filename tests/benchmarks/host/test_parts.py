# SPDX-License-Identifier: MIT
"""What documents cite of the host's benchmarks, and which results are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from benchmarks.common.whole import NotWholeError
from benchmarks.host import parts
from benchmarks.host.tested import recorded

RUN = {"is_relay": False, "seconds": 3.0, "poses_sent": 9, "poses_heard": 7}


@pytest.mark.parametrize(
    ("part", "found"),
    [
        (parts.attacks, [{"seconds": 60.0}, {"seconds": 60.0}]),
        (parts.card_log, {"seconds": 33.0}),
        (
            parts.daemon_load,
            {"live": [RUN | {"probes": 8, "overrun": 0, "dropped": 0}]},
        ),
        (parts.dating, {"messages": 1000}),
        (parts.fleet, {"rows": [], "has_log": True}),
        (parts.page, {"seconds": 5.0}),
        (parts.soak, {"hours": 1.0}),
        (parts.soak_limited, {"hours": 3.0, "keep_mb": 0}),
        (parts.stages, {"runs": 2, "turns": 50}),
        (parts.tested, {"clock": {}}),
    ],
)
def test_partial_results_are_refused(part: Any, found: Any) -> None:
    with pytest.raises(NotWholeError):
        part(found)


def test_what_never_arrived_was_missed() -> None:
    assert parts.missed(RUN | {"dropped": 3, "overrun": 1}) == 6


def test_numbers_that_a_test_recorded_are_those_of_its_parameters(
    tmp_path: Path,
) -> None:
    report = tmp_path / "report.xml"
    case = '<testcase name="{}"><properties>{}</properties></testcase>'
    value = '<property name="error_us" value="12.5"/>'
    report.write_text(
        "<testsuites><testsuite>"
        + case.format("test_dates[nano-a wire]", value)
        + case.format("test_sites", value)
        + '<testcase name="test_of_nothing"/></testsuite></testsuites>'
    )
    assert recorded(report) == {
        "nano-a wire": {"error_us": 12.5},
        "test_sites": {"error_us": 12.5},
    }
