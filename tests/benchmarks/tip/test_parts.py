# SPDX-License-Identifier: MIT
"""What stays of the results of wobbles, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.common.whole import NotWholeError
from benchmarks.tip import parts

ROWS = [{"case": f"case {number}", "found": 50.0} for number in range(12)]
WHOLE = {"set": "judging", "rows": ROWS, "figures": []}


@pytest.mark.parametrize(
    ("found", "told"),
    [
        (WHOLE | {"set": "tuning"}, "--set tuning"),
        (WHOLE | {"rows": ROWS[:1]}, "1 cases"),
        (WHOLE | {"runs": {}}, "0 runs of all kinds"),
    ],
)
def test_partial_results_are_refused(found: Any, told: str) -> None:
    with pytest.raises(NotWholeError, match=told):
        parts.wobbles(found)


def test_wobbles_of_all_kinds_are_counted_by_their_base() -> None:
    firm = {"kind": "found", "base": "firm", "error_mm": 0.5}
    crowd = [firm] * 300 + [{"kind": "slips", "base": "slips"}] * 200
    kept = parts.wobbles(WHOLE | {"runs": {parts.CROWD: crowd}})["crowd"]
    assert kept["drawn"] == {"firm": 300, "slips": 200}
    assert kept["accepted"] == {"firm": 300, "soft": 0, "slips": 0}
    assert kept["worst_mm"] == 0.5
