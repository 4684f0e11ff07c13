# SPDX-License-Identifier: MIT
"""The method of the thesis, beside the firmware's C."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.strokes import thesis


def test_a_constant_is_drift_and_a_leap_is_not() -> None:
    leap = np.repeat([0.0, 1.0], 200)[:, None]
    left = thesis.without_drift(leap)[:, 0]
    assert left[200] == 1.0
    assert left[-1] == pytest.approx(0.0, abs=1e-4)


def test_trapezoids_are_exact_for_a_straight_line() -> None:
    t = thesis.STEP_S * np.arange(11)[:, None]
    assert thesis.integral(t)[-1, 0] == pytest.approx(0.5 * t[-1, 0] ** 2)


def test_the_noise_filter_lets_leaps_through_and_calms_noise() -> None:
    acc = np.array([[0.0], [thesis.CHANGE_SMALL / 2.0], [10.0]])
    assert thesis.calmed(acc)[:, 0] == pytest.approx(
        [0.0, thesis.QUIET * thesis.CHANGE_SMALL / 2.0, 10.0]
    )


def test_strokes_of_table_ii_are_10_cm_to_us_and_shorter_to_the_thesis() -> None:
    ours, error, travelled = thesis.table_ii(0.45, 1)
    assert len(ours) == len(error) == len(travelled) == len(thesis.TABLE_II_CM)
    assert error.max() < 0.5
    assert np.abs(ours - 10.0).max() < 0.5
    assert travelled.max() < 9.5


def test_three_of_the_printed_sums_are_within_1_cm() -> None:
    assert thesis.spread(thesis.TABLE_II_CM)["within 1 cm"] == 3
