# SPDX-License-Identifier: MIT
"""The benchmark of strokes: its measurements, and what it judges."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.strokes import on_host
from benchmarks.strokes.runs import Case, Found
from imud.virtual.stroking import Plan


def found(errors: object) -> Found:
    rows = np.array(errors, float)
    return Found(rows, rows, np.full_like(rows, 0.01))


def test_a_run_is_measured(tmp_path: Path) -> None:
    output = tmp_path / "strokes.json"
    words = ["--set", "tuning", "--seeds", "1", "--only"]
    # Of eight strokes too few may be inside: the figures are for hundreds.
    on_host.main(arguments=[*words, "supported, 1 s", "--output", str(output)])
    report = json.loads(output.read_text())
    ((_, strokes, _, p95, *_, other),) = report["tables"]["cases"]["rows"]
    assert (strokes, other) == (8, 0.0)
    assert p95 < 0.8


def test_few_strokes_under_1_cm_and_wide_corners_are_missed() -> None:
    row = {"case": "supported, 1 s", "under 1 cm": 98.9, "inside": 95.0}
    assert [each.verdict for each in on_host.figures_of([row])] == ["MISSED", "goal"]
    path = {"as measured, p95": 0.71, "closed, p95": 0.3}
    found = on_host.path_figures({"A4 outline, 4 x 1 s": path})
    assert [each.verdict for each in found] == ["MISSED", "goal"]


def test_a_stroke_without_length_is_not_under_1_cm() -> None:
    case = Case("two of three", Plan(strokes=3))
    row = on_host.row_of(case, [found([[0.001, 0.0, 0.0], [0.002, 0.0, 0.0]])])
    assert row["under 1 cm"] == pytest.approx(100 * 2 / 3)
    assert row["other"] == pytest.approx(100 / 3)
    assert row["inside"] == 100.0


def test_closing_a_path_takes_away_an_error_that_grows_evenly() -> None:
    even = found([[0.001, 0.0, 0.0]] * 4)
    assert on_host.corners(even, is_closed=True) == pytest.approx(0.0, abs=1e-12)
    # 1, 2, 3 and 4 mm.
    assert on_host.corners(even, is_closed=False) == pytest.approx(7.5e-6**0.5)


def test_the_floor_of_white_noise_is_5_mm_after_2_s() -> None:
    assert on_host.floor_of(2.0) == pytest.approx(0.52, abs=0.01)
