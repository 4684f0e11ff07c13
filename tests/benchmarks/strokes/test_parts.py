# SPDX-License-Identifier: MIT
"""What stays of the results of strokes, and what is refused."""

from __future__ import annotations

from typing import Any

import pytest

from benchmarks.common.whole import NotWholeError
from benchmarks.strokes import parts


def rows(count: int, **fields: Any) -> list[dict[str, Any]]:
    return [{"case": f"case {number}"} | fields for number in range(count)]


@pytest.mark.parametrize(
    ("part", "found", "told"),
    [
        (parts.strokes, {"set": "tuning"}, "--set tuning"),
        (parts.strokes, {"set": "judging", "rows": rows(1)}, "1 cases"),
        (
            parts.strokes,
            {"set": "judging", "rows": rows(21, strokes=64)},
            "64 strokes a case",
        ),
        (parts.image, {"runs": 1, "rows": rows(5)}, "1 runs a case"),
        (parts.image, {"runs": 2, "rows": rows(2)}, "2 cases"),
        (parts.compared, {"runs": 8, "cases": {}}, "8 runs a case"),
        (parts.compared, {"runs": 30, "cases": {}}, "some cases"),
    ],
)
def test_partial_results_are_refused(part: Any, found: Any, told: str) -> None:
    with pytest.raises(NotWholeError, match=told):
        part(found)


def test_the_worst_sample_of_an_image_is_that_of_all_cases() -> None:
    found = rows(4, cycles_worst=70.0, cycles_worst_tip=75.0)
    found.append({"case": "last", "cycles_worst": 72.0, "cycles_worst_tip": 74.0})
    kept = parts.image({"runs": 2, "rows": found, "other_bits": 0, "costs": {}})
    assert kept["cycles_worst"] == {"cycles_worst": 72.0, "cycles_worst_tip": 75.0}
