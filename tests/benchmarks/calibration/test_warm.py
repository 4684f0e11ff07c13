# SPDX-License-Identifier: MIT
"""The benchmark of calibrations far from their temperature."""

from __future__ import annotations

import pytest

from benchmarks.calibration import warm


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kind", warm.KINDS)
def test_what_is_stated_holds_and_two_temperatures_tell_more(kind: str) -> None:
    row = warm.measure((kind, 2))
    assert len(row.once) == len(row.twice) == warm.ATTITUDES
    for (true, sigma), (same, known) in zip(row.once, row.twice, strict=True):
        assert true == pytest.approx(same, abs=0.01)
        assert true <= warm.INSIDE * sigma
        assert true <= warm.INSIDE * known
        assert sigma == pytest.approx(1.86, abs=0.03)
        assert known < 0.8 or not kind.startswith("0.2")


def test_a_line_counts_what_is_inside_and_how_much_of_it_is_true() -> None:
    line = warm.line_of([(1.0, 1.0), (3.0, 1.0)])
    true, stated, inside, share, verdict = warm.cells(line)
    assert (true, stated, inside, share) == ("2.24", "1.00", "50.0", "2.24")
    assert verdict == "MISSED"
