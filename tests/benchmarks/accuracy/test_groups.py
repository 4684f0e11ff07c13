# SPDX-License-Identifier: MIT
"""The benchmark on simulated recordings: its report of given results, and of one that
it measures."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import groups, groups_report
from benchmarks.accuracy.groups_report import Outcome
from benchmarks.common import feed, scoring
from benchmarks.common.scoring import Coverage, Score
from imud.virtual.motions.groups import JUDGING, TUNING, Recipe


def outcome(
    group: str = "pendulum",
    seed: int = 0,
    heading: float = 1.0,
    inclination: float = 0.5,
    coverage: tuple[float, float] = (0.95, 0.94),
) -> Outcome:
    scores = {
        "host": Score(1.0, heading, inclination),
        "vqf": Score(2.5, 2.0, 1.0),
    }
    shares = Coverage(*coverage, 0.0, 0.0, 0.25, 2.0)
    return Outcome(Recipe(group, seed), "nano", scores, shares)


def test_a_recording_is_worse_by_a_fifth_and_half_a_degree() -> None:
    assert not outcome().is_worse
    assert not outcome(heading=2.49).is_worse  # not by half a degree
    assert outcome(heading=2.51).is_worse
    assert outcome(inclination=1.51).is_worse
    small = Outcome(
        Recipe("pendulum", 0),
        "nano",
        {"host": Score(5.0, 5.5, 0.0), "vqf": Score(4.8, 4.8, 0.0)},
        Coverage(1.0, 1.0, 0.0, 0.0),
    )
    assert not small.is_worse  # not by a fifth


def test_magnets_are_a_group_of_their_own() -> None:
    with_magnet = outcome(seed=12, heading=9.0)
    assert with_magnet.recipe.room == "magnet"
    found = groups_report.by_group([outcome(), outcome(seed=2), with_magnet])
    assert list(found) == ["pendulum", "magnet"]
    assert found["pendulum"].count == 2
    assert found["pendulum"].ratio("heading") == pytest.approx(0.5)
    assert found["magnet"].ratio("heading") == pytest.approx(4.5)


def test_a_summary_is_of_the_means() -> None:
    found = groups_report.by_group([outcome(heading=1.0), outcome(heading=3.0)])
    summary = found["pendulum"]
    assert summary.ratio("heading") == pytest.approx(1.0)
    assert summary.worse == pytest.approx(0.5)
    assert summary.tilt_stated == pytest.approx(0.5)
    assert summary.heading_stated == pytest.approx(1.0)
    assert summary.cells() == [
        *("2", "2.00 / 2.00 = 1.00", "0.50 / 1.00 = 0.50"),
        *("50", "95  0.50", "94  1.00"),
    ]


def test_the_figures_are_of_the_worst_group() -> None:
    outcomes = [
        outcome(),
        outcome("robot_arm", heading=3.0, coverage=(0.99, 0.80)),
        outcome("vehicle", inclination=0.9, coverage=(0.85, 0.94)),
        outcome("east_pendulum", heading=16.0, coverage=(0.1, 0.1)),
    ]
    found = {each.name: each for each in groups_report.figures(outcomes)}
    assert len(found) == 7
    heading = found["heading / VQF, worst group"]
    assert (heading.value, heading.detail) == (1.5, "robot_arm")
    assert heading.verdict == "MISSED"
    inclination = found["inclination / VQF, worst group"]
    assert (inclination.value, inclination.detail) == (0.9, "vehicle")
    assert inclination.verdict == "must"
    assert found["recordings worse than VQF, %"].value == 50.0
    tilt = found["tilt inside 1.96 sigma, %, worst group"]
    assert (tilt.value, tilt.detail) == (85.0, "vehicle")
    assert found["heading inside 1.96 sigma, %, worst group"].value == 80.0
    assert found["heading / VQF, east_pendulum"].value == 8.0


def test_what_is_withheld_is_counted_without_magnets() -> None:
    magnet = outcome(seed=12)
    magnet = replace(magnet, coverage=replace(magnet.coverage, heading_null=0.9))
    plain = outcome()
    stuck = replace(plain, coverage=replace(plain.coverage, heading_null=0.03))
    outcomes = [plain, plain, stuck, outcome("vehicle"), magnet]
    found = {each.name: each for each in groups_report.figures(outcomes)}
    figure = found["heading withheld, without a magnet, %"]
    assert figure.value == pytest.approx(0.75)
    assert figure.verdict == "must"


def test_the_east_pendulum_alone_has_one_figure() -> None:
    found = list(groups_report.figures([outcome("east_pendulum", heading=1.9)]))
    assert [each.verdict for each in found] == ["goal"]
    assert groups_report.by_condition([outcome("east_pendulum")]) == {}


def test_the_median_of_stated_errors_leaves_out_the_rest() -> None:
    motion = Recipe("east_pendulum", 1).made()
    times = np.array([1.0, 9.0, 10.0, 11.0, 12.0])  # it rests for 8 s
    quats = np.tile([1.0, 0.0, 0.0, 0.0], (5, 1))
    tilt = np.array([99.0, 1.0, 2.0, 3.0, np.nan])
    found = scoring.coverage_at(times, quats, tilt, np.full(5, np.nan), motion)
    assert found.tilt_sigma_deg == 2.0
    assert math.isnan(found.heading_sigma_deg)


@pytest.mark.nightly
def test_a_recording_is_scored_as_broad_is() -> None:
    recipe = Recipe("east_pendulum", 1)
    (found,) = groups.measure(recipe, ["nano"], ["host", "vqf"])
    motion = recipe.made()
    vqf = groups.engines.ENGINES["vqf"](feed.sampled(motion))
    assert found.scores["vqf"] == scoring.score_at(vqf.times_s, vqf.quats, motion)
    # VQF holds on this pendulum: 2.0 degrees in the study that found it.
    assert found.scores["vqf"].heading == pytest.approx(2.0, abs=0.3)


@pytest.mark.nightly
def test_the_program_prints_tables_and_writes_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "groups.json"
    words = ["--groups", "east_pendulum", "--sets", JUDGING, "--boards", "nano"]
    words += ["--engines", "madgwick", "--jobs", "1", "--each"]
    status = groups.main([*words, "--output", str(path)])
    output = capsys.readouterr().out
    assert "judging, nano, by group" in output
    assert "east_pendulum 1" in output
    assert "madgwick" in output
    document = json.loads(path.read_text())
    (figure,) = document["sets"][JUDGING]["nano"]["figures"]
    assert status == (figure["verdict"] == "MISSED")
    assert TUNING not in document["sets"]
    (recording,) = document["recordings"]
    assert set(recording["scores"]) == {"host", "vqf", "madgwick"}
    assert (recording["room"], recording["module"]) == ("east", "crossed")


def test_further_seeds_are_odd_ones_beyond_those_for_judging(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Recipe] = []

    def measured(recipes: list[Recipe], _: object) -> list[Outcome]:
        seen.extend(recipes)
        return [outcome(each.group, each.seed, heading=2.9) for each in recipes]

    monkeypatch.setattr(groups, "measure_all", measured)
    monkeypatch.setattr(groups, "FURTHER", tmp_path / "further.json")
    words = "--further --groups pendulum east_pendulum --boards nano"
    assert groups.main(words.split()) == 0
    assert {each.group for each in seen} == {"pendulum"}
    assert [each.seed for each in seen] == [*range(29, 112, 2)]
    document = json.loads((tmp_path / "further.json").read_text())
    assert list(document) == ["29 to 55", "57 to 83", "85 to 111"]
    for each in document.values():
        assert (each["nano"]["recordings"], each["nano"]["worse"]) == (14, 14)
