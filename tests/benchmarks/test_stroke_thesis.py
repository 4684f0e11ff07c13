# SPDX-License-Identifier: MIT
"""The thesis' way to a displacement, as its equations have it, and its Table II."""

from __future__ import annotations

import numpy as np
import pytest
import stroke_thesis as thesis
from stroke_runs import Case, run_of

from imud.virtual.stroking import Plan, strokes_of


def test_the_filter_constant_is_the_printed_one() -> None:
    assert pytest.approx(0.0619, abs=5e-5) == thesis.ALPHA


def test_a_constant_is_drift_and_a_jump_passes() -> None:
    x = np.array([[0.0]] * 5 + [[1.0]] * 200)
    y = thesis.without_drift(x)
    assert y[5] == pytest.approx(1.0)
    assert y[6] == pytest.approx(1.0 - thesis.ALPHA)
    assert y[-1] == pytest.approx(0.0, abs=1e-3)


def test_a_constant_force_is_half_its_square_of_time() -> None:
    place = thesis.integral(thesis.integral(np.full((201, 1), 2.0)))
    assert place[-1] == pytest.approx(9.0)  # 3 s


def test_noise_is_calmed_and_a_change_is_not() -> None:
    small, change = 0.5 * thesis.CHANGE_SMALL, 2.0 * thesis.CHANGE
    calm = thesis.calmed(np.array([[0.0], [small], [change]]))
    assert calm[1] == pytest.approx(thesis.QUIET * small)
    assert calm[2] == pytest.approx(change)
    between = 0.5 * (thesis.CHANGE + thesis.CHANGE_SMALL)
    assert thesis.calmed(np.array([[0.0], [between]]))[1] == pytest.approx(between / 2)


def test_strokes_of_table_ii_are_along_one_axis_and_its_method_misses_them() -> None:
    case = Case("z", Plan(0.45, strokes=1), motion=thesis.table_ii)
    run = run_of(case, seed=2)
    (stroke,) = strokes_of(run.exact)
    assert stroke.way_m == pytest.approx([0.0, 0.0, 0.1], abs=1e-9)
    (moved,), (travelled,) = thesis.ways(run)
    assert np.linalg.norm(moved) < 0.03
    assert travelled == pytest.approx(0.1, abs=0.03)


def test_strokes_of_table_ii_are_measured_to_half_a_centimetre() -> None:
    rows = thesis.table_ii_rows(0.45, 0)
    assert len(rows) == len(thesis.TABLE_II_CM)
    assert rows[:, 1].max() < 0.5
    assert rows[:, 0] == pytest.approx(np.full(15, 10.0), abs=0.5)
