# SPDX-License-Identifier: MIT
"""The benchmark on simulated recordings: what it judges, and one that it measures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.accuracy import groups
from benchmarks.accuracy.compared import Outcome, Summary
from benchmarks.common import engines, feed, scoring
from benchmarks.common.scoring import Coverage, Score
from benchmarks.harness import Figure
from imud.virtual.motions.groups import Recipe


def outcome(
    group: str = "pendulum",
    seed: int = 0,
    heading: float = 1.0,
    inclination: float = 0.5,
    coverage: tuple[float, float] = (0.95, 0.94),
) -> Outcome:
    scores = {
        "host": Score(1.0, heading, inclination, 0.25),
        "vqf": Score(2.5, 2.0, 1.0),
    }
    return Outcome(group, seed, scores, Coverage(*coverage, 0.0, 0.0, 0.25, 2.0))


def figures(outcomes: list[Outcome]) -> dict[str, Figure]:
    return {each.name: each for each in groups.figures(groups.by_group(outcomes))}


def test_a_recording_is_worse_by_a_fifth_and_half_a_degree() -> None:
    assert not outcome().is_worse
    assert not outcome(heading=2.49).is_worse  # not by half a degree
    assert outcome(heading=2.51).is_worse
    assert outcome(inclination=1.51).is_worse
    scores = {"host": Score(5.0, 5.5, 0.0), "vqf": Score(4.8, 4.8, 0.0)}
    assert not replace(outcome(), scores=scores).is_worse  # not by a fifth


def test_magnets_are_a_group_of_their_own() -> None:
    assert Recipe("pendulum", 12).room == "magnet"
    magnet = outcome(seed=12, heading=9.0)
    found = groups.by_group([outcome(), outcome(seed=2), magnet])
    assert list(found) == ["pendulum", "magnet"]
    assert found["pendulum"].count == 2
    assert found["pendulum"].ratio("heading") == pytest.approx(0.5)
    assert found["magnet"].ratio("heading") == pytest.approx(4.5)


def test_a_summary_is_of_the_means() -> None:
    summary = Summary.of([outcome(heading=1.0), outcome(heading=3.0)])
    assert summary.row("pendulum") == {
        "group": "pendulum",
        "count": 2,
        "heading": "2.00 / 2.00 = 1.00",
        "inclination": "0.50 / 1.00 = 0.50",
        "varying": "0.25",
        "worse": 50.0,
        "tilt in": "95, 0.50",
        "heading in": "94, 1.00",
        "withheld": 0.0,
    }


def test_the_figures_are_of_the_worst_group() -> None:
    found = figures(
        [
            outcome(),
            outcome("robot_arm", heading=3.0, coverage=(0.99, 0.80)),
            outcome("vehicle", inclination=0.9, coverage=(0.85, 0.94)),
            outcome("east_pendulum", heading=16.0, coverage=(0.1, 0.1)),
        ]
    )
    heading = found["heading / VQF, worst group"]
    assert (heading.value, heading.detail) == (1.5, "robot_arm")
    assert heading.verdict == "MISSED"
    inclination = found["inclination / VQF, worst group"]
    assert (inclination.value, inclination.detail) == (0.9, "vehicle")
    assert found["recordings worse than VQF, %"].value == 50.0
    tilt = found["tilt inside 1.96 sigma, %, worst group"]
    assert (tilt.value, tilt.detail) == (85.0, "vehicle")
    assert found["heading inside 1.96 sigma, %, worst group"].value == 80.0
    assert found["heading / VQF, east_pendulum"].value == 8.0


def test_what_is_withheld_is_counted_without_magnets() -> None:
    def null(given: Outcome, share: float) -> Outcome:
        return replace(given, coverage=replace(given.coverage, heading_null=share))

    withheld = [null(outcome(seed=12), 0.9), null(outcome(), 0.03)]
    found = figures([outcome(), outcome(), outcome("vehicle"), *withheld])
    figure = found["heading withheld, without a magnet, %"]
    assert figure.value == pytest.approx(0.75)
    assert figure.verdict == "must"


@pytest.mark.nightly
def test_a_recording_is_scored_as_broad_is() -> None:
    recipe = Recipe("east_pendulum", 1)
    found = groups.measure(recipe, "nano")
    motion = recipe.made()
    vqf = engines.ENGINES["vqf"](feed.sampled(motion))
    assert found.scores["vqf"] == scoring.score_at(vqf.times_s, vqf.quats, motion)
    # VQF holds on this pendulum: 2.0 degrees in the study that found it.
    assert found.scores["vqf"].heading == pytest.approx(2.0, abs=0.3)


@pytest.mark.nightly
def test_one_group_is_measured(tmp_path: Path) -> None:
    path = tmp_path / "motions.json"
    words = ["--groups", "east_pendulum", "--jobs", "1", "--output", str(path)]
    assert groups.main(arguments=words) == 0
    found = json.loads(path.read_text())
    ((name, count, *_),) = found["tables"]["groups"]["rows"]
    assert (name, count) == ("east_pendulum", 8)
    assert [each["name"] for each in found["figures"]] == [
        "heading / VQF, east_pendulum"
    ]
