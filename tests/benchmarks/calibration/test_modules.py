# SPDX-License-Identifier: MIT
"""The benchmark of calibrations: its cases, its verdicts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from benchmarks.calibration import asking, cases, modules, report, simulated
from benchmarks.calibration.cases import CASES, Case
from benchmarks.calibration.report import GUIDED, Results
from benchmarks.common.figure import SETS
from benchmarks.pictures import poses
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
    assert row["housing"] < 0.15
    assert row["seconds"] == pytest.approx(54.0)
    assert report.is_good(row)


def test_tuning_and_judging_share_no_seed() -> None:
    assert set(SETS.values()) == {0, 1}
    seeds = [cases.crowd(2 * n + modules.CROWD_SEED) for n in range(40)]
    assert len({each.user for each in seeds}) == 6
    assert {each.is_held for each in seeds} == {True, False}


def row(tilt: float, refused: str | None) -> dict[str, Any]:
    return {"tilt": tilt, "heading": 1.0, "refused": refused}


def test_wrong_verdicts_are_counted() -> None:
    rows = [row(0.1, None), row(0.1, None), row(0.2, "weak"), row(2.0, "weak")]
    rows += [row(0.9, None), {"refused": "too_few"}]
    wrong, lost, *_ = report.of_crowd(rows)
    assert wrong.value == pytest.approx(100.0 / 3.0)
    assert lost.value == pytest.approx(100.0 / 3.0)
    assert "3 accepted, 3 good of 6" in wrong.detail
    # Who is asked for poses lays them: one is accepted, one is still too weak.
    rows[2] |= {"asked": row(0.05, None)}
    rows[3] |= {"asked": row(1.5, "weak")}
    *before, wrong, lost = report.of_crowd(rows)
    assert [each.value for each in before] == pytest.approx([100.0 / 3.0] * 2)
    assert wrong.value == pytest.approx(25.0)
    assert lost.value == 0.0
    assert "4 accepted, 3 good of 6" in wrong.detail


def test_who_is_asked_for_poses_lays_them_and_is_accepted() -> None:
    case = Case("lazy", poses=5, user="lazy")
    refused = modules.measure((case, 4))
    assert refused["refused"] == "missing_poses"
    laid = cases.laid(case, 4)
    asked = asking.laid_as_asked(laid, asking.judged(laid.recording()))
    assert asked["refused"] is None
    assert 0 < asked["more"] < 12
    assert report.is_good(asked)
    assert asked["tilt"] < refused["tilt"]


def test_a_fit_that_failed_is_infinitely_wrong(
    capsys: pytest.CaptureFixture[str],
) -> None:
    results = Results("tuning")
    good = {"tilt": 0.03, "heading": 0.1, "scale": 0.05, "housing": 0.05}
    results.cases[GUIDED] = [good | {"seconds": 54.0}] * 18 + [{"seconds": 14.0}] * 2
    (tilt, *_) = report.figures(results)
    assert tilt.verdict == "MISSED"
    results.cases[GUIDED] = [good | {"seconds": 54.0}] * 20
    assert all(each.verdict == "goal" for each in report.figures(results))
    report.show(results)
    assert "goal" in capsys.readouterr().out


def test_what_documents_cite_is_written_by_part() -> None:
    results = Results("judging")
    assert report.parts_of(results) == {}
    good = {"tilt": 0.03, "heading": 0.1, "scale": 0.05, "housing": 0.05}
    results.cases[GUIDED] = [good | {"seconds": 54.0}] * 19 + [{"seconds": 60.0}]
    results.methods = [{"none": {"tilt": 2.0}, "extremes": {"heading": 5.0}}]
    results.crowd = [row(0.1, None), row(0.2, "weak") | {"asked": row(0.1, None)}]
    results.crowd[1]["asked"]["more"] = 2
    parts = report.parts_of(results)
    assert list(parts) == ["cases", "crowd"]
    cases = parts["cases"]
    assert (cases["modules"], cases["seconds"]) == (20, 54.0)
    # One fit of 20 failed: there is no 95th percentile.
    assert cases["cases"][GUIDED]["tilt"] == {"median": 0.03, "p95": None}
    assert cases["methods"]["none"] == {"tilt": {"median": 2.0, "p95": 2.0}}
    assert parts["crowd"]["asked for poses"]["accepted"] == 2
    assert parts["crowd"]["as they are"]["good_refused"] == 1
    told = [
        parts["crowd"][f"lacked{name}"] for name in ("", "_accepted", "_accepted_soon")
    ]
    assert told == [1, 1, 1]


def test_a_perfect_calibration_has_no_error() -> None:
    same = Affine(np.eye(3), np.zeros(3))
    found = simulated.affine_errors(calibrated(), same, same)
    assert found == {"tilt": pytest.approx(0.0), "heading": pytest.approx(0.0)}
    turned = Affine(np.diag([1.0, 1.0, 1.02]), np.zeros(3))
    assert simulated.affine_errors(calibrated(), turned, same)["tilt"] > 0.2


def test_the_picture_of_the_poses_is_the_one_in_the_docs() -> None:
    assert poses.OUTPUT.read_text() == poses.drawn()
    assert poses.drawn().count("<text") > 36


def test_an_uneven_field_has_its_size_over_its_distance() -> None:
    world = simulated.uneven(2.0, random())
    slopes = np.array(world.gradient_ut_m)
    assert np.array_equal(slopes, slopes.T)
    assert np.trace(slopes) == pytest.approx(0.0, abs=1e-12)
    size = np.linalg.norm(slopes) * simulated.UNEVEN_OVER_M / 1.2
    assert size == pytest.approx(2.0)
    assert math.hypot(*simulated.EARTH.field_at(np.zeros((1, 3)))[0]) == pytest.approx(
        48.0, abs=0.05
    )
