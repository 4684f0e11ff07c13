# SPDX-License-Identifier: MIT
"""The benchmark of calibrations: its cases, and what it judges."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.calibration import cases, modules, simulated, verdicts
from benchmarks.calibration.cases import CASES, Case
from benchmarks.calibration.modules import GUIDED
from imud.calibration.affine import Affine
from imud.virtual.modules import calibrated


def random() -> np.random.Generator:
    return np.random.default_rng(1)


def test_users_lay_the_probe_as_they_are_called() -> None:
    upright = cases.ups_of(Case("x", user="upright", poses=50), random())
    assert min(up[2] for up in upright if up is not None) > 0.0
    lazy = np.array(cases.ups_of(Case("x", user="lazy", poses=200), random()))
    tilts = np.degrees(np.arccos(lazy[:, 2]))
    assert 15.0 < tilts.mean() < 30.0
    faces = cases.ups_of(Case("x", user="faces", poses=8), random())
    assert np.array_equal(faces[0], faces[6])
    housing = cases.ups_of(Case("x", has_housing=True), random())
    assert len(housing) == 14
    assert housing[-1] is None
    assert len({case.name for case in CASES}) == len(CASES)


def test_one_recording_is_measured_and_accepted() -> None:
    row = modules.measure((Case("one", has_housing=True), 4))
    assert row["refused"] is None
    assert row["tilt"] < 0.1
    assert row["leans"] < 0.15
    assert row["seconds"] == pytest.approx(54.0)
    assert verdicts.is_good(row)


def test_hands_are_of_all_kinds() -> None:
    found = [cases.crowd(2 * n + verdicts.CROWD_SEED) for n in range(40)]
    assert len({each.user for each in found}) == 6
    assert {each.is_held for each in found} == {True, False}


def row(tilt: float, refused: str | None) -> dict[str, Any]:
    return {"tilt": tilt, "heading": 1.0, "refused": refused}


def test_wrong_verdicts_are_counted() -> None:
    rows = [row(0.1, None), row(0.1, None), row(0.2, "weak"), row(2.0, "weak")]
    rows += [row(0.9, None), {"refused": "too_few"}]
    # Who is asked for poses lays them: one is accepted, one is still too weak.
    rows[2] |= {"asked": row(0.05, None)}
    rows[3] |= {"asked": row(1.5, "weak")}
    first = verdicts.verdicts(verdicts.AS_THEY_ARE, rows, rows)
    last = verdicts.verdicts(verdicts.ASKED, rows, verdicts.as_asked(rows))
    assert [*first.values()][1:] == [6, 3, 1, 3, 1]
    assert [*last.values()][1:] == [6, 4, 1, 3, 0]
    found = [*verdicts.figures([first, last])]
    assert [each.value for each in found] == pytest.approx([100 / 3, 100 / 3, 25, 0])
    assert [each.verdict for each in found] == ["MISSED", "must", "MISSED", "goal"]


def test_who_is_asked_for_poses_lays_them_and_is_accepted() -> None:
    case = Case("lazy", poses=5, user="lazy")
    laid = cases.laid(case, 4)
    first = cases.judged(laid.recording())
    refused = verdicts.row_of(laid, first)
    assert refused["refused"] == "missing_poses"
    asked = verdicts.laid_as_asked(laid, first)
    assert asked["refused"] is None
    assert 0 < asked["more"] < 12
    assert verdicts.is_good(asked)
    assert asked["tilt"] < refused["tilt"]


def test_a_thousand_verdicts_begin_with_one(tmp_path: Path) -> None:
    path = tmp_path / "verdicts.json"
    verdicts.main(arguments=["--seeds", "1", "--output", str(path)])
    tables = json.loads(path.read_text())["tables"]
    assert [each[1] for each in tables["verdicts"]["rows"]] == [1, 1]


def test_a_fit_that_failed_is_infinitely_wrong() -> None:
    good = {"tilt": 0.03, "heading": 0.1, "scale": 0.05, "leans": 0.05}
    bad = modules.figures({GUIDED: modules.line_of([good] * 18 + [{}] * 2)}, 0.1)
    assert next(bad).verdict == "MISSED"
    lines = {GUIDED: modules.line_of([good] * 20)}
    assert all(each.verdict == "goal" for each in modules.figures(lines, 0.1))
    (name, tilt, *_), *_ = modules.table_of(lines).rows
    assert (name, tilt) == (GUIDED, "0.030 / 0.030")


def test_a_perfect_calibration_has_no_error() -> None:
    same = Affine(np.eye(3), np.zeros(3))
    found = simulated.errors(calibrated(), same, same)
    assert found == pytest.approx({"tilt": 0.0, "heading": 0.0, "own": 0.0})
    turned = Affine(np.diag([1.0, 1.0, 1.02]), np.zeros(3))
    assert simulated.errors(calibrated(), turned, same)["tilt"] > 0.2


def test_an_uneven_field_has_its_size_over_its_distance() -> None:
    slopes = np.array(simulated.uneven(2.0, random()).gradient_ut_m)
    assert np.array_equal(slopes, slopes.T)
    assert np.trace(slopes) == pytest.approx(0.0, abs=1e-12)
    size = np.linalg.norm(slopes) * simulated.UNEVEN_OVER_M / 1.2
    assert size == pytest.approx(2.0)
