# SPDX-License-Identifier: MIT
"""What stays of a benchmark's results, and what is refused."""

from __future__ import annotations

import json

import pytest

from benchmarks import kept


@pytest.mark.parametrize(
    ("part", "found"),
    [
        (kept.micropython, {"seconds": 3.0}),
        (kept.pico, {"seconds": 9.0}),
        (kept.faults, {"failed": 1}),
    ],
)
def test_partial_results_are_refused(part, found) -> None:
    with pytest.raises(kept.NotWholeError):
        part(found)


def test_floats_are_rounded_and_counts_are_not() -> None:
    found = {"a": [0.123456789, 12345678, None, "x"], "b": {"c": 1234567.8}}
    assert kept.rounded(found) == {
        "a": [0.123457, 12345678, None, "x"],
        "b": {"c": 1234570.0},
    }
