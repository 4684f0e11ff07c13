# SPDX-License-Identifier: MIT
"""What documents cite of the host's benchmarks, and which results are refused."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.common.whole import NotWholeError
from benchmarks.host import parts
from benchmarks.host.tested import by_parameters

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
        (parts.dated, {"nano-a wire": {}}),
        (parts.sites, {"test_sites": {}}),
    ],
)
def test_partial_results_are_refused(part: Any, found: Any) -> None:
    with pytest.raises(NotWholeError):
        part(found)


def test_what_never_arrived_was_missed() -> None:
    assert parts.missed(RUN | {"dropped": 3, "overrun": 1}) == 6


def test_figures_of_tests_have_their_parameters_for_names() -> None:
    found = {"dates[nano-a wire]": {"error_us": 12.5}, "sites": {"missed": 2}}
    assert by_parameters(found) == {
        "nano-a wire": {"error_us": 12.5},
        "sites": {"missed": 2},
    }
